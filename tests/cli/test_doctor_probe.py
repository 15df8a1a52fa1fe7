"""The doctor opens devices that are free, and says how to run a robot with those that answer."""

from __future__ import annotations

import datetime as dt
import errno
import itertools
import json
import os
import shlex
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from agribot.cli.doctor import doctor_probe
from agribot.cli.doctor.doctor_probe import DeviceProbe
from agribot.cli.main import main
from agribot.core import config
from agribot.drivers.probe.camera_probe import CameraAnswer
from agribot.drivers.probe.gpsd_probe import GpsdState
from tests.cli.parser_tree import every_parser
from tests.cli.test_board import LinesThenFrames, living
from tests.drivers import receiver_bytes as written
from tests.drivers.board_emulator import BoardEmulator
from tests.drivers.device_tree import link, plug_camera, plug_serial, put
from tests.drivers.lines import Line
from tests.drivers.test_line_holders import held
from tests.drivers.test_udev_names import CH340, MEGA

pytest.importorskip("serial", reason="pyserial is missing (pip install -e '.[hardware]')")


class Desk:
    """A computer with lines to devices that live; its probe's time passes as it is asked for."""

    def __init__(self, root: Path) -> None:
        self.root, self._lines = root, list[Line]()
        self._ticks = itertools.count()

    def plug(self, name: str, usb: str) -> Line:
        plug_serial(self.root, name, usb)
        folder = self.root / "lines" / name
        folder.mkdir(parents=True)
        line = Line(folder)
        self._lines.append(line)
        (self.root / "dev" / name).unlink()
        (self.root / "dev" / name).symlink_to(line.path)
        return line

    def probe(self, **more: Any) -> DeviceProbe:
        return DeviceProbe(self.root, now_s=lambda: next(self._ticks) * 0.02, **more)

    def close(self) -> None:
        for line in self._lines:
            line.unplug()


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Desk]:
    desk = Desk(tmp_path)
    yield desk
    desk.close()


def live_as_motor_board() -> Callable[[bytes], bytes]:
    board = BoardEmulator()

    def live(data: bytes) -> bytes:
        board.feed(data)
        return board.advance()

    return live


def live_as_receiver() -> Callable[[bytes], bytes]:
    epochs = itertools.count()

    def live(_: bytes) -> bytes:
        at = written.EPOCH + next(epochs) * dt.timedelta(seconds=1)
        return written.make_ubx_pvt(at) + written.make_ubx_sky(at)

    return live


def test_two_megas_and_a_receiver_are_told_apart_and_make_a_robot(desk: Desk) -> None:
    lines = [desk.plug(f"ttyACM{k}", usb) for k, usb in enumerate(["2341:0042", "2341:0042"])]
    receiver = desk.plug("ttyACM2", "1546:01a9")
    for k in range(3):
        link(desk.root, f"dev/serial/by-path/usb-0:{k}", f"../../ttyACM{k}")
    probe = desk.probe()
    with (
        living(lines[0], LinesThenFrames().live),
        living(lines[1], live_as_motor_board()),
        living(receiver, live_as_receiver()),
    ):
        found = {finding.what: finding for finding in probe.check_lines()}
    assert {finding.state for finding in found.values()} == {"ok"}
    imu, motor, gnss = (
        f"serial:/dev/serial/by-path/usb-0:{k}{option}"
        for k, option in ((0, "?baud=250000&board=agribot"), (1, ""), (2, ""))
    )
    assert "imu board, firmware 1.2.3" in found["at /dev/ttyACM0"].detail
    assert f"--source 'imu={imu}'" in found["at /dev/ttyACM0"].detail
    assert f"agribot gnss configure {gnss} --rate 10" in found["at /dev/ttyACM2"].detail
    command, lacks = probe.write_command()
    assert lacks == ""
    words = [word for word in shlex.split(command) if word != "--ui"]
    assert words[:3] == ["agribot", "run", "hardware"]
    assert words[3:] == [
        "--source", f"base={motor}", "--source", f"imu={imu}", "--source", f"gnss={gnss}",
    ]  # fmt: skip


