from __future__ import annotations

import csv
import errno
import json
import math
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from rosbags import rosbag1

from agribot.cli.main import main
from agribot.core import topics
from agribot.core.config import load
from agribot.core.geo import MapFrame
from agribot.record.bag import table
from agribot.record.bag.definitions import ros1_store
from agribot.record.bag.track import read_track
from tests.record.bag import bag_samples as samples

GPX = {"g": "http://www.topografix.com/GPX/1/1"}
KML = {"k": "http://www.opengis.net/kml/2.2"}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run") / "run.mcap"
    samples.write_run(path)
    return path


def test_a_track_is_the_same_in_every_format(tmp_path: Path) -> None:
    samples.write_ros1(tmp_path / "a.bag", count=10)
    for suffix in ("gpx", "kml", "csv"):
        out = tmp_path / f"a.{suffix}"
        assert main(["bag", "track", str(tmp_path / "a.bag"), "-o", str(out)]) == 0
    points = ElementTree.parse(tmp_path / "a.gpx").findall(".//g:trkpt", GPX)
    from_gpx = [(float(p.attrib["lat"]), float(p.attrib["lon"])) for p in points]
    assert [lat for lat, _ in from_gpx] == pytest.approx(
        [49.5 + 1e-6 * i for i in range(10)], abs=1e-9
    )
    assert {lon for _, lon in from_gpx} == {8.1}
    assert points[1].findtext("g:time", namespaces=GPX) == "2023-11-14T22:13:20.100Z"
    assert points[1].findtext("g:ele", namespaces=GPX) == "120.500"
    line = ElementTree.parse(tmp_path / "a.kml").findtext(".//k:coordinates", namespaces=KML)
    assert line is not None
    from_kml = [tuple(map(float, place.split(",")))[:2] for place in line.split()]
    assert [(lat, lon) for lon, lat in from_kml] == from_gpx
    with (tmp_path / "a.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(float(r["lat_deg"]), float(r["lon_deg"])) for r in rows] == from_gpx
    assert float(rows[0]["std_m"]) == pytest.approx((0.5 * (0.04 + 0.09)) ** 0.5, abs=1e-4)


def test_a_run_gives_its_fixes_or_its_estimate(run: Path) -> None:
    fixes = read_track(run)
    assert (fixes.topic, len(fixes.points)) == (topics.FIX.name, 30)
    estimate = read_track(run, topics.ODOMETRY.name)
    frame = MapFrame(load("farm").field.datum)
    point = estimate.points[-1]
    east_m, north_m, _ = frame.map_from_geodetic(point.lat_deg, point.lon_deg, point.alt_m)
    assert [east_m, north_m] == pytest.approx([1.0, 2.0 + 0.4 * 3.0], abs=0.1)
    assert point.std_m == pytest.approx(0.02)


def test_simulated_time_is_not_passed_off_as_a_date(run: Path, tmp_path: Path) -> None:
    out = tmp_path / "run.gpx"
    assert main(["bag", "track", str(run), "-o", str(out)]) == 0
    assert ElementTree.parse(out).findall(".//g:time", GPX) == []


def test_bags_without_positions_and_other_formats_are_refused(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bag", "track", str(run), "-o", str(tmp_path / "x.shp")]) == 2
    assert ".gpx, .kml, .csv" in capsys.readouterr().err
    out = ["-o", str(tmp_path / "x.gpx")]
    assert main(["bag", "track", str(run), "--topic", topics.IMU.name, *out]) == 2
    assert "a track needs" in capsys.readouterr().err


def test_any_ros_topic_becomes_a_table(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "joints.csv"
    assert main(["bag", "csv", str(run), topics.JOINT_STATES.name, "-o", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["rows"] == 150
    with out.open() as file:
        rows = list(csv.DictReader(file))
    assert rows[0]["log_time_s"] == "0.020000000"
    assert len(json.loads(rows[0]["position"])) == 4
    assert json.loads(rows[0]["name"])[0].startswith("right_wheel_R")
    out = tmp_path / "tf.csv"
    assert main(["bag", "csv", str(run), topics.TF.name, "-o", str(out)]) == 0
    with out.open() as file:
        first = next(csv.DictReader(file))
    assert json.loads(first["transforms"])[0]["child_frame_id"] == "odom"
    assert main(["bag", "csv", str(run), topics.TICK.name, "-o", str(out)]) == 2
    assert "cannot be read here" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("ending", "status"),
    [(KeyboardInterrupt(), 130), (OSError(errno.ENOSPC, "No space left on device"), 2)],
)
def test_a_table_that_is_not_finished_leaves_the_earlier_one(
    ending: BaseException, status: int, run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, flatten, left = tmp_path / "joints.csv", table._flatten, iter(range(5))
    out.write_text("the earlier table")

    def end_soon(*arguments: Any) -> None:
        if next(left, None) is None:
            raise ending
        flatten(*arguments)

    monkeypatch.setattr(table, "_flatten", end_soon)
    assert main(["bag", "csv", str(run), topics.JOINT_STATES.name, "-o", str(out)]) == status
    assert out.read_text() == "the earlier table"
    assert [path.name for path in tmp_path.iterdir()] == ["joints.csv"]


def test_a_table_is_never_written_over_its_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = tmp_path / "a.csv"  # whatever its name, it is a recording
    samples.write_ros1(bag, count=10)
    before = bag.read_bytes()
    beside = tmp_path / "link.csv"
    beside.symlink_to(bag)
    for out in (bag, beside):
        assert main(["bag", "csv", str(bag), "/fix", "-o", str(out)]) == 2
        assert "is the recording itself" in capsys.readouterr().err
    assert bag.read_bytes() == before


def test_a_point_without_an_altitude_or_an_accuracy_has_none_in_any_format(tmp_path: Path) -> None:
    recording, store = tmp_path / "a.bag", ros1_store()
    with rosbag1.Writer(recording) as writer:
        fix = writer.add_connection("/fix", "sensor_msgs/msg/NavSatFix", typestore=store)
        message = samples.nav_sat_fix(store, samples.START_NS)
        message.altitude, message.position_covariance = math.nan, np.zeros(9)
        writer.write(fix, samples.START_NS, store.serialize_ros1(message, fix.msgtype))
    for suffix in (".gpx", ".kml", ".csv"):
        assert main(["bag", "track", str(recording), "-o", str(tmp_path / f"a{suffix}")]) == 0
    (point,) = ElementTree.parse(tmp_path / "a.gpx").findall(".//g:trkpt", GPX)
    assert point.find("g:ele", GPX) is None and point.get("lat") == "49.500000000"
    line = ElementTree.parse(tmp_path / "a.kml").findtext(".//k:coordinates", namespaces=KML)
    assert line == "8.100000000,49.500000000"
    with (tmp_path / "a.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert (row["alt_m"], row["std_m"]) == ("", "")


def test_a_track_is_never_written_over_its_recording_and_leaves_out_what_is_no_place(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording, store = tmp_path / "drive.csv", ros1_store()
    with rosbag1.Writer(recording) as writer:
        fix = writer.add_connection("/fix", "sensor_msgs/msg/NavSatFix", typestore=store)
        for index, lat_deg in enumerate((49.5, 500.0, 49.6)):
            t_ns = samples.START_NS + index * samples.STEP_NS
            message = samples.nav_sat_fix(store, t_ns, lat_deg, seq=index)
            writer.write(fix, t_ns, store.serialize_ros1(message, fix.msgtype))
    before = recording.read_bytes()
    assert main(["bag", "track", str(recording), "-o", str(recording)]) == 2
    assert "is the recording itself" in capsys.readouterr().err
    assert recording.read_bytes() == before
    track = read_track(recording)
    assert [point.lat_deg for point in track.points] == [49.5, 49.6]
    assert track.without_fix == 1
