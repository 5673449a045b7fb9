"""The looks of the scene in a trial: nominal, or colours, textures, light, background, image noise
and cameras at random, and a post that hides part of it.

All of it belongs to the picture only: the physics and a camera's calibration know nothing of it.
What the trial's seed gives is the same for every peg and in every drawing.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from statistics import NormalDist

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from pliant.conditions import Setup
from pliant.pose import rotation_matrix
from pliant.sim import constants as c
from pliant.task import BLOCK_SIZE

Vector = NDArray[np.float64]  # (3,)

_PATTERNS = ("clouds", "grain", "stripes", "checks", "speckles")
_TEXTURE_SIZE = 128  # [px]
_DARKEST = 0.6  # of a texture, which darkens the colour below it
_PAINTED = ("peg", "block", "table", "backdrop")
_TELL_APART = 0.35  # between neighbours' colours, RGB in 0..1: what no camera sees is no test
_BACKDROP_AT, _BACKDROP_HALF = 1.6, 3.0  # [m] behind the scene, from the camera
_POST_AT = 0.3  # [m] from the hole's axis toward the camera
_QUANTILES = 1 << 16  # of noise


@dataclass(frozen=True, kw_only=True, eq=False)
class Paint:
    """A colour (3,) in 0..1, and the pattern over it; None: plain."""

    rgb: Vector
    pattern: str | None


@dataclass(frozen=True, kw_only=True, eq=False)
class Shift:
    """The shift of a camera: where it really is, seen from where it should be, on its own axes
    (right, up, back): an offset (3,) [m] and small angles (3,) [rad] about them."""

    offset: Vector
    angles: Vector


@dataclass(frozen=True, kw_only=True, eq=False)
class Post:
    """A post on the table: foot (3,) and top (3,) [m], radius [m], colour (3,)."""

    foot: Vector
    top: Vector
    radius: float
    rgb: Vector


@dataclass(frozen=True, kw_only=True, eq=False)
class Looks:
    """The looks of one trial: what differs in its pictures; nothing where a field is empty or
    None."""

    paints: Mapping[str, Paint]  # peg, block, table, backdrop
    light: Vector | None  # (3,) where it shines to
    diffuse: float
    ambient: float
    noise: float  # standard deviation of a channel, of 255
    shifts: Mapping[str, Shift]  # by camera
    posts: tuple[Post, ...]


NOMINAL = Looks(paints={}, light=None, diffuse=0.0, ambient=0.0, noise=0.0, shifts={}, posts=())


def looks_of(setup: Setup) -> Looks:
    """The looks of a trial: two draws from its seed, one for the looks and one for what hides
    them."""
    posts = _posts(setup.stream("occluder")) if setup.is_on("occluder") else ()
    if not setup.is_on("looks"):
        return replace(NOMINAL, posts=posts)
    random = setup.stream("looks")
    azimuth, elevation = random.uniform(-1.2, 1.2), math.radians(random.uniform(20, 70))
    flat = math.cos(elevation)
    return Looks(
        paints=_paints(random),
        light=-np.array([flat * math.cos(azimuth), flat * math.sin(azimuth), math.sin(elevation)]),
        diffuse=float(random.uniform(0.2, 0.6)),
        ambient=float(random.uniform(0.2, 0.5)),
        noise=float(random.uniform(2.0, 8.0)),
        shifts={name: _shift(random) for name in c.CAMERAS},
        posts=posts,
    )


def _paints(random: np.random.Generator) -> dict[str, Paint]:
    """A colour for each part that can be told from its neighbours': the block from all, the peg
    from block and backdrop."""
    while True:
        rgb = random.uniform(0.1, 1.0, (len(_PAINTED), 3))
        peg, block, table, backdrop = rgb
        pairs = ((peg, block), (peg, backdrop), (block, table), (block, backdrop))
        if all(np.linalg.norm(a - b) >= _TELL_APART for a, b in pairs):
            break
    patterns = (None, *_PATTERNS)
    return {
        part: Paint(rgb=colour, pattern=patterns[random.integers(len(patterns))])
        for part, colour in zip(_PAINTED, rgb, strict=True)
    }


def _shift(random: np.random.Generator) -> Shift:
    most = np.array([0.002, 0.002, 0.005])
    return Shift(
        offset=random.uniform(-most, most),
        angles=random.uniform(-math.radians(0.3), math.radians(0.3), 3),
    )


def _posts(random: np.random.Generator) -> tuple[Post, ...]:
    """Two posts: one before the side and one before the front camera. They lean, so that neither
    ever hides the whole of an upright edge, and end below the gripper."""
    return tuple(_post(random, toward) for toward in (np.eye(3)[0], np.eye(3)[1]))


def _post(random: np.random.Generator, toward: Vector) -> Post:
    """A post toward a camera that stands before the block, wherever a trial puts that."""
    across = np.array([-toward[1], toward[0], 0.0])
    lean = math.radians(random.uniform(8, 25)) * random.choice([-1.0, 1.0])
    along = np.array([0.0, 0.0, 1.0]) + math.tan(lean) * across
    middle = _POST_AT * toward + random.uniform(-0.05, 0.05) * across + [0.0, 0.0, -0.03]
    return Post(
        foot=middle - (BLOCK_SIZE[2] - 0.03) * along,
        top=middle + random.uniform(0.0, 0.11) * along,
        radius=random.uniform(0.003, 0.006),
        rgb=random.uniform(0.1, 1.0, 3),
    )


# --- into a picture ------------------------------------------------------------------------------


def dress(looks: Looks, scene: mujoco.MjvScene, model: mujoco.MjModel, camera: str) -> None:
    """Put the looks into a scene that has been updated for `camera`."""
    _paint(looks, scene, model)
    if looks.light is not None:
        for light in (scene.lights[n] for n in range(scene.nlight)):
            if light.headlight:
                light.ambient[:] = looks.ambient
            else:
                light.dir[:] = looks.light
                light.diffuse[:] = looks.diffuse
    for post in looks.posts:
        geom = _more(scene, post.rgb)
        mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_CAPSULE, post.radius, post.foot, post.top)
    if camera in looks.shifts:
        _move(scene, looks.shifts[camera])


def noisy(looks: Looks, image: NDArray[np.uint8], random: np.random.Generator) -> NDArray[np.uint8]:
    """A picture with the looks' noise."""
    if not looks.noise:
        return image
    steps = np.rint(looks.noise * _normal()).astype(np.int16)
    drawn = random.integers(len(steps), size=image.shape, dtype=np.uint16)
    return np.asarray(cv2.add(image, steps[drawn], dtype=cv2.CV_8U), np.uint8)


