"""The pages of a run: the experiment's, and one for each trial whose record was kept."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from pliant import files, folders, store
from pliant.console import Told, untold
from pliant.errors import InputError
from pliant.experiment import results
from pliant.records import Trial
from pliant.report import overview, summary, trial
from pliant.teaching import Teaching

_HOME = f"../../{trial.PAGE}"


@dataclass(frozen=True, kw_only=True)
class Viewed:
    """The pages that were made: the one to open, a trial's where the experiment's could not be
    made; how many trials' pages were made, how many of them without goal pictures, and how many
    were up to date; and what is wrong with those that have none."""

    page: Path
    made: int
    kept: int
    without_goals: int
    problems: tuple[str, ...]


def view(
    folder: Path,
    teachings: Sequence[Teaching],
    *,
    film: bool = False,
    progress: Told = untold,
) -> Viewed:
    """Make the pages of an experiment or a single run, or of the one trial stored in `folder`;
    pages that are up to date stay. `teachings` are searched for each trial's goals; `film` draws
    missing videos too. What is broken gets no page, and is named: a trial's record, or what the
    experiment's page is made from.

    Raises:
        InputError: the folder holds no results, or a link; it cannot be written.
    """
    if (folder / store.TRIAL).is_file():
        run = trial.run_of(folder)
        if run is not None:
            folders.refuse_links(run, but=(store.TRIALS,))
        home = _HOME if run is not None and (run / trial.PAGE).is_file() else None
        made = Counter([_show(folder, teachings, film, home)])
        return _viewed(folder / trial.PAGE, made, [])
    results.see_results(folder)
    folders.refuse_links(folder, but=(store.TRIALS,))
    stored = store.kept_trials(folder)
    counts, pages, problems = Counter[_Page](), set(), []
    for n, one in enumerate(stored, start=1):
        try:
            folders.refuse_link(one)
            counts[_show(one, teachings, film, _HOME)] += 1
            pages.add(one.name)
        except InputError as error:
            problems.append(str(error))
        progress(n, len(stored))
    page = folder / trial.PAGE
    try:
        with folders.contained(f"'{folder}'"):
            text = overview.render(summary.read(folder), folder.resolve().name, pages)
        files.write_bytes(page, text.encode())
    except InputError as error:
        if not pages:
            raise
        problems.insert(0, str(error))
        page = folder / store.TRIALS / min(pages) / trial.PAGE
    return _viewed(page, counts, problems)


class _Page(Enum):
    KEPT = "up to date"
    MADE = "made"
    WITHOUT_GOALS = "made without goal pictures"


def _show(folder: Path, teachings: Sequence[Teaching], film: bool, home: str | None) -> _Page:
    """Make a trial's page, unless it is up to date."""
    folders.refuse_links(folder)
    lacks_video = film and not (folder / trial.VIDEO).is_file()
    if not lacks_video and trial.is_shown(folder, home):
        return _Page.KEPT
    with folders.contained(f"'{folder}'"):
        stored = store.load_trial(folder)
        taught = _taught(stored, teachings)
        trial.show(folder, stored, taught, film=film, home=home)
    return _Page.WITHOUT_GOALS if taught is None else _Page.MADE


def _viewed(page: Path, counts: Counter[_Page], problems: Sequence[str]) -> Viewed:
    return Viewed(
        page=page,
        made=counts[_Page.MADE] + counts[_Page.WITHOUT_GOALS],
        kept=counts[_Page.KEPT],
        without_goals=counts[_Page.WITHOUT_GOALS],
        problems=tuple(problems),
    )


def _taught(stored: Trial, teachings: Sequence[Teaching]) -> Teaching | None:
    """The teaching whose goals the trial had; None: it is not among `teachings`."""
    for teaching in teachings:
        if teaching.for_task(stored.task).goals == stored.goals:
            return teaching
    return None
