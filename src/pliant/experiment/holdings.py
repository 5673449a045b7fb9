"""What a result folder holds: which experiment it belongs to, and how another may add to it."""

import json
from pathlib import Path
from typing import Any

from pliant import store
from pliant.errors import InputError
from pliant.experiment import growth, journal, results
from pliant.experiment.cells import Experiment
from pliant.files import write_json


def prepare(experiment: Experiment, folder: Path, *, grows: bool = False) -> None:
    """Make the output folder, with run.json; or see that it belongs to this experiment, or, where
    it `grows`, that this one adds to what it holds: then run.json says so from here on.

    Raises:
        InputError: it holds something else, or results of another configuration, or another run
            is writing to it.
    """
    store.prepare_folder(folder)
    document = growth.fingerprinted(experiment.document)
    run_file = folder / store.RUN
    if not run_file.exists():
        with journal.Journal(folder / journal.FILE):  # of several that start together, one
            if not run_file.exists():
                store.write_run_json(folder, configuration=document, **_minds(experiment))
    before = held(folder)
    if before.get("fingerprint") == document["fingerprint"]:
        return
    if not grows and (holds := growth.planned(before)) > len(experiment):
        raise InputError(
            f"output folder '{folder}' holds an experiment of {holds} trials, whose tables a single"
            " trial would replace: choose another folder (--out), or add to it with `pliant"
            " experiment`"
        )
    after = growth.grown(before, document, folder)
    if after is before:
        return
    if not grows:
        raise InputError(
            f"output folder '{folder}' holds another trial: choose another folder, or remove it"
        )
    with journal.Journal(folder / journal.FILE):
        run = json.loads(run_file.read_bytes())
        after = growth.grown(held(folder), document, folder)
        for name, value in _minds(experiment).items():
            named = [n for text in (run.get(name), value) if text for n in text.split(", ")]
            run[name] = ", ".join(dict.fromkeys(named)) or None
        run["configuration"] = after
        write_json(run_file, run, indent=2)
        for name in (results.TRIALS_FILE, results.EXECUTIONS_FILE):  # written again in the end
            (folder / name).unlink(missing_ok=True)


def _minds(experiment: Experiment) -> dict[str, Any]:
    reasoners = dict.fromkeys(c.names[-1] for c in experiment.cells)
    models = ", ".join(dict.fromkeys(experiment.models))
    return {"reasoner": ", ".join(reasoners), "model": models or None}


def may_hold(experiment: Experiment, folder: Path) -> bool:
    """Whether a folder holds nothing yet, or results of this very experiment."""
    if not (folder / store.RUN).exists():
        return store.is_unused(folder)
    return bool(held(folder).get("fingerprint") == experiment.fingerprint)


def held(folder: Path) -> growth.Document:
    """The document of what a result folder holds, of all calls that added to it.

    Raises:
        InputError: run.json is broken, or of no experiment.
    """
    run_file = folder / store.RUN
    try:
        configuration = json.loads(run_file.read_bytes())["configuration"]
        for cell in configuration["cells"]:
            growth.seeds(configuration, cell), growth.names(cell)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"'{run_file}' is broken ({error}): choose another folder, or remove this one"
        ) from error
    return configuration
