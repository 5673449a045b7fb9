"""A case set: cases as reasoners met them in simulated trials, and apart from them the truth.

A set is one zip archive of plain text and pictures:

    cases.jsonl         a case per line, without its goal pictures
    answers.jsonl       as many lines: what was right, and the truth it follows from
    teaching.json       the goal pictures and their measurements, once
    pictures/*.webp     each named by the hash of its pixels; lossless, or as a camera sent it

Cases are thinned: of the pictures only those after the execution in question are kept, and of a
motion's trace the first and the last sample.
"""

import io
import json
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Mapping, Set
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from pliant import pictures
from pliant.cell import Motion, Trace, Truth
from pliant.errors import InputError
from pliant.experiment.bench.answers import Answer
from pliant.experiment.decides import digest
from pliant.files import write_bytes
from pliant.formations import Formation, Goals
from pliant.records import SCHEMA, Case, Look, Outcome
from pliant.store import adapter, invalid, with_method
from pliant.teaching import Teaching

SHIPPED = Path(__file__).with_name("cases.zip")
"""The case set of pliant's own: in a checkout, and where the distribution pliant-cases is."""
SHIPPED_HASH = "3acba46b245aaec8"
"""Content hash of the case set that ships: figures of different sets do not compare."""

_CASES, _ANSWERS, _TEACHING = "cases.jsonl", "answers.jsonl", "teaching.json"
_MOST_TEXT = 1 << 28  # [bytes] of a member that is text
_BROKEN = (KeyError, zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError)
_WHENCE = "give a set that reproduce/make_cases.py wrote"
_AGAIN = "; make the set again"
_LOSSLESS = [cv2.IMWRITE_WEBP_QUALITY, 101]
_EPOCH = (1980, 1, 1, 0, 0, 0)  # of every member, so that the same set is the same archive
T = TypeVar("T")


class Kind(StrEnum):
    """The kinds of a case, by what makes it hard, if anything."""

    PLAIN = "plain"
    CONFLICT = "conflict"  # a check of the picture is wrong, or pose or compression fail a success
    NEARLY = "nearly"  # an insertion that ended close to the criterion's depth, on either side
    STALE = "stale"  # the picture and its measurement are those of an earlier execution
    MESSAGE = "message"  # Table I's message was exchanged for another of its messages
    STRANGE = "strange"  # something is not as the task says, and it is right to stop
    SOUND = "sound"  # beside those: the guided skills where the peg did go in at last


@dataclass(frozen=True, kw_only=True)
class Origin:
    """The trial that a case was met in, and the execution after which it was."""

    peg: str
    condition: str
    seed: int
    reasoner: str
    index: int
    level: str = "L0"


@dataclass(frozen=True, kw_only=True)
class Key:
    """The experiment's side of a case: what was right, and why. No reasoner sees it."""

    kind: Kind
    formation: Formation
    answer: Answer
    truth: Truth
    origin: Origin


@dataclass(frozen=True, kw_only=True, eq=False)
class BenchCase:
    """A case with its key, and its name in the set."""

    name: str
    case: Case = field(repr=False)
    key: Key


@dataclass(frozen=True)
class Cases:
    """A case set, read as it is iterated over.

    Raises:
        InputError: the archive is missing or broken; the message names the line that is.
    """

    path: Path

    def __len__(self) -> int:
        return len(self.keys)

    def __iter__(self) -> Iterator[BenchCase]:
        with _opened(self.path) as archive:
            pictures = _Pictures(archive)
            teaching = self._teaching(pictures)
            lines = self._texts[_CASES].splitlines()
            for number, (line, key) in enumerate(zip(lines, self.keys, strict=True), start=1):
                where = f"'{self.path}' {_CASES} line {number}"
                document = _record(line, where)
                goals = _valid(Goals, document.get("teaching"), where)
                document["teaching"] = replace(teaching, goals=goals)
                case = _valid(Case, with_method(document), where, pictures)
                if key.formation is not case.outcome.step.formation:
                    raise InputError(f"{where}: the answer is to another case{_AGAIN}")
                yield BenchCase(name=f"{number:04d}", case=case, key=key)

    @cached_property
    def keys(self) -> tuple[Key, ...]:
        """The experiment's side of every case, in order."""
        cases, lines = (self._texts[name].splitlines() for name in (_CASES, _ANSWERS))
        if len(cases) != len(lines) or not lines:
            raise InputError(
                f"'{self.path}' holds {len(cases)} cases and {len(lines)} answers, not as many of"
                f" each{_AGAIN}"
            )
        where = f"'{self.path}' {_ANSWERS} line"
        return tuple(
            _valid(Key, _record(line, f"{where} {n}"), f"{where} {n}")
            for n, line in enumerate(lines, start=1)
        )

    @cached_property
    def hash(self) -> str:
        """Content hash of the set: of the text, which names each picture by the hash of its
        pixels."""
        return digest(*self._texts.values())[:16]

    @cached_property
    def _texts(self) -> dict[str, bytes]:
        with _opened(self.path) as archive:
            try:
                names = (_CASES, _ANSWERS, _TEACHING)
                return {name: _member(archive, name, _MOST_TEXT) for name in names}
            except _BROKEN as error:
                raise InputError(
                    f"'{self.path}' is not a whole case set: {error.args[0]}; {_WHENCE}"
                ) from error

    def pictures(self) -> dict[str, bytes]:
        """The pictures as they are stored, by the hashes of their pixels."""
        with _opened(self.path) as archive:
            return {Path(n).stem: archive.read(n) for n in archive.namelist() if n[-5:] == ".webp"}

    def _teaching(self, pictures: "_Pictures") -> Teaching:
        where = f"'{self.path}' {_TEACHING}"
        document = _record(self._texts[_TEACHING], where)
        found = document.get("schema")
        if found != SCHEMA:
            raise InputError(f"{where} has schema {found!r}; this pliant reads {SCHEMA}{_AGAIN}")
        return _valid(Teaching, document.get("teaching"), where, pictures)


