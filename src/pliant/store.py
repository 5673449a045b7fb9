"""Writes records to a folder and reads them back: `trial.json`, and each picture once, named by
what it shows.

A record is written through pydantic's adapter of its dataclass: plain JSON, so that nothing read
can run code. Files are written beside their name and then renamed: none is ever half there.
"""

import json
import os
import platform
import re
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from pliant import folders, pictures
from pliant.errors import InputError
from pliant.files import write_bytes, write_json
from pliant.methods.named import method
from pliant.records import SCHEMA, Case, Trial

RUN, JOURNAL, TRIAL, CASE, PICTURES = (
    "run.json",
    "journal.jsonl",
    "trial.json",
    "case.json",
    "pictures",
)
TRIALS, ABORTED = "trials", "aborted"
"""The folder of a run that holds its trials' folders."""

_MOST_EXECUTIONS = 200  # of a trial: five times the most that one takes
_LONGEST_NAME = 250  # characters
_PACKAGES = {"pliant": "pliant", "mujoco": "mujoco", "opencv": "opencv-python-headless"}
_PACKAGES |= {"numpy": "numpy"}
MOST_JSON = 1 << 27  # [bytes] of a JSON file
_MOST_PIXELS = 1 << 29  # of a record's pictures together: 1700 of 640 x 480
_NAME = re.compile(r"[\w][\w.+-]*")
T = TypeVar("T")


def save_trial(folder: Path, trial: Trial) -> None:
    """Write a trial and its pictures into `folder`, made if need be.

    Raises:
        InputError: the folder cannot be written.
    """
    _save(folder, TRIAL, "trial", trial)


def load_trial(folder: Path) -> Trial:
    """Read a trial that `save_trial` wrote.

    Raises:
        InputError: there is none, its schema is another, or it or a picture is broken.
    """
    trial = _load(folder, TRIAL, "trial", Trial)
    if len(trial.executions) > _MOST_EXECUTIONS:
        raise InputError(
            f"'{folder / TRIAL}' has {len(trial.executions)} executions, more than"
            f" {_MOST_EXECUTIONS}: no trial is that long"
        )
    for n, execution in enumerate(trial.executions):
        looks = execution.outcome.looks
        if execution.index != n or not looks or "side" not in looks[-1].observation.views:
            raise InputError(
                f"'{folder / TRIAL}' is broken at executions.{n}: its index, its looks or its side"
                " picture are not as they are written; run it again"
            )
    return trial


def save_case(folder: Path, case: Case) -> None:
    """Write a case as a reasoner was asked it, so that it can be asked again."""
    _save(folder, CASE, "case", case)


def load_case(folder: Path) -> Case:
    """Read a case that `save_case` wrote. Raises as `load_trial` does, and where its method is not
    at hand."""
    return _load(folder, CASE, "case", Case, with_method)


def with_method(case: dict[str, Any]) -> dict[str, Any]:
    """A stored case with the method in the place of its name, which older sets call its skills.

    Raises:
        InputError: there is no method of that name, or its file is not here.
    """
    name = case.get("method", case.get("skills", "planar"))
    return {**case, "method": method(str(name))}


@dataclass(frozen=True)
class Pictures:
    """A folder of pictures, each named by the hash of its pixels.

    Pydantic calls `save` while a record is dumped and `load` while it is read.
    """

    folder: Path
    unwritten: dict[str, NDArray[np.uint8]] = field(default_factory=dict)
    loaded: dict[str, NDArray[np.uint8]] = field(default_factory=dict)

    def path(self, image: NDArray[np.uint8]) -> Path:
        return self.folder / f"{pictures.name_of(image)}.png"

    def save(self, image: NDArray[np.uint8]) -> str:
        """Keep a picture for `write`, and return its name: what is raised here, pydantic hides."""
        name = pictures.name_of(image)
        self.unwritten[name] = image
        return name

    def write(self) -> None:
        """Write the pictures that are not there yet; raises as `write_bytes` does."""
        for name, image in self.unwritten.items():
            path = self.folder / f"{name}.png"
            if not path.exists():
                write_bytes(path, pictures.encoded(image))

    def load(self, name: object) -> NDArray[np.uint8]:
        """Read a picture; raises ValueError if it is missing or not the one that was stored."""
        if not isinstance(name, str) or re.fullmatch("[0-9a-f]{16}", name) is None:
            raise ValueError(f"picture name {name!r} is not a hash")
        if name not in self.loaded:
            self.loaded[name] = self._read(name)
        return self.loaded[name]

    def _read(self, name: str) -> NDArray[np.uint8]:
        path = self.folder / f"{name}.png"
        image = pictures.kept(path.name, lambda: folders.read(path, pictures.MOST_BYTES))
        if image.size + sum(other.size for other in self.loaded.values()) > 3 * _MOST_PIXELS:
            raise ValueError(f"its pictures have more than {_MOST_PIXELS} pixels together")
        return image


