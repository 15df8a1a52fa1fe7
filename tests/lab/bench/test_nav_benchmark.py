"""The benchmark judges honestly: its plant follows physics, its seeds stand alone."""

from __future__ import annotations

import itertools
import json
import math
import statistics
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np
import pytest

from agribot.cli.main import main
from agribot.core.errors import ConfigError
from agribot.description.loader import load_robot
from agribot.lab.bench.nav import suite
from agribot.lab.bench.nav.job import Job
from agribot.lab.bench.nav.judge import FleetJudge, LevelJudge, Outcome
from agribot.lab.bench.nav.kept import KeptMissions
from agribot.lab.bench.nav.missions import run_missions
from agribot.lab.bench.nav.original import OriginalController
from agribot.lab.bench.nav.plant import RoverFleet
from agribot.lab.bench.nav.receivers import Receivers
from agribot.lab.bench.nav.row_camera import RowCamera
from agribot.lab.bench.nav.scenario import (
    DT_S,
    RECEIVERS,
    ROWS,
    TICK_STEPS,
    Receiver,
    Scenario,
    SoilDrift,
    Vision,
    scenario,
)
from tests import nightly

# 95 % band of the mean of 50 squared normal errors of a pose: chi2(150) / 50.
POSE_BAND = 2.36, 3.72
FOUR_ROWS_S = 80.0
FEW = 2  # rows of the field by day
each_field = nightly.one_by_one("rows", (FEW, ROWS), in_suite=1)
FIRM = SoilDrift(
    slip_max_ratio=0.0, slip_std_ratio=0.0, yaw_gain_std_ratio=0.0, yaw_gain_walk_ratio=0.0,
    yaw_rate_std_radps=0.0, slope_max_rad=0.0, lateral_std_mps=0.0, turn_centre_std_m=0.0,
)  # fmt: skip


def drive(plant: RoverFleet, v_mps: float, yaw_rate_radps: float, seconds: float) -> None:
    count = len(plant.x_m)
    for _ in range(round(seconds / DT_S)):
        plant.step(np.full(count, v_mps), np.full(count, yaw_rate_radps))


def test_on_firm_ground_the_plant_drives_what_it_is_told_after_lag_and_dead_time() -> None:
    plant = RoverFleet((1, 2), FIRM)
    start_m = plant.x_m.copy()
    drive(plant, 0.5, 0.0, 10.0)
    way_m = (plant.x_m - start_m) / np.cos(plant.yaw_rad)
    # 10 s less the dead time and the lag, and a little more for the limited acceleration.
    np.testing.assert_allclose(way_m, 0.5 * (10.0 - 0.05 - 0.15), atol=0.06)


def test_soil_takes_a_share_of_the_way_and_disturbs_nobody_who_stands() -> None:
    plant = RoverFleet(range(40), SoilDrift())
    before = plant.x_m.copy(), plant.yaw_rad.copy()
    drive(plant, 0.0, 0.0, 5.0)
    np.testing.assert_array_equal(plant.x_m, before[0])
    drive(plant, 0.5, 0.0, 10.0)
    share = np.hypot(plant.x_m - before[0], plant.y_m - plant.y_m.mean()) / 5.0
    assert 0.88 < share.mean() < 0.98


def test_a_seed_meets_the_same_world_whoever_drives_beside_it() -> None:
    alone, among = RoverFleet((7,), SoilDrift()), RoverFleet((5, 7, 9), SoilDrift())
    drive(alone, 0.4, 0.1, 4.0)
    drive(among, 0.4, 0.1, 4.0)
    assert alone.x_m[0] == among.x_m[1] and alone.yaw_rad[0] == among.yaw_rad[1]


def test_a_receiver_with_corrections_loses_its_ambiguities_about_once_in_four_minutes() -> None:
    plant = RoverFleet(range(60), FIRM)
    receivers = Receivers(range(60), RECEIVERS["rtk"], (0.0, 0.0))
    lost = [receivers.sample(0.1 * k, plant)[0].is_float for k in range(6000)]
    # Mean outage 15 s after a mean wait of 240 s.
    assert np.mean(lost) == pytest.approx(15.0 / 255.0, rel=0.25)


