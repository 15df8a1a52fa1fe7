"""A real gpsd between receiver and robot: nothing is lost, mixed up, or better than it is."""

from __future__ import annotations

import contextlib
import datetime as dt
import itertools
import random
import socket
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from agribot.core.messages import GnssFix, GnssQuality, GnssStatus
from agribot.drivers.gnss.gpsd import write_watch
from agribot.drivers.gnss.nmea import write_sentence
from agribot.drivers.gnss.receiver import GpsdDecoder
from agribot.drivers.line.byte_streams import TcpStream
from tests import machine
from tests.drivers import receiver_bytes as written
from tests.drivers.gpsd_daemon import Daemon
from tests.drivers.lines import Line, Opened, free_port, is_open
from tests.waiting import wait_for

pytestmark = machine.needs("gpsd")
STEP = dt.timedelta(milliseconds=200)
Speak = Callable[[dt.datetime], bytes]


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[Daemon]:
    with Daemon(tmp_path) as daemon:
        yield daemon


@contextmanager
def speaking(*lines: tuple[Line, Speak]) -> Iterator[None]:
    """Let receivers speak, epoch by epoch, until the end of the context."""
    ended = threading.Event()

    def run() -> None:
        start = dt.datetime.now(dt.UTC).replace(microsecond=0)
        for k in itertools.count():
            if ended.wait(0.05):
                return
            for line, speak in lines:
                line.blurt(speak(start + k * STEP))

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def speak_nmea(at: dt.datetime, quality: int = 4, std_m: float = 0.02) -> bytes:
    sky = write_sentence("GPGSV,1,1,02,05,71,210,44,07,15,033,38")
    used = write_sentence("GPGSA,A,3,05,07,,,,,,,,,,,1.8,0.9,1.5")
    return b"".join(written.make_nmea(at, quality=quality, std_m=std_m)) + used + sky


@pytest.mark.parametrize(
    ("speak", "quality", "std_m"),
    [
        (speak_nmea, GnssQuality.RTK_FIXED, 0.02),
        (lambda at: speak_nmea(at, 5, 0.4), GnssQuality.RTK_FLOAT, 0.4),
        (lambda at: speak_nmea(at, 1, 1.7), GnssQuality.SINGLE, 1.7),
        (lambda at: written.make_ubx_pvt(at, h_acc_m=1.4), GnssQuality.SINGLE, 1.4 / 2**0.5),
        (
            lambda at: written.make_ubx_pvt(at, carrier=2, h_acc_m=0.014),
            GnssQuality.RTK_FIXED,
            0.014 / 2**0.5,
        ),
        (
            lambda at: written.make_ubx_pvt(at, carrier=1, h_acc_m=0.3),
            GnssQuality.RTK_FLOAT,
            0.3 / 2**0.5,
        ),
    ],
)
def test_every_epoch_comes_once_with_accuracy_and_state_of_the_carrier(
    speak: Speak, quality: GnssQuality, std_m: float, line: Line, opened: Opened, daemon: Daemon
) -> None:
    daemon.start(line.path)
    source = opened.open("gnss", f"gpsd://127.0.0.1:{daemon.port}")
    with speaking((line, speak)):
        fixes: list[GnssFix] = opened.wait_for(source, 12)
    assert {fix.quality for fix in fixes[2:]} == {quality}
    assert fixes[-1].pos_std_m == pytest.approx(std_m, rel=0.2)
    assert fixes[-1].lat_deg == pytest.approx(written.LAT_DEG, abs=2e-7)
    assert fixes[-1].alt_m == pytest.approx(written.ALT_M + written.GEOID_M, abs=0.1)
    times_s = [fix.t_s for fix in fixes]
    assert times_s == sorted(set(times_s))


def test_satellites_and_dilutions_come_through(line: Line, opened: Opened, daemon: Daemon) -> None:
    daemon.start(line.path)
    source = opened.open("gnss", f"gpsd://127.0.0.1:{daemon.port}")
    with speaking((line, speak_nmea)):

        def find() -> GnssStatus | None:
            states: list[GnssStatus] = opened.take(source, "gnss_status")
            return next((status for status in states if status.satellites), None)

        status = wait_for(find, "satellites")
    names = [(each.system, each.number, each.is_used) for each in status.satellites]
    assert names == [("GP", 5, True), ("GP", 7, True)]
    assert status.hdop == pytest.approx(0.9)


