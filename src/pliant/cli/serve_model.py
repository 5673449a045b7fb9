"""`pliant serve-model`: the model that comes with pliant, for whoever speaks OpenAI's protocol."""

from contextlib import suppress
from pathlib import Path

from rich.text import Text

from pliant.console import Console, say
from pliant.errors import InputError
from pliant.paths import located
from pliant.reasoners.vlm import local
from pliant.reasoners.vlm.settings import SHIPPED, Settings


def serve_model(
    *, port: int = 0, weights: Path | None = None, projector: Path | None = None
) -> int:
    """Serve the model that comes with pliant, or one tuned from it, to this machine until Ctrl-C.
    `pliant run --reasoner vlm` does not need that: it serves the model itself.

    Args:
        port: 0 takes a free one.
        weights: the language model of a tuned one (.gguf).
        projector: what reads its pictures (.gguf).
    """
    if not 0 <= port < 1 << 16:
        raise InputError(f"--port is {port}: it must be from 0 to 65535")
    if (weights is None) != (projector is None):
        raise InputError("--weights and --projector belong together: give both, or neither")
    if weights is None or projector is None:
        served = local.installed(Settings(model=SHIPPED))
    else:
        served = local.tuned(located(weights), located(projector))
    with suppress(KeyboardInterrupt), local.serving(served, port) as server:
        Console(stderr=True, highlight=False, soft_wrap=True).print(
            Text(
                "serving until Ctrl-C; to ask it: pliant run --reasoner vlm --base-url"
                f" {server.base_url} --model {served.name}"
            )
        )
        say(server.base_url)
        server.wait()
    return 0
