"""Writes a trained model for llama.cpp (model.gguf, mmproj.gguf) and for transformers (a folder).

python export_gguf.py checkpoint.pt tokenizer.json out_folder [--type f16]
"""

import argparse
import json
from pathlib import Path

import gguf
import numpy as np
import tokenizer as words
import torch
from model import Attention, LanguageBlock, Model, Size, VisionBlock, load
from numpy.typing import NDArray
from tokenizers import Tokenizer
from torch import Tensor, nn
from transformers import (
    Lfm2VlConfig,
    Lfm2VlForConditionalGeneration,
    LlamaConfig,
    PreTrainedTokenizerFast,
    Siglip2VisionConfig,
)

TYPES = {
    "q8_0": gguf.GGMLQuantizationType.Q8_0,
    "f16": gguf.GGMLQuantizationType.F16,
    "f32": gguf.GGMLQuantizationType.F32,
}
"""Of the language model's matrices."""

FILE_TYPES = {
    "q8_0": gguf.LlamaFileType.MOSTLY_Q8_0,
    "f16": gguf.LlamaFileType.MOSTLY_F16,
    "f32": gguf.LlamaFileType.ALL_F32,
}
NAME = "pliant-vlm"


def export(model: Model, tokenizer: Tokenizer, folder: Path, *, kind: str = "q8_0") -> None:
    """Writes all of it into `folder`. `kind` is one of `TYPES`; the tower is F16, or F32 with
    it."""
    folder.mkdir(parents=True, exist_ok=True)
    model = model.eval().float().cpu()
    with torch.no_grad():
        write_language(model, tokenizer, folder / "model.gguf", kind=kind)
        write_tower(model, folder / "mmproj.gguf", half=kind != "f32")
        write_transformers(model, tokenizer, folder / "transformers")


