"""Set-ups for tests of the real cell's code against the emulator."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from pliant.emulator.client import Admin
from pliant.ur5e.configuration import Configuration
from pliant.ur5e.emulated import configuration_of

WITHIN_S = 60.0  # on a loaded machine


def cell_at(host: str, **patience: float) -> Configuration:
    """The emulated cell's configuration, with some patience changed [ms]."""
    configuration = configuration_of(host)
    changed = configuration.patience.model_copy(update=patience)
    return configuration.model_copy(update={"patience": changed})


def with_patience_of_a_real_cell(host: str) -> Configuration:
    """As far as a loaded machine allows."""
    return cell_at(host, stamp_ms=900.0, driver_ms=1400.0, picture_ms=1500.0)


@contextmanager
def when_moving(host: str, do: Callable[[Admin], object]) -> Iterator[list[float]]:
    """Do something once the arm has been moving for 0.2 s. The list gets the controller's time [s]
    when it had been done."""
    done: list[float] = []

    def wait() -> None:
        with Admin(host) as admin:
            began: float | None = None
            give_up = time.monotonic() + WITHIN_S
            while time.monotonic() < give_up:
                state = admin.ask("state")
                if began is None and state["moving"]:
                    began = state["time_s"]
                if began is not None and state["time_s"] > began + 0.2:
                    do(admin)
                    done.append(admin.ask("state")["time_s"])
                    return

    thread = threading.Thread(target=wait)
    thread.start()
    try:
        yield done
    finally:
        thread.join()
    assert done, "the arm did not move"
