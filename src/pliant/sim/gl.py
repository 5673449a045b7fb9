"""Chooses MuJoCo's OpenGL back end before MuJoCo is first imported."""

import ctypes
import os
import sys
from ctypes.util import find_library

from pliant.errors import InputError

INSTALL = "apt-get install libosmesa6"

_PLATFORM_DEVICE = 0x313F  # EGL_PLATFORM_DEVICE_EXT: without a screen


def choose_backend() -> None:
    """Set MUJOCO_GL where the user has not: EGL if it works, else software OSMesa.

    Raises:
        InputError: MuJoCo was told to use a back end that is not installed, or there is none.
    """
    if sys.platform != "linux":
        return
    libraries = {"egl": "EGL", "osmesa": "OSMesa"}
    wanted = os.environ.get("MUJOCO_GL", "").lower()
    if wanted:
        if wanted in libraries and find_library(libraries[wanted]) is None:
            raise InputError(f"MUJOCO_GL is '{wanted}', whose library is not installed: {INSTALL}")
        return
    installed = [name for name, library in libraries.items() if find_library(library) is not None]
    if not installed:
        raise InputError(
            f"no OpenGL to draw pictures with: run '{INSTALL}' as root, then try again"
        )
    # Starting EGL takes a moment, so it is tried only where there is a choice.
    if len(installed) > 1 and not _egl_starts():
        installed.remove("egl")
    os.environ["MUJOCO_GL"] = installed[0]


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