adapter: Callable[[Any], TypeAdapter[Any]] = cache(TypeAdapter)
"""The reader and writer of a kind of record, made once."""


def _save(folder: Path, name: str, key: str, record: object) -> None:
    shown = Pictures(folder / PICTURES)
    dumped = adapter(type(record)).dump_python(record, mode="json", context=shown)
    document = {"schema": SCHEMA, key: dumped}
    shown.write()
    write_bytes(folder / name, json.dumps(document, separators=(",", ":")).encode())


def _load(
    folder: Path,
    name: str,
    key: str,
    kind: type[T],
    completed: Callable[[dict[str, Any]], dict[str, Any]] = lambda document: document,
) -> T:
    path = folder / name
    document = _document(path)
    try:
        record = document[key]
        record = completed(record) if isinstance(record, dict) else record
        found: T = adapter(kind).validate_python(record, context=Pictures(folder / PICTURES))
        return found
    except KeyError as error:
        raise InputError(f"'{path}' holds no {key}; it is broken, run it again") from error
    except ValidationError as error:
        raise InputError(f"'{path}' is broken at {invalid(error)}; run it again") from error


def invalid(error: ValidationError) -> str:
    """The first of what is wrong in a record, in a line: the place where, and what."""
    first = error.errors(include_url=False, include_input=False)[0]
    where = ".".join(str(part) for part in first["loc"])
    return f"{where}: {first['msg'].splitlines()[0]}"


def _document(path: Path) -> dict[str, Any]:
    try:
        document = json.loads(folders.read(path, MOST_JSON))
    except OSError as error:
        raise InputError(
            f"'{path}' cannot be read: {error.strerror}; name a folder that pliant wrote"
        ) from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"'{path}' is not JSON: {str(error).splitlines()[0]}") from error
    found = document.get("schema") if isinstance(document, dict) else None
    if not isinstance(document, dict) or found != SCHEMA:
        raise InputError(
            f"'{path}' has schema {found!r}; this pliant reads {SCHEMA}: use the one that wrote it"
        )
    return document


# --- files -------------------------------------------------------------------------------------


def prepare_folder(path: Path) -> None:
    """Make an output folder, and see that results can be put into it. One that pliant wrote before
    may be used again.

    Raises:
        InputError: it or a folder in it cannot be made or named, or it holds something that pliant
            did not write, or a link.
    """
    try:
        os.path.abspath(path).encode()  # noqa: PTH100, the libraries take no other names
    except UnicodeEncodeError as error:
        raise InputError(
            f"output folder '{path}' cannot be used: its name is not UTF-8; choose another"
        ) from error
    try:
        path.mkdir(parents=True, exist_ok=True)
        is_ours = is_unused(path) or any((path / name).is_file() for name in (RUN, TRIAL))
        for place in (path, path / TRIALS, path / ABORTED):
            if place == path or place.exists():
                TemporaryDirectory(dir=place, prefix=".tried-").cleanup()
    except OSError as error:
        raise InputError(
            f"output folder '{path}' cannot be used: {error.strerror}; choose another"
        ) from error
    if not is_ours:
        raise InputError(
            f"output folder '{path}' holds something else than results of pliant: choose a new one"
        )
    folders.refuse_links(path)


def is_unused(path: Path) -> bool:
    """Whether a folder is not there, or holds nothing, or only the empty journal of a run that was
    ended before it began.

    Raises:
        OSError: it cannot be read.
    """
    if not path.exists():
        return True
    names = [entry.name for entry in path.iterdir()]
    return not names or (names == [JOURNAL] and (path / JOURNAL).lstat().st_size == 0)


