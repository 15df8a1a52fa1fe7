"""The page shows what the GNSS receiver reports, and what it does not report as missing."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import pytest

from agribot.core.config import load
from agribot.core.fact_text import render
from agribot.core.facts import AnyFact, LineNoisy
from agribot.core.messages import (
    AddNote,
    DeviceNote,
    GnssFix,
    GnssQuality,
    GnssStatus,
    Satellite,
    SensorBatch,
)
from agribot.drivers.gnss.corrections import CorrectionLink
from agribot.drivers.gnss.ntrip import Caster
from agribot.drivers.gnss.rtcm import RtcmMessage
from agribot.drivers.line.line_watch import MANY, WITHIN_S, LineWatch
from agribot.record.recorder import RunRecorder
from agribot.ui import wire
from agribot.ui.receiver_view import MOST_SHOWN, STATUS_LATE_S, ReceiverView
from agribot.ui.robot_side.feed import RECEIVER_EVERY, SLOW_EVERY, Feed
from agribot.ui.server.channel import Channel
from agribot.ui.server.client import Client
from agribot.ui.server.replay import Replay
from agribot.ui.view import RunView
from tests.asking import ask
from tests.drivers.lines import free_port
from tests.record import record_samples as samples
from tests.waiting import wait_for

FED = "serial:/dev/ttyACM0?baud=38400&ntrip=ntrip://127.0.0.1:2101/FARM"
FED_BY_CASTER = ["platform='hardware'", f"sources.gnss='{FED}'"]


def make_fix(t_s: float, quality: GnssQuality = GnssQuality.RTK_FIXED) -> GnssFix:
    return GnssFix(
        t_s=t_s, lat_deg=52.15, lon_deg=4.5, alt_m=50.0, pos_std_m=0.014, quality=quality
    )


def make_satellite(number: int, snr_db: float = 40.0, *, is_used: bool = True) -> Satellite:
    return Satellite(
        system="GP", number=number, elevation_deg=30.4, azimuth_deg=200.6, snr_db=snr_db,
        is_used=is_used,
    )  # fmt: skip


def test_a_place_without_satellites_and_what_is_not_read_are_shown() -> None:
    fix = msgspec.structs.replace(make_fix(1.0, GnssQuality.NONE), unmeasured="held")
    status = GnssStatus(t_s=1.0, unread=("ZDA",), trouble="its place is held; switch that off")
    shown = view_of(SensorBatch(t_s=1.1, gnss=(fix,), gnss_status=(status,))).show()
    assert (shown.quality, shown.unmeasured, shown.unread) == (0, "held", ["ZDA"])
    assert shown.position_trouble == "its place is held; switch that off"


def view_of(*batches: SensorBatch, settings: list[str] | None = None) -> ReceiverView:
    view = ReceiverView(load("farm", settings or []))
    for batch in batches:
        view(batch)
    return view


def test_before_the_first_fix_nothing_is_told_and_nothing_is_zero() -> None:
    shown = view_of(SensorBatch(t_s=7.0)).show()
    assert shown == wire.ReceiverState(is_simulated=True)
    told = (shown.fix_age_s, shown.std_m, shown.rate_hz, shown.hdop, shown.correction_age_s)
    assert told == (None,) * 5


def test_fixes_have_their_rate_and_the_age_of_the_last_grows_when_they_end() -> None:
    view = view_of(*(SensorBatch(t_s=0.1 * k + 0.11, gnss=(make_fix(0.1 * k),)) for k in range(40)))
    shown = view.show()
    assert (shown.fix_age_s, shown.rate_hz) == (0.1, 10.0)
    assert (shown.quality, shown.std_m) == (GnssQuality.RTK_FIXED, 0.014)
    view(SensorBatch(t_s=15.9))
    assert view.show().fix_age_s == 12.0
    view(SensorBatch(t_s=16.0, gnss=(make_fix(16.0),)))
    shown = view.show()
    assert (shown.fix_age_s, shown.rate_hz) == (0.0, None)


def test_the_sky_is_shown_until_the_receiver_does_not_tell_it_any_more() -> None:
    heard = (make_satellite(1), make_satellite(2, 0.0, is_used=False))
    status = GnssStatus(t_s=1.0, satellites=heard, hdop=0.84, pdop=1.52)
    view = view_of(SensorBatch(t_s=1.1, gnss_status=(status,)))
    shown = view.show()
    assert shown.satellites == [
        wire.SeenSatellite(
            system="GP", number=number, elevation_deg=30, azimuth_deg=201, snr_db=snr_db,
            is_used=is_used,
        )
        for number, snr_db, is_used in ((1, 40, True), (2, 0, False))
    ]  # fmt: skip
    assert (shown.used_count, shown.in_view_count) == (1, 2)
    assert (shown.hdop, shown.pdop, shown.vdop) == (0.8, 1.5, None)
    view(SensorBatch(t_s=1.0 + STATUS_LATE_S + 2.0))
    late = view.show()
    assert (late.satellites, late.in_view_count, late.hdop) == ([], 0, None)
    assert late.status_age_s == STATUS_LATE_S + 2.0


def test_of_a_crowded_sky_those_that_are_used_or_strong_are_shown_and_all_are_counted() -> None:
    weak = [make_satellite(k, 20.0, is_used=False) for k in range(100, 180)]
    best = [make_satellite(1, 15.0), make_satellite(2, 50.0, is_used=False)]
    status = GnssStatus(t_s=1.0, satellites=(*weak, *best))
    shown = view_of(SensorBatch(t_s=1.0, gnss_status=(status,))).show()
    assert len(shown.satellites) == MOST_SHOWN
    assert {1, 2} <= {each.number for each in shown.satellites}
    assert (shown.used_count, shown.in_view_count) == (1, 82)


def test_corrections_grow_old_between_two_statuses_and_are_counted_by_the_second() -> None:
    view = view_of(settings=FED_BY_CASTER)
    for t_s, counts in ((1.0, ((1005, 1), (1077, 4))), (2.0, ((1005, 1), (1077, 9)))):
        status = GnssStatus(t_s=t_s, correction_age_s=0.4, correction_counts=counts)
        view(SensorBatch(t_s=t_s + 0.1, gnss_status=(status,)))
    shown = view.show()
    assert (shown.correction_age_s, shown.correction_hz) == (0.5, 5.0)
    view(SensorBatch(t_s=4.0))
    assert view.show().correction_age_s == 2.4


def test_of_corrections_the_share_is_shown_that_the_receiver_used_since_the_state_before() -> None:
    view, shares = view_of(settings=FED_BY_CASTER), list[float | None]()
    for t_s, used, unused in ((1.0, 5, 0), (2.0, 8, 1), (3.0, 8, 3), (4.0, 8, 3), (5.0, 1, 0)):
        status = GnssStatus(t_s=t_s, corrections_used=used, corrections_unused=unused)
        view(SensorBatch(t_s=t_s, gnss_status=(status,)))
        shares.append(view.show().correction_use_ratio)
    assert shares == [None, 0.75, 0.0, None, None]


@pytest.mark.parametrize(
    ("settings", "is_simulated", "device"),
    [
        ([], True, ""),
        (["sources.gnss='gpsd:'"], False, "gpsd:"),
        (["platform='firmware'"], True, ""),
        (["platform='hardware'"], False, ""),
        (FED_BY_CASTER, False, "serial:/dev/ttyACM0"),
    ],
)
def test_only_a_receiver_of_the_simulator_is_called_simulated(
    settings: list[str], is_simulated: bool, device: str
) -> None:
    shown = view_of(settings=settings).show()
    assert (shown.is_simulated, shown.device) == (is_simulated, device)


def test_a_caster_that_gives_nothing_is_told_with_the_reason_and_forgotten_once_it_gives() -> None:
    view = view_of(settings=FED_BY_CASTER)
    assert (view.show().caster_state, view.show().caster) == (
        "asked",
        "ntrip://127.0.0.1:2101/FARM",
    )
    told: list[AnyFact] = []
    link = CorrectionLink(
        Caster("127.0.0.1", free_port(), "FARM"), None, lambda _: True, lambda: None,
        told.append,
    )  # fmt: skip
    wait_for(lambda: told, "the reason why there are no corrections")
    link.close()
    view(SensorBatch(t_s=1.0, notes=(DeviceNote(t_s=1.0, fact=told[0]),)))
    shown = view.show()
    assert (shown.caster_state, shown.correction_trouble) == ("failed", render(told[0]))
    observed = bytes(3) + b"\xff" * 40 + bytes(3)  # of many satellites
    link._take(RtcmMessage(1077, observed))  # as from a caster that answers at last
    view(SensorBatch(t_s=2.0, notes=(DeviceNote(t_s=2.0, fact=told[-1]),)))
    shown = view.show()
    assert (shown.caster_state, shown.correction_trouble) == ("connected", "")


def test_a_line_that_breaks_messages_is_told_until_it_does_not_any_more() -> None:
    view, watch = view_of(), LineWatch("receiver", "receiver on /dev/ttyACM0")
    notes = watch.update(1.0, MANY)
    view(SensorBatch(t_s=1.0, notes=notes))
    (noisy,) = (note.fact for note in notes)
    assert isinstance(noisy, LineNoisy) and noisy.count == MANY
    assert view.show().line_trouble == render(noisy)
    view(SensorBatch(t_s=2.0, notes=LineWatch("board", "motor board").update(2.0, MANY)))
    assert view.show().line_trouble == render(noisy), "the receiver's"
    late_s = 1.5 + WITHIN_S
    view(SensorBatch(t_s=late_s, notes=watch.update(late_s, MANY)))
    assert view.show().line_trouble == ""


def test_what_an_operator_writes_is_no_news_of_the_receiver() -> None:
    note = AddNote(text="no corrections from the tractor today")
    for name in ("Ada", "sensors"):
        batch = SensorBatch(t_s=1.0, requests=(ask(note, name, t_s=1.0),))
        assert view_of(batch).show().correction_trouble == ""


def test_a_slow_page_is_sent_the_newest_state_of_the_receiver_alone() -> None:
    channel = Channel("sim")
    client = Client(channel)
    channel.clients.add(client)
    for second in range(50):
        channel.publish_growth(wire.ReceiverState(status_age_s=second))
    sent = take_all(client)
    assert [type(message) for message in sent] == [wire.Snapshot, wire.ReceiverState]
    assert sent[1] == wire.ReceiverState(epoch=channel.epoch, status_age_s=49)
    assert take_all(client) == []


def test_a_page_that_comes_later_is_sent_the_receiver_and_none_of_before_a_restart() -> None:
    channel = Channel("sim")
    channel.publish_growth(wire.ReceiverState(hdop=0.8))
    assert wire.ReceiverState(epoch=channel.epoch, hdop=0.8) in take_all(Client(channel))
    channel.restart()
    assert [type(message) for message in take_all(Client(channel))] == [wire.Snapshot]


def take_all(client: Client) -> list[wire.ServerMessage]:
    texts = iter(client.take, None)
    return [wire.read_server_message(text) for text in texts]


def test_the_robot_tells_of_its_receiver_once_and_again_when_it_changed() -> None:
    view, sent = RunView(load("farm")), list[bytes]()
    noise = np.random.default_rng(0)
    view(samples.tick(0, noise))
    source: Any = SimpleNamespace(
        path=lambda: None, weeds=list, events_since=lambda _: [], recording=str,
        calibration=lambda: None,
    )  # fmt: skip
    feed = Feed(view, source, sent.append)

    def of_kind(kind: type[wire.Message]) -> list[wire.Message]:
        return [one for one in map(wire.read_robot_message, list(sent)) if isinstance(one, kind)]

    def looks(times: int) -> bool:
        """Whether it looked at the receiver so often, by how often it counted."""
        return len(of_kind(wire.TickCounts)) > times * RECEIVER_EVERY // SLOW_EVERY

    feed.start()
    wait_for(lambda: looks(1), "a second look")
    assert len(of_kind(wire.ReceiverState)) == 1
    view(samples.tick(200, noise))
    wait_for(lambda: looks(2), "a third look")
    feed.close()
    told = of_kind(wire.ReceiverState)
    assert len(told) == 2
    assert cast(wire.ReceiverState, told[1]).in_view_count == 1


def test_a_recording_shows_its_receiver_as_it_was_at_each_time(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    recorder = RunRecorder(path, load("farm"), samples.robot(), samples.URDF)
    for index, record in enumerate(samples.ticks(300)):
        batch = record.batch
        if index > 150:
            batch = msgspec.structs.replace(batch, gnss=(), gnss_status=())
        recorder(msgspec.structs.replace(record, batch=batch))
    recorder.close()
    replay = Replay.load(path, "today")
    assert replay.receiver is not None
    assert replay.receiver.epoch == replay.epoch
    assert replay.receiver.fix_age_s == pytest.approx(0.05, abs=0.051)
    replay.seek(6.0)
    assert replay.receiver is not None
    assert replay.receiver.fix_age_s is not None
    assert replay.receiver.fix_age_s > 1.0
    replay.seek(0.0)
    assert replay.receiver.in_view_count == 1
