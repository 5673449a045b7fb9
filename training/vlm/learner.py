"""What is trained: the model, beside heads that read from its tower what is true in a picture."""

import math
from typing import Any

import numpy as np
import torch
from dataset import POINTS, RELATIVE, SHIFT, TARGETS, UNITS, Asked, Batch, Batches, Pictures
from model import Model, Size
from torch import Tensor, nn
from torch.nn import functional

GEOMETRY = 0.3  # weight of the heads' loss beside that of the words
BINS, A_UNIT = 97, 10  # steps in which a token tells a target, and how many are one of its units


class Heads(nn.Module):
    """Reads what is true in a side view, and in a front view: where points are, from the tower's
    patches; and how the peg lies, from every language token of a picture alone, in steps of a
    millimetre or half a degree: a language model finds the figures in steps at once, and in one
    number hardly."""

    centres: Tensor
    steps: Tensor

    def __init__(self, size: Size) -> None:
        super().__init__()
        self.size = size
        self.where = nn.Linear(size.vision_width, 2 * POINTS)
        self.beside = nn.Linear(size.vision_width, 2 * POINTS * 2)
        self.told = nn.Sequential(
            nn.LayerNorm(size.width), nn.Linear(size.width, 2 * TARGETS * BINS)
        )
        down, across = torch.meshgrid(
            torch.arange(size.rows), torch.arange(size.columns), indexing="ij"
        )
        centres = (torch.stack([across, down], -1).flatten(0, 1) + 0.5) * size.patch
        self.register_buffer("centres", centres, persistent=False)
        steps = (torch.arange(BINS) - BINS // 2) / A_UNIT
        self.register_buffer("steps", steps, persistent=False)

    def losses(
        self, features: Tensor, tokens: Tensor, pictures: Pictures, rows: Tensor, by: Tensor
    ) -> tuple[Tensor, Tensor]:
        """How far from the truth it is where the points are said to be, and what is told; `by`
        (n, 2): the pixels by which the pictures are shifted."""
        if not pictures.drawn:
            return 0.0 * features.sum(), 0.0 * tokens.sum()
        true, points, front, known = pictures.geometry(rows)
        which = front.long()
        one = torch.arange(len(rows), device=rows.device)
        heat = self.where(features).float().unflatten(-1, (2, POINTS))[one, :, which]
        beside = self.beside(features).float().unflatten(-1, (2, POINTS, 2))[one, :, which]
        points = points + by[:, None]
        limit = torch.tensor(
            [self.size.picture_width, self.size.picture_height], device=rows.device
        )
        inside = known[:, None] & ((points >= 0) & (points < limit)).all(-1)
        patch = (points / self.size.patch).long().clamp(min=0)
        patch = (patch[..., 1] * self.size.columns + patch[..., 0]).clamp(max=len(self.centres) - 1)
        named = functional.cross_entropy(
            heat.transpose(1, 2).flatten(0, 1), patch.flatten(), reduction="none"
        )
        share = heat.softmax(1)[..., None]
        place = (share * (self.centres[:, None] + beside * self.size.patch)).sum(1)
        off = functional.smooth_l1_loss(
            place / self.size.patch, points / self.size.patch, reduction="none", beta=0.05
        ).sum(-1)
        each = (off.flatten() + 0.1 * named) * inside.flatten()
        of_places = each.sum() / inside.sum().clamp(min=1)
        valid = known[:, None].expand(-1, TARGETS).clone()
        valid[:, RELATIVE:] &= (by == 0).all(-1)[:, None]
        told = self.told(tokens).float().unflatten(-1, (2, TARGETS, BINS))[one, :, which]
        told = told.log_softmax(-1).mean(1)
        at = (true * A_UNIT + BINS // 2).clamp(0, BINS - 1.001)[..., None]
        low, share = at.long(), at.frac()
        wrong = -(told.gather(-1, low) * (1 - share) + told.gather(-1, low + 1) * share)[..., 0]
        return of_places, (wrong * valid).sum() / valid.sum().clamp(min=1)

    @torch.no_grad()
    def measured(self, tokens: Tensor, front: Tensor) -> Tensor:
        """What the tokens of a picture tell together (n, TARGETS)."""
        told = self.told(tokens).float().unflatten(-1, (2, TARGETS, BINS)).log_softmax(-1).mean(1)
        told = told[torch.arange(len(front), device=front.device), front.long()]
        return (told.softmax(-1) * self.steps).sum(-1)


class Learner(nn.Module):
    """The model and the heads; only the model is kept in the end."""

    def __init__(self, size: Size, picture_token: int) -> None:
        super().__init__()
        self.model = Model(size)
        self.heads = Heads(size)
        self.picture_token = picture_token

    def hidden(self, tokens: Tensor, pictures: Tensor, order: Tensor) -> Tensor:
        """The language model's last hidden states (b, t, width), with the tokens of these pictures
        (n, t, width) in their places."""
        shown = pictures[order].flatten(0, 1)
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
        features = self.model.tower.features(pictures.normal(rows, vary=vary))
        shown = self.model.tower.project(features)
        hidden = self.hidden(tokens, shown, order)
        weight = weights[:, 1:].flatten()
        places = torch.nonzero(weight)[:, 0]
        logits = self.logits(hidden[:, :-1].flatten(0, 1)[places])
        right = tokens[:, 1:].flatten()[places]
        each = functional.cross_entropy(logits.float(), right, reduction="none")
        of_words = (each * weight[places]).sum() / weight[places].sum()
        still = torch.zeros((len(rows), 2), dtype=torch.long, device=device)
        return of_words, sum(self.heads.losses(features, shown, pictures, rows, still))

    def sight(self, pictures: Pictures, rows: Tensor) -> tuple[Tensor, Tensor]:
        """The heads' losses alone, half of the pictures being shifted."""
        x = pictures.normal(rows, vary=True)
        by = torch.randint(-SHIFT, SHIFT + 1, (len(rows), 2), device=x.device)
        by[::2] = 0
        features = self.model.tower.features(pictures.shifted(x, by))
        return self.heads.losses(features, self.model.tower.project(features), pictures, rows, by)


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
            seen = pictures.normal(torch.from_numpy(rows).to(device), vary=False)
            shown = learner.model.tower(seen)
            order = torch.from_numpy(batch.order).to(device)
            hidden = learner.hidden(torch.from_numpy(batch.tokens).to(device), shown, order)
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


@torch.no_grad()
def measured(learner: Learner, pictures: Pictures, rows: Tensor) -> dict[str, list[float]]:
    """How far, in pictures, what their tokens tell is from the truth: of each target the median and
    the 95th percentile [mm or degrees]."""
    found: dict[str, list[Tensor]] = {"side": [], "front": []}
    for some in rows.split(128):
        true, _, front, known = pictures.geometry(some)
        shown = learner.model.tower(pictures.normal(some, vary=False))
        off = (learner.heads.measured(shown, front) - true).abs()
        off = off * torch.tensor(UNITS, device=off.device)
        for name, which in (("side", ~front & known), ("front", front & known)):
            found[name].append(off[which])
    return {
        f"{name}, {what}": [round(v, 2) for v in torch.cat(parts).quantile(q, 0).tolist()]
        for name, parts in found.items()
        for what, q in (("median", 0.5), ("95 %", 0.95))
        if sum(map(len, parts))
    }
