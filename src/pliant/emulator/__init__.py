"""An emulated UR5e controller with its gripper and camera, and the simulated cell as its plant.

    python -m pliant.emulator --peg circle --condition all --seed 1

It speaks RTDE, the script and dashboard ports and the Robotiq gripper's socket, so that client
programs run against it unchanged. docs/emulator.md says what it speaks, and what it does not.
"""

import pliant.sim  # noqa: F401, chooses the OpenGL back end before a module imports MuJoCo
