"""An OpenAI-compatible server on the loopback address that behaves, or misbehaves, as told."""

import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

Fields = dict[str, Any]
Behaviour = Callable[["Handler"], None]


@dataclass
class Received:
    """One request as it arrived."""

    path: str
    headers: dict[str, str]
    body: Fields


class Handler(BaseHTTPRequestHandler):
    """Keeps the request and lets the behaviour answer it."""

    protocol_version = "HTTP/1.1"
    server: "_Server"

    def do_POST(self) -> None:
        length = int(self.headers["Content-Length"])
        body = json.loads(self.rfile.read(length))
        self.received = Received(self.path, dict(self.headers.items()), body)
        self.server.received.append(self.received)
        self.server.behaviour(self)

    def send(
        self,
        content: bytes,
        *,
        status: int = 200,
        kind: str = "application/json",
        **headers: str,
    ) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        for name, value in headers.items():
            self.send_header(name.replace("_", "-"), value)
        self.end_headers()
        self.wfile.write(content)

    def drop(self) -> None:
        """Close without another byte."""
        self.close_connection = True

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002, the base class's name
        pass


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    received: list[Received]
    behaviour: Behaviour

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that gave up is no error of the server."""


@dataclass
class Loopback:
    """A running server: its address for `base_url`, and what it received so far."""

    base_url: str
    received: list[Received] = field(default_factory=list)
    stopped: threading.Event = field(default_factory=threading.Event)


@contextmanager
def loopback(behave: Callable[["Loopback", Handler], None]) -> Iterator[Loopback]:
    """Serve until the block ends; `behave` answers each request."""
    server = _Server(("127.0.0.1", 0), Handler)
    running = Loopback(base_url=f"http://127.0.0.1:{server.server_port}/v1")
    server.received = running.received
    server.behaviour = lambda handler: behave(running, handler)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    try:
        yield running
    finally:
        running.stopped.set()
        server.shutdown()
        thread.join()
        server.server_close()


def completion(body: Fields, text: str = "", tokens: tuple[int, int] = (900, 60)) -> bytes:
    """A chat completion that says `text`: as the function call that was asked for, or as words."""
    message: Fields = {"role": "assistant", "content": text}
    if body.get("tools"):
        function = {"name": body["tools"][0]["function"]["name"], "arguments": text}
        call = {"id": "call-1", "type": "function", "function": function}
        message = {"role": "assistant", "content": None, "tool_calls": [call]}
    reply = {
        "id": "chatcmpl-1",
        "object": "chat.completion",
        "created": 1_700_000_000,
        "model": body["model"],
        "system_fingerprint": "loopback-1",
        "choices": [{"index": 0, "message": message, "finish_reason": "stop"}],
        "usage": {
            "prompt_tokens": tokens[0],
            "completion_tokens": tokens[1],
            "total_tokens": sum(tokens),
            "prompt_tokens_details": {"cached_tokens": 512},
        },
    }
    return json.dumps(reply).encode()