def test_the_camera_sees_the_offset_of_the_nearest_row_and_nothing_at_a_slant() -> None:
    sharp = Vision(
        offset_std_m=1e-6, heading_std_rad=1e-6, heading_wander_rad=0.0, outlier_ratio=0.0,
        dropout_every_s=1e9,
    )  # fmt: skip
    plant = RoverFleet((1, 2, 3), FIRM)
    plant.x_m = np.array([5.0, 5.0, 5.0])
    plant.y_m = np.array([2.1, 2.1, 2.1])
    plant.yaw_rad = np.array([0.1, math.pi, math.radians(40.0)])
    line = RowCamera((1, 2, 3), sharp).sample(0.0, plant)
    np.testing.assert_allclose(line.offset_m[:2], [0.1, -0.1], atol=1e-4)
    np.testing.assert_allclose(line.heading_rad[:2], [0.1, 0.0], atol=1e-4)
    assert math.isnan(line.offset_m[2])


def test_the_judge_counts_plants_under_the_wheels_and_rows_left_out() -> None:
    plant, judge = RoverFleet((1,), FIRM), FleetJudge(1)
    plant.y_m[:], plant.yaw_rad[:] = 0.39, 0.0  # its right wheels stand on the row
    row, on, done = np.zeros(1, dtype=np.int64), np.ones(1, dtype=bool), np.zeros(1, dtype=bool)
    for x_m in np.arange(0.0, 12.0, 0.02):
        plant.x_m[:] = x_m
        judge.tick(plant, row, on, done)
    (outcome,) = judge.outcomes([1], ~done, np.zeros(1), has_filter=False)
    assert outcome.crushed == 49
    assert outcome.xte_max_m == pytest.approx(0.39)
    assert outcome.rows_ok == 0 and not outcome.success


def test_the_original_controller_turns_on_the_spot_and_stops_a_metre_short() -> None:
    controller = OriginalController(2)
    for _ in range(7):
        controller.hear_compass(np.array([math.radians(90.0), 0.0]))
    for _ in range(2):  # the first fix also sees the jump of the angle
        controller.hear_fix(np.array([-1.0, 12.2]), np.array([0.0, 0.5]))
    assert controller.v_mps.tolist() == [0.0, 0.0]
    assert controller.yaw_rate_radps[0] == pytest.approx(-0.5)
    assert controller.waypoint[1] == 3  # the next row's end lies within a metre, too


