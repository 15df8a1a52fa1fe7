"""Corrections reach the receiver whole, whatever caster and line do; the login only its caster."""

from __future__ import annotations

import base64
import contextlib
import datetime as dt
import itertools
import math
import socket
import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from pynmeagps import NMEAReader
from pyrtcm import RTCMReader

from agribot.cli.main import main
from agribot.core.errors import ConfigError
from agribot.core.fact_text import render
from agribot.core.facts import AnyFact, CorrectionsCome, CorrectionsMissing
from agribot.core.geo import ecef_from_geodetic
from agribot.core.messages import DeviceNote, GnssFix, GnssQuality, GnssStatus
from agribot.drivers.gnss import ntrip, rtcm
from agribot.drivers.gnss.corrections import CorrectionLink, CorrectionTiming
from agribot.drivers.gnss.nmea import StampedFix, write_gga
from agribot.drivers.line import caster_login
from agribot.record.replay import read_ticks
from tests import machine
from tests.drivers import receiver_bytes as written
from tests.drivers.caster import (
    EXAMPLE,
    STATION,
    TABLE,
    YES,
    FakeCaster,
    Serve,
    chunk,
    make_empty_observation,
    make_observation,
    make_station,
)  # fmt: skip
from tests.drivers.lines import Line, Opened, free_port, is_open, speak_ubx
from tests.waiting import wait_for

LOGIN = caster_login.CasterLogin("farmer", "s3cret")
# The same waits as on a farm, only shorter.
PATIENT = CorrectionTiming(gga_period_s=0.02, stall_s=600, first_wait_s=0.01, longest_wait_s=0.05)
BRISK = PATIENT._replace(stall_s=0.4)
FIX = StampedFix(
    written.EPOCH.timestamp(),
    GnssFix(
        t_s=0.0, lat_deg=written.LAT_DEG, lon_deg=written.LON_DEG, alt_m=written.ALT_M,
        pos_std_m=1.0, quality=GnssQuality.SINGLE,
    ),
)  # fmt: skip
GGA = write_gga(FIX)


class Rover:
    """A receiver that takes corrections; `is_there` is false while it is unplugged."""

    def __init__(self) -> None:
        self.taken = bytearray()
        self.told: list[AnyFact] = []
        self.is_there = True
        self.fix: StampedFix | None = FIX

    def write(self, data: bytes) -> bool:
        if self.is_there:
            self.taken += data
        return self.is_there

    @contextmanager
    def fed_by(
        self, port: int, mount: str = "FARM", login: caster_login.CasterLogin | None = LOGIN,
        timing: CorrectionTiming = PATIENT,
    ) -> Iterator[CorrectionLink]:  # fmt: skip
        caster = ntrip.Caster("127.0.0.1", port, mount)
        link = CorrectionLink(caster, login, self.write, lambda: self.fix, self.notify, timing)
        try:
            yield link
        finally:
            link.close()

    def notify(self, fact: AnyFact) -> None:
        self.told.append(fact)

    def wait_for(self, data: bytes) -> None:
        wait_for(lambda: data in self.taken, f"{len(data)} bytes")

    def wait_told(self, why: str) -> None:
        wait_for(lambda: any(why in reason for reason in self.reasons), why)

    def wait_come(self, *, is_again: bool = False) -> None:
        wait_for(lambda: any(come.is_again is is_again for come in self.come), "corrections")

    @property
    def come(self) -> list[CorrectionsCome]:
        return [fact for fact in self.told if isinstance(fact, CorrectionsCome)]

    @property
    def reasons(self) -> list[str]:
        return [fact.why for fact in self.told if isinstance(fact, CorrectionsMissing)]


@contextmanager
def casting(*answers: Serve) -> Iterator[FakeCaster]:
    caster = FakeCaster(*answers)
    try:
        yield caster
    finally:
        caster.close()


def send(*parts: bytes, then: Callable[[socket.socket], None] | None = None) -> Serve:
    def serve(peer: socket.socket, _head: bytes) -> None:
        for part in parts:
            peer.sendall(part)
        if then is not None:
            then(peer)

    return serve


