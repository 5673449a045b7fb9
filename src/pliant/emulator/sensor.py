"""The force-torque sensor in the flange: payload compensation, zero, noise."""

from dataclasses import dataclass, field

import numpy as np

from pliant.emulator.frames import Array, cross
from pliant.wrist import GRAVITY


@dataclass(frozen=True, kw_only=True)
class SensorPayload:
    """The payload that the controller believes hangs on the flange."""

    mass: float = 0.0  # [kg]
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [m] on the flange
    inertia: tuple[float, ...] = (0.0,) * 6  # [kg m2], reported and not used


@dataclass(kw_only=True)
class ForceSensor:
    """Turns what the tool does to the flange into what the controller reports.

    A wrench (6,) is force [N] and torque [N m]; `zero` belongs to the sensor, so it turns with the
    flange.
    """

    payload: SensorPayload = field(default_factory=SensorPayload)
    noise: float = 0.0  # [N], one standard deviation per axis
    seed: int = 0

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng(self.seed)
        self._zero = np.zeros(6)  # in flange axes
        self.raw: Array = np.zeros(6)  # flange axes, nothing compensated
        self.external: Array = np.zeros(6)  # base axes at the flange, payload compensated
        self.reported: Array = np.zeros(6)  # the same less the zero

    def read(self, force: Array, torque: Array, facing: Array) -> None:
        """Take a reading: force and torque (3,) of the tool on the flange in base axes, and the
        flange's rotation (3, 3)."""
        wrench = np.concatenate([force, torque])
        if self.noise:
            wrench[:3] += self._rng.normal(0.0, self.noise, 3)
        self.external = wrench - self._weight(facing)
        self.reported = self.external - _turned(facing, self._zero)
        self.raw = _turned(facing.T, wrench)

    def zero(self, facing: Array) -> None:
        """Count from the present reading on."""
        self._zero = _turned(facing.T, self.external)
        self.reported = np.zeros(6)

    def at(self, point: Array) -> Array:  # (6,)
        """The reported wrench about a point (3,) given from the flange's centre, base axes."""
        force, torque = self.reported[:3], self.reported[3:]
        return np.concatenate([force, torque - cross(point, force)])

    def _weight(self, facing: Array) -> Array:
        force = np.array([0.0, 0.0, -GRAVITY * self.payload.mass])
        return np.concatenate([force, cross(facing @ np.array(self.payload.centre), force)])


def _turned(facing: Array, wrench: Array) -> Array:
    return np.concatenate([facing @ wrench[:3], facing @ wrench[3:]])