def test_the_command_is_one_that_there_is(desk: Desk) -> None:
    plug_camera(desk.root, "video0", "HD Camera")
    probe = desk.probe(gpsd=GpsdState(release="3.22", paths=("/dev/ttyACM9",)))
    taken = CameraAnswer(width_px=640, height_px=480, stated_hz=30.0, rate_hz=15.0)
    (finding,) = probe.check_cameras(lambda path: taken)
    assert "640 x 480 px, 15.0 Hz measured, 30 by its driver" in finding.detail
    command, lacks = probe.write_command()
    assert lacks == "a motor board"
    words = shlex.split(command)
    options = every_parser()["run",].parse_args(words[2:])
    assert options.source == ["gnss=gpsd:", "camera=v4l2:/dev/video0"]
    settings = config.load(
        options.profile, [*options.set, *(f"sources.{s}" for s in options.source)]
    )
    assert settings.platform == "hardware" and settings.perception.enabled


def test_a_line_that_another_program_has_is_left_alone_with_its_name(desk: Desk) -> None:
    line = desk.plug("ttyUSB0", "1a86:7523")
    with held(line.path) as process:
        (finding,) = desk.probe(open_line=refuse_to_open).check_lines()
    assert finding.state == "warning"
    assert f"process {process}" in finding.detail and "left alone" in finding.detail


def refuse_to_open(path: str, baud: int) -> Any:
    raise AssertionError(f"{path} was opened")


def test_a_line_of_gpsd_is_left_to_it_though_it_is_closed_just_now(desk: Desk) -> None:
    desk.plug("ttyACM0", "1546:01a9")
    gpsd = GpsdState(release="3.22", paths=("/dev/ttyACM0",))
    probe = desk.probe(open_line=refuse_to_open, gpsd=gpsd)
    (finding,) = probe.check_lines()
    assert finding.state == "ok" and "--source gnss=gpsd:" in finding.detail
    assert "gnss=gpsd:" in probe.write_command()[0]


def test_a_line_that_is_locked_by_whom_nobody_sees_is_told(desk: Desk) -> None:
    desk.plug("ttyUSB0", "1a86:7523")

    def be_busy(path: str, baud: int) -> Any:
        raise OSError(errno.EBUSY, os.strerror(errno.EBUSY))

    (finding,) = desk.probe(open_line=be_busy).check_lines()
    assert finding.state == "warning" and "another program may have it" in finding.detail


def test_a_silent_line_hears_nothing_and_makes_nobody_ill(desk: Desk) -> None:
    line = desk.plug("ttyUSB0", "1a86:7523")
    probe = desk.probe()
    (finding,) = probe.check_lines()
    assert finding.state == "missing" and "silent" in finding.detail
    assert probe.write_command() == ("", "a motor board and a receiver")
    assert "--ask /dev/ttyUSB0" in finding.detail
    assert line.hear() == b""


def test_a_line_that_is_to_be_asked_and_is_not_there_is_told(desk: Desk) -> None:
    (finding,) = desk.probe(ask=["/dev/ttyAMA7"]).check_lines()
    assert (finding.what, finding.state) == ("at /dev/ttyAMA7", "warning")


