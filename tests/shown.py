"""What must come of every command, file and snippet that the documents show.

`tests/test_shown.py` runs them page by page, in order and in one folder, and refuses a block that
stands neither here nor, with its reason, among those that cannot be run.
"""

import re
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

from documents import ROOT

from pliant.conditions import condition
from pliant.emulator import faults
from pliant.experiment import plan, runner
from pliant.experiment.one import Spec, perform
from pliant.pictures import decoded
from pliant.sim.cell import SimCell
from pliant.task import load_task
from pliant.teaching import shipped
from pliant.ur5e import configuration


@dataclass(frozen=True, kw_only=True)
class Ran:
    """A block that was run in `folder`: what was printed by it, and by all before it on the page;
    a snippet's names; the block itself, and where it was saved if it is a file."""

    folder: Path
    printed: str
    before: Mapping[str, str]
    names: Mapping[str, Any]
    code: str
    file: Path


@dataclass(frozen=True, kw_only=True)
class Comes:
    """What comes of a block: `says` are regular expressions for what is printed, `makes` paths that
    are there afterwards, `then` what else must hold.

    `less` are options that a command gets besides, all of them public, so that it takes less time.
    What is `slow` is run with the system tests.
    """

    says: tuple[str, ...] = ()
    makes: tuple[str, ...] = ()
    then: Callable[[Ran], None] | None = None
    less: str = ""
    status: int = 0
    slow: bool = False


@dataclass(frozen=True, kw_only=True)
class Elsewhere:
    """Run by another test, in whose text `word` stands."""

    test: str
    word: str


@dataclass(frozen=True, kw_only=True)
class NotRun:
    """Cannot be run here."""

    because: str


@dataclass(frozen=True, kw_only=True)
class Page:
    """A document's blocks by name, and the files that it takes from other pages or as given."""

    blocks: Mapping[str, Comes | Elsewhere | NotRun]
    takes: Mapping[str, tuple[str, str]] = field(default_factory=dict)  # file: page, block
    prepared: Callable[[Path], object] | None = None  # what its commands take as given


# --- what is checked beyond what is printed ------------------------------------------------------


def is_shown_by(command: str) -> Callable[[Ran], None]:
    """Each line of a shown output, but for dots, is one that the command printed."""

    def check(ran: Ran) -> None:
        printed = [line.rstrip() for line in ran.before[command].splitlines()]
        for line in ran.code.splitlines():
            if line.strip() != "…":
                assert line.rstrip() in printed, f"{command} does not print: {line}"

    return check


def paths_are_there(ran: Ran) -> None:
    """Every file and folder that a tree names is in the checkout, in one of those it names."""
    code = ROOT / "src" / "pliant"
    for path in re.findall(r"(?<!\S)[\w/]+(?:\.py|/)(?!\S)", ran.code):
        found = [ROOT, code, *(p for p in code.iterdir() if p.is_dir())]
        assert any((folder / path).exists() for folder in found), path


def inserts(ran: Ran) -> None:
    """A peg file's peg goes into its hole, under every disturbance of the paper."""
    task = load_task(str(ran.file))
    spec = Spec(task=task, condition=condition("all"), seed=1, reasoner="rules")
    trial = perform(spec, SimCell(), shipped())
    assert trial.inserted
    assert trial.truths[-1].depth_m > 0.015


def is_planned(trials: int) -> Callable[[Ran], None]:
    """An experiment's file is of so many trials."""

    def check(ran: Ran) -> None:
        assert len(plan.load(ran.file, agree=lambda named: None)) == trials

    return check


def is_inserted(ran: Ran) -> None:
    """A snippet's trial ended well."""
    assert ran.names["trial"].inserted
    assert ran.names["trial"].truths[-1].depth_m > 0.015


def is_a_step(ran: Ran) -> None:
    """The environment answers as Gymnasium says."""
    assert ran.names["env"].observation_space.contains(ran.names["observation"])
    assert ran.names["reward"] == ran.names["reward"]  # a number
    assert not ran.names["terminated"]


def are_faults(ran: Ran) -> None:
    """A fault file is read."""
    found = faults.load(ran.file)
    assert [(at, fault.kind) for at, fault in found] == [(2.5, "protective_stop"), (4.0, "stall")]


def with_own_goals(folder: Path) -> None:
    """Goals taught by somebody else: the shipped ones, in a folder of their own."""
    shutil.copytree(str(files("pliant") / "goals"), folder / "my_goals")


