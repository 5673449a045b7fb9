"""A process that is asked to end, by Ctrl-C, `kill` or a closed terminal, ends in good order and
leaves nobody behind."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from pliant import signals

ENDING = ["SIGINT", "SIGTERM", "SIGHUP"]
WITHIN_S = 60.0  # on a machine under load


@pytest.fixture(autouse=True)
def _as_before(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    before = {name: signal.getsignal(getattr(signal, name)) for name in ENDING}
    monkeypatch.setattr(signals, "_heard", [])
    yield
    for name, handler in before.items():
        signal.signal(getattr(signal, name), handler)


def send(name: str) -> None:
    os.kill(os.getpid(), getattr(signal, name))


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_each_ends_what_is_going_on_as_ctrl_c_does(name: str) -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signals.heed()
    with pytest.raises(KeyboardInterrupt):
        send(name)
    assert signals.exit_status() == 128 + getattr(signal, name)
    assert name.removeprefix("SIGINT") in str(signals.interrupted())


def test_what_was_to_be_ignored_is_ignored() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as `nohup` does
    signals.heed()
    send("SIGHUP")
    assert signals.exit_status() == 130


def test_several_within_a_moment_are_one() -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signals.heed()
    with signals.once(60.0):
        with pytest.raises(KeyboardInterrupt):
            send("SIGTERM")
        send("SIGTERM")
        send("SIGINT")
    with pytest.raises(KeyboardInterrupt):
        send("SIGINT")


@contextmanager
def script(tmp_path: Path, text: str) -> "Iterator[subprocess.Popen[str]]":
    """A program in a group of its own, once it has said that it is ready."""
    path = tmp_path / "script.py"
    path.write_text(text, encoding="utf-8")
    with subprocess.Popen(
        [sys.executable, path], start_new_session=True, stdout=subprocess.PIPE, encoding="utf-8"
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        yield process


def assert_all_end(group: int) -> None:
    give_up = time.monotonic() + WITHIN_S
    while time.monotonic() < give_up:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return
        time.sleep(0.02)
    raise AssertionError("somebody is left")


def test_a_closed_terminal_is_not_written_to(tmp_path: Path) -> None:
    """The other end is gone: what is said then is an error, unless it goes nowhere."""
    ours, theirs = os.openpty()
    path = tmp_path / "script.py"
    path.write_text(
        "import time; from pathlib import Path; from pliant import signals\n"
        "signals.heed()\n"
        "try:\n    print('ready', flush=True); time.sleep(60)\n"
        "except KeyboardInterrupt:\n    print('halted', flush=True)\n"
        f"    Path({str(tmp_path / 'kept')!r}).touch()\n",
        encoding="utf-8",
    )
    process = subprocess.Popen(
        [sys.executable, path], stdin=theirs, stdout=theirs, stderr=theirs, start_new_session=True
    )
    os.close(theirs)
    assert b"ready" in os.read(ours, 100)
    os.close(ours)
    process.send_signal(signal.SIGHUP)
    assert process.wait(WITHIN_S) == 0
    assert (tmp_path / "kept").exists()


POOL = """
import time, multiprocessing
from concurrent.futures import ProcessPoolExecutor
from pliant import signals
if __name__ == "__main__":
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(2, mp_context=spawn, initializer=signals.work_for_parent) as pool:
        busy = [pool.submit(time.sleep, n) for n in (0, 0, 600, 600)]
        busy[0].result(), busy[1].result()
        print("ready", flush=True)
        busy[2].result()
"""


def test_workers_end_with_the_process_that_they_work_for(tmp_path: Path) -> None:
    with script(tmp_path, POOL) as process:
        process.kill()
        process.wait(WITHIN_S)
        assert_all_end(process.pid)


EXPORT = """
import sys, time
from contextlib import closing
from pathlib import Path
from pliant import signals
from pliant.export import lerobot
from pliant.export.output import filling

def slow(job):
    time.sleep(600 * job)

slow.__module__ = "__main__"
lerobot.episode = slow
if __name__ == "__main__":
    signals.heed()
    with filling(Path(sys.argv[0]).with_name("out")):
        with closing(lerobot.drawn([0, 1, 1, 1], 2)) as episodes:
            for made in episodes:
                print("ready", flush=True)
                time.sleep(PAUSE_S)
"""


@pytest.mark.system
@pytest.mark.parametrize("name", ENDING)
@pytest.mark.parametrize("pause_s", [0, 600], ids=["while it draws", "while it writes"])
def test_an_export_that_is_asked_to_end_leaves_no_worker_and_no_file(
    tmp_path: Path, name: str, pause_s: int
) -> None:
    with script(tmp_path, EXPORT.replace("PAUSE_S", str(pause_s))) as process:
        os.killpg(process.pid, getattr(signal, name))
        process.wait(WITHIN_S)
        assert_all_end(process.pid)
    assert [path.name for path in tmp_path.iterdir()] == ["script.py"]
