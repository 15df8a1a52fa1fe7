"""A log through the filter: poses near the truth, honest figures, all files."""

from __future__ import annotations

import csv
import html
import json
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin

from agribot.app.localization.figures import ThinTable
from agribot.app.localization.study import StudyOptions, open_study, run_study
from agribot.cli.main import main
from agribot.core import topics
from agribot.core.config import load
from agribot.core.errors import ConfigError, RecordingError
from agribot.core.geo import MapFrame
from agribot.description.loader import export_urdf, load_robot
from agribot.record.bag.definitions import ros1_store, ros2_store
from agribot.record.bag.opening import open_bag
from agribot.record.recorder import RunRecorder
from tests.app.localization import drives
from tests.app.localization.drives import START_S, Drive, Messages, make_drive, rotation_deg
from tests.record import record_samples as samples

KEYS = [
    "fixes", "used", "started_after_s", "started_after_m", "rms_to_fixes_m",
    "within_3_sigma_ratio", "outages", "nis_mean", "reason",
]  # fmt: skip
RADIUS_M, TRACK_M = 0.165, 0.55


def write_tables(folder: Path, drive: Drive) -> Path:
    drives.write_tables(folder, drive)
    drives.write_ubx(folder / "gnss.ubx", drive)
    return folder


@pytest.fixture(scope="module")
def drive() -> Drive:
    return make_drive(duration_s=80.0, body_from_imu=rotation_deg(90.0, 0.0, -90.0))


class Ran:
    """One run of the program over the drive, in every way that it can."""

    def __init__(self, folder: Path, drive: Drive, out: str) -> None:
        self.drive, self.out = drive, folder / "out"
        self.line: dict[str, Any] = json.loads(out.splitlines()[-1])


@pytest.fixture(scope="module")
def ran(drive: Drive, tmp_path_factory: pytest.TempPathFactory) -> Ran:
    import contextlib
    import io

    folder = tmp_path_factory.mktemp("ran")
    log, out = write_tables(folder / "log", drive), io.StringIO()
    with contextlib.redirect_stdout(out):
        status = main(
            ["localize", str(log), "--out", str(folder / "out"), "--outage", "50-65",
             "--with", "estimate.gate_sigma=2.5", "--gpx", "--json"]
        )  # fmt: skip
    assert status == 0
    return Ran(folder, drive, out.getvalue())


def test_the_last_line_has_the_keys_of_the_contract_in_their_order(ran: Ran) -> None:
    assert list(ran.line) == [*KEYS, "with"]
    assert list(ran.line["with"]) == ["settings", *KEYS]
    assert ran.line["with"]["settings"] == ["estimate.gate_sigma=2.5"]
    (outage,) = ran.line["outages"]
    assert list(outage) == ["from_s", "to_s", "driven_m", "error_m", "sigma_m"]


def test_the_poses_lie_at_the_truth_within_what_they_state(ran: Ran) -> None:
    error_m = drives.find_error_m(ran.out, ran.drive)
    table = np.genfromtxt(ran.out / "poses.csv", delimiter=",", names=True)
    stated_m = np.sqrt(table["xx_m2"] + table["yy_m2"])
    assert np.mean(error_m < 3.0 * stated_m) > 0.99
    assert np.sqrt(np.mean(error_m[table["t_s"] < 50.0] ** 2)) < 1.2
    assert ran.line["reason"] == "ok" and ran.line["started_after_s"] < 20.0


def test_the_figures_are_those_of_the_fixes(ran: Ran) -> None:
    """Fixes scatter by 0.5 m on each axis: 0.71 m in the plane."""
    line, given = ran.line, ran.drive.fixes[:, 0]
    assert line["fixes"] == len(given)
    assert line["used"] <= np.count_nonzero((given < 50.0) | (given >= 65.0))
    assert line["used"] > 0.7 * line["fixes"]
    assert 0.4 < line["rms_to_fixes_m"] < 1.0
    assert line["within_3_sigma_ratio"] > 0.97
    assert 0.4 < line["nis_mean"] < 3.0


def test_an_outage_is_driven_by_wheels_and_gyro(ran: Ran) -> None:
    (outage,) = ran.line["outages"]
    t, v, _ = ran.drive.odom.T
    driven_m = np.sum(v[(t >= 50.0) & (t < 65.0)]) * drives.ODOM_S
    assert outage["driven_m"] == pytest.approx(driven_m, abs=0.2)
    assert (outage["from_s"], outage["to_s"]) == (50.0, 65.0)
    assert 0.2 < outage["error_m"] < 1.5  # of fixes that scatter themselves
    assert 0.2 < outage["sigma_m"] < 1.5


