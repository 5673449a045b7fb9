"""The plant's state in shared memory: the controller writes it every tick, the camera reads it.

A sequence lock: the writer makes the counter odd, writes, and makes it even; a reader that sees it
odd or changed reads again. So drawing never holds up the controller.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from multiprocessing.shared_memory import SharedMemory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pliant.conditions import NOMINAL, Setup
from pliant.emulator.frames import Array
from pliant.errors import InputError

_MOST_JOINTS = 32
_MOST_NAME = 512  # [bytes] of a peg's name or file
_LAYOUT = np.dtype(
    [
        ("sequence", "<u8"),
        ("time_s", "<f8"),
        ("fault", "<u4"),
        ("joints", "<u4"),
        ("qpos", "<f8", (_MOST_JOINTS,)),
        ("setup", "<f8", (len(NOMINAL),)),
        ("peg", f"S{_MOST_NAME}"),
    ]
)
_ATTEMPTS = 1000


class CameraFault(StrEnum):
    """A fault of the camera, or none."""

    OK = "ok"
    FROZEN = "frozen"
    ERROR = "error"
    DEAD = "dead"


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockState:
    """The plant's state, as far as a picture needs it."""

    time_s: float  # the controller's
    qpos: Array  # (nq,)
    peg: str  # a shipped peg's name or a peg file
    setup: Setup
    fault: CameraFault


class Block:
    """A block of shared memory. The process that made it must `close` it last."""

    def __init__(self, name: str | None = None) -> None:
        """Attach to a block by name, or make one."""
        self._is_owner = name is None
        self._memory = SharedMemory(name, create=self._is_owner, size=_LAYOUT.itemsize)
        self.name = self._memory.name
        self._record = np.ndarray((1,), _LAYOUT, self._memory.buf)

    def set_up(self, peg: str, setup: Setup) -> None:
        """Write what a trial changes.

        Raises:
            InputError: the peg's name is too long.
        """
        if len(peg.encode()) > _MOST_NAME:
            raise InputError(f"peg '{peg[:40]}…': its path must have at most {_MOST_NAME} bytes")
        with self.writing() as record:
            record["peg"], record["setup"] = peg.encode(), [*setup.quantities().values()]

    def write(self, time_s: float, qpos: Array) -> None:
        """Write what a tick changes."""
        with self.writing() as record:
            record["time_s"], record["joints"] = time_s, len(qpos)
            record["qpos"][0, : len(qpos)] = qpos

    def set_fault(self, fault: CameraFault) -> None:
        with self.writing() as record:
            record["fault"] = list(CameraFault).index(fault)

    def read(self) -> BlockState:
        """The latest state, all of one tick.

        Raises:
            TimeoutError: the writer stopped in the middle.
        """
        for _ in range(_ATTEMPTS):
            before = int(self._record["sequence"][0])
            record = self._record[0].copy()
            if before % 2 == 0 and before == int(self._record["sequence"][0]):
                return BlockState(
                    time_s=float(record["time_s"]),
                    qpos=record["qpos"][: int(record["joints"])].copy(),
                    peg=record["peg"].decode(),
                    setup=Setup(
                        seed=0, **dict(zip(NOMINAL, record["setup"].tolist(), strict=True))
                    ),
                    fault=list(CameraFault)[int(record["fault"])],
                )
        raise TimeoutError("the controller stopped in the middle of a write")

    def close(self) -> None:
        del self._record
        self._memory.close()
        if self._is_owner:
            self._memory.unlink()

    @contextmanager
    def writing(self) -> Iterator[NDArray[Any]]:
        """The record, which nobody reads while this context lasts."""
        self._record["sequence"] += 1
        yield self._record
        self._record["sequence"] += 1
