"""The original's networks against their description, layer by layer."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from agribot.lab.train.architectures import ARCHITECTURES, find_architecture
from agribot.lab.train.originals import (
    BonnetResidual,
    OriginalBonnet,
    OriginalUNet,
    count_keras_parameters,
    unpooling_mask,
)

HEIGHT_PX, WIDTH_PX = 48, 32
# (channels in, channels out, kernel rows, kernel columns) in the order of the data.
UNET_WIDTHS_IN_OUT = (
    (3, 16), (16, 16), (16, 16), (16, 32), (32, 32), (32, 32), (32, 64), (64, 64), (64, 64),
    (64, 128), (128, 128), (128, 128), (128, 256), (256, 256),
    (256, 128), (256, 128), (128, 128), (128, 64), (128, 64), (64, 64),
    (64, 32), (64, 32), (32, 32), (32, 16), (32, 16), (16, 16),
)  # fmt: skip
UNET_CONVOLUTIONS = [*((i, o, 3, 3) for i, o in UNET_WIDTHS_IN_OUT), (16, 3, 1, 1)]
BONNET_RESIDUAL = [(16, 8, 1, 1), (8, 8, 5, 1), (8, 8, 1, 5), (8, 16, 1, 1)]
BONNET_CONVOLUTIONS = [(10, 16, 5, 5), *(24 * BONNET_RESIDUAL), (16, 3, 1, 1)]


def run_through(network: nn.Module, channels: int) -> list[tuple[nn.Conv2d, tuple[int, ...]]]:
    """Every convolution in the order of the data, with the height and width of its output."""
    seen: list[tuple[nn.Conv2d, tuple[int, ...]]] = []

    def note(module: nn.Module, _inputs: object, output: Tensor) -> None:
        assert isinstance(module, nn.Conv2d)
        seen.append((module, tuple(output.shape[2:])))

    for module in network.modules():
        if isinstance(module, nn.Conv2d):
            module.register_forward_hook(note)
    with torch.inference_mode():
        logits = network.eval()(torch.rand(1, channels, HEIGHT_PX, WIDTH_PX))
    assert logits.shape == (1, 3, HEIGHT_PX, WIDTH_PX)
    return seen


def shape_of(convolution: nn.Conv2d) -> tuple[int, ...]:
    return (convolution.in_channels, convolution.out_channels, *convolution.kernel_size)


@pytest.mark.parametrize(
    ("build", "channels", "layers", "parameters"),
    [
        (OriginalUNet, 3, UNET_CONVOLUTIONS, 2_354_819),
        (lambda: OriginalBonnet(relu_logits=True), 10, BONNET_CONVOLUTIONS, 26_595),
    ],
)
def test_layers_and_parameters_are_those_of_the_original(
    build: Callable[[], nn.Module],
    channels: int,
    layers: list[tuple[int, int, int, int]],
    parameters: int,
) -> None:
    network = build()
    seen = run_through(network, channels)
    assert [shape_of(convolution) for convolution, _ in seen] == layers
    assert all(convolution.bias is not None for convolution, _ in seen)
    assert count_keras_parameters(network) == parameters


def test_bonnet_halves_four_times_and_comes_back() -> None:
    rows = [size[0] for _, size in run_through(OriginalBonnet(relu_logits=True), 10)]
    levels = [HEIGHT_PX >> level for level in (0, 0, 1, 2, 3, 3, 2, 1, 0, 0)]
    # Encoder levels work at 1, 1/2, 1/4, 1/8; decoder levels, each after an unpooling, mirror them.
    per_level = [1, 12, 12, 12, 12, 12, 12, 12, 12, 1]
    assert rows == [
        size for size, count in zip(levels, per_level, strict=True) for _ in range(count)
    ]


def test_unet_halves_four_times_and_comes_back() -> None:
    rows = [size[0] for _, size in run_through(OriginalUNet(), 3)]
    assert rows == [
        HEIGHT_PX >> level
        for level in (
            0,
            0,
            0,
            1,
            1,
            1,
            2,
            2,
            2,
            3,
            3,
            3,
            4,
            4,
            3,
            3,
            3,
            2,
            2,
            2,
            1,
            1,
            1,
            0,
            0,
            0,
            0,
        )
    ]


def test_trainable_parameters_of_bonnet_leave_out_the_running_statistics() -> None:
    network = OriginalBonnet(relu_logits=False)
    assert sum(p.numel() for p in network.parameters() if p.requires_grad) == 26_563


def test_a_residual_block_has_936_parameters_and_adds_only_what_is_positive() -> None:
    block = BonnetResidual()
    assert sum(p.numel() for p in block.parameters()) == 936
    x = torch.randn(1, 16, 8, 8, generator=torch.Generator().manual_seed(0))
    assert (block(x) >= x).all()
    assert (block(x) > x).any()


def test_the_unpooling_mask_marks_maxima_and_keeps_ties() -> None:
    full = torch.tensor([[[[1.0, 2.0, 5.0, 5.0], [0.0, -1.0, 4.0, 5.0]]]])
    pooled = torch.tensor([[[[2.0, 5.0]]]])
    expected = torch.tensor([[[[0.0, 1.0, 1.0, 1.0], [0.0, 0.0, 0.0, 1.0]]]])
    assert torch.equal(unpooling_mask(full, pooled), expected)


def test_the_mask_agrees_with_numpy_on_random_values() -> None:
    full = np.random.default_rng(0).integers(0, 4, (2, 3, 8, 6)).astype(np.float32)
    windows = full.reshape(2, 3, 4, 2, 3, 2)
    pooled = windows.max(axis=(3, 5))
    expected = (windows == pooled[:, :, :, None, :, None]).reshape(full.shape)
    mask = unpooling_mask(torch.from_numpy(full), torch.from_numpy(pooled))
    np.testing.assert_array_equal(mask.numpy(), expected)


@pytest.mark.parametrize(("faithful", "corrected"), [("original-bonnet", "bonnet")])
def test_only_the_faithful_head_loses_negative_logits(faithful: str, corrected: str) -> None:
    torch.manual_seed(3)
    bad, good = (
        find_architecture(faithful).build().eval(),
        find_architecture(corrected).build().eval(),
    )
    good.load_state_dict(bad.state_dict())
    x = torch.rand(1, 10, 32, 32)
    with torch.inference_mode():
        assert (good(x) < 0.0).any()
        torch.testing.assert_close(bad(x), good(x).clamp(min=0.0))


def test_a_pixel_with_only_negative_logits_teaches_the_faithful_head_nothing() -> None:
    for relu_logits in (True, False):
        network = OriginalBonnet(relu_logits=relu_logits)
        with torch.no_grad():
            assert network.head.bias is not None
            network.head.bias.fill_(-100.0)
        target = torch.ones(1, 16, 16, dtype=torch.int64)
        nn.functional.cross_entropy(network(torch.rand(1, 10, 16, 16)), target).backward()  # type: ignore[no-untyped-call]
        gradient = network.stem.weight.grad
        assert gradient is not None
        assert bool(gradient.abs().sum() == 0.0) is relu_logits


def test_the_original_unet_has_a_linear_head() -> None:
    torch.manual_seed(0)
    with torch.inference_mode():
        assert (
            find_architecture("original-unet").build().eval()(torch.rand(1, 3, 32, 32)) < 0.0
        ).any()


def test_ours_are_bigger_than_bonnet_yet_small() -> None:
    counts = {
        name: sum(p.numel() for p in known.build().parameters())
        for name, known in ARCHITECTURES.items()
    }
    assert counts["agribot-s"] == 744_019
    assert counts["agribot-m"] == 3_241_907