def write_language(model: Model, tokenizer: Tokenizer, path: Path, *, kind: str) -> None:
    """Writes the language model with its tokenizer and the template of conversations."""
    size, language = model.size, model.language
    file = gguf.GGUFWriter(path, "llama")
    file.add_name(NAME)
    file.add_file_type(FILE_TYPES[kind])
    file.add_context_length(size.context)
    file.add_embedding_length(size.width)
    file.add_block_count(size.layers)
    file.add_feed_forward_length(size.mlp)
    file.add_head_count(size.heads)
    file.add_head_count_kv(size.heads)
    file.add_rope_freq_base(size.rope_base)
    file.add_rope_dimension_count(size.width // size.heads)
    file.add_layer_norm_rms_eps(size.eps)
    file.add_vocab_size(size.vocabulary)
    add_tokenizer(file, tokenizer, size.vocabulary)

    matrix = TYPES[kind]
    add(file, "token_embd.weight", language.embedding.weight, matrix)
    add(file, "output_norm.weight", language.norm.weight)
    for n, block in enumerate(language.blocks):
        assert isinstance(block, LanguageBlock)
        q, k, v = block.attention.qkv.weight.chunk(3)
        add(file, f"blk.{n}.attn_norm.weight", block.norm1.weight)
        add(file, f"blk.{n}.attn_q.weight", interleaved(q, size.heads), matrix)
        add(file, f"blk.{n}.attn_k.weight", interleaved(k, size.heads), matrix)
        add(file, f"blk.{n}.attn_v.weight", v, matrix)
        add(file, f"blk.{n}.attn_output.weight", block.attention.out.weight, matrix)
        add(file, f"blk.{n}.ffn_norm.weight", block.norm2.weight)
        add(file, f"blk.{n}.ffn_gate.weight", block.gate.weight, matrix)
        add(file, f"blk.{n}.ffn_up.weight", block.up.weight, matrix)
        add(file, f"blk.{n}.ffn_down.weight", block.down.weight, matrix)
    finish(file)


def add_tokenizer(file: gguf.GGUFWriter, tokenizer: Tokenizer, vocabulary: int) -> None:
    """The tokens and their merges; places of the vocabulary that no token has are unused ones."""
    held = {number: token for token, number in tokenizer.get_vocab().items()}
    tokens = [held.get(n, f"<|unused_{n}|>") for n in range(vocabulary)]
    types = [
        gguf.TokenType.CONTROL
        if token in words.SPECIAL
        else (gguf.TokenType.NORMAL if n in held else gguf.TokenType.UNUSED)
        for n, token in enumerate(tokens)
    ]
    # Of user-defined tokens the text comes out, and the server looks for it.
    for token in (words.CALL, words.END_OF_CALL, *words.WHOLE):
        types[tokens.index(token)] = gguf.TokenType.USER_DEFINED
    file.add_tokenizer_model("gpt2")
    file.add_tokenizer_pre(words.PRE)
    file.add_token_list(tokens)
    file.add_token_types(types)
    file.add_token_merges(merges(tokenizer))
    end, turn_end = (tokens.index(t) for t in (words.END_OF_TEXT, words.END_OF_TURN))
    file.add_bos_token_id(end)
    file.add_eos_token_id(turn_end)
    file.add_pad_token_id(end)
    file.add_add_bos_token(False)
    file.add_add_eos_token(False)
    file.add_chat_template(words.chat_template())


def merges(tokenizer: Tokenizer) -> list[str]:
    """The pairs that BPE joins, in their order."""
    pairs = json.loads(tokenizer.to_str())["model"]["merges"]
    return [pair if isinstance(pair, str) else " ".join(pair) for pair in pairs]


def interleaved(weight: Tensor, heads: int) -> Tensor:
    """Rows of a query's or key's matrix in llama.cpp's order for RoPE: the halves of a head, whose
    elements go together in pairs, by turns."""
    return weight.unflatten(0, (heads, 2, -1)).transpose(1, 2).flatten(0, 2)


def write_tower(model: Model, path: Path, *, half: bool) -> None:
    """Writes the picture tower as llama.cpp's projector `lfm2`, which takes pictures of 64 to 256
    tokens as they are."""
    size, tower = model.size, model.tower
    file = gguf.GGUFWriter(path, "clip")
    file.add_name(NAME)
    file.add_type("mmproj")
    file.add_file_type(gguf.LlamaFileType.MOSTLY_F16 if half else gguf.LlamaFileType.ALL_F32)
    file.add_clip_has_vision_encoder(True)
    file.add_clip_projector_type("lfm2")
    file.add_vision_projection_dim(size.width)
    file.add_vision_image_size(grid_side(size) * size.patch)
    file.add_vision_patch_size(size.patch)
    file.add_vision_image_mean([0.5] * 3)
    file.add_vision_image_std([0.5] * 3)
    file.add_vision_embedding_length(size.vision_width)
    file.add_vision_feed_forward_length(size.vision_mlp)
    file.add_vision_block_count(size.vision_layers)
    file.add_vision_head_count(size.vision_heads)
    file.add_vision_attention_layernorm_eps(size.vision_eps)
    file.add_vision_projector_scale_factor(size.merge)
    file.add_vision_use_gelu(True)
    file.add_uint32("pliant.picture_height", size.picture_height)  # for `read_gguf.py`

    matrix = TYPES["f16" if half else "f32"]
    add(file, "v.patch_embd.weight", tower.patches.weight, matrix)
    add(file, "v.patch_embd.bias", tower.patches.bias)
    add(file, "v.position_embd.weight", position_grid(tower.positions, size))
    for n, block in enumerate(tower.blocks):
        assert isinstance(block, VisionBlock)
        parts: dict[str, nn.LayerNorm | nn.Linear] = {
            "ln1": block.norm1,
            "ln2": block.norm2,
            "attn_out": block.attention.out,
            "ffn_up": block.up,
            "ffn_down": block.down,
        }
        for name, part in parts.items():
            flat = name.startswith("ln")
            add(file, f"v.blk.{n}.{name}.weight", part.weight, TYPES["f32"] if flat else matrix)
            add(file, f"v.blk.{n}.{name}.bias", part.bias)
        for name, (weight, bias) in qkv(block.attention).items():
            add(file, f"v.blk.{n}.attn_{name}.weight", weight, matrix)
            add(file, f"v.blk.{n}.attn_{name}.bias", bias)
    add(file, "v.post_ln.weight", tower.norm.weight)
    add(file, "v.post_ln.bias", tower.norm.bias)
    add(file, "mm.input_norm.weight", tower.projector_norm.weight)
    add(file, "mm.input_norm.bias", tower.projector_norm.bias)
    add(file, "mm.1.weight", tower.projector1.weight, matrix)
    add(file, "mm.1.bias", tower.projector1.bias)
    add(file, "mm.2.weight", tower.projector2.weight, matrix)
    add(file, "mm.2.bias", tower.projector2.bias)
    finish(file)


def qkv(attention: Attention) -> dict[str, tuple[Tensor, Tensor]]:
    """The weights and biases of query, key and value, by their letters."""
    weights, biases = attention.qkv.weight.chunk(3), attention.qkv.bias.chunk(3)
    return dict(zip("qkv", zip(weights, biases, strict=True), strict=True))


def grid_side(size: Size) -> int:
    """Rows and columns of the square grid of position embeddings that both programs hold."""
    return max(size.rows, size.columns)


def position_grid(positions: Tensor, size: Size) -> Tensor:
    """Position embeddings of a square grid (side², width), which both programs resize to that of
    the patches. Of all grids that give exactly `positions` then, it is the one with the least
    squares."""
    side = grid_side(size)
    down, across = (torch.linalg.pinv(resizing(side, n)) for n in (size.rows, size.columns))
    grid = positions.double().view(size.rows, size.columns, -1)
    return torch.einsum("ar,bc,rcw->abw", down, across, grid).flatten(0, 1).float()


def resizing(side: int, length: int) -> Tensor:
    """The matrix (length, side) that resizes a line: bilinear, with antialiasing."""
    unit = torch.eye(side, dtype=torch.float64)[None, None]
    resized = torch.nn.functional.interpolate(
        unit, (length, side), mode="bilinear", align_corners=False, antialias=True
    )
    return resized[0, 0]


def add(
    file: gguf.GGUFWriter,
    name: str,
    tensor: Tensor | None,
    kind: gguf.GGMLQuantizationType = gguf.GGMLQuantizationType.F32,
) -> None:
    assert tensor is not None, name
    values: NDArray[np.float32] = tensor.detach().float().contiguous().numpy()
    file.add_tensor(name, gguf.quants.quantize(values, kind), raw_dtype=kind)


def finish(file: gguf.GGUFWriter) -> None:
    file.write_header_to_file()
    file.write_kv_data_to_file()
    file.write_tensors_to_file()
    file.close()


def write_transformers(model: Model, tokenizer: Tokenizer, folder: Path) -> None:
    """Writes the folder that transformers loads with `AutoModelForImageTextToText`."""
    other = Lfm2VlForConditionalGeneration(transformers_config(model.size, tokenizer)).eval()
    missing, unexpected = other.load_state_dict(transformers_weights(model), strict=False)
    assert not unexpected, unexpected
    assert set(missing) <= {"lm_head.weight"}, missing  # tied
    other.tie_weights()
    other.save_pretrained(folder)
    fast = PreTrainedTokenizerFast(
        tokenizer_object=tokenizer,
        eos_token=words.END_OF_TURN,
        pad_token=words.END_OF_TEXT,
        extra_special_tokens={
            "image_token": words.PICTURE,
            "image_start_token": words.PICTURE_START,
            "image_end_token": words.PICTURE_END,
        },
        clean_up_tokenization_spaces=False,
        model_max_length=model.size.context,
    )
    fast.chat_template = words.chat_template()
    fast.save_pretrained(folder)


def transformers_config(size: Size, tokenizer: Tokenizer) -> Lfm2VlConfig:
    end, turn_end = (tokenizer.token_to_id(t) for t in (words.END_OF_TEXT, words.END_OF_TURN))
    return Lfm2VlConfig(
        vision_config=Siglip2VisionConfig(
            hidden_size=size.vision_width,
            intermediate_size=size.vision_mlp,
            num_hidden_layers=size.vision_layers,
            num_attention_heads=size.vision_heads,
            num_patches=grid_side(size) ** 2,
            patch_size=size.patch,
            hidden_act="gelu_pytorch_tanh",
            layer_norm_eps=size.vision_eps,
            vision_use_head=False,
        ),
        text_config=LlamaConfig(
            vocab_size=size.vocabulary,
            hidden_size=size.width,
            intermediate_size=size.mlp,
            num_hidden_layers=size.layers,
            num_attention_heads=size.heads,
            num_key_value_heads=size.heads,
            max_position_embeddings=size.context,
            rms_norm_eps=size.eps,
            rope_parameters={"rope_type": "default", "rope_theta": size.rope_base},
            tie_word_embeddings=True,
            bos_token_id=end,
            eos_token_id=turn_end,
            pad_token_id=end,
        ),
        image_token_id=words.number(tokenizer, words.PICTURE),
        projector_hidden_act="gelu_pytorch_tanh",
        projector_hidden_size=size.projector,
        projector_bias=True,
        projector_use_layernorm=True,
        downsample_factor=size.merge,
        tie_word_embeddings=True,
    )


def transformers_weights(model: Model) -> dict[str, Tensor]:
    """The weights under transformers' names."""
    size, tower, language = model.size, model.tower, model.language
    seen, bridge = "model.vision_tower.", "model.multi_modal_projector."
    told = "model.language_model."
    weights: dict[str, Tensor | None] = {
        f"{seen}embeddings.patch_embedding.weight": tower.patches.weight.permute(0, 2, 3, 1)
        .flatten(1)
        .contiguous(),
        f"{seen}embeddings.patch_embedding.bias": tower.patches.bias,
        f"{seen}embeddings.position_embedding.weight": position_grid(tower.positions, size),
        f"{told}embed_tokens.weight": language.embedding.weight,
        f"{told}norm.weight": language.norm.weight,
    }
    pairs: dict[str, nn.LayerNorm | nn.Linear] = {
        f"{seen}post_layernorm": tower.norm,
        f"{bridge}layer_norm": tower.projector_norm,
        f"{bridge}linear_1": tower.projector1,
        f"{bridge}linear_2": tower.projector2,
    }
    for n, block in enumerate(tower.blocks):
        assert isinstance(block, VisionBlock)
        at = f"{seen}encoder.layers.{n}."
        pairs[f"{at}layer_norm1"], pairs[f"{at}layer_norm2"] = block.norm1, block.norm2
        pairs[f"{at}mlp.fc1"], pairs[f"{at}mlp.fc2"] = block.up, block.down
        pairs[f"{at}self_attn.out_proj"] = block.attention.out
        for name, (weight, bias) in qkv(block.attention).items():
            weights[f"{at}self_attn.{name}_proj.weight"] = weight
            weights[f"{at}self_attn.{name}_proj.bias"] = bias
    for name, part in pairs.items():
        weights[f"{name}.weight"], weights[f"{name}.bias"] = part.weight, part.bias
    for n, block in enumerate(language.blocks):
        assert isinstance(block, LanguageBlock)
        at = f"{told}layers.{n}."
        for name, weight in zip("qkv", block.attention.qkv.weight.chunk(3), strict=True):
            weights[f"{at}self_attn.{name}_proj.weight"] = weight
        weights[f"{at}self_attn.o_proj.weight"] = block.attention.out.weight
        weights[f"{at}mlp.gate_proj.weight"] = block.gate.weight
        weights[f"{at}mlp.up_proj.weight"] = block.up.weight
        weights[f"{at}mlp.down_proj.weight"] = block.down.weight
        weights[f"{at}input_layernorm.weight"] = block.norm1.weight
        weights[f"{at}post_attention_layernorm.weight"] = block.norm2.weight
    return {
        name: weight.detach().clone().contiguous()
        for name, weight in weights.items()
        if weight is not None
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("tokenizer", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--type", choices=TYPES, default="q8_0")
    options = parser.parse_args()
    export(
        load(options.checkpoint),
        words.load(options.tokenizer),
        options.folder,
        kind=options.type,
    )
