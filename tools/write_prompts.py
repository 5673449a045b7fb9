"""Write docs/prompts.md: what a model is told and shown, whole, in each stage of each method.

    python tools/write_prompts.py            # after a prompt changed
    python tools/write_prompts.py --check    # exit 1 where the document differs

The cases are of simulated trials: of each formation that a plan may hold one that failed. The
analysis that comes back to the model is that of the rules.
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from pydantic_ai.messages import BinaryContent

from pliant.envelope import Limits
from pliant.experiment.one import Spec, composed
from pliant.formations import RECOVERABLE, Formation
from pliant.reasoners.rules import Rules
from pliant.reasoners.vlm import prompt
from pliant.reasoners.vlm.settings import Settings
from pliant.records import Case, Verdict
from pliant.recovery import changes
from pliant.sim.cell import SimCell
from pliant.teaching import shipped

DOCS = Path(__file__).parent.parent / "docs"
PAGE, PICTURES = DOCS / "prompts.md", DOCS / "images" / "prompts"
TRIALS = {
    "planar": (
        Spec.named(peg="circle", condition="friction", seed=1),
        Spec.named(peg="circle", condition="pose", seed=3),
        Spec.named(peg="rectangle_narrow", condition="pose", seed=129),
    ),
    "guided": (
        Spec.named(peg="square", level="L1", seed=50026),
        Spec.named(peg="circle", level="lying_camera", seed=41004),
        Spec.named(peg="square", level="blocked_hole", seed=41001),
    ),
}
_HEAD = """# What a model is told and shown

Whole requests, as they are sent, for each method and each formation that a model is asked about:
to judge, to analyse and to plan. Approach and Contact are not asked about, nor what the compression
limit ended ([assumptions](assumptions.md#the-vlm)). Each request begins with the same static part,
then comes the situation, then the pictures, and last what is asked; the reply's structure goes
with it as the function to call or the schema to fill. What is sent is chosen by
[options](vlm.md#what-it-is-asked); these are the defaults.

This page is written by `python tools/write_prompts.py`, and a test fails where it is not what
would be sent.
"""
_SAME = 5e-5  # [m, rad] of no change
_FAILED = Verdict(
    success=False,
    reason="(the reason that the model gave)",
    votes={},
    conflict=None,
    by="vlm",
)


@dataclass(frozen=True)
class _Watching(Rules):
    """The rules, and what they were asked."""

    cases: list[Case] = field(default_factory=list)

    def judge(self, case: Case) -> Verdict:
        self.cases.append(case)
        return super().judge(case)


def page() -> tuple[str, dict[str, bytes]]:
    """The page, and its pictures by their names."""
    shown: dict[str, bytes] = {}
    parts = [
        _HEAD,
        *(part for name, specs in TRIALS.items() for part in _method(name, specs, shown)),
    ]
    return "\n".join(parts), shown


def _method(name: str, specs: Sequence[Spec], shown: dict[str, bytes]) -> Iterator[str]:
    settings = Settings()
    cases = _failed(specs)
    yield f"## Method {name}\n"
    yield "### The static part\n"
    yield _quoted(prompt.instructions(settings, cases[Formation.FIT], Limits()))
    for formation, case in cases.items():
        recovery = Rules().recover(case, Rules().judge(case))
        assert recovery is not None, "the rules always plan"
        made = {step.formation: changes(step, case) for step in recovery.steps}
        made = {f: {a: by for a, by in of.items() if abs(by) > _SAME} for f, of in made.items()}
        made = {formation: of for formation, of in made.items() if of}
        analysis = replace(recovery.analysis, changes=made)
        for stage in ("judge", "analyse", "plan"):
            yield f"### {str(formation).capitalize()}: {stage}\n"
            content = prompt.situation(
                case,
                settings,
                asked=prompt.ASKED[stage],
                goal_picture=stage == "judge" and formation is Formation.INSERTION,
                verdict=None if stage == "judge" else _FAILED,
                analysis=analysis if stage == "plan" else None,
            )
            for item in content:
                yield (
                    _shown(item, shown, name)
                    if isinstance(item, BinaryContent)
                    else _quoted(str(item))
                )


def _failed(specs: Sequence[Spec]) -> dict[Formation, Case]:
    """A case of each formation: the first in the trials that failed without being stopped."""
    watching = _Watching()
    for spec in specs:
        robot = SimCell().prepare(spec.task, setup := spec.condition.draw(spec.seed))
        list(composed(spec, robot, setup, shipped().for_task(spec.task), watching))
    failed = [c for c in watching.cases if not Rules().judge(c).success]
    return {
        formation: next(
            c
            for c in failed
            if c.outcome.step.formation is formation and not c.outcome.stop.is_early
        )
        for formation in RECOVERABLE
    }


def _quoted(text: str) -> str:
    return f"```text\n{text}\n```\n"


def _shown(picture: BinaryContent, shown: dict[str, bytes], name: str) -> str:
    for file, known in shown.items():
        if known == picture.data:
            return f"![{file}](images/prompts/{file})\n"
    file = f"{name}-{sum(known.startswith(name) for known in shown) + 1}.png"
    shown[file] = picture.data
    return f"![{file}](images/prompts/{file})\n"


def main() -> None:
    text, shown = page()
    if "--check" in sys.argv:
        sys.exit(PAGE.read_text(encoding="utf-8") != text)
    PAGE.write_text(text, encoding="utf-8")
    PICTURES.mkdir(parents=True, exist_ok=True)
    for file, data in shown.items():
        (PICTURES / file).write_bytes(data)


if __name__ == "__main__":
    main()