def test_a_message_of_the_standard_is_found_between_anything() -> None:
    decoder = rtcm.RtcmDecoder()
    data = b"\xd3\x00" + EXAMPLE + b"$GNGGA\xd3" + make_observation() + EXAMPLE[:9]
    found = [each for k in range(0, len(data), 7) for each in decoder.feed(data[k : k + 7])]
    assert [each.kind for each in found] == [1005, 1077]
    assert found[0].data == EXAMPLE and decoder.junk == 9
    assert RTCMReader.parse(found[0].data).identity == "1005"
    assert rtcm.make_message(EXAMPLE[3:-3]) == EXAMPLE


def test_the_place_of_a_base_is_read_as_others_read_it() -> None:
    for data in (EXAMPLE, STATION):
        message = rtcm.RtcmMessage(1005, data)
        other = RTCMReader.parse(data)
        base = rtcm.read_base(message)
        assert base is not None
        assert base.ecef_m == pytest.approx((other.DF025, other.DF026, other.DF027))
        assert (base.station, base.is_virtual) == (other.DF003, bool(other.DF141))
        assert rtcm.read_base(rtcm.RtcmMessage(1077, data)) is None
        assert rtcm.read_base(rtcm.RtcmMessage(1006, data[:15] + b"\0\0\0")) is None


def test_chunks_of_any_size_reach_the_receiver_as_whole_messages() -> None:
    stream = STATION + make_observation() + make_observation(1087)
    parts = [chunk(stream[k : k + 50]) for k in range(0, len(stream), 50)]
    body = b"".join([YES, b"Transfer-Encoding: chunked\r\n\r\n", *parts])
    rover = Rover()
    with casting() as caster:
        caster._answers = [
            send(*(body[k : k + 13] for k in range(0, len(body), 13)), then=caster.listen)
        ]
        with rover.fed_by(caster.port) as link:
            rover.wait_for(stream)
            assert rover.taken == stream
            wait_for(lambda: caster.heard.count(GGA) >= 2, "where the rover is, again and again")
            state = link.state()
    assert state.counts == {1005: 1, 1077: 1, 1087: 1}
    assert state.age_s is not None and state.age_s >= 0.0
    assert rover.told == [CorrectionsCome(f"127.0.0.1:{caster.port}/FARM", is_again=False)]
    (head,) = caster.requests
    assert head.startswith(b"GET /FARM HTTP/1.1\r\n") and b"Ntrip-Version: Ntrip/2.0" in head
    assert b"Ntrip-GGA: " + GGA.strip() in head
    assert base64.b64encode(b"farmer:s3cret") in head


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        (b"HTTP/1.1 401 Unauthorized\r\n\r\n", "refuses the login; check 'machine HOST login"),
        (b"ERROR - Bad Password\r\n", "refuses the login"),
        (b"HTTP/1.1 404 Not Found\r\n\r\n", "no mountpoint 'FRAM' now"),
        (b"SOURCETABLE 200 OK\r\n\r\n" + TABLE, "did you mean 'FARM'?; it has FARM, FARMVRS"),
        (
            b"HTTP/1.1 200 OK\r\nContent-Type: gnss/sourcetable\r\n\r\n" + TABLE,
            "no mountpoint 'FRAM'; did you mean 'FARM'?",
        ),
        (
            b"HTTP/1.1 200 OK\nContent-Type: gnss/sourcetable\n\n" + TABLE,
            "no mountpoint 'FRAM'; did you mean 'FARM'?",
        ),
        (
            b"HTTP/1.1 200 OK\r\nContent-Type: text/plain\r\n\r\n" + TABLE,
            "no mountpoint 'FRAM'; did you mean 'FARM'?",
        ),
        (
            b"HTTP/1.1 200 OK\r\nContent-Type: text/plain; charset=utf-8\r\n"
            b"Transfer-Encoding: chunked\r\n\r\n" + chunk(TABLE),
            "no mountpoint 'FRAM'; did you mean 'FARM'?",
        ),
        (
            b"HTTP/1.1 200 OK\r\nContent-Type: text/plain\r\n\r\nclosed for today\r\n",
            "the caster answers 'closed for today'",
        ),
        (
            b"HTTP/1.1 302 Found\r\nLocation: https://caster.example/\r\n\r\n",
            "sends on to 'https://caster.example/' ('HTTP/1.1 302 Found'); write the address of",
        ),
        (b"HTTP/1.1 301 Moved\r\n\r\n", "sends on, and does not say where to ('HTTP/1.1 301"),
        (b"HTTP/1.1 503 Full\r\n\r\n", "answers 'HTTP/1.1 503 Full'"),
        (b"SSH-2.0-OpenSSH_9.2\r\n", "no NTRIP caster; check host and port"),
        (b"HTTP/1.1 200 OK\r\nContent-Type: text/html\r\n\r\n<html>", "no NTRIP caster"),
        (
            YES + b"Transfer-Encoding: chunked\r\n\r\nxyz\r\n",
            "a chunk whose length is not a number",
        ),
        (YES + b"Transfer-Encoding: chunked\r\n\r\nffffffff\r\n", "the limit is 1048576"),
        (YES + b"\r\n" + b"\x55" * 3000, "3000 bytes came that are no RTCM 3"),
        (YES + b"\r\n", "nothing came for 0.4 s"),
        (b"", "closed the line without an answer"),
    ],
)
def test_a_caster_that_gives_no_corrections_is_told_once_with_what_to_do(
    answer: bytes, why: str
) -> None:
    rover = Rover()
    with casting() as caster:
        caster._answers = [send(answer, then=caster.listen if answer[:9] == YES[:9] else None)]
        with rover.fed_by(caster.port, "FRAM", timing=BRISK):
            rover.wait_told(why)
            wait_for(lambda: len(caster.requests) >= 3, "further tries")
    (reason,) = rover.reasons
    name = f"127.0.0.1:{caster.port}/FRAM"
    assert rover.told == [CorrectionsMissing(name, reason, is_lost=False)]
    assert not rover.taken and "s3cret" not in reason


