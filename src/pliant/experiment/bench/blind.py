"""The same cases with other pictures: what a reasoner scores on them is not seeing.

What was measured in the pictures stays as it was, and so do goal pictures: only what a reasoner
would look at itself is exchanged.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from enum import StrEnum

import numpy as np

from pliant.cell import View
from pliant.experiment.bench.cases import BenchCase
from pliant.formations import Formation

_Views = Mapping[str, View]
_Sort = tuple[Formation, tuple[str, ...]]


class Pictures(StrEnum):
    """Which pictures are shown with each case."""

    OWN = "own"
    BLACK = "black"
    OTHERS = "others"  # of another case, after the same formation and of the same cameras


def shown(cases: Iterable[BenchCase], pictures: Pictures) -> Iterable[BenchCase]:
    """The cases with these pictures, to be iterated over again and again."""
    if pictures is Pictures.OWN:
        return cases
    return _Exchanged(cases, _black if pictures is Pictures.BLACK else None)


class _Exchanged:
    """Cases with each look's views exchanged for what `made` makes of them; without it, for those
    of the case of its sort before it, and the first one's for those of the last."""

    def __init__(self, cases: Iterable[BenchCase], made: Callable[[_Views], _Views] | None) -> None:
        self._cases, self._made = cases, made

    def __iter__(self) -> Iterator[BenchCase]:
        if self._made is not None:
            for question in self._cases:
                yield _with(question, self._made(_views(question)))
            return
        last = {_sort(question): _views(question) for question in self._cases}
        for question in self._cases:
            sort, views = _sort(question), _views(question)
            yield _with(question, last[sort])
            last[sort] = views


def _views(question: BenchCase) -> _Views:
    return question.case.outcome.looks[-1].observation.views


def _sort(question: BenchCase) -> _Sort:
    return question.case.outcome.step.formation, tuple(sorted(_views(question)))


def _with(question: BenchCase, views: _Views) -> BenchCase:
    """The case with other views in its last look, from the cameras where its own are."""
    outcome = question.case.outcome
    look = outcome.looks[-1]
    own = look.observation.views
    exchanged = {n: replace(view, image=views[n].image) for n, view in own.items()}
    observation = replace(look.observation, views=exchanged)
    looks = (*outcome.looks[:-1], replace(look, observation=observation))
    return replace(question, case=replace(question.case, outcome=replace(outcome, looks=looks)))


def _black(views: _Views) -> _Views:
    return {n: replace(view, image=np.zeros_like(view.image)) for n, view in views.items()}
