"""Trains the network on what `data.py` made, on a graphics card or a processor.

    python train.py data out --minutes 3 --device cuda

Every checkpoint holds all that is needed to go on: call it again with the same `out`.
"""

import argparse
import json
import math
import time
from pathlib import Path

import numpy as np
import torch
from net import SHIFT, TURN, Net, loss_of
from torch import Tensor

_HELD_OUT = 0.04  # of every file's pictures, its last: for the log and for calibration
_CHUNK = 4096  # rows that are copied at a time


def load(folder: Path, device: str, most: int) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Pictures and labels, of training and held out. All of a file's last pictures are held out."""
    files = sorted(folder.glob("labels-*.npy"))
    kept: list[tuple[np.ndarray, np.ndarray]] = []
    held: list[tuple[np.ndarray, np.ndarray]] = []
    for file in files:
        labels = np.load(file)
        shown = np.load(file.with_name(file.name.replace("labels", "shown")), mmap_mode="r")
        n = min(len(labels), most // len(files))
        cut = round(n * (1 - _HELD_OUT)) // 6 * 6
        kept.append((shown[:cut], labels[:cut]))
        held.append((shown[cut:n], labels[cut:n]))
    return (*_joined(kept, device), *_joined(held, device))


def _joined(parts: list[tuple[np.ndarray, np.ndarray]], device: str) -> tuple[Tensor, Tensor]:
    rows = sum(len(labels) for _, labels in parts)
    pictures = torch.empty((rows, *parts[0][0].shape[1:]), dtype=torch.uint8, device=device)
    at = 0
    for shown, _ in parts:
        for start in range(0, len(shown), _CHUNK):
            some = torch.from_numpy(np.array(shown[start : start + _CHUNK]))
            pictures[at : at + len(some)] = some.to(device)
            at += len(some)
    labels = torch.from_numpy(np.concatenate([part for _, part in parts])).to(device)
    return pictures, labels


def varied(pictures: Tensor, labels: Tensor) -> tuple[Tensor, Tensor]:
    """Pictures mirrored, with their colours exchanged, brighter or darker, noisier or softer."""
    n, device = len(pictures), pictures.device
    x, y = pictures.float() / 255, labels.clone()
    mirrored = torch.rand(n, device=device) < 0.5
    x = torch.where(mirrored[:, None, None, None], x.flip(3), x)
    y[:, 0] = torch.where(mirrored, -y[:, 0], y[:, 0])
    y[:, 2] = torch.where(mirrored, -y[:, 2], y[:, 2])
    colours, rest = x[:, :3], x[:, 3:]
    order = torch.rand(n, 3, device=device).argsort(1)
    colours = colours.gather(1, order[:, :, None, None].expand_as(colours))
    dark = 2 ** (0.6 * (2 * torch.rand(n, 1, 1, 1, device=device) - 1))
    colours = (colours.clamp(min=1e-4) ** dark) * (
        0.7 + 0.6 * torch.rand(n, 3, 1, 1, device=device)
    )
    noise = 0.025 * torch.rand(n, 1, 1, 1, device=device)
    colours = (colours + noise * torch.randn_like(colours)).clamp(0, 1)
    return torch.cat([colours, rest], 1), y


@torch.no_grad()
def outputs(net: Net, pictures: Tensor) -> Tensor:
    net.eval()
    found = [net(pictures[k : k + 1024].float() / 255) for k in range(0, len(pictures), 1024)]
    return torch.cat(found).float()


def judged(net: Net, pictures: Tensor, labels: Tensor) -> dict[str, float]:
    """How well held-out pictures are measured, and by what factor the stated widths are too
    small."""
    if not len(labels):
        return {}
    out, figures = outputs(net, pictures), {}
    figures["loss"] = float(loss_of(out, labels))
    there = labels[:, 3] > 0.5
    figures["there, right"] = float(((out[:, 6] > 0) == there).float().mean())
    unit = torch.tensor([SHIFT, SHIFT, TURN], device=out.device)
    for name, first in (("first", True), ("later", False)):
        some = there & ((labels[:, 4] > 0.5) == first)
        if some.sum() < 20:
            continue
        off = (out[some, :3] * unit - labels[some, :3]).abs()
        z = off / (unit * out[some, 3:6].exp())
        for k, what in enumerate(("across", "along", "turn")):
            scale = 180 / math.pi if k == 2 else 1.0
            figures[f"{name} {what} median"] = float(off[:, k].median()) * scale
            figures[f"{name} {what} 95 %"] = float(off[:, k].quantile(0.95)) * scale
            figures[f"{name} {what} z95"] = float(z[:, k].quantile(0.95)) / 1.96
    return figures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--minutes", type=float, default=3.0, help="how long it trains")
    parser.add_argument("--steps", type=int, default=0, help="of the schedule; 0: from the speed")
    parser.add_argument("--batch", type=int, default=512)
    parser.add_argument("--rate", type=float, default=2e-3)
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--most", type=int, default=10**9, help="small pictures that are loaded")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    log = (given.out / "train.log").open("a", encoding="utf-8")

    def say(text: str) -> None:
        print(text, flush=True)
        print(text, file=log, flush=True)

    torch.manual_seed(0)
    began = time.monotonic()
    pictures, labels, held, held_labels = load(given.data, given.device, given.most)
    say(
        f"{len(labels)} small pictures, {len(held_labels)} held out,"
        f" {time.monotonic() - began:.0f} s"
    )
    cuda = given.device.startswith("cuda")
    net = Net().to(given.device)
    if cuda:
        net = net.to(memory_format=torch.channels_last)
    say(f"{sum(p.numel() for p in net.parameters())} parameters")
    decayed = [p for p in net.parameters() if p.ndim > 1]
    others = [p for p in net.parameters() if p.ndim <= 1]
    optimiser = torch.optim.AdamW(
        [{"params": decayed, "weight_decay": 0.02}, {"params": others, "weight_decay": 0.0}],
        lr=given.rate,
    )
    average = torch.optim.swa_utils.AveragedModel(
        net, multi_avg_fn=torch.optim.swa_utils.get_ema_multi_avg_fn(0.998), use_buffers=True
    )
    step, spent, checkpoint = 0, 0.0, given.out / "checkpoint.pt"
    if checkpoint.is_file():
        kept = torch.load(checkpoint, map_location=given.device, weights_only=True)
        net.load_state_dict(kept["net"])
        average.load_state_dict(kept["average"])
        optimiser.load_state_dict(kept["optimiser"])
        step, spent = kept["step"], kept["spent"]
        say(f"goes on at step {step}")

    def keep() -> None:
        state = {
            "net": net.state_dict(),
            "average": average.state_dict(),
            "optimiser": optimiser.state_dict(),
            "step": step,
            "spent": spent,
        }
        torch.save(state, checkpoint.with_suffix(".part"))
        checkpoint.with_suffix(".part").replace(checkpoint)

    seconds, began, last = 60 * given.minutes, time.monotonic() - spent, time.monotonic()
    running = 0.0
    while True:
        spent = time.monotonic() - began
        done = step / given.steps if given.steps else spent / seconds
        if done >= 1.0:
            break
        rate = given.rate * min(1.0, (step + 1) / 300) * 0.5 * (1 + math.cos(math.pi * done))
        for group in optimiser.param_groups:
            group["lr"] = rate
        net.train()
        rows = torch.randint(len(labels), (given.batch,), device=given.device)
        x, y = varied(pictures[rows], labels[rows])
        if cuda:
            x = x.contiguous(memory_format=torch.channels_last)
        with torch.autocast("cuda", dtype=torch.bfloat16, enabled=cuda):
            out = net(x)
        loss = loss_of(out.float(), y)
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(net.parameters(), 5.0)
        optimiser.step()
        average.update_parameters(net)
        step += 1
        if step % 50 == 0:
            running = float(loss)
        if time.monotonic() - last > (15 if cuda else 120):
            last = time.monotonic()
            figures = judged(average.module, held[:4096], held_labels[:4096])
            brief = {k: round(v, 3) for k, v in figures.items() if "median" in k or k == "loss"}
            say(f"step {step}, {spent:.0f} s, loss {running:.3f}: {json.dumps(brief)}")
            keep()
    keep()
    figures = judged(average.module, held, held_labels)
    say(json.dumps({k: round(v, 4) for k, v in figures.items()}, indent=1))
    # The stated widths are made true on later looks, which are what is reported.
    wide = [max(0.2, figures.get(f"later {w} z95", 1.0)) for w in ("across", "along", "turn")]
    with torch.no_grad():
        average.module.head[-1].bias[3:6] += torch.log(torch.tensor(wide, device=given.device))
    torch.save({k: v.cpu() for k, v in average.module.state_dict().items()}, given.out / "net.pt")
    say(f"stated widths times {wide}")


if __name__ == "__main__":
    main()