def search_in_nmea(at: dt.datetime) -> bytes:
    time = at.strftime("%H%M%S.00")
    told = (
        f"GPRMC,{time},V,,,,,,,{at:%d%m%y},,,N", f"GPGGA,{time},,,,,0,00,99.99,,,,,,",
        "GPGSA,A,1,,,,,,,,,,,,,99.99,99.99,99.99", "GPGSV,1,1,02,05,71,210,44,07,15,033,38",
    )  # fmt: skip
    return b"".join(write_sentence(body) for body in told)


@pytest.mark.parametrize("search", [search_in_nmea, written.make_ubx_searching])
def test_satellites_come_through_while_the_receiver_searches(
    search: Speak, line: Line, opened: Opened, daemon: Daemon
) -> None:
    daemon.start(line.path)
    source = opened.open("gnss", f"gpsd://127.0.0.1:{daemon.port}")
    fixes: list[GnssFix] = []
    with speaking((line, search)):

        def find() -> GnssStatus | None:
            states: list[GnssStatus] = opened.take(source, "gnss_status")
            fixes.extend(opened.take(source))
            return next((status for status in states if len(status.satellites) > 1), None)

        status = wait_for(find, "satellites")
    assert fixes == []
    assert ("GP", 5, False) in [(s.system, s.number, s.is_used) for s in status.satellites]


def test_an_unplugged_receiver_comes_back_through_gpsd_under_another_name(
    line: Line, tmp_path: Path, opened: Opened, daemon: Daemon
) -> None:
    daemon.start(line.device)
    source = opened.open("gnss", f"gpsd://127.0.0.1:{daemon.port}")
    with speaking((line, speak_nmea)):
        opened.wait_for(source, 3)
    (tmp_path / "again").mkdir()
    again = Line(tmp_path / "again")
    daemon.tell("-", line.device)
    line.unplug()
    assert daemon.tell("+", again.device)

    def find_moved() -> bool:
        return any(fix.lat_deg < 50.0 for fix in opened.take(source))

    with speaking((again, lambda at: b"".join(written.make_nmea(at, lat_deg=48.0, quality=1)))):
        wait_for(find_moved, "fixes of the receiver that came back")
    daemon.stop()  # it would open the terminal of that number again, which is another test's then
    again.unplug()


@pytest.mark.parametrize("speak", [speak_nmea, lambda at: written.make_ubx_pvt(at, carrier=2)])
def test_ten_epochs_a_second_come_all_of_them_once_with_the_times_that_they_have(
    speak: Speak, line: Line, daemon: Daemon
) -> None:
    daemon.start(line.path)
    decoder, stamps_s = GpsdDecoder(pytest.fail), list[float]()
    stream = TcpStream("127.0.0.1", daemon.port)
    stream.write(write_watch())

    def hear() -> bool:
        stamps_s.extend(
            s for s, sample in decoder.feed(stream.read()) if isinstance(sample, GnssFix)
        )
        return bool(stamps_s)

    begin = dt.datetime.now(dt.UTC).replace(microsecond=0)
    with speaking((line, lambda at: speak(begin))):  # until gpsd knows what the receiver speaks
        wait_for(hear, "the first fix")
    first_s, tenth = begin.timestamp(), dt.timedelta(seconds=0.1)
    for k in range(1, 81):
        line.say(speak(begin + k * tenth))
        hear()
        time.sleep(0.02)
    # The start of the next epoch ends an epoch; after the 80th there is no next one.
    wait_for(lambda: hear() and stamps_s[-1] > first_s + 7.85, "the last but one")
    stream.close()
    wanted = [first_s + 0.1 * k for k in range(len(stamps_s))]
    assert len(stamps_s) >= 80
    assert stamps_s == pytest.approx(wanted, abs=2e-3)


def test_a_receiver_of_the_network_is_read_through_gpsd(opened: Opened, daemon: Daemon) -> None:
    ended = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            line, _ = server.accept()
            at = dt.datetime.now(dt.UTC).replace(microsecond=0)
            with line, contextlib.suppress(OSError):
                for k in itertools.count():
                    if ended.wait(0.05):
                        return
                    line.sendall(written.make_ubx_pvt(at + k * STEP, carrier=2, h_acc_m=0.014))

        receiver = threading.Thread(target=serve)
        receiver.start()
        try:
            daemon.start(f"tcp://127.0.0.1:{server.getsockname()[1]}")
            source = opened.open("gnss", f"gpsd://127.0.0.1:{daemon.port}")
            fixes: list[GnssFix] = opened.wait_for(source, 8)
        finally:
            ended.set()
            receiver.join()
    assert {fix.quality for fix in fixes} == {GnssQuality.RTK_FIXED}
    assert fixes[-1].lat_deg == pytest.approx(written.LAT_DEG, abs=2e-7)