@pytest.mark.parametrize(
    "head",
    [
        b"HTTP/1.1 200 OK\nContent-Type: gnss/data\n\n",
        b"HTTP/1.1 200 OK\r\nContent-Type: text/plain\r\n\r\n",
    ],
)
def test_corrections_come_behind_heads_that_are_not_by_the_book(head: bytes) -> None:
    rover, stream = Rover(), STATION + make_observation()
    with casting() as caster:
        whole = head + stream
        parts = (whole[k : k + 13] for k in range(0, len(whole), 13))
        caster._answers = [send(*parts, then=caster.listen)]
        with rover.fed_by(caster.port):
            rover.wait_for(stream)


def test_a_caster_that_hangs_up_in_the_head_of_a_redirect_is_told_as_one() -> None:
    answer = ntrip.AnswerDecoder(ntrip.Caster("localhost", 2101, "FARM"), has_login=False)
    assert answer.feed(b"HTTP/1.1 301 Moved\r\nServer: x\r\n") == b""
    with pytest.raises(ntrip.CasterRefusal, match=r"does not say where to \('HTTP/1.1 301 Moved"):
        answer.end()


def test_a_caster_that_wants_a_login_says_so_where_none_is_known() -> None:
    rover = Rover()
    with (
        casting(send(b"HTTP/1.1 401 Unauthorized\r\n\r\n")) as caster,
        rover.fed_by(caster.port, login=None),
    ):
        rover.wait_told("wants a login: 'machine HOST login USER password WORD' in ~/.netrc")
    assert b"Authorization" not in caster.requests[0]


def test_a_line_that_falls_silent_is_asked_for_again_and_told_twice() -> None:
    rover = Rover()
    with casting() as caster:
        quiet = send(YES, b"\r\n", STATION, make_observation(), then=caster.listen)
        caster._answers = [quiet, send(b""), quiet]
        with rover.fed_by(caster.port, timing=BRISK):
            rover.wait_told("nothing came for 0.4 s")
            rover.wait_come(is_again=True)
    name = f"127.0.0.1:{caster.port}/FARM"
    lost = CorrectionsMissing(name, rover.reasons[0], is_lost=True)
    assert rover.told[:2] == [CorrectionsCome(name, is_again=False), lost]