def test_poses_stand_in_three_files_with_the_stamps_of_the_log(ran: Ran) -> None:
    with (ran.out / "poses.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    tum = np.loadtxt(ran.out / "poses.tum")
    assert len(rows) == len(tum) > 500
    assert float(rows[-1]["stamp_s"]) == pytest.approx(tum[-1, 0])
    assert float(rows[-1]["stamp_s"]) == pytest.approx(START_S + 80.0, abs=0.1)
    assert float(rows[-1]["t_s"]) == pytest.approx(80.0, abs=0.1)
    yaw_rad = 2.0 * np.arctan2(tum[:, 6], tum[:, 7])
    stated = np.array([float(row["yaw_map_rad"]) for row in rows])
    assert np.exp(1j * yaw_rad) == pytest.approx(np.exp(1j * stated), abs=1e-4)
    last = ran.drive.truth[-1]
    frame = MapFrame(drives.DATUM)
    east_m, north_m, _ = frame.map_from_geodetic(
        float(rows[-1]["lat_deg"]), float(rows[-1]["lon_deg"]), drives.DATUM.alt_m
    )
    assert np.hypot(east_m - last[1], north_m - last[2]) < 1.5
    assert "<trkpt" in (ran.out / "poses.gpx").read_text()


def test_foxglove_finds_fixes_poses_and_frames(ran: Ran) -> None:
    with open_bag(ran.out / "estimate.mcap") as bag:
        counts = {topic.name: topic.count for topic in bag.topics}
        assert counts[topics.FIX.name] == np.count_nonzero(
            (ran.drive.fixes[:, 0] < 50.0) | (ran.drive.fixes[:, 0] >= 65.0)
        )
        assert counts[topics.ODOMETRY.name] == counts[topics.TF.name] > 500
        assert counts[topics.IMU.name] == len(ran.drive.imu)
        imu = next(iter(bag.messages(frozenset({topics.IMU.name}))))
        assert bag.value(imu).linear_acceleration.z == pytest.approx(9.81, abs=1.0)
        assert imu.log_ns * 1e-9 == pytest.approx(START_S, abs=0.1)


def test_the_page_shows_figures_outages_and_what_was_not_used(ran: Ran) -> None:
    page = html.unescape((ran.out / "report.html").read_text())
    for words in (
        "Localized", "With estimate.gate_sigma=2.5", "<h2>Outages</h2>", "gnss.ubx", "imu.csv",
        "the body's axes are x = imu -z, y = imu -x, z = imu y",
        "What was not used, and why", "assumed; state --antenna X,Y,Z",
    ):  # fmt: skip
        assert words in page, words
    assert page.count("<svg") == 3 and "http" not in page.replace("http://www.w3.org", "")


def test_the_same_log_gives_the_same_poses(drive: Drive, tmp_path: Path) -> None:
    short = msgspec.structs.replace(
        drive, **{name: getattr(drive, name)[getattr(drive, name)[:, 0] < 30.0]
                  for name in ("odom", "imu", "fixes", "mag")},
    )  # fmt: skip
    log = write_tables(tmp_path / "log", short)
    for out in ("a", "b"):
        main(["localize", str(log), "--out", str(tmp_path / out)])
    for name in ("poses.tum", "poses.csv", "report.html", "estimate.mcap"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_the_mount_is_that_of_tf_static_unless_gravity_contradicts_it(tmp_path: Path) -> None:
    drive = make_drive(duration_s=30.0, body_from_imu=rotation_deg(0.0, 0.0, 30.0))
    ros = Messages(drive, ros2_store())

    def study(name: str, roll_deg: float, yaw_deg: float) -> Any:
        """The IMU hangs on a plate, which is turned about the vertical."""
        frames = [("base_link", "plate", 0.0, yaw_deg), ("plate", "imu_link", roll_deg, 0.0),
                  ("base_link", "gps", 0.0, 0.0)]  # fmt: skip
        moved = [ros.frame(*frame) for frame in frames]
        kind = "tf2_msgs/msg/TFMessage"
        messages = [(0.0, "/tf_static", kind, ros.make(kind, moved)), *ros.list()]
        drives.write_ros2(tmp_path / name, messages, StoragePlugin.MCAP)
        return open_study([tmp_path / name], StudyOptions())

    right = study("right", 0.0, 30.0)
    assert right.mount.how == "frame imu_link"
    assert right.mount.body_from_imu == pytest.approx(rotation_deg(0.0, 0.0, 30.0), abs=1e-9)
    assert "antenna at 0.30, 0.00, 1.20 m of the body (by its frame)" in right.facts.robot
    assert np.array_equal(right.mag_mount.body_from_imu, right.mount.body_from_imu)
    across = study("across", 0.0, 120.0)
    assert across.mount.how == "frame imu_link"
    (note,) = (note for note in across.facts.notes if "forward lies" in note)
    assert int(note.split("forward lies ")[1].split()[0]) == pytest.approx(90, abs=10)
    wrong = study("wrong", 90.0, 30.0)
    assert wrong.mount.how.startswith("found from gravity")
    assert any("the frame is not used" in note for note in wrong.facts.notes)


def test_wheels_that_nobody_measured_are_found_from_fixes_and_gyro(tmp_path: Path) -> None:
    drive = make_drive(duration_s=60.0, fix_std_m=0.1)
    t, v, w = drive.odom.T
    speeds = np.column_stack([v - w * TRACK_M / 2.0, v + w * TRACK_M / 2.0]) / RADIUS_M
    drives.write_tables(tmp_path, drive)
    (tmp_path / "odom.csv").unlink()
    drives.write_table(
        tmp_path / "wheels.csv", ["stamp_s", "left_radps", "right_radps"],
        np.column_stack([t, speeds]),
    )  # fmt: skip
    drives.write_ubx(tmp_path / "gnss.ubx", drive)
    found = open_study([tmp_path], StudyOptions())
    assert found.robot.drive.wheel_radius_m == pytest.approx(RADIUS_M / 1.01, rel=0.01)
    assert found.robot.drive.effective_separation_m == pytest.approx(TRACK_M, rel=0.05)
    stated = open_study([tmp_path], StudyOptions(track_m=TRACK_M, radius_m=RADIUS_M))
    assert stated.facts.robot[0] == "wheels of 0.165 m radius, 0.55 m apart (as stated)"
    (run,) = run_study(stated)
    assert run.driven_m == pytest.approx(np.sum(v) * drives.ODOM_S, rel=0.01)


@pytest.mark.parametrize(("scale", "expected"), [(1.15, 1.16), (1.0, 1.0)])
def test_an_odometry_whose_way_is_too_long_is_divided_by_what_the_fixes_show(
    tmp_path: Path, scale: float, expected: float
) -> None:
    """That of the drive is 1 % too long, which the filter learns as slip."""
    drive = make_drive(duration_s=40.0, fix_std_m=0.1)
    drive.odom[:, 1] *= scale
    write_tables(tmp_path, drive)
    study = open_study([tmp_path], StudyOptions())
    assert study.way_ratio == pytest.approx(expected, rel=0.02)
    is_noted = any("odometry: its speeds are divided by 1.1" in each for each in study.facts.notes)
    assert is_noted == (scale != 1.0)
    (run,) = run_study(study)
    way_m = np.sum(np.hypot(*np.diff(drive.truth[:, 1:3], axis=0).T))
    assert run.driven_m == pytest.approx(way_m, rel=0.03)


def test_a_recording_of_ours_brings_its_robot_and_its_settings(tmp_path: Path) -> None:
    recorder = RunRecorder(
        tmp_path / "run.mcap", load("rows-10x12", ["seed=7"]), load_robot(), export_urdf()
    )
    for record in samples.ticks(30, seed=3, with_camera=False):
        recorder(record)
    recorder.close()
    found = open_study([tmp_path], StudyOptions())
    assert found.mount.how == "of the recording"
    assert found.config.seed == 7


def test_only_settings_that_the_filter_has_are_tried(tmp_path: Path, drive: Drive) -> None:
    log = write_tables(tmp_path, drive)
    with pytest.raises(ConfigError, match=r"mission\.speed_mps=1: it has no effect on a log"):
        open_study([log], StudyOptions(settings=("mission.speed_mps=1",)))
    with pytest.raises(ConfigError, match="did you mean 'gate_sigma'"):
        open_study([log], StudyOptions(settings=("estimate.gate_sigm=1",)))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--outage", "20-10"], "--outage 20-10: not two times in order"),
        (["--antenna", "1,2"], "--antenna 1,2: not three numbers; give X,Y,Z in metres"),
        (
            ["--imu-rpy-deg", "a,b,c"],
            "--imu-rpy-deg a,b,c: not three numbers; give R,P,Y in degrees",
        ),
        (["--robot", "agribot", "--track", "1"], "--robot brings track and radius"),
        (["--radius", "-0.1"], "-0.1: out of range; give a number above 0"),
        (["--with", "estimate.gate_sigm=1"], "did you mean 'gate_sigma'"),
    ],
)
def test_options_that_cannot_be_meant_are_refused(
    words: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        status = main(["localize", "no.bag", "--out", str(tmp_path / "out"), *words])
    except SystemExit as error:  # of the parser
        status = error.code if isinstance(error.code, int) else 1
    assert status == 2 and said in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_results_are_no_log_and_never_written_over_the_log_that_is_read(
    ran: Ran, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(RecordingError, match="the log has no odometry"):
        open_study([ran.out], StudyOptions())
    mcap = ran.out / "estimate.mcap"
    assert main(["localize", str(mcap), "--out", str(ran.out)]) == 2
    assert "estimate.mcap is the recording itself" in capsys.readouterr().err


def test_a_thin_table_keeps_its_ends_and_a_bounded_number_of_rows() -> None:
    table = ThinTable(2, limit=100)
    for index in range(10_001):
        table.append((float(index), 1.0))
    rows = table.to_array()
    assert len(rows) <= 100 and rows[0, 0] == 0.0
    assert len(set(np.diff(rows[:, 0]))) == 1 and rows[-1, 0] > 9_800.0


def test_a_report_of_a_foreign_bag_shows_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = make_drive(duration_s=25.0)
    drives.write_ros1(tmp_path / "a.bag", Messages(drive, ros1_store()).list())
    assert main(["report", str(tmp_path / "a.bag"), "-o", str(tmp_path / "out"), "--json"]) == 0
    line = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert list(line["localization"]) == KEYS
    assert line["localization"]["fixes"] == len(drive.fixes)
    assert "Fixes and estimate" in (tmp_path / "out" / "report.html").read_text()
