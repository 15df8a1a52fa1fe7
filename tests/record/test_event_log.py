from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from agribot.core.errors import RecordingError
from agribot.core.fact_text import render
from agribot.core.facts import (
    ButtonPressed,
    Fact,
    GnssRepeats,
    ImuLate,
    ImuSpoilt,
    NoFixesYet,
    PositionUnsure,
    SensorSilent,
    SourceHeard,
    SourceSilent,
    SpeedLimited,
    StoppedBy,
    StopToClear,
)
from agribot.core.messages import (
    Check,
    DeviceNote,
    DriveCommand,
    Estimate,
    GateStatus,
    RequestWord,
    RobotCommand,
    SensorBatch,
    SensorVerdict,
    TickRecord,
    Tracking,
)
from agribot.record.events import EventLog, read_events
from agribot.record.old_reasons import lift_reasons
from tests.asking import BY_WORD, ask
from tests.record import record_samples as samples


@pytest.fixture
def log(tmp_path: Path) -> Iterator[EventLog]:
    log = EventLog(tmp_path / "events.jsonl")
    yield log
    log.close()


def _changed(record: TickRecord, v_mps: float, fact: Fact | None) -> TickRecord:
    command = RobotCommand(t_s=record.batch.t_s, drive=DriveCommand(v_mps=v_mps))
    return msgspec.structs.replace(record, command=command, reason=render(fact), fact=fact)


def _doubted(record: TickRecord, fact: Fact | None) -> Estimate:
    return msgspec.structs.replace(record.estimate, reason=render(fact), fact=fact)


