"""MuJoCo's back end is chosen, or refused in one line, whoever imports MuJoCo first."""

import os
import subprocess
import sys

import pytest

from pliant.errors import InputError
from pliant.sim import gl

LINUX = pytest.mark.skipif(sys.platform != "linux", reason="elsewhere MuJoCo chooses")
FIRST = """
import mujoco
import pliant.sim
from mujoco.rendering.classic import gl_context
print(gl_context.GLContext.__module__)
"""


@LINUX
@pytest.mark.parametrize(
    ("wanted", "said"),
    [
        ("gpu", "MUJOCO_GL is 'gpu': valid are egl"),
        ("Quatsch ", "MUJOCO_GL is 'quatsch': valid are egl"),
        ("off", "turns drawing off"),
        ("glfw", "needs a screen"),
        ("osmesa", "whose library is not installed"),
        ("egl", "whose library is not installed"),
    ],
)
def test_a_back_end_that_cannot_draw_is_refused(
    wanted: str, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MUJOCO_GL", wanted)
    for screen in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(screen, raising=False)
    monkeypatch.setattr(gl, "find_library", lambda name: None)
    refuses = gl.must_draw if wanted == "off" else gl.choose_backend
    with pytest.raises(InputError, match=said) as caught:
        refuses()
    assert "unset it" in str(caught.value)


@LINUX
def test_mujoco_may_be_imported_before_pliant() -> None:
    env = {name: value for name, value in os.environ.items() if name != "MUJOCO_GL"}
    done = subprocess.run(
        [sys.executable, "-c", FIRST], capture_output=True, encoding="utf-8", env=env, check=True
    )
    assert done.stdout.strip() in ("mujoco.egl", "mujoco.osmesa")
