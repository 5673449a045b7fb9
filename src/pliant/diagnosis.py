"""The diagnosis of a trial: whether things are as the task says, weighed over all that was seen and
felt so far.

A sign is one thing that does not fit the task; it speaks for some hypotheses more than for the task
as told. Their weights add up, as independent evidence does (naive Bayes), and where one that no
insertion can help against is nearly certain, the right end is to stop and say so.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

_PRIOR = -2.0  # log10 of each other hypothesis against the task as told
_CERTAIN = 0.98  # wrong in one of fifty, were the signs independent


class Hypothesis(StrEnum):
    """What may be so, by the names that results have."""

    AS_TOLD = "as_told"
    PEG_OTHER = "peg_other"
    PEG_MISSING = "peg_missing"
    HOLE_ELSEWHERE = "hole_elsewhere"
    HOLE_BLOCKED = "hole_blocked"
    OBJECT_ON_BOARD = "object_on_board"
    SENSOR_WRONG = "sensor_wrong"
    CAMERA_WRONG = "camera_wrong"
    CAMERA_BLIND = "camera_blind"
    UNKNOWN = "unknown"

    @property
    def words(self) -> str:
        return _WORDS[self]

    @property
    def is_hopeless(self) -> bool:
        """Whether no attempt can help against it."""
        return self not in _INSERTABLE


_INSERTABLE = (Hypothesis.AS_TOLD, Hypothesis.HOLE_ELSEWHERE, Hypothesis.CAMERA_BLIND)
_WORDS = {
    Hypothesis.AS_TOLD: "all is as the task says",
    Hypothesis.PEG_OTHER: "the peg is another than the task's",
    Hypothesis.PEG_MISSING: "the gripper holds no peg",
    Hypothesis.HOLE_ELSEWHERE: "the hole is elsewhere than the camera shows it",
    Hypothesis.HOLE_BLOCKED: "the hole is blocked",
    Hypothesis.OBJECT_ON_BOARD: "something lies on the board, over the hole",
    Hypothesis.SENSOR_WRONG: "the wrist's sensor does not tell how far it is pressed",
    Hypothesis.CAMERA_WRONG: "the cameras do not show what is there now",
    Hypothesis.CAMERA_BLIND: "the cameras show nothing near the board",
    Hypothesis.UNKNOWN: "the reasoner stopped, and no sign says what is wrong",
}


OF_FAULTS = {
    "fault:sensor": (Hypothesis.SENSOR_WRONG, Hypothesis.SENSOR_WRONG),
    "fault:no_touch": (Hypothesis.PEG_MISSING, Hypothesis.SENSOR_WRONG),
    "fault:held": (Hypothesis.PEG_MISSING, Hypothesis.SENSOR_WRONG),
}
"""The hypotheses that the cell itself decides, by how it ends a trial: where no picture showed a
peg, and where one did."""


@dataclass(frozen=True, kw_only=True)
class Sign:
    """One thing that does not fit the task, in a sentence, and by how much it speaks for each
    hypothesis against the task as told [log10 of the odds]."""

    says: str
    speaks: Mapping[Hypothesis, float]


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """The weight of each hypothesis, between 0 and 1, and the signs behind it."""

    signs: tuple[Sign, ...] = ()
    weights: Mapping[Hypothesis, float] = field(default_factory=lambda: {Hypothesis.AS_TOLD: 1.0})

    @property
    def leading(self) -> Hypothesis:
        """The hypothesis with the greatest weight."""
        return max(self.weights, key=lambda h: self.weights[h])

    @property
    def is_as_told(self) -> bool:
        """Whether all is believed to be as the task says."""
        return self.leading is Hypothesis.AS_TOLD

    @property
    def weight(self) -> float:
        return self.weights[self.leading]

    @property
    def is_hopeless(self) -> bool:
        """Whether it is nearly certain that no attempt can help."""
        return self.leading.is_hopeless and self.weight >= _CERTAIN

    @property
    def why(self) -> str:
        """The signs, each as often as it was seen."""
        said = [sign.says for sign in self.signs]
        return "; ".join(dict.fromkeys(said))

    def __str__(self) -> str:
        if self.leading is Hypothesis.UNKNOWN:  # a word of the reasoner's, which nothing weighs
            return self.leading.words
        return f"{self.leading.words} ({100 * self.weight:.0f} %)"


def blames_camera(diagnosis: Diagnosis | None) -> bool:
    """Whether the pictures are what is most probably wrong."""
    return diagnosis is not None and diagnosis.leading is Hypothesis.CAMERA_WRONG


def weighed(signs: Sequence[Sign]) -> Diagnosis:
    """The diagnosis that signs give together."""
    if not signs:
        return Diagnosis()
    odds = {h: 0.0 if h is Hypothesis.AS_TOLD else _PRIOR for h in Hypothesis}
    for sign in signs:
        for hypothesis, by in sign.speaks.items():
            odds[hypothesis] += by
    most = max(odds.values())
    shares = {h: math.pow(10.0, by - most) for h, by in odds.items()}
    total = math.fsum(shares.values())
    return Diagnosis(signs=tuple(signs), weights={h: s / total for h, s in shares.items()})
