"""Labels that a person gives after the experiment: journal, records and Parquet files agree."""

from collections.abc import Callable
from pathlib import Path

from pliant import folders, store
from pliant.errors import InputError
from pliant.experiment import journal, results
from pliant.experiment.attended import labelled, last_picture
from pliant.experiment.rows import rows_of
from pliant.records import Trial

Ask = Callable[[Trial, Path], bool | None]


def label(folder: Path, ask: Ask) -> tuple[int, int]:
    """Ask for the label of each trial that lacks one and was kept; `ask` gets it and its last
    picture, and may raise KeyboardInterrupt to stop. Return how many were labelled, and how many
    are still not. Each answer is on the disk before the next question.

    Raises:
        InputError: it is no run's folder, its journal is damaged or in use, a record is broken, or
            something cannot be written.
    """
    path = folder / journal.FILE
    if not path.is_file():
        results.see_results(folder)
        raise InputError(f"'{folder}' has no {journal.FILE}: name the folder of an experiment")
    folders.refuse_links(folder)
    done = 0
    with journal.Journal(path) as book:
        lacking = [
            kept
            for entry in journal.scan(path)
            if entry.inserted is None
            and not entry.fault
            and ((kept := store.trial_folder(folder, entry.trial_id)) / store.TRIAL).is_file()
        ]
        for kept in lacking:
            trial = store.load_trial(kept)
            try:
                inserted = ask(trial, last_picture(kept, trial)) if trial.truths else None
            except KeyboardInterrupt:
                break
            if inserted is not None:
                named = labelled(trial, inserted)
                store.save_trial(kept, named)
                book.replace(rows_of(named))
                done += 1
    results.refresh(folder)
    return done, len(lacking) - done
