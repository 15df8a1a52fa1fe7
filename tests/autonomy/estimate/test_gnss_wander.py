"""A receiver that wanders by more than it states is followed loosely, and the pose says so."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np
import pytest

from agribot.autonomy.estimate.localizer import Localizer
from agribot.autonomy.estimate.sensors.gnss_noise import noise_model
from agribot.autonomy.estimate.sensors.gnss_wander import GnssWander
from agribot.core.config import EstimateConfig, FieldConfig
from agribot.core.messages import FloatArray, RowLine
from tests import nightly
from tests.autonomy.estimate.noisy_rover import M8N, RTK, Errors, record, rows
from tests.autonomy.estimate.paper_robot import robot
from tests.autonomy.estimate.playback import batches, error, localizer, play
from tests.autonomy.estimate.test_first_heading import URBAN, displace

STATED = noise_model(0.9, 0.4, is_float=False, is_corrected=False)
STEP_S = 0.4


def wandering(walk_m_per_sqrt_s: float, memory_s: float, seed: int, count: int = 600) -> FloatArray:
    """A Gauss-Markov error east and north, (count, 2)."""
    rng = np.random.default_rng(seed)
    decay = math.exp(-STEP_S / memory_s)
    size_m = walk_m_per_sqrt_s * math.sqrt(memory_s / 2.0)
    error_m = np.zeros((count, 2))
    error_m[0] = size_m * rng.standard_normal(2)
    for k in range(1, count):
        fresh = math.sqrt(1.0 - decay * decay) * size_m * rng.standard_normal(2)
        error_m[k] = decay * error_m[k - 1] + fresh
    return error_m


def learn(error_m: FloatArray) -> GnssWander:
    wander = GnssWander()
    for k, (east_m, north_m) in enumerate(error_m.tolist()):
        wander.add(k * STEP_S, complex(east_m, north_m), 0.5 * k * STEP_S, 0.02, 0.1)
    return wander


@pytest.mark.parametrize("walk_m_per_sqrt_s", [0.3, 0.6])
def test_the_walk_of_a_receiver_beside_walls_is_learnt(walk_m_per_sqrt_s: float) -> None:
    learnt = [
        learn(wandering(walk_m_per_sqrt_s, 45.0, seed)).widen(STATED, is_vouched=True)
        for seed in range(20)
    ]
    walks = [noise.bias_walk_m_per_sqrt_s for noise in learnt]
    assert np.mean(walks) == pytest.approx(walk_m_per_sqrt_s, rel=0.15)
    assert all(float(noise.bias_std_m) > 1.0 for noise in learnt)


def test_a_receiver_that_does_as_it_states_is_believed() -> None:
    for seed in range(40):
        wander = learn(wandering(0.1, 162.0, seed))
        assert wander.widen(STATED, is_vouched=True) == STATED


def test_a_few_outliers_teach_nothing() -> None:
    error_m = wandering(0.1, 162.0, 1)
    error_m[::10] += 30.0
    assert learn(error_m).widen(STATED, is_vouched=True) == STATED


def test_without_velocity_a_receiver_is_worth_less_until_it_is_known() -> None:
    fresh, known = GnssWander(), learn(wandering(0.1, 162.0, 2))
    assert fresh.widen(STATED, is_vouched=True) == STATED
    assert fresh.widen(STATED, is_vouched=False).bias_walk_m_per_sqrt_s == 0.4
    assert known.widen(STATED, is_vouched=False) == STATED


@nightly.all_or_first("seeds", range(20), in_suite=3)
@pytest.mark.parametrize("errors", [M8N, URBAN], ids=["open sky", "beside walls"])
def test_the_stated_error_covers_the_true_one(seeds: Sequence[int], errors: Errors) -> None:
    squares, distances = [], []
    for seed in seeds:
        recording = record(rows, 120.0, seed=seed, errors=errors)
        estimates = [estimate for estimate in play(recording)[1500::250] if estimate.ok]
        for estimate in estimates:
            off_m = error(recording, estimate)[:2]
            cov_m2 = np.array(estimate.pose_cov).reshape(3, 3)[:2, :2]
            squares.append(float(off_m @ np.linalg.solve(cov_m2, off_m)) / 2.0)
            distances.append(math.hypot(*off_m) / estimate.pos_std_m)
    assert np.mean(np.array(distances) < 3.0) >= 0.95
    assert np.mean(squares) < 2.0  # of runs whose errors last longer than they do


def test_rejections_in_a_row_never_leave_a_small_sigma_behind() -> None:
    """A receiver of 0.9 m that steps aside by 12 m for good, as urban receivers do."""
    recording = record(rows, 90.0, seed=4, errors=URBAN)
    fixes = [(t_s, displace(fix, 12.0) if t_s > 45.0 else fix) for t_s, fix in recording.fixes]
    into = localizer()
    estimates = play(msgspec.structs.replace(recording, fixes=fixes), into)
    assert into.rejected["gnss outlier"] > 10
    assert estimates[-1].pos_std_m > 2.0


def test_a_camera_holds_the_robot_to_its_row_when_the_fixes_step_aside() -> None:
    """Fixes step 12 m to the East for good; the row runs North, its neighbours are 1 m away."""
    recording = record(lambda t_s: (0.4, 0.0) if t_s > 3.0 else (0.0, 0.0), 60.0, 4, URBAN)
    fixes = [(t_s, displace(fix, 12.0) if t_s > 30.0 else fix) for t_s, fix in recording.fixes]
    field = FieldConfig(row_length_m=40.0, start_map_m=(1.0, 2.0), start_yaw_deg=90.0)
    into = Localizer(EstimateConfig(), field, robot())
    for number, batch in enumerate(batches(msgspec.structs.replace(recording, fixes=fixes))):
        estimate = into.update(batch)
        if number % 10 == 0:
            off_m = field.first_row_start_map_m[0] - recording.pose(batch.t_s)[0]
            into.observe_line(
                RowLine(
                    t_s=batch.t_s - 0.06, offset_m=off_m, heading_rad=0.0, offset_std_m=0.015,
                    heading_std_rad=0.02,
                )
            )  # fmt: skip
    assert into.rejected["gnss outlier"] > 25
    assert into.rejected["row line ambiguous"] == 0
    east_m, north_m, _ = error(recording, estimate)
    east_std_m, north_std_m = np.sqrt(np.diag(np.array(estimate.pose_cov).reshape(3, 3))[:2])
    assert abs(east_m) < 0.03 and east_std_m < 0.1  # the row is as well known as before
    assert north_std_m > 0.8 and abs(north_m) < 3.0 * north_std_m


def test_fixed_ambiguities_are_not_touched() -> None:
    into = localizer()
    for batch in batches(record(rows, 60.0, seed=1, errors=RTK)):
        into.update(batch)
    assert into.update(batch).pos_std_m < 0.05
