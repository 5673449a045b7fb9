"""Reads weights that `export_gguf.py` wrote back into the model, to train on from them: rounded as
they were written."""

from pathlib import Path
from typing import Any

import gguf
import numpy as np
import tokenizer as words
import torch
from export_gguf import resizing
from model import Model, Size
from tokenizers import AddedToken, Tokenizer, models
from torch import Tensor

LANGUAGE, TOWER = "model.gguf", "mmproj.gguf"


def read_model(folder: Path) -> Model:
    """The model whose weights a folder holds."""
    language, tower = gguf.GGUFReader(folder / LANGUAGE), gguf.GGUFReader(folder / TOWER)
    size = _size(language, tower)
    model = Model(size)
    named = {**_tensors(language), **_tensors(tower)}
    with torch.no_grad():
        _fill_language(model, named)
        _fill_tower(model, named)
    return model


def read_tokenizer(folder: Path) -> Tokenizer:
    """The tokenizer that the language model's file holds."""
    reader = gguf.GGUFReader(folder / LANGUAGE)
    tokens = _field(reader, "tokenizer.ggml.tokens")
    kinds = _field(reader, "tokenizer.ggml.token_type")
    pairs = [tuple(merge.split(" ")) for merge in _field(reader, "tokenizer.ggml.merges")]
    by_itself = (gguf.TokenType.CONTROL, gguf.TokenType.NORMAL)
    vocabulary = {
        token: n
        for n, (token, kind) in enumerate(zip(tokens, kinds, strict=True))
        if kind in by_itself or token in words.SPECIAL
    }
    made = Tokenizer(models.BPE(vocab=vocabulary, merges=pairs))
    words.cut_as_smollm(made)
    made.add_special_tokens(
        [AddedToken(token, special=True, normalized=False) for token in words.SPECIAL]
    )
    made.add_tokens([AddedToken(text, special=False, normalized=False) for text in words.WHOLE])
    return made


def _size(language: gguf.GGUFReader, tower: gguf.GGUFReader) -> Size:
    vision = "clip.vision."
    patch = _field(tower, f"{vision}patch_size")
    side = _field(tower, f"{vision}image_size")
    return Size(
        picture_width=side,
        picture_height=_height(tower, side),
        patch=patch,
        merge=_field(tower, f"{vision}projector.scale_factor"),
        vision_width=_field(tower, f"{vision}embedding_length"),
        vision_layers=_field(tower, f"{vision}block_count"),
        vision_heads=_field(tower, f"{vision}attention.head_count"),
        vision_mlp=_field(tower, f"{vision}feed_forward_length"),
        projector=len(_tensors(tower)["mm.1.bias"]),
        width=_field(language, "llama.embedding_length"),
        layers=_field(language, "llama.block_count"),
        heads=_field(language, "llama.attention.head_count"),
        mlp=_field(language, "llama.feed_forward_length"),
        vocabulary=_field(language, "llama.vocab_size"),
        context=_field(language, "llama.context_length"),
        rope_base=_field(language, "llama.rope.freq_base"),
    )


def _height(tower: gguf.GGUFReader, side: int) -> int:
    """The height of a picture, which llama.cpp has no key for: the file's own."""
    field = tower.get_field("pliant.picture_height")
    return side if field is None else int(field.contents())


def _field(reader: gguf.GGUFReader, name: str) -> Any:
    field = reader.get_field(name)
    if field is None:
        raise ValueError(f"{name} is not in the file: it is none of export_gguf.py's")
    return field.contents()


def _tensors(reader: gguf.GGUFReader) -> dict[str, Tensor]:
    """The tensors by their names, as they were before they were rounded to their types."""
    return {
        t.name: torch.from_numpy(
            np.array(gguf.quants.dequantize(t.data, t.tensor_type), np.float32)
        ).reshape(tuple(int(n) for n in reversed(t.shape)))
        for t in reader.tensors
    }


def _halves(weight: Tensor, heads: int) -> Tensor:
    """The inverse of `export_gguf.interleaved`."""
    return weight.unflatten(0, (heads, -1, 2)).transpose(1, 2).flatten(0, 2)


def _fill_language(model: Model, named: dict[str, Tensor]) -> None:
    size, language = model.size, model.language
    language.embedding.weight.copy_(named["token_embd.weight"])
    language.norm.weight.copy_(named["output_norm.weight"])
    for n, block in enumerate(language.blocks):
        of = {k: named[f"blk.{n}.{k}.weight"] for k in _OF_BLOCK}
        q, k = (_halves(of[name], size.heads) for name in ("attn_q", "attn_k"))
        block.attention.qkv.weight.copy_(torch.cat([q, k, of["attn_v"]]))
        block.attention.out.weight.copy_(of["attn_output"])
        block.norm1.weight.copy_(of["attn_norm"])
        block.norm2.weight.copy_(of["ffn_norm"])
        block.gate.weight.copy_(of["ffn_gate"])
        block.up.weight.copy_(of["ffn_up"])
        block.down.weight.copy_(of["ffn_down"])


_OF_BLOCK = (
    "attn_norm",
    "attn_q",
    "attn_k",
    "attn_v",
    "attn_output",
    "ffn_norm",
    "ffn_gate",
    "ffn_up",
    "ffn_down",
)


def _fill_tower(model: Model, named: dict[str, Tensor]) -> None:
    size, tower = model.size, model.tower
    tower.patches.weight.copy_(named["v.patch_embd.weight"].view_as(tower.patches.weight))
    tower.patches.bias.copy_(named["v.patch_embd.bias"])
    grid = named["v.position_embd.weight"].double()
    side = round(len(grid) ** 0.5)
    down, across = (resizing(side, n) for n in (size.rows, size.columns))
    tower.positions.copy_(
        torch.einsum("ra,cb,abw->rcw", down, across, grid.view(side, side, -1)).flatten(0, 1)
    )
    for n, block in enumerate(tower.blocks):
        for what in ("weight", "bias"):
            of = {k: named[f"v.blk.{n}.{k}.{what}"] for k in _OF_VISION}
            parts = [of[f"attn_{letter}"] for letter in "qkv"]
            getattr(block.attention.qkv, what).copy_(torch.cat(parts))
            getattr(block.attention.out, what).copy_(of["attn_out"])
            getattr(block.norm1, what).copy_(of["ln1"])
            getattr(block.norm2, what).copy_(of["ln2"])
            getattr(block.up, what).copy_(of["ffn_up"])
            getattr(block.down, what).copy_(of["ffn_down"])
    layers = {
        "v.post_ln": tower.norm,
        "mm.input_norm": tower.projector_norm,
        "mm.1": tower.projector1,
        "mm.2": tower.projector2,
    }
    for name, layer in layers.items():
        layer.weight.copy_(named[f"{name}.weight"])
        layer.bias.copy_(named[f"{name}.bias"])


_OF_VISION = ("ln1", "ln2", "attn_q", "attn_k", "attn_v", "attn_out", "ffn_up", "ffn_down")
