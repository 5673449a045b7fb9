"""A Robotiq 2F-85 behind its URCap socket: `SET` and `GET` of its variables, one line each.

It moves on the controller's clock. The peg in the model is fixed to the wrist: opening the gripper,
or losing the peg, changes what the gripper reports, not the physics.
"""

from pliant.ur5e.protocol import Object

REFUSED = "nack"
"""The reply to a line that is no request."""

_CLOSED, _HOLDING = 255, 120  # positions: fully closed, and closed on a peg
_FASTEST, _SLOWEST = 400.0, 55.0  # [1/s] in units of position
_ACTIVATION_S = 1.5
_WRITABLE = ("ACT", "GTO", "FOR", "SPE", "POS", "ATR", "ARD")
_READABLE = ("ACT", "GTO", "FOR", "SPE", "POS", "PRE", "STA", "OBJ", "FLT", "ATR", "ARD")


class EmulatedGripper:
    """An emulated gripper: activated and closed on the peg, to begin with."""

    def __init__(self) -> None:
        self._set = {"ACT": 1, "GTO": 1, "FOR": 255, "SPE": 255, "ATR": 0, "ARD": 0}
        self._target, self._position = _CLOSED, float(_HOLDING)
        self._has_peg = True
        self._activating_s = 0.0
        self.readable = True  # not under an emergency stop

    def grip(self) -> None:
        """Close the fingers on the peg again."""
        self._set |= {"ACT": 1, "GTO": 1}
        self._target, self._position, self._activating_s = _CLOSED, float(_HOLDING), 0.0
        self._has_peg = True

    def lose(self) -> None:
        """Let the peg slip out; the fingers close on nothing."""
        self._has_peg = False

    def step(self, dt: float) -> None:
        if self._activating_s > 0.0:
            self._activating_s = max(0.0, self._activating_s - dt)
            return
        if not (self._set["ACT"] and self._set["GTO"]):
            return
        most = (_SLOWEST + (_FASTEST - _SLOWEST) * self._set["SPE"] / 255) * dt
        goal = self._goal()
        change = goal - self._position
        self._position += max(-most, min(most, change))

    def answer(self, line: str) -> str:
        """The reply to one request. `SET` is acknowledged without a newline, as the URCap does."""
        words = line.split()
        if words[:1] == ["GET"] and len(words) == 2 and words[1] in _READABLE:
            value = str(self._value(words[1])) if self.readable else "?"
            return f"{words[1]} {value}\n"
        pairs = dict(zip(words[1::2], words[2::2], strict=False))
        valid = all(k in _WRITABLE and v.isdigit() and int(v) <= 255 for k, v in pairs.items())
        if words[:1] != ["SET"] or not pairs or len(words) % 2 == 0 or not valid:
            return REFUSED
        for name, value in pairs.items():
            self._write(name, int(value))
        return "ack"

    def _write(self, name: str, value: int) -> None:
        if name == "POS":
            self._target = value
            return
        if name == "ACT" and value and not self._set["ACT"]:
            self._activating_s = _ACTIVATION_S
        self._set[name] = value

    def _goal(self) -> float:
        if self._has_peg and self._position >= _HOLDING - 1:
            return min(self._target, _HOLDING)
        if self._has_peg:
            self._has_peg = False  # it has opened: the peg falls
        return self._target

    def _value(self, name: str) -> int:
        if name == "POS":
            return round(self._position)
        if name == "PRE":
            return self._target
        if name == "STA":
            return 0 if not self._set["ACT"] else 1 if self._activating_s else 3
        if name == "OBJ":
            return self._object()
        return self._set.get(name, 0)

    def _object(self) -> Object:
        if self._has_peg and self._target > _HOLDING and abs(self._position - _HOLDING) < 1:
            return Object.CLOSING
        return Object.NONE if abs(self._position - self._target) < 0.5 else Object.MOVING