@pytest.mark.parametrize(("message", "kind"), [(STATION, 1005), (make_empty_observation(), 1074)])
def test_a_base_that_measures_no_satellite_gives_no_corrections(message: bytes, kind: int) -> None:
    def repeat(peer: socket.socket, _head: bytes) -> None:
        with contextlib.suppress(OSError):
            peer.sendall(b"ICY 200 OK\r\n\r\n")
            while not caster.ended.wait(0.02):
                peer.sendall(message)

    rover = Rover()
    with casting(repeat) as caster, rover.fed_by(caster.port, timing=BRISK) as link:
        rover.wait_told(f"the base reported itself only (RTCM {kind}) and measured no satellite")
        assert message in rover.taken, "the receiver needs it beside the measurements"
        assert link.state().age_s is None


@pytest.mark.parametrize("kind", [1004, 1012, 1071, 1074, 1087, 1097, 1127, 1137])
def test_an_observation_corrects_where_it_counts_a_satellite(kind: int) -> None:
    empty, full = rtcm.RtcmDecoder().feed(make_empty_observation(kind) + make_observation(kind))
    assert not rtcm.corrects_ranges(empty) and rtcm.corrects_ranges(full)


@pytest.mark.parametrize("accept", [b"*/*", b"rtk/rtcm, dgps/rtcm"])
@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize(
    "answer",
    [
        b"HTTP/1.1 403 Forbidden\r\nContent-Length: 0\r\n\r\n",
        b"HTTP/1.1 406 Not Acceptable\r\nContent-Length: 0\r\n\r\n",
        b"SOURCETABLE 200 OK\r\n\r\n" + TABLE,
    ],
    ids=["403", "406", "table"],
)
def test_a_caster_that_wants_another_form_of_the_request_gets_it(
    answer: bytes, version: int, accept: bytes
) -> None:
    def want(peer: socket.socket, head: bytes) -> None:
        is_wanted = b"HTTP/1.%d\r\n" % (version - 1) in head and b"Accept: %s\r\n" % accept in head
        if is_wanted:
            peer.sendall(b"ICY 200 OK\r\n\r\n" + STATION)
            caster.listen(peer)
        else:
            peer.sendall(answer)

    rover = Rover()
    with casting(want) as caster, rover.fed_by(caster.port):
        rover.wait_for(STATION)
    assert len(caster.requests) <= 4


@pytest.mark.parametrize(
    ("base", "why"),
    [
        (EXAMPLE, "stand at latitude 38.80, longitude -77.06, 5959 km from here; the limit is 200"),
        (make_station((0.0, 0.0, 0.0)), "inside of the Earth: its own place is not set"),
    ],
)
def test_a_base_that_stands_where_it_corrects_nothing_is_told_once_and_not_passed_on(
    base: bytes, why: str
) -> None:
    rover = Rover()
    with casting() as caster:
        caster._answers = [send(YES, b"\r\n", base, make_observation(), then=caster.listen)]
        with rover.fed_by(caster.port):
            rover.wait_told(why)
            wait_for(lambda: len(caster.requests) >= 3, "further tries")
            assert not rover.taken and len(rover.told) == 1
            caster._answers = [send(YES, b"\r\n", STATION, make_observation(), then=caster.listen)]
            rover.wait_come()
    assert rover.taken.startswith(STATION + make_observation())


def make_base(east_m: float = 0.0, *, is_virtual: bool = False) -> bytes:
    """Write message 1005 of a base that says to stand East of its place by a distance."""
    lat_deg, lon_deg = written.LAT_DEG + 0.03, written.LON_DEG - 0.03
    lon_deg += east_m / (111_320.0 * math.cos(math.radians(lat_deg)))
    ecef_m = ecef_from_geodetic(lat_deg, lon_deg, written.ALT_M)
    return make_station(ecef_m, is_virtual=is_virtual)


@pytest.mark.parametrize(
    ("east_m", "is_virtual", "is_passed_on"),
    [(0.01, False, True), (0.4, False, False), (0.4, True, True), (5000.0, False, True)],
)
def test_a_base_with_other_coordinates_than_in_the_last_run_is_not_passed_on(
    east_m: float, *, is_virtual: bool, is_passed_on: bool
) -> None:
    """Farther away it is another mast; a virtual one is put beside the receiver each time."""
    first, then = Rover(), Rover()
    with casting() as caster:
        for rover, base in (
            (first, make_base(is_virtual=is_virtual)),
            (then, make_base(east_m, is_virtual=is_virtual)),
        ):
            caster._answers = [send(YES, b"\r\n", base, make_observation(), then=caster.listen)]
            with rover.fed_by(caster.port):
                wait_for(lambda: len(rover.told) > 0, "an answer")  # noqa: B023
    assert first.come
    assert bool(then.come) is is_passed_on
    assert bool(then.taken) is is_passed_on
    if not is_passed_on:
        assert "-0.00 m north" in then.reasons[0] or "+0.00 m north" in then.reasons[0]
        assert f"{east_m:+.2f} m east of where it has stood" in then.reasons[0]


