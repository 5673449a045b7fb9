"""`pliant check-cell`: what is found in a cell, and what to do about it."""

import json
import math
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from stand_ins import prepared

from pliant.cell import Observation, Robot, Truth, Workcell
from pliant.commissioning.preflight import CheckState, Finding, check
from pliant.conditions import Setup
from pliant.envelope import Guarded, Limits
from pliant.errors import InputError, RobotFault
from pliant.experiment.where import Where
from pliant.pose import Pose
from pliant.task import Task, load_task
from pliant.teaching import save, shipped
from pliant.ur5e.cell import Operator
from pliant.vision.measure import Colours

PLIANT = Path(sys.executable).parent / "pliant"
TASK = load_task("circle")


@dataclass(frozen=True, kw_only=True)
class Like(Where):
    """The simulated cell, with something about it changed."""

    setup: Setup = Setup(seed=0)  # noqa: RUF009
    fault: str = ""
    camera_moved_m: float = 0.0
    colours_seen: Colours = Colours()  # noqa: RUF009
    goals_file: Path | None = None
    lowest_m: float | None = None  # that a controller permits; None: there is none

    @property
    def colours(self) -> Colours:
        return self.colours_seen

    @property
    def goals(self) -> Path | None:
        return self.goals_file

    def open(self, operator: Operator | None = None) -> Workcell:
        return _Cell(self)


class _Shifted(Guarded):
    """A robot whose camera is not where its calibration says."""

    camera_moved_m = 0.0

    def observe(self, cameras: Sequence[str] = ("side",)) -> Observation:
        seen = super().observe(cameras)
        views = {}
        for name, view in seen.views.items():
            position = view.camera.position + np.array([0.0, 0.0, self.camera_moved_m])
            views[name] = replace(view, camera=replace(view.camera, position=position))
        return replace(seen, views=views)


class _Limited(_Shifted):
    """One whose controller has a safety plane."""

    lowest_m = 0.0

    def permits(self, pose: Pose) -> bool:
        return pose.z >= self.lowest_m


class _Cell:
    kind = "sim"

    def __init__(self, like: Like) -> None:
        self._like = like

    def prepare(self, task: Task, setup: Setup) -> Robot:
        if self._like.fault:
            raise RobotFault(self._like.fault, "scripted")
        plain = prepared("circle", self._like.setup)
        if self._like.lowest_m is not None:
            limited = _Limited(plain, Limits())
            limited.lowest_m = self._like.lowest_m
            return limited
        robot = _Shifted(plain, Limits())
        robot.camera_moved_m = self._like.camera_moved_m
        return robot

    def truth(self) -> Truth:
        raise AssertionError("a check never asks for the truth")


def found(where: Where) -> dict[str, Finding]:
    findings = check(where, TASK)
    assert len({f.check for f in findings}) == len(findings) == 12
    assert all(f.advice for f in findings if f.state is CheckState.FAIL)
    return {f.check: f for f in findings}


def test_the_simulated_cell_is_ready_and_says_what_it_does_not_have() -> None:
    findings = found(Where())
    assert all(finding.is_good for finding in findings.values())
    passed = {name for name, f in findings.items() if f.state is CheckState.PASS}
    assert passed == {"tare drift", "picture", "calibration", "goals"}


def test_a_hole_off_its_place_and_a_crooked_grasp_are_no_failure_of_the_cell() -> None:
    setup = Setup(seed=0, hole_y=-0.02, grasp_roll=math.radians(5))
    assert found(Like(setup=setup))["calibration"].state is CheckState.PASS


def test_a_camera_that_is_not_where_its_calibration_says_is_found() -> None:
    calibration = found(Like(camera_moved_m=0.008))["calibration"]
    assert calibration.state is CheckState.FAIL
    assert "surface +8.0" in calibration.found
    assert "pliant calibrate" in calibration.advice


def test_colours_that_do_not_find_the_peg_leave_the_calibration_unchecked() -> None:
    black = Colours(peg=(((0, 0, 0), (1, 1, 1)),))
    findings = found(Like(colours_seen=black))
    assert findings["picture"].state is CheckState.FAIL
    assert "no peg" in findings["picture"].found
    assert findings["calibration"].state is CheckState.UNKNOWN
    assert findings["goals"].state is CheckState.PASS


def test_goals_outside_the_workspace_are_found(tmp_path: Path) -> None:
    path = tmp_path / "goals.yaml"
    save(path, shipped())
    document = yaml.safe_load(path.read_text(encoding="utf-8"))
    document["formations"]["fit"]["goal"]["y_mm"] = -150
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    goals = found(Like(goals_file=path))["goals"]
    assert goals.state is CheckState.FAIL
    assert "fit y -150.0 mm is outside the workspace" in goals.found


def test_goals_that_the_controllers_own_limits_exclude_are_found_one_by_one() -> None:
    limits = found(Like(lowest_m=0.18))["safety limits"]
    assert limits.state is CheckState.FAIL
    excluded = limits.found.splitlines()
    assert [line.partition(":")[0] for line in excluded] == [
        "insertion",
        "insertion after a retreat",
    ]
    assert "z 167.6 mm" in excluded[0]
    assert "teach these goals" in limits.advice
    assert found(Like(lowest_m=0.0))["safety limits"].state is CheckState.PASS


@pytest.mark.parametrize(
    ("kind", "fails", "before"),
    [
        ("connection", "connection", 0),
        ("stalled", "connection", 0),
        ("emergency_stop", "safety status", 1),
        ("power_off", "mode", 2),
        ("gripper", "gripper", 3),
        ("camera", "camera", 5),
    ],
)
def test_a_fault_fails_its_check_and_those_after_it_are_not_checked(
    kind: str, fails: str, before: int
) -> None:
    states = [f.state for f in found(Like(fault=kind)).values()]
    assert found(Like(fault=kind))[fails].state is CheckState.FAIL
    expected = [CheckState.PASS] * before + [CheckState.FAIL] + [CheckState.UNKNOWN] * (10 - before)
    assert states == [*expected, CheckState.PASS]  # the goals need no robot


def test_ctrl_c_is_not_a_finding() -> None:
    with pytest.raises(KeyboardInterrupt):
        check(Like(fault="interrupted"), TASK)


def test_a_cell_file_that_cannot_be_used_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        check(Where(file=tmp_path / "none.yaml"), TASK)


def test_the_command_says_it_as_a_table_and_as_json() -> None:
    shown = subprocess.run(
        [PLIANT, "check-cell"], capture_output=True, encoding="utf-8", check=False
    )
    assert shown.returncode == 0, shown.stderr
    assert shown.stdout.splitlines()[-1] == "ready"
    done = subprocess.run(
        [PLIANT, "check-cell", "--json"], capture_output=True, encoding="utf-8", check=False
    )
    document = json.loads(done.stdout)
    assert document["ready"] is True
    assert {c["state"] for c in document["checks"]} == {"pass", "does not apply"}