def in_a_checkout(folder: Path) -> None:
    """The tests lie where a reader of a checkout has them."""
    (folder / "tests").symlink_to(ROOT / "tests")


def with_table2(folder: Path) -> None:
    """A small run in the place of Table II's."""
    fields = {"pegs": "circle", "conditions": "all", "reasoners": ["none", "rules"], "trials": 2}
    runner.run(plan.from_fields(fields), folder / "runs" / "table2", workers=1)


def is_a_picture(ran: Ran) -> None:
    """It shows the peg in the hole, as the camera took it."""
    assert decoded((ran.folder / "last.png").read_bytes()).shape == (480, 640, 3)


def is_csv(ran: Ran) -> None:
    """Each trial is a line under the columns' names."""
    head, *lines = (ran.folder / "trials.csv").read_text(encoding="utf-8").splitlines()
    assert head.startswith('"trial_id","cell","level","peg"')
    assert len(lines) == 4
    assert any(line.startswith('"L0-circle-all-rules-2","sim","L0","circle"') for line in lines)


def is_the_example(ran: Ran) -> None:
    """The cell's file is whole, and is read."""
    assert ran.printed == ""
    configuration.load(ran.folder / "cell.yaml")


# --- the documents -------------------------------------------------------------------------------

INSERTED = (r"^inserted \(ground truth: [12]\d\.\d mm deep; judged yes\)",)
ONE = "--trials 1 --workers 1"
HOSTED = NotRun(because="asks a hosted model")
SERVER = Elsewhere(test="test_vlm_server.py", word="base_url")
INSTALLS = Elsewhere(test="../tools/smoke_wheel.sh", word="pip install")
SHELLS = Elsewhere(test="test_wrong_words.py", word="--tyro-print-completion")
EMULATED = Elsewhere(test="test_tutorials.py", word="own-robot.md")
REAL = NotRun(because="moves a real cell")
PICTURE = NotRun(because="a picture drawn with characters")
MINE = {"mine.py": ("docs/how-to/reasoner.md", "mine.py")}

