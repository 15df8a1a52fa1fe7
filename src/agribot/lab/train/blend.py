"""Weights between those that a training ended with and others, as those that it began with.

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


def blend_weights(network: nn.Module, other: Path, share: float, x: Tensor) -> nn.Module:
    """Return `network` with weights `share` of the way from those of a file to its own.

    The file at `other` is of the same network; `x` (N, C, H, W) is a batch of its input. Weights
    are blended with every normalisation folded into the convolution before it, as in the file.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "learned.onnx"
        export_onnx(network, path)
        learned = read_convolutions(path)
    others = read_convolutions(other)
    blended = copy.deepcopy(network)
    weights = [
        (other_weight.lerp(weight, share), other_bias.lerp(bias, share))
        for (other_weight, other_bias), (weight, bias) in zip(others, learned, strict=True)
    ]
    set_convolutions(blended, weights, x)
    return blended.eval()
