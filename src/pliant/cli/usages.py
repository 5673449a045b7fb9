"""What each command's page of help says beside its options: command lines to copy, and groups."""

from pliant.cli.model import GROUPS
from pliant.usage import Usage

_TRIED = "what is tried"
_HOW = "how it is tried"
_KEPT = "what is kept and shown"

RUN = Usage(
    examples=(
        ("pliant run --peg square --condition all --seed 4", "a failure, and its recovery"),
        (
            "pliant run --reasoner mine.py:Mine --hole-y-mm 8 12",
            "your reasoner, a hole far off",
        ),
        ("pliant run --reasoner vlm", "the model that comes with pliant"),
        ("pliant run --reasoner vlm --model openai:gpt-4o --max-usd 1", "a hosted model"),
    ),
    groups={
        _TRIED: ("peg", "condition", "level", "seed"),
        _HOW: ("reasoner", "method", "goals", "cell", "dry-run", "air"),
        _KEPT: ("out", "video", "json", "live"),
        **GROUPS,
    },
)
EXPERIMENT = Usage(
    examples=(
        ("pliant experiment --pegs circle square --reasoners none rules --trials 20", "every pair"),
        ("pliant experiment --level L4 --trials 20 --out runs/L4", "a harder level"),
        (
            "pliant experiment mine.yaml --save failures",
            "from a file, options win",
        ),
    ),
    groups={
        _TRIED: ("pegs", "conditions", "level", "trials", "first-seed"),
        _HOW: ("reasoners", "method", "goals", "cell"),
        "how it is run": ("workers", "ray", "time-limit-s", "again", "watch", "yes", "trust"),
        _KEPT: ("out", "save"),
        **GROUPS,
    },
)
VIEW = Usage(
    examples=(
        ("pliant view runs/experiment", "make its pages, and name the first"),
        ("pliant view runs/experiment --serve", "and show them to a browser, while it still runs"),
        ("pliant view runs/experiment --out copy", "pages elsewhere, the results as they are"),
    ),
    groups={_KEPT: ("video", "goals", "out"), "for a browser": ("serve", "port")},
)
TABLES = Usage(
    examples=(
        ("pliant tables runs/experiment", "the paper's tables as Markdown"),
        ("pliant tables runs/experiment --json", "the same figures for a program"),
        ("pliant tables runs/experiment | less -S", "wide rows that scroll"),
    ),
    groups={_KEPT: ("json",)},
)
EXPORT = Usage(
    examples=(
        ("pliant export runs/experiment --lerobot data", "a LeRobot data set"),
        ("pliant export runs/experiment --failure-qa qa --chat chat", "to tune a model on"),
        ("pliant export runs/experiment --rerun t.rrd --trial L0-circle-all-rules-1", "one trial"),
    ),
    groups={
        "into which form": ("lerobot", "failure-qa", "chat", "chat-for", "rerun"),
        "which, and how": ("trial", "fps", "cameras", "workers"),
    },
)
BENCH_REASONER = Usage(
    examples=(
        ("pliant bench-reasoner rules coin", "side by side"),
        ("pliant bench-reasoner mine.py:Mine --out mine.json", "your own, with all scores kept"),
        (
            "pliant bench-reasoner vlm --model openai:gpt-4o --limit 40",
            "a model",
        ),
    ),
    groups={_TRIED: ("cases", "limit", "pictures"), _KEPT: ("out",), **GROUPS},
)
SERVE_MODEL = Usage(
    examples=(
        ("pliant serve-model", "says its address, and how to ask it"),
        ("pliant serve-model --port 8001", "always at the same"),
        ("pliant serve-model --weights tuned/model.gguf --projector tuned/mmproj.gguf", "your own"),
    ),
)
LABEL = Usage(
    examples=(
        ("pliant label runs/lab", "say of each trial whether the peg is in"),
        ("pliant tables runs/lab", "then: the tables, with what you said"),
        ("pliant view runs/lab", "then: its pages"),
    ),
)
CALIBRATE = Usage(
    examples=(
        ("pliant calibrate --cell cell.yaml", "all of it"),
        ("pliant calibrate camera --cell cell.yaml", "the camera alone"),
        (
            "pliant calibrate colours --cell cell.yaml --peg-at 320 100 --block-at 320 400",
            "no window",
        ),
    ),
    groups={
        _TRIED: ("cell", "peg", "condition", "seed"),
        "where to look": ("peg-at", "block-at"),
        _KEPT: ("write", "out"),
    },
)
CHECK_CELL = Usage(
    examples=(
        ("pliant check-cell --cell cell.yaml", "what is found, and what to do"),
        ("pliant check-cell --cell cell.yaml --peg square", "with another peg in the gripper"),
        ("pliant check-cell --cell cell.yaml --json", "for a program"),
    ),
    groups={_TRIED: ("cell", "peg"), _KEPT: ("json",)},
)
TEACH = Usage(
    examples=(
        ("pliant teach", "in the simulated cell, to learn the keys"),
        ("pliant teach --cell cell.yaml --goals goals/lab/goals.yaml", "your own cell's goals"),
        ("pliant run --cell cell.yaml --goals goals/lab/goals.yaml --condition none", "then try"),
    ),
    groups={_TRIED: ("cell", "peg"), _KEPT: ("goals", "picture")},
)
