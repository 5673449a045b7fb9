"""`pliant run --dry-run` and `--air`: a trial's motions on paper, and run above the board."""

from rich.table import Table
from rich.text import Text

from pliant.cli.cells import opened
from pliant.commissioning import rehearsal
from pliant.commissioning.attending import AtTerminal
from pliant.conditions import Setup
from pliant.console import Console
from pliant.errors import RobotFault
from pliant.experiment.where import Where
from pliant.pose import Axis
from pliant.task import Task
from pliant.teaching import Teaching

_NAMES = tuple(f"{axis} {axis.report_unit}" for axis in Axis)


def dry_run(where: Where, task: Task, teaching: Teaching) -> int:
    """Print every motion that a trial could command. Exit status 0: all lie in the workspace."""
    taught, limits = teaching.for_task(task), where.limits
    lines = rehearsal.plan_of(taught, task, limits)
    console = Console(highlight=False)
    table = _table("motion", *_NAMES, "mm/s", "stop mm")
    for line in lines:
        how = f"retreat, {line.formation}" if line.is_retreat else line.formation
        numbers = [f"{axis.to_report(line.pose[axis]) + 0.0:.1f}" for axis in Axis]
        caps = f"{line.speed_m_s * 1e3:g}", f"{line.compression_m * 1e3:g}"
        table.add_row(how, *numbers, *caps)
    console.print(
        "The nominal plan, and each formation after a retreat, with the taught goals; speed and"
        " compression at most:\n"
    )
    console.print(table)
    table = _table("a recovery moves", "taught", "from", "to", "all of them, from", "to")
    for bound in rehearsal.bounds_of(taught, limits):
        values = (bound.taught, *bound.one, *bound.all)
        numbers = [f"{bound.axis.to_report(v) + 0.0:.1f}" for v in values]
        table.add_row(f"{bound.formation} {bound.axis} [mm]", *numbers)
    console.print(
        "\nA retreat goes straight up from where the failed motion ended. One recovery may move a"
        " goal by a step from where it is, all of them within the workspace:\n"
    )
    console.print(table)
    problems = [f"{line.formation}: {line.problem}" for line in lines if line.problem]
    for problem in problems:
        console.print(Text(problem))
    return 1 if problems else 0


def air_run(where: Where, task: Task, teaching: Teaching) -> int:
    """Run the nominal plan above the board. Exit status 0: it went through, and touched nothing.

    Raises:
        InputError: the workspace has no room for that.
    """
    taught, limits = teaching.for_task(task), where.limits
    rehearsal.above(taught, task, limits)  # refuses before anything moves
    console = Console(highlight=False, soft_wrap=True)
    is_early = False
    try:
        with opened(where, AtTerminal()) as cell:
            robot = cell.prepare(task, Setup(seed=0))
            for outcome in rehearsal.air(robot, taught, task, limits):
                is_early = outcome.stop.is_early
                end, pressed = outcome.pose, max(m.peak_compression_m for m in outcome.motions)
                console.print(
                    f"{outcome.step.formation:<9} {outcome.stop}: y {end.y * 1e3:.1f} mm,"
                    f" z {end.z * 1e3:.1f} mm, pressed by {pressed * 1e3:.1f} mm at most"
                )
    except RobotFault as fault:
        console.print(Text(f"{fault.end_reason}: {fault}"))
        return 1
    console.print("stopped: something pressed the wrist" if is_early else "all in free air")
    return 1 if is_early else 0


def _table(*columns: str) -> Table:
    table = Table(box=None, pad_edge=False, header_style="dim")
    for index, name in enumerate(columns):
        table.add_column(name, justify="right" if index else "left")
    return table
