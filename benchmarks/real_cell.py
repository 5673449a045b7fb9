"""The UR5e cell's own code, through the unmodified ur_rtde and the emulated controller.

    python benchmarks/real_cell.py trials --trials 60     # histories beside pure simulation's
    python benchmarks/real_cell.py presses --presses 20   # how far past the limit contact goes
    python benchmarks/real_cell.py faults                 # how soon each is seen, in real time

The first two are in lockstep and take --force-noise, in newtons. Trials have the same loop, rules
and seeds on both sides; a false stop is a motion that ended by compression on the UR5e cell in a
trial in which none did in simulation.
"""

import argparse
import threading
import time

import numpy as np
from numpy.typing import NDArray

from pliant.cell import Stop, Workcell
from pliant.conditions import Setup, condition
from pliant.emulator.client import Admin, started
from pliant.errors import RobotFault
from pliant.experiment.one import Spec, perform
from pliant.pose import Pose
from pliant.records import Trial
from pliant.sim.cell import SimCell
from pliant.task import load_task
from pliant.teaching import shipped
from pliant.ur5e.cell import UrCell
from pliant.ur5e.emulated import configuration_of

_HOST = "127.0.0.190"
_SPEED = 0.020  # [m/s], of contact
_LIMIT = 0.012  # [m]
_FAULTS: dict[str, dict[str, float]] = {
    "protective_stop": {},
    "emergency_stop": {},
    "power_off": {},
    "stall": {"seconds": 2.0},
    "drop_rtde": {},
    "gripper_lost": {},
}
_STAMP_MS = 100.0  # of patience with a stalled controller, as shipped; a loaded machine needs more


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("what", choices=["trials", "presses", "faults"])
    parser.add_argument("--trials", type=int, default=10)
    parser.add_argument("--presses", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--peg", default="circle")
    parser.add_argument("--condition", default="all")
    parser.add_argument("--force-noise", type=float, default=0.0)
    parser.add_argument("--ticks-per-look", type=int, default=5)
    options = parser.parse_args()
    if options.what == "faults":
        with started("--host", _HOST) as admin:
            for kind in _FAULTS:
                _suffer(admin, kind)
        return
    arguments = ("--host", _HOST, "--mode", "lockstep", "--force-noise", str(options.force_noise))
    with started(*arguments):
        configuration = configuration_of(_HOST)
        assert configuration.emulator is not None
        ticks = {"ticks_per_look": options.ticks_per_look}
        emulator = configuration.emulator.model_copy(update=ticks)
        with UrCell(configuration.model_copy(update={"emulator": emulator})) as cell:
            if options.what == "trials":
                _compare(cell, options)
            else:
                _press(cell, options.presses)


def _compare(cell: UrCell, options: argparse.Namespace) -> None:
    simulated = SimCell()
    inserted = same = stops = 0
    for seed in range(options.first_seed, options.first_seed + options.trials):
        spec = Spec(
            task=load_task(options.peg),
            condition=condition(options.condition),
            seed=seed,
            reasoner="rules",
        )
        began = time.perf_counter()
        theirs, ours = _performed(spec, cell), _performed(spec, simulated)
        inserted += theirs.inserted is True
        same += _history(theirs) == _history(ours)
        stops += not _stops(ours) and _stops(theirs)
        print(
            f"{seed:4d}  {_history(theirs):<24} {theirs.end_reason:<12}"
            f"  simulated {_history(ours):<24} {ours.end_reason:<12}"
            f"  {time.perf_counter() - began:5.1f} s  {theirs.fault}",
            flush=True,
        )
    print(
        f"{options.peg}, {options.condition}, {options.force_noise:g} N of noise:"
        f" {inserted}/{options.trials} inserted, {same} histories as in simulation,"
        f" {stops} with a false stop"
    )


def _performed(spec: Spec, cell: Workcell) -> Trial:
    return perform(spec, cell, shipped())


def _history(trial: Trial) -> str:
    """Formations by their number, each with its verdict: "0+ 1+ 2- 2+"."""
    return " ".join(f"{e.formation.order}{'-+'[e.verdict.success]}" for e in trial.executions)


def _stops(trial: Trial) -> bool:
    return any(e.outcome.stop is Stop.COMPRESSION for e in trial.executions)


def _press(cell: UrCell, presses: int) -> None:
    task = load_task("circle")
    past = []
    for seed in range(presses):
        robot = cell.prepare(task, Setup(seed=seed))
        above = Pose(y=0.03, z=task.tip_below_hinge + 0.012)
        robot.move_to(above, speed_m_s=_SPEED, stop_at_compression_m=_LIMIT)
        robot.settle(1.0)
        down = Pose(y=0.03, z=task.tip_below_hinge - 0.030)
        motion = robot.move_to(down, speed_m_s=_SPEED, stop_at_compression_m=_LIMIT)
        if motion.stop is not Stop.COMPRESSION:
            raise RobotFault("not_stopped", "the press went through to its goal")
        past.append(cell.truth().compression_m - _LIMIT)
    mm = np.array(past) * 1e3
    print(
        f"{presses} presses to {_LIMIT * 1e3:g} mm at {_SPEED * 1e3:g} mm/s: {mm.mean():+.2f} mm"
        f" past the limit on average, {mm.min():+.2f} to {mm.max():+.2f} mm"
    )


def _suffer(admin: Admin, kind: str) -> None:
    """Let a fault happen during a motion."""
    admin.ask("restore")
    configuration = configuration_of(_HOST)
    patience = configuration.patience.model_copy(update={"stamp_ms": _STAMP_MS})
    happened: list[float] = []

    def happen() -> None:
        time.sleep(0.7)
        admin.fault(kind, **_FAULTS[kind])
        happened.append(time.monotonic())

    with UrCell(configuration.model_copy(update={"patience": patience})) as cell:
        robot = cell.prepare(load_task("circle"), Setup(seed=0))
        thread = threading.Thread(target=happen)
        thread.start()
        try:
            robot.move_to(Pose(y=0.05, z=0.24), speed_m_s=_SPEED, stop_at_compression_m=_LIMIT)
            said = "it was not seen"
        except RobotFault as fault:
            said = f"fault:{fault.kind}: {fault}"
        seen = time.monotonic()
        thread.join()
    time.sleep(0.1 + _FAULTS[kind].get("seconds", 0.0))
    at = _position(admin)
    time.sleep(0.5)
    crept = float(np.linalg.norm(_position(admin) - at)) * 1e3
    print(f"{kind:<16} after {seen - happened[0]:5.3f} s  {said}; then {crept:.2f} mm", flush=True)


def _position(admin: Admin) -> NDArray[np.float64]:
    return np.array(admin.ask("state")["tool_pose"][:3])


if __name__ == "__main__":
    main()
