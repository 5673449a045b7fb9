"""Trials in a cell that a file describes, as `run` and `experiment` perform them."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from pliant.cli.cells import opened
from pliant.errors import InputError
from pliant.experiment.attended import Attended
from pliant.experiment.cells import Experiment


@contextmanager
def attended(experiment: Experiment, *, one_trial: bool = False) -> Iterator[Attended]:
    """The experiment's cell, connected until the end of this context; a real one with the person at
    this terminal.

    Raises:
        InputError: the cell cannot be used, or nobody is at the terminal of a real one.
    """
    from pliant.commissioning.attending import Attending

    needs_person = experiment.where.kind == "ur5e"
    if needs_person and not sys.stdin.isatty():
        raise InputError("a real cell needs a person who places things: run this in a terminal")
    person = Attending(one_trial=one_trial) if needs_person else None
    with opened(experiment.where, person) as cell:
        yield Attended(cell, experiment, person)
