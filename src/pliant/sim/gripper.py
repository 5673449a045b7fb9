"""The 2F-85's shape when it holds a peg: Menagerie's gripper, closed by its own actuator.

The simulated cell needs the gripper's weight, its looks and its fingertips, not its linkage: the
peg does not slip (Sec. VI-A). So the linkage is settled once on a peg-wide block, and the poses of
its links are kept.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from pliant.menagerie import GRIPPER, menagerie_file

_CLOSED = 255.0  # of the actuator's range
_QUARTER_TURN = [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]  # about z
_VISUAL_GROUP = 2
_CLOSING_STEPS = 2000


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """A mesh or box of the gripper, in the frame of its mounting plate, fingers along +z."""

    name: str
    mesh: Path | None
    half_size: NDArray[np.float64] | None  # (3,) [m] of a box
    position: NDArray[np.float64]  # (3,) [m]
    quaternion: NDArray[np.float64]  # (4,) w, x, y, z
    rgba: tuple[float, ...]


@lru_cache(maxsize=8)
def closed_on(width: float) -> tuple[Part, ...]:
    """The parts of the gripper closed on a block `width` wide [m], its fingers moving along y."""
    spec = mujoco.MjSpec.from_file(str(menagerie_file(GRIPPER)))
    mount = spec.body("base_mount")
    mount.pos, mount.quat = [0, 0, 0], _QUARTER_TURN  # as shipped it closes along x
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX, pos=[0, 0, 0.155], size=[0.02, width / 2, 0.03]
    )
    spec.option.gravity = [0, 0, 0]
    files = {
        m.name or Path(m.file).stem: Path(spec.modelfiledir, spec.meshdir, m.file)
        for m in spec.meshes
    }
    model = spec.compile()
    data = mujoco.MjData(model)
    for step in range(_CLOSING_STEPS):  # slowly, until the pads touch
        data.ctrl[:] = _CLOSED * step / _CLOSING_STEPS
        mujoco.mj_step(model, data)
        if any(min(c.geom) == 0 for c in data.contact):
            break
    mujoco.mj_kinematics(model, data)

    parts = []
    for i in range(model.ngeom):
        geom, body = model.geom(i), int(model.geom_bodyid[i])
        if body == 0:
            continue
        if geom.name.endswith("_pad1"):  # of a fingertip
            name, mesh, half_size = geom.name, None, np.array(geom.size)
            position, quaternion = data.geom_xpos[i].copy(), np.zeros(4)
            mujoco.mju_mat2Quat(quaternion, data.geom_xmat[i])
        elif int(geom.group[0]) == _VISUAL_GROUP:  # its pose in its link is the identity
            drawn = model.mesh(int(model.geom_dataid[i])).name
            name, mesh, half_size = f"{model.body(body).name}_{drawn}", files[drawn], None
            position, quaternion = data.xpos[body].copy(), data.xquat[body].copy()
        else:
            continue
        parts.append(
            Part(
                name=name,
                mesh=mesh,
                half_size=half_size,
                position=position,
                quaternion=quaternion,
                rgba=_rgba(model, i),
            )
        )
    return tuple(parts)


def _rgba(model: mujoco.MjModel, geom: int) -> tuple[float, ...]:
    material = int(model.geom_matid[geom])
    rgba = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
    return tuple(float(v) for v in rgba)
