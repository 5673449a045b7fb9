"""A case set put to several reasoners, and the document of their scores."""

from collections.abc import Callable, Mapping
from itertools import islice
from typing import Any

from pliant import store
from pliant.errors import InputError
from pliant.experiment.bench.blind import Pictures, shown
from pliant.experiment.bench.cases import Cases
from pliant.experiment.bench.marks import Make, Mark, put
from pliant.experiment.bench.scores import scores
from pliant.records import SCHEMA


def run(
    reasoners: Mapping[str, Make],
    cases: Cases,
    *,
    limit: int | None = None,
    pictures: Pictures = Pictures.OWN,
    on_mark: Callable[[str, Mark], None] | None = None,
) -> dict[str, Any]:
    """Put every case, or the first `limit`, to each reasoner; one after the other, so that a
    reasoner that asks a slow model holds up no other. `pictures` other than their own show what a
    reasoner scores without seeing. `on_mark` is told each case's marks.

    Raises:
        InputError: there is nothing to do, the set is broken, or a reasoner failed.
    """
    if not reasoners:
        raise InputError("no reasoner was named: give one or several, such as rules coin")
    if limit is not None and limit < 1:
        raise InputError(f"--limit is {limit}: it must be a whole number above 0")
    found = {}
    for name, make in reasoners.items():
        marks: list[Mark] = []
        for question in islice(shown(cases, pictures), limit):
            marks.append(put(question, name, make))
            if on_mark is not None:
                on_mark(name, marks[-1])
        found[name] = scores(marks)
    return {
        "schema": SCHEMA,
        "made_by": store.made_here(),
        "cases": {
            "hash": cases.hash,
            "n": len(marks),
            "of": len(cases),
            "pictures": pictures.value,
        },
        "reasoners": found,
    }
