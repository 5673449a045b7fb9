"""`view --serve` and `experiment --watch` give one folder to browsers on this machine, and nothing
else to anyone."""

import http.client
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from queue import Queue
from threading import Thread
from urllib.request import urlopen

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from view_folders import experiment

from pliant.cli import following
from pliant.errors import InputError
from pliant.report.serve import Server

SECRET = b"not for you"
FILM = bytes(range(256)) * 1000


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("served")
    (root / "secret.txt").write_bytes(SECRET)
    (root / "run-other").mkdir()
    (root / "run-other" / "secret.txt").write_bytes(SECRET)
    run = root / "run"
    (run / "trials" / "a b").mkdir(parents=True)
    (run / "index.html").write_text("<p>the experiment", encoding="utf-8")
    (run / "trials" / "a b" / "index.html").write_text("<p>a trial", encoding="utf-8")
    (run / "video.mp4").write_bytes(FILM)
    (run / "inside.html").symlink_to("index.html")
    (run / "link.txt").symlink_to(root / "secret.txt")
    (run / "outside").symlink_to(root)
    return run


@pytest.fixture(scope="module")
def server(folder: Path) -> Iterator[Server]:
    server = Server(folder)
    thread = Thread(target=server.run)
    thread.start()
    yield server
    server.close()
    thread.join()


def ask(
    server: Server, path: str, method: str = "GET", **headers: str
) -> tuple[http.client.HTTPResponse, bytes]:
    """Ask for exactly this path, which http.client and browsers would tidy up."""
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)
    try:
        connection.putrequest(method, path, skip_host="Host" in headers)
        for name, value in headers.items():
            connection.putheader(name, value)
        connection.endheaders()
        answer = connection.getresponse()
        return answer, answer.read()
    finally:
        connection.close()


@pytest.mark.parametrize(
    ("path", "content", "kind"),
    [
        ("/", b"<p>the experiment", "text/html; charset=utf-8"),
        ("/trials/a%20b/", b"<p>a trial", "text/html; charset=utf-8"),
        ("/inside.html?x=1", b"<p>the experiment", "text/html; charset=utf-8"),
        ("/video.mp4", FILM, "video/mp4"),
    ],
)
def test_files_come_with_their_types(server: Server, path: str, content: bytes, kind: str) -> None:
    answer, body = ask(server, path)
    assert (answer.status, body) == (200, content)
    assert answer.headers["Content-Type"] == kind
    assert answer.headers["X-Content-Type-Options"] == "nosniff"


@pytest.mark.parametrize(
    "path",
    [
        "/../secret.txt",
        "/%2e%2e/secret.txt",
        "/..%2fsecret.txt",
        "/trials/../../secret.txt",
        "/../run-other/secret.txt",
        "//secret.txt",
        "/link.txt",
        "/outside/secret.txt",
        "/outside/",
        "/..\\secret.txt",
        "/%00",
        "/" + "a" * 5000,
        "/trials/",  # has no page, and is not listed
        "secret.txt",
    ],
)
def test_nothing_outside_the_folder_is_served(server: Server, path: str) -> None:
    answer, body = ask(server, path)
    assert answer.status == 404
    assert SECRET not in body


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=200)
@given(st.lists(st.sampled_from(["..", "%2e%2e", "/", "%2f", "secret.txt", "run-other", "."])))
def test_no_path_leads_outside(server: Server, parts: list[str]) -> None:
    answer, body = ask(server, "/" + "/".join(parts))
    assert answer.status in (200, 301, 404)
    assert SECRET not in body


def test_a_folder_is_asked_for_with_its_slash_on_this_host(server: Server) -> None:
    answer, _ = ask(server, "//trials/a%20b")
    assert answer.status == 301
    assert answer.headers["Location"] == "/trials/a%20b/"


