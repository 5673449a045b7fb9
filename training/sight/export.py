"""Writes a trained network as ONNX, and checks that OpenCV's runtime gives the same numbers.

python export.py out/net.pt learned_sight.onnx
"""

import argparse
import hashlib
from pathlib import Path

import numpy as np
import torch
from net import LEAST, MOST, OUT, SHIFT, TURN, Net
from torch import Tensor, nn

_SAME = 2e-3  # of the outputs' units


class InUnits(nn.Module):
    """The network with outputs in small pixels, radians and standard deviations."""

    def __init__(self, net: Net) -> None:
        super().__init__()
        self.net = net
        self.register_buffer("unit", torch.tensor([[SHIFT, SHIFT, TURN]]))

    def forward(self, x: Tensor) -> Tensor:
        out = self.net(x)
        spread = out[:, 3:6].clamp(LEAST, MOST).exp()
        return torch.cat([out[:, :3] * self.unit, spread * self.unit, out[:, 6:].sigmoid()], 1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("weights", type=Path)
    parser.add_argument("onnx", type=Path)
    given = parser.parse_args()
    net = Net()
    net.load_state_dict(torch.load(given.weights, map_location="cpu", weights_only=True))
    whole = InUnits(net).eval()
    some = torch.rand(2, 5, 128, 128)
    torch.onnx.export(
        whole,
        (some,),
        given.onnx,
        input_names=["shown"],
        output_names=["found"],
        opset_version=17,
        dynamo=False,
    )
    import onnx

    kinds = sorted({node.op_type for node in onnx.load(given.onnx).graph.node})
    content = given.onnx.read_bytes()
    print(f"{len(content)} bytes, sha256 {hashlib.sha256(content).hexdigest()}, {kinds}")
    import cv2

    runtime = cv2.dnn.readNetFromONNX(str(given.onnx))
    runtime.setInput(some.numpy())
    found = runtime.forward()
    with torch.no_grad():
        true = whole(some).numpy()
    assert found.shape == (2, OUT), found.shape
    off = float(np.abs(found - true).max())
    print(f"OpenCV {cv2.__version__} is off by {off:.1e}")
    if not off < _SAME:
        raise SystemExit("OpenCV gives other numbers than PyTorch")


if __name__ == "__main__":
    main()
