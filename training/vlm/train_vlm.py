"""Trains the model: the tower on what is true in pictures, then tower and language together.

    python train_vlm.py decisions pictures tokenizer.json out --pretrain 45 --seconds 300

On a graphics card or a processor. What was trained is kept in `out`: the same command goes on from
there, with the seconds that are left. Seeds fix all that is drawn, not the order of sums.
"""

import argparse
import json
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import tokenizer as words
import torch
from dataset import HELD_OUT, Asked, Batches, Pictures, Readings, read
from learner import GEOMETRY, Learner, measured, validated
from model import SIZES, load, save
from torch import Tensor, nn

WARM_UP = 150  # steps
READ_EVERY = 6  # steps of the last course: reading goes on among decisions
KEPT_S = 120.0  # between two checkpoints


def _averaged(
    kept: tuple[Tensor, ...] | list[Tensor], now: tuple[Tensor, ...] | list[Tensor], n: Any
) -> None:
    """The average over the last steps, of which a short course has few: else it would end where it
    began."""
    share = min(0.998, (1 + float(n)) / (10 + float(n)))
    with torch.no_grad():
        for one, other in zip(kept, now, strict=True):
            one.lerp_(other, 1 - share)


class Course:
    """A course of training for a time: its rate rises, and falls by a cosine. What it has reached
    is kept in a file, from which it goes on."""

    def __init__(self, trained: nn.Module, *, seconds: float, rate: float, kept: Path) -> None:
        decayed = [p for p in trained.parameters() if p.ndim > 1]
        others = [p for p in trained.parameters() if p.ndim <= 1]
        groups = [
            {"params": decayed, "weight_decay": 0.05},
            {"params": others, "weight_decay": 0.0},
        ]
        self._optimiser = torch.optim.AdamW(groups, lr=rate, betas=(0.9, 0.98))
        self._trained, self._seconds, self._rate, self._kept = trained, seconds, rate, kept
        self._average = torch.optim.swa_utils.AveragedModel(trained, multi_avg_fn=_averaged)
        self.step, self._spent = 0, 0.0
        if kept.is_file():
            held = torch.load(kept, map_location=next(trained.parameters()).device)
            trained.load_state_dict(held["trained"])
            self._average.load_state_dict(held["average"])
            self._optimiser.load_state_dict(held["optimiser"])
            self.step, self._spent = held["step"], held["spent"]

    def __iter__(self) -> Iterator[None]:
        """Once for each step, for as long as there is time."""
        began = saved = time.monotonic()
        before = self._spent
        while (done := self._spent / self._seconds) < 1:
            rise = min(1.0, (self.step + 1) / WARM_UP)
            for group in self._optimiser.param_groups:
                group["lr"] = self._rate * rise * (0.51 + 0.49 * math.cos(math.pi * done))
            yield
            self._spent = before + time.monotonic() - began
            if time.monotonic() - saved > KEPT_S:
                saved = time.monotonic()
                self.keep()
        self.keep()

    def learn(self, loss: Tensor) -> None:
        """One step down a loss."""
        self._optimiser.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(self._trained.parameters(), 1.0)
        self._optimiser.step()
        self._average.update_parameters(self._trained)
        self.step += 1

    def keep(self) -> None:
        part = self._kept.with_suffix(".part")
        state = {
            "trained": self._trained.state_dict(),
            "average": self._average.state_dict(),
            "optimiser": self._optimiser.state_dict(),
            "step": self.step,
            "spent": self._spent,
        }
        torch.save(state, part)
        part.replace(self._kept)

    def take_average(self) -> None:
        """Let the trained weights be their average over the last steps."""
        self._trained.load_state_dict(self._average.module.state_dict())


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("decisions", type=Path)
    parser.add_argument("pictures", type=Path)
    parser.add_argument("tokenizer", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--begin", type=Path, help="a model.pt to begin from, of the same size")
    parser.add_argument("--size", choices=SIZES, default="full")
    parser.add_argument("--pretrain", type=float, default=45.0, help="seconds for the tower alone")
    parser.add_argument("--read", type=float, default=60.0, help="seconds for reading pictures")
    parser.add_argument("--seconds", type=float, default=300.0, help="for decisions")
    parser.add_argument("--frozen", action="store_true", help="the tower stays as pre-trained")
    parser.add_argument("--rate", type=float, default=2e-3)
    parser.add_argument("--tokens", type=int, default=98_304, help="of a batch, with padding")
    parser.add_argument("--pictures-each", type=int, default=384, help="of a batch in pre-training")
    parser.add_argument("--most", type=int, default=10**9, help="decisions that are trained on")
    parser.add_argument("--whole-sources", action="store_true", help="without untrue pictures")
    parser.add_argument("--files", type=int, default=10**9, help="the first so many only")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--compile", action="store_true")
    parser.add_argument("--processes", type=int, default=2, help="that read decisions")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    say = _said_in(given.out / "train.log")
    torch.manual_seed(0)
    torch.set_float32_matmul_precision("high")
    cut = words.load(given.tokenizer)
    size = replace(SIZES[given.size], vocabulary=-(-cut.get_vocab_size() // 64) * 64)
    found = read(
        given.decisions, given.tokenizer, size, files=given.files, processes=given.processes
    )
    say(f"{sum(map(len, found))} decisions read")
    pegs = sorted({p[1] for some in found for a in some for p in a.pictures if p[0] == "goal"})
    pictures = Pictures(given.pictures, pegs, size, given.device)
    say(f"{pictures.drawn} pictures on {given.device}")
    train, held = _split(found, given.most, whole=given.whole_sources)
    apart = {
        f"a {name} never trained on": [a for some in found for a in some if a.held == (name,)]
        for name in ("phrase", "combination")
    }
    say(f"{len(train)} decisions to train on, {len(held)} to validate")
    batches = Batches(train, pictures, tokens=given.tokens, seed=0)

    learner = Learner(size, cut.token_to_id(words.PICTURE)).to(given.device)
    if given.begin is not None:
        learner.model.load_state_dict(load(given.begin).state_dict())
    counts = {
        name: round(sum(p.numel() for p in part.parameters()) / 1e6, 2)
        for name, part in (("tower", learner.model.tower), ("language", learner.model.language))
    }
    say(f"millions of parameters: {counts}")
    if given.compile:
        model = learner.model
        towers = model.tower.blocks if given.device != "cpu" else ()  # slower there
        for block in [*towers, *model.language.blocks]:
            block.compile(dynamic=True)
    half = torch.autocast(given.device.partition(":")[0], dtype=torch.bfloat16)
    if given.pretrain > 0:
        seeds = {asked.seed for asked in held}
        _train_tower(learner, pictures, seeds, given, half, say)
        unseen = [n for n, seed in enumerate(pictures.seeds) if seed in seeds]
        with half:
            say(json.dumps(measured(learner, pictures, torch.tensor(unseen, device=given.device))))
    if given.frozen:
        learner.model.tower.requires_grad_(False)
    of = _of_others(pictures, {asked.seed for asked in held})
    readings = Readings(pictures, of, cut, size)
    if given.read > 0:
        _train_to_read(learner, readings, pictures, given, half, say)
    _train_together(learner, batches, readings, pictures, given, half, say)
    save(learner.model, given.out / "model.pt")
    figures = {}
    for name, some in {"other trials": held, **apart}.items():
        if some:
            asked = Batches(some, pictures, tokens=given.tokens, seed=0)
            with half:
                figures[name] = validated(learner, asked, pictures)
            say(f"{name}: {json.dumps(figures[name])}")
    text = json.dumps(figures, indent=1) + "\n"
    (given.out / "validated.json").write_text(text, encoding="utf-8")


def _said_in(path: Path) -> Callable[[str], None]:
    """Says a line on the terminal and in a log."""
    began = time.monotonic()
    log = path.open("a", encoding="utf-8")

    def say(text: str) -> None:
        line = f"{time.monotonic() - began:6.1f} s  {text}"
        print(line, flush=True)
        print(line, file=log, flush=True)

    return say


def _split(found: list[list[Asked]], most: int, *, whole: bool) -> tuple[list[Asked], list[Asked]]:
    """The decisions to train on, and those of other trials to validate."""
    train, held = [], []
    for k, some in enumerate(found):
        if k % HELD_OUT == HELD_OUT - 1:
            held += [a for a in some if not a.held]
        else:
            train += [a for a in some if not a.held and (a.shown == "look" or not whole)]
    return train[:most], held


def _of_others(pictures: Pictures, held: set[int]) -> Tensor:
    """The rows of the drawn pictures of other trials."""
    rows = [n for n, seed in enumerate(pictures.seeds) if seed not in held]
    return torch.tensor(rows, device=pictures.pixels.device)


def _train_to_read(
    learner: Learner,
    readings: Readings,
    pictures: Pictures,
    given: Any,
    half: Any,
    say: Callable[[str], None],
) -> None:
    """To say of a picture how the peg lies in it."""
    course = Course(learner, seconds=given.read, rate=given.rate, kept=given.out / "read.pt")
    told = time.monotonic()
    for _ in course:
        with half:
            of_words, geometry = learner.losses(
                readings.batch(given.pictures_each), pictures, vary=True
            )
        course.learn(of_words + (0.0 if given.frozen else GEOMETRY) * geometry)
        if time.monotonic() - told > 15:
            told = time.monotonic()
            say(f"reading: step {course.step}, {of_words.item():.4f}")
    course.take_average()
    say(f"reading: {course.step} steps")


def _train_tower(
    learner: Learner,
    pictures: Pictures,
    held: set[int],
    given: Any,
    half: Any,
    say: Callable[[str], None],
) -> None:
    """On the pictures of trials that are not `held` for validation."""
    of = _of_others(pictures, held)
    both = nn.ModuleList([learner.model.tower, learner.heads])
    course = Course(both, seconds=given.pretrain, rate=1e-3, kept=given.out / "tower.pt")
    told, some = time.monotonic(), [math.nan, math.nan]
    for _ in course:
        rows = of[torch.randint(len(of), (given.pictures_each,), device=given.device)]
        with half:
            losses = learner.sight(pictures, rows)
        course.learn(losses[0] + losses[1])
        if time.monotonic() - told > 15:
            told, some = time.monotonic(), [round(v.item(), 4) for v in losses]
            say(f"tower: step {course.step}, places and measurements {some}")
    course.take_average()
    say(f"tower: {course.step} steps")


def _train_together(
    learner: Learner,
    batches: Batches,
    readings: Readings,
    pictures: Pictures,
    given: Any,
    half: Any,
    say: Callable[[str], None],
) -> None:
    course = Course(learner, seconds=given.seconds, rate=given.rate, kept=given.out / "all.pt")
    told = time.monotonic()
    for _, batch in zip(course, batches, strict=False):
        if course.step % READ_EVERY == READ_EVERY - 1:
            batch = readings.batch(given.pictures_each)
        with half:
            of_words, geometry = learner.losses(batch, pictures, vary=True)
        course.learn(of_words + (0.0 if given.frozen else GEOMETRY) * geometry)
        if time.monotonic() - told > 15:
            told = time.monotonic()
            say(
                f"step {course.step}: {of_words.item():.4f}, geometry {geometry.item():.4f};"
                f" {len(batch.asked)} decisions of {batch.tokens.shape[1]} tokens"
            )
    course.take_average()
    say(f"{course.step} steps")


if __name__ == "__main__":
    main()
