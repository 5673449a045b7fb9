"""The tiny vision-language model in plain PyTorch: a picture tower and a language model.

It is laid out so that llama.cpp (projector `lfm2`, language model `llama`) and transformers
(`Lfm2VlForConditionalGeneration` with a Llama inside) compute the same from its weights; export.py
writes them for both. GELU is the tanh approximation throughout, as llama.cpp has no other there.

A picture of 192 × 192 px is cut into 16 × 16 patches, row by row. Blocks of 2 × 2 patches are laid
side by side (upper left, upper right, lower left, lower right) and become one language token each:
8 × 8 = 64, row by row. The language model reads them causally, as any token.
"""

import math
from dataclasses import asdict, dataclass
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn import functional


@dataclass(frozen=True)
class Size:
    """How large the model is, and what it takes."""

    picture_width: int = 192
    picture_height: int = 192
    patch: int = 12
    merge: int = 2
    vision_width: int = 256
    vision_layers: int = 6
    vision_heads: int = 4
    vision_mlp: int = 768
    vision_eps: float = 1e-6
    projector: int = 640
    width: int = 320
    layers: int = 8
    heads: int = 5
    mlp: int = 864
    vocabulary: int = 4096
    context: int = 2048
    rope_base: float = 10_000.0
    eps: float = 1e-5

    @property
    def columns(self) -> int:
        """Patches across a picture."""
        return self.picture_width // self.patch

    @property
    def rows(self) -> int:
        """Patches down a picture."""
        return self.picture_height // self.patch

    @property
    def picture_tokens(self) -> int:
        """Language tokens of a picture."""
        return self.columns * self.rows // self.merge**2


SIZES = {
    "full": Size(),
    "small": Size(
        vision_width=160,
        vision_layers=4,
        vision_heads=5,
        vision_mlp=480,
        projector=384,
        width=192,
        layers=6,
        heads=3,
        mlp=512,
    ),
    "tiny": Size(
        vision_width=32,
        vision_layers=1,
        vision_heads=1,
        vision_mlp=32,
        projector=32,
        width=32,
        layers=1,
        heads=1,
        mlp=32,
    ),
}
"""full is for a graphics card; small can be trained on two cores; tiny is for tests."""

PROJECTOR_EPS = 1e-5
"""Of the projector's LayerNorm; fixed in llama.cpp."""


class Attention(nn.Module):
    """Multi-head attention with query, key and value in one matrix."""

    def __init__(self, width: int, heads: int, *, bias: bool) -> None:
        super().__init__()
        self.heads = heads
        self.qkv = nn.Linear(width, 3 * width, bias=bias)
        self.out = nn.Linear(width, width, bias=bias)

    def forward(
        self, x: Tensor, turn: tuple[Tensor, Tensor] | None, mask: Tensor | None, *, causal: bool
    ) -> Tensor:
        """`turn`: the cosines and sines of RoPE, for queries and keys."""
        batch, length, width = x.shape
        q, k, v = self.qkv(x).view(batch, length, 3, self.heads, -1).permute(2, 0, 3, 1, 4)
        if turn is not None:
            q, k = rotated(q, *turn), rotated(k, *turn)
        y = functional.scaled_dot_product_attention(
            q, k, v, attn_mask=mask, is_causal=causal and mask is None
        )
        return self.out(y.transpose(1, 2).reshape(batch, length, width))


def rotated(x: Tensor, cosines: Tensor, sines: Tensor) -> Tensor:
    """RoPE in transformers' order: element i of a head's first half goes with that of its
    second."""
    first, second = x.float().chunk(2, -1)
    turned = first * cosines - second * sines, second * cosines + first * sines
    return torch.cat(turned, -1).to(x.dtype)


class VisionBlock(nn.Module):
    """A transformer block of the tower: LayerNorm before, biases, GELU."""

    def __init__(self, size: Size) -> None:
        super().__init__()
        self.norm1 = nn.LayerNorm(size.vision_width, eps=size.vision_eps)
        self.attention = Attention(size.vision_width, size.vision_heads, bias=True)
        self.norm2 = nn.LayerNorm(size.vision_width, eps=size.vision_eps)
        self.up = nn.Linear(size.vision_width, size.vision_mlp)
        self.down = nn.Linear(size.vision_mlp, size.vision_width)

    def forward(self, x: Tensor) -> Tensor:
        x = x + self.attention(self.norm1(x), None, None, causal=False)
        return x + self.down(functional.gelu(self.up(self.norm2(x)), approximate="tanh"))


