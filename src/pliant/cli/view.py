"""`pliant view`: the pages of an experiment or a run, to open from the disk or to be served."""

import os
import tempfile
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro
from rich.text import Text

from pliant import folders, store, teaching
from pliant.cli.steps import counted
from pliant.console import Console, say
from pliant.errors import InputError
from pliant.paths import located


def view(
    folder: Annotated[Path, tyro.conf.Positional],
    *,
    video: bool = False,
    goals: Path | None = None,
    out: Path | None = None,
    serve: bool = False,
    port: int = 0,
) -> int:
    """Make the pages of an experiment and of each trial whose record was kept; those that are up
    to date stay. An experiment that still runs is shown as far as it is.

    Args:
        folder: the result folder of `pliant experiment` or `pliant run`, or one trial's in it.
        video: also draw the videos that are missing, about ten seconds each.
        goals: the taught goals file that the trials used, if it was not the shipped one.
        out: put a copy of the results with its pages into this new folder, and leave the results as
            they are; default, where they cannot be written, a temporary folder.
        serve: then serve the folder, and nothing else, to browsers on this machine, and go on with
            the pages while the experiment runs; Ctrl-C ends it.
        port: of --serve; 0 takes a free one.
    """
    from pliant.cli.following import followed
    from pliant.report.serve import Server
    from pliant.report.trial import run_of
    from pliant.report.view import view as make

    teachings = [teaching.shipped(), *([] if goals is None else [teaching.load(goals)])]
    server = None
    if serve:
        run = run_of(folder) if (folder / store.TRIAL).is_file() else None
        if run is not None:
            raise InputError(f"'{folder}' shares files with its run: serve '{run}' instead")
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    folder = _place(folder, out, console)
    if serve:
        server = Server(folder, port)  # a port that is taken is said at once
    with counted("pages") as steps:
        viewed = make(folder, teachings, film=video, progress=steps.tell)
    for problem in viewed.problems:
        console.print(Text(f"no page: {problem}"))
    if viewed.without_goals:
        console.print(
            Text(
                f"{viewed.without_goals} trials had other goals than the shipped ones: --goals FILE"
                " shows their goal pictures"
            )
        )
    console.print(Text(f"{viewed.made} pages of trials made, {viewed.kept} up to date"))
    say(str(viewed.page))
    if server is not None:
        with suppress(KeyboardInterrupt), followed(folder, partial(make, folder, teachings)):
            console.print(Text(f"serving '{folder}' at {server.address} until Ctrl-C"))
            server.run()
    return 1 if viewed.problems else 0


def _place(folder: Path, out: Path | None, console: Console) -> Path:
    """The folder that the pages go into: that of the results, or a copy of it where these are not
    to be touched, or cannot be.

    Raises:
        InputError: the copy cannot be made.
    """
    if out is not None:
        copy = located(out)
    elif not folder.is_dir() or os.access(folder, os.W_OK):
        return folder
    else:
        copy = Path(tempfile.mkdtemp(prefix="pliant-")) / folder.resolve().name
        console.print(
            Text(f"'{folder}' cannot be written: the pages are made in '{copy}' (--out chooses)")
        )
    folders.copy(folder, copy)
    return copy