PAGES: Mapping[str, Page] = {
    "CONTRIBUTING.md": Page(
        blocks={
            "make setup": NotRun(because="made what these tests run in"),
            "make test": NotRun(because="runs these tests"),
            "make help": Comes(says=(r"^  make test +\S", r"^  make test-system +\S")),
            "text 1": NotRun(because="the layers: import-linter holds them"),
        }
    ),
    "README.md": Page(
        blocks={
            ". .venv/bin/activate": NotRun(because="these tests run in it"),
            "make run": Comes(less="-n", says=(r"pliant run --peg circle .*--seed 1",)),
            "make test": NotRun(because="runs these tests"),
            "pliant run --peg square --condition all --seed 4": Comes(
                says=INSERTED,
                makes=(
                    "runs/L0-square-all-rules-4/trials/*/index.html",
                    "runs/L0-square-all-rules-4/trials/*/*.mp4",
                ),
                slow=True,
            ),
            "pliant experiment --pegs circle square --reasoners none rules --trials 10"
            " --save failures": Comes(
                says=(
                    r"\| circle \| all \| rules \| 10 \| 100\.0",
                    r"\| square \| all \| none \| 10 \|",
                    "results: runs/experiment",
                ),
                makes=("runs/experiment/trials.parquet",),
                slow=True,
            ),
            "pliant view runs/experiment": Comes(
                says=(r"\d pages of trials made", "runs/experiment/index.html"),
                makes=("runs/experiment/trials/L0-circle-all-none-*/index.html",),
                slow=True,
            ),
            "pliant tables runs/experiment": Comes(
                says=(r"\| circle \| all \| rules \| 10 \|",), slow=True
            ),
            "pliant export runs/experiment --lerobot data": Comes(
                says=(r"LeRobot: data: \d+ train, \d+ test episodes",),
                makes=("data/meta/executions.parquet", "data/videos/*/*/*.mp4"),
                slow=True,
            ),
            "pliant experiment --pegs circle square --reasoners none rules retry"
            " --trials 20": Comes(
                says=(
                    "resuming: 40 of 120 trials are there",
                    r"\| square \| all \| retry \| 20 \|",
                ),
                slow=True,
            ),
            "python 1": Comes(
                says=(r"^approach True ", r"^fit False ", r"^inserted True$"), then=is_inserted
            ),
            "text 1": PICTURE,
            "text 2": Comes(then=paths_are_there),
        }
    ),
    "docs/speed.md": Page(
        blocks={
            "python benchmarks/paired.py ../other": Elsewhere(
                test="test_benchmarks.py", word='"benchmarks" / "paired.py"'
            ),
            "text 1": NotRun(because="a machine's own times"),
            "text 2": NotRun(because="a machine's own times"),
        }
    ),
    "docs/bench-reasoner.md": Page(
        takes={"my_reasoner.py": ("docs/how-to/reasoner.md", "mine.py")},
        blocks={
            "pliant bench-reasoner rules messages coin": Comes(
                less="--limit 10", says=(r"^\| rules \| 10 \|", r"^\| messages \| 10 \|")
            ),
            "pliant bench-reasoner rules vlm --model openai:gpt-4o": HOSTED,
            "pliant bench-reasoner vlm --base-url http://localhost:8000/v1"
            " --model NAME --limit 40": SERVER,
            "pliant bench-reasoner my_reasoner.py:Mine --out mine.json": Comes(
                less="--limit 10",
                says=(r"^\| my_reasoner\.py:Mine \| 10 \|",),
                makes=("mine.json",),
            ),
        },
    ),
    "docs/contact.md": Page(
        blocks={
            "pytest tests/test_sim_model.py tests/test_pegs.py -s -k 'play or"
            " room or sinks'": Comes(
                less="--collect-only -q -n 0",
                says=(r"^tests/test_pegs\.py: \d+$", r"^tests/test_sim_model\.py: \d+$"),
                slow=True,
            ),
        }
    ),
    "docs/data.md": Page(
        prepared=with_table2,
        blocks={
            "python 1": Comes(says=("inserted_mean",), slow=True),
            "python 2": Comes(makes=("trials.csv",), then=is_csv),
            "sql 1": Comes(says=("first_step",), slow=True),
            "python 3": Comes(says=("drawn_grasp_roll",), slow=True),
        },
    ),
    "docs/datasets.md": Page(
        blocks={
            "pliant experiment --pegs circle square --trials 30 --save all --out runs/mine": Comes(
                less="--trials 2 --workers 1 --first-seed 5",
                says=("results: runs/mine",),
                slow=True,
            ),
            "pliant export runs/mine --lerobot exports/lerobot --failure-qa"
            " exports/failure-qa": Comes(
                less="--fps 2",
                says=(r"failure QA: .*: \d+ train, \d+ test questions", "2 train, 2 test episodes"),
                makes=("exports/lerobot/README.md", "exports/failure-qa/train.jsonl"),
                slow=True,
            ),
            "pliant export runs/mine --chat exports/chat": Comes(
                says=(r"chat: .*: \d+ train, \d+ test conversations",),
                makes=("exports/chat/README.md", "exports/chat/train.jsonl"),
                slow=True,
            ),
            "pliant export runs/mine --rerun exports/trial.rrd --trial"
            " L0-circle-all-rules-6": Comes(
                less="--fps 1", makes=("exports/trial.rrd",), slow=True
            ),
            "python 1": Comes(says=(r"^L0-\S+ \S+ \[.*\] \(480, 640, 3\)$",), slow=True),
            "python 2": NotRun(because="lerobot comes with PyTorch: reproduce/lerobot_reader.sh"),
            "python 3": Comes(says=(r"^exports/failure-qa/\S+\.png",), slow=True),
            "python 4": Comes(says=(r"^\w+ exports/chat/pictures/\S+\.png \{",), slow=True),
        }
    ),
    "docs/emulator.md": Page(
        blocks={
            "pip install '.[ur5e]'": NotRun(because="brings an extra: tools/smoke_extras.sh does"),
            "python -m pliant.emulator": Elsewhere(
                test="test_emulator_ur_rtde.py", word="pliant.emulator"
            ),
            "python 1": Elsewhere(test="test_emulator_ur_rtde.py", word="emulator.md"),
            "python 2": Comes(says=(r"^\d+\.\d+ \(",), slow=True),
            "yaml 1": Comes(then=are_faults),
        }
    ),
    "docs/environments.md": Page(
        blocks={
            "pip install '.[gym]'": NotRun(because="brings an extra: tools/smoke_extras.sh does"),
            "python 1": Comes(then=is_a_step),
        }
    ),
    "docs/how-to/cell.md": Page(
        blocks={
            "pliant run --cell noisy.py:NoisyCell": Comes(says=INSERTED),
            "pliant experiment --cell noisy.py:NoisyCell --trials 20 --out runs/noisy": Comes(
                less="--trials 1", says=(r"\| circle \| all \| rules \| 1 \| 100\.0",)
            ),
            "noisy.py": Comes(),
        }
    ),
    "docs/how-to/command-line.md": Page(
        blocks={
            "pliant run --help": Comes(says=("^what is tried:", r"--hole-y-mm MIN MAX")),
            "pliant run --peg sqare": Comes(says=("did you mean 'square'",), status=2),
            "pliant run --vidoe": Comes(says=("did you mean '--video'",), status=2),
            "pliant --tyro-print-completion bash": SHELLS,
            "pliant --tyro-print-completion zsh": SHELLS,
            "python -m pliant --version": Comes(says=(r"^pliant \d+\.\d+",)),
        }
    ),
    "docs/how-to/experiments.md": Page(
        blocks={
            "pliant experiment --pegs circle square --conditions friction all --reasoners none"
            " rules --trials 20 --out runs/mine": Comes(
                less=ONE, says=(r"\| square \| all \| rules \| 1 \| 100\.0",), slow=True
            ),
            "pliant experiment --pegs circle square --conditions friction all --reasoners none"
            " rules retry --trials 30 --out runs/mine": Comes(
                less="--trials 2 --workers 1",
                says=("resuming: 8 of 24", r"\| square \| all \| retry \| 2 \|"),
                slow=True,
            ),
            "mine.yaml": Comes(then=is_planned(110)),
            "pliant experiment mine.yaml --out runs/from-file": Comes(
                less=ONE,
                says=(
                    r"\| rectangle \| all \| messages \| 1 \|",
                    r"\| circle \| far \| rules \| 1 \|",
                ),
                slow=True,
            ),
            "pliant experiment mine.yaml --out runs/from-file --again faults": Comes(
                less=ONE, says=("results: runs/from-file",), slow=True
            ),
            "pliant tables runs/mine": Comes(
                says=(r"\| circle \| friction \| none \| 2 \|",), slow=True
            ),
            "pliant view runs/mine": Comes(makes=("runs/mine/index.html",), slow=True),
            "python 1": Comes(
                says=(r"'reasoner': 'rules', 'seed': 2, 'inserted': True",),
                makes=("runs/from-python/trials.parquet",),
                slow=True,
            ),
            "python 2": Comes(makes=("last.png",), then=is_a_picture),
        }
    ),
    "docs/how-to/peg.md": Page(
        prepared=with_own_goals,
        blocks={
            "my_peg.yaml": Comes(then=inserts),
            "pliant run --peg my_peg.yaml": Comes(less="--no-video", says=INSERTED),
            "pliant experiment --pegs circle my_peg.yaml --conditions all --reasoners none rules"
            " --trials 10 --out runs/pegs": Comes(
                less=ONE, says=(r"\| my_peg \| all \| rules \| 1 \| 100\.0",), slow=True
            ),
            "keyway.yaml": Comes(then=inserts),
            "pliant run --peg my_peg.yaml --goals my_goals/goals.yaml": Comes(
                less="--no-video", says=INSERTED
            ),
            "python 1": Comes(says=("^inserted True$",), then=is_inserted),
        },
    ),
    "docs/architecture.md": Page(
        blocks={"text 1": NotRun(because="the layers: test_methods.py holds them")},
    ),
    "docs/how-to/method.md": Page(
        blocks={
            "pliant run --method slow.py:Slow": Comes(less="--no-video", says=INSERTED),
            "pliant experiment --method slow.py:Slow --trials 20 --out runs/slow": Comes(
                less=ONE, says=(r"slow\.py:Slow",), makes=("runs/slow/trials.parquet",), slow=True
            ),
            "slow.py": Comes(),
        }
    ),
    "docs/how-to/providers.md": Page(
        blocks={
            "pliant run --reasoner vlm --model anthropic:claude-opus-5 --effort low": HOSTED,
        }
    ),
    "docs/how-to/reasoner.md": Page(
        blocks={
            "pliant run --reasoner mine.py:Mine": Comes(
                less="--no-video", says=(*INSERTED, r"how +fit again, [+-]8 mm")
            ),
            "pliant experiment --reasoners rules mine.py:Mine --trials 20 --out runs/mine": Comes(
                less=ONE, says=(r"\| circle \| all \| mine\.py:Mine \| 1 \|",), slow=True
            ),
            "pliant bench-reasoner rules mine.py:Mine": Comes(
                less="--limit 10", says=(r"^\| mine\.py:Mine \| 10 \|",)
            ),
            "mine.py": Comes(),
            "gives_up.py": Comes(),
            "pliant run --level blocked_hole --peg square --seed 3 --method planar --reasoner"
            " gives_up.py:GivesUp": Comes(
                less="--no-video",
                says=("how +stop, and let somebody look$", r"^stopped: 12 executions"),
                status=1,
            ),
            "asks.py": Comes(),
            "pliant run --level flush_plug --peg square --seed 3 --reasoner asks.py:Asks": Comes(
                less="--no-video",
                says=("^stopped: 3 executions", "why +in the hole the peg was felt"),
                status=1,
            ),
            "text 1": Comes(
                then=is_shown_by(
                    "pliant run --level flush_plug --peg square --seed 3 --reasoner asks.py:Asks"
                )
            ),
        }
    ),
    "docs/index.md": Page(
        blocks={
            "pip install .": INSTALLS,
            "pliant run": Elsewhere(test="shown.py", word='"pliant run": Comes'),
        }
    ),
    "docs/ladder.md": Page(
        takes=MINE,
        blocks={
            "pliant experiment --level L4 --trials 67 --first-seed 50001 --out runs/L4": Comes(
                less=f"{ONE} --pegs circle", says=(r"\| L4 \| guided \| rules \|",), slow=True
            ),
            "pliant tables runs/L4": Comes(says=(r"\| L4 \| guided \| rules \|",), slow=True),
            "pliant run --level L6+ --peg square --seed 9002": Comes(
                less="--no-video", says=INSERTED, slow=True
            ),
            "pliant experiment --level L4 --reasoners rules mine.py:Mine --trials 67 --first-seed"
            " 50001 --out runs/mine": Comes(
                less=f"{ONE} --pegs circle",
                says=(r"\| L4 \| guided \| mine\.py:Mine \|",),
                slow=True,
            ),
            "python reproduce/ladder.py mine.json runs/mine": Comes(
                says=("mine.json: 2 rows",), makes=("mine.json",), slow=True
            ),
        },
    ),
    "docs/loop.md": Page(
        blocks={
            "text 1": PICTURE,
            "python 1": Comes(says=("^approach True -", "^insertion True 0.02", "^inserted$")),
        }
    ),
    "docs/prompts.md": Page(
        blocks={
            f"text {n}": Elsewhere(test="test_prompts_page.py", word="write_prompts")
            for n in range(1, 68)
        }
    ),
    "docs/real-cell.md": Page(
        blocks={
            "python -c \"from importlib.resources import files; print((files('pliant') /"
            " 'ur5e/example.yaml').read_text(), end='')\" > cell.yaml": Comes(then=is_the_example),
            "pliant calibrate --cell cell.yaml": Elsewhere(
                test="test_calibrate_emulated.py", word="calibrate("
            ),
            "pliant calibrate camera --cell cell.yaml": Elsewhere(
                test="test_calibration.py", word="calibrate("
            ),
            "reproduce/table4.sh cell.yaml": REAL,
        }
    ),
    "docs/scenarios.md": Page(
        takes=MINE,
        blocks={
            "pliant run --level blocked_hole --peg square --seed 3": Comes(
                less="--no-video --method planar",
                says=("^not inserted .*judged no", "^cap: 40 executions"),
                status=1,
                slow=True,
            ),
            "pliant experiment --level bar_across --reasoners rules mine.py:Mine --trials 4 --out"
            " runs/bar_across": Comes(
                less=f"{ONE} --pegs circle --method planar",
                says=(r"\| bar_across \| rules \| stop \|",),
                slow=True,
            ),
            "pliant experiment --level wrong_peg --reasoners vlm --model openai:gpt-4o --trials 4"
            " --out runs/vlm": HOSTED,
        },
    ),
    "docs/start.md": Page(
        blocks={
            "python3 -m venv venv": INSTALLS,
            ". venv/bin/activate": INSTALLS,
            "pip install .": INSTALLS,
            "pliant run": Comes(less="--no-video", says=INSERTED),
            "text 1": Comes(then=is_shown_by("pliant run")),
            "pliant experiment --pegs circle --conditions all --reasoners rules retry --trials 5"
            " --save failures --out runs/first": Comes(
                less=ONE, says=(r"\| circle \| all \| rules \| 1 \| 100\.0",), slow=True
            ),
            "pliant view runs/first": Comes(makes=("runs/first/index.html",), slow=True),
            "seen_hole.py": Comes(),
            "pliant run --reasoner seen_hole.py:SeenHole": Comes(
                less="--no-video", says=(*INSERTED, "how +lift, touch down before the hole")
            ),
            "pliant experiment --pegs circle --conditions all --reasoners rules"
            " seen_hole.py:SeenHole --trials 5 --out runs/mine": Comes(
                less=ONE,
                says=(r"\| circle \| all \| seen_hole\.py:SeenHole \| 1 \| 100\.0",),
                slow=True,
            ),
        }
    ),
    "docs/teaching.md": Page(
        blocks={
            "pliant teach --cell cell.yaml --goals goals/lab/goals.yaml": Elsewhere(
                test="test_teach_emulated.py", word="teach"
            ),
            "pliant run --cell cell.yaml --goals goals/lab/goals.yaml --condition none": Elsewhere(
                test="test_teach_emulated.py", word="run"
            ),
            "pliant check-cell --cell cell.yaml": Elsewhere(
                test="test_check_cell.py", word="check-cell"
            ),
            "pliant run --cell cell.yaml --dry-run": Elsewhere(
                test="test_check_cell_rehearsal.py", word="dry"
            ),
            "pliant run --cell cell.yaml --air": Elsewhere(
                test="test_check_cell_rehearsal.py", word="air"
            ),
        }
    ),
    "docs/tutorials/first-peg.md": Page(
        blocks={
            "keyed_plug.yaml": Comes(then=inserts),
            "pliant run --peg keyed_plug.yaml": Comes(less="--no-video", says=INSERTED),
            "text 1": Comes(then=is_shown_by("pliant run --peg keyed_plug.yaml")),
            "pliant experiment --pegs keyed_plug.yaml --reasoners none rules --trials 10"
            " --save failures --out runs/plug": Comes(
                says=(
                    r"\| keyed_plug \| all \| none \| 10 \| 20\.0 .*\| 20\.0 ",
                    r"\| keyed_plug \| all \| rules \| 10 \| 100\.0 .*\| 100\.0 ",
                ),
                slow=True,
            ),
            "pliant view runs/plug": Comes(
                makes=("runs/plug/trials/L0-keyed_plug-all-none-*/index.html",), slow=True
            ),
        }
    ),
    "docs/tutorials/own-robot.md": Page(
        prepared=in_a_checkout,
        blocks={
            "loud.py": Comes(),
            "test_loud.py": Comes(),
            "pliant run --cell loud.py:LoudCell --dry-run": Comes(
                says=(r"^insertion .* 167\.6 ", r"^retreat, fit "),
            ),
            "pliant run --cell loud.py:LoudCell --air": Comes(says=("^all in free air$",)),
            "PYTHONPATH=tests:. python -m pytest test_loud.py": Comes(
                less="-q -p no:cacheprovider", says=(r"^1\d passed",)
            ),
            "pliant run --cell loud.py:LoudCell": Comes(
                says=(*INSERTED, r"^moved to y \+26\.0, z 21\d\.\d mm: reached$")
            ),
            "python -m pliant.emulator --client-patience 20": EMULATED,
            "python 1": EMULATED,
            "pliant check-cell --cell cell.yaml": EMULATED,
            "pliant run --cell cell.yaml --dry-run": EMULATED,
            "pliant run --cell cell.yaml --air": EMULATED,
            "pliant run --cell cell.yaml --condition none": EMULATED,
            "text 1": EMULATED,
        },
    ),
    "docs/vlm.md": Page(
        blocks={
            "make dist": NotRun(because="tools/smoke_wheel.sh does the same elsewhere"),
            "pip install --find-links dist 'pliant[local]'": NotRun(
                because="brings an extra: tools/smoke_extras.sh does"
            ),
            "pliant run --reasoner vlm": Elsewhere(
                test="test_vlm_local.py", word='"run", "--reasoner", "vlm"'
            ),
            "pliant serve-model": Elsewhere(test="test_vlm_local.py", word='"serve-model"'),
            "pip install '.[vlm]'": NotRun(because="brings an extra: tools/smoke_extras.sh does"),
            "export OPENAI_API_KEY=…": HOSTED,
            "pliant run --reasoner vlm --model openai:gpt-4o": HOSTED,
            "pliant run --reasoner vlm --base-url http://localhost:8000/v1 --model"
            " Qwen2.5-VL-7B-Instruct": SERVER,
            "yaml 1": Comes(then=is_planned(17 * 30)),
            "pliant run --reasoner vlm --model openai:gpt-4o --seed 3 --record talk.jsonl": HOSTED,
            "pliant run --reasoner vlm --seed 3 --replay talk.jsonl": Elsewhere(
                test="test_vlm_local_model.py", word="--replay"
            ),
        }
    ),
}
