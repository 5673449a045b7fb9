"""Chooses MuJoCo's OpenGL back end, also where MuJoCo has been imported before."""

import ctypes
import importlib
import os
import sys
from ctypes.util import find_library

from pliant.errors import InputError, described

INSTALL = "apt-get install libosmesa6"

_LIBRARIES = {"egl": "EGL", "osmesa": "OSMesa"}
_ON = ("glfw", "glx", "enable", "enabled", "on", "true", "1")  # need a screen
_OFF = ("disable", "disabled", "off", "false", "0")
_CONTEXT = "mujoco.rendering.classic.gl_context"
_PLATFORM_DEVICE = 0x313F  # EGL_PLATFORM_DEVICE_EXT: without a screen


def choose_backend() -> None:
    """Set MUJOCO_GL where the user has not: EGL if it works, else software OSMesa. One that turns
    drawing off stays, for what needs no pictures; `must_draw` refuses it where they are drawn.

    Raises:
        InputError: MuJoCo was told to use a back end that does not exist, is not installed or draws
            nothing, or there is none.
    """
    if sys.platform != "linux":
        return
    wanted = os.environ.get("MUJOCO_GL", "").lower().strip()
    if wanted in _OFF:
        return
    if wanted:
        _check(wanted)
    else:
        os.environ["MUJOCO_GL"] = _best()
    _use(os.environ["MUJOCO_GL"].lower().strip())


def must_draw() -> None:
    """Check that MUJOCO_GL does not turn drawing off.

    Raises:
        InputError: MUJOCO_GL turns drawing off.
    """
    wanted = os.environ.get("MUJOCO_GL", "").lower().strip()
    if wanted in _OFF:
        raise InputError(
            f"MUJOCO_GL is '{wanted}', which turns drawing off, and the method needs pictures:"
            " unset it"
        )


def let_go() -> None:
    """Leave no EGL context current in this thread, so that any thread may draw with it next, or end
    it: a cell that nobody holds is collected in whatever thread happens to run."""
    egl = sys.modules.get("mujoco.egl")
    if egl is not None and egl.EGL_DISPLAY is not None:
        api = egl.EGL
        none = api.EGL_NO_SURFACE
        api.eglMakeCurrent(egl.EGL_DISPLAY, none, none, api.EGL_NO_CONTEXT)


def _check(wanted: str) -> None:
    if wanted not in _LIBRARIES and wanted not in _ON:
        raise InputError(
            f"MUJOCO_GL is '{wanted}': valid are egl (graphics card), osmesa (software) and glfw (a"
            " screen); unset it to let pliant choose"
        )
    if wanted in _ON and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise InputError(
            f"MUJOCO_GL is '{wanted}', which needs a screen, and DISPLAY is not set: unset it to"
            " let pliant choose"
        )
    if wanted in _LIBRARIES and find_library(_LIBRARIES[wanted]) is None:
        raise InputError(
            f"MUJOCO_GL is '{wanted}', whose library is not installed: {INSTALL}, or unset it to"
            " let pliant choose"
        )


def _best() -> str:
    installed = [name for name, library in _LIBRARIES.items() if find_library(library) is not None]
    if not installed:
        raise InputError(
            f"no OpenGL to draw pictures with: run '{INSTALL}' as root, then try again"
        )
    # Starting EGL takes a moment, so it is tried only where there is a choice.
    if len(installed) > 1 and not _egl_starts():
        installed.remove("egl")
    return installed[0]


def _use(wanted: str) -> None:
    """Turn MuJoCo to a back end. It looks at MUJOCO_GL as it is imported, once: whoever was first
    has it look again."""
    context = sys.modules.get(_CONTEXT)
    if context is None or getattr(context, "_MUJOCO_GL", wanted) == wanted:
        return
    try:
        importlib.reload(context)
    except Exception as error:  # the back ends raise what they like
        raise InputError(
            f"MuJoCo was imported before pliant, and cannot turn to {wanted} any more"
            f" ({described(error)}): import pliant first, or set MUJOCO_GL={wanted} before"
        ) from error


def _egl_starts() -> bool:
    """Whether EGL has a device to draw on without a screen, tried as MuJoCo does."""
    if find_library("OpenGL") is None:  # PyOpenGL calls it beside EGL
        return False
    try:
        egl = ctypes.CDLL(find_library("EGL"))
        egl.eglGetProcAddress.restype = ctypes.c_void_p
        pointer, integer = ctypes.c_void_p, ctypes.c_int
        query = egl.eglGetProcAddress(b"eglQueryDevicesEXT")
        get_display = egl.eglGetProcAddress(b"eglGetPlatformDisplayEXT")
    except (OSError, AttributeError):
        return False
    if not query or not get_display:
        return False
    devices, count = (pointer * 16)(), integer(0)
    ctypes.CFUNCTYPE(integer, integer, pointer, pointer)(query)(
        len(devices), ctypes.addressof(devices), ctypes.addressof(count)
    )
    egl.eglInitialize.argtypes = [pointer, pointer, pointer]
    for device in devices[: count.value]:
        display = ctypes.CFUNCTYPE(pointer, integer, pointer, pointer)(get_display)(
            _PLATFORM_DEVICE, device, None
        )
        if display and egl.eglInitialize(display, None, None):
            return True
    return False
