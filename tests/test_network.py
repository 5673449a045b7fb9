"""What is meant for this machine or the cell is never seen by a proxy."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from threading import Thread

import pytest
from loopback import Handler, Loopback, completion, loopback
from vlm_cases import simulated

from pliant.network import is_loopback, keep_direct, open_directly, origin
from pliant.reasoners import vlm
from pliant.reasoners.vlm.settings import Settings

PROXIES = ("HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY")


@contextmanager
def serving(handler: type[BaseHTTPRequestHandler]) -> Iterator[HTTPServer]:
    with HTTPServer(("127.0.0.1", 0), handler) as server:
        thread = Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield server
        server.shutdown()
        thread.join()


@pytest.fixture
def proxied(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[str]]:
    """What a proxy saw, that every variable names."""
    seen: list[str] = []

    class Proxy(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            seen.append(f"{self.command} {self.path}")
            self.send_response(503)
            self.end_headers()

        do_POST = do_CONNECT = do_GET  # noqa: N815

        def log_message(self, *args: object) -> None:
            pass

    with serving(Proxy) as server:
        for name in PROXIES:
            for variable in (name, name.lower()):
                monkeypatch.setenv(variable, f"http://127.0.0.1:{server.server_port}")
        monkeypatch.setenv("NO_PROXY", "example.org")
        monkeypatch.setenv("no_proxy", "")  # so that both are put back
        yield seen


@pytest.fixture
def own_server(monkeypatch: pytest.MonkeyPatch) -> None:
    """See conftest.py."""
    monkeypatch.setenv("OPENAI_API_KEY", "sk-0123456789")
    for name in ("PLIANT_VLM_KEY", "PLIANT_VLM_KEY_FOR"):
        monkeypatch.delenv(name, raising=False)


def says_no(server: Loopback, handler: Handler) -> None:
    handler.send(completion(handler.received.body, "no"))


@pytest.mark.parametrize(
    ("url", "server"),
    [
        ("http://localhost:8000/v1", "http://localhost:8000"),
        ("HTTPS://Example.org./", "https://example.org:443"),
        ("http://example.org", "http://example.org:80"),
        ("http://[::1]:8000/v1", "http://[::1]:8000"),
        ("https://example.org@evil.example/", "https://evil.example:443"),
    ],
)
def test_a_server_is_its_scheme_host_and_port(url: str, server: str) -> None:
    assert origin(url) == server


@pytest.mark.parametrize(
    "url", ["localhost:8000", "example.org", "ftp://a/", "http://", "http://a:x"]
)
def test_what_is_no_address_of_a_server_is_said(url: str) -> None:
    with pytest.raises(ValueError, match=r"must begin with http|Port"):
        origin(url)


@pytest.mark.usefixtures("own_server")
@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "127.1", "0.0.0.0"])
def test_a_model_on_this_machine_is_asked_past_the_proxy(host: str, proxied: list[str]) -> None:
    with loopback(says_no) as server:
        address = server.base_url.replace("127.0.0.1", host)
        mind = vlm(Settings(model="small", base_url=address, picture=False))
        mind.judge(simulated().judged[-1])
    assert server.received
    assert proxied == []


@pytest.mark.usefixtures("own_server")
def test_a_provider_that_a_variable_points_here_is_asked_past_the_proxy(
    proxied: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with loopback(says_no) as server:
        monkeypatch.setenv("OPENAI_BASE_URL", server.base_url)
        monkeypatch.setenv("PLIANT_VLM_KEY_FOR", server.base_url)
        vlm(Settings(model="openai:gpt-4o", picture=False)).judge(simulated().judged[-1])
    assert server.received
    assert proxied == []


@pytest.mark.usefixtures("own_server")
def test_a_model_elsewhere_is_asked_through_the_proxy(proxied: list[str]) -> None:
    mind = vlm(Settings(model="small", base_url="http://192.0.2.1/v1", deadline_s=1))
    mind.judge(simulated().judged[-1])
    assert proxied
    assert os.environ["NO_PROXY"] == "example.org"


def test_a_camera_of_the_cell_is_asked_past_the_proxy(proxied: list[str]) -> None:
    class Camera(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.end_headers()
            self.wfile.write(b"picture")

        def log_message(self, *args: object) -> None:
            pass

    with serving(Camera) as server:
        address = f"http://127.0.0.1:{server.server_port}/side.jpg"
        assert open_directly(address, 2.0).read() == b"picture"
    with pytest.raises(OSError, match="refused"):  # not the proxy's 503
        open_directly(address, 2.0)
    assert proxied == []


def test_this_machine_has_many_names() -> None:
    ours = ("localhost", "LOCALHOST.", "a.localhost", "127.0.0.1", "127.8.9.10", "127.1", "0.0.0.0")
    for host in (*ours, "::1", "[::1]", "::ffff:127.0.0.1"):
        assert is_loopback(host), host
    for host in ("example.org", "localhost.example.org", "10.0.0.1", "192.168.1.2", "::2", ""):
        assert not is_loopback(host), host


def test_what_is_exempt_already_stays_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_PROXY", "example.org")
    monkeypatch.setenv("no_proxy", "example.org")
    assert keep_direct("http://localhost:8000/v1")
    assert not keep_direct("http://localhost:8001/v1")
    assert not keep_direct("http://example.com/v1")
    assert os.environ["no_proxy"] == os.environ["NO_PROXY"] == "example.org,localhost"
