"""`pliant tables`: the paper's tables, and pliant's own, from a finished experiment."""

import json as json_format
from collections.abc import Container
from pathlib import Path
from typing import Annotated

import tyro

from pliant import folders, store
from pliant.console import complain, say
from pliant.errors import InputError
from pliant.experiment import journal, results
from pliant.experiment import tables as made
from pliant.experiment.tables_text import markdown
from pliant.report import summary


def tables(folder: Annotated[Path, tyro.conf.Positional], *, json: bool = False) -> int:
    """Print the tables of an experiment as Markdown, and write them beside its data. One that still
    runs is shown as far as it is, and a folder that cannot be written all the same.

    Args:
        folder: the result folder of `pliant experiment`.
        json: print JSON instead.
    """
    document = made_of(folder)
    say(json_format.dumps(document, indent=1) if json else markdown(document))
    return 0


def made_of(folder: Path, part: Container[str] | None = None) -> made.Document:
    """Write an experiment's tables beside its data, or one line on standard error why not; return
    them, or those of a `part` of its trials. Of one that is not finished nothing is written.

    Raises:
        InputError: the results are missing or broken, or the folder holds a link.
    """
    results.see_results(folder)
    folders.refuse_links(folder, but=(store.TRIALS,))
    if not (folder / results.TRIALS_FILE).is_file() and (folder / journal.FILE).is_file():
        so_far = summary.read(folder)
        complain(f"pliant: so far: {len(so_far.trials)} of {so_far.planned} trials")
        return dict(so_far.tables)
    document = made.build(folder)
    try:
        made.keep(folder, document)
    except InputError as error:
        complain(f"pliant: shown only: {error}")
    return document if part is None else made.build(folder, part)
