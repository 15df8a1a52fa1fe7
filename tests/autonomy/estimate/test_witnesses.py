"""Sensors as one another's witnesses: who lies is named, and the others go on without it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from unittest.mock import ANY

import msgspec
import numpy as np
import pytest

from agribot.autonomy.estimate.localizer import Localizer
from agribot.autonomy.estimate.witnesses.spin_watch import moves_against
from agribot.core.facts import (
    ClockLeapt,
    CompassTurned,
    GnssCrept,
    GnssParts,
    GyroTurns,
    NoPicture,
    PictureReversed,
    PicturesComeLate,
    PositionsScatter,
    VelocityScatters,
    WheelsSlip,
)
from agribot.core.geo import WGS84_A_M
from agribot.core.messages import (
    ControlMission,
    Estimate,
    GnssFix,
    GnssHeading,
    GroundPlant,
    ImuSample,
    MagSample,
    PlantClass,
    Scene,
    SensorBatch,
)
from tests import nightly
from tests.asking import ask
from tests.autonomy.estimate.noisy_rover import M8N, Errors, Recording, record, rows
from tests.autonomy.estimate.playback import batches, localizer
from tests.autonomy.estimate.test_doubts import north
from tests.autonomy.estimate.test_localizer_faults import at, distance_m, shifted, with_fixes
from tests.finding import holds, is_like

FROM_S = 12.0
Change = Callable[[SensorBatch], SensorBatch]


def play_with(recording: Recording, change: Change) -> tuple[Localizer, list[Estimate]]:
    into = localizer()
    return into, [into.update(change(batch)) for batch in batches(recording)]


def accused(estimate: Estimate) -> dict[str, str]:
    """The sensors that are not fine, and what they are instead."""
    return {name: verdict.state for name, verdict in estimate.verdicts.items()}


def first_accusing(estimates: list[Estimate], sensor: str) -> Estimate:
    return next(e for e in estimates if sensor in accused(e))


@pytest.mark.parametrize("errors", [Errors(), M8N])
@nightly.all_or_first("seeds", range(3), in_suite=1)
def test_no_sensor_is_accused_while_all_are_in_order(errors: Errors, seeds: Sequence[int]) -> None:
    for seed in seeds:
        _, estimates = play_with(record(rows, 45.0, seed=seed, errors=errors), lambda batch: batch)
        assert {name for e in estimates for name in accused(e)} == set()


def creeping(mps: float, heading_rad: float) -> Callable[[GnssFix], GnssFix]:
    def creep(fix: GnssFix) -> GnssFix:
        off_m = mps * (fix.t_s - FROM_S)
        return shifted(fix, off_m * math.cos(heading_rad), off_m * math.sin(heading_rad))

    return creep


@nightly.one_by_one("heading_rad", [1.0, 0.0, math.pi / 2, -2.0], in_suite=1)
def test_fixes_that_creep_off_by_five_centimetres_a_second_are_named_without_a_camera(
    heading_rad: float,
) -> None:
    recording = with_fixes(
        record(north, 20.0, seed=2), lambda t: t > FROM_S, creeping(0.05, heading_rad)
    )
    _, estimates = play_with(recording, lambda batch: batch)
    first = first_accusing(estimates, "gnss")
    assert first.t_s > FROM_S
    assert first.verdicts["gnss"].since_s == pytest.approx(first.t_s)
    halted = next(e for e in estimates if e.contradiction_fact)
    assert halted.t_s < FROM_S + 6.0
    assert is_like(halted.contradiction_fact, GnssCrept(0.5, ANY), within=0.5)
    assert distance_m(recording, halted) < 0.3
    for e in estimates:
        if first.t_s <= e.t_s <= halted.t_s:
            assert distance_m(recording, e) < e.protection_m
    assert at(estimates, first.t_s + 1.0).verdicts["gnss"].since_s == first.verdicts["gnss"].since_s


def test_a_velocity_that_lags_behind_as_filtered_ones_do_is_no_creep() -> None:
    """A receiver that smooths its velocity, on a robot that starts and stops."""

    def halting(t_s: float) -> tuple[float, float]:
        return (0.4, 0.0) if t_s % 6.0 > 3.0 else (0.0, 0.0)

    recording = record(halting, 30.0, seed=3)
    smooth, fixes = np.zeros(3), []
    for arrival_s, fix in recording.fixes:
        smooth = smooth + 0.25 * (np.array(fix.velocity_mps) - smooth)
        east, north, up = smooth.tolist()
        fixes.append((arrival_s, msgspec.structs.replace(fix, velocity_mps=(east, north, up))))
    recording = msgspec.structs.replace(recording, fixes=fixes)
    _, estimates = play_with(recording, lambda batch: batch)
    assert not any(holds(e.contradiction_fact, GnssCrept) for e in estimates)
    assert not any(isinstance(e.fact, GnssParts) for e in estimates)


def test_a_person_who_believes_the_fixes_that_crept_goes_on_with_them() -> None:
    recording = with_fixes(
        record(north, 26.0, seed=2),
        lambda t: t > FROM_S,
        lambda fix: shifted(fix, min(0.05 * (fix.t_s - FROM_S), 0.4)),
    )

    def resume(batch: SensorBatch) -> SensorBatch:
        if abs(batch.t_s - 21.0) > 0.01:
            return batch
        event = ask(ControlMission(action="resume"), "test", t_s=batch.t_s)
        return msgspec.structs.replace(batch, requests=(event,))

    _, estimates = play_with(recording, resume)
    assert at(estimates, 20.9).contradiction_fact
    assert not any(e.contradiction_fact for e in estimates if e.t_s > 21.03)
    assert distance_m(recording, estimates[-1]) == pytest.approx(0.4, abs=0.1)


def scattering(mps: float) -> Recording:
    """Velocities that scatter by `mps` more than they state."""
    rng = np.random.default_rng(7)

    def shake(fix: GnssFix) -> GnssFix:
        assert fix.velocity_mps is not None
        east, north, up = (np.array(fix.velocity_mps) + rng.normal(0.0, mps, 3)).tolist()
        return msgspec.structs.replace(fix, velocity_mps=(east, north, up))

    return with_fixes(record(north, 40.0, seed=4), lambda t: t > FROM_S, shake)


def test_velocities_that_scatter_ten_times_as_stated_are_named_and_weigh_less() -> None:
    recording = scattering(0.3)
    into, estimates = play_with(recording, lambda batch: batch)
    first = first_accusing(estimates, "gnss")
    assert first.t_s < FROM_S + 3.0
    assert isinstance(first.fact, VelocityScatters)
    assert not first.contradiction_fact
    assert into.rejected["velocity outlier"] < 30
    for e in estimates:
        if e.t_s > FROM_S:
            _, _, yaw_rad = recording.pose(e.t_s)
            assert abs(math.remainder(e.yaw_map_rad - yaw_rad, math.tau)) < math.radians(3.0)
            assert distance_m(recording, e) < 0.1


def scattered(seed: int, std_m: float) -> Recording:
    """Positions that scatter by `std_m`, and state 1.4 cm."""
    rng = np.random.default_rng(seed)

    def shake(fix: GnssFix) -> GnssFix:
        east_m, north_m = rng.normal(0.0, std_m, 2).tolist()
        lat_deg = fix.lat_deg + math.degrees(north_m / WGS84_A_M)
        per_lon_m = WGS84_A_M * math.cos(math.radians(fix.lat_deg))
        lon_deg = fix.lon_deg + math.degrees(east_m / per_lon_m)
        return msgspec.structs.replace(fix, lat_deg=lat_deg, lon_deg=lon_deg)

    return with_fixes(record(north, 40.0, seed=seed), lambda t: t > FROM_S, shake)


@nightly.all_or_first("seeds", (4, 5, 6), in_suite=1)
def test_positions_that_scatter_five_times_as_stated_are_named_and_weigh_less(
    seeds: Sequence[int],
) -> None:
    off_m2, stated_m2 = [], []
    for seed in seeds:
        recording = scattered(seed, 0.07)
        into, estimates = play_with(recording, lambda batch: batch)
        assert any(isinstance(e.fact, PositionsScatter) for e in estimates[:850]), seed
        assert not any(e.contradiction_fact for e in estimates), seed
        assert into.rejected["gnss outlier"] < 30, seed
        late = [e for e in estimates if e.t_s > FROM_S + 2.0]
        off_m2 += [distance_m(recording, e) ** 2 for e in late]
        stated_m2 += [2.0 * e.pos_std_m**2 for e in late]
    assert math.sqrt(np.mean(off_m2)) < 0.035, "half of one position's"
    assert np.mean(off_m2) < 2.0 * np.mean(stated_m2), "and it knows how well it knows"


def test_the_heading_of_a_receiver_that_repeats_itself_is_not_believed_either() -> None:
    """Two antennas, frozen before the robot turns: their heading would hold it back."""

    def turning(t_s: float) -> tuple[float, float]:
        return (0.4, 0.0) if t_s < FROM_S + 2.0 else (0.4, 0.2)

    recording = record(turning, FROM_S + 6.0, seed=5)
    last = [fix for _, fix in recording.fixes if fix.t_s <= FROM_S][-1]
    recording = with_fixes(
        recording, lambda t: t > FROM_S, lambda fix: msgspec.structs.replace(last, t_s=fix.t_s)
    )

    def add_heading(batch: SensorBatch) -> SensorBatch:
        _, _, yaw_rad = recording.pose(min(batch.t_s, FROM_S))
        heading = GnssHeading(t_s=batch.t_s, yaw_map_rad=yaw_rad, std_rad=math.radians(0.3))
        return msgspec.structs.replace(batch, headings=(heading,) if batch.gnss else ())

    into, estimates = play_with(recording, add_heading)
    _, _, yaw_rad = recording.pose(estimates[-1].t_s)
    assert accused(estimates[-1])["gnss"] == "frozen"
    assert into.rejected["antenna heading of a frozen receiver"] > 40
    assert math.remainder(estimates[-1].yaw_map_rad - yaw_rad, math.tau) == pytest.approx(
        0.0, abs=math.radians(4.0)
    )


def test_wheels_that_turn_in_mud_are_blamed_and_not_the_receiver() -> None:
    recording = record(north, 18.0, seed=6, grip=lambda t_s: 0.1 if t_s > FROM_S else 1.0)
    _, estimates = play_with(recording, lambda batch: batch)
    first = first_accusing(estimates, "wheels")
    assert FROM_S < first.t_s < FROM_S + 2.5
    assert isinstance(first.verdicts["wheels"].fact, WheelsSlip)
    assert not any(e.contradiction_fact for e in estimates)


@pytest.mark.parametrize(
    ("claimed_mps", "shown_mps", "is_against"),
    [(0.3, 0.05, False), (0.3, -0.1, False), (0.3, -0.25, True), (-0.3, 0.25, True)],
)
def test_a_robot_that_goes_against_its_wheels_is_not_on_soft_ground(
    claimed_mps: float, shown_mps: float, is_against: bool
) -> None:
    assert moves_against(claimed_mps, shown_mps) is is_against


def with_gyro(bias_radps: float) -> Change:
    def turn(sample: ImuSample) -> ImuSample:
        x, y, z = sample.gyro_radps
        off_radps = bias_radps if sample.t_s > FROM_S else 0.0
        return msgspec.structs.replace(sample, gyro_radps=(x, y, z + off_radps))

    return lambda batch: msgspec.structs.replace(batch, imu=tuple(map(turn, batch.imu)))


@nightly.one_by_one("bias_radps", [0.05, -0.05], in_suite=1)
def test_a_gyro_whose_bias_steps_is_outvoted_by_compass_and_wheels_and_corrected(
    bias_radps: float,
) -> None:
    recording = record(north, 24.0, seed=6)
    _, estimates = play_with(recording, with_gyro(bias_radps))
    first = first_accusing(estimates, "gyro")
    assert FROM_S < first.t_s < FROM_S + 5.0
    assert isinstance(first.fact, GyroTurns)
    assert all(distance_m(recording, e) < 0.15 for e in estimates if e.t_s > FROM_S)
    for e in estimates:
        if e.t_s > first.t_s + 4.0:
            _, _, yaw_rad = recording.pose(e.t_s)
            assert abs(math.remainder(e.yaw_map_rad - yaw_rad, math.tau)) < math.radians(3.0)


@nightly.one_by_one("heading_rad", [0.0, math.pi / 2, math.pi], in_suite=1)
@nightly.one_by_one("bias_radps", [0.05, -0.05], in_suite=1)
def test_fixes_and_a_gyro_that_lie_at_once_are_both_named(
    bias_radps: float, heading_rad: float
) -> None:
    """The gyro bends the way of the wheels as the fixes would have it, or against them."""
    recording = with_fixes(
        record(north, 24.0, seed=6), lambda t: t > FROM_S, creeping(0.05, heading_rad)
    )
    _, estimates = play_with(recording, with_gyro(bias_radps))
    first = first_accusing(estimates, "gnss")
    halted = next(e for e in estimates if e.contradiction_fact)
    assert FROM_S < first.t_s < FROM_S + 6.0
    assert halted.t_s < FROM_S + 9.0
    assert first_accusing(estimates, "gyro").t_s < FROM_S + 6.0
    for e in estimates:
        if first.t_s <= e.t_s <= halted.t_s:
            assert distance_m(recording, e) < e.protection_m


def test_a_magnet_that_comes_near_is_blamed_on_the_compass() -> None:
    def pull(sample: MagSample) -> MagSample:
        x, y, z = sample.field_t
        off_t = 1.5e-5 if sample.t_s > FROM_S else 0.0
        return msgspec.structs.replace(sample, field_t=(x, y + off_t, z))

    _, estimates = play_with(
        record(north, 18.0, seed=6),
        lambda batch: msgspec.structs.replace(batch, mag=tuple(map(pull, batch.mag))),
    )
    first = first_accusing(estimates, "compass")
    assert first.t_s < FROM_S + 3.0
    assert isinstance(first.fact, CompassTurned)
    assert all("gyro" not in accused(e) for e in estimates)


def test_samples_of_the_imu_that_come_a_tenth_of_a_second_late_are_named() -> None:
    waiting: list[ImuSample] = []

    def delay(batch: SensorBatch) -> SensorBatch:
        waiting.extend(batch.imu)
        age_s = 0.1 if batch.t_s > FROM_S else 0.0
        due = tuple(sample for sample in waiting if sample.t_s <= batch.t_s - age_s + 1e-9)
        del waiting[: len(due)]
        return msgspec.structs.replace(batch, imu=due)

    _, estimates = play_with(record(north, 15.0, seed=6), delay)
    first = first_accusing(estimates, "gyro")
    assert accused(first) == {"gyro": "late"}
    assert FROM_S < first.t_s < FROM_S + 1.0


def leap(sample: msgspec.Struct, by_s: float) -> msgspec.Struct:
    return msgspec.structs.replace(sample, t_s=getattr(sample, "t_s") + by_s)  # noqa: B009


def test_a_clock_that_jumps_is_named_and_a_program_that_paused_is_not() -> None:
    def step(batch: SensorBatch) -> SensorBatch:
        if batch.t_s <= FROM_S:
            return batch
        moved = {
            name: tuple(leap(sample, 0.2) for sample in getattr(batch, name))
            for name in ("wheels", "imu", "mag", "gnss")
        }
        return msgspec.structs.replace(batch, t_s=batch.t_s + 0.2, **moved)

    def pause(batch: SensorBatch) -> SensorBatch:
        is_lost = FROM_S < batch.t_s <= FROM_S + 0.2
        return msgspec.structs.replace(batch, wheels=() if is_lost else batch.wheels)

    recording = record(north, 15.0, seed=6)
    _, stepped = play_with(recording, step)
    _, paused = play_with(recording, pause)
    assert holds(first_accusing(stepped, "clock").fact, ClockLeapt(0.25), within=0.055)
    assert all("clock" not in accused(e) for e in paused)


def seen(recording: Recording, t_s: float, turned_over: bool) -> Scene:
    """Weeds every 30 cm beside the way, seen from 0.5 to 2 m ahead."""
    x_m, y_m, yaw_rad = recording.pose(t_s)
    plants = []
    for number in range(60):
        along_m = 2.0 + 0.3 * number - y_m
        aside_m = x_m - 1.0 + 0.25 * (-1) ** number
        ahead_m = along_m * math.cos(yaw_rad - math.pi / 2) + aside_m * math.sin(
            yaw_rad - math.pi / 2
        )
        if 0.5 < ahead_m < 2.0:
            x, y = (2.5 - ahead_m, -aside_m) if turned_over else (ahead_m, aside_m)
            plants.append(
                GroundPlant(
                    x_body_m=x, y_body_m=y, plant=PlantClass.WEED, area_m2=1e-3, confidence=0.9,
                    std_m=0.02,
                )
            )  # fmt: skip
    return Scene(
        t_s=t_s, ready_s=t_s + 0.2, frame_index=0, plants=tuple(plants), view_body_m=(),
    )  # fmt: skip


def watch(
    recording: Recording,
    *,
    flips_s: float = math.inf,
    ends_s: float = math.inf,
    late_s: float = 0.0,
) -> Iterator[tuple[Estimate, bool | None]]:
    """Estimates, and whether the scene of that tick was refused; ten pictures a second."""
    into = localizer()
    for tick, batch in enumerate(batches(recording)):
        estimate, is_refused = into.update(batch), None
        taken_s = batch.t_s - 0.2 - (late_s if batch.t_s > FROM_S else 0.0)
        if tick % 5 == 0 and taken_s > 4.0 and batch.t_s < ends_s:
            scene = seen(recording, taken_s, taken_s > flips_s)
            is_refused = into.is_stale(scene)
            if not is_refused:
                into.observe(scene)
        yield estimate, is_refused


def test_plants_that_go_away_from_a_robot_driving_ahead_mean_a_picture_upside_down() -> None:
    found = list(watch(record(north, 18.0, seed=8), flips_s=FROM_S))
    first = next(e for e, _ in found if "camera" in accused(e))
    assert FROM_S < first.t_s < FROM_S + 2.0
    assert isinstance(first.fact, PictureReversed)
    assert all(is_refused in (True, None) for e, is_refused in found if e.t_s > first.t_s)


def test_a_camera_that_is_the_right_way_up_is_believed_also_on_the_way_back() -> None:
    def to_and_fro(t_s: float) -> tuple[float, float]:
        return (0.4 if t_s % 8.0 > 3.0 else -0.3, 0.15 * math.sin(t_s))

    found = list(watch(record(to_and_fro, 30.0, seed=8)))
    assert not any(is_refused for _, is_refused in found)
    assert not any("camera" in accused(e) for e, _ in found)


def test_a_camera_that_falls_silent_is_named_within_two_seconds() -> None:
    found = list(watch(record(north, 18.0, seed=8), ends_s=FROM_S))
    first = next(e for e, _ in found if "camera" in accused(e))
    assert accused(first) == {"camera": "silent"}
    assert FROM_S + 1.0 < first.t_s < FROM_S + 2.0
    assert is_like(first.fact, NoPicture(1.55), within=0.055)


@pytest.mark.parametrize("late_s", [0.5, 2.0])
def test_pictures_that_come_late_are_named(late_s: float) -> None:
    found = list(watch(record(north, 18.0, seed=8), late_s=late_s))
    first = next(e for e, _ in found if accused(e).get("camera") == "late")
    assert first.t_s < FROM_S + 3.5
    assert is_like(first.fact, PicturesComeLate(late_s + 0.2))


def test_a_table_without_faults_takes_next_to_no_room_in_a_recording() -> None:
    estimate = localizer().update(SensorBatch(t_s=0.0))
    assert msgspec.msgpack.encode(estimate.verdicts) == b"\x80"
    again = msgspec.msgpack.decode(msgspec.msgpack.encode(estimate), type=Estimate)
    assert accused(again) == {}
