"""Rows of a field file are the robot's rows: filter, mission and referee all know these."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from agribot.app.field_work import plan_field_file
from agribot.app.simulated_run import simulate
from agribot.core.config import RunConfig, load
from agribot.core.facts import NewTask
from agribot.core.geo import MapFrame
from agribot.core.messages import ControlMission, MapPoint, Row, TakePlan
from agribot.core.row_shape import project_on_row, row_points_map_m
from agribot.core.world import WorldSpec
from agribot.description.loader import load_robot
from agribot.description.worlds_sdf import load_run_world
from agribot.gis.plan_file import format_plan
from tests import nightly
from tests.mission.paper_camera import CameraOnPaper

SETTINGS = ["seed=1", "perception.enabled=false", "record.enabled=false", 'world="empty"',
            "field.start_map_m=[-1.5,0.2]", "field.start_yaw_deg=0"]  # fmt: skip
# Neither parallel nor of one length, the last one bent, and none where the profile has one.
CROP = (
    Row(index=0, start_map_m=(0.0, 0.4), end_map_m=(9.0, 1.0)),
    Row(index=1, start_map_m=(0.3, 1.4), end_map_m=(8.0, 2.1)),
    Row(index=2, start_map_m=(0.0, 2.5), end_map_m=(9.0, 3.4), curvature_radpm=-0.03),
)
EDGE = ((-4.0, -4.0), (13.0, -4.0), (13.0, 8.0), (-4.0, 8.0))


def plan_text(folder: Path) -> str:
    config = load("rows-10x12", SETTINGS)
    frame = MapFrame(config.field.datum)

    def degrees(points: Sequence[MapPoint]) -> list[list[float]]:
        return [list(frame.geodetic_from_map(*point)[1::-1]) for point in points]

    features: list[tuple[str, str, Any]] = [("boundary", "Polygon", [degrees((*EDGE, EDGE[0]))])]
    features += [("row", "LineString", degrees(row_points_map_m(row).tolist())) for row in CROP]
    path = folder / "rows.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [
        {"type": "Feature", "properties": {"kind": kind},
         "geometry": {"type": geometry, "coordinates": at}} for kind, geometry, at in features
    ]}))  # fmt: skip
    return format_plan(*plan_field_file(path, config, load_robot(config.robot), None))


@pytest.fixture(autouse=True)
def stands_on_its_mark(monkeypatch: pytest.MonkeyPatch) -> None:
    def shifted(settings: RunConfig) -> WorldSpec:
        place = {"spawn_xy_map_m": (-1.5, 0.2), "spawn_yaw_map_rad": 0.0}
        return msgspec.structs.replace(load_run_world(settings), **place)

    monkeypatch.setattr("agribot.app.run_world.load_run_world", shifted)


def off_rows_m(places: list[tuple[float, float, float]]) -> list[float]:
    """How far from the nearest row the robot was where it drove along one."""
    found = []
    for x_m, y_m, yaw_rad in places:
        for row in CROP:
            along_m, left_m, row_rad = map(float, project_on_row(row, x_m, y_m))
            is_along = abs(math.sin(yaw_rad - row_rad)) < 0.2 and 1.0 < along_m < 7.0
            if is_along and abs(left_m) < 0.5:
                found.append(left_m)
    return found


@pytest.mark.parametrize(
    "is_sent",
    [
        pytest.param(
            False,
            marks=nightly.by_day("test_a_cheap_receiver_holds_the_rows_of_a_plan_by_the_camera"),
        ),
        True,
    ],
)
def test_a_cheap_receiver_holds_the_rows_of_a_plan_by_the_camera(
    tmp_path: Path, is_sent: bool
) -> None:
    """Whether the run begins with the plan, or is sent it while it stands."""
    text = plan_text(tmp_path)
    given = "" if is_sent else text
    with simulate(load("rows-10x12", SETTINGS), tmp_path / "run", plan_text=given) as session:
        session.stack.perception = CameraOnPaper(session, CROP)
        if is_sent:
            session.inbox.post(ControlMission(action="pause"))
            session.inbox.post(TakePlan(geojson=text))
        places: list[tuple[float, float, float]] = []
        for record in session.ticks():
            if is_sent and isinstance(record.status.fact, NewTask):
                session.inbox.post(ControlMission(action="resume"))
            truth = session.simulator.truth()
            places.append((truth.x_map_m, truth.y_map_m, truth.yaw_map_rad))
            if is_sent and record.status.rows_done:
                break  # the rest is as in the other drive
        report = session.finish()
        believed = session.last
    off_m = off_rows_m(places)
    assert np.sqrt(np.mean(np.square(off_m))) < 0.025
    assert np.max(np.abs(off_m)) < 0.08
    assert believed is not None and believed.status.rows_done
    if not is_sent:
        assert report.ok, report.reason
        assert (
            report.mission.rows_done == report.mission.rows_total == 5
        )  # in truth; a bend counts as 3
        assert report.mission.rows_unproven == ()
