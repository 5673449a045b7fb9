"""The simulated cell. Importing it chooses MuJoCo's OpenGL back end, whether or not MuJoCo has been
imported; MUJOCO_GL, where it is set, is left as it is."""

from pliant.sim.gl import choose_backend

choose_backend()
