"""The pages of an experiment kept up with its trials, and served, while it runs."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from threading import Event, Thread

from pliant import teaching
from pliant.errors import InputError
from pliant.experiment import journal, results
from pliant.report.serve import REFRESH_S, Server
from pliant.report.view import view

_LOOK_EVERY_S = REFRESH_S / 2


@contextmanager
def followed(folder: Path, make: Callable[[], object], *, anew: bool = False) -> Iterator[None]:
    """Make the pages again, beside what is done inside, whenever trials have been added; `anew`
    also makes them at first, once there are trials."""
    over = Event()

    def follow() -> None:
        seen = _state(folder) if not anew else []
        while not over.wait(_LOOK_EVERY_S):
            if any(state := _state(folder)) and state != seen:
                with suppress(InputError):  # it may be in the middle of being written
                    make()
                    seen = state

    thread = Thread(target=follow, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


class Watched:
    """A browser's view of an experiment that runs: its page fills while trials end."""

    def __init__(self, folder: Path, goals: Path | None, say: Callable[[str], None]) -> None:
        own = [] if goals is None else [teaching.load(goals)]
        self._make = partial(view, folder, [*own, teaching.shipped()])
        self._folder, self._say = folder, say
        self._server: Server | None = None

    @contextmanager
    def filling(self) -> Iterator[None]:
        """Serve the pages from the first trial on, beside what is done inside."""
        try:
            with followed(self._folder, self._made, anew=True):
                yield
        except BaseException:
            self._close()
            raise

    def stay(self) -> None:
        """Make the pages of all that there is, and serve them until Ctrl-C."""
        self._made()
        with suppress(KeyboardInterrupt):
            self._say("the page is served until Ctrl-C")
            Event().wait()
        self._close()

    def _made(self) -> None:
        self._make()
        if self._server is None:
            self._server = Server(self._folder)
            Thread(target=self._server.run, daemon=True).start()
            self._say(f"watch it at {self._server.address}")

    def _close(self) -> None:
        if self._server is not None:
            self._server.close()


def _state(folder: Path) -> list[int]:
    """How large what the trials are written to is."""
    files = (folder / journal.FILE, folder / results.TRIALS_FILE)
    return [file.stat().st_size if file.exists() else 0 for file in files]
