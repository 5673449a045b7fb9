"""The tokenizer: byte-level BPE with each digit a token, and the special tokens.

Texts are cut before BPE as llama.cpp's `tokenizer.ggml.pre` "smollm" does it: each digit by itself,
then GPT-2's rule. So numbers are read digit by digit, and both tokenizers agree.
"""

from collections.abc import Iterable
from pathlib import Path

from tokenizers import AddedToken, Tokenizer, decoders, models, pre_tokenizers, trainers

PRE = "smollm"
"""The rule's name in llama.cpp."""

END_OF_TEXT = "<|endoftext|>"  # also pads
TURN, END_OF_TURN = "<|im_start|>", "<|im_end|>"
PICTURE = "<image>"  # stands for a picture once for each of its tokens
PICTURE_START, PICTURE_END = "<|image_start|>", "<|image_end|>"  # llama.cpp puts them around it
CALL, END_OF_CALL = "<tool_call>", "</tool_call>"
SPECIAL = (
    END_OF_TEXT,
    TURN,
    END_OF_TURN,
    PICTURE,
    PICTURE_START,
    PICTURE_END,
    CALL,
    END_OF_CALL,
)
"""The special tokens, in the order of their numbers, which begin at 0."""


WHOLE = tuple(
    before + f'"{name}":' + after
    for name, before, after in (
        ("pose_check", "{", '"'),
        ("compression_check", '",', '"'),
        ("table_i", '",', '"'),
        ("picture", '",', '"'),
        ("conflict", '",', '"'),
        ("reason", '",', '"'),
        ("success", '",', ""),
        ("bottom_left_corner", "{", '"'),
        ("bottom_right_corner", '",', '"'),
        ("what_happened", '",', '"'),
        ("why", '",', '"'),
        ("wrong_goal", '",', '"'),
        ("how_to_recover", '",', '"'),
        ("fit_y_change_mm", '",', ""),
        ("fit_y_change_mm", ",", ""),
        ("align_y_change_mm", ",", ""),
        ("insertion_z_change_mm", ",", ""),
        ("x_motion_mm", ",", ""),
        ("pitch_motion_deg", ",", ""),
        ("yaw_motion_deg", ",", ""),
        ("fit_x_change_mm", ",", ""),
        ("fit_pitch_change_deg", ",", ""),
        ("fit_yaw_change_deg", ",", ""),
        ("align_x_change_mm", ",", ""),
        ("align_pitch_change_deg", ",", ""),
        ("align_yaw_change_deg", ",", ""),
        ("resume_from", "{", '"'),
        ("retreat_first", '",', ""),
        ("retreat_first", ",", ""),
        ("steps", "{", "["),
        ("skill", "{", '"'),
        ("goal_mm", '",', ""),
        ("x_mm", ",", ""),
        ("pitch_deg", ",", ""),
        ("yaw_deg", ",", ""),
    )
) + ('{"name": "', '", "arguments": ')
"""What replies are made of beside words and numbers: each is one token."""


def trained(texts: Iterable[str], size: int) -> Tokenizer:
    """A tokenizer of at most `size` tokens. Special tokens, the 256 bytes and the digits are
    always among them; `texts` should not hold special tokens."""
    tokenizer = Tokenizer(models.BPE())
    cut_as_smollm(tokenizer)
    tokenizer.train_from_iterator(
        texts,
        trainers.BpeTrainer(
            vocab_size=size - len(WHOLE),
            special_tokens=[AddedToken(token, special=True, normalized=False) for token in SPECIAL],
            initial_alphabet=pre_tokenizers.ByteLevel.alphabet(),
            show_progress=False,
        ),
    )
    tokenizer.add_tokens([AddedToken(text, special=False, normalized=False) for text in WHOLE])
    return tokenizer


def cut_as_smollm(tokenizer: Tokenizer) -> None:
    """Cut texts as llama.cpp's rule does before bytes are joined."""
    tokenizer.pre_tokenizer = pre_tokenizers.Sequence(
        [
            pre_tokenizers.Digits(individual_digits=True),
            pre_tokenizers.ByteLevel(add_prefix_space=False, use_regex=True),
        ]
    )
    tokenizer.decoder = decoders.ByteLevel()


def load(path: Path) -> Tokenizer:
    return Tokenizer.from_file(str(path))


def number(tokenizer: Tokenizer, token: str) -> int:
    """The number of a token that there is."""
    found = tokenizer.token_to_id(token)
    assert found is not None, token
    return int(found)


def chat_template() -> str:
    """The template of conversations, in Jinja."""
    return Path(__file__).with_name("chat_template.jinja").read_text(encoding="utf-8").strip()


def picture_text(tokens: int) -> str:
    """What stands for a picture of so many tokens where llama.cpp's server puts one."""
    return PICTURE_START + tokens * PICTURE + PICTURE_END
