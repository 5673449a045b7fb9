"""`pliant tables`: the paper's tables, and pliant's own, from a finished experiment."""

import json as json_format
from pathlib import Path
from typing import Annotated

import tyro

from pliant import folders, store
from pliant.console import complain, say
from pliant.errors import InputError
from pliant.experiment import tables as made
from pliant.experiment.tables_text import markdown


def tables(folder: Annotated[Path, tyro.conf.Positional], *, json: bool = False) -> int:
    """Print the tables of a finished experiment as Markdown, and write them beside its data. A
    folder that cannot be written is shown all the same.

    Args:
        folder: the result folder of `pliant experiment`.
        json: print JSON instead.
    """
    document = made_of(folder)
    say(json_format.dumps(document, indent=1) if json else markdown(document))
    return 0


def made_of(folder: Path) -> made.Document:
    """Write an experiment's tables beside its data, or one line on standard error why not; return
    them.

    Raises:
        InputError: the results are missing or broken, or the folder holds a link.
    """
    folders.refuse_links(folder, but=(store.TRIALS,))
    document = made.build(folder)
    try:
        made.keep(folder, document)
    except InputError as error:
        complain(f"pliant: shown only: {error}")
    return document
