"""Networks whose normalisations are not what they were at their start."""

from __future__ import annotations

from typing import TypeVar

import torch
from torch import nn

Network = TypeVar("Network", bound=nn.Module)


def change_norms(network: Network) -> Network:
    """Give a network of pictures other normalisations, as if it had learned."""
    torch.manual_seed(3)
    for norm in network.modules():
        if isinstance(norm, nn.BatchNorm2d):
            nn.init.uniform_(norm.weight, 0.5, 1.5)
            nn.init.normal_(norm.bias, 0.0, 0.3)
    with torch.no_grad():
        for _ in range(5):
            network.train()(torch.randn(2, 3, 64, 64))
    network.eval()
    return network