def test_without_the_package_for_lines_that_is_said_and_nothing_opened(
    desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    desk.plug("ttyUSB0", "1a86:7523")
    monkeypatch.setattr("agribot.core.extras.has", lambda extra: False)
    (finding,) = desk.probe(open_line=refuse_to_open).check_lines()
    assert finding.state == "missing" and "[hardware]" in finding.detail


def test_the_rules_name_each_board_by_what_it_said_it_is(desk: Desk) -> None:
    imu, motor = desk.plug("ttyUSB0", "1a86:7523"), desk.plug("ttyACM0", "2341:0042")
    for name, number, database in (("ttyUSB0", "188:0", CH340), ("ttyACM0", "166:0", MEGA)):
        put(desk.root, f"sys/devices/usb1/{name}/1-1:1.0/tty/{name}/dev", number)
        put(desk.root, f"run/udev/data/c{number}", database)
    probe = desk.probe()
    with living(imu, LinesThenFrames().live), living(motor, live_as_motor_board()):
        assert len(list(probe.check_lines())) == 2
    rules = {rule.rpartition("=")[2]: rule for rule in probe.write_rules()}
    assert "55330313735351910141" in rules['"agribot-motor"']
    assert "platform-3f980000.usb-usb-0:1.4:1.0" in rules['"agribot-imu"']


def test_a_camera_that_gives_no_picture_is_told_with_the_reason(desk: Desk) -> None:
    plug_camera(desk.root, "video0", "HD Camera")

    def fail(path: str) -> CameraAnswer:
        raise OSError("gives no picture")

    (finding,) = desk.probe().check_cameras(fail)
    assert finding.state == "warning" and "gives no picture" in finding.detail


def test_pictures_are_taken_by_opencv(tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2", reason="pip install -e '.[camera]'")
    import numpy as np

    from agribot.drivers.probe.camera_probe import probe_camera

    path = str(tmp_path / "pictures.avi")
    writer = cv2.VideoWriter(path, cv2.VideoWriter_fourcc(*"MJPG"), 20.0, (64, 48))
    for k in range(12):
        writer.write(np.full((48, 64, 3), 20 * k, np.uint8))
    writer.release()
    answer = probe_camera(path)
    assert (answer.width_px, answer.height_px, answer.stated_hz) == (64, 48, 20.0)
    assert answer.rate_hz > 0.0
    with pytest.raises(OSError, match="no picture"):
        probe_camera(str(tmp_path / "absent.avi"))


@pytest.fixture
def quiet_doctor(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("AGRIBOT_HOME", str(tmp_path / "home"))
    monkeypatch.setattr("agribot.cli.doctor.doctor._list_checks", lambda is_full: iter(()))
    monkeypatch.setattr("agribot.drivers.probe.gpsd_probe.ask_gpsd", lambda: None)


def test_the_command_line_prints_the_rules_or_all_of_it_as_json(
    desk: Desk, quiet_doctor: None, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    line = desk.plug("ttyACM0", "2341:0042")
    put(desk.root, "sys/devices/usb1/ttyACM0/1-1:1.0/tty/ttyACM0/dev", "166:0")
    put(desk.root, "run/udev/data/c166:0", MEGA)
    monkeypatch.setattr(doctor_probe, "DeviceProbe", desk.probe)
    with living(line, live_as_motor_board()):
        assert main(["doctor", "--probe", "--udev"]) == 0
        out, told = capsys.readouterr()
        assert 'SYMLINK+="agribot-motor"' in out and out.count("\n") == 1
        assert "71-agribot-boards.rules" in told and "listening at 250000 baud" in told
        assert "a robot needs a receiver" in told
        assert main(["doctor", "--probe", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["probe"]
    assert found["devices"][0]["answer"]["kind"] == "motor board"
    assert found["devices"][0]["source"] == "base=serial:/dev/ttyACM0"
    assert found["udev_rules"] == [out.strip()]
    assert found["command"].startswith("agribot run hardware ")
    assert "agribot calibrate motors" in told
    assert main(["calibrate", "motors", "--counts-per-turn=2048", "--full-speed-rpm=80"]) == 0
    capsys.readouterr()
    with living(line, live_as_motor_board()):
        assert main(["doctor", "--probe"]) == 0
    assert "agribot calibrate motors" not in capsys.readouterr().err


@pytest.mark.parametrize("words", [["--udev"], ["--ask", "/dev/ttyAMA0"]])
def test_what_only_a_probe_can_do_is_refused_without_one(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["doctor", *words]) == 2
    assert "add --probe" in capsys.readouterr().err
