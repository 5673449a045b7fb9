"""Teach the goals that ship: the circular peg in the nominal cell (Sec. VI-A, "Default condition").

The paper drove its robot by keyboard. Here the same is done by rule, so that it can be repeated:

    python reproduce/teach_goals.py src/pliant/goals/goals.yaml [FIT_Y_MM]

Approach and Align are placed by the nominal hole; the height of Contact is felt, in free hang, by
going down until the wrist gives. Fit's over-travel decides the baseline's success under friction
(see docs/assumptions.md): -35.2 mm reproduces the paper's.
"""

import math
import sys
from collections.abc import Sequence
from pathlib import Path

from pliant.belief import Belief
from pliant.cell import Robot
from pliant.conditions import Setup
from pliant.envelope import Guarded, Limits
from pliant.formations import Formation, Goals
from pliant.methods.planar.skills import PlanarSkills
from pliant.pose import Axis, Pose
from pliant.records import Look
from pliant.sim.cell import SimCell
from pliant.task import load_task
from pliant.teaching import Demonstration, save, taught
from pliant.vision.scene import Scene

TOUCH_DOWN_Y = 0.026  # the leaning peg's edge then stands clear of the hole
LEAN = math.radians(10)  # of the flange; the peg hangs at about half of it
APPROACH_HEIGHT = 0.020
PRELOAD = 0.006
INSERTION_TRAVEL = 0.020
SPEED, LIMIT = 0.05, 0.02


def touch_height(robot: Robot) -> float:
    """The hinge's height at which the leaning peg touches the board [m]."""
    pose = Pose(y=TOUCH_DOWN_Y, z=0.22, roll=LEAN)
    robot.move_to(pose, speed_m_s=SPEED, stop_at_compression_m=LIMIT)
    robot.settle(4.0)
    while robot.observe(cameras=()).compression_m < 0.0003:
        pose = pose.updated({Axis.Z: pose.z - 0.0002})
        robot.move_to(pose, speed_m_s=SPEED, stop_at_compression_m=LIMIT)
        robot.settle(0.1)
    return pose.z


def main(path: Path, fit_y: float) -> None:
    cell, task, nominal = SimCell(), load_task("circle"), Setup(seed=0)
    touch = round(touch_height(Guarded(cell.prepare(task, nominal), Limits())), 4)
    contact = touch - PRELOAD
    goals = Goals(
        formations={
            Formation.APPROACH: {
                Axis.Y: TOUCH_DOWN_Y,
                Axis.Z: touch + APPROACH_HEIGHT,
                Axis.ROLL: LEAN,
            },
            Formation.CONTACT: {Axis.Z: contact},
            Formation.FIT: {Axis.Y: fit_y},
            Formation.ALIGN: {Axis.Y: 0.0},
            Formation.INSERTION: {Axis.Z: contact - INSERTION_TRAVEL},
        }
    )
    robot = Guarded(cell.prepare(task, nominal), Limits())
    skill, demonstrations = PlanarSkills(taught=goals), {}

    def look(cameras: Sequence[str] = ("side",)) -> Look:
        return Look(observation=robot.observe(cameras), scene=Scene(peg=None, hole=None))

    for formation in Formation:
        outcome = skill(
            robot,
            look,
            goals.target(formation),
            goals.step(formation),
            Belief(),
        )
        demonstrations[formation] = Demonstration(
            formation=formation,
            pose=outcome.pose,
            peg=task.peg.name,
            view=outcome.looks[-1].observation.views["side"],
        )
    truth = cell.truth()
    if not truth.inserted:
        raise SystemExit(f"not taught: the peg ended {truth.depth_m * 1e3:.1f} mm deep")
    save(path, taught(goals, demonstrations))
    print(f"taught {path}: touch at {touch * 1e3:.1f} mm, inserted {truth.depth_m * 1e3:.1f} mm")


if __name__ == "__main__":
    main(Path(sys.argv[1]), float(sys.argv[2]) / 1e3 if len(sys.argv) > 2 else -0.0352)
