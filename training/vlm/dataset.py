"""Recorded decisions as tokens with weights, and their pictures, ready to be trained on."""

import gzip
import json
import re
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import rendering
import tokenizer as words
import torch
from model import Size
from numpy.typing import NDArray
from tokenizers import Tokenizer
from torch import Tensor
from torch.nn import functional

from pliant import pictures
from pliant.formations import Formation
from pliant.reasoners.vlm.settings import BROUGHT
from pliant.task import load_task
from pliant.teaching import shipped

DRAWN, SCALE = (384, 288), 0.6  # width and height of what `draw.py` draws, of a camera's pixels
CROP: tuple[int, int, int, int] = tuple(BROUGHT["picture_crop"])
VERSIONS = 4  # of a decision's text
TARGETS = 6  # that are true of a picture: see draw.geometry
UNITS = (10.0, 10.0, 5.0, 10.0, 10.0, 5.0)  # [mm or degrees] that the targets are divided by
RELATIVE = 3  # targets, the first ones, that are the same where the picture is shifted
POINTS = 3  # whose places in a picture are known: see draw.points
SHIFT = 16  # [px] that a picture is shifted by, at most
HELD_OUT = 20  # every so manieth file of ten trials is for validation
_WEIGHTS = {
    "success": 6.0,
    "picture": 4.0,
    "resume_from": 4.0,
    "retreat_first": 3.0,
    "wrong_goal": 3.0,
    "skill": 3.0,
    "steps": 3.0,
    "goal_mm": 2.0,
    "bottom_left_corner": 2.0,
    "bottom_right_corner": 2.0,
    "conflict": 0.5,
    "why": 0.15,  # friction and such cannot be seen
}  # of a reply's fields; of others 1
_CHANGE = 2.5  # of a change of a goal
_MEASURED = 5.0  # of a number in what is said of a picture
_MISLED = 3.0  # of a judgement where the text alone, or an old picture, says the opposite
_STOPS = 0.3  # of a decision to stop: what is recorded holds many more of them than cells do
_SAYS = ("reason", "what_happened")
_FIELD = re.compile(r'"([a-z_]+)":')
_NUMBER = re.compile(r"\d+\.\d mm to the \w+|\d+\.\d mm \w+|\d+\.\d degrees to the \w+")


@dataclass(frozen=True, kw_only=True, eq=False)
class Asked:
    """A decision: in each version its tokens with their weights, and the pictures that it is shown,
    as `record.py` names them. `vote` is the place in version 0 of the model's own vote on the
    picture, None where it is not asked for one; `misleads`: the text alone says the opposite of
    the truth."""

    seed: int
    execution: int
    versions: tuple[tuple[NDArray[np.int32], NDArray[np.float16]], ...] = field(repr=False)
    pictures: tuple[tuple[Any, ...], ...]
    stage: str
    success: bool
    shown: str
    held: tuple[str, ...]
    vote: int | None
    misleads: bool

    @property
    def length(self) -> int:
        """The tokens of its longest version."""
        return max(len(tokens) for tokens, _ in self.versions)


def read(
    folder: Path, tokenizer: Path, size: Size, *, files: int, processes: int
) -> list[list[Asked]]:
    """The decisions of each file, in order: as `record.py` writes them."""
    paths = sorted(folder.glob("*.jsonl.gz"))[:files]
    with ProcessPoolExecutor(processes) as pool:
        return list(pool.map(_read, paths, [tokenizer] * len(paths), [size] * len(paths)))


def read_chat(folder: Path, split: str, tokenizer: Path, size: Size) -> list[Asked]:
    """The conversations of a split, train or test, of what `pliant export --chat` writes."""
    cut = words.load(tokenizer)
    lines = (folder / f"{split}.jsonl").read_text(encoding="utf-8").splitlines()
    found = []
    for line in map(json.loads, lines):
        system, user, assistant = (message["content"] for message in line["messages"])
        reply = assistant[0]["text"]
        decision = {
            "stage": line["stage"],
            "execution": line["execution"],
            "success": line["kind"] == "success",
            "shown": "look",
            "tool": False,
            "system": system[0]["text"],
            "user": [part.get("text", "<image>") for part in user],
            "pictures": [["file", str(folder / name)] for name in line["images"]],
            "reply": reply,
            "plain": reply,
            "held": [],
        }
        found.append(_asked(line["seed"], decision, cut, size, np.random.default_rng(line["seed"])))
    return [asked for asked in found if asked.length <= size.context]


