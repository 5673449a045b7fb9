"""Options that set the range of a drawn quantity, in the units of the command line."""

from dataclasses import asdict, dataclass
from typing import Annotated, Any

import tyro

from pliant.conditions import check_range, condition
from pliant.levels import FIELDS

Range = Annotated[tuple[float, float] | None, tyro.conf.arg(metavar="MIN MAX")]


@dataclass(frozen=True, kw_only=True)
class Ranges:
    """Drawn in place of the condition's own ranges, each evenly from MIN to MAX."""

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
    grasp_yaw_deg: Range = None
    """How far the peg is turned in the grasp about its axis."""
    looks: Range = None
    """Above 0.5: colours, textures, light, noise and cameras are random."""
    occluder: Range = None
    """Above 0.5: a post before the side and the front camera."""
    stale: Range = None
    """Share of pictures that are old."""
    misread: Range = None
    """Share of the hole's measurements that are 10 mm off."""
    board_shift_mm: Range = None
    """How far the board is pushed when it is struck."""
    board_shift_heading_deg: Range = None
    """The direction in which the board is pushed when it is struck."""
    grasp_turn_deg: Range = None
    """How far the peg turns in the grasp when it is struck."""
    grasp_slide_mm: Range = None
    """How far the peg slides up in the grasp when it is struck."""
    struck_at_s: Range = None
    """When board and grasp are struck."""
    wrist_stiffness: Range = None
    """Factor on the wrist's stiffness."""
    compression_noise_mm: Range = None
    """Standard deviation of a reading of the compression."""
    peg_missing: Range = None
    """Above 0.5: the gripper holds no peg."""
    peg_wider_mm: Range = None
    """How much wider along x the peg is than its file says."""
    peg_longer_mm: Range = None
    """How much longer the peg is than its file says."""
    plugged_at_mm: Range = None
    """How far below the surface the hole is plugged."""
    bar_height_mm: Range = None
    """Height of a bar across the board."""
    bar_y_mm: Range = None
    """The distance of the bar across the board from the hole along y."""
    hole_misread_mm: Range = None
    """How far off every reading of the hole's y is."""
    compression_dead: Range = None
    """Above 0.5: the compression always reads the same."""
    compression_scale: Range = None
    """Factor on what the compression reads."""
    pictures_frozen: Range = None
    """Above 0.5: after 4 s every camera's picture stays as it is."""
    blind_below_mm: Range = None
    """With the tip lower than this over the board no camera shows anything."""

    @property
    def first_given(self) -> str | None:
        """The first option that is given; None: none is."""
        given = (name for name, value in asdict(self).items() if value is not None)
        name = next(given, None)
        return None if name is None else f"--{name.replace('_', '-')}"

    def applied_to(self, name: str) -> Any:
        """The condition as an experiment's field: its name, or its ranges with these in place.

        Raises:
            InputError: a range is out of order, or cannot be simulated.
        """
        given = {field: value for field, value in asdict(self).items() if value is not None}
        if not given:
            return name
        for field, values in given.items():
            quantity, axis = FIELDS[field]
            low, high = (v if axis is None else axis.from_report(v) for v in values)
            check_range(f"--{field.replace('_', '-')}", quantity, low, high)
        own = condition(name).ranges
        ranges = {
            field: [v if axis is None else axis.to_report(v) for v in own[quantity]]
            for field, (quantity, axis) in FIELDS.items()
            if quantity in own
        }
        return {"name": f"{name}-own", **ranges, **{f: list(v) for f, v in given.items()}}