@pytest.mark.parametrize(
    ("asked", "status", "content", "said"),
    [
        ("bytes=0-9", 206, FILM[:10], "bytes 0-9/256000"),
        ("bytes=255990-", 206, FILM[-10:], "bytes 255990-255999/256000"),
        ("bytes=-10", 206, FILM[-10:], "bytes 255990-255999/256000"),
        ("bytes=100-999999999", 206, FILM[100:], "bytes 100-255999/256000"),
        ("bytes=256000-", 416, b"", "bytes */256000"),
        ("bytes=9-0", 416, b"", "bytes */256000"),
        ("bytes=0-1,5-6", 200, FILM, None),  # several: the whole may be sent
        ("lines=1-2", 200, FILM, None),
    ],
)
def test_a_part_of_a_file_can_be_asked_for(
    server: Server, asked: str, status: int, content: bytes, said: str | None
) -> None:
    answer, body = ask(server, "/video.mp4", Range=asked)
    assert (answer.status, body) == (status, content)
    assert answer.headers["Content-Range"] == said


def test_a_head_has_no_body_and_other_methods_are_refused(server: Server) -> None:
    answer, body = ask(server, "/video.mp4", "HEAD")
    assert (answer.status, answer.headers["Content-Length"], body) == (200, "256000", b"")
    assert ask(server, "/index.html", "PUT")[0].status == 501
    assert ask(server, "/index.html", "DELETE")[0].status == 501


def test_another_sites_name_for_this_machine_is_refused(server: Server) -> None:
    assert ask(server, "/", Host=f"evil.example:{server.port}")[0].status == 403
    assert ask(server, "/", Host=f"localhost:{server.port}")[0].status == 200


def test_it_listens_on_the_loopback_address_alone(server: Server) -> None:
    assert server.address == f"http://127.0.0.1:{server.port}/"
    with pytest.raises(ConnectionRefusedError):
        http.client.HTTPConnection("127.0.0.2", server.port, timeout=10).connect()


def test_a_port_that_is_taken_or_none_is_refused_in_a_line(server: Server, folder: Path) -> None:
    with pytest.raises(InputError, match=r"port \d+ cannot be used: Address already in use"):
        Server(folder, server.port)
    with pytest.raises(InputError, match="port 99999 cannot be used"):
        Server(folder, 99999)
    with pytest.raises(InputError, match="is no folder"):
        Server(folder / "index.html")


def test_the_page_of_an_experiment_that_runs_asks_again_until_it_has_ended(tmp_path: Path) -> None:
    (tmp_path / "index.html").write_text("<p>so far", encoding="utf-8")
    (tmp_path / "journal.jsonl").touch()
    server = Server(tmp_path)
    thread = Thread(target=server.run)
    thread.start()
    try:
        assert int(ask(server, "/")[0].headers["Refresh"]) <= 10
        (tmp_path / "trials.parquet").touch()
        assert ask(server, "/")[0].headers["Refresh"] is None
    finally:
        server.close()
        thread.join()


def test_an_experiment_that_is_watched_serves_its_page_until_ctrl_c(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "pliant", "experiment", "--watch", "--trials", "3"]
    given = ["--reasoners", "none", "--workers", "1", "--out", str(tmp_path / "run")]
    with subprocess.Popen(
        [*command, *given], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, encoding="utf-8"
    ) as running:
        try:
            assert running.stdout is not None
            said = ""
            for line in running.stdout:
                said += line
                if "until Ctrl-C" in line:
                    break
            found = re.search(r"watch it at (http://127\.0\.0\.1:\d+/)\n", said)
            assert found is not None, said
            with urlopen(found[1], timeout=10) as answer:
                assert answer.headers["Refresh"] is None  # it has ended
                page = answer.read().decode()
                assert "<h1" in page
                assert "circle" in page
            running.send_signal(signal.SIGINT)
            assert running.wait(timeout=30) == 0
        finally:
            running.kill()


def test_the_page_of_a_watched_experiment_is_there_while_it_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(following, "_LOOK_EVERY_S", 0.05)
    said: Queue[str] = Queue()
    with following.Watched(tmp_path / "run", None, said.put).filling():
        experiment(tmp_path / "run")
        address = said.get(timeout=20).removeprefix("watch it at ")
        with urlopen(address, timeout=10) as answer:
            assert "circle" in answer.read().decode()


def test_ctrl_c_at_the_very_moment_at_which_it_is_offered_ends_the_page_in_good_order(
    tmp_path: Path,
) -> None:
    said = []

    def say(line: str) -> None:
        said.append(line)
        if "Ctrl-C" in line:
            raise KeyboardInterrupt

    experiment(tmp_path / "run")
    following.Watched(tmp_path / "run", None, say).stay()
    assert "until Ctrl-C" in said[-1]
