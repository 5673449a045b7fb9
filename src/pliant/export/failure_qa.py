"""A run as questions and answers about its executions, successes and failures: JSON lines and
pictures, for training and testing models that judge, explain and correct."""

import json
import shutil
from collections import Counter
from dataclasses import asdict
from functools import partial
from pathlib import Path

from pliant.console import Told, untold
from pliant.export.output import (
    SPLIT_RULE,
    Lines,
    in_paragraphs,
    lines_matter,
    origin,
    write_lines,
)
from pliant.export.questions import TYPES, asked, context
from pliant.export.source import Saved, Source, counts
from pliant.store import PICTURES, Pictures, load_trial
from pliant.table import Table

_CAMERA = "side"


def write(source: Source, out: Path, *, progress: Told = untold) -> dict[str, int]:
    """Write train.jsonl, test.jsonl and their pictures; return how many questions each has.
    `progress` is told how many of how many trials are done.

    Raises:
        InputError: `out` holds something, a trial's record is broken, or no truth is known.
    """
    asker = _Asker()
    card = partial(_card, source, asker)
    return write_lines(source, out, asker.add, card, made="answers", progress=progress)


class _Asker:
    """What was asked about already: train comes first, so that test can leave out what is in it."""

    def __init__(self) -> None:
        self._asked: set[str] = set()
        self._pictures: dict[str, str] = {}  # the split that each belongs to
        self.executions: Counter[str] = Counter()
        self.repeated = self.leaked = 0

    def add(self, lines: Lines, saved: Saved) -> None:
        """Write the questions about a trial, and their pictures."""
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
            shutil.copyfile(picture, lines.pictures / picture.name)
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
                lines.add(line, saved.split, question.type, question.category)


def _card(source: Source, asker: _Asker, lines: Lines) -> str:
    trials, found = counts(source.saved), lines.totals()
    by_type: Counter[tuple[str, str]] = Counter()
    for (split, kind, _), n in lines.tally.items():
        by_type[split, kind] += n
    rows = [
        [s, trials[s], asker.executions[s], *(by_type[s, kind] for kind in TYPES), found[s]]
        for s in lines.present()
    ]
    return in_paragraphs(
        lines_matter("visual-question-answering", lines),
        "# Did it fail, how, where, why, and what now? Questions about peg insertion",
        "One question a line, with the picture that a reasoner saw when the execution had ended,"
        " what else it knew, and an answer made from the simulation's truth.",
        "## Origin",
        origin(source),
        "## Counts",
        f"The run has {source.trials} trials, of which {len(source.saved)} were chosen that kept"
        " their record.",
        Table(["split", "trials", "executions asked about", *TYPES, "questions"], rows).markdown(),
        f"{SPLIT_RULE} {asker.leaked} questions of `test` were left out because their picture"
        f" is in `train` (a first motion may look the same), and {asker.repeated} that repeat"
        " another's picture and context.",
        "How often each answer is right. Always giving the commonest answer is the baseline to"
        " beat; `detect` asks about successes too, and is not balanced.",
        lines.kinds(["type", "category"], lambda key: (TYPES.index(key[0]), key[1])),
        "## Fields",
        Table(["field", "meaning"], _FIELDS).markdown(),
        "`correct` is answered by pliant's rules with the truth in place of every measurement: a"
        " good next step, not the only one.",
    )


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
