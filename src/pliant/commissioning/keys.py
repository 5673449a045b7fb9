"""The meaning of the keys of `pliant teach`, and the keys in a terminal's bytes.

Letters count without regard to case, so that Caps Lock turns no motion around.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from pliant.pose import Axis


class Do(StrEnum):
    """The actions that a person may ask for besides a step along an axis."""

    RECORD = "record"
    UNDO = "undo"
    NEXT = "next"
    BACK = "back"
    GO = "go"
    KEEP = "keep"
    TARE = "tare"
    GUIDE = "guide"
    QUIT = "quit"


@dataclass(frozen=True)
class Jog:
    """A request for one step along or about an axis, forward (1) or backward (-1)."""

    axis: Axis
    sign: int


@dataclass(frozen=True)
class StepOf:
    """A request that later steps along or about an axis be of this size [mm or deg]."""

    size: float
    is_angle: bool


Intent = Do | Jog | StepOf

LENGTHS_MM = (0.5, 2.0, 10.0)
ANGLES_DEG = (0.5, 2.0)

INTENTS: Mapping[str, Intent] = {
    "a": Jog(Axis.Y, -1),
    "d": Jog(Axis.Y, 1),
    "w": Jog(Axis.Z, 1),
    "s": Jog(Axis.Z, -1),
    "left": Jog(Axis.Y, -1),
    "right": Jog(Axis.Y, 1),
    "up": Jog(Axis.Z, 1),
    "down": Jog(Axis.Z, -1),
    ",": Jog(Axis.ROLL, 1),
    ".": Jog(Axis.ROLL, -1),
    "x": Jog(Axis.X, -1),
    "c": Jog(Axis.X, 1),
    "i": Jog(Axis.PITCH, 1),
    "k": Jog(Axis.PITCH, -1),
    "j": Jog(Axis.YAW, 1),
    "l": Jog(Axis.YAW, -1),
    "1": StepOf(LENGTHS_MM[0], False),
    "2": StepOf(LENGTHS_MM[1], False),
    "3": StepOf(LENGTHS_MM[2], False),
    "4": StepOf(ANGLES_DEG[0], True),
    "5": StepOf(ANGLES_DEG[1], True),
    "enter": Do.RECORD,
    "u": Do.UNDO,
    "n": Do.NEXT,
    "b": Do.BACK,
    "g": Do.GO,
    "=": Do.KEEP,
    "0": Do.TARE,
    "f": Do.GUIDE,
    "q": Do.QUIT,
}

HELP = (  # the most important first: a small screen loses the last ones
    ("q Ctrl-C", "halt and end"),
    ("← → a d", "y"),
    ("↑ ↓ w s", "z"),
    (", .", "roll: lean left, right"),
    ("x c  i k  j l", "x, pitch, yaw"),
    ("1 2 3", "0.5, 2, 10 mm"),
    ("4 5", "0.5, 2 deg"),
    ("Enter", "record"),
    ("u", "undo"),
    ("n b", "next, previous"),
    ("g", "go to the recorded pose"),
    ("=", "put back what this formation keeps"),
    ("0", "tare"),
    ("f", "freedrive"),
)

_KEY = re.compile(  # ESC [ or ESC O, parameters, then a letter or ~; ESC and a key; any other key
    rb"\x1b[\[O][^\x40-\x7e]*[\x40-\x7e]|\x1b[^\[O]|[^\x1b]", re.DOTALL
)
_NAMED = {b"\n": "enter", b"\r": "enter"} | {
    b"\x1b" + start + letter: name
    for start in (b"[", b"O")
    for letter, name in ((b"A", "up"), (b"B", "down"), (b"C", "right"), (b"D", "left"))
}


def split(data: bytes) -> tuple[list[str], bytes]:
    """The keys in what a terminal sent, and the beginning of an escape sequence that is not whole
    yet. A key without a meaning is ""."""
    keys: list[str] = []
    at = 0
    while found := _KEY.match(data, at):
        key, at = found[0], found.end()
        is_plain = len(key) == 1 and 32 < key[0] < 127
        keys.append(chr(key[0]).lower() if is_plain else _NAMED.get(key, ""))
    return keys, data[at:]