def test_measurements_of_a_base_too_far_away_wait_until_it_tells_another_place() -> None:
    rover = Rover()
    with casting() as caster:
        late = send(YES, b"\r\n", make_observation(), EXAMPLE, then=caster.listen)
        caster._answers = [late, late, send(YES, b"\r\n", make_observation(), then=caster.listen)]
        with rover.fed_by(caster.port):
            wait_for(lambda: len(caster.requests) >= 3, "a third try")
    assert rover.taken == make_observation(), "what came before the base sent its position"
    assert rover.come == rover.told[:1]


def test_a_base_is_believed_while_the_receiver_does_not_know_where_it_is() -> None:
    rover = Rover()
    rover.fix = None
    with casting() as caster:
        caster._answers = [send(YES, b"\r\n", EXAMPLE, make_observation(), then=caster.listen)]
        with rover.fed_by(caster.port):
            rover.wait_for(EXAMPLE + make_observation())


def test_a_host_that_can_be_none_is_told_and_asked_for_again() -> None:
    rover = Rover()
    caster = ntrip.Caster("caster..example", 2101, "FARM")
    link = CorrectionLink(caster, None, rover.write, lambda: None, rover.notify, PATIENT)
    try:
        rover.wait_told("'caster..example' can be no host's name")
    finally:
        link.close()


def test_an_old_caster_that_hangs_up_on_version_2_is_asked_in_version_1() -> None:
    def only_old(peer: socket.socket, head: bytes) -> None:
        if b"Ntrip/2.0" not in head:
            peer.sendall(b"ICY 200 OK\r\n\r\n" + STATION)
            caster.listen(peer)

    rover = Rover()
    with casting(only_old) as caster, rover.fed_by(caster.port):
        rover.wait_for(STATION)
    assert caster.requests[-1].startswith(b"GET /FARM HTTP/1.0\r\n")


def test_garbage_among_the_messages_never_reaches_the_receiver() -> None:
    broken = bytearray(make_observation())
    broken[40] ^= 1
    stream = b"\xd3junk" + STATION + bytes(broken) + b"\x00" * 50 + make_observation(1087)
    rover = Rover()
    with casting() as caster:
        caster._answers = [send(YES, b"\r\n", stream, then=caster.listen)]
        with rover.fed_by(caster.port):
            rover.wait_for(make_observation(1087))
    assert rover.taken == STATION + make_observation(1087)


def test_corrections_for_a_receiver_that_is_unplugged_are_no_corrections() -> None:
    rover = Rover()
    rover.is_there = False
    with casting() as caster:
        caster._answers = [send(YES, b"\r\n", STATION, then=caster.listen)]
        with rover.fed_by(caster.port, timing=BRISK) as link:
            wait_for(lambda: len(caster.requests) >= 2, "a second try")
            assert link.state().age_s is None and link.state().counts == {}
    assert not rover.come


@pytest.mark.parametrize("lat_deg", [52.15, -33.999999999, 0.0])
@pytest.mark.parametrize("lon_deg", [4.51, -151.2, 179.9999999999])
def test_the_place_that_a_caster_is_told_is_that_of_the_fix(lat_deg: float, lon_deg: float) -> None:
    at = written.EPOCH + dt.timedelta(seconds=0.5)
    from agribot.drivers.gnss.receiver_decoder import ReceiverDecoder

    ((stamp_s, fix), *_) = ReceiverDecoder(pytest.fail).feed(
        written.make_ubx_pvt(at, lat_deg=lat_deg, lon_deg=lon_deg, carrier=2)
    )
    parsed = NMEAReader.parse(write_gga(StampedFix(stamp_s, fix)))  # type: ignore[arg-type]
    assert parsed.lat == pytest.approx(lat_deg, abs=1e-7)
    assert parsed.lon == pytest.approx(lon_deg, abs=1e-7)
    assert (parsed.quality, parsed.time) == (4, at.time())
    assert parsed.alt == pytest.approx(written.ALT_M + written.GEOID_M)


