"""The command line: the only place that chooses a cell and a reasoner. One file per command."""

import os
import re
import sys
from contextlib import suppress
from importlib.metadata import version
from typing import NoReturn

import tyro

from pliant import signals
from pliant.cli.bench_reasoner import bench_reasoner
from pliant.cli.calibrate import calibrate
from pliant.cli.check_cell import check_cell
from pliant.cli.experiment import experiment
from pliant.cli.export import export
from pliant.cli.label import label
from pliant.cli.model import with_preset
from pliant.cli.run import run
from pliant.cli.tables import tables
from pliant.cli.teach import teach
from pliant.cli.view import view
from pliant.console import complain, say
from pliant.errors import PliantError
from pliant.paths import current_folder, shortened
from pliant.text import replace_unshowable

_DESCRIPTION = (
    "Robust and resilient object insertion with a soft robotic wrist. `pliant --version` says which"
    " version this is."
)


def main() -> None:
    """Run the command line and exit with a status: 0 inserted or done; 1 not inserted, not
    complete, or faults among the trials; 2 wrong usage, something of the machine in the way, or
    nothing but faults; where a signal ended it, that of the signal: 130 for Ctrl-C. Status 3: a
    model was asked, and decided nothing.
    """
    signals.heed()
    replace_unshowable(sys.stdout, sys.stderr)
    try:
        _called()
    except PliantError as error:
        _leave(2, shortened(str(error)))
    except UnicodeEncodeError as error:  # the streams replace, so it is a file's name
        _leave(
            2,
            f"a file's name has {error.object[error.start : error.end]!r}, which the locale's"
            f" encoding, {error.encoding}, lacks: set PYTHONUTF8=1",
        )
    except BrokenPipeError:  # whoever reads, such as head, has seen enough
        _silence()
        sys.exit(1)
    except OSError as error:  # a full disk or terminal, a folder that may not be read
        _silence()
        what = f"'{error.filename}'" if error.filename else "the output"
        _leave(2, f"{what} cannot be used: {error.strerror or error}")
    except MemoryError:
        _leave(2, "out of memory: end other programs, or raise the limit (ulimit -v)")
    except KeyboardInterrupt as stop:
        signals.ignore()  # who presses Ctrl-C again is not to take the exit status away
        _leave(signals.exit_status(), shortened(": ".join(["interrupted", *map(str, stop.args)])))


def _called() -> None:
    try:
        if sys.argv[1:] == ["--version"]:
            say(f"pliant {version('pliant')}")
            return
        current_folder()  # what is started from one that is gone fails somewhere deep
        sys.exit(
            tyro.extras.subcommand_cli_from_dict(
                {
                    "run": run,
                    "experiment": experiment,
                    "label": label,
                    "tables": tables,
                    "teach": teach,
                    "calibrate": calibrate,
                    "check-cell": check_cell,
                    "view": view,
                    "export": export,
                    "bench-reasoner": bench_reasoner,
                },
                prog="pliant",
                args=with_preset([_expanded(word) for word in sys.argv[1:]]),
                description=_DESCRIPTION,
            )
        )
    finally:  # what cannot be shown is found out here, and not as the program ends
        sys.stdout.flush()


def _leave(status: int, said: str) -> NoReturn:
    with suppress(OSError):
        complain(f"pliant: {said}")
    sys.exit(status)


def _silence() -> None:
    """Write nothing more to standard output, also not as the program ends."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _expanded(word: str) -> str:
    """A word with the home folder for `~`, which shells leave as it is in `--out=~/runs`."""
    option, path = re.fullmatch(r"(--[\w-]+=)?(.*)", word, re.DOTALL).groups("")  # type: ignore[union-attr]
    return option + os.path.expanduser(path)  # noqa: PTH111, a word need not be a path
