from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from rosbags import rosbag1

from agribot.cli.main import main
from agribot.core import topics
from agribot.core.errors import RecordingError
from agribot.record.bag.convert import ConvertOptions, convert
from agribot.record.bag.definitions import ros1_store
from agribot.record.foreign import read_foreign
from tests.record.bag import bag_samples as samples


def test_a_bag_with_fixes_only_shows_its_track_and_says_what_is_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    samples.write_ros1(tmp_path / "field.bag")
    out = tmp_path / "report"
    assert main(["report", str(tmp_path / "field.bag"), "-o", str(out), "--json"]) == 0
    said = capsys.readouterr()
    result = json.loads(said.out.splitlines()[-1])
    assert result["track"] == {"/fix": 50}
    assert result["distance"] == {"driven, by /fix": 50}
    assert any("raw heading" in word for word in result["missing"])
    assert any("speed" in word for word in result["missing"])
    assert any(word.startswith("poses: the log has no odometry") for word in result["missing"])
    assert result["localization"] is None
    assert "missing: speed" in said.err
    names = {p.name for p in out.iterdir()}
    assert names == {"report.html", "report.json", "track.png", "distance.png"}
    page = (out / "report.html").read_text()
    assert "What is missing" in page
    assert "/fix" in page


def test_values_of_a_foreign_bag_are_those_that_were_driven(tmp_path: Path) -> None:
    samples.write_run(tmp_path / "run.mcap")
    wanted = (topics.ODOMETRY.name, topics.FIX.name, topics.HEADING_RAW.name, topics.IMU.name)
    convert(tmp_path / "run.mcap", tmp_path / "a.bag", ConvertOptions(topics=wanted))
    data = read_foreign(tmp_path / "a.bag")
    assert data.missing == ()
    (speed,) = data.speed
    assert speed.points[:, 1] == pytest.approx(0.4)
    (heading,) = data.heading_filtered  # the IMU of ours measures no orientation
    assert all(abs(math.remainder(value, 360.0)) < 5.0 for value in heading.points[:, 1])
    tracks = {line.label: line.points for line in data.tracks}
    assert tracks[topics.FIX.name][0].tolist() == [0.0, 0.0]
    assert tracks[topics.ODOMETRY.name][-1] == pytest.approx([1.0, 2.0 + 0.4 * 3.0], abs=0.1)


def test_a_receiver_that_begins_at_latitude_and_longitude_0_is_at_no_place_yet(
    tmp_path: Path,
) -> None:
    store, kind = ros1_store(), "sensor_msgs/msg/NavSatFix"
    with rosbag1.Writer(tmp_path / "a.bag") as writer:
        topic = writer.add_connection("/fix", kind, typestore=store)
        for index, lat_deg in enumerate((0.0, 49.5, 49.50001)):
            t_ns = samples.START_NS + index * samples.STEP_NS
            fix = samples.nav_sat_fix(store, t_ns, lat_deg, 8.1 if lat_deg else 0.0)
            writer.write(topic, t_ns, store.serialize_ros1(fix, kind))
    (track,) = read_foreign(tmp_path / "a.bag").tracks
    assert len(track.points) == 2
    assert track.points[-1] == pytest.approx([0.0, 1.11], abs=0.01)


def test_fixes_without_an_altitude_make_no_step_in_a_track(tmp_path: Path) -> None:
    store, kind = ros1_store(), "sensor_msgs/msg/NavSatFix"
    with rosbag1.Writer(tmp_path / "a.bag") as writer:
        topic = writer.add_connection("/fix", kind, typestore=store)
        for index in range(8):
            t_ns = samples.START_NS + index * samples.STEP_NS
            fix = samples.nav_sat_fix(store, t_ns, 49.5 + 0.0045 * min(index, 1))
            fix.altitude = math.nan if index % 4 == 3 else 1700.0
            writer.write(topic, t_ns, store.serialize_ros1(fix, kind))
    (track,) = read_foreign(tmp_path / "a.bag").tracks
    assert np.ptp(track.points[1:, 1]) == 0.0
    assert track.points[1, 1] == pytest.approx(500.6, abs=0.1)