@pytest.mark.parametrize(
    "uri",
    [
        "gnss=serial:{path}?ntrip=ntrip://farmer:s3cret@127.0.0.1:2101/FARM",
        "gnss=serial:{path}?ntrip=ntrip://farmer:s3cret%40127.0.0.1:2101/FARM",
        "gnss=serial:{path}?ntrip=ntrip://farmer:s3#cret@127.0.0.1:2101/FARM",
        "gnss=tcp://127.0.0.1:1?ntrip=farmer:s3cret@127.0.0.1/FARM",
    ],
)
def test_a_password_in_a_uri_is_refused_before_anything_is_written(
    uri: str, line: Line, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    words = ["run", "farm", "--headless", "--for", "1", "--out", str(out)]
    assert main([*words, "--source", uri.format(path=line.path)]) == 2
    told = capsys.readouterr().err
    assert "~/.netrc" in told and "s3" not in told and not out.exists()


@pytest.mark.parametrize(
    "text", ["ntrip://127.0.0.1", "http://a/b", "ntrip:///FARM", "ntrip://a:port/M", "a/M?x y"]
)
def test_what_names_no_mountpoint_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="write ntrip://HOST:PORT/MOUNTPOINT"):
        ntrip.read_caster(text)


def test_a_login_comes_from_the_environment_or_from_netrc(tmp_path: Path) -> None:
    assert caster_login.find_login("caster.example", {}, tmp_path) is None
    file = tmp_path / ".netrc"
    file.write_text("machine caster.example login farmer password s3cret\n")
    file.chmod(0o600)
    assert caster_login.find_login("caster.example", {}, tmp_path) == LOGIN
    assert caster_login.find_login("other.example", {}, tmp_path) is None
    told = {caster_login.LOGIN_VARIABLE: "me:a:b"}
    assert caster_login.find_login("caster.example", told, tmp_path) == caster_login.CasterLogin(
        "me", "a:b"
    )
    assert "s3cret" not in repr(LOGIN) + str(LOGIN)
    file.write_text("s3cret login machine\n")
    with pytest.raises(ConfigError, match="line 1") as refusal:
        caster_login.find_login("caster.example", {}, tmp_path)
    assert "s3cret" not in str(refusal.value)


@contextmanager
def str2str(*words: str) -> Iterator[None]:
    process = subprocess.Popen(
        [machine.require("str2str"), *words], stderr=subprocess.DEVNULL, stdin=subprocess.DEVNULL
    )
    try:
        yield
    finally:
        process.kill()
        process.wait()


def find_fed(states: list[GnssStatus]) -> GnssStatus | None:
    return next((status for status in states if status.correction_age_s is not None), None)


@machine.needs("str2str")
def test_a_base_station_behind_a_real_caster_feeds_the_receivers_line(
    line: Line, opened: Opened, monkeypatch: pytest.MonkeyPatch
) -> None:
    base_port, port = free_port(), free_port()
    monkeypatch.setenv(caster_login.LOGIN_VARIABLE, "farmer:s3cret")
    caster = (f"tcpsvr://:{base_port}", f"ntripc://farmer:s3cret@:{port}/FARM:;RTCM3;")
    with str2str("-in", caster[0], "-out", caster[1], "-b", "1"):
        wait_for(lambda: is_open(base_port) and is_open(port), "str2str")
        uri = f"serial:{line.path}?ntrip=ntrip://127.0.0.1:{port}/FARM"
        with socket.create_connection(("127.0.0.1", base_port)) as base:  # hears the first GGA
            source = opened.open("gnss", uri)
            speak_ubx(line.say)
            opened.wait_for(source)
            base.settimeout(0.05)
            heard = {"base": b"", "rover": b""}

            def pass_on() -> bool:
                base.sendall(STATION + make_observation())
                heard["rover"] += line.hear()
                with contextlib.suppress(TimeoutError):
                    heard["base"] += base.recv(4096)
                return STATION + make_observation() in heard["rover"] and b"\n" in heard["base"]

            wait_for(pass_on, "corrections at the rover, and its place at the base")
            speak_ubx(line.say, first=100)
            note = opened.wait_for(source, field="notes")[0]
            status = wait_for(lambda: find_fed(opened.take(source, "gnss_status")), "a status")
    assert heard["base"].startswith(b"$GPGGA,")
    assert dict(status.correction_counts).keys() == {1005, 1077}
    assert isinstance(note, DeviceNote)
    assert note.fact == CorrectionsCome(f"127.0.0.1:{port}/FARM", is_again=False)


