"""Triangles that a camera never shows while a known motion is drawn: they always face away from it,
or lie beyond the same border of its picture. Without them the same pictures take less time."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

_LEAST_FACES = 100  # a mesh with fewer is drawn as it is
_BESIDE = np.float32(
    0.01
)  # [m] how far a camera may stand from where the model has it: `looks` shifts it

_Bounds = tuple[NDArray[np.float32], NDArray[np.float32]]  # the least and the most of each


@dataclass(frozen=True, kw_only=True, eq=False)
class Sight:
    """A camera at one moment, in every geom's frame: where it is, and the outward normals of its
    picture's borders."""

    eye: NDArray[np.float64]  # (ngeom, 3) [m]
    borders: NDArray[np.float64]  # (ngeom, borders, 3)


def sight(data: mujoco.MjData, camera: int, borders: NDArray[np.float64]) -> Sight:
    """The camera now; `borders` (n, 3) are on its own axes."""
    turns = data.geom_xmat.reshape(-1, 3, 3)
    outward = borders @ data.cam_xmat[camera].reshape(3, 3).T
    away = data.cam_xpos[camera] - data.geom_xpos
    return Sight(eye=(away[:, None] @ turns)[:, 0], borders=outward @ turns)


class Meshes:
    """The meshes of a model, of which some triangles are left out for a while."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._drawn = (model.mesh_face, model.mesh_facenormal, model.mesh_facetexcoord)
        self._whole = [array.copy() for array in self._drawn]
        self._count = model.mesh_facenum.copy()
        of = np.where(model.geom_type == mujoco.mjtGeom.mjGEOM_MESH, model.geom_dataid, -1)
        large = np.flatnonzero(self._count >= _LEAST_FACES).tolist()
        self._geoms = {mesh: g for mesh in large if (g := np.flatnonzero(of == mesh).tolist())}
        self._planes = {mesh: self._planes_of(mesh) for mesh in self._geoms}

    def leave_out(self, sights: Sequence[Sight]) -> list[int]:
        """Keep the triangles that may be seen at some of the moments; return the meshes that have
        changed."""
        eyes = np.array([s.eye for s in sights], np.float32)
        borders = np.array([s.borders for s in sights], np.float32)
        eye = eyes.min(axis=0) - _BESIDE, eyes.max(axis=0) + _BESIDE
        border = borders.min(axis=0), borders.max(axis=0)
        beyond = np.einsum("ngbi,ngi->ngb", borders, eyes).max(axis=0)
        for mesh, geoms in self._geoms.items():
            first, count = int(self._model.mesh_faceadr[mesh]), int(self._count[mesh])
            vertices, faces = self._vertices(mesh), self._whole[0][first : first + count]
            normal, offset = self._planes[mesh]
            shown = np.zeros(count, bool)
            for g in geoms:
                seen = _most(normal, (eye[0][g], eye[1][g])) > offset
                for b, furthest in enumerate(beyond[g]):
                    reach = -_most(vertices, (-border[1][g, b], -border[0][g, b]))
                    seen &= ~(reach > furthest)[faces].all(axis=1)
                shown |= seen
            shown[0] = True  # an empty mesh is none
            kept = int(np.count_nonzero(shown))
            self._model.mesh_facenum[mesh] = kept
            for drawn, whole in zip(self._drawn, self._whole, strict=True):
                drawn[first : first + kept] = whole[first : first + count][shown]
        return list(self._geoms)

    def _vertices(self, mesh: int) -> NDArray[np.float32]:
        start = int(self._model.mesh_vertadr[mesh])
        return np.asarray(self._model.mesh_vert[start : start + self._model.mesh_vertnum[mesh]])

    def _planes_of(self, mesh: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """The planes of a mesh's triangles: outward normals (n, 3), and how far along them."""
        first = int(self._model.mesh_faceadr[mesh])
        faces = self._whole[0][first : first + int(self._count[mesh])]
        corner, second, third = (self._vertices(mesh)[faces[:, k]] for k in range(3))
        normal = np.cross(second - corner, third - corner)
        return normal, (normal * corner).sum(axis=1)


def _most(vectors: NDArray[np.float32], bounds: _Bounds) -> NDArray[np.float32]:  # (n,)
    """The most that each vector (n, 3) times one within the bounds can be."""
    low, high = bounds
    return np.asarray(
        vectors @ ((low + high) / 2) + np.abs(vectors) @ ((high - low) / 2), np.float32
    )
