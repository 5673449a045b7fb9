"""The command line: the only place that chooses a cell and a reasoner. One file per command."""

import re
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial, wraps
from importlib.metadata import version
from typing import Any

import tyro

from pliant import signals
from pliant.cli import usages
from pliant.cli.bench_reasoner import bench_reasoner
from pliant.cli.calibrate import calibrate
from pliant.cli.check_cell import check_cell
from pliant.cli.experiment import experiment
from pliant.cli.export import export
from pliant.cli.label import label
from pliant.cli.run import run
from pliant.cli.serve_model import serve_model
from pliant.cli.tables import tables
from pliant.cli.teach import teach
from pliant.cli.view import view
from pliant.console import say
from pliant.ending import in_a_line
from pliant.errors import unknown
from pliant.paths import current_folder, expanded
from pliant.text import replace_unshowable
from pliant.usage import HELP, Usage, page, refuse_repeats, taken

_DESCRIPTION = "Robust and resilient object insertion with a soft robotic wrist."
_BEYOND = (
    "pliant COMMAND --help   its options, with examples\n"
    "pliant --version        which version this is\n"
    "pliant --tyro-print-completion bash   completion for the shell (bash, zsh or tcsh):\n"
    "                        docs/how-to/command-line.md says where to put it"
)

COMMANDS: Mapping[str, tuple[Callable[..., Any], Usage]] = {
    "run": (run, usages.RUN),
    "experiment": (experiment, usages.EXPERIMENT),
    "view": (view, usages.VIEW),
    "tables": (tables, usages.TABLES),
    "export": (export, usages.EXPORT),
    "bench-reasoner": (bench_reasoner, usages.BENCH_REASONER),
    "serve-model": (serve_model, usages.SERVE_MODEL),
    "label": (label, usages.LABEL),
    "calibrate": (calibrate, usages.CALIBRATE),
    "check-cell": (check_cell, usages.CHECK_CELL),
    "teach": (teach, usages.TEACH),
}
"""Every command by its name: what does it, and what its page of help says beside the options."""


def main() -> None:
    """Run the command line and exit with a status: 0 inserted or done; 1 not inserted, not
    complete, or faults among the trials; 2 wrong usage, something of the machine in the way, or
    nothing but faults; where a signal ended it, that of the signal: 130 for Ctrl-C. Status 3: a
    model was asked, and decided nothing.
    """
    signals.heed()
    replace_unshowable(sys.stdout, sys.stderr)
    with in_a_line("pliant"):
        _called()


def parsed(words: Sequence[str]) -> Callable[[], int | None]:
    """What a command line, without the program's name, asks for: call it to have it done.

    Raises:
        InputError: there is no such command or option, or a value cannot be one of it.
        SystemExit: a page of help, or a shell's completion, was asked for and shown.
    """
    if not words or words[0] in HELP:
        say(_overview())
        sys.exit(0 if words else 2)
    name = words[0]
    if not name.startswith("--tyro-"):  # its completions for a shell know all commands
        if name not in COMMANDS:
            raise unknown("command", name, COMMANDS)
        if any(word in HELP for word in words):
            say(page(f"pliant {name}", *COMMANDS[name]))
            sys.exit(0)
    ready = {key: _deferred(command) for key, (command, _) in COMMANDS.items()}
    return taken(
        words,
        COMMANDS[name][0] if name in COMMANDS else main,
        lambda: tyro.extras.subcommand_cli_from_dict(ready, prog="pliant", args=list(words)),
        f"pliant {name}",
    )


def _deferred(command: Callable[..., Any]) -> Callable[..., Callable[[], Any]]:
    @wraps(command)
    def later(*args: Any, **options: Any) -> Callable[[], Any]:
        return partial(command, *args, **options)

    return later


def _overview() -> str:
    lines = ["usage: pliant COMMAND [options]", "", _DESCRIPTION, ""]
    for name, (command, _) in COMMANDS.items():
        first = re.split(r"[.:,;(]", command.__doc__ or "")[0]
        lines.append(f"  {name:<16}{' '.join(first.split())}")
    return "\n".join([*lines, "", _BEYOND])


def _called() -> None:
    if sys.argv[1:] == ["--version"]:
        say(f"pliant {version('pliant')}")
        return
    current_folder()  # what is started from one that is gone fails somewhere deep
    words = [expanded(word) for word in sys.argv[1:]]
    if words and words[0] in COMMANDS and not any(word in HELP for word in words):
        refuse_repeats(words, COMMANDS[words[0]][0])
    sys.exit(parsed(words)())