def lay_rows(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    """Give the field of the benchmark so many rows."""
    for module in ("judge", "missions", "row_camera", "scenario", "table"):
        monkeypatch.setattr(f"agribot.lab.bench.nav.{module}.ROWS", count)


@each_field
def test_the_command_reports_what_it_measured(
    rows: int, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    lay_rows(monkeypatch, rows)
    status = main(
        ["bench", "nav", "--sensors", "rtk", "--seeds", "1-4", "--workers", "1", "--json"]
    )
    out = capsys.readouterr().out.strip().splitlines()[-1]
    (entry,) = json.loads(out)["lines"]
    assert status == 0
    assert entry["missions_ok"] == entry["missions"] == 4
    assert 0.005 < entry["xte_rms_m"] < 0.02
    assert entry["plants"] == 4 * rows * 49 and entry["crushed"] == 0


def assert_levels_are_kept(
    outcomes: list[Outcome], rows: int = ROWS, least_available: float = 0.85
) -> None:
    """No error was beyond its level more often than promised, and work was allowed."""
    levels = [outcome.level for outcome in outcomes if outcome.level is not None]
    row_m = sum(level.row_m for level in levels)
    assert row_m > 0.9 * len(outcomes) * rows * 12.0
    assert sum(level.exceeded_m for level in levels) <= 2e-3 * row_m
    assert sum(level.misled for level in levels) == 0
    assert sum(level.available_m for level in levels) > least_available * row_m


def drive_four_rows(
    seeds: Sequence[int], what: Scenario, *, has_level: bool = False
) -> list[Outcome]:
    """Of these three are done by every robot that is not held up."""
    ticks = itertools.count()
    last = round(FOUR_ROWS_S / (TICK_STEPS * DT_S))
    return run_missions(
        seeds, what, load_robot(), stop=lambda: next(ticks) >= last, has_level=has_level
    )


@each_field
def test_the_filter_knows_how_wrong_it_is_across_the_row(
    rows: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And its protection level bounds that, on the same drives."""
    lay_rows(monkeypatch, rows)
    what = scenario("m8n", vision=True, speed_mps=0.8, variant="nominal")
    outcomes = run_missions(range(300, 350), what, load_robot(), has_level=True)
    assert_levels_are_kept(outcomes, rows)
    assert all(outcome.success and outcome.crushed == 0 for outcome in outcomes)
    # 95 % band of the mean of 50 squared normal numbers.
    assert 0.65 < np.mean([outcome.nees or 0.0 for outcome in outcomes]) < 1.42
    assert POSE_BAND[0] < np.mean([outcome.nees_pose or 0.0 for outcome in outcomes]) < POSE_BAND[1]


@nightly.one_by_one(
    "drive",
    [("rtk", False), ("legacy", True), ("hector", True), ("rtk", True), ("rtk-dual", True)],
    in_suite=0,
)
def test_the_errors_of_the_pose_are_as_large_as_the_filter_says(
    drive: tuple[Receiver, bool],
) -> None:
    """Over the first four rows, with the levels of the dear receiver; by day m8n, above."""
    receiver, vision = drive
    what = scenario(receiver, vision=vision, speed_mps=0.8, variant="nominal")
    has_level = drive == ("rtk", False)
    outcomes = drive_four_rows(range(300, 350), what, has_level=has_level)
    if has_level:
        # The first rows are those that it knows least.
        assert_levels_are_kept(outcomes, rows=3, least_available=0.8)
    assert all(outcome.time_s == pytest.approx(FOUR_ROWS_S, abs=0.1) for outcome in outcomes)
    assert POSE_BAND[0] < np.mean([outcome.nees_pose or 0.0 for outcome in outcomes]) < POSE_BAND[1]


def test_a_speed_that_no_robot_drives_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "nav", "--speed", "3"]) == 2
    assert "--speed 3" in capsys.readouterr().err


def test_the_hard_variant_is_harder_in_what_the_camera_and_the_soil_do() -> None:
    easy, hard = (
        scenario("m8n", vision=True, speed_mps=0.8, variant=variant)
        for variant in ("nominal", "hard")
    )
    assert easy.vision is not None and hard.vision is not None
    assert hard.vision.offset_std_m > 2.0 * easy.vision.offset_std_m
    assert hard.soil.slip_max_ratio == 2.0 * easy.soil.slip_max_ratio


@nightly.one_by_one(
    "drive", [("rtk", False, FEW), ("rtk", False, ROWS), ("m8n", True, ROWS)], in_suite=1
)
def test_a_receiver_whose_velocity_is_far_noisier_than_it_says_strands_nobody(
    drive: tuple[Receiver, bool, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ten times as noisy as stated, and four times; it learns that before it drives."""
    receiver, has_vision, rows = drive
    lay_rows(monkeypatch, rows)
    liar = msgspec.structs.replace(
        RECEIVERS[receiver], velocity_std_mps=0.2 if has_vision else 0.3,
        velocity_stated_mps=RECEIVERS[receiver].velocity_std_mps,
    )  # fmt: skip
    monkeypatch.setitem(RECEIVERS, receiver, liar)
    what = scenario(receiver, vision=has_vision, speed_mps=0.8, variant="nominal")
    seeds = (20004, 20005, 20006, 20007, 20008, 20009)
    outcomes = run_missions(seeds, what, load_robot())
    assert all(outcome.success for outcome in outcomes)
    assert all(outcome.xte_rms_m < 0.03 for outcome in outcomes)


@nightly.one_by_one("drive", [("m8n", FEW), ("m8n", ROWS), ("rtk", ROWS)], in_suite=1)
def test_row_lines_far_noisier_than_they_state_leave_the_covariance_honest(
    drive: tuple[Receiver, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """4 cm and 2 degrees, stated 1.5 cm and 0.75 degrees; believed, they made NEES 7.3 and 4.7."""
    receiver, rows = drive
    lay_rows(monkeypatch, rows)
    camera = Vision(offset_std_m=0.04, heading_std_rad=math.radians(2.0), stated_ratio=0.375)
    what = scenario(receiver, vision=True, speed_mps=0.8, variant="nominal")
    what = msgspec.structs.replace(what, vision=camera)
    outcomes = run_missions(range(91000, 91006), what, load_robot())
    assert all(outcome.success and outcome.crushed == 0 for outcome in outcomes)
    assert statistics.mean(outcome.xte_rms_m for outcome in outcomes) < 0.04
    nees = [outcome.nees_pose for outcome in outcomes if outcome.nees_pose is not None]
    assert len(nees) == len(outcomes)
    assert statistics.mean(nees) < 4.0


def test_the_protection_level_is_held_against_the_truth_in_the_rows_alone() -> None:
    """Three robots at 0.5 m/s: in order, beyond its level, and misled; a fourth stands outside."""
    plant, judge = RoverFleet((1, 2, 3, 4), FIRM), LevelJudge(4, limit_m=0.3)
    plant.v_mps = np.full(4, 0.5)
    plant.y_m = np.zeros(4)
    row = np.array([0, 0, 0, -1])
    for tick in range(100):
        off_m = 0.0 if tick < 50 else 1.0
        believed_m = off_m * np.array([0.1, 0.2, 0.4, 9.0])
        judge.tick(plant, believed_m, np.array([0.15, 0.15, 0.2, 0.1]), row)
    fine, beyond, misled, outside = judge.outcomes()
    way_m = 100 * TICK_STEPS * DT_S * 0.5
    assert fine.row_m == pytest.approx(way_m)
    assert (fine.exceeded, fine.misled) == (0, 0)
    assert fine.available_m == pytest.approx(way_m)
    assert (beyond.exceeded, beyond.misled) == (1, 0)
    assert beyond.exceeded_m == pytest.approx(way_m / 2)
    assert (misled.exceeded, misled.misled) == (1, 1)
    assert (outside.row_m, outside.exceeded) == (0.0, 0)


def test_a_level_that_is_too_high_for_the_crop_allows_no_work() -> None:
    plant, judge = RoverFleet((1,), FIRM), LevelJudge(1, limit_m=0.3)
    plant.v_mps = np.full(1, 0.5)
    judge.tick(plant, plant.y_m, np.array([0.31]), np.zeros(1, dtype=int))
    (level,) = judge.outcomes()
    assert level.row_m > 0.0
    assert level.available_m == 0.0


@nightly.one_by_one("drives", [("rtk", False), ("m8n", True)], in_suite=0)
def test_the_error_is_beyond_its_level_no_more_often_than_promised(
    drives: tuple[Receiver, bool],
) -> None:
    """By day in the two tests above."""
    receiver, has_vision = drives
    what = scenario(receiver, vision=has_vision, speed_mps=0.8, variant="nominal")
    seeds = range(20000, 20250)
    assert_levels_are_kept(run_missions(seeds, what, load_robot(), has_level=True))


def test_missions_that_are_kept_are_not_driven_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    what = scenario("rtk", vision=False, speed_mps=0.8, variant="nominal")
    job = suite.chosen((1, 2, 3), load_robot(), what)
    driven: list[int] = []

    def drive_nothing(block: Job, stop: suite.Stop) -> tuple[Job, list[Outcome]]:
        driven.extend(block.seeds)
        return block, [make_outcome(seed) for seed in block.seeds]

    monkeypatch.setattr(suite, "drive", drive_nothing)
    path = tmp_path / "missions.jsonl"
    KeptMissions(path).add(job, [make_outcome(1), make_outcome(3)])
    with path.open("ab") as file:
        file.write(b'{"version": "0')  # the program was killed while it wrote
    seen: list[int] = []
    ((line, outcomes),) = suite.drive_all([job], 1, lambda: False, seen.extend, KeptMissions(path))
    assert driven == [2] and sorted(seen) == [1, 2, 3]
    assert [outcome.seed for outcome in outcomes] == [1, 2, 3] and line.missions == 3
    assert sorted(KeptMissions(path).find(job)) == [1, 2, 3]
    other = msgspec.structs.replace(job, scenario=msgspec.structs.replace(what, speed_mps=0.5))
    assert not KeptMissions(path).find(other)
    assert not KeptMissions(path).find(msgspec.structs.replace(job, has_level=True))


def test_a_file_that_holds_no_missions_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "missions.jsonl"
    path.write_text("seed,success\n1,true\n")
    with pytest.raises(ConfigError, match="line 1 holds no missions"):
        KeptMissions(path)


def make_outcome(seed: int) -> Outcome:
    return Outcome(
        seed=seed, success=True, finished=True, rows_ok=ROWS, xte_rms_m=0.01, xte_p95_m=0.02,
        xte_max_m=0.03, crushed=0, time_s=300.0, nees=1.0, nees_pose=3.0, paused_s=0.0,
    )  # fmt: skip
