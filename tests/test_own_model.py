"""The weights that come with pliant, as they are served: they decide trials of each peg themselves,
and what they say of a picture changes with it."""

import json
import subprocess
import sys
from itertools import islice
from pathlib import Path

import pytest

from pliant.experiment.bench.blind import Pictures, shown
from pliant.experiment.bench.cases import SHIPPED, BenchCase, Cases, Kind
from pliant.reasoners import vlm
from pliant.reasoners.vlm.reasoner import unasked
from pliant.reasoners.vlm.settings import SHIPPED as NAME
from pliant.reasoners.vlm.settings import from_fields

pytestmark = pytest.mark.system

PLIANT = Path(sys.executable).with_name("pliant")
ALONE = from_fields({"fallback": False})


@pytest.mark.parametrize("peg", ["circle", "square", "rectangle_narrow"])
def test_it_decides_a_trial_of_each_peg_by_itself(peg: str, tmp_path: Path) -> None:
    words = ["run", "--peg", peg, "--seed", "3", "--reasoner", "vlm", "--no-fallback", "--no-video"]
    ended = subprocess.run(
        [PLIANT, *words, "--json", "--out", tmp_path], capture_output=True, encoding="utf-8"
    )
    assert ended.returncode in (0, 1), ended.stderr
    row = json.loads(ended.stdout)
    assert row["model"] == NAME
    assert row["own"] == row["decisions"] > 0
    assert not row["fault"]


def test_what_it_says_of_a_picture_changes_with_the_picture() -> None:
    """Replies are the same for the same request: were the picture lost, nothing would change."""
    cases = list(islice(Cases(SHIPPED), 12))
    asked = [q for q in cases if unasked(q.case) is None]
    own, others = (
        [said(q) for q in shown(asked, which)] for which in (Pictures.OWN, Pictures.OTHERS)
    )
    assert sum(a != b for a, b in zip(own, others, strict=True)) >= 3


def test_it_sees_how_deep_a_peg_is() -> None:
    """Insertions that ended close to the depth that is asked for: what was commanded tells nothing,
    and the checks that there are say success of both sorts."""
    close = [q for q in Cases(SHIPPED) if q.key.kind is Kind.NEARLY]
    own, black = (
        sum(judged(q) is q.key.answer.success for q in shown(close, which))
        for which in (Pictures.OWN, Pictures.BLACK)
    )
    assert len(close) == 33
    assert own >= black + 5


def judged(question: BenchCase) -> bool:
    return bool(vlm(ALONE).judge(question.case).success)


def said(question: BenchCase) -> str:
    verdict = vlm(ALONE).judge(question.case)
    assert verdict.is_own
    return verdict.reason
