"""Rows that somebody taught by driving along them."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from rosbags import rosbag2
from rosbags.rosbag2 import StoragePlugin

from agribot.app.simulated_run import simulate
from agribot.app.taught_rows import (
    DrivenTrack,
    split_by_marks,
    split_by_turns,
    teach_rows,
)
from agribot.autonomy.plan.ways.curves import Segment, sample
from agribot.cli.main import main
from agribot.core.config import load
from agribot.core.facts import MarksOdd
from agribot.core.geo import Datum
from agribot.core.messages import FloatArray, MarkMoment
from agribot.core.pose import Pose2
from agribot.gis.drawn_field import SIMPLIFIED_M
from agribot.gis.field_file import read_field
from agribot.record.bag.definitions import ros2_store
from tests.finding import refused
from tests.record.bag.bag_samples import START_NS, nav_sat_fix

DATUM = Datum(lat_deg=21.0, lon_deg=72.0)


def drive_rows(bend_radpm: float = 0.0, noise_m: float = 0.005) -> FloatArray:
    """Three rows of 8 m, 1 m apart, up and down, with the turns between them."""
    pieces = [Segment(8.0, bend_radpm), Segment(math.pi / 2.0, 2.0), Segment(8.0, bend_radpm),
              Segment(math.pi / 2.0, -2.0), Segment(8.0, bend_radpm)]  # fmt: skip
    path = sample(Pose2(0.0, 0.0, 0.3), pieces)
    every = slice(None, None, 3)
    points = path.xy_map_m[every]
    points = points + np.random.default_rng(5).normal(0.0, noise_m, points.shape)
    t_s = path.s_m[every] / 0.4
    return np.column_stack([t_s, points, np.full(len(t_s), 0.02)])


@pytest.mark.parametrize("bend_radpm", [0.0, 0.05])
def test_a_drive_without_marks_is_cut_where_it_turns(bend_radpm: float) -> None:
    rows = split_by_turns(drive_rows(bend_radpm))
    assert len(rows) == 3
    lengths = [float(np.hypot(*(row[-1] - row[0])[1:3])) for row in rows]
    assert lengths == pytest.approx([8.0] * 3, abs=0.8)


def test_marks_tell_where_rows_begin_and_end() -> None:
    points = drive_rows()
    rows = split_by_marks(DrivenTrack(points, (5.0, 15.0, 30.0, 40.0), DATUM))
    ends_s = [t_s for row in rows for t_s in (row[0, 0], row[-1, 0])]
    assert ends_s == pytest.approx([5.0, 15.0, 30.0, 40.0], abs=0.2)


def test_a_row_without_an_end_is_refused() -> None:
    with refused(MarksOdd(3)):
        split_by_marks(DrivenTrack(drive_rows(), (1.0, 2.0, 3.0), DATUM))


def test_a_recorded_drive_becomes_a_field_whose_line_keeps_to_its_track(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = ["seed=1", 'sim.sensors="rtk"', "perception.enabled=false", 'world="empty"',
                "field.start_map_m=[0,0]",
                "field.first_row_start_map_m=[0,1.5]", "field.row_yaw_deg=90",
                "field.start_yaw_deg=90",
                "duration_s=26", "record.image_rate_hz=0"]  # fmt: skip
    track, run = [], tmp_path / "run"
    with simulate(load("rows-10x12", settings), run) as session:
        for record in session.ticks():
            here = record.estimate
            track.append((record.batch.t_s, here.x_map_m, here.y_map_m))
            if record.batch.t_s in (10.0, 25.0):
                session.inbox.post(MarkMoment(text="end"))
        session.finish()
    out = tmp_path / "field.geojson"
    assert main(["plan", "teach", str(run), "--out", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["rows"] == 1
    text, _, _ = teach_rows(run / "run.mcap")
    assert text == out.read_text()
    area, _ = read_field(out, load("rows-10x12").field.datum)
    line = shapely.LineString(area.rows[0])
    assert line.length == pytest.approx(15.0 * 0.4, abs=0.5)
    assert 2 <= len(area.rows[0]) < 20
    off_m = [line.distance(shapely.Point(x_m, y_m)) for t_s, x_m, y_m in track if 10.1 < t_s < 25.0]
    assert max(off_m) < SIMPLIFIED_M + 0.005
    assert 0.0 < json.loads(text)["features"][1]["properties"]["std_m"] < 0.1


def test_what_is_no_recording_is_refused_in_a_line(tmp_path: Path) -> None:
    missing = str(tmp_path / "nothing.mcap")
    assert main(["plan", "teach", missing, "--out", str(tmp_path / "x.geojson")]) == 2
    assert main(["plan", "teach", missing]) == 2


def write_fixes(folder: Path, places: list[tuple[float, float]], order: list[int]) -> None:
    """A rosbag2 folder of fixes (latitude, longitude), one a second, written in another order."""
    store = ros2_store()
    with rosbag2.Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/gps/fix", "sensor_msgs/msg/NavSatFix", typestore=store)
        for index in order:
            t_ns = START_NS + index * 10**9
            message = nav_sat_fix(store, t_ns, *places[index])
            if index % 4 == 3:
                message.altitude = math.nan  # as of receivers with few satellites
            writer.write(topic, t_ns, store.serialize_cdr(message, topic.msgtype))


def test_wrong_fixes_of_another_robot_are_left_out_of_its_rows_and_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The first of a receiver that knows nothing yet, and one that is 700 m off."""
    row = [(48.0 + 5e-6 * k, 11.0) for k in range(40)]
    places = [(0.0, 0.0), (0.0, 0.0), *row]
    places[20] = (places[20][0], 11.01)
    write_fixes(tmp_path / "foreign", places, list(range(len(places))))
    out = tmp_path / "field.geojson"
    assert main(["plan", "teach", str(tmp_path / "foreign"), "--out", str(out)]) == 0
    assert "warning: 1 fixes are left out" in capsys.readouterr().err
    area, _ = read_field(out)
    assert shapely.Polygon(area.boundary).area < 100.0, "no corridor beyond its way"
    assert sum(shapely.LineString(line).length for line in area.rows) > 20.0


def test_fixes_that_a_recorder_wrote_out_of_order_are_taught_in_theirs(tmp_path: Path) -> None:
    row = [(48.0 + 5e-6 * k, 11.0) for k in range(40)]
    order = [k for k in range(40) if k % 3] + list(range(0, 40, 3))
    write_fixes(tmp_path / "foreign", row, order)
    out = tmp_path / "field.geojson"
    assert main(["plan", "teach", str(tmp_path / "foreign"), "--out", str(out)]) == 0
    area, _ = read_field(out)
    (line,) = area.rows
    assert len(line) == 2 and shapely.LineString(line).length == pytest.approx(21.7, abs=0.3)


def test_a_field_is_never_written_over_its_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_fixes(tmp_path / "foreign", [(48.0 + 5e-6 * k, 11.0) for k in range(40)], [*range(40)])
    (recording,) = (tmp_path / "foreign").glob("*.mcap")
    drive = recording.rename(tmp_path / "drive.json")
    before = drive.read_bytes()
    assert main(["plan", "teach", str(drive), "--out", str(drive)]) == 2
    assert "is the recording itself" in capsys.readouterr().err
    assert drive.read_bytes() == before