class Tower(nn.Module):
    """Pictures → language tokens: a vision transformer, then the projector."""

    def __init__(self, size: Size) -> None:
        super().__init__()
        self.size = size
        self.patches = nn.Conv2d(3, size.vision_width, size.patch, size.patch)
        self.positions = nn.Parameter(torch.empty(size.rows * size.columns, size.vision_width))
        self.blocks = nn.ModuleList(VisionBlock(size) for _ in range(size.vision_layers))
        self.norm = nn.LayerNorm(size.vision_width, eps=size.vision_eps)
        self.projector_norm = nn.LayerNorm(size.vision_width * size.merge**2, eps=PROJECTOR_EPS)
        self.projector1 = nn.Linear(size.vision_width * size.merge**2, size.projector)
        self.projector2 = nn.Linear(size.projector, size.width)

    def features(self, pixels: Tensor) -> Tensor:
        """The patches' features (n, 256, vision width), row by row, of pictures (n, 3, 192, 192)
        with values (x - 0.5) / 0.5."""
        x = self.patches(pixels).flatten(2).transpose(1, 2) + self.positions
        for block in self.blocks:
            x = block(x)
        return self.norm(x)

    def project(self, features: Tensor) -> Tensor:
        """Language tokens (n, 64, language width) of patch features."""
        size = self.size
        x = features.unflatten(1, (size.rows // size.merge, size.merge, -1, size.merge))
        x = x.transpose(2, 3).flatten(3).flatten(1, 2)
        x = self.projector1(self.projector_norm(x))
        return self.projector2(functional.gelu(x, approximate="tanh"))

    def forward(self, pixels: Tensor) -> Tensor:
        return self.project(self.features(pixels))


class LanguageBlock(nn.Module):
    """A block of Llama: RMSNorm before, RoPE, SwiGLU, no biases."""

    def __init__(self, size: Size) -> None:
        super().__init__()
        self.norm1 = nn.RMSNorm(size.width, eps=size.eps)
        self.attention = Attention(size.width, size.heads, bias=False)
        self.norm2 = nn.RMSNorm(size.width, eps=size.eps)
        self.gate = nn.Linear(size.width, size.mlp, bias=False)
        self.up = nn.Linear(size.width, size.mlp, bias=False)
        self.down = nn.Linear(size.mlp, size.width, bias=False)

    def forward(self, x: Tensor, turn: tuple[Tensor, Tensor], mask: Tensor | None) -> Tensor:
        x = x + self.attention(self.norm1(x), turn, mask, causal=True)
        y = self.norm2(x)
        return x + self.down(functional.silu(self.gate(y)) * self.up(y))


class Language(nn.Module):
    """Llama, with the embeddings' matrix for the output as well."""

    cosines: Tensor
    sines: Tensor

    def __init__(self, size: Size) -> None:
        super().__init__()
        self.size = size
        self.embedding = nn.Embedding(size.vocabulary, size.width)
        self.blocks = nn.ModuleList(LanguageBlock(size) for _ in range(size.layers))
        self.norm = nn.RMSNorm(size.width, eps=size.eps)
        head = size.width // size.heads
        speeds = size.rope_base ** -(torch.arange(0, head, 2, dtype=torch.float64) / head)
        angles = torch.arange(size.context, dtype=torch.float64)[:, None] * speeds
        self.register_buffer("cosines", angles.cos().float(), persistent=False)
        self.register_buffer("sines", angles.sin().float(), persistent=False)

    def embed(self, tokens: Tensor) -> Tensor:
        return self.embedding(tokens)

    def hidden(
        self, embeddings: Tensor, mask: Tensor | None = None, positions: Tensor | None = None
    ) -> Tensor:
        """What the output matrix is applied to (b, t, width).

        `mask`: True where a query (second last axis) may see a key (last), as
        `scaled_dot_product_attention` takes it; None: all before it, which does for sequences that
        are padded on the right. `positions` (b, t): the tokens' places in their sequences, where
        several are packed in one; None: 0, 1, ….
        """
        if positions is None:
            length = embeddings.shape[1]
            turn = self.cosines[:length], self.sines[:length]
        else:
            turn = self.cosines[positions][:, None], self.sines[positions][:, None]
        x = embeddings
        for block in self.blocks:
            x = block(x, turn, mask)
        return self.norm(x)

    def forward(
        self, embeddings: Tensor, mask: Tensor | None = None, positions: Tensor | None = None
    ) -> Tensor:
        """Logits (b, t, vocabulary)."""
        hidden = self.hidden(embeddings, mask, positions)
        return functional.linear(hidden, self.embedding.weight)


class Model(nn.Module):
    """The tower and the language model together."""

    def __init__(self, size: Size | None = None) -> None:
        super().__init__()
        self.size = size or Size()
        self.tower = Tower(self.size)
        self.language = Language(self.size)
        initialise(self)

    def embed(self, tokens: Tensor, pictures: Tensor | None, picture_token: int) -> Tensor:
        """Embeddings (b, t, width), with the pictures (m, 3, 192, 192) in the places of
        `picture_token`, in their order in the batch. There must be 64 places for each picture, one
        after the other; this is not checked."""
        embeddings = self.language.embed(tokens)
        if pictures is None or not len(pictures):
            return embeddings
        shown = self.tower(pictures).flatten(0, 1).to(embeddings.dtype)
        is_place = (tokens == picture_token).flatten()
        places = torch.nonzero_static(is_place, size=len(shown))[:, 0]
        return embeddings.flatten(0, 1).index_copy(0, places, shown).view_as(embeddings)

    def forward(
        self,
        tokens: Tensor,
        pictures: Tensor | None,
        picture_token: int,
        mask: Tensor | None = None,
        positions: Tensor | None = None,
    ) -> Tensor:
        """Logits (b, t, vocabulary): at each place those of the token after it."""
        return self.language(self.embed(tokens, pictures, picture_token), mask, positions)

    def loss(
        self,
        tokens: Tensor,
        pictures: Tensor | None,
        picture_token: int,
        weights: Tensor,
        mask: Tensor | None = None,
        positions: Tensor | None = None,
    ) -> Tensor:
        """The mean cross entropy in nats of the tokens (b, t) after the first, each with the weight
        that stands at its own place in `weights` (b, t); those of places that are not to be learnt,
        as pictures and padding, are 0."""
        logits = self(tokens, pictures, picture_token, mask, positions)[:, :-1]
        each = functional.cross_entropy(
            logits.flatten(0, 1).float(), tokens[:, 1:].flatten(), reduction="none"
        )
        weight = weights[:, 1:].flatten().float()
        return (each * weight).sum() / weight.sum().clamp(min=1e-6)


@torch.no_grad()
def initialise(model: Model) -> None:
    """Random weights to train from: each layer keeps the scale of what it reads, the blocks' last
    ones write less the more blocks there are, and a picture's tokens are as large as words'."""
    size, tower, language = model.size, model.tower, model.language
    for module in model.modules():
        if isinstance(module, nn.Linear | nn.Conv2d) and module.bias is not None:
            nn.init.zeros_(module.bias)
    nn.init.normal_(tower.patches.weight, std=tower.patches.weight[0].numel() ** -0.5)
    tower.positions.copy_(0.5 * waves(size.rows, size.columns, size.vision_width))
    for block in tower.blocks:
        assert isinstance(block, VisionBlock)
        for linear in (block.attention.qkv, block.up):
            nn.init.normal_(linear.weight, std=0.7 * linear.in_features**-0.5)
        for linear in (block.attention.out, block.down):
            std = 0.7 * (linear.in_features * 2 * size.vision_layers) ** -0.5
            nn.init.normal_(linear.weight, std=std)
    small = math.sqrt(2 / (5 * size.width))
    nn.init.normal_(tower.projector1.weight, std=tower.projector1.in_features**-0.5)
    nn.init.normal_(tower.projector2.weight, std=1.5 * small * size.projector**-0.5)
    nn.init.normal_(language.embedding.weight, std=small)
    for block in language.blocks:
        assert isinstance(block, LanguageBlock)
        for linear in (block.attention.qkv, block.gate, block.up):
            nn.init.normal_(linear.weight, std=small)
        for linear in (block.attention.out, block.down):
            nn.init.normal_(linear.weight, std=small * (2 * size.layers) ** -0.5)


def waves(rows: int, columns: int, width: int) -> Tensor:
    """Sines and cosines of the row and of the column (rows * columns, width), between which two
    places can be told apart from the start."""
    speeds = 100.0 ** -(torch.arange(width // 4) / (width // 4))
    down, across = (torch.arange(n)[:, None] * speeds for n in (rows, columns))
    down = torch.cat([down.sin(), down.cos()], -1)[:, None].expand(-1, columns, -1)
    across = torch.cat([across.sin(), across.cos()], -1)[None].expand(rows, -1, -1)
    return torch.cat([down, across], -1).flatten(0, 1)


def save(model: Model, path: Path) -> None:
    """Writes a checkpoint: the size and the weights."""
    torch.save({"size": asdict(model.size), "model": model.state_dict()}, path)


def load(path: Path) -> Model:
    """The model of a checkpoint. Weights of a compiled or distributed copy do as well."""
    held = torch.load(path, map_location="cpu", weights_only=True)
    model = Model(Size(**held["size"]))
    weights = held["model"].items()
    model.load_state_dict(
        {k.removeprefix("module.").replace("_orig_mod.", ""): v.float() for k, v in weights}
    )
    return model
