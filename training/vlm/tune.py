"""Tunes a model on failures that you recorded, from the weights that pliant ships or others of its
kind.

    pliant export runs/mine --chat chat --chat-for local
    python tune.py chat weights tuned

`weights` and `tuned` are folders with model.gguf and mmproj.gguf, and `pliant run --reasoner vlm
--model local:tuned` asks the tuned one.
"""

import argparse
import json
import time
from pathlib import Path

import tokenizer as words
import torch
from dataset import Asked, Batches, Pictures, read_chat
from export_gguf import export
from learner import Learner, validated
from read_gguf import read_model, read_tokenizer
from train_vlm import Course


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("chat", type=Path)
    parser.add_argument("weights", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--rate", type=float, default=3e-4)
    parser.add_argument("--tokens", type=int, default=8192, help="of a batch, with padding")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(0)
    model, cut = read_model(given.weights), read_tokenizer(given.weights)
    cut.save(str(given.out / "tokenizer.json"))
    train, test = (
        read_chat(given.chat, split, given.out / "tokenizer.json", model.size)
        for split in ("train", "test")
    )
    pictures = Pictures(None, (), model.size, given.device, _files([*train, *test]))
    learner = Learner(model.size, cut.token_to_id(words.PICTURE))
    learner.model.load_state_dict(model.state_dict())
    learner.to(given.device)
    half = torch.autocast(given.device.partition(":")[0], dtype=torch.bfloat16)
    held = Batches(test, pictures, tokens=given.tokens, seed=0) if test else None
    if held is not None:
        with half:
            print("before", json.dumps(validated(learner, held, pictures)), flush=True)
    course = Course(
        learner, seconds=given.seconds, rate=given.rate, kept=given.out / "checkpoint.pt"
    )
    told = time.monotonic()
    for _, batch in zip(
        course, Batches(train, pictures, tokens=given.tokens, seed=0), strict=False
    ):
        with half:
            loss, _ = learner.losses(batch, pictures, vary=True)
        course.learn(loss)
        if time.monotonic() - told > 15:
            told = time.monotonic()
            print(f"step {course.step}: {loss.item():.4f}", flush=True)
    course.take_average()
    if held is not None:
        with half:
            print("after", json.dumps(validated(learner, held, pictures)), flush=True)
    export(learner.model, cut, given.out)


def _files(asked: list[Asked]) -> list[str]:
    return sorted({p[1] for a in asked for p in a.pictures if p[0] == "file"})


if __name__ == "__main__":
    main()
