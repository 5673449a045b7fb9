"""`pliant label`: say afterwards how a real cell's trials went."""

import sys
from pathlib import Path
from typing import Annotated

import tyro

from pliant.console import Console
from pliant.errors import InputError
from pliant.records import Trial


def label(folder: Annotated[Path, tyro.conf.Positional]) -> int:
    """Label the trials of a real cell that nobody has labelled yet: each one's last picture is
    named, and you say whether the peg is inserted. Whoever stops goes on with the same command.

    Args:
        folder: the result folder of `pliant experiment` or `pliant run`.
    """
    from pliant.commissioning.attending import Attending
    from pliant.experiment import labels

    if not sys.stdin.isatty():
        raise InputError("labels are a person's to give: run this in a terminal")
    console = Console(highlight=False)
    person = Attending(console)

    def ask(trial: Trial, picture: Path) -> bool | None:
        console.print(f"\n{trial.trial_id}", style="bold")
        return person.label(trial, picture)

    done, missing = labels.label(folder, ask)
    console.print(f"{done} labelled, {missing} without a label")
    return 0 if not missing else 1
