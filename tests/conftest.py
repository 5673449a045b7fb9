"""What every test needs before it is collected."""

import os

from hypothesis import settings

import pliant.sim  # noqa: F401, chooses the OpenGL back end before a test imports MuJoCo

settings.register_profile("local", deadline=None)  # a first picture takes a second
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "local")
