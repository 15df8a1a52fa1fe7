"""The first heading of a robot without a magnetometer: from its way, a mark, or two antennas."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import msgspec
import numpy as np
import pytest

from agribot.autonomy.estimate.filter.ekf import Ekf
from agribot.autonomy.estimate.filter.motion_heading import WayPlace
from agribot.autonomy.estimate.filter.start import StartMark
from agribot.autonomy.estimate.localizer import Localizer
from agribot.autonomy.estimate.sensors.first_heading import FirstHeading
from agribot.core.config import EstimateConfig, FieldConfig
from agribot.core.facts import HeadingAwaited, HeadingUnknown, StartTurned
from agribot.core.geo import MapFrame
from agribot.core.messages import Estimate, GnssFix, GnssHeading, SensorBatch
from tests import nightly
from tests.autonomy.estimate.noisy_rover import M8N, RTK, Drive, Errors, Recording, record, rows
from tests.autonomy.estimate.paper_robot import robot
from tests.autonomy.estimate.playback import batches, error
from tests.finding import find, holds

BARE = msgspec.structs.replace(robot(), mag=None)
# A receiver beside walls, as measured on a rover outdoors: it states 0.9 m and wanders by 2.
URBAN = msgspec.structs.replace(
    M8N, gnss_hz=2.5, pos_std_m=0.9, white_m=0.09, wander=((2.0, 45.0),), velocity_mps=0.0
)


class Started(NamedTuple):
    """The moment at which the pose was known first: time, way, error and 1 sigma of the heading."""

    t_s: float
    driven_m: float
    off_rad: float
    std_rad: float


def without_magnetometer(
    drive: Drive, duration_s: float, seed: int, errors: Errors, *, has_velocity: bool = True
) -> Recording:
    recording = record(drive, duration_s, seed=seed, errors=errors)
    fixes = recording.fixes
    if not has_velocity:
        fixes = [
            (t_s, msgspec.structs.replace(fix, velocity_mps=None)) for t_s, fix in recording.fixes
        ]
    return msgspec.structs.replace(recording, mag=[], fixes=fixes)


def estimates(recording: Recording, into: Localizer | None = None) -> list[Estimate]:
    into = into or Localizer(EstimateConfig(), FieldConfig(), BARE)
    return [into.update(batch) for batch in batches(recording)]


def begin(recording: Recording) -> Started:
    into = Localizer(EstimateConfig(), FieldConfig(), BARE)
    played = (into.update(batch) for batch in batches(recording))
    first = next(estimate for estimate in played if estimate.ok)
    way = recording.truth[recording.truth[:, 0] <= first.t_s, 1:3]
    driven_m = float(np.hypot(*np.diff(way, axis=0).T).sum())
    return Started(first.t_s, driven_m, float(error(recording, first)[2]), first.yaw_std_rad)


def straight(t_s: float) -> tuple[float, float]:
    return (0.5, 0.0) if t_s > 1.0 else (0.0, 0.0)


def backwards(t_s: float) -> tuple[float, float]:
    return (-0.5, 0.0) if t_s > 1.0 else (0.0, 0.0)


@pytest.mark.parametrize(
    ("errors", "has_velocity", "most_m"),
    [
        (RTK, True, 1.0),
        (RTK, False, 1.0),
        (M8N, True, 3.0),
        (M8N, False, 12.0),
        (URBAN, False, 12.0),
    ],
    ids=["rtk", "rtk without velocity", "m8n", "m8n without velocity", "beside walls"],
)
@nightly.all_or_first("seeds", range(20), in_suite=2)
def test_the_heading_follows_from_the_first_metres(
    seeds: Sequence[int], errors: Errors, has_velocity: bool, most_m: float
) -> None:
    started = [
        begin(without_magnetometer(straight, 45.0, seed, errors, has_velocity=has_velocity))
        for seed in seeds
    ]
    assert max(each.driven_m for each in started) < most_m
    assert max(abs(each.off_rad / each.std_rad) for each in started) < 3.5
    squares = [(each.off_rad / each.std_rad) ** 2 for each in started]
    assert np.mean(squares) < nightly.mean_square_band(len(seeds), 1)[1]


def test_wheels_know_that_the_robot_drives_backwards() -> None:
    started = begin(without_magnetometer(backwards, 10.0, 1, RTK))
    assert abs(started.off_rad) < math.radians(10.0)


def test_it_follows_from_a_way_with_turns() -> None:
    started = begin(without_magnetometer(lambda t_s: (0.4, 0.5), 15.0, 2, RTK, has_velocity=False))
    assert abs(started.off_rad) < 3.0 * started.std_rad


def test_every_tenth_fix_thirty_metres_away_does_no_harm() -> None:
    recording = without_magnetometer(straight, 25.0, 3, M8N, has_velocity=False)
    fixes = [
        (t_s, displace(fix, 30.0) if index % 10 == 4 else fix)
        for index, (t_s, fix) in enumerate(recording.fixes)
    ]
    started = begin(msgspec.structs.replace(recording, fixes=fixes))
    assert abs(started.off_rad) < 3.0 * started.std_rad


def displace(fix: GnssFix, east_m: float) -> GnssFix:
    frame = MapFrame(FieldConfig().datum)
    x_m, y_m, z_m = frame.map_from_geodetic(fix.lat_deg, fix.lon_deg, fix.alt_m)
    lat_deg, lon_deg, alt_m = frame.geodetic_from_map(x_m + east_m, y_m, z_m)
    return msgspec.structs.replace(fix, lat_deg=lat_deg, lon_deg=lon_deg, alt_m=alt_m)


def test_without_a_way_the_reason_says_to_drive() -> None:
    last = estimates(without_magnetometer(lambda t_s: (0.0, 0.0), 6.0, 1, RTK))[-1]
    assert not last.ok
    unknown = find(last.fact, HeadingUnknown)
    assert (unknown.variant, unknown.way_m) == ("unknown", 3.0)


def test_a_robot_whose_magnetometer_is_silent_drives_for_its_heading_too() -> None:
    into = Localizer(EstimateConfig(), FieldConfig(), robot())
    silent = estimates(without_magnetometer(straight, 1.5, 1, RTK), into)[-1]
    assert holds(silent.fact, HeadingAwaited)
    into = Localizer(EstimateConfig(), FieldConfig(), robot())
    assert estimates(without_magnetometer(straight, 8.0, 1, RTK), into)[-1].ok


def mark(turned_deg: float = 0.0) -> Localizer:
    field = FieldConfig(start_map_m=(1.0, 2.0), start_yaw_deg=90.0 + turned_deg)
    return Localizer(EstimateConfig(), field, BARE)


def test_a_mark_gives_the_heading_before_the_robot_moves() -> None:
    recording = without_magnetometer(rows, 2.5, 1, RTK)
    last = estimates(recording, mark())[-1]
    assert last.ok
    assert abs(error(recording, last)[2]) < math.radians(2.0)


@pytest.mark.parametrize(
    ("errors", "has_velocity", "most_m"),
    [(RTK, True, 1.0), (RTK, False, 1.0), (M8N, True, 2.0), (M8N, False, 5.0)],
    ids=["rtk", "rtk without velocity", "m8n", "m8n without velocity"],
)
def test_a_robot_that_faces_backwards_on_its_mark_stops_soon(
    errors: Errors, has_velocity: bool, most_m: float
) -> None:
    recording = without_magnetometer(straight, 14.0, 1, errors, has_velocity=has_velocity)
    played = estimates(recording, mark(180.0))
    found = next(estimate for estimate in played if holds(estimate.fact, StartTurned))
    assert not found.ok
    assert abs(recording.pose(found.t_s)[1] - 2.0) < most_m
    assert not played[-1].ok
    assert holds(played[-1].fact, StartTurned)


@pytest.mark.parametrize("turned_deg", [10.0, 25.0, 45.0, -90.0])
@pytest.mark.parametrize("errors", [RTK, M8N], ids=["rtk", "m8n"])
def test_a_robot_that_faces_aside_finds_its_heading_or_says_so(
    turned_deg: float, errors: Errors
) -> None:
    recording = without_magnetometer(straight, 14.0, 1, errors)
    last = estimates(recording, mark(turned_deg))[-1]
    is_named = not last.ok or bool(last.contradiction_fact)
    assert is_named or abs(error(recording, last)[2]) < math.radians(6.0)


@nightly.all_or_first("seeds", range(40), in_suite=2)
def test_a_robot_that_faces_as_marked_is_not_accused(seeds: Sequence[int]) -> None:
    for seed in seeds:
        for errors in (RTK, M8N):
            last = estimates(without_magnetometer(straight, 12.0, seed, errors), mark(3.0))[-1]
            assert last.ok, (seed, last.fact)


# The first 3.3 m of a drive straight ahead beside walls: time, way of the wheels, where the fixes
# have the robot after it (ahead, to the left). They stepped while it stood, and wandered on.
BESIDE_WALLS = (
    (0.4, 0.0, 0.0, 0.0), (4.0, 0.17, 0.12, -0.62), (4.4, 0.31, 0.22, -0.23),
    (4.8, 0.48, -0.27, -0.09), (5.2, 0.66, 0.12, -0.57), (5.6, 0.9, 0.36, -0.74),
    (6.0, 1.19, 0.72, -0.38), (6.4, 1.5, 0.52, -0.98), (6.8, 1.82, 0.5, -0.89),
    (7.2, 2.14, 0.52, -1.46), (7.6, 2.46, 0.53, -1.25), (8.0, 2.77, -0.01, -1.69),
    (8.4, 3.09, 0.29, -1.47), (8.8, 3.25, -0.06, -1.11),
)  # fmt: skip


@pytest.mark.parametrize(("slow_m", "is_accused"), [(1.79, False), (0.2, True)])
def test_a_way_that_wandering_fixes_draw_across_accuses_no_mark(
    slow_m: float, is_accused: bool
) -> None:
    start = StartMark(xy_map_m=None, yaw_map_rad=0.0, std_m=0.1, yaw_std_rad=math.radians(2.0))
    ekf = Ekf([1.0] * 3, 0.0)
    first = FirstHeading(ekf, start, set(), has_compass=False)
    first.wait(0.0, 0.0)
    for t_s, way_m, ahead_m, left_m in BESIDE_WALLS:
        place = WayPlace(
            t_s, complex(ahead_m, left_m), complex(way_m), way_m, 0.12, slow_m, slow_m * 0.2235
        )
        first.add_fix(place, None)
    assert (first.misplaced is not None) == is_accused


def test_two_antennas_know_the_heading_at_standstill() -> None:
    recording = without_magnetometer(lambda t_s: (0.0, 0.0), 3.0, 1, RTK)
    into = Localizer(EstimateConfig(), FieldConfig(), BARE)
    last = into.update(SensorBatch(t_s=0.01))
    for batch in batches(recording):
        heading = GnssHeading(t_s=batch.t_s - 0.05, yaw_map_rad=math.pi / 2 + 0.01, std_rad=0.01)
        last = into.update(msgspec.structs.replace(batch, headings=(heading,)))
    assert last.ok
    assert abs(error(recording, last)[2]) < math.radians(1.5)
