"""Field plans in the simulator: driven to the end, and never out of the field."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import shapely

from agribot.app.mission_file import continue_config, read_mission
from agribot.app.simulated_run import simulate
from agribot.autonomy.plan.coverage.plan_sweep import sweep_footprint
from agribot.autonomy.plan.ways.footprint import measure_footprint
from agribot.cli.main import main
from agribot.core.config import RunConfig, load
from agribot.core.facts import ReturnedHome
from agribot.core.geo import Datum, MapFrame
from agribot.core.messages import ControlMission
from agribot.description.loader import load_robot
from agribot.gis.plan_file import read_plan
from agribot.record.replay import read_truth
from tests import nightly

DATUM = Datum(lat_deg=21.161289, lon_deg=72.787022)  # of the farm profile
OUTLINE = ((-1.5, -1.5), (3.9, -1.5), (4.3, 3.4), (-1.5, 3.0))
HOLE = ((1.2, 0.8), (1.7, 0.8), (1.7, 1.3), (1.2, 1.2))
ROOMY = (((-2.0, -2.4), (2.9, -2.4), (2.9, 2.4), (-2.0, 2.4)),)
EMPTY = ["perception.enabled=false", 'world="empty"', "field.start_map_m=[0,0]",
         'sim.sensors="rtk"']  # fmt: skip
BRISK = ["mission.speed_mps=0.8", "mission.turn_speed_mps=0.5"]  # twice as fast as usual


def field_file(
    folder: Path, outlines: tuple[tuple[tuple[float, float], ...], ...] = (OUTLINE, HOLE)
) -> Path:
    frame = MapFrame(DATUM)
    rings = []
    for ring in outlines:
        places = [frame.geodetic_from_map(*point) for point in (*ring, ring[0])]
        rings.append([[lon_deg, lat_deg] for lat_deg, lon_deg, _ in places])
    path = folder / "field.geojson"
    path.write_text(json.dumps({"type": "Polygon", "coordinates": rings}))
    return path


def settings(*more: str) -> list[str]:
    return [part for setting in (*EMPTY, *more) for part in ("--set", setting)]


@pytest.mark.figures
@nightly.by_day(
    "tests/mission/test_unmapped_field.py::"
    "test_many_rows_are_counted_once_each_with_any_receiver_and_driven_again_from_elsewhere",
    "tests/autonomy/plan/test_plan_certificate.py::"
    "test_a_way_through_a_hole_is_refused_at_the_hole",
    "tests/autonomy/plan/test_plan_certificate.py::"
    "test_a_corner_of_the_robot_that_clips_a_hole_counts",
    "tests/app/test_operator_sends.py::"
    "test_another_plan_replaces_the_mission_and_is_judged_in_its_place",
)
def test_a_field_with_a_hole_is_worked_without_leaving_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    wanted = ["run", "farm", "--field", str(field_file(tmp_path)), "--out", str(out), "--json"]
    assert main([*wanted, *settings(*BRISK)]) == 0
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert report["ok"] is True
    assert report["mission"]["rows_done"] == report["mission"]["rows_total"] > 10
    assert report["mission"]["coverage_ratio"] > 0.95
    saved = read_plan(out / "plan.geojson", DATUM)
    shape = measure_footprint(load_robot("agribot"), saved.request.implement_width_m)
    field = shapely.Polygon(saved.area.boundary, saved.area.holes)
    truth = read_truth(out / "run.mcap")
    ahead = np.column_stack([np.cos(truth[:, 3]), np.sin(truth[:, 3])]) * 1e-6
    boxes = [sweep_footprint(np.array([place, place + step]), shape, None, None)[0]
             for place, step in zip(truth[:, 1:3], ahead, strict=True)]  # fmt: skip
    assert np.all(shapely.covers(field, shapely.polygons(np.array(boxes))))
    assert main(["replay", str(out / "run.mcap")]) == 0


@pytest.mark.figures
@nightly.by_day(
    "tests/mission/test_one_job.py::test_time_distance_rows_and_errors_are_those_of_the_whole_job",
    "tests/mission/test_one_job.py::"
    "test_a_run_that_went_on_replays_bit_by_bit_with_the_map_it_took_over",
    "tests/autonomy/plan/test_mission_resume.py::"
    "test_after_a_crash_the_work_goes_on_at_the_same_place",
)
def test_a_run_that_was_killed_goes_on_from_its_folder(tmp_path: Path) -> None:
    config = load("farm", [*EMPTY, 'world="Farm"', "field.start_map_m=[-2,0]", "field.row_count=1"])
    with simulate(config, tmp_path / "first") as session:
        for record in session.ticks():
            if record.batch.t_s > 22.0:
                break  # no finish: the computer lost its power
    saved = read_mission(tmp_path / "first")
    assert saved.state == "running"
    assert saved.s_m > 3.0
    config = load(str(tmp_path / "first" / "config.toml"))
    assert isinstance(config, RunConfig)
    with simulate(continue_config(config, saved), tmp_path / "second", saved) as session:
        first = next(record for record in session.ticks() if record.status.state == "running")
        assert first.status.s_m == pytest.approx(saved.s_m, abs=0.3)
        for _ in session.ticks():
            pass
        report = session.finish()
    assert report.ok, report.reason
    assert report.mission.rows_done == 1
    assert main(["replay", str(tmp_path / "second" / "run.mcap")]) == 0


@nightly.by_day(
    "tests/autonomy/plan/test_mission_resume.py::"
    "test_it_returns_home_around_the_crop_with_the_tool_off",
    "tests/autonomy/plan/test_mission_errands.py::"
    "test_the_way_home_is_planned_from_where_the_robot_comes_to_rest",
)
def test_called_home_it_comes_back_to_where_it_began(tmp_path: Path) -> None:
    farm = ['world="Farm"', "field.start_map_m=[-2,0]", "record.enabled=false"]
    config = load("farm", [*EMPTY, *farm])
    with simulate(config, tmp_path / "run") as session:
        ticks = session.ticks()
        next(record for record in ticks if record.status.row == 0 and record.batch.t_s > 20.0)
        session.inbox.post(ControlMission(action="return_home"))
        for _ in ticks:
            pass
        last = session.last
        report = session.finish()
        truth = session.simulator.truth()
    assert last is not None and last.status.state == "cancelled"
    assert (truth.x_map_m, truth.y_map_m) == pytest.approx((-2.0, 0.0), abs=0.15)
    assert report.tracking.plants_crushed == 0
    assert isinstance(last.status.fact, ReturnedHome)


@nightly.by_day(
    "tests/autonomy/plan/test_turn_styles.py::test_every_style_of_turn_is_certified",
    "tests/autonomy/control/test_follower.py::"
    "test_a_three_point_turn_is_driven_forwards_back_and_forwards",
)
@pytest.mark.parametrize("style", ["pivot", "arc", "three-point"])
def test_every_style_of_turn_is_planned_and_driven(tmp_path: Path, style: str) -> None:
    plan = tmp_path / "plan.geojson"
    field = str(field_file(tmp_path, ROOMY))
    wanted = ["plan", "--field", field, "--implement-width", "0.9", "--swath-angle", "90"]
    wanted += ["--headland-passes", "2", "--turns", style, "--out", str(plan)]
    assert main(wanted) == 0
    kinds = [leg.kind for leg in read_plan(plan, DATUM).plan.legs]
    assert ("reverse" in kinds) == (style == "three-point")
    assert ("arc" in kinds) == (style != "pivot")
    config = load("farm", [*EMPTY, *BRISK, f"plan={json.dumps(str(plan))}", "record.enabled=false"])
    speeds = []
    with simulate(config, tmp_path / "run") as session:
        for record in session.ticks():
            speeds.append(record.estimate.v_mps)
        report = session.finish()
    assert report.ok, report.reason
    assert report.mission.rows_done == report.mission.rows_total
    assert (min(speeds) < -0.1) == (style == "three-point")
    assert report.tracking.xte_max_m is not None and report.tracking.xte_max_m < 0.1
