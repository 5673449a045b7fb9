"""`pliant teach`: goals by keyboard, in the terminal."""

from collections.abc import Callable
from pathlib import Path

from rich.live import Live

from pliant import files, pictures
from pliant.cell import Observation
from pliant.cli.cells import opened, where
from pliant.conditions import Setup
from pliant.console import Console
from pliant.errors import RobotFault
from pliant.paths import located, shown
from pliant.task import Task, load_task, located_peg
from pliant.vision.scene import Scene


def teach(
    *,
    cell: str = "sim",
    peg: str = "circle",
    goals: Path = Path("goals/goals.yaml"),
    picture: Path | None = None,
) -> int:
    """Teach the goals of the five contact formations with keys: they move the arm in small steps,
    and Enter records pose and picture. That is kept at once: the same command goes on with it.

    Args:
        cell: sim, or the path of a cell's file.
        peg: the peg in the gripper: circle, square, rectangle, or the path of a peg file (.yaml).
        goals: the file to write, for `pliant run --goals`; in a folder of its own.
        picture: keep the latest picture, with its measurement, in this file (.png).
    """
    from pliant.commissioning.attending import AtTerminal
    from pliant.commissioning.teach import CONTACT_SPEED, Place, Teacher
    from pliant.commissioning.teach import teach as go_on
    from pliant.commissioning.terminal import check_terminal, single_keys

    task, chosen = load_task(peg), where(cell)
    goals, picture = located(goals), None if picture is None else located(picture)
    place = Place(out=goals, cell=chosen.file, peg=located_peg(peg))
    place.check()
    check_terminal()
    given = chosen.configuration
    speed = CONTACT_SPEED if given is None else given.limits.contact_speed_mm_s * 1e-3
    console = Console(highlight=False, soft_wrap=True)
    named = cell if chosen.file is None else chosen.file.name
    title = f"pliant teach: {task.peg.name} peg, cell {named}, for {shown(goals)}"
    status = 1
    try:
        with opened(chosen, AtTerminal(console)) as workcell:
            console.print("preparing the cell ...")
            with workcell.prepare(task, Setup(seed=0)) as robot, single_keys() as keys:
                teacher = Teacher(
                    robot,
                    task,
                    place,
                    limits=chosen.limits,
                    speed_m_s=speed,
                    colours=chosen.colours,
                )
                with Live(console=console, screen=True, auto_refresh=False) as live:
                    is_written = go_on(teacher, keys, _shower(live, title, task, picture))
        if is_written:
            console.print(f"goals: {shown(goals)}")
            return 0
    except RobotFault as fault:
        console.print(f"{fault.end_reason}: {fault}")
        status = 130 if fault.kind == "interrupted" else 1
    except KeyboardInterrupt:
        status = 130
    count = len({record.formation for record in place.draft.load()})
    console.print(f"halted; {count} of 5 formations are taught, and the same command goes on")
    return status


def _shower(live: Live, title: str, task: Task, picture: Path | None) -> Callable[..., None]:
    from pliant.commissioning import screen
    from pliant.commissioning.session import Session
    from pliant.report import overlay

    def show(session: Session, observation: Observation, scene: Scene) -> None:
        size = live.console.size
        live.update(
            screen.render(session, observation, scene, title=title, size=(size.width, size.height)),
            refresh=True,
        )
        if picture is not None:
            drawn = overlay.draw(observation.views["side"], scene, task)
            files.write_bytes(picture, pictures.encoded(drawn))

    return show
