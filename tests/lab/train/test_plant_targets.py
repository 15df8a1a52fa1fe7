from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
import torch

from agribot.autonomy.perceive.stems import CELL_PX
from agribot.core.messages import ByteArray, PlantClass
from agribot.lab.train.augment import choose_windows
from agribot.lab.train.losses import IGNORED
from agribot.lab.train.picture_stack import PictureStack
from agribot.lab.train.plant_loss import plant_loss
from agribot.lab.train.plant_network import BRANCH_MAPS
from agribot.lab.train.plant_targets import (
    HEAT,
    HEAT_WEIGHT,
    MAPS,
    WAY,
    WAY_UNIT_PX,
    WAY_WEIGHT,
    augment_views,
    join_labels,
    make_targets,
)
from agribot.lab.train.plant_truth import LEAST_PX, DrawnView, PlantTruth
from agribot.lab.train.simulated import draw_random_field
from agribot.sim.random_scenes import DENSE
from tests import nightly
from tests.lab.train.whole_pictures import join_target_heat, stack_up, tell_targets

SHAPE = (96, 128)


def draw_discs(*discs: tuple[float, float, float, PlantClass]) -> tuple[ByteArray, PlantTruth]:
    """Draw plants as discs about their stems: u, v, radius, class; the later in front."""
    rows, columns = np.indices(SHAPE)
    label = np.full(SHAPE, PlantClass.SOIL, dtype=np.uint8)
    number = np.zeros(SHAPE, dtype=np.uint16)
    for index, (u, v, radius_px, kind) in enumerate(discs, 1):
        disc = np.hypot(columns - u, rows - v) <= radius_px
        label[disc], number[disc] = kind, index
    stem_px = np.array([disc[:2] for disc in discs], dtype=float).reshape(-1, 2)
    return label, PlantTruth(number, stem_px, np.array([d[3] for d in discs], dtype=np.uint8))


def list_peaks(heat: np.ndarray) -> set[tuple[int, int]]:
    return {(int(row), int(column)) for row, column in np.argwhere(heat == 1.0)}


