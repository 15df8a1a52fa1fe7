"""The benchmark judges honestly: its plant follows physics, its seeds stand alone."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from agribot.cli.main import main
from agribot.core.errors import AgribotError, ConfigError
from agribot.core.geo import MapFrame
from agribot.core.messages import GnssFix
from agribot.core.pose import Pose2
from agribot.description.loader import load_robot
from agribot.lab.bench.nav import suite
from agribot.lab.bench.nav.job import Job
from agribot.lab.bench.nav.judge import LevelJudge, MissionJudge, Outcome
from agribot.lab.bench.nav.kept import KeptMissions
from agribot.lab.bench.nav.missions import Stop, run_mission
from agribot.lab.bench.nav.original import OriginalController
from agribot.lab.bench.nav.plant import SoilRover
from agribot.lab.bench.nav.row_camera import RowCamera
from agribot.lab.bench.nav.scenario import (
    DT_S,
    HEADLAND_M,
    ROWS,
    TICK_S,
    TICK_STEPS,
    Scenario,
    SoilDrift,
    Vision,
    make_scenario,
)
from agribot.lab.bench.nav.sensors import Sensors
from agribot.lab.sweep.ray_cluster import NodeResult
from tests import nightly

FIRM = SoilDrift(
    slip_max_ratio=0.0, slip_std_ratio=0.0, yaw_gain_std_ratio=0.0, yaw_gain_walk_ratio=0.0,
    yaw_rate_std_radps=0.0, slope_max_rad=0.0, lateral_std_mps=0.0, turn_centre_std_m=0.0,
)  # fmt: skip
SEEDS = range(20000, 20004)
ONE_ROW = ("--rows", "1", "--workers", "1", "--json")


def drive(rover: SoilRover, v_mps: float, yaw_rate_radps: float, seconds: float) -> None:
    for _ in range(round(seconds / DT_S)):
        rover.step(v_mps, yaw_rate_radps)


def plan(sensors: str, *, vision: bool, rows: int) -> Scenario:
    return msgspec.structs.replace(make_scenario(sensors, vision=vision), rows=rows)


def bench(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, dict[str, Any]]:
    """Run the command; its status and what it printed as JSON."""
    status = main(["bench", "nav", *words])
    printed: dict[str, Any] = json.loads(capsys.readouterr().out.strip().splitlines()[-1])
    return status, printed


def test_on_firm_ground_the_plant_drives_what_it_is_told_after_lag_and_dead_time() -> None:
    rover = SoilRover(1, FIRM)
    start_m = rover.x_m
    drive(rover, 0.5, 0.0, 10.0)
    way_m = (rover.x_m - start_m) / math.cos(rover.yaw_rad)
    # 10 s less the dead time and the lag, and a little more for the limited acceleration.
    assert way_m == pytest.approx(0.5 * (10.0 - 0.05 - 0.15), abs=0.06)


def test_soil_takes_a_share_of_the_way_and_disturbs_nobody_who_stands() -> None:
    rovers = [SoilRover(seed, SoilDrift()) for seed in range(40)]
    places = [(rover.x_m, rover.y_m, rover.yaw_rad) for rover in rovers]
    for rover in rovers:
        drive(rover, 0.0, 0.0, 1.0)
    assert [(rover.x_m, rover.y_m, rover.yaw_rad) for rover in rovers] == places
    for rover in rovers:
        drive(rover, 0.5, 0.0, 4.0)
    shares = [(r.x_m - x_m) / 2.0 for r, (x_m, _, _) in zip(rovers, places, strict=True)]
    assert 0.84 < np.mean(shares) < 0.96  # the drive's lag takes a tenth of a second of four


def test_wheels_and_gyro_tell_the_motion_of_the_rover() -> None:
    what, robot = plan("ideal", vision=False, rows=1), load_robot()
    rover, sensors = SoilRover(3, FIRM), Sensors(what.config(3), robot)
    yaw_rad = rover.yaw_rad
    turned_rad = driven_m = 0.0
    last = (0.0, 0.0, 0.0, 0.0)
    for _ in range(200):
        for _ in range(TICK_STEPS):
            rover.step(0.4, 0.3)
            sensors.step(rover)
        batch = sensors.read()
        turned_rad += sum(sample.gyro_radps[2] * DT_S for sample in batch.imu)
        for sample in batch.wheels:
            driven_m += (sum(sample.angle_rad) - sum(last)) / 4.0
            last = sample.angle_rad
    assert turned_rad == pytest.approx(rover.yaw_rad - yaw_rad, abs=1e-6)
    assert driven_m * robot.drive.wheel_radius_m == pytest.approx(0.4 * (4.0 - 0.2), abs=0.06)
    right_rad, left_rad, *_ = last
    aside_m = (right_rad - left_rad) * robot.drive.wheel_radius_m
    assert aside_m / robot.drive.effective_separation_m == pytest.approx(turned_rad, abs=1e-6)


def test_the_fixes_of_a_preset_are_those_of_the_antenna_of_its_rover_and_come_late() -> None:
    robot, config = load_robot(), plan("rtk-1", vision=False, rows=1).config(1)
    rover, sensors = SoilRover(1, SoilDrift()), Sensors(config, robot)
    came: list[tuple[float, GnssFix]] = []
    for k in range(1, 41):
        rover.step(0.0, 0.0)
        sensors.step(rover)
        if k % TICK_STEPS == 0:
            batch = sensors.read()
            assert batch.mag == ()
            came += [(batch.t_s, fix) for fix in batch.gnss]
    assert [at_s for at_s, _ in came] == pytest.approx([0.2, 0.3, 0.4])
    assert [fix.t_s for _, fix in came] == pytest.approx([0.1, 0.2, 0.3])
    fix = came[-1][1]
    frame, lever_m = MapFrame(config.field.datum), robot.body_from_link(robot.gnss.link)[:2, 3]
    seen_m = frame.map_from_geodetic(fix.lat_deg, fix.lon_deg, fix.alt_m)
    expected_m = Pose2(-HEADLAND_M, rover.y_m, rover.yaw_rad).transform(*lever_m.tolist())
    assert math.dist(seen_m[:2], expected_m) < 0.05


@pytest.mark.parametrize(
    ("yaw_rad", "offset_m", "heading_rad"), [(0.1, 0.1, 0.1), (math.pi, -0.1, 0.0)]
)
def test_the_camera_sees_the_offset_of_the_nearest_row(
    yaw_rad: float, offset_m: float, heading_rad: float
) -> None:
    rover, camera = look_from(2.1, yaw_rad)
    line = camera.sample(0.0, rover)
    assert line is not None
    assert line.offset_m == pytest.approx(offset_m, abs=1e-4)
    assert line.heading_rad == pytest.approx(heading_rad, abs=1e-4)


@pytest.mark.parametrize(("y_m", "yaw_deg"), [(2.1, 40.0), (2.48, 0.0), (-0.8, 0.0)])
def test_the_camera_sees_nothing_at_a_slant_and_between_and_beside_the_rows(
    y_m: float, yaw_deg: float
) -> None:
    rover, camera = look_from(y_m, math.radians(yaw_deg))
    assert camera.sample(0.0, rover) is None


def look_from(y_m: float, yaw_rad: float) -> tuple[SoilRover, RowCamera]:
    """A rover in the middle of the rows with a camera without errors."""
    sharp = Vision(
        offset_std_m=1e-6, heading_std_rad=1e-6, heading_wander_rad=0.0, outlier_ratio=0.0,
        dropout_every_s=1e9,
    )  # fmt: skip
    rover = SoilRover(1, FIRM)
    rover.x_m, rover.y_m, rover.yaw_rad = 5.0, y_m, yaw_rad
    return rover, RowCamera(1, make_scenario("m8n", vision=True), sharp)


def test_the_judge_counts_plants_under_the_wheels_and_rows_left_out() -> None:
    rover, judge = SoilRover(1, FIRM), MissionJudge(ROWS)
    rover.y_m, rover.yaw_rad = 0.39, 0.0  # its right wheels stand on the row
    for x_m in np.arange(0.0, 12.0, 0.02):
        rover.x_m = float(x_m)
        judge.tick(rover, 0, tool_on=True)
    outcome = judge.outcome(1, is_done=True)
    assert outcome.crushed == 49
    assert outcome.xte_max_m == pytest.approx(0.39)
    assert outcome.time_s == pytest.approx(600 * TICK_S)
    assert outcome.rows_ok == 0 and not outcome.success


def test_a_row_in_its_limits_under_the_working_tool_counts_and_one_with_the_tool_off_does_not() -> (
    None
):
    for tool_on in (True, False):
        rover, judge = SoilRover(1, FIRM), MissionJudge(1)
        rover.y_m, rover.yaw_rad = 0.05, 0.0
        for x_m in np.arange(0.0, 12.0, 0.02):
            rover.x_m = float(x_m)
            judge.tick(rover, 0, tool_on=tool_on)
        outcome = judge.outcome(1, is_done=True)
        assert outcome.success == tool_on and outcome.crushed == 0
        assert outcome.xte_p95_m == pytest.approx(0.05)


def test_the_original_controller_turns_on_the_spot_and_stops_a_metre_short() -> None:
    frame = MapFrame(make_scenario("m8n", vision=False).config(1).field.datum)
    aside, near = OriginalController(ROWS, frame), OriginalController(ROWS, frame)
    for _ in range(7):
        aside.update_compass(90.0)
        near.update_compass(0.0)
    for _ in range(2):  # the first fix also sees the jump of the angle
        aside.update_fix(-1.0, 0.0)
        near.update_fix(12.2, 0.5)
    assert (aside.v_mps, near.v_mps) == (0.0, 0.0)
    assert aside.yaw_rate_radps == pytest.approx(-0.5)
    assert near.waypoint == 3  # the next row's end lies within a metre, too


def test_the_command_reports_what_it_measured_and_drives_it_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("--sensors", "rtk-1", "--no-vision", "--seeds", "20000", "--out", str(tmp_path))
    status, printed = bench(capsys, *words, *ONE_ROW)
    (entry,) = printed["lines"]
    assert status == 0
    assert entry["missions_ok"] == entry["missions"] == 1
    assert entry["plants"] == 49 and entry["crushed"] == 0
    assert 0.002 < entry["xte_rms_m"] < 0.04
    assert entry["nees_lateral"] < 6.0
    assert entry["level"]["row_km"] == pytest.approx(0.012, rel=0.1)
    assert printed["cpu_s"] == entry["cpu_s"] > 0.0
    again, kept = bench(capsys, *words, *ONE_ROW)
    assert again == 0 and kept == printed, "the CPU time too: nothing was driven again"
    assert json.loads((tmp_path / "nav.json").read_text()) == printed
    assert "| rtk-1, 0.8 m/s, nominal, 1 rows | 1 of 1 |" in (tmp_path / "nav.md").read_text()


@pytest.mark.parametrize(
    ("words", "refusal"),
    [
        (("--speed", "3"), "--speed 3"),
        (("--rows", "0"), "--rows 0"),
        (("--sensors", "m8m"), "m8n"),
        (("--set", "field.row_count=3"), "control, estimate, mission"),
        (("--set", "mission.headland_m=-1"), "headland_m"),
        (("--sensors", "rtk-1", "--baseline"), "--baseline: the original robot needs a magneto"),
    ],
)
def test_what_cannot_be_driven_is_refused_before_anything_drives(
    words: Sequence[str], refusal: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bench", "nav", "--seeds", "1", *words]) == 2
    assert refusal in capsys.readouterr().err


def test_a_setting_of_the_robot_changes_the_drive() -> None:
    what = plan("ideal", vision=False, rows=1)
    slow = msgspec.structs.replace(what, settings=("mission.speed_mps=0.4",))
    quick, late = (run_mission(1, each, load_robot()).time_s for each in (what, slow))
    assert late > quick + 10.0  # 12 m of row


def test_the_hard_variant_is_harder_in_what_the_camera_and_the_soil_do() -> None:
    easy, hard = (
        make_scenario("m8n", vision=True, variant=variant) for variant in ("nominal", "hard")
    )
    assert easy.vision is not None and hard.vision is not None
    assert hard.vision.offset_std_m > 2.0 * easy.vision.offset_std_m
    assert hard.soil.slip_max_ratio == 2.0 * easy.soil.slip_max_ratio


def drive_seeds(
    sensors: str, *, vision: bool, rows: int, seeds: Sequence[int] = SEEDS
) -> list[Outcome]:
    what, robot = plan(sensors, vision=vision, rows=rows), load_robot()
    return [run_mission(seed, what, robot) for seed in seeds]


def assert_levels_are_kept(outcomes: list[Outcome], rows: int, least_available: float) -> None:
    """No error was beyond its level more often than promised, and work was allowed."""
    levels = [outcome.level for outcome in outcomes if outcome.level is not None]
    row_m = sum(level.row_m for level in levels)
    assert row_m > 0.9 * len(outcomes) * rows * 12.0
    assert sum(level.exceeded_m for level in levels) <= 5e-3 * row_m
    assert sum(level.misled for level in levels) == 0
    assert sum(level.available_m for level in levels) > least_available * row_m


@nightly.by_day(
    "test_the_command_reports_what_it_measured_and_drives_it_once",
    "test_the_protection_level_is_held_against_the_truth_in_the_rows_alone",
)
@pytest.mark.parametrize(
    ("sensors", "vision"),
    [
        ("rtk", False), ("rtk", True), ("rtk-dual", True), ("rtk-1", False), ("m8n", True),
        ("m8n-1", True), ("m8n-urban", True), ("legacy", True), ("seed", True),
    ],
)  # fmt: skip
def test_four_rows_are_driven_and_the_filter_knows_how_wrong_it_is(
    sensors: str, vision: bool
) -> None:
    outcomes = drive_seeds(sensors, vision=vision, rows=4)
    assert all(outcome.success and outcome.crushed == 0 for outcome in outcomes)
    assert_levels_are_kept(outcomes, rows=4, least_available=0.8)
    # Errors of one drive last, so that each mission counts as one squared normal error.
    low, high = nightly.mean_square_band(len(outcomes), 3, 0.999)
    poses = [outcome.nees_pose for outcome in outcomes if outcome.nees_pose is not None]
    assert low / 3 < np.mean(poses) / 3 < high / 3


@nightly.by_day(
    "test_the_command_reports_what_it_measured_and_drives_it_once",
    "tests/autonomy/plan/test_caution.py::"
    "test_far_above_the_limit_it_stands_at_once_unless_a_person_bids_it_creep_on",
)
@pytest.mark.parametrize("sensors", ["m8n-urban", "m8n-1"])
def test_without_a_camera_a_cheap_receiver_stands_before_it_crushes_the_crop(sensors: str) -> None:
    (outcome,) = drive_seeds(sensors, vision=False, rows=ROWS, seeds=(20000,))
    assert not outcome.finished and outcome.reason
    assert outcome.crushed == 0


@nightly.by_day("test_the_command_reports_what_it_measured_and_drives_it_once")
@pytest.mark.parametrize("sensors", ["m8n", "rtk"])
def test_row_lines_far_noisier_than_they_state_leave_the_covariance_honest(sensors: str) -> None:
    """4 cm and 2 degrees, stated 1.5 cm and 0.75 degrees."""
    camera = Vision(offset_std_m=0.04, heading_std_rad=math.radians(2.0), stated_ratio=0.375)
    what = msgspec.structs.replace(plan(sensors, vision=True, rows=4), vision=camera)
    outcomes = [run_mission(seed, what, load_robot()) for seed in range(91000, 91006)]
    assert all(outcome.success and outcome.crushed == 0 for outcome in outcomes)
    assert np.mean([outcome.xte_rms_m for outcome in outcomes]) < 0.04
    assert np.mean([outcome.nees_pose or 0.0 for outcome in outcomes]) < 4.0


def test_the_protection_level_is_held_against_the_truth_in_the_rows_alone() -> None:
    """Three robots at 0.5 m/s: in order, beyond its level, and misled; a fourth stands outside."""
    rover, judges = SoilRover(1, FIRM), [LevelJudge(limit_m=0.3) for _ in range(4)]
    rover.v_mps, rover.y_m = 0.5, 0.0
    for tick in range(100):
        off_m = 0.0 if tick < 50 else 1.0
        for judge, ratio, level_m, row in zip(
            judges, (0.1, 0.2, 0.4, 9.0), (0.15, 0.15, 0.2, 0.1), (0, 0, 0, -1), strict=True
        ):
            judge.tick(rover, off_m * ratio, level_m, row)
    fine, beyond, misled, outside = (judge.outcome() for judge in judges)
    way_m = 100 * TICK_STEPS * DT_S * 0.5
    assert fine.row_m == pytest.approx(way_m)
    assert (fine.exceeded, fine.misled) == (0, 0)
    assert fine.available_m == pytest.approx(way_m)
    assert (beyond.exceeded, beyond.misled) == (1, 0)
    assert beyond.exceeded_m == pytest.approx(way_m / 2)
    assert (misled.exceeded, misled.misled) == (1, 1)
    assert (outside.row_m, outside.exceeded) == (0.0, 0)


def test_a_level_that_is_too_high_for_the_crop_allows_no_work() -> None:
    rover, judge = SoilRover(1, FIRM), LevelJudge(limit_m=0.3)
    rover.v_mps = 0.5
    judge.tick(rover, rover.y_m, 0.31, 0)
    level = judge.outcome()
    assert level.row_m > 0.0
    assert level.available_m == 0.0


def execute_nothing(driven: list[int]) -> suite.Executor:
    def execute(jobs: Sequence[Job], stop: Stop) -> Iterator[tuple[Job, Outcome]]:
        for job in jobs:
            driven.extend(job.seeds)
            yield job, make_outcome(job.seeds[0])

    return execute


def test_missions_that_are_kept_are_not_driven_again(tmp_path: Path) -> None:
    job = suite.choose((1, 2, 3), load_robot(), make_scenario("rtk", vision=False))
    path = tmp_path / "missions.jsonl"
    KeptMissions(path).add(job, [make_outcome(1), make_outcome(3)])
    with path.open("ab") as file:
        file.write(b'{"program": "0')  # the program was killed while it wrote
    driven: list[int] = []
    counts: list[int] = []
    ((line, outcomes),) = suite.drive_all(
        [job], execute_nothing(driven), lambda: False, counts.append, KeptMissions(path)
    )
    assert driven == [2] and counts == [2, 3]
    assert [outcome.seed for outcome in outcomes] == [1, 2, 3] and line.missions == 3
    assert sorted(KeptMissions(path).find(job)) == [1, 2, 3]
    other = msgspec.structs.replace(job.scenario, speed_mps=0.5)
    assert not KeptMissions(path).find(msgspec.structs.replace(job, scenario=other))


def test_a_stop_keeps_what_is_finished_and_gives_no_line_of_a_part(tmp_path: Path) -> None:
    job = suite.choose((1, 2, 3), load_robot(), make_scenario("rtk", vision=False))
    kept, counts = KeptMissions(tmp_path / "missions.jsonl"), list[int]()
    lines = suite.drive_all(
        [job], execute_nothing([]), lambda: len(counts) > 2, counts.append, kept
    )
    assert list(lines) == []
    assert sorted(kept.find(job)) == [1, 2]


def test_missions_that_another_program_drove_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "missions.jsonl"
    job = suite.choose((1,), load_robot(), make_scenario("rtk", vision=False))
    KeptMissions(path).add(job, [make_outcome(1)])
    content = path.read_text()
    block = json.loads(content)
    path.write_text(content.replace(block["program"], "0123456789ab"))
    with pytest.raises(ConfigError, match="driven by the program 0123456789ab"):
        KeptMissions(path)


def test_a_file_that_holds_no_missions_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "missions.jsonl"
    path.write_text("seed,success\n1,true\n")
    with pytest.raises(ConfigError, match="line 1 holds no missions"):
        KeptMissions(path)


class Cluster:
    """Two nodes; one fails with seed 2."""

    def results(
        self, work: object, jobs: Sequence[Job], stop: Stop
    ) -> Iterator[NodeResult[Job, tuple[Job, Outcome]]]:
        assert work is suite.drive
        for job in jobs:
            is_lost = job.seeds == (2,)
            answer = None if is_lost else (job, make_outcome(job.seeds[0]))
            yield NodeResult(job, answer, "its node failed: out of memory" if is_lost else "")


def test_a_cluster_drives_the_missions_and_a_node_that_fails_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(suite, "RayCluster", lambda address: Cluster())
    good = suite.choose((1, 3), load_robot(), make_scenario("rtk", vision=False))
    execute = suite.use_cluster("auto")
    ((line, _),) = suite.drive_all([good], execute, lambda: False, lambda _: None)
    assert line.missions_ok == 2
    bad = msgspec.structs.replace(good, seeds=(1, 2))
    with pytest.raises(AgribotError, match="seed 2: its node failed: out of memory"):
        list(suite.drive_all([bad], execute, lambda: False, lambda _: None))


def make_outcome(seed: int) -> Outcome:
    return Outcome(
        seed=seed, success=True, finished=True, rows_ok=ROWS, xte_rms_m=0.01, xte_p95_m=0.02,
        xte_max_m=0.03, crushed=0, time_s=300.0, nees=1.0, nees_pose=3.0, paused_s=0.0,
    )  # fmt: skip