def kept_trials(run: Path) -> list[Path]:
    """The folders of the trials whose records a run keeps, in the order of their names; also those
    that cannot be looked into.

    Raises:
        InputError: their folder cannot be looked through.
    """
    place = run / TRIALS
    try:
        kept = sorted(place.iterdir()) if place.is_dir() else []
    except OSError as error:
        raise InputError(
            f"'{place}' cannot be looked through: {error.strerror}; make it readable, or copy it"
        ) from error
    return [folder for folder in kept if _may_hold(folder / TRIAL)]


def _may_hold(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:  # reading it says why
        return True


def set_apart(run: Path, trial_id: str) -> Path | None:
    """Move a trial's record out of the way of the next one's, into the run's folder of trials that
    are none, and return where to. None: it has no record.

    Raises:
        InputError: it cannot be moved.
    """
    kept = trial_folder(run, trial_id)
    if not kept.exists():
        return None
    apart = free_folder(run / ABORTED, trial_id)
    try:
        apart.parent.mkdir(exist_ok=True)
        kept.rename(apart)
    except OSError as error:
        raise InputError(f"'{kept}' cannot be moved to '{apart}': {error.strerror}") from error
    return apart


def free_folder(folder: Path, name: str) -> Path:
    """The first numbered name that nothing in a folder has."""
    return next(path for n in count(1) if not (path := folder / f"{name}-{n}").exists())


def trial_folder(run: Path, trial_id: str) -> Path:
    """The folder where a run keeps a trial's record.

    Raises:
        InputError: the id, as a file may give it, is not the name of a folder.
    """
    if not _NAME.fullmatch(trial_id) or len(trial_id) > _LONGEST_NAME:
        raise InputError(f"'{run}' holds a trial '{trial_id}', which is no trial's name")
    return run / TRIALS / trial_id


# --- run.json ----------------------------------------------------------------------------------


def write_run_json(
    folder: Path, *, configuration: Mapping[str, Any], reasoner: str, model: str | None
) -> None:
    """Write what made the results in `folder`: the program's commit and versions, the machine, and
    what it was asked to do. `configuration` must be plain JSON values."""
    commit, dirty = _commit()
    document = {
        "schema": SCHEMA,
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "commit": commit,
        "dirty": dirty,
        "versions": {
            "python": platform.python_version(),
            **{name: version_of(package) for name, package in _PACKAGES.items()},
        },
        "machine": {
            "system": platform.platform(),
            "processor": _processor(),
            "cores": os.cpu_count(),
        },
        "configuration": dict(configuration),
        "reasoner": reasoner,
        "model": model,
    }
    write_json(folder / RUN, document, indent=2)


def made_by(commit: str | None, *, dirty: bool | None, version: str | None) -> str:
    """The program that made something, in a word: the commit of its checkout, with a + where its
    source differed from it, or the version where it was installed."""
    if commit is None:
        return f"pliant {version}"
    return f"{commit[:12]}{'+' if dirty else ''}"


def made_here() -> str:
    """The program that is running, as `made_by` names it."""
    commit, dirty = _commit()
    return made_by(commit, dirty=dirty, version=version_of("pliant"))


def made_in(folder: Path) -> str | None:
    """The program that made a run, by its run.json; None: it does not say."""
    try:
        document = json.loads(folders.read(folder / RUN, MOST_JSON))
        version = str(document["versions"]["pliant"])
        return made_by(document["commit"], dirty=document["dirty"], version=version)
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _commit() -> tuple[str | None, bool | None]:
    """The checkout's commit and whether its source differs from it; None where pliant was
    installed, or there is no git."""
    here = Path(__file__)
    if _git(here.parent, "ls-files", "--error-unmatch", here.name) is None:
        return None, None
    commit = _git(here.parent, "rev-parse", "HEAD")
    changes = _git(here.parent, "status", "--porcelain", "--", ".")
    return commit, bool(changes)


def _git(folder: Path, *arguments: str) -> str | None:
    try:
        done = subprocess.run(
            ["git", "-C", str(folder), *arguments],
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            timeout=10,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()


def version_of(package: str) -> str | None:
    """The version of an installed package; None: it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _processor() -> str:
    """The processor's name, where the system tells it."""
    if sys.platform == "linux":
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