def _read(path: Path, tokenizer: Path, size: Size) -> list[Asked]:
    cut = words.load(tokenizer)
    found = []
    with gzip.open(path, "rt", encoding="utf-8") as file:
        for trial in map(json.loads, file):
            draw = np.random.default_rng([trial["seed"], 3])
            for decision in trial["decisions"]:
                if _is_a_guess(trial, decision):
                    continue
                asked = _asked(trial["seed"], decision, cut, size, draw)
                if asked.length <= size.context:
                    found.append(asked)
    return found


def _asked(
    seed: int, decision: dict[str, Any], cut: Tokenizer, size: Size, draw: np.random.Generator
) -> Asked:
    told = []
    for version in range(VERSIONS):
        before = cut.encode(rendering.prompt(decision, draw, size.picture_tokens)).ids
        reply = rendering.reply(decision, plain=version % 2 == 1)
        told.append((before, cut.encode(reply), reply))
    misleads = decision["success"] != _text_says(decision)
    vote, more = None, _STOPS if _stops(decision) else 1.0
    if decision["stage"] == "judge":
        if decision["shown"] == "stale" or (misleads and decision["shown"] == "look"):
            more = _MISLED
        before, after, reply = told[0]
        place = reply.index('"picture":"') + len('"picture":"')
        vote = len(before) + next(
            n for n, (start, end) in enumerate(after.offsets) if start <= place < end
        )
    return Asked(
        seed=seed,
        execution=decision["execution"],
        versions=tuple(
            (
                np.array(before + after.ids, np.int32),
                more * np.array([0.0] * len(before) + _weights(reply, after.offsets), np.float16),
            )
            for before, after, reply in told
        ),
        pictures=tuple(tuple(p) for p in decision["pictures"]),
        stage=decision["stage"],
        success=decision["success"],
        shown=decision["shown"],
        held=tuple(decision["held"]),
        vote=vote,
        misleads=misleads,
    )


def _is_a_guess(trial: dict[str, Any], decision: dict[str, Any]) -> bool:
    """Whether it was right to stop for a reason that neither the picture nor any earlier execution
    that is told can show."""
    is_told = any("Before: " in part or "plausible" in part for part in decision["user"])
    return _stops(decision) and trial["scenario"] != "no_peg" and not is_told


def _stops(decision: dict[str, Any]) -> bool:
    marks = '"steps":[]', '"resume_from":"stop"', "no motion can help"
    return any(mark in decision["plain"] for mark in marks)


def _weights(reply: str, offsets: Sequence[tuple[int, int]]) -> list[float]:
    """The weight of each token of a reply: that of the field in which it begins."""
    marks = [(0, 1.0)]
    fields = [*_FIELD.finditer(reply)]
    for found, after in zip(fields, [*fields[1:], None], strict=True):
        name = found[1]
        other = _CHANGE if name.endswith(("_mm", "_deg")) else 1.0
        marks.append((found.end(), _WEIGHTS.get(name, other)))
        if name in _SAYS:
            for number in _NUMBER.finditer(
                reply, found.end(), after.start() if after else len(reply)
            ):
                marks += [(number.start(), _MEASURED), (number.end(), 1.0)]
    weights, k = [], 0
    for start, _ in offsets:
        while k + 1 < len(marks) and marks[k + 1][0] <= start:
            k += 1
        weights.append(marks[k][1])
    return weights


def _text_says(decision: dict[str, Any]) -> bool:
    """What the checks say together: success, where none says failure."""
    now = "\n".join(decision["user"]).partition("Now: ")[2].partition("\n")[0]
    return " failure" not in now


class Readings:
    """Side pictures, and what is to be said of them: how the peg lies to the hole, in the words in
    which it stands in replies; some after a goal picture, which is not meant."""

    def __init__(self, pictures: "Pictures", rows: Tensor, cut: Tokenizer, size: Size) -> None:
        self._pictures, self._cut, self._tokens = pictures, cut, size.picture_tokens
        side = ~pictures.front[rows] & pictures.there[rows]
        self._rows = rows[side].cpu().numpy()
        self._true = (pictures.true[rows] * torch.tensor(UNITS, device=rows.device)).cpu().numpy()
        self._true = self._true[side.cpu().numpy()]
        self._draw = np.random.default_rng(7)

    def batch(self, n: int) -> "Batch":
        """Some of them, drawn."""
        tokens, weights, rows = [], [], []
        goals = [*self._pictures.goals.values()]
        for k in self._draw.integers(len(self._rows), size=n):
            user = ["Side:", "<image>", "Asked: judge this execution."]
            if goals and self._draw.uniform() < 0.3:
                user = ["Goal, circle:", "<image>", *user]
                rows.append(goals[int(self._draw.integers(len(goals)))])
            rows.append(int(self._rows[k]))
            text = rendering.joined(user).replace("<image>", words.picture_text(self._tokens))
            before = self._cut.encode(rendering.turn("user", text) + f"{words.TURN}assistant\n").ids
            said = f"{self._draw.choice(rendering.PLACES)} {rendering.measured(*self._true[k, :3])}"
            after = self._cut.encode(said + words.END_OF_TURN).ids
            tokens.append(before + after)
            weights.append([0.0] * len(before) + [1.0] * len(after))
        wide = _round(max(map(len, tokens)))
        return Batch(
            asked=[],
            tokens=np.array([t + [0] * (wide - len(t)) for t in tokens], np.int64),
            weights=np.array([w + [0.0] * (wide - len(w)) for w in weights], np.float32),
            rows=np.array(rows, np.int64),
            order=np.arange(len(rows)),
        )


