"""The definition of an experiment: cells (peg, condition, reasoner), seeds, and their
fingerprint."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from pliant import teaching
from pliant.conditions import Condition
from pliant.errors import InputError
from pliant.experiment import decides, growth
from pliant.experiment.one import MOST_SEED, Spec, whole
from pliant.experiment.where import Where
from pliant.methods.named import method
from pliant.own import short_name
from pliant.reasoners import vlm as make_vlm
from pliant.records import SCHEMA
from pliant.teaching import Teaching

MOST_TRIALS = 1_000_000
WHOLE = {"trials": (1, MOST_TRIALS), "first_seed": (0, MOST_SEED)}


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """An experiment: cells of a table times seeds. A cell is the specification of its trials, of
    which only the seed differs. `goals` is a taught goals file, or None for
    those of the workcell `where`.

    Raises:
        InputError: there are no cells, two of them would share their trials' names, a number is
            out of range, the workcell's file cannot be used, or the workcell cannot do this.
    """

    cells: tuple[Spec, ...]
    trials: int = 30
    first_seed: int = 1
    goals: str | None = None
    where: Where = field(default_factory=Where)

    def __post_init__(self) -> None:
        whole("trials", self.trials, *WHOLE["trials"])
        whole("first_seed", self.first_seed, *WHOLE["first_seed"])
        if not self.cells:
            raise InputError("the experiment has no cells: give pegs, conditions and reasoners")
        ids: dict[str, Spec] = {}
        for cell in self.cells:
            twin = ids.setdefault(cell.trial_id, cell)
            if twin is not cell:
                raise InputError(
                    f"two different cells are both named {', '.join(cell.names)}: rename the peg"
                    " file, the condition or the reasoner's file of one"
                )
        for cell in self.cells:
            self.where.check(cell.level, cell.condition, cell.reasoner, cell.method)
            if cell.vlm is not None and cell.vlm.probes and method(cell.method).prober is None:
                raise InputError(
                    f"probes: method {short_name(cell.method)} has none; leave them out, or take"
                    " guided"
                )

    def __len__(self) -> int:
        return len(self.cells) * self.trials

    def specs(self) -> Iterator[Spec]:
        """All trials in canonical order: by cell as listed, then by seed."""
        for cell in self.cells:
            for seed in range(self.first_seed, self.first_seed + self.trials):
                yield replace(cell, seed=seed)

    def teaching(self) -> Teaching:
        """The taught goals. Raises InputError when the goals file cannot be used."""
        goals = self.where.goals if self.goals is None else Path(self.goals)
        if goals is None:
            return teaching.shipped()
        return teaching.load(goals, self.where.limits, self.where.colours)

    @property
    def models(self) -> list[str]:
        """The models that are asked, cell by cell."""
        return [str(c.vlm.name) for c in self.cells if c.vlm is not None]

    def check_models(self) -> None:
        """Check the models to be asked. Raises InputError when one is unknown, or its library or
        key is missing."""
        for settings in {c.vlm for c in self.cells if c.vlm is not None}:
            make_vlm(settings)

    @cached_property
    def document(self) -> dict[str, Any]:
        """Everything that decides outcomes, as JSON: pegs and conditions in full, content hashes of
        goals and of a user's own files, and what is installed (`decides`)."""
        return {
            "schema": SCHEMA,
            "trials": self.trials,
            "first_seed": self.first_seed,
            "cells": [
                {
                    "task": asdict(c.task),
                    "level": c.level,
                    "condition": _document(c.condition),
                    "reasoner": c.names[-1],
                    "reasoner_file": decides.own_file_hash(c.reasoner),
                    "vlm": None if c.vlm is None else asdict(c.vlm),
                    "weights": decides.weights_hash(c.vlm),
                    "method": short_name(c.method),
                    "method_file": decides.own_file_hash(c.method),
                }
                for c in self.cells
            ],
            "cell": self.where.document,
            "goals": decides.goals(self.teaching()),
            **decides.installation(
                models=self.where.kind == "sim",
                asked=[c.vlm for c in self.cells if c.vlm is not None],
            ),
        }

    @property
    def expected(self) -> dict[tuple[str, str], dict[str, Any]]:
        """The installation that a worker must find, by reasoner and method; empty where no worker
        simulates."""
        if self.where.kind != "sim":
            return {}
        return {(c.reasoner, c.method): decides.expected(c) for c in self.cells}

    @property
    def fingerprint(self) -> str:
        """Content hash of `document`: an output folder belongs to one fingerprint."""
        return str(growth.fingerprinted(self.document)["fingerprint"])


def differences(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
    """The fields of two experiments' documents that differ, by name."""
    return sorted(k for k in {*one, *other} if one.get(k) != other.get(k))


def _document(condition: Condition) -> dict[str, Any]:
    document: dict[str, Any] = {"name": condition.name, "ranges": dict(condition.ranges)}
    if condition.scenarios:
        document["scenarios"] = {name: dict(r) for name, r in condition.scenarios.items()}
    return document
