"""The key presses that teach the five formations with the circle, and hands that press them."""

from collections.abc import Sequence

from a_terminal import Terminal

PRESSES: Sequence[tuple[str, str, Sequence[str]]] = (
    ("approach", "y 26.0 mm, z 213.8 mm, roll 10.0 deg", [*"3dd2ddd3sss5,,,,,"]),
    ("contact", "z 187.8 mm", [*"3ss2sss"]),
    ("fit", "y -35.0 mm", [*"3aaaaaa1aa"]),
    ("align", "y 0.0 mm", [*"3ddd2dd1dd"]),
    ("insertion", "z 167.8 mm", [*"3ss"]),
)
"""Per formation: its goal, and the keys that lead there from the one before, without Enter."""

MOVES = {
    "a": ("y", -1),
    "d": ("y", 1),
    "s": ("z", -1),
    "w": ("z", 1),
    ",": ("roll", 1),
    "\x1b[B": ("z", -1),
}
LENGTHS = {"1": 0.5, "2": 2.0, "3": 10.0}


def shows(axis: str, set_point: float) -> str:
    """The row of the table that an axis has."""
    return rf"(?m)^{axis} +{set_point:.1f} "


class Hands:
    """Press a key, wait until the screen shows what it must have done, press the next."""

    def __init__(self, terminal: Terminal) -> None:
        self.terminal = terminal
        self.at = {"y": 0.0, "z": 243.8, "roll": 0.0}
        self.length = 2.0
        terminal.until(shows("z", 243.8))

    def press(self, keys: Sequence[str]) -> None:
        for key in keys:
            self.terminal.press(key)
            if key in LENGTHS:
                self.length = LENGTHS[key]
                self.terminal.until(rf"(?m)^y .* {self.length:g} mm")
            elif key in MOVES:
                axis, sign = MOVES[key]
                self.at[axis] += sign * (2.0 if axis == "roll" else self.length)
                self.terminal.until(shows(axis, self.at[axis]))

    def teach(self, name: str, goal: str, keys: Sequence[str]) -> None:
        self.press(keys)
        self.terminal.press("\r")
        self.terminal.until(f"{name} recorded: {goal}")

    def retrace(self, name: str, at: dict[str, float]) -> None:
        """Go to what was recorded for a formation, and on to the next."""
        self.terminal.until(f"▶ {name}")
        self.terminal.press("g")
        self.at |= at
        for axis, value in self.at.items():
            self.terminal.until(shows(axis, value))
        self.terminal.press("n")