@cache
def _normal() -> NDArray[np.float64]:  # (65536,)
    """A standard normal variable's quantiles: to draw of them is four times as fast."""
    quantile = NormalDist().inv_cdf
    return np.array([quantile((k + 0.5) / _QUANTILES) for k in range(_QUANTILES)])


def _paint(looks: Looks, scene: mujoco.MjvScene, model: mujoco.MjModel) -> None:
    if not looks.paints:
        return
    parts = {int(model.geom("table").id): "table"}
    for body, painted in (("peg", "peg"), ("board", "block")):
        of_body = model.geom_bodyid == model.body(body).id
        parts |= dict.fromkeys(np.flatnonzero(of_body).tolist(), painted)
    for geom in (scene.geoms[n] for n in range(scene.ngeom)):
        part = parts.get(geom.objid) if geom.objtype == mujoco.mjtObj.mjOBJ_GEOM else None
        if part is not None:
            _coat(geom, looks.paints[part], model, flat=part == "table")
    eye = np.array(scene.camera[0].pos)
    ahead = np.array(scene.camera[0].forward)
    ahead[2] = 0.0
    ahead /= np.linalg.norm(ahead)
    backdrop = _more(scene, looks.paints["backdrop"].rgb)
    turned = np.column_stack([ahead, np.cross([0.0, 0.0, 1.0], ahead), [0.0, 0.0, 1.0]])
    mujoco.mjv_initGeom(
        backdrop,
        mujoco.mjtGeom.mjGEOM_BOX,
        np.array([0.01, _BACKDROP_HALF, _BACKDROP_HALF]),
        eye + (c.SIDE_CAMERA_DISTANCE + _BACKDROP_AT) * ahead,
        turned.ravel(),
        backdrop.rgba,
    )
    _coat(backdrop, looks.paints["backdrop"], model)


