"""Logs without a pose in them are refused in a sentence; of others a report says what lacks."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from agribot.app.localization.log_scan import LogScan
from agribot.app.localization.study import Study, StudyOptions, open_study
from agribot.app.localization.time_order import order_by_stamp
from agribot.cli.main import main
from agribot.core.errors import ConfigError, RecordingError
from agribot.core.fact_text import render
from agribot.core.facts import NoFixesYet
from agribot.record.bag.definitions import ros1_store
from tests.app.localization import drives
from tests.app.localization.drives import Drive, Message, Messages, make_drive

DURATION_S = 40.0


@pytest.fixture(scope="module")
def drive() -> Drive:
    return make_drive(duration_s=DURATION_S)


@pytest.fixture(scope="module")
def messages(drive: Drive) -> list[Message]:
    return Messages(drive, ros1_store()).list()


def study(folder: Path, messages: list[Message], **options: Any) -> Study:
    (folder / "drive.bag").unlink(missing_ok=True)
    drives.write_ros1(folder / "drive.bag", messages)
    return open_study([folder / "drive.bag"], StudyOptions(**options))


def without(messages: list[Message], topic: str) -> list[Message]:
    return [each for each in messages if each[1] != topic]


def change(drive: Drive, method: str, make: Callable[..., Any]) -> list[Message]:
    """The drive's messages with another way to make those of a kind."""
    ros = Messages(drive, ros1_store())
    before = getattr(ros, method)
    setattr(ros, method, lambda *values: make(before, *values))
    return ros.list()


@pytest.mark.parametrize(
    ("topic", "words"),
    [("/odom", "no odometry.*name a topic or a file with --odom"), ("/imu", "no IMU"),
     ("/fix", "no GNSS")],
)  # fmt: skip
def test_a_sensor_that_lacks_is_named_with_the_option_that_brings_it(
    topic: str, words: str, messages: list[Message], tmp_path: Path
) -> None:
    with pytest.raises(RecordingError, match=words):
        study(tmp_path, without(messages, topic))


def test_a_receiver_that_never_had_a_fix_is_refused(drive: Drive, tmp_path: Path) -> None:
    def lose(before: Any, fix: Any) -> Any:
        message = before(fix)
        message.status.status = -1
        return message

    with pytest.raises(RecordingError, match="none of 100 messages has a position"):
        study(tmp_path, change(drive, "fix", lose))