@pytest.fixture
def open_line() -> Iterator[Line]:
    """A line whose name a daemon finds that has given up its rights, too."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        line = Line(Path(folder))
        yield line
        line.unplug()


def test_a_named_receiver_that_was_unplugged_is_read_again_under_its_name(
    open_line: Line, opened: Opened, daemon: Daemon
) -> None:
    line, name = open_line, open_line.path
    daemon.start(name)
    source = opened.open("gnss", f"gpsd://127.0.0.1:{daemon.port}{name}")
    with speaking((line, speak_nmea)):
        opened.wait_for(source, 3)
    assert daemon.tell("-", name)
    line.unplug()
    line.plug_in()
    assert daemon.tell("+", name)

    def find_moved() -> bool:
        return any(fix.lat_deg < 50.0 for fix in opened.take(source))

    with speaking((line, lambda at: b"".join(written.make_nmea(at, lat_deg=48.0, quality=1)))):
        wait_for(find_moved, "fixes of the receiver that came back")


def test_a_gpsd_that_ends_and_is_started_again_is_told_and_read_again(
    line: Line, opened: Opened, daemon: Daemon
) -> None:
    daemon.start(line.path)
    source = opened.open("gnss", f"gpsd://127.0.0.1:{daemon.port}")
    with speaking((line, speak_nmea)):
        opened.wait_for(source, 3)
        daemon.stop()
        wait_for(lambda: any("is lost" in text for text in opened.told), "the loss")
        daemon.start(line.path)
        wait_for(lambda: any("is back" in text for text in opened.told), "the return")
        opened.wait_for(source, 3)


def test_garbage_on_the_line_makes_no_other_fix(line: Line, opened: Opened, daemon: Daemon) -> None:
    rng = random.Random(1)
    daemon.start(line.path)
    source = opened.open("gnss", f"gpsd://127.0.0.1:{daemon.port}")

    def speak(at: dt.datetime) -> bytes:
        sentences = bytearray(speak_nmea(at))
        sentences[rng.randrange(len(sentences))] ^= 1 << rng.randrange(8)
        return rng.randbytes(rng.randrange(20)) + bytes(sentences)

    with speaking((line, speak)):
        fixes: list[GnssFix] = opened.wait_for(source, 10)
    for fix in fixes:
        assert fix.lat_deg == pytest.approx(written.LAT_DEG, abs=2e-7)
        assert fix.lon_deg == pytest.approx(written.LON_DEG, abs=2e-7)


@pytest.mark.parametrize("chosen", [0, 1])
def test_of_two_receivers_of_one_gpsd_the_chosen_one_is_read(
    chosen: int, tmp_path: Path, opened: Opened, daemon: Daemon
) -> None:
    folders = tmp_path / "a", tmp_path / "b"
    for folder in folders:
        folder.mkdir()
    near, far = (Line(folder) for folder in folders)
    daemon.start(near.path, far.path)
    device = (near, far)[chosen].path
    source = opened.open("gnss", f"gpsd://127.0.0.1:{daemon.port}{device}")

    def speak_far(at: dt.datetime) -> bytes:
        return b"".join(written.make_nmea(at, lat_deg=48.0, quality=1))

    with speaking((near, speak_nmea), (far, speak_far)):
        fixes: list[GnssFix] = opened.wait_for(source, 8)
    lat_deg = (written.LAT_DEG, 48.0)[chosen]
    assert all(fix.lat_deg == pytest.approx(lat_deg, abs=2e-7) for fix in fixes)
    daemon.stop()
    for line in (near, far):
        line.unplug()


@machine.needs("gpsfake")
def test_a_log_of_a_receiver_is_played_by_gpsfake(tmp_path: Path, opened: Opened) -> None:
    log, port = tmp_path / "drive.ubx", free_port()
    at = dt.datetime.now(dt.UTC).replace(microsecond=0)
    log.write_bytes(b"".join(written.make_ubx_pvt(at + k * STEP) for k in range(200)))
    words = [machine.require("gpsfake"), "-q", "-P", str(port), "-c", "0.05", str(log)]
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as player:
        try:
            wait_for(lambda: is_open(port), "gpsd")
            source = opened.open("gnss", f"gpsd://127.0.0.1:{port}")
            fixes: list[GnssFix] = opened.wait_for(source, 5)
        finally:
            player.terminate()
    assert fixes[-1].pos_std_m == pytest.approx(1.4 / 2**0.5, rel=0.1)