def test_a_quiet_run_has_one_line_for_each_change(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    log = EventLog(path)
    for record in samples.ticks(200):
        log(record)
    log.close()
    assert [event.kind for event in log.events] == ["ready", "row", "mission", "operator"]
    assert read_events(path) == log.events
    assert len(path.read_text().splitlines()) == 4


def test_a_stop_is_one_event_though_its_number_changes_every_tick(log: EventLog) -> None:
    records = samples.ticks(40)
    for index, record in enumerate(records):
        if 10 <= index < 30:
            log(_changed(record, 0.0, PositionUnsure(1.0 + 0.01 * index, 1.0)))
        else:
            log(_changed(record, 0.4, None))
    (stop,) = log.list_kind("stop")
    assert (stop.code, stop.numbers) == ("position_unsure", {"std_m": 1.1, "limit_m": 1.0})
    assert stop.reason == render(PositionUnsure(1.1, 1.0))
    assert stop.t_s == pytest.approx(records[10].batch.t_s)
    assert len(log.list_kind("clear")) == 1


def test_a_standing_robot_is_held_not_stopped(log: EventLog) -> None:
    records = samples.ticks(3)
    log(_changed(records[0], 0.0, NoFixesYet()))
    log(_changed(records[1], 0.2, SpeedLimited(0.4, 0.2)))
    log(_changed(records[2], 0.0, ButtonPressed()))
    kinds = [event.kind for event in log.events if event.kind not in {"ready", "row", "mission"}]
    assert kinds == ["hold", "limit", "stop"]


def test_a_lost_position_is_a_fault_with_the_filters_reason(log: EventLog) -> None:
    good, bad = samples.ticks(2)
    silent = SensorSilent("wheels", 0.4, 0.3, "board")
    lost = msgspec.structs.replace(bad.estimate, ok=False, reason=render(silent), fact=silent)
    log(good)
    log(msgspec.structs.replace(bad, estimate=lost))
    (fault,) = log.list_kind("fault")
    assert (fault.code, fault.parts) == ("sensor_silent", ("wheels",))
    assert fault.reason == render(silent)


def test_a_sensor_in_doubt_is_a_fault_once_although_the_position_is_known(log: EventLog) -> None:
    for index, record in enumerate(samples.ticks(30)):
        doubt = GnssRepeats(float(index)) if index % 20 > 5 else None
        log(msgspec.structs.replace(record, estimate=_doubted(record, doubt)))
    assert [fault.numbers for fault in log.list_kind("fault")] == [{"way_m": 6.0}, {"way_m": 26.0}]


def test_a_recording_from_before_facts_has_the_same_events(log: EventLog) -> None:
    for index, record in enumerate(samples.ticks(30)):
        doubt = GnssRepeats(float(index)) if index % 20 > 5 else None
        old = msgspec.structs.replace(_doubted(record, doubt), fact=None)
        log(lift_reasons(msgspec.structs.replace(record, estimate=old)))
    faults = log.list_kind("fault")
    assert [(fault.reason, fault.code) for fault in faults] == [
        (render(GnssRepeats(6.0)), "said"),
        (render(GnssRepeats(26.0)), "said"),
    ]


def test_mission_changes_are_written_at_once(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    log = EventLog(path)
    record = samples.ticks(1)[0]
    for state in ("waiting", "running", "running", "done"):
        log(msgspec.structs.replace(record, status=samples.status(state)))
    on_disk = read_events(path)  # before close: a crash must not lose it
    assert [e.reason for e in on_disk if e.kind == "mission"] == ["waiting", "running", "done"]
    log.close()
    log.close()


def test_unwritable_and_foreign_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(RecordingError, match="writable"):
        EventLog(tmp_path / "file" / "events.jsonl")
    with pytest.raises(RecordingError, match="not an event log"):
        read_events(tmp_path / "file")


def test_a_stop_that_nobody_has_cleared_goes_on_while_nothing_asks_the_robot_to_move(
    log: EventLog,
) -> None:
    for index, record in enumerate(samples.ticks(6)):
        stopped = StoppedBy("Ann") if 1 <= index < 5 else None
        status = msgspec.structs.replace(record.status, stopped_fact=stopped)
        reason = StopToClear(StoppedBy("Ann")) if index == 1 else None
        log(msgspec.structs.replace(_changed(record, 0.0, reason), status=status))
        assert len(log.list_kind("clear")) == (1 if index == 5 else 0)
    assert len(log.list_kind("hold")) == 1


def test_the_gate_tells_its_way_from_state_to_state_and_the_list_before_the_start(
    log: EventLog,
) -> None:
    good, bad = Check(name="clock", is_ok=True), Check(name="field", is_ok=False, text="outside")
    statuses = (
        GateStatus(),
        GateStatus(state="checking", reason="outside", checks=(good, bad)),
        GateStatus(state="checking", reason="outside"),
        GateStatus(
            state="driving", reason="over: outside", warning="1e+200", warning_fact=ImuSpoilt(1e200)
        ),
        GateStatus(
            state="driving", reason="over: outside", warning="3e+100", warning_fact=ImuSpoilt(3e100)
        ),
        GateStatus(state="stopped", reason="the bumper touches something"),
    )
    for record, gate in zip(samples.ticks(len(statuses)), statuses, strict=True):
        status = msgspec.structs.replace(record.status, gate=gate)
        log(msgspec.structs.replace(record, status=status))
    assert [event.reason for event in log.list_kind("gate")] == [
        "standby -> checking: outside",
        "checking -> driving: over: outside",
        "driving -> stopped: the bumper touches something",
    ]
    assert [event.reason for event in log.list_kind("check")] == [
        "before the start not good: field: outside. Good: clock"
    ]
    assert [event.reason for event in log.list_kind("fault")] == ["1e+200"]


def test_the_events_tell_how_each_row_went(log: EventLog) -> None:
    records = samples.ticks(60)

    def put(record: TickRecord, row: int, done: tuple[int, ...], off_m: float) -> TickRecord:
        status = msgspec.structs.replace(
            record.status, row=row, rows_done=done, s_m=10.0 * record.batch.t_s
        )
        tracking = Tracking(s_m=status.s_m, cross_track_m=off_m, heading_error_rad=0.0)
        estimate = msgspec.structs.replace(record.estimate, row_seen=True)
        return msgspec.structs.replace(record, status=status, tracking=tracking, estimate=estimate)

    for index, record in enumerate(records):
        if index < 30:
            log(put(record, 2, (), -0.031 if index == 7 else 0.01))
        elif index < 40:
            log(put(record, -1, (2,), 0.2))
        else:
            log(put(record, 3, (2,), 0.0))
    log(put(records[-1], -1, (2,), 0.0))
    told = [event.reason for event in log.list_kind("row")]
    assert told[0] == "row 3 begun"
    assert told[1].startswith("row 3 done: ") and "at most 3.1 cm off its line" in told[1]
    assert "crop seen 100 % of the time" in told[1]
    assert told[2] == "row 4 begun"
    assert told[3].startswith("row 4 left, not done: ")


def test_a_sensor_that_is_not_fine_is_a_fault_once_unless_its_reason_is_told_already(
    log: EventLog,
) -> None:
    gone, late_fact = SensorSilent("gnss", 3.0, 3.0, "gnss"), ImuLate(0.1)
    silent = SensorVerdict(state="silent", since_s=0.1, reason=render(gone), fact=gone)
    late = SensorVerdict(state="late", since_s=0.1, reason=render(late_fact), fact=late_fact)
    for index, record in enumerate(samples.ticks(30)):
        if 5 <= index < 20:
            verdicts = {"gnss": silent, "gyro": late}
            doubted = msgspec.structs.replace(_doubted(record, ImuLate(0.2)), verdicts=verdicts)
            record = msgspec.structs.replace(record, estimate=doubted)  # noqa: PLW2901
        log(record)
    assert [event.reason for event in log.list_kind("fault")] == [
        render(ImuLate(0.2)), silent.reason,
    ]  # fmt: skip
    fine = [event.reason for event in log.list_kind("clear")]
    assert fine == ["gnss is fine again", "gyro is fine again"]


@pytest.mark.parametrize("name", ["Ada", "sensors", "operator", "the battery", ""])
@pytest.mark.parametrize("action", BY_WORD)
def test_what_a_person_presses_is_logged_as_the_persons_whatever_the_name(
    action: RequestWord, name: str, log: EventLog
) -> None:
    press = ask(action, name)
    (record,) = samples.ticks(1)
    log(msgspec.structs.replace(record, batch=SensorBatch(t_s=0.0, requests=(press,))))
    event = log.events[0]
    assert event.kind == ("mark" if action == "mark" else "operator")
    assert event.reason.endswith(f"({name})")


def test_a_note_on_a_sensor_is_a_fault_and_its_end(log: EventLog) -> None:
    notes = (
        DeviceNote(t_s=0.0, fact=SourceSilent("gnss", "gpsd://", 2.5, 2.0)),
        DeviceNote(t_s=0.0, fact=SourceHeard("gnss", "gpsd://")),
    )
    (record,) = samples.ticks(1)
    log(msgspec.structs.replace(record, batch=SensorBatch(t_s=0.0, notes=notes)))
    told = [(event.kind, event.code) for event in log.events[:2]]
    assert told == [("fault", "source_silent"), ("clear", "source_heard")]
    assert (log.events[0].parts, log.events[0].numbers["silent_s"]) == (("gnss",), 2.5)