def write(
    path: Path, questions: Iterable[BenchCase], *, encoded: Mapping[str, bytes] | None = None
) -> None:
    """Write a set, whole or not at all. All its cases share their goal pictures. `encoded` holds
    the WebP files of pictures that are stored as they came, by the hashes of their pixels; the
    others are written without loss.

    Raises:
        InputError: it cannot be written.
    """
    questions = list(questions)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        pictures = _Pictures(archive, encoded or {})
        cases, answers = [], []
        for question in questions:
            case = thinned(question.case)
            document = _dumped(Case, case, pictures, without={"teaching"})
            document["teaching"] = _dumped(Goals, case.teaching.goals, pictures)
            cases.append(document)
            answers.append(_dumped(Key, question.key, pictures))
        taught = _dumped(Teaching, questions[0].case.teaching, pictures)
        shared = [{"schema": SCHEMA, "teaching": taught}]
        for name, documents in ((_CASES, cases), (_ANSWERS, answers), (_TEACHING, shared)):
            lines = (json.dumps(d, separators=(",", ":"), allow_nan=False) for d in documents)
            _add(archive, name, "".join(f"{line}\n" for line in lines).encode())
    write_bytes(path, buffer.getvalue())


def thinned(case: Case) -> Case:
    """The case without earlier pictures, and with the ends only of each motion's trace."""
    history = tuple(
        replace(e, outcome=_thinned(e.outcome, keep_pictures=False)) for e in case.history
    )
    return replace(case, history=history, outcome=_thinned(case.outcome, keep_pictures=True))


def _thinned(outcome: Outcome, *, keep_pictures: bool) -> Outcome:
    *earlier, last = outcome.looks
    looks = [_unpictured(look) for look in earlier]
    looks.append(last if keep_pictures else _unpictured(last))
    motions = tuple(replace(m, trace=_ends(m)) for m in outcome.motions)
    return replace(outcome, looks=tuple(looks), motions=motions)


def _unpictured(look: Look) -> Look:
    return replace(look, observation=replace(look.observation, views={}))


def _ends(motion: Motion) -> Trace:
    trace = motion.trace
    ends = [0, -1] if len(trace.time_s) > 1 else [0] * len(trace.time_s)
    return Trace(
        time_s=trace.time_s[ends], pose=trace.pose[ends], compression_m=trace.compression_m[ends]
    )


# --- the archive -------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Pictures:
    """The pictures of an archive. Pydantic calls `save` while a record is dumped and `load` while
    it is read."""

    archive: zipfile.ZipFile
    encoded: Mapping[str, bytes] = field(default_factory=dict)

    def save(self, image: NDArray[np.uint8]) -> str:
        name = pictures.name_of(image)
        member = f"pictures/{name}.webp"
        if member not in self.archive.NameToInfo:
            content = self.encoded.get(name) or pictures.encoded(image, "webp", _LOSSLESS)
            _add(self.archive, member, content)
        return name

    def load(self, name: object) -> NDArray[np.uint8]:
        """The picture of that name. Raises ValueError if it is missing or not the one that was
        stored."""
        file = f"{name}.webp"
        return pictures.kept(
            file,
            lambda: _member(self.archive, f"pictures/{file}", pictures.MOST_BYTES),
            unreadable=_BROKEN,
        )


def _opened(path: Path) -> zipfile.ZipFile:
    if path == SHIPPED and not path.exists():
        raise InputError(
            "the cases are not installed: `pip install ./packages/cases` in a checkout brings them,"
            " or --cases names a set of your own"
        )
    try:
        return zipfile.ZipFile(path)
    except OSError as error:
        raise InputError(
            f"case set '{path}' cannot be read: {error.strerror}; {_WHENCE}"
        ) from error
    except zipfile.BadZipFile as error:
        raise InputError(f"'{path}' is not a case set: {error}; {_WHENCE}") from error


def _member(archive: zipfile.ZipFile, name: str, most: int) -> bytes:
    """A member of an archive unpacked, into memory; no more is read than it says, and it may not
    say more than `most`. Raises one of `_BROKEN`."""
    if archive.getinfo(name).file_size > most:
        raise zipfile.BadZipFile(f"{name} is larger than {most / 1e6:.0f} MB")
    return archive.read(name)


def _add(archive: zipfile.ZipFile, name: str, content: bytes) -> None:
    info = zipfile.ZipInfo(name, date_time=_EPOCH)
    is_packed = name.endswith(".webp")
    info.compress_type = zipfile.ZIP_STORED if is_packed else zipfile.ZIP_LZMA
    archive.writestr(info, content)


def _dumped(kind: type[T], record: T, pictures: _Pictures, without: Set[str] = frozenset()) -> Any:
    return adapter(kind).dump_python(record, mode="json", context=pictures, exclude=set(without))


def _record(line: bytes, where: str) -> dict[str, Any]:
    try:
        document = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where} is not JSON: {str(error).splitlines()[0]}{_AGAIN}") from error
    if not isinstance(document, dict):
        raise InputError(f"{where} holds no fields{_AGAIN}")
    return document


def _valid(kind: type[T], document: Any, where: str, pictures: _Pictures | None = None) -> T:
    try:
        return adapter(kind).validate_python(document, context=pictures)
    except ValidationError as error:
        raise InputError(f"{where} is broken at {invalid(error)}{_AGAIN}") from error