def follow_ways(targets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where each cell says its stem is, (rows, columns, 2), and whether it counts."""
    rows, columns = np.indices(targets.shape[1:])
    centre_px = np.stack([columns, rows]) * CELL_PX + (CELL_PX - 1) / 2.0
    points = centre_px + targets[WAY] * WAY_UNIT_PX
    return points.transpose(1, 2, 0), targets[WAY_WEIGHT][0] > 0.0


def test_heat_is_one_at_the_square_of_a_stem_of_its_class_and_nowhere_else() -> None:
    discs = ((30.0, 40.0, 12.0, PlantClass.CROP), (90.0, 20.0, 5.0, PlantClass.WEED))
    targets = tell_targets(*draw_discs(*discs))
    weed, crop = join_target_heat(targets)
    assert list_peaks(crop) == {(20, 15)} and list_peaks(weed) == {(10, 45)}
    assert crop[20, 16] > crop[20, 17] > 0.0


def test_every_cell_of_a_plant_says_the_way_to_its_stem() -> None:
    discs = ((30.0, 40.0, 15.0, PlantClass.CROP), (48.0, 44.0, 15.0, PlantClass.CROP))
    label, plants = draw_discs(*discs)
    points, counts = follow_ways(tell_targets(label, plants))
    for index, (u, v) in enumerate(plants.stem_px, 1):
        whole = (plants.number == index).reshape(24, CELL_PX, 32, CELL_PX).all(axis=(1, 3))
        assert whole.sum() > 15 and counts[whole].all()
        np.testing.assert_allclose(points[whole], (u, v) * np.ones((whole.sum(), 2)), atol=1e-4)


def test_a_stem_behind_another_plants_leaf_still_has_its_peak_and_its_place() -> None:
    discs = ((30.0, 40.0, 14.0, PlantClass.WEED), (38.0, 40.0, 12.0, PlantClass.CROP))
    label, plants = draw_discs(*discs)
    assert plants.number[40, 30] == 2
    targets = tell_targets(label, plants)
    points, _ = follow_ways(targets)
    assert list_peaks(join_target_heat(targets)[0]) == {(20, 15)}
    np.testing.assert_allclose(points[10, 7], (30.0, 40.0), atol=1e-4)


def test_a_plant_of_which_little_is_seen_and_a_stem_out_of_the_picture_have_no_peak() -> None:
    discs = ((30.0, 40.0, 1.4, PlantClass.WEED), (-5.0, 60.0, 15.0, PlantClass.CROP))
    label, plants = draw_discs(*discs)
    assert 0 < (plants.number == 1).sum() < LEAST_PX < (plants.number == 2).sum()
    targets = tell_targets(label, plants)
    assert not (targets[HEAT] == 1.0).any()
    points, counts = follow_ways(targets)
    assert counts.any()
    np.testing.assert_allclose(points[counts], (-5.0, 60.0) * np.ones((counts.sum(), 2)), atol=1e-4)


def test_a_small_plant_counts_for_the_ways_more_than_its_area() -> None:
    discs = ((30.0, 40.0, 5.0, PlantClass.WEED), (90.0, 45.0, 20.0, PlantClass.CROP))
    targets = tell_targets(*draw_discs(*discs))
    weight = targets[WAY_WEIGHT][0]
    small, big = weight[:, :16], weight[:, 16:]
    cells = (big > 0.0).sum() / (small > 0.0).sum()
    assert cells > 6.0
    assert big.sum() / small.sum() == pytest.approx(math.sqrt(cells), rel=1e-3)


def test_heat_does_not_count_where_nobody_knows_the_class() -> None:
    label, plants = draw_discs((30.0, 40.0, 12.0, PlantClass.CROP))
    label[:21] = IGNORED
    counted = tell_targets(label, plants)[HEAT_WEIGHT][0]
    assert not counted[:6].any() and counted[6:].all()


def test_the_classes_of_all_pixels_come_back_out_of_a_target() -> None:
    label, plants = draw_discs(
        (30.0, 40.0, 12.0, PlantClass.CROP), (90.3, 20.0, 5.0, PlantClass.WEED)
    )
    label[0, :7] = IGNORED
    targets = torch.from_numpy(tell_targets(label, plants))[None]
    np.testing.assert_array_equal(join_labels(targets)[0].numpy(), label)


def test_a_crop_of_a_picture_moves_stems_with_their_pixels() -> None:
    label, plants = draw_discs((40.0, 50.0, 8.0, PlantClass.CROP))
    stack, chosen = stack_up(label, plants), np.zeros(30, dtype=np.int64)
    windows = choose_windows(stack, chosen, 64, np.random.default_rng(0))
    assert set(windows.is_mirrored.tolist()) == {True, False}
    numbers = windows.cut_pixels(stack.numbers[chosen])
    images = windows.cut_images(numbers_as_images(stack)[chosen])
    points_px = windows.move_points(stack.stems_px[chosen])[:, 0]
    whole = 0
    for number, image, (u, v) in zip(numbers, images, points_px, strict=True):
        rows, columns = np.nonzero(number.numpy())
        if len(rows) and min(rows.min(), columns.min()) > 0 and max(*rows, *columns) < 63:
            whole += 1
            assert abs(columns.mean() - u) < 0.7 and abs(rows.mean() - v) < 0.7
            assert float((image[0] / 255.0 - number).abs().mean()) < 0.03
    assert whole > 5


def numbers_as_images(stack: PictureStack) -> torch.Tensor:
    return (255 * stack.numbers[..., None].expand(-1, -1, -1, 3)).to(torch.uint8)


def test_of_a_batch_every_picture_has_the_target_that_it_has_alone() -> None:
    pictures = [
        draw_discs((30.0, 40.0, 14.0, PlantClass.WEED), (38.0, 40.0, 12.0, PlantClass.CROP)),
        draw_discs(),
        draw_discs((90.0, 20.0, 5.0, PlantClass.WEED)),
    ]
    stack = PictureStack(
        (DrawnView(np.zeros((*SHAPE, 3), dtype=np.uint8), *picture) for picture in pictures), 3
    )
    together = make_targets(
        stack.labels.to(torch.int64),
        stack.numbers.to(torch.int64),
        stack.stems_px,
        stack.kinds.to(torch.int64),
    )
    for picture, target in zip(pictures, together, strict=True):
        np.testing.assert_array_equal(target.numpy(), tell_targets(*picture))


def test_the_loss_is_least_for_the_maps_of_the_truth() -> None:
    discs = ((30.0, 40.0, 12.0, PlantClass.CROP), (90.0, 20.0, 5.0, PlantClass.WEED))
    target = torch.from_numpy(tell_targets(*draw_discs(*discs)))[None]
    peak = torch.where(target[:, HEAT] == 1.0, 12.0, -12.0)
    right = torch.cat([peak, target[:, WAY]], dim=1)
    moved = torch.cat([peak.roll(2, dims=3), target[:, WAY]], dim=1)
    swapped = torch.cat([peak.flip(1), target[:, WAY]], dim=1)
    astray = torch.cat([peak, target[:, WAY] + 0.1], dim=1)
    none = torch.cat([torch.full_like(peak, -12.0), target[:, WAY]], dim=1)
    least = float(plant_loss(right, target))
    assert least < 0.01
    for worse in (moved, swapped, astray, none):
        assert float(plant_loss(worse, target)) > least + 0.5


def test_a_picture_without_plants_has_a_loss_that_learns() -> None:
    label, plants = draw_discs()
    target = torch.from_numpy(tell_targets(label, plants))[None]
    maps = torch.zeros((1, BRANCH_MAPS, *target.shape[2:]), requires_grad=True)
    loss = plant_loss(maps, target)
    loss.backward()  # type: ignore[no-untyped-call]
    assert maps.grad is not None and torch.isfinite(maps.grad).all()
    assert (maps.grad[:, HEAT] > 0.0).all() and not maps.grad[:, WAY].any()


@pytest.mark.slow
@nightly.all_or_first("scenes", (1, 0, 2, 3), in_suite=1, unit="scenes")
def test_drawn_stems_stand_among_the_pixels_of_their_plants(scenes: Sequence[int]) -> None:
    inside, count = 0, 0
    for seed in scenes:
        view = next(draw_random_field(np.random.default_rng([71, seed]), 1, DENSE))
        number, height, width = view.plants.number, *view.label.shape
        assert set(np.unique(view.label[number > 0])) <= {0, 1, IGNORED}
        for index, (u, v) in enumerate(view.plants.stem_px, 1):
            rows, columns = np.nonzero(number == index)
            is_cut = min(rows.min(), columns.min()) == 0
            is_cut |= rows.max() == height - 1 or columns.max() == width - 1
            if is_cut or len(rows) < 60:
                continue
            near_px = 3.0 + 0.3 * math.sqrt(len(rows))
            count += 1
            inside += bool(
                rows.min() - near_px <= v <= rows.max() + near_px
                and columns.min() - near_px <= u <= columns.max() + near_px
            )
            kinds = np.bincount(view.label[rows, columns], minlength=256)[:2]
            assert kinds.argmax() == view.plants.kind[index - 1] or not kinds.any()
    assert count > 10 * len(scenes)
    assert inside / count > 0.9


@pytest.mark.slow
def test_batches_of_views_repeat_with_their_seed() -> None:
    views: list[DrawnView] = list(draw_random_field(np.random.default_rng([71, 9]), 2, DENSE))
    stack = PictureStack(views, 2)
    images, targets = augment_views(stack, 2, 160, np.random.default_rng(1))
    again, targets_again = augment_views(stack, 2, 160, np.random.default_rng(1))
    assert images.shape == (2, 3, 160, 160) and targets.shape == (2, MAPS, 40, 40)
    assert torch.equal(images, again) and torch.equal(targets, targets_again)
