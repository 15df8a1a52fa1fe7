"""Crop rows as a position sensor: a cheap receiver, a marked start and a camera that errs."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence

import msgspec
import numpy as np
import pytest

from agribot.autonomy.estimate.localizer import Localizer
from agribot.autonomy.estimate.witnesses.contradiction import Contradiction
from agribot.core.config import EstimateConfig, FieldConfig
from agribot.core.messages import Estimate, FloatArray
from tests import nightly
from tests.autonomy.estimate.noisy_rover import M8N, Errors, Recording, record, rows, stand
from tests.autonomy.estimate.paper_robot import robot
from tests.autonomy.estimate.playback import error
from tests.autonomy.estimate.row_plants import Faults, scenes, watch

START = (1.0, 1.0, math.pi / 2)
# The recorded drive leaves East 1 for rows further west, by a turn of a metre each.
FIELD = FieldConfig(
    first_row_start_map_m=(-2.0, 1.5), row_count=5, row_length_m=4.0, plant_spacing_m=2.0,
    start_map_m=START[:2], start_yaw_deg=90.0,
)  # fmt: skip
DENSE = msgspec.structs.replace(FIELD, plant_spacing_m=None)
DURATION_S = 48.0
# Half a pitch is where one row ends and the next begins.
HALF_PITCH_M = 0.5


@functools.lru_cache(maxsize=16)
def drive(
    seed: int,
    field: FieldConfig = FIELD,
    spacing_m: float = 2.0,
    faults: Faults | None = None,
    errors: Errors = M8N,
) -> tuple[Recording, list[Estimate], Localizer]:
    """Drive and watch; what several tests look at is driven once."""
    recording = record(rows, DURATION_S, seed=seed, errors=errors, start=START)
    rng = np.random.default_rng(seed + 1000)
    seen = scenes(recording, field, spacing_m, faults or Faults(), rng)
    into = Localizer(EstimateConfig(), field, robot())
    return recording, watch(into, recording, seen), into


def off(recording: Recording, estimates: list[Estimate], after_s: float = 8.0) -> FloatArray:
    """Errors (N, 3) once the first plants have been passed."""
    return np.array([error(recording, e) for e in estimates if e.t_s > after_s and e.ok])


def rms(values: FloatArray) -> float:
    return float(np.sqrt((values**2).mean()))


def nees(recording: Recording, estimate: Estimate) -> float:
    """Of the position, two degrees of freedom."""
    deviation = error(recording, estimate)[:2]
    cov = np.array(estimate.pose_cov).reshape(3, 3)[:2, :2]
    return float(deviation @ np.linalg.solve(cov, deviation))


@pytest.mark.parametrize(
    ("field", "spacing_m"), [(FIELD, 2.0), (DENSE, 0.25)], ids=["sparse", "dense"]
)
@nightly.all_or_first("seeds", range(10), in_suite=2)
def test_rows_hold_a_robot_with_a_cheap_receiver_and_the_filter_knows_how_well(
    field: FieldConfig, spacing_m: float, seeds: Sequence[int]
) -> None:
    deviations, normalised = [], []
    for seed in seeds:
        recording, estimates, _ = drive(seed, field, spacing_m)
        deviations.append(off(recording, estimates))
        normalised += [nees(recording, e) for e in estimates[400::100]]
    everything = np.concatenate(deviations)
    assert np.abs(everything[:, :2]).max() < HALF_PITCH_M
    assert rms(everything[:, :2]) < 0.06
    assert 0.4 < np.mean(normalised) < 3.4  # 2 is ideal; a planter's errors last, they count once


@nightly.all_or_first("seeds", range(4), in_suite=2)
def test_without_the_camera_the_same_robot_loses_the_rows(seeds: Sequence[int]) -> None:
    seen, unseen = [], []
    for seed in seeds:
        seen.append(off(*drive(seed)[:2], after_s=35.0))
        unseen.append(
            off(
                *drive(seed, faults=Faults(missed_ratio=1.0, false_per_frame=0.0))[:2], after_s=35.0
            )
        )
    assert rms(np.concatenate(unseen)[:, :2]) > 3.0 * rms(np.concatenate(seen)[:, :2])


@nightly.all_or_first("seeds", range(5), in_suite=2)
def test_row_ends_tell_the_place_along_a_row_where_the_spacing_does_not(
    seeds: Sequence[int],
) -> None:
    """Rows end in view of the camera at both headlands; in a field without ends nothing does."""
    endless = msgspec.structs.replace(
        DENSE, row_length_m=400.0, first_row_start_map_m=(-2.0, -200.0)
    )
    with_ends, without = [], []
    for seed in seeds:
        with_ends.append(off(*drive(seed, DENSE, 0.25)[:2], after_s=15.0)[:, 1])
        without.append(off(*drive(seed, endless, 0.25)[:2], after_s=15.0)[:, 1])
    assert rms(np.concatenate(with_ends)) < 0.7 * rms(np.concatenate(without))


@pytest.mark.parametrize(
    "faults",
    [
        Faults(false_per_frame=0.4),
        Faults(bare_ratio=0.3),
        Faults(missed_ratio=0.6),
        Faults(blind_s=(20.0, 26.0)),
    ],
    ids=["weeds taken for crop", "missing plants", "missed plants", "blind for six seconds"],
)
@nightly.all_or_first("seeds", range(6), in_suite=1)
def test_no_fault_of_camera_or_planter_leads_to_another_row(
    faults: Faults, seeds: Sequence[int]
) -> None:
    deviations = []
    for seed in seeds:
        recording, estimates, _ = drive(seed, faults=faults)
        deviations.append(off(recording, estimates))
    everything = np.concatenate(deviations)
    assert np.abs(everything[:, :2]).max() < HALF_PITCH_M
    assert rms(everything[:, :2]) < 0.1


@nightly.all_or_first("seeds", range(4), in_suite=1)
def test_fragments_of_weeds_do_not_count_as_crop(seeds: Sequence[int]) -> None:
    clean, littered = [], []
    fragments = Faults(false_per_frame=4.0, false_area_m2=0.0005)
    for seed in seeds:
        clean.append(off(*drive(seed, faults=Faults(false_per_frame=0.0))[:2]))
        recording, estimates, into = drive(seed, faults=fragments)
        littered.append(off(recording, estimates))
        assert into.rejected["crop too small"] > 500
    assert rms(np.concatenate(littered)) < 1.3 * rms(np.concatenate(clean))


@nightly.all_or_first("seeds", range(5), in_suite=1)
def test_a_pose_beside_its_row_is_noticed_and_corrected(seeds: Sequence[int]) -> None:
    """Put down 0.4 m beside a mark that is said to be exact, the robot would crush a row."""
    for seed in seeds:
        believed = (START[0] + 0.4, START[1])
        wrong = msgspec.structs.replace(
            FIELD, start_map_m=believed, start_std_m=0.01, start_yaw_std_deg=0.3
        )
        recording, estimates, into = drive(seed, wrong)
        assert abs(error(recording, estimates[100])[0]) > 0.2
        assert into.rejected["rows found again"] >= 1
        assert rms(off(recording, estimates, after_s=20.0)[:, 0]) < 0.1


def test_a_pose_that_cannot_tell_rows_apart_does_not_guess() -> None:
    lost = msgspec.structs.replace(FIELD, start_map_m=None, start_yaw_deg=None)
    recording, estimates, into = drive(1, lost)
    assert into.rejected["row ambiguous"] > 100
    assert into.rejected["rows found again"] == 0
    assert estimates[-1].pos_std_m > 0.5
    assert nees(recording, estimates[-1]) < 9.2


def test_looking_longer_at_the_same_plants_makes_nothing_more_certain() -> None:
    field = msgspec.structs.replace(FIELD, start_map_m=(1.0, 2.0))
    recording = record(stand, 20.0, seed=1, errors=M8N, start=(1.0, 2.0, math.pi / 2))
    seen = scenes(recording, field, 2.0, Faults(false_per_frame=0.0), np.random.default_rng(1))
    assert sum(len(scene.plants) for scene in seen) > 100
    into = Localizer(EstimateConfig(), field, robot())
    estimates = watch(into, recording, seen)
    assert estimates[-1].pos_std_m > 0.9 * estimates[200].pos_std_m


def test_scenes_of_another_time_are_refused() -> None:
    recording = record(rows, 12.0, seed=1, errors=M8N, start=START)
    seen = scenes(recording, FIELD, 2.0, Faults(), np.random.default_rng(1))
    into = Localizer(EstimateConfig(), FIELD, robot())
    before = watch(into, recording, seen)[-1]
    into.observe(msgspec.structs.replace(seen[-1], t_s=99.0))
    into.observe(msgspec.structs.replace(seen[-1], t_s=9.0))
    assert into.rejected["scene without odometry"] >= 1
    assert into.rejected["scene first"] == 1
    assert into.rejected["scene out of order"] >= 1
    assert math.isfinite(before.x_map_m)


def test_the_same_scenes_give_the_same_bits() -> None:
    assert drive.__wrapped__(1)[1] == drive(1)[1]


def test_one_plant_out_of_place_never_overrules_the_pose() -> None:
    doubt = Contradiction()
    assert all(doubt.add(3.0 + 0.001 * look, 1.3, -0.3) is None for look in range(100))


def test_plants_that_agree_on_the_same_offset_do() -> None:
    doubt = Contradiction()
    told = [doubt.add(3.0 + 0.5 * (look // 5), 1.3, -0.3) for look in range(10)]
    assert next(offset for offset in told if offset is not None) == pytest.approx(-0.3)
    scattered = [
        doubt.add(0.5 * look, 1.0, (-0.45, -0.2, 0.2, 0.45)[look % 4]) for look in range(12)
    ]
    assert scattered == [None] * 12
