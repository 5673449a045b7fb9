"""Options that set the range of a drawn quantity, in the units of the command line."""

from dataclasses import asdict, dataclass
from typing import Any

from pliant.conditions import condition
from pliant.levels import FIELDS

Range = tuple[float, float] | None


@dataclass(frozen=True, kw_only=True)
class Ranges:
    """Ranges in place of the condition's own: low and high of a uniform draw."""

    friction: Range = None
    """Factor on the hole's friction."""
    hole_y_mm: Range = None
    """The hole's offset from where it is expected."""
    grasp_roll_deg: Range = None
    """The peg's angle in the grasp about x."""
    hole_x_mm: Range = None
    """The hole's offset across the plane of insertion."""
    board_z_mm: Range = None
    """The board's height above the nominal."""
    board_yaw_deg: Range = None
    """The board's angle about the vertical."""
    grasp_pitch_deg: Range = None
    """The peg's angle in the grasp about y."""

    def applied_to(self, name: str) -> Any:
        """The condition as an experiment's field: its name, or its ranges with these in place."""
        given = {field: value for field, value in asdict(self).items() if value is not None}
        if not given:
            return name
        own = condition(name).ranges
        ranges = {
            field: [v if axis is None else axis.to_report(v) for v in own[quantity]]
            for field, (quantity, axis) in FIELDS.items()
            if quantity in own
        }
        return {"name": f"{name}-own", **ranges, **{f: list(v) for f, v in given.items()}}
