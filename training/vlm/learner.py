"""What is trained: the model, beside heads that read from its tower what is true in a picture."""

import math
from typing import Any

import numpy as np
import torch
from dataset import TARGETS, Asked, Batch, Batches, Pictures
from model import Model, Size
from torch import Tensor, nn
from torch.nn import functional

GEOMETRY = 0.2  # weight of the heads' loss beside that of the words


class Heads(nn.Module):
    """Reads from the tower's patches what is true of a side view, and of a front view."""

    def __init__(self, width: int, queries: int = 8) -> None:
        super().__init__()
        self.queries = nn.Parameter(torch.randn(queries, width) * width**-0.5)
        self.key, self.value = nn.Linear(width, width), nn.Linear(width, width)
        self.out = nn.Sequential(
            nn.Linear(queries * width, 256), nn.GELU(), nn.Linear(256, 2 * TARGETS)
        )

    def forward(self, features: Tensor) -> Tensor:
        """(n, 2, TARGETS) of features (n, patches, width)."""
        scores = self.queries @ self.key(features).transpose(1, 2) * features.shape[-1] ** -0.5
        read = scores.softmax(-1) @ self.value(features)
        return self.out(read.flatten(1)).unflatten(1, (2, TARGETS))


class Learner(nn.Module):
    """The model and the heads; only the model is kept in the end."""

    def __init__(self, size: Size, picture_token: int) -> None:
        super().__init__()
        self.model = Model(size)
        self.heads = Heads(size.vision_width)
        self.picture_token = picture_token

    def hidden(self, tokens: Tensor, features: Tensor, order: Tensor) -> Tensor:
        """The language model's last hidden states (b, t, width), with the pictures of these
        features in their places."""
        shown = self.model.tower.project(features)[order].flatten(0, 1)
        embedded = self.model.language.embed(tokens)
        is_place = (tokens == self.picture_token).flatten()
        places = torch.nonzero_static(is_place, size=len(shown))[:, 0]
        flat = embedded.flatten(0, 1).index_copy(0, places, shown.to(embedded.dtype))
        return self.model.language.hidden(flat.view_as(embedded))

    def logits(self, hidden: Tensor) -> Tensor:
        return functional.linear(hidden, self.model.language.embedding.weight)

    def losses(self, batch: Batch, pictures: Pictures, *, vary: bool) -> tuple[Tensor, Tensor]:
        """The weighted mean cross entropy of the replies' tokens [nats], and the heads' loss."""
        device = pictures.pixels.device
        tokens, weights, rows, order = (
            torch.from_numpy(a).to(device, non_blocking=True)
            for a in (batch.tokens, batch.weights, batch.rows, batch.order)
        )
        features = pictures.seen(self.model.tower, rows, vary=vary)
        hidden = self.hidden(tokens, features, order)
        weight = weights[:, 1:].flatten()
        places = torch.nonzero(weight)[:, 0]
        logits = self.logits(hidden[:, :-1].flatten(0, 1)[places])
        right = tokens[:, 1:].flatten()[places]
        each = functional.cross_entropy(logits.float(), right, reduction="none")
        of_words = (each * weight[places]).sum() / weight[places].sum()
        return of_words, pictures.geometry_loss(self.heads(features), rows)


@torch.no_grad()
def validated(learner: Learner, batches: Batches, pictures: Pictures) -> dict[str, float]:
    """Of decisions that were not trained on: the loss, and in how many judgements the model's own
    vote on the picture, which it gives before any reason, is right (balanced); then with a black
    picture, and with another case's, which is not seeing."""
    losses: list[float] = []
    votes: list[tuple[str, Asked, bool]] = []
    device = pictures.pixels.device
    for batch in batches.in_turn(24):
        losses.append(learner.losses(batch, pictures, vary=False)[0].item())
        for how, rows in _shown(batch, pictures):
            features = pictures.seen(
                learner.model.tower, torch.from_numpy(rows).to(device), vary=False
            )
            order = torch.from_numpy(batch.order).to(device)
            hidden = learner.hidden(torch.from_numpy(batch.tokens).to(device), features, order)
            for n, one in enumerate(batch.asked):
                if one.vote is not None and one.shown == "look":
                    said = int(learner.logits(hidden[n, one.vote - 1]).argmax())
                    votes.append((how, one, said == int(batch.tokens[n, one.vote])))
    figures = {"loss": float(np.mean(losses)), "n": sum(how == "seeing" for how, *_ in votes)}
    for how in ("seeing", "black", "other"):
        for name, only in (("", False), (", where the text misleads", True)):
            some = [(a.success, ok) for h, a, ok in votes if h == how and (a.misleads or not only)]
            shares = [
                np.mean([ok for success, ok in some if success == kind])
                for kind in (True, False)
                if any(success == kind for success, _ in some)
            ]
            figures[f"{how}{name}"] = round(float(np.mean(shares)), 4) if shares else math.nan
    return figures


def _shown(batch: Batch, pictures: Pictures) -> list[tuple[str, Any]]:
    """The rows of the pictures as they are, all black, and each another's."""
    return [
        ("seeing", batch.rows),
        ("black", np.full_like(batch.rows, pictures.black)),
        ("other", np.roll(batch.rows, max(1, len(batch.rows) // 2))),
    ]
