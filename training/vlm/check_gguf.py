"""Checks that llama.cpp and transformers compute from an export what model.py does.

    python check_gguf.py [--default-size] [--type f16]

A model with random weights is exported, served by llama.cpp with one thread, and asked to continue
prompts with no, one and two pictures. Its tokens' log probabilities must be those of model.py, and
so must the logits of the transformers folder. As a measure, it is said how much they change where
something is wrong on purpose. With `--default-size`, speeds and memory follow.
"""

import argparse
import base64
import copy
import json
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.request import Request, urlopen

import numpy as np
import tokenizer as words
import torch
from export_gguf import TYPES, export
from model import SIZES, Model, Size
from numpy.typing import NDArray
from tokenizers import Tokenizer
from torch import Tensor
from torch.nn import functional
from transformers import AutoModelForImageTextToText, AutoTokenizer

from pliant import pictures
from pliant.reasoners.vlm import local

CONTINUED = 12  # tokens
MOST_LIKELY = 20  # tokens whose log probabilities are compared at each place
TOLERANCE = {"f32": 0.02, "f16": 0.05, "q8_0": 0.5}
"""Of a log probability: llama.cpp rounds keys, values and what it multiplies with F16 matrices to
F16, looks GELU up in a table of F16, and rounds what it multiplies with Q8_0 ones to 8 bits."""


def lively(size: Size) -> Model:
    """A model with weights so large and positions so random that every part shows in the logits."""
    torch.manual_seed(1)
    model = Model(size).eval()
    with torch.no_grad():
        for weight in model.parameters():
            if weight.ndim > 1:
                weight.mul_(1.7)
            else:
                weight.add_(0.1 * torch.randn_like(weight))
        model.tower.positions.add_(0.5 * torch.randn_like(model.tower.positions))
    return model


def smooth_picture(size: Size, seed: int) -> NDArray[np.uint8]:
    """A picture (height, width, 3) of random colours that go over into each other."""
    coarse = torch.rand(1, 3, 9, 12, generator=torch.Generator().manual_seed(seed))
    fine = functional.interpolate(
        coarse, (size.picture_height, size.picture_width), mode="bicubic", align_corners=False
    )
    return (255 * fine[0].clamp(0, 1)).round().byte().permute(1, 2, 0).contiguous().numpy()


def as_pixels(shown: Sequence[NDArray[np.uint8]]) -> Tensor | None:
    """Pictures as the model takes them."""
    if not shown:
        return None
    stacked = torch.from_numpy(np.stack(shown)).permute(0, 3, 1, 2)
    return (stacked.float() / 255 - 0.5) / 0.5


def messages(texts: Sequence[str], shown: Sequence[NDArray[np.uint8]]) -> list[dict[str, Any]]:
    """A conversation as an OpenAI client sends it: a text, then pictures with a text each."""
    parts: list[dict[str, Any]] = [{"type": "text", "text": texts[0]}]
    for image, text in zip(shown, texts[1:], strict=False):
        data = base64.b64encode(pictures.encoded(image)).decode()
        parts.append({"type": "image_url", "image_url": {"url": f"data:image/png;base64,{data}"}})
        parts.append({"type": "text", "text": text})
    system = {"role": "system", "content": "You judge what a robot did."}
    return [system, {"role": "user", "content": parts}]


def rendered(template: Any, conversation: Sequence[Mapping[str, Any]], size: Size) -> str:
    """The prompt of a conversation, by the template in the transformers folder."""
    turns = [dict(turn) for turn in conversation]
    turns[-1]["content"] = [
        {"type": "image"} if part["type"] == "image_url" else part for part in turns[-1]["content"]
    ]
    told: str = template.apply_chat_template(turns, tokenize=False, add_generation_prompt=True)
    return told.replace(words.PICTURE, words.picture_text(size.picture_tokens))


def posted(server: local.Server, path: str, body: Mapping[str, Any]) -> dict[str, Any]:
    """What the server replies; `path` begins at its root."""
    url = server.base_url.removesuffix("/v1") + path
    request = Request(url, json.dumps(body).encode(), {"Content-Type": "application/json"})
    with urlopen(request) as reply:
        told: dict[str, Any] = json.load(reply)
    return told


