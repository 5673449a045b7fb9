"""The network: says how a thing is shifted and turned from where it is expected, and how surely."""

import math

import torch
from torch import Tensor, nn

OUT = 7  # across, along, turn; the logarithm of each one's standard deviation; how sure it is there
SHIFT, TURN = 8.0, math.radians(5.0)  # units of the first three
LEAST, MOST = -5.0, 3.0  # logarithm of a standard deviation in these units


class Block(nn.Module):
    """Two convolutions beside a short cut."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.one = _conv(width, width)
        self.two = _conv(width, width, act=False)

    def forward(self, x: Tensor) -> Tensor:
        return torch.relu(x + self.two(self.one(x)))


class Net(nn.Module):
    """From (n, 5, 128, 128), 0 to 1, to (n, OUT)."""

    def __init__(self) -> None:
        super().__init__()
        self.body = nn.Sequential(
            _conv(5, 16, kernel=5, stride=2),
            _conv(16, 32, stride=2),
            Block(32),
            _conv(32, 64, stride=2),
            Block(64),
            Block(64),
            _conv(64, 96, stride=2),
            Block(96),
            _conv(96, 32, kernel=1),
        )
        self.head = nn.Sequential(
            nn.Flatten(), nn.Linear(32 * 8 * 8, 128), nn.ReLU(), nn.Linear(128, OUT)
        )
        nn.init.zeros_(self.head[-1].weight)
        nn.init.zeros_(self.head[-1].bias)

    def forward(self, x: Tensor) -> Tensor:
        return self.head(self.body(x - 0.5))


def _conv(n: int, out: int, *, kernel: int = 3, stride: int = 1, act: bool = True) -> nn.Module:
    layers: list[nn.Module] = [
        nn.Conv2d(n, out, kernel, stride, kernel // 2, bias=False),
        nn.BatchNorm2d(out),
    ]
    return nn.Sequential(*layers, nn.ReLU()) if act else nn.Sequential(*layers)


def loss_of(out: Tensor, label: Tensor) -> Tensor:
    """Student's t with the stated width where the thing is there, and whether it is there."""
    there = label[:, 3]
    true = label[:, :3] / torch.tensor([SHIFT, SHIFT, TURN], device=out.device)
    spread = out[:, 3:6].clamp(LEAST, MOST)
    off = (out[:, :3] - true) * torch.exp(-spread)
    few = 5.0  # degrees of freedom: outliers count, but not by their square
    unlikely = spread + (few + 1) / 2 * torch.log1p(off**2 / few)
    sure = nn.functional.binary_cross_entropy_with_logits(out[:, 6], there)
    return (there[:, None] * unlikely).sum() / there.sum().clamp(min=1) / 3 + sure
