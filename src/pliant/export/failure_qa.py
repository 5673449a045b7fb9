"""A run as questions and answers about its executions, successes and failures: JSON lines and
pictures, for training and testing models that judge, explain and correct."""

import json
import shutil
from collections import Counter
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path

from pliant.console import Told, untold
from pliant.errors import InputError
from pliant.export.output import (
    CARD,
    LinesBySplit,
    filling,
    front_matter,
    origin,
    split_rule,
    table,
)
from pliant.export.questions import TYPES, asked, context
from pliant.export.source import TEST, TRAIN, Saved, Source, counts
from pliant.store import PICTURES, Pictures, load_trial

_CAMERA = "side"


def write(source: Source, out: Path, *, progress: Told = untold) -> dict[str, int]:
    """Write train.jsonl, test.jsonl and their pictures; return how many questions each has.
    `progress` is told how many of how many trials are done.

    Raises:
        InputError: `out` holds something, a trial's record is broken, or no truth is known.
    """
    with filling(out) as folder:
        (folder / PICTURES).mkdir()
        with ExitStack() as stack:
            writer = _Writer(folder, stack)
            for n, saved in enumerate(source.saved, start=1):
                writer.add(saved)
                progress(n, len(source.saved))
        found = writer.questions()
        if not any(found.values()):
            raise InputError(
                f"'{source.folder}' has no trial with a known truth, from which answers are made"
            )
        (folder / CARD).write_text(_card(source, writer), encoding="utf-8")
    return found


class _Writer:
    """Writer of the files while trials are added: train first, so that test can leave out what is
    in it."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self._folder, self._lines = folder, LinesBySplit(folder, stack)
        self._asked: set[str] = set()
        self._pictures: dict[str, str] = {}  # the split that each belongs to
        self.tally: Counter[tuple[str, str, str]] = Counter()  # split, type, category
        self.executions: Counter[str] = Counter()
        self.repeated = self.leaked = 0

    def add(self, saved: Saved) -> None:
        trial = load_trial(saved.folder)
        for label, questions in asked(trial):
            image = label.execution.outcome.looks[-1].observation.views[_CAMERA].image
            picture = Pictures(saved.folder / PICTURES).path(image)
            if self._pictures.setdefault(picture.name, saved.split) != saved.split:
                self.leaked += len(questions)
                continue
            shown = context(trial, label)
            index = label.execution.index
            known = json.dumps([picture.name, shown], sort_keys=True)
            if known in self._asked:
                self.repeated += len(questions)
                continue
            self._asked.add(known)
            self.executions[saved.split] += 1
            shutil.copyfile(picture, self._folder / PICTURES / picture.name)
            for question in questions:
                line = {
                    "id": f"{trial.trial_id}/{index}/{question.type}",
                    **asdict(question),
                    "picture": f"{PICTURES}/{picture.name}",
                    "context": shown,
                    "trial_id": trial.trial_id,
                    "seed": trial.seed,
                    "execution": index,
                    "run_verdict": {
                        "success": label.execution.verdict.success,
                        "by": label.execution.verdict.by,
                    },
                }
                self._lines.add(saved.split, line)
                self.tally[saved.split, question.type, question.category] += 1

    def questions(self) -> dict[str, int]:
        return {
            split: sum(n for (s, _, _), n in self.tally.items() if s == split)
            for split in (TRAIN, TEST)
        }


def _card(source: Source, writer: _Writer) -> str:
    trials, asked_in = counts(source.saved), writer.questions()
    present = [split for split in (TRAIN, TEST) if asked_in[split]]
    lines = [
        *front_matter("visual-question-answering", present),
        "# Did it fail, how, where, why, and what now? Questions about peg insertion",
        "",
        "One question a line, with the picture that a reasoner saw when the execution had ended,"
        " what else it knew, and an answer made from the simulation's truth.",
        "",
        "## Origin",
        "",
        *origin(source),
        "",
        "## Counts",
        "",
        f"The run has {source.trials} trials, of which {len(source.saved)} were chosen that kept"
        " their record.",
        "",
        *table(
            ["split", "trials", "executions asked about", *TYPES, "questions"],
            [_row(writer, split, trials[split], asked_in[split]) for split in present],
        ),
        "",
        split_rule() + f" {writer.leaked} questions of `test` were left out because their picture"
        f" is in `train` (a first motion may look the same), and {writer.repeated} that repeat"
        " another's picture and context.",
        "",
        "How often each answer is right. Always giving the commonest answer is the baseline to"
        " beat; `detect` asks about successes too, and is not balanced.",
        "",
        *table(["type", "category", *present], _categories(writer, present)),
        "",
        "## Fields",
        "",
        *table(["field", "meaning"], _FIELDS),
        "",
        "`correct` is answered by pliant's rules with the truth in place of every measurement: a"
        " good next step, not the only one.",
        "",
    ]
    return "\n".join(lines)


def _row(writer: _Writer, split: str, trials: int, questions: int) -> list[object]:
    by_type = [
        sum(n for (s, t, _), n in writer.tally.items() if (s, t) == (split, kind)) for kind in TYPES
    ]
    return [split, trials, writer.executions[split], *by_type, questions]


def _categories(writer: _Writer, present: list[str]) -> list[list[object]]:
    pairs = sorted(
        {(kind, category) for _, kind, category in writer.tally},
        key=lambda pair: (TYPES.index(pair[0]), pair[1]),
    )
    return [[t, c, *(writer.tally[split, t, c] for split in present)] for t, c in pairs]


_FIELDS = [
    ["`id`", "trial_id / execution / type"],
    ["`type`", ", ".join(TYPES)],
    ["`question`, `answer`", "in words"],
    ["`category`", "the answer's discrete part: for scoring without reading the words"],
    ["`truth`", "the values behind the answer: mm, degrees"],
    ["`picture`", "the side camera's picture, 640 × 480"],
    ["`context`", "formation, goals, measured pose, compression, the paper's checks, history"],
    ["`run_verdict`", "what the run's reasoner judged; not for the model that is asked"],
    ["`trial_id`, `seed`, `execution`", "where it comes from; as `id`, not for the model"],
]
