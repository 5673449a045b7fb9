"""The cell's bodies as triangles with colours, from the compiled MuJoCo model."""

import math
from dataclasses import dataclass
from itertools import product

import mujoco
import numpy as np
from numpy.typing import NDArray

from pliant.sim import model as m
from pliant.sim.strange import STRANGE, is_drawn

_ARM, _GRIPPER = "robot", "gripper"
_SIDES = 48  # of a cylinder


@dataclass(frozen=True, kw_only=True, eq=False)
class Solid:
    """A part of the cell that moves with one body: corners in that body's frame [m]."""

    name: str  # robot/<link>, wrist, gripper, peg, board
    body: int
    corners: NDArray[np.float64]  # (n, 3)
    triangles: NDArray[np.int32]  # (k, 3), counter-clockwise from outside
    colours: NDArray[np.uint8]  # (n, 4) RGBA of each corner


def solids(model: mujoco.MjModel) -> list[Solid]:
    """The solids of everything that is drawn and fixed to a body; the table, which is fixed to the
    world, is left out."""
    parts: dict[str, list[Solid]] = {}
    for geom in range(model.ngeom):
        body = int(model.geom_bodyid[geom])
        if body == 0 or not is_drawn(model, geom):
            continue
        part = _solid(model, geom, _name(model, geom, body), body)
        parts.setdefault(part.name, []).append(part)
    return [_joined(pieces) for pieces in parts.values()]


def _name(model: mujoco.MjModel, geom: int, body: int) -> str:
    name = str(model.body(body).name)
    if name in (m.PEG, m.BOARD):
        return name
    if name == m.WRIST:
        return _GRIPPER if str(model.geom(geom).name).startswith("gripper_") else m.WRIST
    return name if name in STRANGE else f"{_ARM}/{name}"


def _solid(model: mujoco.MjModel, geom: int, name: str, body: int) -> Solid:
    corners, triangles = _triangles(model, geom)
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
    placed = corners @ rotation.reshape(3, 3).T + model.geom_pos[geom]
    material = int(model.geom_matid[geom])
    rgba = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
    colour = np.round(np.clip(rgba, 0, 1) * 255).astype(np.uint8)
    return Solid(
        name=name,
        body=body,
        corners=placed,
        triangles=triangles,
        colours=np.tile(colour, (len(placed), 1)),
    )


def _triangles(model: mujoco.MjModel, geom: int) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    if kind == int(mujoco.mjtGeom.mjGEOM_MESH):
        mesh = int(model.geom_dataid[geom])
        vertex, face = int(model.mesh_vertadr[mesh]), int(model.mesh_faceadr[mesh])
        vertices = model.mesh_vert[vertex : vertex + int(model.mesh_vertnum[mesh])]
        faces = model.mesh_face[face : face + int(model.mesh_facenum[mesh])]
        return vertices.astype(np.float64), faces.astype(np.int32)
    if kind == int(mujoco.mjtGeom.mjGEOM_BOX):
        return _box(size)
    if kind == int(mujoco.mjtGeom.mjGEOM_CYLINDER):
        return _cylinder(float(size[0]), float(size[1]))
    raise NotImplementedError(f"geom {model.geom(geom).name} is of a type not drawn here: {kind}")


def _box(half: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    corners = np.array(list(product((-1.0, 1.0), repeat=3))) * half
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return corners, np.array(triangles, np.int32)


def _cylinder(radius: float, half: float) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    angle = math.tau * np.arange(_SIDES) / _SIDES
    ring = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    low, high = (np.column_stack([ring, np.full(_SIDES, z)]) for z in (-half, half))
    corners = np.vstack([low, high, [[0.0, 0.0, -half], [0.0, 0.0, half]]])
    bottom, top = 2 * _SIDES, 2 * _SIDES + 1
    triangles = []
    for i in range(_SIDES):
        j = (i + 1) % _SIDES
        triangles += [(i, j, _SIDES + j), (i, _SIDES + j, _SIDES + i)]
        triangles += [(bottom, j, i), (top, _SIDES + i, _SIDES + j)]
    return corners, np.array(triangles, np.int32)


def _joined(pieces: list[Solid]) -> Solid:
    starts = np.cumsum([0] + [len(piece.corners) for piece in pieces[:-1]])
    return Solid(
        name=pieces[0].name,
        body=pieces[0].body,
        corners=np.vstack([piece.corners for piece in pieces]),
        triangles=np.vstack(
            [p.triangles + np.int32(s) for p, s in zip(pieces, starts, strict=True)]
        ),
        colours=np.vstack([piece.colours for piece in pieces]),
    )
