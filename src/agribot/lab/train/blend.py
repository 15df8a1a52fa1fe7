"""Weights between those that a training began with and those that it ended with.

A network that learns something more forgets some of what it knew; weights in between know nearly
all of both. Source: Wortsman et al. 2022, Robust fine-tuning of zero-shot models (WiSE-FT).
"""

from __future__ import annotations

import copy
import tempfile
from pathlib import Path

from torch import Tensor, nn

from agribot.lab.train.export import export_onnx
from agribot.lab.train.start import read_convolutions, set_convolutions


def blend_with_start(network: nn.Module, start: Path, share: float, x: Tensor) -> nn.Module:
    """Return `network` with weights `share` of the way from those of a file to its own.

    The file at `start` is of the same network; `x` (N, C, H, W) is a batch of its input. Weights
    are blended with every normalisation folded into the convolution before it, as in the file.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "learned.onnx"
        export_onnx(network, path)
        learned = read_convolutions(path)
    begun = read_convolutions(start)
    blended = copy.deepcopy(network)
    weights = [
        (begun_weight.lerp(weight, share), begun_bias.lerp(bias, share))
        for (begun_weight, begun_bias), (weight, bias) in zip(begun, learned, strict=True)
    ]
    set_convolutions(blended, weights, x)
    return blended.eval()
