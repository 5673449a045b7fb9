"""Serves an export by llama.cpp with one thread: to check it here, or to ask it by hand.

    python serve.py folder [--port N]

says the server's address, then serves until Ctrl-C. `folder` holds model.gguf and mmproj.gguf.
"""

import argparse
import json
import subprocess
import sys
import urllib.request
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from threading import Event
from typing import Any

NAME = "pliant-vlm"
DOWN_S = 60.0


@dataclass(frozen=True)
class Server:
    """A server that runs, and its process."""

    url: str
    process: int

    def post(self, path: str, body: Mapping[str, Any]) -> dict[str, Any]:
        request = urllib.request.Request(
            self.url + path, json.dumps(body).encode(), {"Content-Type": "application/json"}
        )
        with urllib.request.urlopen(request) as reply:
            told: dict[str, Any] = json.load(reply)
        return told

    def memory_mb(self) -> dict[str, float]:
        """What the process holds now and has held at most, in MB."""
        lines = Path(f"/proc/{self.process}/status").read_text(encoding="utf-8").splitlines()
        held = dict(line.split(":", 1) for line in lines)
        return {k: int(held[k].split()[0]) * 1024 / 1e6 for k in ("VmRSS", "VmHWM")}


@contextmanager
def serving(folder: Path, *, context: int) -> Iterator[Server]:
    """A server of `folder`'s GGUF files in a process of its own, which ends with this context."""
    command = (sys.executable, __file__, str(folder), "--context", str(context), "--until-eof")
    with (
        (folder / "log.txt").open("wb") as log,
        subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log
        ) as process,
    ):
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            url = process.stdout.readline().decode().strip()
            if not url:
                raise RuntimeError((folder / "log.txt").read_text(encoding="utf-8"))
            yield Server(url, process.pid)
        finally:
            process.stdin.close()
            process.wait(DOWN_S)


def serve(folder: Path, *, context: int, port: int, until_eof: bool) -> None:
    """Says the server's address, then serves until Ctrl-C or the end of standard input."""
    xllamacpp = import_module("xllamacpp")
    params = xllamacpp.CommonParams()
    params.model.path = str(folder / "model.gguf")
    params.mmproj.path = str(folder / "mmproj.gguf")
    params.model_alias = {NAME}
    params.hostnames, params.port = ["127.0.0.1"], port
    params.offline = True
    params.n_ctx, params.n_parallel, params.kv_unified = context, 1, True
    params.cache_ram_mib = 0
    params.cpuparams.n_threads = params.cpuparams_batch.n_threads = 1
    server = xllamacpp.Server(params)  # returns when all is loaded
    print(server.listening_address, flush=True)
    with suppress(KeyboardInterrupt):
        if until_eof:
            sys.stdin.read()
        else:
            Event().wait()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--port", type=int, default=0, help="default: any that is free")
    parser.add_argument("--context", type=int, default=2048, help="tokens; default: 2048")
    parser.add_argument("--until-eof", action="store_true", help="end with standard input")
    options = parser.parse_args()
    serve(options.folder, context=options.context, port=options.port, until_eof=options.until_eof)