def asked(server: local.Server, conversation: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The server's likeliest continuation in ASCII, with log probabilities."""
    return posted(
        server,
        "/v1/chat/completions",
        {
            "messages": conversation,
            "max_tokens": CONTINUED,
            "temperature": 0,
            "logprobs": True,
            "top_logprobs": MOST_LIKELY,
            "cache_prompt": False,
            # The log probabilities of bytes that are no character yet are not given.
            "grammar": "root ::= [ -~]*",
        },
    )


@torch.no_grad()
def compared(
    model: Model, reply: Mapping[str, Any], prompt: Sequence[int], pixels: Tensor | None, place: int
) -> tuple[float, int, int]:
    """The largest difference of a log probability between the server's reply and `model`; at how
    many of how many places both find the same token likeliest."""
    steps = reply["choices"][0]["logprobs"]["content"]
    tokens = [*prompt, *(step["id"] for step in steps)]
    logits = model(torch.tensor([tokens]), pixels, place)[0, len(prompt) - 1 : -1]
    ours = logits.double().log_softmax(-1)
    apart = max(
        abs(top["logprob"] - float(ours[n, top["id"]]))
        for n, step in enumerate(steps)
        for top in step["top_logprobs"]
    )
    likeliest = [step["top_logprobs"][0]["id"] for step in steps]
    same = sum(int(ours[n].argmax()) == token for n, token in enumerate(likeliest))
    return apart, same, len(steps)


def wrong(model: Model) -> Iterator[tuple[str, Model]]:
    """The model with a fault each, to see that it would show."""
    size = model.size
    for name in ("no position embeddings", "positions column by column", "blocks column by column"):
        faulty = copy.deepcopy(model)
        with torch.no_grad():
            if name.startswith("no"):
                faulty.tower.positions.zero_()
            elif name.startswith("positions"):
                grid = model.tower.positions.view(size.columns, size.rows, -1)
                faulty.tower.positions.copy_(grid.transpose(0, 1).flatten(0, 1))
            else:
                by_patch = model.tower.projector1.weight.unflatten(1, (2, 2, -1))
                faulty.tower.projector1.weight.copy_(by_patch.transpose(1, 2).flatten(1))
        yield name, faulty


@torch.no_grad()
def transformers_apart(
    model: Model, folder: Path, prompt: Sequence[int], pixels: Tensor | None, place: int
) -> float:
    """The largest difference of a logit between the transformers folder and `model`."""
    size = model.size
    other = AutoModelForImageTextToText.from_pretrained(folder, dtype=torch.float32).eval()
    given: dict[str, Tensor] = {}
    if pixels is not None:
        patches = pixels.unfold(2, size.patch, size.patch).unfold(3, size.patch, size.patch)
        given["pixel_values"] = patches.permute(0, 2, 3, 4, 5, 1).flatten(3).flatten(1, 2)
        given["pixel_attention_mask"] = torch.ones(given["pixel_values"].shape[:2]).long()
        given["spatial_shapes"] = torch.tensor([[size.rows, size.columns]] * len(pixels))
    tokens = torch.tensor([prompt])
    theirs = other(input_ids=tokens, attention_mask=torch.ones_like(tokens), **given).logits
    return float((theirs - model(tokens, pixels, place)).abs().max())


def tokenized_alike(server: local.Server, tokenizer: Tokenizer, texts: Sequence[str]) -> int:
    """How many texts the server cuts into tokens as `tokenizer` does; says those that differ."""
    alike = 0
    for text in texts:
        theirs = posted(server, "/tokenize", {"content": text, "parse_special": True})["tokens"]
        ours = tokenizer.encode(text).ids
        alike += theirs == ours
        if theirs != ours:
            print(f"   tokens differ: {text!r}: {theirs} and {ours}")
    return alike


def samples() -> list[str]:
    """200 texts: of pliant's own files, and some with what is rare."""
    rare = [
        "y_mm -35.2, roll_deg 10.0 ± 0.3",
        "  two  spaces,\ttab\n\nlines \n",
        '{"success": false, "reason": "it’s"}',
        "I'll don't we've IT'S",
        "x²½ Ⅷ ٣ 12345 1.5e-3",
        "naïve größer 漢字 🙂 –—…",
        "<|im_start|>user\nhi<|im_end|>\n<|image_start|><|image_end|><tool_call>{}</tool_call>",
        "trailing spaces   ",
        "\r\n\r\n a\u00a0b\u2003c",
        "|no|skill|\n|--|--|\n|1|insert|",
    ]
    root = Path(pictures.__file__).parent
    lines = [x for p in sorted(root.rglob("*.py")) for x in p.read_text("utf-8").split("\n\n")]
    return rare + lines[:: max(1, len(lines) // (200 - len(rare)))][: 200 - len(rare)]


def trained_on_pliant(size: Size) -> Tokenizer:
    """A tokenizer of pliant's own files; of them there are enough for the default size."""
    root = Path(pictures.__file__).parent
    texts = (p.read_text(encoding="utf-8") for p in sorted(root.rglob("*.py")))
    return words.trained(texts, size.vocabulary)


def check(size: Size, folder: Path, kind: str, *, speeds: bool) -> bool:
    """Does it all and prints it; whether all is as it should be."""
    model, tokenizer = lively(size), trained_on_pliant(size)
    export(model, tokenizer, folder, kind=kind)
    place = words.number(tokenizer, words.PICTURE)
    template = AutoTokenizer.from_pretrained(folder / "transformers")
    images = [smooth_picture(size, seed) for seed in range(3)]
    texts = ["Picture of 12.5 mm:", " And\n", " What is it?"]
    good = True
    weights = local.tuned(folder / local.MODEL, folder / local.PROJECTOR)
    with local.serving(weights) as server:
        cut = samples()
        alike = tokenized_alike(server, tokenizer, cut)
        print(f"tokens: {alike} of {len(cut)} texts alike; {tokenizer.get_vocab_size()} tokens")
        good &= alike == len(cut)
        for count in range(3):
            conversation = messages(texts[: count + 1], images[:count])
            prompt = tokenizer.encode(rendered(template, conversation, size)).ids
            pixels = as_pixels(images[:count])
            reply = asked(server, conversation)
            used = reply["usage"]["prompt_tokens"]
            apart, same, of = compared(model, reply, prompt, pixels, place)
            theirs = transformers_apart(model, folder / "transformers", prompt, pixels, place)
            print(
                f"{count} pictures: {used} tokens there, {len(prompt)} here;"
                f" llama.cpp: log probabilities within {apart:.4f}, {same} of {of} tokens the same;"
                f" transformers: logits within {theirs:.1e}"
            )
            good &= used == len(prompt) and apart < TOLERANCE[kind] and theirs < 1e-3
            if count:
                swapped = as_pixels([images[2], *images[1:count]])
                apart = compared(model, reply, prompt, swapped, place)[0]
                print(f"   another picture: {apart:.3f}")
                for name, faulty in wrong(model):
                    print(f"   {name}: {compared(faulty, reply, prompt, pixels, place)[0]:.3f}")
        if speeds:
            print_speeds(server, size)
    return good


def print_speeds(server: local.Server, size: Size) -> None:
    """Tokens per second of prompts and of replies, and milliseconds per picture, of one thread."""
    line = "Executed last: no 12, insert; goal: y_mm -35.2, z_mm 101.7, roll_deg 10.0.\n"
    asks: dict[str, list[dict[str, Any]]] = {"text": messages([20 * line], [])}
    shown = [smooth_picture(size, 10 + n) for n in range(3)]
    asks["text and 3 pictures"] = messages([20 * line, "", "", ""], shown)
    took: dict[str, float] = {}
    for name, conversation in asks.items():
        for n in range(3):  # the best of them
            body = {"messages": conversation, "max_tokens": 100, "ignore_eos": True, "seed": n}
            begun = time.perf_counter()
            timing = posted(server, "/v1/chat/completions", {**body, "cache_prompt": False})[
                "timings"
            ]
            total_ms = 1e3 * (time.perf_counter() - begun)
            ms = timing["prompt_ms"]
            if ms < took.get(name, np.inf):
                took[name] = ms
                speed = (timing["prompt_per_second"], timing["predicted_per_second"])
                told = f"prompt of {timing['prompt_n']} tokens {ms:.0f} ms, {speed[0]:.0f} tokens/s"
                said = f"{name}: {told}; reply {speed[1]:.0f} tokens/s; in all {total_ms:.0f} ms"
        print(said)
    each = (took["text and 3 pictures"] - took["text"]) / len(shown)
    print(f"a picture: {each:.0f} ms, its {size.picture_tokens} language tokens included")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--size", choices=SIZES, default="tiny")
    parser.add_argument("--type", choices=TYPES, default="f16")
    options = parser.parse_args()
    torch.set_num_threads(1)
    size = SIZES[options.size]
    with TemporaryDirectory() as folder:
        if not check(size, Path(folder), options.type, speeds=options.size != "tiny"):
            raise SystemExit("not as it should be")


if __name__ == "__main__":
    main()
