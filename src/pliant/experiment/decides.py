"""Everything beside its spec that decides a trial's outcome, as content hashes and versions.

The fingerprint of an experiment holds it, so that a folder's trials were all made by the same; a
worker compares it with its own, so that they are, on whatever machine.

- `code`: pliant's own files, but for those that only show, store or convert.
- `models`: the robots' MJCF files and every mesh that they name, as MuJoCo loads them.
- `versions`: of MuJoCo (physics and drawing), OpenCV (what is measured in pictures), NumPy (draws,
  linear algebra), Python to the minor version (3.12, say, sums floats in another way), and with a
  VLM of the library that words its requests, and of the server where pliant has its own.
- `weights`: of a model that pliant serves itself.

Not in it, because nothing of theirs reaches a trial: PyYAML (what it read is in the fingerprint,
parsed), PyArrow, PyAV, rich, tyro. Nor are the processor and the OpenGL driver, since a cluster may
mix them; run.json names the machine.
"""

import hashlib
import json
import platform
import sys
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import cv2

from pliant import menagerie, store
from pliant.errors import InputError
from pliant.experiment.one import Spec
from pliant.formations import Formation
from pliant.own import own_file
from pliant.reasoners.vlm import local
from pliant.reasoners.vlm.settings import Settings
from pliant.task import load_task
from pliant.teaching import Teaching

_CANNOT_DECIDE = (
    *("cli", "calibration", "commissioning", "report", "export", "envs", "emulator"),
    *("experiment", "store.py", "html.py"),
)
_DECIDE = ("misread.py", "one.py", "oracle.py", "rows.py", "success.py")  # of the experiment's own


def installation(*, models: bool = True, asked: Iterable[Settings] = ()) -> dict[str, Any]:
    """The installation on this machine, as JSON: with the robots' `models` where it is simulated,
    and with the libraries of the VLMs that are `asked`.

    Raises:
        InputError: a robot model cannot be read.
    """
    packages = ["pliant", "mujoco", "numpy"]
    for settings in asked:
        packages += ["pydantic-ai-slim", *(["xllamacpp"] if settings.is_local else [])]
    python = ".".join(map(str, sys.version_info[:2]))
    return {
        "code": _code(),
        "models": menagerie.digest() if models else None,
        # OpenCV's own word: it comes in packages of several names
        "versions": {
            **{name: store.version_of(name) for name in packages},
            "opencv": cv2.__version__,
            "python": python,
        },
    }


def expected(spec: Spec) -> dict[str, Any]:
    """The installation that a worker must have to simulate this trial, with the hashes of a user's
    own files."""
    own = {"reasoner_file": spec.reasoner, "method_file": spec.method}
    return {
        **installation(asked=[] if spec.vlm is None else [spec.vlm]),
        **{what: own_file_hash(name) for what, name in own.items()},
        "weights": weights_hash(spec.vlm),
    }


def check(spec: Spec, wanted: Mapping[str, Any]) -> None:
    """Check that this process would perform a trial as the one that planned it.

    Raises:
        InputError: something that decides its outcome is another here.
    """
    here = expected(spec)
    if here == wanted:
        return
    differ = [name for name in wanted if wanted[name] != here[name]]
    versions = [f"{k} {v}" for k, v in here["versions"].items() if wanted["versions"].get(k) != v]
    also = f" (here: {', '.join(versions)})" if versions else ""
    raise InputError(
        f"a worker on {platform.node()} would not perform the trials as they were planned:"
        f" {', '.join(differ)} differ{also}; install the same there, change nothing while an"
        " experiment runs, and choose a new folder if it was changed"
    )


def digest(*parts: bytes) -> str:
    """A content hash of byte strings in this order."""
    total = hashlib.sha256()
    for part in parts:
        total.update(hashlib.sha256(part).digest())
    return total.hexdigest()


def own_file_hash(name: str) -> str | None:
    """Content hash of a user's own file, of a reasoner or a method; None: the name is no such
    file's. What that file imports is not followed."""
    own = own_file(name)
    return digest(own[0].read_bytes()) if own is not None and own[0].is_file() else None


def weights_hash(settings: Settings | None) -> str | None:
    """Content hash of the weights of a model that pliant serves itself; None: it does not, or they
    are not there, which a replay does not need."""
    found = None if settings is None else local.weights_of(settings)
    files = [] if found is None else [found.model, found.projector]
    if not files or not all(path.is_file() for path in files):
        return None
    return _hash_of_files(*((path, path.stat().st_mtime_ns) for path in files))


@lru_cache
def _hash_of_files(*files: tuple[Path, int]) -> str:
    """Content hash of files; the times of their last change say when it must be made anew."""
    return digest(*(path.read_bytes() for path, _ in files))


def goals(taught: Teaching) -> str:
    """Content hash of taught goals: with the pictures, and the peg they were taught with."""
    by_name = {f: {a: float(v) for a, v in g.items()} for f, g in taught.goals.formations.items()}
    peg = asdict(load_task(next(iter(taught.demonstrations.values())).peg))
    pictures = (taught.demonstrations[f].view.image.tobytes() for f in Formation)
    return digest(json.dumps([by_name, peg], sort_keys=True).encode(), *pictures)


@lru_cache(maxsize=1)
def _code() -> str:
    """Content hash of the package's files that a trial's outcome can depend on."""
    root = Path(str(files("pliant")))
    kept = [root / "experiment" / name for name in _DECIDE]
    kept += [
        path
        for path in root.rglob("*")
        if path.is_file()
        and path.suffix != ".pyc"
        and path.relative_to(root).parts[0] not in _CANNOT_DECIDE
    ]
    return digest(
        *(
            part
            for p in sorted(kept)
            for part in (str(p.relative_to(root)).encode(), p.read_bytes())
        )
    )
