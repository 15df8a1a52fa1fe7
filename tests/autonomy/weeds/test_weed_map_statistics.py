"""What the map is worth: statistics over drives along strips with known plants."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from agribot.core.messages import FloatArray
from tests import nightly
from tests.autonomy.weeds.weed_field import Eyes, score, walk

over_seeds = nightly.all_or_first("seeds", range(12), in_suite=4)


def nees(error_m: FloatArray, cov_m2: FloatArray) -> FloatArray:
    values: FloatArray = np.einsum("ni,nij,nj->n", error_m, np.linalg.inv(cov_m2), error_m)
    return values


@over_seeds
def test_weeds_and_crops_are_found_where_they_are(seeds: Sequence[int]) -> None:
    precision, recall, crop_recall, errors_m = [], [], [], []
    for seed in seeds:
        drive = walk(seed, Eyes())
        weeds = score(drive.map.weeds(), drive.weeds_m)
        precision.append(weeds.precision)
        recall.append(weeds.recall)
        crop_recall.append(score(drive.map.crops(), drive.crops_m).recall)
        errors_m.append(np.hypot(*weeds.error_m.T))
    assert np.mean(precision) >= 0.93
    assert min(recall) >= 0.95
    assert np.mean(crop_recall) >= 0.95
    assert np.median(np.concatenate(errors_m)) <= 0.020


@over_seeds
@pytest.mark.parametrize(
    "eyes",
    [Eyes(detection=0.5), Eyes(confusion=0.25), Eyes(false_ratio=0.2), Eyes(noise_m=0.04)],
    ids=["half-seen", "confused", "false-alarms", "noisy"],
)
def test_worse_eyes_still_find_nine_of_ten(eyes: Eyes, seeds: Sequence[int]) -> None:
    scores = []
    for seed in seeds:
        drive = walk(seed, eyes)
        scores.append(score(drive.map.weeds(), drive.weeds_m))
    assert np.mean([s.precision for s in scores]) >= 0.85
    assert np.mean([s.recall for s in scores]) >= 0.95


@over_seeds
def test_a_second_pass_adds_no_second_copy_of_a_weed(seeds: Sequence[int]) -> None:
    scores = []
    for seed in seeds:
        drive = walk(seed, Eyes(), passes=2)
        scores.append(score(drive.map.weeds(), drive.weeds_m))
    assert np.mean([s.precision for s in scores]) >= 0.93
    assert np.mean([s.recall for s in scores]) >= 0.97


@over_seeds
def test_a_heading_off_by_two_degrees_keeps_the_weeds_and_moves_them_a_little(
    seeds: Sequence[int],
) -> None:
    errors_m, recall = [], []
    for seed in seeds:
        drive = walk(seed, Eyes(yaw_bias_rad=0.035, yaw_std_rad=0.02))
        weeds = score(drive.map.weeds(), drive.weeds_m)
        recall.append(weeds.recall)
        errors_m.append(np.hypot(*weeds.error_m.T))
    assert np.mean(recall) >= 0.95
    assert np.median(np.concatenate(errors_m)) <= 0.05


@over_seeds
@pytest.mark.parametrize(
    "eyes",
    [Eyes(), Eyes(pos_std_m=0.03), Eyes(yaw_std_rad=0.02), Eyes(noise_m=0.04)],
    ids=["nominal", "poor-position", "poor-heading", "noisy"],
)
def test_the_covariance_of_the_map_is_neither_boastful_nor_useless(
    eyes: Eyes, seeds: Sequence[int]
) -> None:
    """Two degrees of freedom give 2; the bound for unknown correlation makes it less."""
    values = []
    for seed in seeds:
        drive = walk(seed, eyes)
        weeds = score(drive.map.weeds(), drive.weeds_m)
        values.append(nees(weeds.error_m, weeds.cov_m2))
    mean = float(np.mean(np.concatenate(values)))
    assert 0.4 <= mean <= 2.6


def test_the_same_seed_gives_the_same_map_to_the_last_bit() -> None:
    assert walk(5, Eyes()).map.plants() == walk(5, Eyes()).map.plants()
