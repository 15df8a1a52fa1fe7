"""Begin a training with weights of a file, or of ImageNet."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from agribot.autonomy.perceive.segmenter import Segmenter
from agribot.core.errors import ConfigError
from agribot.lab.train.architectures import ARCHITECTURES, find_architecture
from agribot.lab.train.precision import HALF

IMAGENET, RANDOM = "imagenet", "random"
# Top rates of a network that has learned already, and of one whose encoder has.
LEARNING_RATE, IMAGENET_LEARNING_RATE = 1e-3, 1.5e-3


def load_imagenet(model: str, network: nn.Module) -> None:
    """Load the encoder's weights of ImageNet.

    Raises: ConfigError: no weights of ImageNet for networks of this name, or not installed.
    """
    load = find_architecture(model).load_imagenet
    if load is None:
        known = [name for name, one in ARCHITECTURES.items() if one.load_imagenet]
        raise ConfigError(f"--start {IMAGENET}: not for {model}; train {' or '.join(known)}")
    load(network)


def start_from(path: Path, network: nn.Module, x: Tensor) -> None:
    """Give `network` the weights of the file at `path`; `x` (N, C, H, W) is a batch of its input.

    The file has every normalisation folded into the convolution before it. They are taken apart
    again with the statistics of the batch, so that the network answers as the file does and its
    normalisations are about 0 and 1, as training wants them.

    Raises: PerceptionError: no network that runs. ConfigError: one of another architecture.
    """
    weights = read_convolutions(path)
    layers = _list_convolutions(network)
    if [tuple(layer.weight.shape) for layer in layers] != [tuple(w.shape) for w, _ in weights]:
        raise ConfigError(
            f"--start {path}: its {len(weights)} convolutions are not the {len(layers)} of this "
            "network; give the --model that the file was trained as, one of ours"
        )
    set_convolutions(network, weights, x)


def recognise_architecture(path: Path) -> str:
    """Recognise as which network the file at `path` was trained, by its convolutions.

    Raises: PerceptionError: no network that runs. ConfigError: none of ours.
    """
    shapes = [tuple(weight.shape) for weight, _ in read_convolutions(path)]
    for name, architecture in ARCHITECTURES.items():
        layers = _list_convolutions(architecture.build())
        if [tuple(layer.weight.shape) for layer in layers] == shapes:
            return name
    raise ConfigError(
        f"{path}: its {len(shapes)} convolutions are those of no network that can be trained "
        f"further; give one of {', '.join(ARCHITECTURES)}"
    )


def set_convolutions(network: nn.Module, weights: list[tuple[Tensor, Tensor]], x: Tensor) -> None:
    """Give `network` these weights and biases, as of `read_convolutions`.

    `x` is as of `start_from`.
    """
    biases = {}
    with torch.no_grad():
        for layer, (weight, bias) in zip(_list_convolutions(network), weights, strict=True):
            layer.weight.copy_(weight)
            if layer.bias is not None:
                layer.bias.copy_(bias)
            biases[layer] = bias
        _unfold(network, biases, x)


def _list_convolutions(network: nn.Module) -> list[nn.Conv2d]:
    return [module for module in network.modules() if isinstance(module, nn.Conv2d)]


def read_convolutions(path: Path) -> list[tuple[Tensor, Tensor]]:
    """Read the weights and biases of a file in the order in which its graph computes them.

    Raises: PerceptionError: no network that runs. ConfigError: no plain weights.
    """
    import onnx
    from onnx import numpy_helper

    Segmenter(path)  # names a file that is no network
    graph = onnx.load(str(path)).graph
    values = {one.name.removesuffix(HALF): one for one in graph.initializer}
    nodes = [node for node in graph.node if node.op_type == "Conv"]
    if not all(len(node.input) == 3 and values.keys() >= set(node.input[1:]) for node in nodes):
        raise ConfigError(f"{path}: has no plain weights; give the fp32 file")
    arrays = [
        [numpy_helper.to_array(values[name]).astype(np.float32) for name in node.input[1:]]
        for node in nodes
    ]
    return [(torch.from_numpy(w.copy()), torch.from_numpy(b.copy())) for w, b in arrays]


def _unfold(network: nn.Module, biases: dict[nn.Conv2d, Tensor], x: Tensor) -> None:
    """Set each normalisation, in turn, to the statistics of what reaches it."""

    def fit(norm: nn.BatchNorm2d, bias: Tensor) -> None:
        def hook(module: nn.Module, inputs: tuple[Tensor, ...]) -> None:
            variance, mean = torch.var_mean(inputs[0].float(), dim=(0, 2, 3), correction=0)
            assert norm.running_mean is not None and norm.running_var is not None
            norm.running_mean.copy_(mean)
            norm.running_var.copy_(variance)
            norm.weight.copy_((variance + norm.eps).sqrt())
            norm.bias.copy_(bias.to(mean.device) + mean)

        handles.append(norm.register_forward_pre_hook(hook))

    handles: list[torch.utils.hooks.RemovableHandle] = []
    for pair in network.modules():
        if isinstance(pair, nn.Sequential) and len(pair) == 2:
            conv, norm = pair
            if isinstance(conv, nn.Conv2d) and isinstance(norm, nn.BatchNorm2d):
                fit(norm, biases[conv])
    was_training = network.training
    network.eval()(x)
    network.train(was_training)
    for handle in handles:
        handle.remove()
