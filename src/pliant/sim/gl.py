"""Chooses MuJoCo's OpenGL back end before MuJoCo is first imported."""

import ctypes.util
import os
import sys

from pliant.errors import InputError

INSTALL = "apt-get install libosmesa6"


def choose_backend() -> None:
    """Set MUJOCO_GL where the user has not: EGL if the machine has it, else software OSMesa.

    Raises:
        InputError: MuJoCo was told to use a back end that is not installed, or there is none.
    """
    if sys.platform != "linux":
        return
    libraries = {"egl": "EGL", "osmesa": "OSMesa"}
    wanted = os.environ.get("MUJOCO_GL", "").lower()
    if wanted:
        if wanted in libraries and ctypes.util.find_library(libraries[wanted]) is None:
            raise InputError(f"MUJOCO_GL is '{wanted}', whose library is not installed: {INSTALL}")
        return
    for backend in ("egl", "osmesa"):
        if ctypes.util.find_library(libraries[backend]) is not None:
            os.environ["MUJOCO_GL"] = backend
            return
    raise InputError(f"no OpenGL to draw pictures with: run '{INSTALL}' as root, then try again")
