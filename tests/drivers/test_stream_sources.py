"""Sensors on lines that break, and on a real gpsd."""

from __future__ import annotations

import datetime as dt
import socket
import subprocess
import threading
from pathlib import Path

import pytest

from agribot.cli.main import main
from agribot.core.messages import GnssFix, GnssQuality
from tests import machine
from tests.drivers import receiver_bytes as written
from tests.drivers.lines import Line, Opened, free_port, is_open, speak_ubx
from tests.waiting import wait_for

pytest.importorskip("serial", reason="pyserial is missing (pip install -e '.[hardware]')")
IMU_LINE = b"A0B0C16384D0E0F131G\r\n"


def test_fixes_come_over_a_serial_line(line: Line, opened: Opened) -> None:
    source = opened.open("gnss", f"serial:{line.path}?baud=115200")
    speak_ubx(line.say)
    fix = opened.wait_for(source)[0]
    assert isinstance(fix, GnssFix)
    assert fix.quality is GnssQuality.RTK_FIXED
    assert fix.lat_deg == pytest.approx(written.LAT_DEG, abs=1e-7)
    assert opened.told == []


def test_an_unplugged_receiver_is_told_once_and_read_again_when_it_is_back(
    line: Line, opened: Opened
) -> None:
    source = opened.open("gnss", f"serial:{line.path}")
    speak_ubx(line.say)
    opened.wait_for(source)
    line.unplug()
    wait_for(lambda: any("is lost" in text for text in opened.told), "the loss")
    line.plug_in()
    wait_for(lambda: any("is back" in text for text in opened.told), "the return")
    speak_ubx(line.say, first=100)
    opened.wait_for(source)
    assert len(opened.told) == 2


def test_the_originals_arduino_is_an_imu(line: Line, opened: Opened) -> None:
    source = opened.open("imu", f"serial:{line.path}?baud=57600&axes=x,-y,-z")
    line.say(b"\xff\xfe\x00" + IMU_LINE * 3)
    sample = opened.wait_for(source)[0]
    assert sample.accel_mps2[2] == pytest.approx(-9.80665)


def test_bytes_over_tcp_come_again_after_the_other_end_was_gone(opened: Opened) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        source = opened.open("gnss", f"tcp://127.0.0.1:{port}")
        for first in (0, 100):
            peer, _ = server.accept()
            with peer:
                speak_ubx(peer.sendall, first)
                opened.wait_for(source)
        wait_for(lambda: any("is back" in text for text in opened.told), "the return")


@pytest.mark.parametrize(
    ("uri", "why"),
    [
        ("gnss=serial:/dev/nothing", "plugged in"),
        ("gnss=serial:{path}?baud=fast", "baud=fast: out of range; give 300"),
        ("gnss=serial:{path}?bauds=9600", "unknown option 'bauds'; did you mean 'baud'"),
        ("mag=serial:{path}", "not read from a line; give gnss or imu"),
        ("imu=serial:{path}?axes=x,y,-z", "mirror"),
        ("gnss=tcp://127.0.0.1", "HOST:PORT"),
        ("gnss=tcp://127.0.0.1:1", "Connection refused; check the host and the port"),
        ("gnss=tcp://nowhere.invalid:1", "check the host and the port"),
        ("gnss=gpsd://127.0.0.1:1", "gpsd 127.0.0.1:1: Connection refused; check the host"),
        ("imu=gpsd:", "receivers only"),
    ],
)
def test_a_device_that_cannot_be_read_is_refused_in_one_line(
    uri: str, why: str, line: Line, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["run", "farm", "--set", "perception.enabled=false", "--headless", "--for", "1"]
    source = uri.format(path=line.path)
    assert main([*words, "--source", source, "--out", str(tmp_path / "run")]) == 2
    told = capsys.readouterr().err.strip().splitlines()
    assert why in told[-1]


@machine.needs("gpsd")
@pytest.mark.parametrize("dialect", ["ubx", "nmea"])
def test_a_real_gpsd_gives_the_fixes_of_its_receiver(
    dialect: str, line: Line, opened: Opened
) -> None:
    gpsd = machine.require("gpsd")
    port = free_port()
    daemon = subprocess.Popen([gpsd, "-N", "-n", "-b", "-S", str(port), str(line.path)])
    ended = threading.Event()

    def feed() -> None:
        at = dt.datetime.now(dt.UTC).replace(microsecond=0)
        while not ended.wait(0.1):
            at += dt.timedelta(milliseconds=100)
            line.say(
                written.make_ubx_pvt(at)
                if dialect == "ubx"
                else b"".join(written.make_nmea(at, quality=4, std_m=0.02))
            )

    feeder = threading.Thread(target=feed)
    feeder.start()
    try:
        wait_for(lambda: is_open(port), "gpsd")
        source = opened.open("gnss", f"gpsd://127.0.0.1:{port}")
        fixes = [fix for fix in opened.wait_for(source, 5) if isinstance(fix, GnssFix)]
    finally:
        ended.set()
        feeder.join()
        daemon.terminate()
        daemon.wait()
    assert fixes[-1].lat_deg == pytest.approx(written.LAT_DEG, abs=2e-7)
    assert fixes[-1].lon_deg == pytest.approx(written.LON_DEG, abs=2e-7)
    assert fixes[-1].velocity_mps is not None
    speed_mps = 0.5
    assert sum(v * v for v in fixes[-1].velocity_mps) == pytest.approx(speed_mps**2, rel=0.05)
    if dialect == "nmea":
        assert fixes[-1].quality is GnssQuality.RTK_FIXED
        assert fixes[-1].pos_std_m == pytest.approx(0.02, rel=0.2)
    else:
        assert fixes[-1].pos_std_m == pytest.approx(1.4 / 2**0.5, rel=0.1)
