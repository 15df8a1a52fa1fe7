"""Receivers that jump, creep and repeat themselves, held against wheels, gyro and camera."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from unittest.mock import ANY

import msgspec
import numpy as np
import pytest

from agribot.autonomy.estimate.filter.history import Motion
from agribot.autonomy.estimate.localizer import Localizer
from agribot.autonomy.estimate.witnesses.picture_watch import PictureWatch
from agribot.autonomy.estimate.witnesses.row_agreement import RowAgreement
from agribot.core.config import EstimateConfig, FieldConfig
from agribot.core.facts import CameraAndGnssDisagree, Fact, GnssJumped, GnssRepeats, PictureFrozen
from agribot.core.messages import (
    BaseFix,
    ControlMission,
    Estimate,
    GnssFix,
    RowLine,
    Scene,
    SensorBatch,
)
from tests import nightly
from tests.asking import ask
from tests.autonomy.estimate.noisy_rover import M8N, QUIET, RTK, Errors, Recording, record
from tests.autonomy.estimate.paper_robot import robot
from tests.autonomy.estimate.playback import batches, localizer
from tests.autonomy.estimate.test_localizer_faults import (
    at,
    distance_m,
    halting,
    shifted,
    with_fixes,
)
from tests.finding import holds, is_like

FROM_S = 12.0
# Rows that run North, the robot on the first of them.
FIELD = FieldConfig(
    first_row_start_map_m=(1.0, 2.0), row_yaw_deg=90.0, row_length_m=20.0, row_pitch_m=1.0,
    row_count=4, plant_spacing_m=0.25,
)  # fmt: skip


def north(t_s: float) -> tuple[float, float]:
    return (0.4, 0.0) if t_s > 3.0 else (0.0, 0.0)


def spoilt(recording: Recording, change: Callable[[GnssFix], GnssFix]) -> Recording:
    return with_fixes(recording, lambda t: t > FROM_S, change)


def drive(
    recording: Recording,
    *,
    camera: bool = False,
    resume_s: float | None = None,
    aside_m: float = 0.0,
    seed: int = 0,
) -> tuple[Localizer, list[Estimate]]:
    """Play a recording; the camera sees a row line ten times a second, of rows off their map."""
    into = Localizer(EstimateConfig(), FIELD, robot((0.0, 0.0, 0.6)))
    rng, found = np.random.default_rng(seed), []
    for tick, batch in enumerate(batches(recording)):
        is_time = resume_s is not None and abs(batch.t_s - resume_s) < 0.01
        events = (ask(ControlMission(action="resume"), "test", t_s=batch.t_s),) * is_time
        found.append(into.update(msgspec.structs.replace(batch, requests=events)))
        if camera and tick % 5 == 0 and batch.t_s > 4.0:
            into.observe(sight(recording, batch.t_s, aside_m, rng))
    return into, found


def sight(recording: Recording, t_s: float, aside_m: float, rng: np.random.Generator) -> Scene:
    """What a camera makes of the row under the robot."""
    x_m, _, yaw_rad = recording.pose(t_s)
    off_m, turn_rad = rng.normal(0.0, (0.015, math.radians(0.7))).tolist()
    line = RowLine(
        t_s=t_s, offset_m=1.0 - x_m - aside_m + off_m, heading_rad=yaw_rad - math.pi / 2 + turn_rad,
        offset_std_m=0.02, heading_std_rad=math.radians(0.8),
    )  # fmt: skip
    return Scene(t_s=t_s, ready_s=t_s, frame_index=0, plants=(), view_body_m=(), row_line=line)


def told(estimates: list[Estimate]) -> Fact | None:
    """The first contradiction."""
    return next((e.contradiction_fact for e in estimates if e.contradiction_fact), None)


def jumped(size_m: float) -> Recording:
    return spoilt(record(north, 22.0, seed=1), lambda fix: shifted(fix, size_m))


def crept(mps: float, duration_s: float = 30.0) -> Recording:
    return spoilt(
        record(north, duration_s, seed=1), lambda fix: shifted(fix, mps * (fix.t_s - FROM_S))
    )


def test_fixes_that_jump_while_the_robot_drives_are_not_followed_but_named() -> None:
    recording = jumped(0.4)
    _, estimates = drive(recording)
    assert is_like(told(estimates), GnssJumped(0.5), within=0.5)
    first = next(e for e in estimates if e.contradiction_fact)
    assert first.t_s < FROM_S + 3.5
    assert distance_m(recording, at(estimates, FROM_S + 4.0)) < 0.1
    assert first.ok


def with_fixes_at(recording: Recording, is_told: Callable[[float], bool]) -> Recording:
    kept = [(arrival_s, fix) for arrival_s, fix in recording.fixes if is_told(fix.t_s)]
    return msgspec.structs.replace(recording, fixes=kept)


def test_a_jump_of_a_receiver_with_one_fix_a_second_is_named_although_its_times_jitter() -> None:
    """0.9 and 1.1 s apart by turns."""
    recording = with_fixes(
        record(north, 72.0, seed=1), lambda t: t > 40.0, lambda fix: shifted(fix, 3.0)
    )
    recording = with_fixes_at(recording, lambda t: round(10.0 * t) % 20 in (0, 9))
    _, estimates = drive(recording)
    assert isinstance(told(estimates), GnssJumped)
    assert max(distance_m(recording, e) for e in estimates if e.t_s > 12.0) < 0.2


@pytest.mark.parametrize(("silent_s", "is_named"), [(2.0, True), (6.0, False)])
def test_fixes_before_a_long_silence_do_not_speak_against_those_after_it(
    silent_s: float, is_named: bool
) -> None:
    began_s = FROM_S - silent_s - 1.0
    recording = with_fixes_at(jumped(0.4), lambda t: not began_s < t <= began_s + silent_s)
    _, estimates = drive(recording)
    assert bool(told(estimates)) is is_named
    assert (distance_m(recording, at(estimates, FROM_S + 6.0)) < 0.2) is is_named


def test_a_person_who_goes_on_believes_gnss_where_no_camera_saw_the_row() -> None:
    recording = spoilt(record(halting, 24.0, seed=1), lambda fix: shifted(fix, 0.4))
    _, estimates = drive(recording, resume_s=18.0)
    assert at(estimates, 17.9).contradiction_fact
    assert distance_m(recording, at(estimates, 17.9)) < 0.1
    after = [e for e in estimates if e.t_s > 18.03]
    assert not any(e.contradiction_fact for e in after)
    assert all(0.3 < distance_m(recording, e) < 0.5 for e in after)


def test_a_person_who_goes_on_believes_the_camera_where_it_saw_the_row() -> None:
    recording = spoilt(record(halting, 24.0, seed=1), lambda fix: shifted(fix, 0.4))
    _, estimates = drive(recording, camera=True, resume_s=18.0)
    assert is_like(told(estimates), CameraAndGnssDisagree(0.45, ANY), within=0.055)
    after = [e for e in estimates if e.t_s > 18.03]
    assert not any(e.contradiction_fact for e in after)
    assert max(distance_m(recording, e) for e in after) < 0.1


@nightly.one_by_one("size_m", [0.15, 0.4, 2.0], in_suite=1)
def test_a_jump_that_the_camera_contradicts_leaves_the_robot_on_its_row(size_m: float) -> None:
    recording = jumped(size_m)
    _, estimates = drive(recording, camera=True)
    assert isinstance(told(estimates), CameraAndGnssDisagree)
    first = next(e for e in estimates if e.contradiction_fact)
    assert first.t_s < FROM_S + 4.0
    assert max(distance_m(recording, e) for e in estimates if e.t_s > 6.0) < 0.12


@pytest.mark.parametrize(("mps", "off_m"), [(0.05, 0.25), (0.01, 0.2)])
def test_fixes_that_creep_off_the_row_are_stopped_before_a_wheel_reaches_the_crop(
    mps: float, off_m: float
) -> None:
    recording = crept(mps, FROM_S + 0.2 / mps + 6.0)
    _, estimates = drive(recording, camera=True)
    first = next(e for e in estimates if e.contradiction_fact)
    assert is_like(first.contradiction_fact, CameraAndGnssDisagree(0.5, ANY), within=0.5)
    assert max(distance_m(recording, e) for e in estimates if 6.0 < e.t_s < first.t_s) < off_m


def test_after_a_slow_creep_a_person_who_goes_on_is_back_on_the_row() -> None:
    def stopping(t_s: float) -> tuple[float, float]:
        return (0.4, 0.0) if 3.0 < t_s < 20.0 else (0.0, 0.0)

    recording = spoilt(
        record(stopping, 28.0, seed=1),
        lambda fix: shifted(fix, min(0.04 * (fix.t_s - FROM_S), 0.25)),
    )
    _, estimates = drive(recording, camera=True, resume_s=24.0)
    before = at(estimates, 23.9).contradiction_fact
    assert is_like(before, CameraAndGnssDisagree(0.25, ANY), within=0.055)
    after = [e for e in estimates if e.t_s > 24.03]
    assert not any(e.contradiction_fact for e in after)
    assert max(distance_m(recording, e) for e in after) < 0.1


@nightly.one_by_one("aside_m", [0.12, 0.22, -0.22], in_suite=1)
def test_rows_beside_their_map_are_a_finding_once_they_were_so_for_a_while(aside_m: float) -> None:
    _, estimates = drive(record(north, 20.0, seed=2), camera=True, aside_m=aside_m)
    assert not told(estimates)
    doubted = [e for e in estimates if isinstance(e.fact, CameraAndGnssDisagree)]
    assert doubted, "until then no pose is certain"
    after = [e for e in estimates if e.t_s > FROM_S]
    assert not any(e.fact for e in after)
    assert not any({"camera", "gnss"} & e.verdicts.keys() for e in after)
    assert all(e.rows_off_m[0] == pytest.approx(-aside_m, abs=0.04) for e in after)
    most_m = max(e.across_protection_m for e in doubted)
    assert most_m > abs(aside_m) > 2.0 * after[-1].across_protection_m


def test_rows_far_beside_their_map_are_left_to_a_person() -> None:
    _, estimates = drive(record(north, 20.0, seed=2), camera=True, aside_m=0.35)
    assert is_like(told(estimates), CameraAndGnssDisagree(0.35, ANY), within=0.055)


@pytest.mark.parametrize("errors", [RTK, M8N], ids=["rtk", "m8n"])
@nightly.one_by_one("seed", range(4), in_suite=1)
def test_without_a_fault_nothing_is_contradicted(errors: Errors, seed: int) -> None:
    recording = record(north, 25.0, seed=seed, errors=errors)
    _, estimates = drive(recording, camera=True, seed=seed)
    assert not told(estimates)
    assert not any(
        holds(e.fact, one) for e in estimates for one in (CameraAndGnssDisagree, GnssRepeats)
    )


def repeated(still: bool) -> Callable[[GnssFix], GnssFix]:
    """The first fix again and again, with its velocity, or with none as static hold has it."""
    first: list[GnssFix] = []

    def repeat(fix: GnssFix) -> GnssFix:
        first.append(fix)
        velocity = (0.0, 0.0, 0.0) if still else first[0].velocity_mps
        return msgspec.structs.replace(first[0], t_s=fix.t_s, velocity_mps=velocity)

    return repeat


@pytest.mark.parametrize("still", [False, True], ids=["velocity too", "static hold"])
def test_a_receiver_that_repeats_its_place_while_the_wheels_turn_is_named_and_not_believed(
    still: bool,
) -> None:
    recording = spoilt(record(north, 24.0, seed=3), repeated(still))
    into, estimates = drive(recording)
    named = at(estimates, FROM_S + 2.5)
    assert is_like(named.fact, GnssRepeats(0.5), within=0.5)
    assert into.rejected["gnss repeats itself"] > 90
    assert max(distance_m(recording, e) for e in estimates if e.t_s > 6.0) < 0.3
    assert estimates[-1].pos_std_m > 3.0 * at(estimates, FROM_S).pos_std_m


def test_a_base_station_with_noise_does_not_move_a_receiver_that_repeats_its_place() -> None:
    recording = spoilt(record(north, 24.0, seed=3, errors=M8N), repeated(still=False))
    into = Localizer(EstimateConfig(), FIELD, robot((0.0, 0.0, 0.6)))
    rng = np.random.default_rng(0)
    for tick, batch in enumerate(batches(recording)):
        lat_deg, lon_deg = rng.normal((59.0, 10.0), 2e-7).tolist()
        base = BaseFix(
            t_s=batch.t_s, lat_deg=lat_deg, lon_deg=lon_deg, alt_m=0.0, pos_std_m=1.0,
            known_lat_deg=59.0, known_lon_deg=10.0, known_alt_m=0.0,
        )  # fmt: skip
        told = (base,) * (tick % 10 == 0)
        estimate = into.update(msgspec.structs.replace(batch, base=told))
    assert into.rejected["gnss repeats itself"] > 45
    assert holds(estimate.fact, GnssRepeats)


def test_a_receiver_without_noise_on_a_standing_robot_may_repeat_itself() -> None:
    into = localizer()
    estimates = [into.update(batch) for batch in batches(record(halting, 25.0, errors=QUIET))]
    assert into.rejected["gnss repeats itself"] == 0
    assert not any(holds(e.fact, GnssRepeats) for e in estimates)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda fix: msgspec.structs.replace(fix, lat_deg=91.0),
        lambda fix: msgspec.structs.replace(fix, lon_deg=-200.0),
        lambda fix: msgspec.structs.replace(fix, lat_deg=fix.lat_deg - 30.0),
    ],
    ids=["beyond the pole", "beyond the date line", "another continent"],
)
def test_no_fix_takes_the_robot_to_the_other_end_of_the_world(
    spoil: Callable[[GnssFix], GnssFix],
) -> None:
    recording = spoilt(record(halting, 40.0, seed=5), spoil)
    _, estimates = drive(recording, resume_s=30.0)
    assert max(distance_m(recording, e) for e in estimates if e.ok and e.t_s > 6.0) < 2.0
    assert estimates[-1].fact


def scenes(crc32s: Iterator[int]) -> Iterator[Scene]:
    for crc32 in crc32s:
        yield Scene(
            t_s=0.0, ready_s=0.0, frame_index=0, plants=(), view_body_m=(), picture_crc32=crc32
        )


def stale(crc32s: list[int], step_m: float, step_rad: float = 0.0) -> list[bool]:
    watch = PictureWatch()
    return [
        watch.is_stale(
            scene, Motion(0.1 * i, step_m * i, 0.0, step_rad * i, 0.4, 0.0)
        )
        for i, scene in enumerate(scenes(iter(crc32s)))
    ]  # fmt: skip


def test_a_picture_that_stays_the_same_over_five_centimetres_is_none() -> None:
    assert stale([7] * 6, 0.02) == [False, False, False, True, True, True]
    assert stale([7, 7, 7, 7, 8, 9], 0.02) == [False, False, False, True, False, False]
    assert stale([7] * 6, 0.0, 0.05) == [False, False, True, True, True, True]


def test_pictures_of_a_standing_robot_may_be_alike_and_old_recordings_tell_none() -> None:
    assert not any(stale([7] * 50, 0.0))
    assert not any(stale([0] * 50, 0.1))


def test_a_frozen_camera_is_named_and_corrects_nothing() -> None:
    recording = record(north, 20.0, seed=3, errors=M8N)
    into = Localizer(EstimateConfig(), FIELD, robot((0.0, 0.0, 0.6)))
    scene = None
    for tick, batch in enumerate(batches(recording)):
        estimate = into.update(batch)
        if tick % 5 == 0 and batch.t_s > 4.0:
            rng = np.random.default_rng(tick)
            if scene is None or batch.t_s < FROM_S:
                scene = sight(recording, batch.t_s, 0.0, rng)
                scene = msgspec.structs.replace(scene, picture_crc32=tick)
            now = msgspec.structs.replace(scene, t_s=batch.t_s, ready_s=batch.t_s)
            if not into.is_stale(now):
                into.observe(now)
    assert is_like(estimate.fact, PictureFrozen(0.05))
    assert into.rejected["picture not new"] > 50
    assert estimate.across_protection_m > 0.2


def test_the_agreement_of_camera_and_fixes_does_not_depend_on_the_pose() -> None:
    """Both are relative to the pose, so that an error of the pose cancels."""
    for pose_off_m in (0.0, 0.5):
        agreement = RowAgreement()
        for i in range(60):
            agreement.add_fix(0.1 * i, 0.01 - pose_off_m)
            agreement.add_look(0.1 * i, 0.31 - pose_off_m)
        assert agreement.must_halt
        assert agreement.apart_m == pytest.approx(0.3)


def disagreeing(off_m: float) -> RowAgreement:
    """The plants of a row have testified against fixes that fit the pose."""
    agreement = RowAgreement()
    for i in range(20):
        agreement.add_fix(0.1 * i, 0.0)
    agreement.testify(2.0, off_m)
    return agreement


def test_plants_that_agree_with_the_fixes_again_end_a_disagreement() -> None:
    for off_m, halts in ((0.12, False), (0.2, True)):
        agreement = disagreeing(off_m)
        assert agreement.fault is not None and agreement.fault.off_m == pytest.approx(off_m)
        assert agreement.must_halt is halts
        agreement.testify(3.0, 0.09)
        assert agreement.fault
        agreement.testify(3.0, 0.07)
        assert not (agreement.fault or agreement.must_halt)


def test_a_named_disagreement_that_nothing_renews_is_past_and_one_that_halts_is_not() -> None:
    named, halting = disagreeing(0.12), disagreeing(0.2)
    for agreement in (named, halting):
        agreement.expire(12.0)
        assert agreement.fault
        agreement.expire(18.0)
    assert named.fault is None
    assert halting.fault is not None and halting.fault.off_m == pytest.approx(0.2)
    assert halting.must_halt


def test_a_robot_without_rows_in_view_does_not_speak_of_a_disagreement_for_good() -> None:
    recording, rng = record(north, 32.0, seed=2), np.random.default_rng(0)
    into, estimates = Localizer(EstimateConfig(), FIELD, robot((0.0, 0.0, 0.6))), []
    for tick, batch in enumerate(batches(recording)):
        estimates.append(into.update(batch))
        if tick % 5 == 0 and FROM_S - 3.0 < batch.t_s < FROM_S:  # too short to be the map's error
            into.observe(sight(recording, batch.t_s, 0.12, rng))
    soon = at(estimates, FROM_S + 1.0).fact
    assert is_like(soon, CameraAndGnssDisagree(0.15, ANY), within=0.055)
    assert estimates[-1].fact is None


def test_an_empty_batch_is_no_reason_for_doubt() -> None:
    assert localizer().update(SensorBatch(t_s=1.0)).contradiction_fact is None
