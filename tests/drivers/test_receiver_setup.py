"""A u-blox receiver is set up in the messages of its generation, as its maker's list has them."""

from __future__ import annotations

import datetime as dt
import itertools
import json
import re
import threading

import pytest
from pyubx2 import GET, SET, UBX_CONFIG_DATABASE, UBXMessage, UBXReader

from agribot.cli.main import main
from agribot.cli.tools import gnss
from agribot.core.messages import GnssFix, GnssQuality
from agribot.drivers.gnss.ubx import UbxDecoder, UbxFrame, make_frame
from agribot.drivers.gnss.ubx_setup import ACK, MON_VER, NAK, ReceiverSetup, SetupPlan, write_setup
from tests.drivers import receiver_bytes as written
from tests.drivers.lines import Line
from tests.drivers.test_real_gpsd import speaking
from tests.waiting import interrupted_once

_USED = re.compile(r"\d+ of \d+ corrections used by the receiver")


def test_the_keys_of_the_ninth_generation_are_those_of_its_maker() -> None:
    plan = SetupPlan(rate_hz=10.0, model="automotive", is_kept=True)
    meant: dict[str, int] = {}
    for data in write_setup(plan, 27.31):
        message = UBXReader.parse(data, msgmode=SET)
        assert message.identity == "CFG-VALSET" and (message.ram, message.bbr) == (1, 1)
        meant |= {
            name: getattr(message, name) for name in UBX_CONFIG_DATABASE if hasattr(message, name)
        }
    expected = {"CFG_RATE_MEAS": 100, "CFG_NAVSPG_DYNMODEL": 4}
    for port in ("UART1", "UART2", "USB"):
        for name, every in (
            ("PVT", 1), ("HPPOSLLH", 1), ("RELPOSNED", 1), ("SAT", 10), ("DOP", 10),
        ):  # fmt: skip
            expected[f"CFG_MSGOUT_UBX_NAV_{name}_{port}"] = every
        expected[f"CFG_MSGOUT_UBX_RXM_RTCM_{port}"] = expected[f"CFG_MSGOUT_UBX_RXM_COR_{port}"] = 1
        expected[f"CFG_{port}INPROT_RTCM3X"] = 1
    assert meant == expected


def test_the_eighth_generation_is_set_up_in_its_own_messages() -> None:
    plan = SetupPlan(rate_hz=5.0, model="pedestrian", is_kept=True)
    told = [UBXReader.parse(data, msgmode=SET) for data in write_setup(plan, 18.0)]
    assert [message.identity for message in told] == [
        "CFG-RATE", "CFG-NAV5", "CFG-MSG", "CFG-MSG", "CFG-MSG", "CFG-CFG",
    ]  # fmt: skip
    assert (told[0].measRate, told[0].navRate) == (200, 1)
    assert (told[1].dyn, told[1].dynModel) == (1, 3)
    pvt = (told[2].msgClass, told[2].msgID)
    assert [int.from_bytes(part, "big") if isinstance(part, bytes) else part for part in pvt] == [
        1, 7,
    ]  # fmt: skip


def test_what_a_receiver_does_not_have_is_no_end_of_the_talk() -> None:
    setup = ReceiverSetup(SetupPlan())
    (frame,) = UbxDecoder().feed(written.make_ubx_version("ZED-F9P"))
    sent = setup.add(frame)
    count = 0
    while sent:
        assert setup.add(UbxFrame(ACK, b"\x06\x01")) == b""  # of another message
        count += 1
        sent = setup.add(UbxFrame(NAK if count == 6 else ACK, sent[2:4]))
    assert setup.is_done and (setup.accepted, len(setup.refused)) == (count - 1, 1)


