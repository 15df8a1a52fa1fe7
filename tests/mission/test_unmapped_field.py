"""An unmapped field: found, counted, driven, drawn, and driven again from the drawing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np
import pytest

from agribot.app.field_work import plan_field_file
from agribot.app.simulated_run import SimulatedRun, simulate
from agribot.autonomy.plan.ways.rows import lay_rows
from agribot.core.config import RunConfig, load
from agribot.core.facts import NoRowInView, RowOutOfView
from agribot.core.messages import FloatArray, Row
from agribot.core.world import WorldSpec
from agribot.description.field_generator import generate_field
from agribot.description.field_settings import CropSettings, FieldSettings, RowsSettings
from agribot.description.loader import load_robot
from agribot.gis.plan_file import format_plan
from agribot.record.report import Report
from tests import nightly
from tests.mission.paper_camera import CameraOnPaper

Start = tuple[float, float, float]  # East, North, heading in degrees
SETTINGS = ["seed=1", 'sim.sensors="rtk"', "perception.enabled=false", "record.enabled=false",
            "field.row_length_m=5.0", "field.row_count=3"]  # fmt: skip
BRISK = ["mission.speed_mps=0.8", "mission.turn_speed_mps=0.5"]  # twice as fast as usual
# How far the distance of neighbours is off, at their middles and at their ends, 1 sigma, m: of 76
# distances with m8n and 16 with rtk, seeds 1 to 10.
APART_STD_M = {"m8n": (0.023, 0.055), "rtk": (0.008, 0.010)}
BEFORE, BESIDE, ELSEWHERE = (-2.4, -1.3, 8.0), (2.5, -5.0, 80.0), (7.2, 1.2, 180.0)


def drive(
    start: Start, out: Path, patch: pytest.MonkeyPatch, *settings: str, plan: str = "",
    seen_rows: tuple[Row, ...] | None = None,
) -> tuple[SimulatedRun, Report]:  # fmt: skip
    """Drive a mission that begins at a place; `seen_rows` are those that the camera can see."""

    def place(settings: RunConfig) -> WorldSpec:
        field = settings.field
        rows = RowsSettings(
            count=field.row_count,
            length_m=field.row_length_m,
            pitch_m=field.row_pitch_m,
            first_row_start_map_m=field.first_row_start_map_m,
            yaw_deg=field.row_yaw_deg,
        )
        world = generate_field(
            FieldSettings(rows=rows, crop=CropSettings(stem_radius_m=0.05)), settings.seed
        )
        at = {"spawn_xy_map_m": start[:2], "spawn_yaw_map_rad": math.radians(start[2])}
        return msgspec.structs.replace(world, **at)

    patch.setattr("agribot.app.run_world.load_run_world", place)
    mark = [f"field.start_map_m=[{start[0]},{start[1]}]", f"field.start_yaw_deg={start[2]}"]
    config = load("rows-10x12", [*SETTINGS, *mark, *settings])
    with simulate(config, out, plan_text=plan) as session:
        rows = lay_rows(config.field) if seen_rows is None else seen_rows
        session.stack.perception = CameraOnPaper(session, rows, has_cover=True)
        for _ in session.ticks():
            pass
        return session, session.finish()


def drive_again(
    first: SimulatedRun, folder: Path, patch: pytest.MonkeyPatch, *settings: str
) -> Report:
    """Drive what the first run drew in its folder, put down on the other side of the field."""
    drawn = folder / "field.geojson"
    saved, certificate = plan_field_file(drawn, first.config, load_robot("agribot"), None)
    assert certificate.ok
    plan = format_plan(saved, certificate)
    return drive(ELSEWHERE, folder / "again", patch, *settings, plan=plan)[1]


def normalise_distances(rows: Sequence[Row], sensors: str) -> tuple[FloatArray, FloatArray]:
    """Errors of the distances of neighbours, of one metre each, in sigmas: middles and ends."""
    y_m = np.array([(row.start_map_m[1], row.end_map_m[1]) for row in rows])
    off_m = np.abs(np.diff(y_m, axis=0)) - 1.0
    middle_std_m, end_std_m = APART_STD_M[sensors]
    return off_m.mean(axis=1) / middle_std_m, off_m.ravel() / end_std_m


@nightly.by_day(
    "test_many_rows_are_counted_once_each_with_any_receiver_and_driven_again_from_elsewhere",
    "tests/autonomy/plan/test_found_rows.py::"
    "test_the_first_row_is_the_line_on_which_plants_stand_close",
    "tests/autonomy/plan/test_found_rows.py::test_a_row_reaches_from_its_first_to_its_last_plant",
)
@pytest.mark.parametrize("start", [BEFORE, BESIDE], ids=["before a row's end", "beside a row"])
def test_rows_that_nobody_mapped_are_found_and_driven_again_from_their_drawing(
    start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session, report = drive(start, tmp_path / "first", monkeypatch, *BRISK, 'task="explore"')
    assert report.ok, report.reason
    found = report.found_rows
    assert found is not None
    assert found.found == found.true == found.matched == report.mission.rows_done == 3
    assert found.offset_m_max is not None and found.offset_m_max < 0.03
    assert found.end_error_m_max is not None and found.end_error_m_max < 0.3
    assert report.tracking.xte_max_m is not None and report.tracking.xte_max_m < 0.1
    second = drive_again(session, tmp_path / "first", monkeypatch, *BRISK)
    assert second.ok, second.reason
    assert second.mission.rows_done == 3
    assert report.tracking.plants_crushed == second.tracking.plants_crushed == 0


@nightly.all_or_first(
    "cases",
    [
        ("m8n", 1, 2),
        ("m8n", 1, 5),
        *((sensors, seed, 10) for seed in range(1, 11) for sensors in ("m8n", "rtk")),
    ],
    in_suite=1,
    unit="drives",
)
def test_many_rows_are_counted_once_each_with_any_receiver_and_driven_again_from_elsewhere(
    cases: Sequence[tuple[str, int, int]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    off = []
    for sensors, seed, rows in cases:
        settings = [f"seed={seed}", f'sim.sensors="{sensors}"', f"field.row_count={rows}",
                    "mission.speed_mps=1.0"]  # fmt: skip
        out = tmp_path / f"{sensors}-{seed}-{rows}"
        session, report = drive(BEFORE, out, monkeypatch, *settings, 'task="explore"')
        assert report.ok, (sensors, seed, report.reason)
        found = report.found_rows
        assert found is not None and found.invented == 0
        assert found.found == found.true == found.matched == report.mission.rows_done == rows
        off += [normalise_distances(session.task.rows, sensors)]
        second = drive_again(session, out, monkeypatch, *settings)
        assert second.ok and second.mission.rows_done == rows, (sensors, seed, second.reason)
        assert second.tracking.plants_total == 21 * rows and second.safety.outside_m_max == 0.0
        assert report.tracking.plants_crushed == second.tracking.plants_crushed == 0
    # Side by side as they stand; their ends have what the receiver drifts along a row.
    middles, ends = (np.concatenate(each) for each in zip(*off, strict=True))
    for sigmas in (middles, ends):
        assert np.abs(sigmas).max() < 4.5
        assert np.mean(sigmas**2) < nightly.mean_square_band(len(sigmas), share=0.998)[1]


@pytest.mark.figures
def test_a_robot_that_sees_no_row_stops_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = ('task="explore"', "mission.speed_mps=1.0")
    session, report = drive(BEFORE, tmp_path / "run", monkeypatch, *settings, seen_rows=())
    assert not report.ok
    assert session.last is not None and session.last.status.fact == NoRowInView(8.0)
    assert not (tmp_path / "run" / "field.geojson").exists()


def test_a_camera_that_goes_blind_in_a_row_ends_the_drive_with_what_it_had_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The robot never drives farther than the crop that it saw, and the headland behind it."""
    first = lay_rows(load("rows-10x12", SETTINGS).field)[0]
    blind = tmp_path / "run"

    def see_to_3_m(self: CameraOnPaper, t_s: float) -> bool:
        return self._session.simulator.truth().x_map_m < 3.0

    step = CameraOnPaper.step
    monkeypatch.setattr(
        CameraOnPaper, "step",
        lambda self, batch: step(self, batch) if see_to_3_m(self, batch.t_s) else (),
    )  # fmt: skip
    session, report = drive((-2.4, 0.0, 0.0), blind, monkeypatch, 'task="explore"',
                            seen_rows=(first,))  # fmt: skip
    assert not report.ok
    assert session.last is not None and session.last.status.fact == RowOutOfView(1)
    assert session.simulator.truth().x_map_m < 3.0 + 1.7 + session.config.mission.headland_m + 0.1
