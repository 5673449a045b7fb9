"""A VLM as the reasoner, from Python: who decided, what it said, and what it took.

python examples/14_a_vlm.py                                  # a stored conversation: asks nobody
python examples/14_a_vlm.py local                            # the model that comes with pliant
python examples/14_a_vlm.py openai:gpt-4o                    # with OPENAI_API_KEY set
python examples/14_a_vlm.py NAME http://localhost:8000/v1    # a server of your own
"""

import sys
from pathlib import Path

from pliant.conditions import condition
from pliant.experiment.one import Spec, perform
from pliant.reasoners.vlm.settings import Settings, from_fields
from pliant.sim.cell import SimCell
from pliant.task import load_task
from pliant.teaching import shipped

STORED = Path(__file__).parent.parent / "tests" / "recordings" / "circle-all-6.jsonl"
AS_STORED = Settings(model="scripted", deadline_s=60, picture=False, table_i=False, history=3)


def main(model: str | None = None, base_url: str | None = None) -> None:
    asked = {"model": model, "base_url": base_url}
    settings = AS_STORED if model is None else from_fields(asked)
    spec = Spec(
        task=load_task("circle"),
        condition=condition("all"),
        seed=6,
        reasoner="vlm",
        vlm=settings,
    )
    trial = perform(spec, SimCell(), shipped(), replay=STORED if model is None else None)
    for execution in trial.executions:
        verdict = execution.verdict
        print(execution.formation, "success" if verdict.success else "failure", "by", verdict.by)
        if execution.recovery is not None:
            print("   why:", execution.recovery.analysis.why)
            print("   how:", execution.recovery.analysis.how)
    calls = [call for e in trial.executions for call in e.verdict.exchanges]
    print(trial.end_reason, f"after {len(calls)} calls to judge")


if __name__ == "__main__":
    main(*sys.argv[1:])
