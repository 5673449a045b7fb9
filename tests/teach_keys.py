"""The key presses that teach the five formations with the circle in the simulated cell."""

from collections.abc import Sequence

PRESSES: Sequence[tuple[str, str, Sequence[str]]] = (
    ("approach", "y 26.0 mm, z 213.8 mm, roll 10.0 deg", [*"3dd2ddd3sss5,,,,,"]),
    ("contact", "z 187.8 mm", [*"3ss2sss"]),
    ("fit", "y -35.0 mm", [*"3aaaaaa1aa"]),
    ("align", "y 0.0 mm", [*"3ddd2dd1dd"]),
    ("insertion", "z 167.8 mm", [*"3ss"]),
)
"""Per formation: its goal, and the keys that lead there from the one before, without Enter."""
