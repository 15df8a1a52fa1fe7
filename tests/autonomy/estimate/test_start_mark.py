"""A marked start: what it gives a cheap receiver, and who is right when the two disagree."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from unittest.mock import ANY

import msgspec
import numpy as np
import pytest

from agribot.autonomy.estimate.filter.start import StartMark
from agribot.autonomy.estimate.localizer import Localizer
from agribot.autonomy.estimate.witnesses.start_agreement import StartAgreement
from agribot.core.config import EstimateConfig, FieldConfig
from agribot.core.facts import StartAside, StartTurned
from agribot.core.messages import (
    AskerKind,
    ControlMission,
    Estimate,
    GnssFix,
    GnssQuality,
    RequestEvent,
    RowLine,
    SensorBatch,
    Who,
)
from tests import nightly
from tests.autonomy.estimate.noisy_rover import M8N, RTK, Errors, Recording, record, rows, stand
from tests.autonomy.estimate.paper_robot import robot
from tests.autonomy.estimate.playback import batches, error, play
from tests.autonomy.estimate.test_first_heading import URBAN
from tests.finding import find, holds

START = (1.0, 2.0, math.pi / 2)
PERSON = Who("person", AskerKind.OPERATOR)
MARKED = FieldConfig(start_map_m=START[:2], start_yaw_deg=90.0)


def run(recording: Recording, field: FieldConfig = MARKED) -> list[Estimate]:
    return play(recording, Localizer(EstimateConfig(), field, robot()))


def moved(east_m: float = 0.0, turned_deg: float = 0.0) -> FieldConfig:
    return msgspec.structs.replace(
        MARKED, start_map_m=(START[0] + east_m, START[1]), start_yaw_deg=90.0 + turned_deg
    )


@pytest.mark.parametrize("errors", [M8N, URBAN], ids=["open sky", "beside walls"])
def test_a_cheap_receiver_starts_from_the_mark(errors: Errors) -> None:
    for seed in range(5):
        recording = record(stand, 6.0, seed=seed, errors=errors, start=START)
        last = run(recording)[-1]
        assert last.ok, last.fact
        assert last.pos_std_m < 0.06
        assert math.hypot(*error(recording, last)[:2]) < 0.02  # the mark is exact here


def drive_from_the_mark(seeds: Sequence[int], errors: Errors) -> tuple[float, float]:
    """Drive 40 s: mean squared normalised error of the places, and mean 1 sigma stated."""
    normalised, stds = [], []
    for seed in seeds:
        recording = record(rows, 40.0, seed=seed, errors=errors, start=START)
        last = run(recording)[-1]
        cov = np.array(last.pose_cov).reshape(3, 3)[:2, :2]
        deviation = error(recording, last)[:2]
        normalised.append(float(deviation @ np.linalg.solve(cov, deviation)))
        stds.append(last.pos_std_m)
    return float(np.mean(normalised)), float(np.mean(stds))


@nightly.all_or_first("seeds", range(20), in_suite=3)
def test_the_stated_error_grows_honestly_after_the_mark(seeds: Sequence[int]) -> None:
    square, std_m = drive_from_the_mark(seeds, M8N)
    assert 0.15 < std_m < 0.6
    assert 0.4 < square < nightly.mean_square_band(len(seeds), 2)[1]


@nightly.all_or_first("seeds", range(20), in_suite=3)
def test_a_receiver_that_turns_out_to_wander_takes_nothing_from_the_mark(
    seeds: Sequence[int],
) -> None:
    square, std_m = drive_from_the_mark(seeds, URBAN)
    assert 0.15 < std_m < 0.6
    assert square < nightly.mean_square_band(len(seeds), 2)[1]


def test_with_corrections_the_receiver_decides() -> None:
    recording = record(rows, 20.0, seed=1, errors=RTK, start=START)
    last = run(recording, moved(east_m=0.15))[-1]
    assert last.ok, last.fact
    assert math.hypot(*error(recording, last)[:2]) < 0.05


@pytest.mark.parametrize("errors", [RTK, M8N], ids=["rtk", "m8n"])
def test_a_robot_that_stands_elsewhere_is_told_so(errors: Errors) -> None:
    last = run(record(stand, 5.0, seed=1, errors=errors, start=START), moved(east_m=12.0))[-1]
    assert not last.ok
    assert holds(last.fact, StartAside(12.0, "west", ANY), within=5.0)


def test_a_robot_astride_the_row_beside_its_mark_is_told_so() -> None:
    """Rows of 1 m: the receiver is right to 2 cm, and the mark is that of another row."""
    last = run(record(stand, 5.0, seed=1, errors=RTK, start=START), moved(east_m=0.9))[-1]
    assert not last.ok
    assert holds(last.fact, StartAside(0.9, "west", ANY), within=0.1)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("off_m", [0.15, -0.15, 0.3, -0.3])
def test_with_corrections_mark_and_fix_are_taken_at_their_word(off_m: float, seed: int) -> None:
    """The mark is good to 5 cm and the fix to 1.4: 4 sigmas are 21 cm."""
    recording = record(stand, 5.0, seed=seed, errors=RTK, start=START)
    last = run(recording, moved(east_m=off_m))[-1]
    assert last.ok is (abs(off_m) < 0.2)
    if not last.ok:
        aside = find(last.fact, StartAside)
        assert aside.direction == ("west" if off_m > 0.0 else "east")
        assert aside.limit_m == pytest.approx(0.21, abs=0.005)


def shift_fixes(recording: Recording, shift: Callable[[GnssFix], GnssFix]) -> Recording:
    fixes = [(arrival_s, shift(fix)) for arrival_s, fix in recording.fixes]
    return msgspec.structs.replace(recording, fixes=fixes)


def move_north(fix: GnssFix, north_m: float) -> GnssFix:
    return msgspec.structs.replace(fix, lat_deg=fix.lat_deg + north_m / 110_700.0)


@pytest.mark.parametrize("quality", [GnssQuality.SINGLE, GnssQuality.RTK_FLOAT])
@pytest.mark.parametrize(("off_m", "starts"), [(0.4, False), (0.1, True)])
def test_ambiguities_that_are_fixed_later_are_held_against_the_mark(
    off_m: float, quality: GnssQuality, *, starts: bool
) -> None:
    """As after every cold start: the position was known from the mark by then."""

    def shift(fix: GnssFix) -> GnssFix:
        moved = move_north(fix, off_m)
        if fix.t_s >= 4.0:
            return moved
        return msgspec.structs.replace(moved, quality=quality, pos_std_m=1.5)

    recording = record(stand, 12.0, seed=1, errors=RTK, start=START)
    before, last = (run(shift_fixes(recording, shift))[k] for k in (190, -1))
    assert before.ok
    assert last.ok is starts
    assert starts or holds(last.fact, StartAside(0.4, "north", 0.21))


def test_fixes_that_jump_before_the_robot_sets_off_are_held_against_the_mark() -> None:
    recording = shift_fixes(
        record(stand, 12.0, seed=1, errors=RTK, start=START),
        lambda fix: move_north(fix, 0.4 if fix.t_s > 5.0 else 0.0),
    )
    assert holds(run(recording)[-1].fact, StartAside(0.45, "north", ANY), within=0.055)


@pytest.mark.parametrize("errors", [RTK, M8N], ids=["rtk", "m8n"])
def test_a_robot_that_is_brought_to_its_mark_starts(errors: Errors) -> None:
    away = shift_fixes(
        record(stand, 15.0, seed=1, errors=errors, start=START),
        lambda fix: move_north(fix, 12.0 if fix.t_s < 5.0 else 0.0),
    )
    seen = [(t_s, fix) for t_s, fix in away.fixes if not 5.0 < fix.t_s < 7.0]
    recording = msgspec.structs.replace(away, fixes=seen)
    estimates = run(recording)
    assert not estimates[240].ok
    assert estimates[-1].ok
    assert math.hypot(*error(recording, estimates[-1])[:2]) < 0.05


def test_a_robot_that_has_set_off_leaves_its_mark() -> None:
    assert run(record(rows, 10.0, seed=1, errors=RTK, start=START))[-1].ok


def test_a_mark_that_is_known_roughly_lets_a_robot_with_corrections_start() -> None:
    field = msgspec.structs.replace(moved(east_m=0.3), start_std_m=0.1)
    assert run(record(stand, 5.0, seed=1, errors=RTK, start=START), field)[-1].ok


def test_what_was_driven_before_the_heading_was_known_may_have_led_anywhere() -> None:
    for slack_m, is_found in ((0.1, True), (0.3, False)):
        check = StartAgreement(StartMark.of(MARKED), MARKED)
        check.begin(complex(*START[:2]) + 0.4, 0.014, 0j, slack_m, is_fixed=True)
        assert (check.fault is not None) is is_found


def test_a_robot_that_faces_elsewhere_is_told_so() -> None:
    last = run(record(stand, 5.0, seed=1, errors=RTK, start=START), moved(turned_deg=180.0))[-1]
    assert not last.ok
    assert holds(last.fact, StartTurned)


@nightly.all_or_first("seeds", range(8), in_suite=4)
def test_the_mark_shows_the_error_of_the_compass(seeds: Sequence[int]) -> None:
    plain, marked = [], []
    for seed in seeds:
        recording = record(stand, 6.0, seed=seed, errors=M8N, start=START)
        plain.append(error(recording, run(recording, FieldConfig())[-1])[2])
        marked.append(error(recording, run(recording)[-1])[2])
    assert np.sqrt(np.mean(np.square(marked))) < 0.7 * np.sqrt(np.mean(np.square(plain)))


def left(east_m: float, field: FieldConfig) -> FieldConfig:
    return msgspec.structs.replace(field, left_map_m=(START[0] + east_m, START[1]))


def test_a_fix_away_from_where_the_last_run_left_the_robot_waits_for_a_person() -> None:
    into = Localizer(EstimateConfig(), left(0.4, FieldConfig()), robot())
    recording = record(stand, 5.0, seed=1, errors=RTK, start=START)
    last = play(recording, into)[-1]
    assert holds(last.fact, StartAside(0.4, "west", 0.13, against=("left",)), within=0.03)
    resumed = RequestEvent(t_s=5.0, who=PERSON, request=ControlMission(action="resume"))
    assert into.update(SensorBatch(t_s=5.0, requests=(resumed,))).ok


def test_a_false_fix_at_power_up_is_told_from_mark_and_last_place() -> None:
    """0.17 m: the mark alone lets it pass."""
    recording = shift_fixes(
        record(stand, 5.0, seed=1, errors=RTK, start=START), lambda fix: move_north(fix, 0.17)
    )
    assert run(recording, MARKED)[-1].ok
    last = run(recording, left(0.0, MARKED))[-1]
    assert holds(last.fact, StartAside(0.2, "north", ANY, "gnss", ANY), within=0.06)


def test_a_wrong_datum_moves_the_mark_away_from_fix_and_last_place() -> None:
    recording = record(stand, 5.0, seed=1, errors=RTK, start=START)
    last = run(recording, left(0.0, moved(east_m=150.0)))[-1]
    assert holds(last.fact, StartAside(150.0, "east", 0.2, "mark", ("gnss", "left")), within=0.1)


def drive_along_rows(field: FieldConfig, beside_m: float, errors: Errors) -> list[Estimate]:
    """Stand, then drive North along a row that truly stands `beside_m` East of its map."""
    recording = record(rows, 6.5, seed=1, errors=errors, start=START)
    into, estimates = Localizer(EstimateConfig(), field, robot()), []
    for batch in batches(recording):
        estimates.append(into.update(batch))
        east_m = recording.pose(batch.t_s)[0] - START[0]
        into.observe_line(
            RowLine(
                t_s=batch.t_s, offset_m=beside_m - east_m, heading_rad=0.0, offset_std_m=0.015,
                heading_std_rad=0.012, at_ahead_m=0.0,
            )
        )  # fmt: skip
    return estimates


@pytest.mark.parametrize("beside_m", [0.03, 0.3])
def test_rows_in_view_that_stand_beside_their_map_are_found_in_the_first_metre(
    beside_m: float,
) -> None:
    estimates = drive_along_rows(MARKED, beside_m, RTK)
    found = [each for each in estimates if holds(each.fact, StartAside)]
    assert bool(found) is (beside_m > 0.2)
    if found:
        assert holds(
            found[0].fact, StartAside(0.3, "west", ANY, "rows", ("gnss", "mark")), within=0.08
        )
        assert found[0].y_map_m - START[1] < 1.0
