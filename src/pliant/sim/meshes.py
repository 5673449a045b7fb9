"""Coarser robot meshes: what is only looked at is drawn with as many triangles as a picture of a
millimetre a pixel can show. Nothing that touches anything is changed, nor any mass or inertia."""

import mujoco
import numpy as np

_GRID = 0.0025  # [m] vertices in one cell of this size become one
_LAYERS = 16  # cells through a mesh at its thinnest, at least: a plate keeps its screws
_LEAST_FACES = 500  # a mesh with fewer stays as it is
_CELLS = 1 << 20  # along each axis: more than any robot has


def coarsen(model: mujoco.MjModel) -> None:
    """Merge the vertices that lie close together in each mesh that only shows, in the compiled
    model's own arrays."""
    touches = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    is_mesh = model.geom_type == mujoco.mjtGeom.mjGEOM_MESH
    solid = set(model.geom_dataid[is_mesh & touches].tolist())
    for mesh in range(model.nmesh):
        if mesh not in solid and int(model.mesh_facenum[mesh]) >= _LEAST_FACES:
            _merge(model, mesh)


def _merge(model: mujoco.MjModel, mesh: int) -> None:
    first, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    start = int(model.mesh_vertadr[mesh])
    vertices = model.mesh_vert[start : start + int(model.mesh_vertnum[mesh])]
    grid = min(_GRID, float(np.ptp(vertices, axis=0).min()) / _LAYERS)
    cells = np.round(vertices / grid).astype(np.int64)
    x, y, z = (cells - cells.min(axis=0)).T
    _, chosen, cell_of = np.unique(
        (x * _CELLS + y) * _CELLS + z, return_index=True, return_inverse=True
    )
    faces = chosen[cell_of][model.mesh_face[first : first + count]]
    i, j, k = faces.T
    whole = (i != j) & (j != k) & (k != i)
    kept = int(np.count_nonzero(whole))
    for drawn, left in (
        (model.mesh_face, faces),
        (model.mesh_facenormal, model.mesh_facenormal[first : first + count]),
        (model.mesh_facetexcoord, model.mesh_facetexcoord[first : first + count]),
    ):
        drawn[first : first + kept] = left[whole]
    model.mesh_facenum[mesh] = kept
