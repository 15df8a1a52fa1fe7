"""A network that forgot the weeds for the crop is made to name both alike."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("torch")

import torch

from agribot.core.messages import PlantClass
from agribot.lab.adapt.balance import NAMED_OFFSETS, OFFSETS, BalanceJudge, find_head
from agribot.lab.adapt.place_names import TaughtPicture
from agribot.lab.rows.lines import PhotoCamera, PhotoCameras, trace_lines
from agribot.lab.train.architectures import find_architecture
from agribot.lab.train.judged_figures import BALANCED
from tests.lab.rows.drawn_rows import (
    PLANT_RGB,
    SIDE_PX,
    WEED_RGB,
    draw_field,
    draw_labels,
)

SIZE_PX = (32, 32)


class Net(torch.nn.Module):
    """Weed by red, crop by green, soil by blue, and a lean of its own to weed or crop."""

    def __init__(self, weed: float = 0.0, crop: float = 0.0) -> None:
        super().__init__()
        head = torch.nn.Conv2d(3, 3, 1)
        with torch.no_grad():
            head.weight.copy_(torch.eye(3)[:, :, None, None])
            head.load_state_dict({"weight": head.weight, "bias": torch.tensor([weed, crop, 0.0])})
        self.head = head
        self.decoder = torch.nn.ModuleDict({"head": head})

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        logits: torch.Tensor = self.head(x)
        return logits


def picture(camera: PhotoCamera | None = None) -> TaughtPicture:
    """Show crop, weed and soil in three columns, of pure colours."""
    label = np.full(SIZE_PX, PlantClass.SOIL, np.uint8)
    label[:, :10], label[:, 10:20] = PlantClass.CROP, PlantClass.WEED
    return TaughtPicture((255 * (np.arange(3) == label[..., None])).astype(np.uint8), label, camera)


def judge() -> BalanceJudge:
    return BalanceJudge([picture()], SIZE_PX, lambda x: x / 255.0)


@pytest.mark.parametrize(("weed", "crop"), [(0.0, 1.5), (1.5, 0.0)])
def test_a_network_that_leans_to_one_name_gets_an_offset_that_takes_it_back(
    weed: float, crop: float
) -> None:
    net = Net(weed, crop)
    unchanged = int(np.abs(OFFSETS).argmin())
    assert float(judge()._score(net)[unchanged]) == 0.5
    assert judge()(net) == {BALANCED: 1.0}
    offset = judge().balance(net)
    assert abs(offset - (crop - weed)) < 1.05
    assert float(judge()._score(net)[unchanged]) == 1.0


def test_a_network_that_names_both_alike_is_left_alone() -> None:
    assert judge().balance(Net()) == 0.0


def test_place_names_what_looks_like_crop_between_rows_without_any_offset() -> None:
    net = Net(crop=0.5)
    with torch.no_grad():  # both greens alike are plants, and the brown is soil
        net.head.weight.copy_(
            torch.tensor([[-9.0, 9, 0], [-9, 9, 0], [9, -9, 0]])[:, :, None, None]
        )
    rows, weeds, size_px = (-1.0, 0.0, 1.0), (-0.5, 0.5), (SIDE_PX, SIDE_PX)
    field = draw_field(rows, weeds)
    label = np.full(size_px, PlantClass.SOIL, np.uint8)
    label[(field == PLANT_RGB).all(axis=2)] = PlantClass.CROP
    label[(field == WEED_RGB).all(axis=2)] = PlantClass.WEED
    traced = trace_lines(np.asarray(draw_labels(rows)) > 0)
    shown = TaughtPicture(field, label, PhotoCameras([traced]).find(traced))
    by_rows = BalanceJudge([shown], size_px, lambda x: x / 255.0)
    assert float(by_rows._score(net)[np.abs(OFFSETS).argmin()]) == 0.5
    assert float(by_rows._score_names(net)[np.abs(NAMED_OFFSETS).argmin()]) > 0.95
    assert by_rows.balance(net) == 0.0


@pytest.mark.parametrize("name", ["agribot-plants", "agribot-sim", "agribot-s"])
def test_the_last_layer_of_each_own_network_is_found(name: str) -> None:
    head = find_head(find_architecture(name).build())
    assert head is not None and head.bias is not None
    assert len(head.bias) == len(PlantClass)
