"""Whole trials in the UR5e cell, and what it asks of the person at a real one."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

import pytest
from ur5e_emulated import cell_at

from pliant.cell import Truth
from pliant.conditions import Setup, condition
from pliant.emulator.client import Admin, started
from pliant.errors import InputError, RobotFault
from pliant.experiment.one import Spec, perform
from pliant.pose import Pose
from pliant.records import Trial
from pliant.sim.cell import SimCell
from pliant.task import Task, load_task
from pliant.teaching import shipped
from pliant.ur5e.cell import UrCell, open_cell
from pliant.ur5e.configuration import Configuration, load, save
from pliant.ur5e.driver import Driver

HAS_EXTRA = find_spec("rtde_control") is not None
needs_extra = pytest.mark.skipif(not HAS_EXTRA, reason="needs the extra 'ur5e'")
EXAMPLE = Path(str(files("pliant") / "ur5e" / "example.yaml"))
HOST = "127.0.0.84"
SAID = Truth(
    inserted=None, depth_m=0.0, tip=(0.0, 0.0, 0.0), tilt_rad=0.0, hole_y=0.0, compression_m=0.0
)


@dataclass(kw_only=True)
class Person:
    """At the cell. What is in the gripper stays there."""

    agrees: bool = True
    asked: list[str] = field(default_factory=list)

    def place(self, task: Task, setup: Setup) -> None:
        self.asked.append("place")

    def may_move(self, what: str) -> bool:
        self.asked.append(what.split()[0])
        return self.agrees and not what.startswith("open")

    def truth(self) -> Truth:
        self.asked.append("truth")
        return SAID


@pytest.fixture(scope="module")
def emulator() -> Iterator[Admin]:
    with started("--host", HOST, "--mode", "lockstep", "--client-patience", "60") as admin:
        yield admin


def history(trial: Trial) -> list[tuple[str, bool]]:
    return [(str(e.formation), e.verdict.success) for e in trial.executions]


@pytest.mark.system
@needs_extra
def test_trials_go_as_in_pure_simulation_and_insert(emulator: Admin, tmp_path: Path) -> None:
    save(tmp_path / "cell.yaml", cell_at(HOST))
    simulated = SimCell()
    with open_cell(tmp_path / "cell.yaml") as cell:
        for peg, seed in (("circle", 1), ("square", 4)):
            spec = Spec(
                task=load_task(peg), condition=condition("all"), seed=seed, reasoner="rules"
            )
            ours, theirs = (perform(spec, one, shipped()) for one in (cell, simulated))
            assert ours.fault == ""
            assert ours.inserted
            assert history(ours) == history(theirs)
            assert ours.aborted is None


@pytest.mark.system
@needs_extra
def test_at_a_real_cell_a_person_sets_the_scene_agrees_to_the_motion_and_labels(
    emulator: Admin,
) -> None:
    """Not in lockstep, and without the experiment's access to the emulator."""
    emulator.ask("pace", mode="fast", speed=3.0)
    emulator.ask("restore")
    emulator.set_up(Setup(seed=0), "circle")
    person = Person()
    slow = cell_at(HOST, stamp_ms=20e3, driver_ms=30e3)  # on a loaded machine so are we
    real = slow.model_copy(update={"emulator": None})
    with UrCell(real, person) as cell:
        home = Pose(z=load_task("circle").tip_below_hinge + 0.06)
        for seed in (0, 1):
            robot = cell.prepare(load_task("circle"), Setup(seed=seed))
            at = robot.observe(cameras=()).pose
            assert at.position() == pytest.approx(home.position(), abs=1e-3)
            with robot:  # which leaves it aside, and lower
                robot.move_to(
                    Pose(y=0.03, z=home.z - 0.02), speed_m_s=0.05, stop_at_compression_m=0.02
                )
        assert person.asked == ["lift", "open", "place", "close"] * 2
        assert cell.truth() is SAID
        person.agrees = False
        with pytest.raises(RobotFault) as caught:
            cell.prepare(load_task("circle"), Setup(seed=2))
        assert caught.value.kind == "interrupted"
    emulator.ask("pace", mode="lockstep")


@pytest.mark.system
@needs_extra
def test_an_emulated_cell_has_the_shipped_pegs_only(emulator: Admin, tmp_path: Path) -> None:
    peg = tmp_path / "thick.yaml"
    peg.write_text("shape: circle\ndiameter_mm: 40\n", encoding="utf-8")
    with (
        UrCell(cell_at(HOST)) as cell,
        pytest.raises(InputError, match=r"shipped pegs only .* not 'thick'"),
    ):
        cell.prepare(load_task(str(peg)), Setup(seed=0))


@pytest.mark.system
@needs_extra
def test_a_controller_that_nobody_answers_for_is_a_connection_fault() -> None:
    nobody = load(EXAMPLE)
    arm = nobody.arm.model_copy(update={"address": "127.0.0.85"})
    cell = UrCell(nobody.model_copy(update={"arm": arm}), Person())
    with pytest.raises(RobotFault, match=r"the controller at 127\.0\.0\.85 cannot be") as caught:
        cell.prepare(load_task("circle"), Setup(seed=0))
    assert caught.value.kind == "connection"
    cell.close()


def test_a_real_cell_needs_somebody() -> None:
    with pytest.raises(InputError, match="a real cell needs an operator"):
        open_cell(EXAMPLE)


def test_an_emulated_cell_needs_its_emulator(tmp_path: Path) -> None:
    data = load(EXAMPLE).model_dump(mode="json") | {"emulator": {"admin_port": 1}}
    data["arm"]["address"] = "127.0.0.1"
    save(tmp_path / "cell.yaml", Configuration.model_validate(data))
    with pytest.raises(InputError, match=r"start one with 'python -m pliant\.emulator'"):
        open_cell(tmp_path / "cell.yaml")


@pytest.mark.skipif(HAS_EXTRA, reason="the extra 'ur5e' is installed")
def test_without_the_extra_it_is_named() -> None:
    driver = Driver(load(EXAMPLE))
    with pytest.raises(InputError, match=r"the extra 'ur5e'.*'\.\[ur5e\]'") as caught:
        driver.connect()
    assert "\n" not in str(caught.value)
    driver.close()