def test_the_program_says_it_in_one_line_and_ends_with_2(
    drive: Drive, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drives.write_ros1(tmp_path / "a.bag", without(Messages(drive, ros1_store()).list(), "/fix"))
    assert main(["localize", str(tmp_path / "a.bag"), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr()
    assert said.err.splitlines()[-1].startswith("agribot localize: the log has no GNSS")
    assert not said.out and not (tmp_path / "out").exists()


def test_a_bag_that_was_played_backwards_is_refused(
    messages: list[Message], tmp_path: Path
) -> None:
    played = [(DURATION_S - t_s, *rest) for t_s, *rest in reversed(messages)]
    with pytest.raises(RecordingError, match="times run backwards"):
        study(tmp_path, played)


def test_a_clock_that_is_set_back_is_refused_with_the_place(drive: Drive, tmp_path: Path) -> None:
    def set_back(before: Any, t_s: float, *values: Any) -> Any:
        return before(t_s - (5.0 if t_s > 20.0 else 0.0), *values)

    with pytest.raises(RecordingError, match=r"imu \(/imu\): times go back 1 times.* by 4.9\d\d s"):
        study(tmp_path, change(drive, "imu", set_back))


def test_stamps_of_two_clocks_are_refused_and_the_recorders_times_serve(
    drive: Drive, tmp_path: Path
) -> None:
    leap = change(
        drive, "fix",
        lambda before, fix: before(msgspec.structs.replace(fix, t_s=fix.t_s + 18.0)),
    )  # fmt: skip
    with pytest.raises(RecordingError, match=r"gnss \(/fix\): its stamps are \+18.00 s off"):
        study(tmp_path, leap)
    taken = study(tmp_path, leap, uses_log_times=True)
    assert taken.facts.sources[0].to_s == pytest.approx(39.7)


def test_files_without_a_time_in_common_are_refused(drive: Drive, tmp_path: Path) -> None:
    drives.write_tables(tmp_path, drive)
    drives.write_table(
        tmp_path / "imu.csv", drives.IMU_NAMES, drive.imu - [drives.START_S, *[0.0] * 6]
    )
    drives.write_nmea(tmp_path / "gnss.nmea", drive)
    with pytest.raises(RecordingError, match="the sensors have no time in common: odom"):
        open_study([tmp_path], StudyOptions())


@pytest.mark.parametrize(
    ("method", "scale", "words"),
    [
        ("imu", ([np.degrees(1.0)] * 3, [1.0] * 3), "unit is degrees a second"),
        ("imu", ([1.0] * 3, [1.0 / 9.81] * 3), "acceleration at rest is 1.00; its unit is g"),
        ("imu", ([1.0] * 3, [1e3 / 9.81] * 3), "its unit is mg"),
        ("imu", ([1.0] * 3, [3.0] * 3), "acceleration at rest is 29.4 m/s"),
    ],
)
def test_wrong_units_of_an_imu_are_named(
    method: str, scale: Any, words: str, drive: Drive, tmp_path: Path
) -> None:
    def turn(before: Any, t_s: float, gyro: Any, accel: Any) -> Any:
        return before(t_s, gyro * scale[0], accel * scale[1])

    with pytest.raises(RecordingError, match=words):
        study(tmp_path, change(drive, method, turn))


@pytest.mark.parametrize(
    ("by", "words"),
    [
        ((1e3, 1.0), "the wheels drove .* times as far.*they look like mm"),
        ((1.0, np.degrees(1.0)), "their yaw rate is in degrees a second"),
        ((1.0, -1.0), "turn to the right where .* turns to the left; left and right are swapped"),
    ],
)
def test_wrong_units_of_the_odometry_are_named(
    by: tuple[float, float], words: str, drive: Drive, tmp_path: Path
) -> None:
    with pytest.raises(RecordingError, match=words):
        study(
            tmp_path,
            change(drive, "odometry", lambda before, t, v, w: before(t, v * by[0], w * by[1])),
        )


@pytest.mark.parametrize(
    ("factor", "words"),
    [(1e7, "looks like units of 1e-7 degrees"), (np.pi / 180.0, "are radians: the wheels drove")],
)
def test_wrong_units_of_a_place_are_named(
    factor: float, words: str, drive: Drive, tmp_path: Path
) -> None:
    def turn(before: Any, fix: Any) -> Any:
        place = (fix.lat_deg * factor, fix.lon_deg * factor)
        return before(msgspec.structs.replace(fix, lat_deg=place[0], lon_deg=place[1]))

    with pytest.raises(RecordingError, match=words):
        study(tmp_path, change(drive, "fix", turn))


def test_two_receivers_on_one_topic_are_noted_and_one_is_used(drive: Drive, tmp_path: Path) -> None:
    ros = Messages(drive, ros1_store())
    other = []
    for t_s, topic, kind, message in ros.list():
        if topic == "/fix" and t_s < 30.0:
            message.header.frame_id = "gps_2"
            message.latitude += 1e-4
            other.append((t_s + 0.05, topic, kind, message))
    taken = study(tmp_path, sorted([*ros.list(), *other], key=lambda each: each[0]))
    assert any(
        "two receivers on one topic (100 of gps, 75 of gps_2)" in note for note in taken.facts.notes
    )


def test_two_receivers_of_two_topics_are_noted_and_one_is_used(
    messages: list[Message], tmp_path: Path
) -> None:
    second = [(t, "/fix_2", k, m) for t, topic, k, m in messages if topic == "/fix"]
    both = sorted([*messages, *second[::2]], key=lambda each: each[0])
    taken = study(tmp_path, both)
    assert "gnss: /fix is used, /fix_2 could be (--gnss)" in taken.facts.notes


def test_a_file_that_was_cut_off_is_read_up_to_there(
    messages: list[Message], tmp_path: Path
) -> None:
    drives.write_ros1(tmp_path / "whole.bag", messages)
    data = (tmp_path / "whole.bag").read_bytes()
    (tmp_path / "cut.bag").write_bytes(data[: len(data) * 3 // 4])
    try:
        taken = open_study([tmp_path / "cut.bag"], StudyOptions())
    except RecordingError as error:
        assert "cut off" in str(error)
    else:
        assert any("no index" in note for note in taken.facts.notes)


def test_an_option_that_contradicts_gravity_is_refused_with_what_was_found(
    drive: Drive, tmp_path: Path
) -> None:
    turned = make_drive(duration_s=DURATION_S, body_from_imu=drives.rotation_deg(90.0, 0.0, 0.0))
    messages = Messages(turned, ros1_store()).list()
    with pytest.raises(ConfigError, match=r"--imu-rpy-deg 0,0,0: .* by the log it is 90,0,0"):
        study(tmp_path, messages, imu_rpy_deg=(0.0, 0.0, 0.0))
    assert study(tmp_path, messages, imu_rpy_deg=(90.0, 0.0, 0.0)).mount.how == "as stated"


def test_memory_does_not_grow_with_the_number_of_messages(drive: Drive) -> None:
    from agribot.app.localization.log import LogEntry
    from agribot.core.messages import ImuSample
    from agribot.description.loader import load_robot

    sample = ImuSample(t_s=0.0, gyro_radps=(0.0, 0.0, 0.0), accel_mps2=(0.0, 0.0, 9.81))
    most = 0
    held = 0

    def make() -> Any:
        nonlocal held
        for index in range(20_000):
            held += 1
            yield LogEntry("imu", index * 0.01, index * 0.01, "", sample)

    scan = LogScan(load_robot().drive)
    for entry in order_by_stamp(make()):
        held -= 1
        most = max(most, held)
        scan.note(entry)
        scan.add(entry)
    assert most <= 203  # two seconds


def test_a_filter_that_never_starts_is_a_report_that_says_why(
    messages: list[Message], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two fixes say no heading, and no place that could not be wrong."""
    fixes = [each for each in messages if each[1] == "/fix"]
    few = [each for each in messages if each[1] != "/fix" and each[0] < 8.0] + fixes[:2]
    drives.write_ros1(tmp_path / "a.bag", sorted(few, key=lambda each: each[0]))
    out = tmp_path / "out"
    assert (
        main(["localize", str(tmp_path / "a.bag"), "--out", str(out), "--gnss", "/fix", "--json"])
        == 1
    )
    line = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert line["started_after_s"] is None and line["rms_to_fixes_m"] is None
    assert line["reason"] == f"never started: {render(NoFixesYet())}"
    assert "Not localized" in (out / "report.html").read_text()
