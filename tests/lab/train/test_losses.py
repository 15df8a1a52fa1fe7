"""Each loss against the same formula in NumPy."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pytest
import torch

from agribot.lab.train.losses import (
    IGNORED,
    OF_ROWS,
    OVERLAP_LOSSES,
    dice_loss,
    generalised_dice_loss,
    iou_loss,
    lovasz_softmax,
    mixed_loss,
    pooled_dice_loss,
    segmentation_loss,
    squared_dice_loss,
    weighted_cross_entropy,
)

Array = npt.NDArray[np.float64]


class Case(NamedTuple):
    logits: torch.Tensor
    target: torch.Tensor
    p: Array  # (pixels that count, 3)
    y: npt.NDArray[np.int64]


@pytest.fixture(params=[0, 1, 2])
def case(request: pytest.FixtureRequest) -> Case:
    rng = np.random.default_rng(request.param)
    logits = rng.normal(0.0, 2.0, (2, 3, 9, 7))
    target = rng.integers(0, 3, (2, 9, 7))
    if request.param == 1:
        target[:, :3] = IGNORED
    if request.param == 2:
        target[target == 1] = 2  # a class that does not occur
    powers = np.exp(logits - logits.max(axis=1, keepdims=True))
    p = np.moveaxis(powers / powers.sum(axis=1, keepdims=True), 1, 3)
    counted = target != IGNORED
    return Case(torch.from_numpy(logits), torch.from_numpy(target), p[counted], target[counted])


def test_weighted_cross_entropy(case: Case) -> None:
    weights = (0.15, 0.75, 0.10)
    expected = np.mean(-np.take(weights, case.y) * np.log(case.p[np.arange(len(case.y)), case.y]))
    found = weighted_cross_entropy(case.logits.float(), case.target, weights)
    assert float(found) == pytest.approx(expected, rel=1e-5)


def test_dice(case: Case) -> None:
    ratios = []
    for kind in np.unique(case.y):
        truth = (case.y == kind).astype(float)
        guess = case.p[:, kind]
        ratios.append((2 * (guess * truth).sum() + 1) / (guess.sum() + truth.sum() + 1))
    assert float(dice_loss(case.logits, case.target)) == pytest.approx(1 - np.mean(ratios))


def test_pooled_dice(case: Case) -> None:
    truth = np.eye(3)[case.y]
    expected = 1 - (2 * (case.p * truth).sum() + 1) / (case.p.sum() + truth.sum() + 1)
    assert float(pooled_dice_loss(case.logits, case.target)) == pytest.approx(expected)


def test_generalised_dice(case: Case) -> None:
    truth = np.eye(3)[case.y]
    area = truth.sum(axis=0)
    weight = np.where(area > 0, 1 / np.maximum(area, 1) ** 2, 0)
    overlap = (weight * (case.p * truth).sum(axis=0)).sum()
    expected = 1 - 2 * overlap / (weight * (case.p.sum(axis=0) + area)).sum()
    found = float(generalised_dice_loss(case.logits, case.target))
    assert found == pytest.approx(expected, rel=1e-5)


def test_squared_dice_is_the_mean_over_the_classes_of_each_picture(case: Case) -> None:
    ratios = []
    for logits, target in zip(case.logits.numpy(), case.target.numpy(), strict=True):
        counted = target != IGNORED
        powers = np.exp(logits - logits.max(axis=0))
        p, y = (powers / powers.sum(axis=0))[:, counted], target[counted]
        for kind in np.unique(y):
            truth = (y == kind).astype(float)
            total = (p[kind] ** 2).sum() + (truth**2).sum()
            ratios.append((2 * (p[kind] * truth).sum() + 1) / (total + 1))
    assert float(squared_dice_loss(case.logits, case.target)) == pytest.approx(1 - np.mean(ratios))


@pytest.mark.parametrize("name", [name for name, loss in OVERLAP_LOSSES.items() if loss])
def test_a_right_and_sure_picture_costs_nothing_and_one_that_is_ignored_does_not_count(
    name: str,
) -> None:
    loss = OVERLAP_LOSSES[name]
    assert loss is not None
    target = torch.arange(3).repeat(1, 4, 4)[:, :, :9]
    sure = 40.0 * torch.nn.functional.one_hot(target, 3).permute(0, 3, 1, 2).float()
    assert float(loss(sure, target)) == pytest.approx(0.0, abs=1e-4)
    assert float(loss(-sure, target)) > 0.3
    ignored = torch.full_like(target, IGNORED)
    half = torch.cat([sure, -sure]), torch.cat([target, ignored])
    assert float(loss(*half)) == pytest.approx(0.0, abs=1e-4)


def test_iou(case: Case) -> None:
    ratios = []
    for kind in np.unique(case.y):
        truth = (case.y == kind).astype(float)
        guess = case.p[:, kind]
        overlap = (guess * truth).sum()
        ratios.append((overlap + 1) / (guess.sum() + truth.sum() - overlap + 1))
    assert float(iou_loss(case.logits, case.target)) == pytest.approx(1 - np.mean(ratios))


def jaccard_loss(chosen: set[int], truth: set[int]) -> float:
    """Loss of the set function: mispredicted pixels over the union with the truth."""
    return len(chosen) / len(truth | chosen) if truth | chosen else 0.0


def test_lovasz_is_the_lovasz_extension_of_the_jaccard_loss(case: Case) -> None:
    losses = []
    for kind in np.unique(case.y):
        truth = set(np.flatnonzero(case.y == kind).tolist())
        errors = np.abs((case.y == kind) - case.p[:, kind])
        total, taken, before = 0.0, set[int](), 0.0
        for index in np.argsort(-errors, kind="stable").tolist():
            taken.add(index)
            now = jaccard_loss(taken, truth)
            total += errors[index] * (now - before)
            before = now
        losses.append(total)
    found = float(lovasz_softmax(case.logits, case.target))
    assert found == pytest.approx(np.mean(losses), rel=1e-6)


def test_a_sample_of_the_pixels_stands_for_all() -> None:
    torch.manual_seed(0)
    logits, target = torch.randn(2, 3, 100, 100), torch.randint(0, 3, (2, 100, 100))
    whole = lovasz_softmax(logits, target, most_px=20_000)
    assert float(lovasz_softmax(logits, target, most_px=8_000)) == pytest.approx(
        float(whole), abs=0.01
    )


def test_a_batch_without_a_single_counted_pixel_costs_nothing() -> None:
    logits = torch.randn(1, 3, 4, 4, requires_grad=True)
    loss = lovasz_softmax(logits, torch.full((1, 4, 4), IGNORED))
    loss.backward()  # type: ignore[no-untyped-call]
    assert float(loss.detach()) == 0.0


def test_without_overlap_the_loss_is_the_original_s(case: Case) -> None:
    logits, weights = case.logits.float(), (0.9, 0.11, 0.1)
    alone = weighted_cross_entropy(logits, case.target, weights)
    assert float(segmentation_loss(logits, case.target, weights, None)) == float(alone)


def test_the_sum_is_entropy_and_overlap(case: Case) -> None:
    logits = case.logits.float()
    weights = (1.0, 2.0, 0.6)
    entropy = torch.nn.functional.cross_entropy(
        logits, case.target, torch.tensor(weights), ignore_index=IGNORED
    )
    found = segmentation_loss(logits, case.target, weights, iou_loss)
    assert float(found) == pytest.approx(float(entropy + iou_loss(logits, case.target)), rel=1e-6)


def test_crops_labelled_by_rows_are_weighed_by_weights_of_their_own() -> None:
    torch.manual_seed(1)
    logits, classes = torch.randn(3, 3, 8, 8), torch.randint(0, 3, (3, 16, 16))
    classes[1, 0] = IGNORED
    marked = classes.clone()
    marked[1] = torch.where(classes[1] == IGNORED, IGNORED, classes[1] + OF_ROWS)
    weights, row_weights = (1.0, 2.0, 0.6), (10.0, 1.0, 0.6)
    found = mixed_loss(logits, marked, weights, row_weights, dice_loss)
    others = segmentation_loss(logits[[0, 2]], classes[[0, 2]], weights)
    rows = segmentation_loss(logits[1:2], classes[1:2], row_weights)
    assert float(found) == pytest.approx(float(2.0 * others + rows) / 3.0, rel=1e-6)
