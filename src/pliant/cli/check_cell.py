"""`pliant check-cell`: is the cell ready?"""

import json as json_format
from dataclasses import asdict

from rich.table import Table
from rich.text import Text

from pliant.cli.cells import where
from pliant.console import Console, say
from pliant.task import load_task

_COLOURS = {"pass": "#117733", "fail": "#882255"}


def check_cell(*, cell: str = "sim", peg: str = "circle", json: bool = False) -> int:
    """Check a cell before it is used, without moving the arm: what was found, and what to do. The
    peg is in the gripper, hanging free above the board. An emulated cell is set up anew.

    Args:
        cell: sim, or the path of a cell's file.
        peg: the peg in the gripper: circle, square, rectangle, or the path of a peg file (.yaml).
        json: print one line of JSON, and nothing else.
    """
    from pliant.commissioning import preflight

    findings = preflight.check(where(cell), load_task(peg))
    is_ready = all(finding.is_good for finding in findings)
    if json:
        checks = [asdict(finding) for finding in findings]
        say(json_format.dumps({"ready": is_ready, "checks": checks}))
        return 0 if is_ready else 1
    table = Table(box=None, pad_edge=False, header_style="dim")
    for name in ("check", "", "found, and what to do"):
        table.add_column(name, overflow="fold")
    for finding in findings:
        said = Text(finding.found)
        if finding.advice:
            said.append(f"\n{finding.advice}", "italic")
        state = Text(finding.state, _COLOURS.get(finding.state, "dim"))
        table.add_row(finding.check, state, said)
    console = Console(highlight=False)
    console.print(table)
    failed = sum(not finding.is_good for finding in findings)
    console.print("ready" if is_ready else f"not ready: {failed} of {len(findings)} checks")
    return 0 if is_ready else 1
