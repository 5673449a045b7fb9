"""`pliant tables`: the paper's tables, and pliant's own, from a finished experiment."""

import json as json_format
from pathlib import Path
from typing import Annotated

import tyro

from pliant.console import say
from pliant.experiment import tables as made
from pliant.experiment.tables_text import markdown


def tables(folder: Annotated[Path, tyro.conf.Positional], *, json: bool = False) -> int:
    """Print the tables of a finished experiment as Markdown, and write them beside its data.

    Args:
        folder: the result folder of `pliant experiment`.
        json: print JSON instead.
    """
    document = made.write(folder)
    say(json_format.dumps(document, indent=1) if json else markdown(document))
    return 0
