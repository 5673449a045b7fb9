"""The card of a LeRobot data set."""

from collections import Counter
from collections.abc import Mapping

from pliant.experiment.success import KINDS
from pliant.export.output import SPLIT_RULE, front_matter, in_paragraphs, origin
from pliant.export.source import Saved, Source, counts
from pliant.formations import Formation
from pliant.table import Table
from pliant.text import markdown


def text(
    source: Source,
    chosen: tuple[Saved, ...],
    tally: Counter[tuple[str, str]],
    *,
    fps: int,
    subtasks: Mapping[Formation, str],
) -> str:
    """The text of the card, README.md: what the data set holds, where it comes from, what its
    labels mean."""
    splits = counts(chosen)
    left_out = len(source.saved) - len(chosen)
    rows = [[s, n, tally["frames", s], tally["retries", s]] for s, n in splits.items()]
    return in_paragraphs(
        front_matter("robotics", ["LeRobot"], " data/*/*.parquet"),
        "# Peg insertion with a soft wrist: successes, failures and recoveries",
        f"A LeRobot data set (v3.0) at {fps} frames a second. One episode is one trial; failed and"
        " retried executions are in it, and labelled.",
        "## Origin",
        origin(source),
        "## Counts",
        f"The run has {source.trials} trials, of which {len(source.saved)} were chosen that kept"
        f" their record; {len(chosen)} are here"
        + (f", {left_out} without a motion to replay are not." if left_out else "."),
        Table(["split", "episodes", "frames", "retried executions"], rows).markdown(),
        f"{SPLIT_RULE} `train` comes first, as LeRobot's ranges want it.",
        _counted("how the trial ended, from the truth", "trials", tally),
        _counted("execution, from the truth", "executions", tally),
        "## Features",
        "Poses are of the wrist's hinge point in the task frame: origin at the nominal hole's"
        " centre on the board's surface, z up; metres and radians, Rz(yaw) Ry(pitch) Rx(roll).",
        Table(["feature", "meaning"], _FEATURES).markdown(),
        "Sub-tasks are the five contact formations (`meta/subtasks.parquet`):",
        "\n".join(f"{n}. {words}" for n, words in enumerate(subtasks.values())),
        "`meta/episodes` has, besides LeRobot's columns, the trial's labels under `trial/`: seed,"
        " split, peg, condition, reasoner, `inserted` (truth), `judged`, `failure_kind`,"
        " `end_reason`, and what was drawn. `meta/executions.parquet` has one row per execution"
        " with its frames [`frame_from`, `frame_to`) of the episode: goal, checks, verdict, what,"
        " why and how, the plan, and the truth.",
        "Kinds of a failed execution:",
        "\n".join(f"- `{kind}`: {meaning}" for kind, meaning in KINDS.items()),
        "The pictures are drawn again from the stored motion, with the robot's meshes a little"
        " coarser than in the pictures that the reasoner saw.",
    )


_FEATURES = [
    ["`observation.state`", "measured pose (6) and the wrist's compression from free hang [m]"],
    ["`action`", "the pose that the running motion goes to, or where the arm holds (6)"],
    ["`observation.images.*`", "the camera's picture, 640 × 480"],
    ["`subtask_index`", "the formation that is executed"],
    ["`execution_index`", "which execution of the trial; one lasts until it is judged"],
    ["`is_retry`", "the trial had executed this formation before"],
    ["`verdict_success`", "how the reasoner judged the execution"],
    ["`execution_success`", "whether it really succeeded (truth)"],
    ["`next.success`", "the last frame of an episode whose peg is inserted (truth)"],
    ["`next.done`", "the last frame of an episode"],
]


def _counted(what: str, key: str, tally: Counter[tuple[str, str]]) -> str:
    found = sorted((name, n) for (kind, name), n in tally.items() if kind == key)
    return Table([what, key], [[markdown(name), n] for name, n in found]).markdown()