class Ublox:
    """A receiver that answers as its generation does."""

    def __init__(self, line: Line, model: str) -> None:
        self._line, self._model = line, model
        self.settings: list[UBXMessage] = []
        self.ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self.ended.set()
        self._thread.join()

    def _run(self) -> None:
        frames = UbxDecoder()
        while not self.ended.wait(0.01):
            for kind, payload in frames.feed(self._line.hear()):
                self._line.say(b"$GNGGA,,,,,,0,,,,,,,,*78\r\n" + written.make_ubx_pvt())
                if kind == MON_VER:
                    self._line.say(written.make_ubx_version(self._model))
                    continue
                self.settings.append(UBXReader.parse(make_frame(kind, payload), msgmode=SET))
                ack = UBXMessage("ACK", "ACK-ACK", GET, clsID=kind[0], msgID=kind[1])
                self._line.say(ack.serialize())


@pytest.mark.parametrize(("model", "first"), [("ZED-F9P", "CFG-VALSET"), ("NEO-M8N", "CFG-RATE")])
def test_the_command_sets_up_a_receiver_on_a_line(
    model: str, first: str, line: Line, capsys: pytest.CaptureFixture[str]
) -> None:
    receiver = Ublox(line, model)
    try:
        assert main(["gnss", "configure", f"serial:{line.path}", "--rate", "8", "--json"]) == 0
    finally:
        receiver.close()
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert told["model"] == model and told["refused"] == 0
    assert told["accepted"] == len(receiver.settings)
    assert receiver.settings[0].identity == first


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["--rate", "100"], "give 1 to 20 Hz"),
        (["--model", "car"], "give one of portable, pedestrian, automotive"),
    ],
)
def test_what_no_receiver_can_do_is_refused(
    words: list[str], why: str, line: Line, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["gnss", "configure", f"serial:{line.path}", *words]) == 2
    assert why in capsys.readouterr().err
    assert line.hear() == b""


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Lines of `agribot gnss show`, as it prints them."""
    lines: list[str] = []
    monkeypatch.setattr(gnss, "print_line", lines.append)
    return lines


def test_the_command_shows_what_a_receiver_tells(
    line: Line, told: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    def is_shown() -> bool:
        words = ("RTK fixed +-0.010 m", "2 of 3 satellites, HDOP 0.9", "heading 0.0 deg")
        return any(all(word in text for word in words) and _USED.search(text) for text in told)

    ended = threading.Event()

    def speak() -> None:
        for k in itertools.count():
            if ended.wait(0.05):
                return
            at = written.EPOCH + k * dt.timedelta(seconds=0.2)
            line.say(written.make_ubx_rtcm(use=2) + written.make_ubx_rtcm(use=1))
            line.say(written.make_ubx_sky(at) + written.make_ubx_relposned(at, 90.0))
            line.say(written.make_ubx_pvt(at, carrier=2, h_acc_m=0.014))

    receiver = threading.Thread(target=speak)
    receiver.start()
    uri = f"serial:{line.path}?heading_offset_deg=90"
    try:
        with interrupted_once(is_shown):
            assert main(["gnss", "show", uri, "--for", "600", "--json"]) == 0
    finally:
        ended.set()
        receiver.join()
    assert is_shown(), told
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    used, unused = (result["status"][f"corrections_{what}"] for what in ("used", "unused"))
    assert used > 0 and used == unused
    assert result["fix"]["lat_deg"] == pytest.approx(written.LAT_DEG)


def test_the_command_shows_satellites_of_a_receiver_that_searches_and_fails_for_want_of_a_fix(
    line: Line, told: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    def is_shown() -> bool:
        return any("no fix yet, 0 of 3 satellites" in text for text in told)

    with speaking((line, written.make_ubx_searching)), interrupted_once(is_shown):
        assert main(["gnss", "show", f"serial:{line.path}", "--for", "600", "--json"]) == 1
    assert is_shown(), told
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result["fix"] is None and len(result["status"]["satellites"]) == 3


def test_the_command_does_not_show_an_old_fix_as_one_of_now() -> None:
    summary = gnss.ReceiverSummary()
    fix = GnssFix(
        t_s=0.5, lat_deg=48.7, lon_deg=9.2, alt_m=200.0, pos_std_m=0.01,
        quality=GnssQuality.RTK_FIXED,
    )  # fmt: skip
    summary.add(0.6, (fix,), {})
    assert summary.describe().startswith("48.70000000, 9.20000000")
    summary.add(4.5, (), {})
    assert summary.describe() == "no fix for 4 s"