def goal_pictures(pegs: Sequence[str], size: Size) -> list[NDArray[np.uint8]]:
    """The goal picture of Insertion for each peg (3, height, width), as pliant shows it."""
    found = []
    for peg in pegs:
        shown = shipped().for_task(load_task(peg, "L0")).demonstrations[Formation.INSERTION]
        found.append(_shrunk(shown.view.image, size))
    return found


def _shrunk(image: NDArray[np.uint8], size: Size) -> NDArray[np.uint8]:
    """A picture as a camera takes it, as the model does (3, height, width)."""
    left, top, width, height = CROP
    image = image[top : top + height, left : left + width]
    wanted = (size.picture_width, size.picture_height)
    small = cv2.resize(image, wanted, interpolation=cv2.INTER_AREA)
    return small.astype(np.uint8).transpose(2, 0, 1)


class Pictures:
    """All pictures on the device: those drawn, then a black one, then the pegs' goal pictures."""

    def __init__(
        self,
        folder: Path | None,
        pegs: Sequence[str],
        size: Size,
        device: str,
        files: Sequence[str] = (),
    ) -> None:
        """`folder` holds what `draw.py` drew; `files` are pictures of recorded trials."""
        shape = (3, size.picture_height, size.picture_width)
        left, top, width, height = CROP
        columns, rows = (
            slice(round(SCALE * a), round(SCALE * (a + n)))
            for a, n in ((left, width), (top, height))
        )
        self.looks: dict[tuple[int, int, str], list[int]] = {}
        true: list[list[float]] = []
        front: list[bool] = []
        there: list[bool] = []
        points: list[list[list[float]]] = []
        self.seeds: list[int] = []
        parts = []
        for path in sorted(folder.glob("index-*.json")) if folder else ():
            index = json.loads(path.read_text(encoding="utf-8"))
            raw = np.memmap(path.with_name(f"pictures-{path.stem[6:]}.raw"), np.uint8, "r")
            parts.append(raw.reshape(-1, 3, DRAWN[1], DRAWN[0])[:, :, rows, columns])
            for entry in index:
                key = (entry["seed"], entry["look"], entry["camera"])
                self.looks.setdefault(key, []).append(len(true))
                true.append(entry["true"])
                front.append(entry["camera"] == "front")
                there.append(entry["peg"])
                points.append(entry["points"])
                self.seeds.append(entry["seed"])
        self.drawn, self.black = len(true), len(true)
        self.goals = {peg: self.black + 1 + n for n, peg in enumerate(pegs)}
        self.files = {file: self.black + 1 + len(pegs) + n for n, file in enumerate(files)}
        read = [pictures.read(Path(file)).transpose(2, 0, 1) for file in files]
        extra = np.stack([np.zeros(shape, np.uint8), *goal_pictures(pegs, size), *read])
        self.pixels = torch.empty(
            (self.drawn + len(extra), *shape), dtype=torch.uint8, device=device
        )
        at = 0
        for part in [*parts, extra]:
            for k in range(0, len(part), 1024):
                some = torch.from_numpy(np.array(part[k : k + 1024]))
                self.pixels[at : at + len(some)] = some.to(device)
                at += len(some)
        self.true = torch.tensor(true, device=device).reshape(-1, TARGETS)
        self.true = self.true / torch.tensor(UNITS, device=device)
        self.front = torch.tensor(front, device=device)
        self.there = torch.tensor(there, device=device)
        self.points = torch.tensor(points, device=device).reshape(-1, POINTS, 2)  # [px]
        self.points -= torch.tensor([left, top], device=device)
        self.points *= torch.tensor(
            [size.picture_width / width, size.picture_height / height], device=device
        )

    def normal(self, rows: Tensor, *, vary: bool) -> Tensor:
        """Pixels from -1 to 1; `vary`: brighter or darker, with more or less contrast and noise."""
        x = self.pixels[rows].float().div_(127.5).sub_(1.0)
        if vary:
            one = (len(x), 1, 1, 1)
            x = x * (1 + 0.15 * torch.randn(one, device=x.device)).clamp(0.6, 1.4)
            x = x + 0.08 * torch.randn(one, device=x.device)
            x = x + 0.02 * torch.rand(one, device=x.device) * torch.randn_like(x)
        return x.clamp_(-1, 1)

    def shifted(self, x: Tensor, by: Tensor) -> Tensor:
        """Each picture moved right and down by some pixels (n, 2), its border going on."""
        wide = functional.pad(x, (SHIFT, SHIFT, SHIFT, SHIFT), "replicate")
        height, width = x.shape[2:]
        return torch.stack([
            one[:, SHIFT - dy : SHIFT - dy + height, SHIFT - dx : SHIFT - dx + width]
            for one, (dx, dy) in zip(wide, by.tolist(), strict=True)
        ])  # fmt: skip

    def geometry(self, rows: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Of some pictures what is true (n, TARGETS), where the points are (n, POINTS, 2) [px],
        whether they are front views, and whether there is anything to know."""
        at = rows.clamp(max=self.drawn - 1)
        return self.true[at], self.points[at], self.front[at], (rows < self.drawn) & self.there[at]


@dataclass(frozen=True, kw_only=True, eq=False)
class Batch:
    """Decisions with their tokens and weights (n, t), and the rows of the pictures that they are
    shown, each once; `order` names those of all places in turn."""

    asked: list[Asked]
    tokens: NDArray[np.int64]
    weights: NDArray[np.float32]
    rows: NDArray[np.int64]
    order: NDArray[np.int64]


class Batches:
    """Batches of decisions of like length; those of one execution share its pictures."""

    def __init__(
        self, asked: Sequence[Asked], pictures: Pictures, *, tokens: int, seed: int
    ) -> None:
        groups: dict[tuple[int, int], list[Asked]] = {}
        for one in asked:
            groups.setdefault((one.seed, one.execution), []).append(one)
        self.groups = list(groups.values())
        self._pictures, self._tokens = pictures, tokens
        self._draw = np.random.default_rng(seed)
        self._longest = np.array([max(a.length for a in group) for group in self.groups])

    def __iter__(self) -> Iterator[Batch]:
        """Without end, in another order each time."""
        while True:
            noisy = self._longest + self._draw.uniform(0, 80, len(self.groups))
            batches: list[list[int]] = [[]]
            for g in np.argsort(noisy):
                now = [*batches[-1], int(g)]
                count = sum(len(self.groups[k]) for k in now)
                if len(now) > 1 and count * _round(max(self._longest[now])) > self._tokens:
                    batches.append([int(g)])
                else:
                    batches[-1] = now
            for k in self._draw.permutation(len(batches)):
                yield self.made([self.groups[g] for g in batches[k]])

    def in_turn(self, groups: int) -> Iterator[Batch]:
        """All of them once, in version 0 and with the pictures as they were."""
        for k in range(0, len(self.groups), groups):
            yield self.made(self.groups[k : k + groups], vary=False)

    def made(self, groups: Sequence[Sequence[Asked]], *, vary: bool = True) -> Batch:
        asked, looks, told = [], [], []
        for group in groups:
            dressed = float(self._draw.uniform()) if vary else 0.0
            for one in group:
                asked.append(one)
                looks += [self._row(one, picture, dressed) for picture in one.pictures]
                told.append(one.versions[int(self._draw.integers(VERSIONS)) if vary else 0])
        wide = _round(max(len(t) for t, _ in told))
        tokens = np.zeros((len(told), wide), np.int64)
        weights = np.zeros((len(told), wide), np.float32)
        for k, (t, w) in enumerate(told):
            tokens[k, : len(t)], weights[k, : len(w)] = t, w
        rows, order = np.unique(np.array(looks, np.int64), return_inverse=True)
        return Batch(asked=asked, tokens=tokens, weights=weights, rows=rows, order=order)

    def _row(self, one: Asked, picture: tuple[Any, ...], dressed: float) -> int:
        """A picture's row; as it was if `dressed` < 0.5, else one of the other variants."""
        drawn = self._pictures
        match picture:
            case ["goal", peg]:
                return drawn.goals[peg]
            case ["file", file]:
                return drawn.files[file]
            case ["look", look, camera]:
                rows = drawn.looks.get((one.seed, look, camera))
                if rows is None:  # it was not drawn in time
                    return drawn.black
                k = 0 if dressed < 0.5 else 1 + int((dressed - 0.5) * 2 * (len(rows) - 1))
                return rows[min(k, len(rows) - 1)]
            case _:
                return drawn.black


def _round(length: int) -> int:
    return -(-int(length) // 32) * 32