def _coat(geom: mujoco.MjvGeom, paint: Paint, model: mujoco.MjModel, *, flat: bool = False) -> None:
    geom.rgba[:3] = paint.rgb
    if paint.pattern is not None:
        geom.matid = model.material(_material(paint.pattern, flat=flat)).id


def _more(scene: mujoco.MjvScene, rgb: Vector) -> mujoco.MjvGeom:
    """Add one more geom to the scene, in a colour; its kind and place are the caller's to set."""
    geom = scene.geoms[scene.ngeom]
    rgba = np.array([*rgb, 1.0], np.float32)
    nowhere = np.zeros(3)
    mujoco.mjv_initGeom(
        geom, mujoco.mjtGeom.mjGEOM_CAPSULE, nowhere, nowhere, np.eye(3).ravel(), rgba
    )
    scene.ngeom += 1
    return geom


def _move(scene: mujoco.MjvScene, shift: Shift) -> None:
    for camera in (scene.camera[0], scene.camera[1]):  # one for each eye
        ahead, up = np.array(camera.forward, float), np.array(camera.up, float)
        axes = np.column_stack([np.cross(ahead, up), up, -ahead])
        turned = axes @ rotation_matrix(*shift.angles.tolist())
        camera.pos[:] += axes @ shift.offset
        camera.forward[:], camera.up[:] = -turned[:, 2], turned[:, 1]


# --- textures: compiled into every model, used by these looks only -------------------------------


def add_textures(spec: mujoco.MjSpec) -> None:
    """Add a material for each pattern: one for solids, one for the flat table."""
    for pattern in _PATTERNS:
        picture = np.repeat(_picture(pattern)[:, :, None], 3, axis=2)
        for flat in (False, True):
            name = _material(pattern, flat=flat)
            kind = mujoco.mjtTexture.mjTEXTURE_2D if flat else mujoco.mjtTexture.mjTEXTURE_CUBE
            faces = picture if flat else np.tile(picture, (6, 1, 1))
            texture = spec.add_texture(name=name, type=kind, nchannel=3)
            texture.width, texture.height = _TEXTURE_SIZE, len(faces)
            texture.data = faces.tobytes()
            material = spec.add_material(name=name, texrepeat=[6, 6] if flat else [1, 1])
            material.textures[int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] = name


def _material(pattern: str, *, flat: bool) -> str:
    return f"{pattern}_flat" if flat else pattern


@cache
def _picture(pattern: str) -> NDArray[np.uint8]:  # (size, size)
    n = _TEXTURE_SIZE
    random = np.random.default_rng(_PATTERNS.index(pattern))
    rows, columns = np.mgrid[:n, :n]
    match pattern:
        case "clouds":
            height = _smooth(random, 4) + 0.5 * _smooth(random, 12)
        case "grain":
            height = _smooth(random, 16) + _smooth(random, 48)
        case "stripes":
            height = np.sin((rows + 0.6 * columns) * math.tau / 16)
        case "checks":
            height = ((rows // 16 + columns // 16) % 2).astype(float)
        case _:
            height = (_smooth(random, 32) > 0.4).astype(float)
    height = (height - height.min()) / np.ptp(height)
    return np.round(255 * (_DARKEST + (1 - _DARKEST) * height)).astype(np.uint8)


def _smooth(random: np.random.Generator, cells: int) -> NDArray[np.float64]:
    coarse = random.uniform(-1, 1, (cells, cells))
    size = (_TEXTURE_SIZE, _TEXTURE_SIZE)
    return np.asarray(cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC), np.float64)
