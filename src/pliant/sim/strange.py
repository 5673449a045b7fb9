"""Strange things, which are not as the task says: another peg in the grasp or none, something in
the hole, or a bar across the board.

All of it is in every compiled model and put away, so that a trial can bring it out: what is put
away is neither drawn nor touched. Sizes are compiled at their largest, which MuJoCo's search for
contacts relies on.
"""

import mujoco
import numpy as np

from pliant.conditions import QUANTITIES, Setup
from pliant.sim import constants as c
from pliant.task import Task

STRANGE = _WRONG_PEG, _PLUG, _BAR = "wrong_peg", "plug", "bar"  # bodies
_BUILT = "built"  # the right peg's mass and inertia, half its width along x, half its length
_SHOWN, _HIDDEN = 0, 3  # geom groups: MuJoCo draws the first three
_LEFT = 1e-3  # share of the peg's mass that stays where there is none
_PLUG_HALF = 0.03  # [m] of its height
_BAR_HALF = (0.022, 0.006)  # [m] along x and y: it bridges the hole
_INTO_WALLS = 0.001  # [m]


def add(spec: mujoco.MjSpec, task: Task, peg: str, board: str) -> None:
    """Add the strange things to the bodies of the right peg and of the board."""
    half_x, half_y = task.peg.half_extents
    spec.add_numeric(name=_BUILT, data=[0.0, 0.0, 0.0, 0.0, half_x, task.peg.length / 2])
    most = {
        name: QUANTITIES[name].valid[1] / 2 for name in ("peg_wider", "peg_longer", "bar_height")
    }
    half = task.peg.length / 2
    wrong = (half_x + most["peg_wider"], half_y, half + most["peg_longer"])
    below = task.peg_top_above_grasp - half
    _add_box(spec.body(peg), _WRONG_PEG, wrong, c.PEG_RGBA, c.PEG_BITS, z=below)
    walls = task.hole.clearance / 2 + _INTO_WALLS
    plug = (half_x + walls, half_y + walls, _PLUG_HALF)
    _add_box(spec.body(board), _PLUG, plug, c.STRANGE_RGBA, c.HOLE_BITS)
    bar = (*_BAR_HALF, most["bar_height"])
    _add_box(spec.body(board), _BAR, bar, c.STRANGE_RGBA, c.HOLE_BITS)


def _add_box(
    parent: mujoco.MjsBody,
    name: str,
    half: tuple[float, float, float],
    rgba: c.Rgba,
    bits: tuple[int, int],
    *,
    z: float = 0.0,
) -> None:
    """A box in a body of its own, which a trial may move in the compiled model."""
    parent.add_body(name=name, pos=[0.0, 0.0, z]).add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=list(half),
        rgba=list(rgba),
        mass=0,
        **c.contact(bits),
    )


def put_away(model: mujoco.MjModel) -> None:
    """Note what was built in a model that was just compiled, and leave nothing strange."""
    peg = _right_peg(model)
    model.numeric(_BUILT).data[:4] = [float(peg.mass[0]), *peg.inertia]
    bring_out(model, Setup(seed=0))


def bring_out(model: mujoco.MjModel, setup: Setup) -> None:
    """Bring out the strange things of a setup, and put the rest away."""
    peg, (mass, *inertia, half_x, half_z) = _right_peg(model), model.numeric(_BUILT).data
    missing, wrong = setup.is_on("peg_missing"), bool(setup.peg_wider or setup.peg_longer)
    first = int(peg.geomadr[0])
    for geom in range(first, first + int(peg.geomnum[0])):
        _show(model, geom, c.PEG_BITS, not (missing or wrong))
    share = _LEFT if missing else 1.0
    peg.mass[:], peg.inertia[:] = share * mass, share * np.array(inertia)
    other, plug, bar = (model.geom(name) for name in (_WRONG_PEG, _PLUG, _BAR))
    _show(model, other.id, c.PEG_BITS, wrong and not missing)
    other.size[0], other.size[2] = half_x + setup.peg_wider / 2, half_z + setup.peg_longer / 2
    other.pos[2] = -setup.peg_longer / 2  # its top stays where it is
    _show(model, plug.id, c.HOLE_BITS, setup.plugged_at > 0.0)
    model.body(_PLUG).pos[2] = -setup.plugged_at - _PLUG_HALF
    _show(model, bar.id, c.HOLE_BITS, setup.bar_height > 0.0)
    bar.size[2] = setup.bar_height / 2
    model.body(_BAR).pos[1:] = setup.bar_y, setup.bar_height / 2


def _right_peg(model: mujoco.MjModel) -> "mujoco._structs._MjModelBodyViews":
    return model.body(int(model.body(_WRONG_PEG).parentid[0]))


def _show(model: mujoco.MjModel, geom: int, bits: tuple[int, int], shown: bool) -> None:
    model.geom_group[geom] = _SHOWN if shown else _HIDDEN
    model.geom_contype[geom], model.geom_conaffinity[geom] = bits if shown else (0, 0)


def is_drawn(model: mujoco.MjModel, geom: int) -> bool:
    """Whether pictures show a geom."""
    return int(model.geom_group[geom]) < _HIDDEN
