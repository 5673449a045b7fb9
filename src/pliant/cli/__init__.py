"""The command line: the only place that chooses a cell and a reasoner. One file per command."""

import os
import re
import sys

import tyro

from pliant.cli.bench_reasoner import bench_reasoner
from pliant.cli.calibrate import calibrate
from pliant.cli.check_cell import check_cell
from pliant.cli.experiment import experiment
from pliant.cli.export import export
from pliant.cli.label import label
from pliant.cli.run import run
from pliant.cli.tables import tables
from pliant.cli.teach import teach
from pliant.cli.view import view
from pliant.console import complain
from pliant.errors import PliantError
from pliant.paths import current_folder, shortened
from pliant.text import replace_unshowable

_DESCRIPTION = "Robust and resilient object insertion with a soft robotic wrist."


def main() -> None:
    """Exit status: 0 inserted or done, 1 not inserted or not complete, 2 wrong usage."""
    replace_unshowable(sys.stdout, sys.stderr)
    try:
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
                args=[_expanded(word) for word in sys.argv[1:]],
                description=_DESCRIPTION,
            )
        )
    except PliantError as error:
        complain(f"pliant: {shortened(str(error))}")
        sys.exit(2)
    except UnicodeEncodeError as error:  # the streams replace, so it is a file's name
        complain(
            f"pliant: a file's name has {error.object[error.start : error.end]!r}, which the"
            f" locale's encoding, {error.encoding}, lacks: set PYTHONUTF8=1"
        )
        sys.exit(2)
    except BrokenPipeError:  # whoever reads, such as head, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except KeyboardInterrupt as stop:
        said = ": ".join(["pliant: interrupted", *map(str, stop.args)])
        complain(shortened(said))
        sys.exit(130)


def _expanded(word: str) -> str:
    """A word with the home folder for `~`, which shells leave as it is in `--out=~/runs`."""
    option, path = re.fullmatch(r"(--[\w-]+=)?(.*)", word, re.DOTALL).groups("")  # type: ignore[union-attr]
    return option + os.path.expanduser(path)  # noqa: PTH111, a word need not be a path