@machine.needs("str2str")
@pytest.mark.parametrize(
    ("mount", "login", "why"),
    [
        ("FARMS", LOGIN, "no mountpoint 'FARMS'; did you mean 'FARM'?; it has FARM"),
        ("FARM", caster_login.CasterLogin("farmer", "wrong"), "refuses the login"),
        ("FARM", None, "wants a login"),
    ],
)
def test_a_real_casters_refusals_are_understood(
    mount: str, login: caster_login.CasterLogin | None, why: str
) -> None:
    base_port, port = free_port(), free_port()
    caster = (f"tcpsvr://:{base_port}", f"ntripc://farmer:s3cret@:{port}/FARM:;RTCM3;")
    rover = Rover()
    with str2str("-in", caster[0], "-out", caster[1]):
        wait_for(lambda: is_open(base_port) and is_open(port), "str2str")
        with rover.fed_by(port, mount, login):
            rover.wait_told(why)


@machine.needs("str2str")
def test_a_real_server_sends_a_base_through_any_caster_to_the_rover() -> None:
    base_port, rover = free_port(), Rover()
    rovers: list[socket.socket] = []

    def relay(peer: socket.socket, head: bytes) -> None:
        peer.sendall(b"ICY 200 OK\r\n\r\n")
        if not head.startswith(b"SOURCE "):
            rovers.append(peer)
            caster.listen(peer)
            return
        while data := peer.recv(4096):
            for each in rovers:
                each.sendall(data)

    with (
        casting(relay) as caster,
        rover.fed_by(caster.port),
        str2str(
            "-in", f"tcpsvr://:{base_port}", "-out",
            f"ntrips://:s3cret@127.0.0.1:{caster.port}/FARM:;RTCM3;",
        ),
    ):  # fmt: skip
        wait_for(lambda: is_open(base_port), "str2str")
        with socket.create_connection(("127.0.0.1", base_port)) as base:

            def pass_on() -> bool:
                base.sendall(STATION)
                return STATION in rover.taken

            wait_for(pass_on, "the base's message at the rover")


def test_a_run_tells_of_its_corrections_and_its_folder_knows_no_password(
    line: Line, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(caster_login.LOGIN_VARIABLE, "farmer:s3cret")
    ended, out = threading.Event(), tmp_path / "run"

    def speak() -> None:
        for k in itertools.count():
            if ended.wait(0.05):
                return
            line.say(written.make_ubx_pvt(written.EPOCH + k * dt.timedelta(seconds=0.1)))

    receiver = threading.Thread(target=speak)
    receiver.start()
    with casting() as caster:
        caster._answers = [send(YES, b"\r\n", make_observation() * 3, then=caster.listen)]
        uri = f"gnss=serial:{line.path}?ntrip=ntrip://127.0.0.1:{caster.port}/FARM"
        words = ["run", "farm", "--headless", "--for", "3", "--out", str(out), "--source", uri]
        try:
            assert main([*words, "--set", "perception.enabled=false"]) in (0, 1)
        finally:
            ended.set()
            receiver.join()
    told = render(CorrectionsCome(f"127.0.0.1:{caster.port}/FARM", is_again=False))
    assert told in (out / "events.jsonl").read_text()
    states = [s for tick in read_ticks(out / "run.mcap") for s in tick.batch.gnss_status]
    ((kind, count),) = states[-1].correction_counts
    assert kind == 1077 and count >= 3, "a slow start outlives a silent caster, which is asked anew"
    said = capsys.readouterr()
    secrets = [b"s3cret", base64.b64encode(b"farmer:s3cret")]
    texts = [path.read_bytes() for path in out.rglob("*") if path.is_file()]
    for text in (*texts, said.out.encode(), said.err.encode()):
        assert not any(secret in text for secret in secrets)