def test_odometry_before_its_first_fix_is_no_part_of_the_track(tmp_path: Path) -> None:
    samples.write_run(tmp_path / "run.mcap", unplaced=50)
    convert(
        tmp_path / "run.mcap", tmp_path / "a.bag", ConvertOptions(topics=(topics.ODOMETRY.name,))
    )
    data = read_foreign(tmp_path / "a.bag")
    (track,) = data.tracks
    assert track.points[0] == pytest.approx([1.0, 2.0 + 0.4 * 1.0], abs=0.1)
    (driven,) = (line for line in data.distance if line.label.startswith("driven"))
    assert driven.points[0] == pytest.approx([1.0, 0.0], abs=0.05)
    assert driven.points[-1, 0] == pytest.approx(3.0, abs=0.05)
    assert driven.points[-1, 1] < 5.0
    (heading,) = data.heading_filtered
    assert all(abs(math.remainder(value, 360.0)) < 5.0 for value in heading.points[:, 1])


def test_a_run_that_was_killed_still_gets_a_report(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    samples.write_run(tmp_path / "run.mcap")
    whole = (tmp_path / "run.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    assert main(["report", str(tmp_path / "cut.mcap"), "-o", str(tmp_path / "out")]) == 0
    assert "ends in the middle" in capsys.readouterr().err
    assert (tmp_path / "out" / "heading.png").exists()


def test_a_bag_with_nothing_to_plot_is_refused_with_what_it_holds(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    samples.write_ros1(tmp_path / "a.bag")
    convert(tmp_path / "a.bag", tmp_path / "b.bag", ConvertOptions(topics=("/text",)))
    for command in (["report"], ["view", "rerun"]):
        out = tmp_path / "out.rrd"
        assert main([*command, str(tmp_path / "b.bag"), "-o", str(out)]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert "/text (std_msgs/msg/String)" in line and "NavSatFix" in line
        assert not out.exists()


def _write_frames(path: Path, base: str, count: int = 40, drive_m: float = 4.0) -> None:
    """Only frames: a robot goes ahead in odom, which lies turned by a right angle in map."""
    store = ros1_store()
    types = store.types
    pose, vector = types["geometry_msgs/msg/Transform"], types["geometry_msgs/msg/Vector3"]
    turn, stamped = (
        types["geometry_msgs/msg/Quaternion"],
        types["geometry_msgs/msg/TransformStamped"],
    )
    with rosbag1.Writer(path) as writer:
        tf = writer.add_connection("/tf", "tf2_msgs/msg/TFMessage", typestore=store)
        for index in range(count):
            t_ns = samples.START_NS + index * samples.STEP_NS
            ahead_m = drive_m * index / (count - 1)
            edges = [
                ("/map", "/odom", pose(vector(1.0, 0.0, 0.0), turn(0.0, 0.0, 0.5**0.5, 0.5**0.5))),
                ("/odom", base, pose(vector(ahead_m, 0.0, 0.0), turn(0.0, 0.0, 0.0, 1.0))),
                (base, "/laser", pose(vector(0.2, 0.0, 0.3), turn(0.0, 0.0, 0.0, 1.0))),
            ]
            told = [
                stamped(samples.header(store, t_ns, parent, index), child, transform)
                for parent, child, transform in edges
            ]
            message = types["tf2_msgs/msg/TFMessage"](told)
            writer.write(tf, t_ns, store.serialize_ros1(message, tf.msgtype))


@pytest.mark.parametrize("base", ["/base_link", "/rover"])
def test_frames_alone_show_the_path_of_the_base(tmp_path: Path, base: str) -> None:
    _write_frames(tmp_path / "f.bag", base)
    data = read_foreign(tmp_path / "f.bag")
    (track,) = data.tracks
    assert track.label == f"tf map to {base[1:]}"
    assert track.points[0] == pytest.approx([1.0, 0.0])
    assert track.points[-1] == pytest.approx([1.0, 4.0])
    (driven,) = data.distance
    assert driven.points[-1] == pytest.approx([3.9, 4.0])


def test_a_report_and_rerun_show_a_bag_of_frames_and_a_track_on_earth_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = tmp_path / "f.bag"
    _write_frames(bag, "/base_link")
    assert main(["report", str(bag), "-o", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out" / "track.png").exists()
    assert main(["view", "rerun", str(bag), "-o", str(tmp_path / "f.rrd")]) == 0
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith("158 messages to")  # 79 places on the track, 79 of the distance
    assert main(["bag", "track", str(bag), "-o", str(tmp_path / "f.gpx")]) == 2
    assert "only /tf (tf2_msgs/msg/TFMessage)" in capsys.readouterr().err


def test_frames_of_a_robot_that_stands_are_no_path(tmp_path: Path) -> None:
    _write_frames(tmp_path / "f.bag", "/base_link", drive_m=0.01)
    with pytest.raises(RecordingError, match=r"f\.bag holds nothing that can be shown"):
        read_foreign(tmp_path / "f.bag")
