"""events.jsonl: every stop, refusal, fault and change of the mission, with its reason."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Literal

import msgspec

from agribot.core.errors import RecordingError, explain_unreadable
from agribot.core.fact_text import render
from agribot.core.facts import AnyFact, ComingAndGoing, Fact, find_kind
from agribot.core.messages import (
    FINE,
    STOP,
    Check,
    DeviceNote,
    GateState,
    GateStatus,
    MarkMoment,
    MissionState,
    RequestEvent,
    SensorVerdicts,
    TickRecord,
    Who,
)
from agribot.core.request_text import describe_request
from agribot.record.dropout_watch import Dropouts, DropoutWatch

EventKind = Literal[
    "mission",
    "row",
    "operator",
    "mark",
    "ready",
    "fault",
    "stop",
    "hold",
    "limit",
    "clear",
    "gate",
    "check",
    "injected",
    "lost",
    "truth",
]

# Least distance of a row from its line in the map that is reported, m.
NAMED_BESIDE_M = 0.05


class Event(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One change; `state` is the new one of the mission or the gate, where that changed.

    `code` is that of the fact that `reason` is the text of, `causes` are the codes of the facts
    inside it, `parts` those of the robot that are at fault, `numbers` its numbers by name; all are
    empty where there is no fact, as of what a person pressed. `fact` is not written.

    mission   the mission's state or its reason changed, or it refused something
    row       a crop row was begun or left, and how it went as the robot believes
    operator  somebody pressed something
    mark      somebody marked the moment
    ready     the estimate became usable; fault: it stopped being so, or a sensor fell silent,
              repeats itself or contradicts another; clear: one is fine again
    stop      the supervisor stopped a moving robot; hold: it keeps a standing one standing
    limit     the supervisor let it move, but less than asked
    clear     the supervisor has no objection any more
    gate      the supervisor's state changed: "driving -> held: why"
    check     what the list before the start of a mission found
    truth     what only the simulator knows: a crop was crushed, a person was touched, the position
              was farther off than its protection level
    lost      the recording is damaged: what happened from then on for a while is not known
    injected  a fault of the simulator began or ended, which the robot itself does not know
    """

    t_s: float
    kind: EventKind
    reason: str
    state: MissionState | GateState | None = None
    code: str = ""
    causes: tuple[str, ...] = ()
    parts: tuple[str, ...] = ()
    numbers: dict[str, float] = {}
    fact: AnyFact | None = None


def write_event(event: Event) -> bytes:
    """Encode an event as a line of the file has it: a fact by its code, parts and numbers."""
    return msgspec.json.encode(msgspec.structs.replace(event, fact=None))


def make_event(
    t_s: float,
    kind: EventKind,
    reason: str,
    fact: Fact | None,
    state: MissionState | GateState | None = None,
) -> Event:
    """Make the event of a fact, where there is one."""
    if fact is None:
        return Event(t_s=t_s, kind=kind, reason=reason, state=state)
    return Event(
        t_s=t_s, kind=kind, reason=reason, state=state,
        code=fact.code, causes=fact.causes, parts=fact.parts, numbers=fact.numbers, fact=fact,
    )  # fmt: skip


class _RowStory:
    """The robot's account of the row that it is in."""

    def __init__(self, index: int, t_s: float, s_m: float) -> None:
        self.index, self._t_s, self._from_m, self._to_m = index, t_s, s_m, s_m
        self._off_m = self._nudged_m = self._beside_m = 0.0
        self._looks = self._seen = 0

    def add(self, record: TickRecord) -> None:
        self._to_m, self._nudged_m = record.status.s_m, record.status.row_nudged_m
        self._beside_m = math.hypot(*record.estimate.rows_off_m)
        if record.tracking is not None:
            self._off_m = max(self._off_m, abs(record.tracking.cross_track_m))
        if record.estimate.row_seen is not None:
            self._looks += 1
            self._seen += record.estimate.row_seen

    def describe(self, t_s: float, *, is_done: bool) -> str:
        seen = 100 * self._seen / max(self._looks, 1)
        crop = f", crop seen {seen:.0f} % of the time" if self._looks else ""
        return (
            f"row {self.index + 1} {'done' if is_done else 'left, not done'}: "
            f"{self._to_m - self._from_m:.1f} m in {t_s - self._t_s:.0f} s, at most "
            f"{100 * self._off_m:.1f} cm off its line as the robot believes{crop}"
            + f", it stands {self._beside_m:.2f} m beside the map"
            * (self._beside_m >= NAMED_BESIDE_M)
            + f", moved {100 * self._nudged_m:+.0f} cm by hand" * bool(self._nudged_m)
        )


class EventSieve:
    """Find what changed: call it with every TickRecord."""

    def __init__(self) -> None:
        self._found: list[Event] = []
        self._mission: tuple[str, tuple[object, ...], tuple[object, ...]] = ("", (), ())
        self._objection: tuple[object, ...] = ()
        self._warning: tuple[str, Fact | None] = ("", None)
        self._facts: list[Fact] = []  # facts of this tick's events
        self._unproven: tuple[int, ...] = ()
        self._estimate_ok = False
        self._doubt: tuple[object, ...] = ()
        self._gate = GateStatus()
        self._verdicts: SensorVerdicts = {}
        self._moving = False
        self._driver: Who | None = None
        self._row: _RowStory | None = None
        self._dropouts = DropoutWatch()

    @property
    def dropouts(self) -> dict[ComingAndGoing, Dropouts]:
        """Dropouts until now, of the parts that had any."""
        return self._dropouts.summarise()

    def __call__(self, record: TickRecord) -> list[Event]:
        self._found, self._facts = [], []
        t_s = record.batch.t_s
        for note in record.batch.notes:
            self._note_device(note)
        for fact in self._dropouts.update(record.batch):
            self._add(t_s, "fault", render(fact), fact)
        for request in record.batch.requests:
            self._note_request(request)
        self._note_hand(t_s, record)
        self._note_estimate(t_s, record)
        self._note_doubt(t_s, record)
        self._note_row(t_s, record)
        self._note_mission(t_s, record)
        self._note_supervisor(t_s, record)
        self._note_warning(t_s, record.status.warning, record.status.warning_fact)
        self._note_gate(t_s, record.status.gate, record.fact)
        self._note_verdicts(t_s, record.estimate.verdicts)
        self._moving = record.command.drive != STOP
        return self._found

    def _note_device(self, note: DeviceNote) -> None:
        kind: EventKind = "clear" if note.fact.severity == "note" else "fault"
        self._found.append(make_event(note.t_s, kind, render(note.fact), note.fact))

    def _note_request(self, event: RequestEvent) -> None:
        kind: EventKind = "mark" if isinstance(event.request, MarkMoment) else "operator"
        self._add(event.t_s, kind, f"{describe_request(event.request)} ({event.who.name})")

    def _note_hand(self, t_s: float, record: TickRecord) -> None:
        """Note who drives by hand; letting a stick go is no event of its own."""
        for hand in record.batch.hand:
            if hand.who != self._driver and (hand.v_mps or hand.yaw_rate_radps):
                self._driver = hand.who
                self._add(t_s, "operator", f"drives by hand ({hand.who.name})")

    def _note_estimate(self, t_s: float, record: TickRecord) -> None:
        ok = record.estimate.ok
        if ok != self._estimate_ok:
            self._estimate_ok = ok
            ready = f"position known to {record.estimate.pos_std_m:.3f} m"
            if ok:
                self._add(t_s, "ready", ready)
            else:
                self._add(t_s, "fault", record.estimate.reason, record.estimate.fact)

    def _note_doubt(self, t_s: float, record: TickRecord) -> None:
        """Note what is wrong with a sensor that the estimate does without."""
        doubt = find_kind(record.estimate.fact) if record.estimate.ok else ()
        if doubt and doubt != self._doubt:
            self._add(t_s, "fault", record.estimate.reason, record.estimate.fact)
        self._doubt = doubt

    def _note_row(self, t_s: float, record: TickRecord) -> None:
        status, row = record.status, self._row
        if row is not None and status.row != row.index:
            self._add(t_s, "row", row.describe(t_s, is_done=row.index in status.rows_done))
            self._row = None
        if status.row >= 0 and self._row is None:
            self._row = _RowStory(status.row, t_s, status.s_m)
            again = " again" if status.row in status.rows_done else ""
            self._add(t_s, "row", f"row {status.row + 1} begun{again}")
        if self._row is not None:
            self._row.add(record)

    def _note_mission(self, t_s: float, record: TickRecord) -> None:
        status = record.status
        now = (status.state, find_kind(status.fact), find_kind(status.refusal_fact))
        before, self._mission = self._mission, now
        if now[:2] != before[:2]:
            reason = f"{status.state}: {status.reason}" if status.reason else status.state
            self._add(t_s, "mission", reason, status.fact, status.state)
        for row in status.rows_unproven:
            if row not in self._unproven:
                lack = "driven without evidence that it was this row"
                self._add(t_s, "fault", f"row {row + 1} does not count as done: {lack}")
        self._unproven = status.rows_unproven
        if now[2] and now[2] not in (before[2], now[1]):
            self._add(t_s, "mission", status.refusal, status.refusal_fact)

    def _note_warning(self, t_s: float, warning: str, fact: Fact | None) -> None:
        before, was = self._warning
        if fact is not None and was is None:
            self._add(t_s, "fault", warning, fact)
        elif fact is None and was is not None:
            self._add(t_s, "clear", f"no more: {before}", was)
        self._warning = warning, fact

    def _note_supervisor(self, t_s: float, record: TickRecord) -> None:
        objection = find_kind(record.fact)
        is_stopped = record.status.stopped_fact is not None
        is_held = is_stopped and not objection  # no motion is requested
        if objection == self._objection or is_held:
            return
        self._objection = objection
        if not objection:
            self._add(t_s, "clear", "")
        elif record.command.drive != STOP:
            self._add(t_s, "limit", record.reason, record.fact)
        else:
            self._add(t_s, "stop" if self._moving else "hold", record.reason, record.fact)

    def _note_gate(self, t_s: float, gate: GateStatus, said: Fact | None) -> None:
        before, self._gate = self._gate, gate
        if gate is before:
            return
        if gate.checks and gate.checks is not before.checks:
            self._add(t_s, "check", describe_checks(gate.checks))
        if gate.state != before.state:
            reason = f"{before.state} -> {gate.state}: {gate.reason}"
            self._add(t_s, "gate", reason, gate.fact, gate.state)
        kind = find_kind(gate.warning_fact)
        if kind and kind not in (find_kind(before.warning_fact), find_kind(said)):
            self._add(t_s, "fault", gate.warning, gate.warning_fact)

    def _note_verdicts(self, t_s: float, verdicts: SensorVerdicts) -> None:
        """Note whose verdict is fine no more, where nothing else shows why, and whose is again."""
        before, self._verdicts = self._verdicts, verdicts
        for name in before | verdicts:
            was, now = before.get(name, FINE), verdicts.get(name, FINE)
            if was.state == "fine" != now.state:
                if now.fact is None or not any(fact.holds(now.fact) for fact in self._facts):
                    self._add(t_s, "fault", now.reason or f"{name} is {now.state}", now.fact)
            elif now.state == "fine" != was.state:
                self._add(t_s, "clear", f"{name} is fine again")

    def _add(
        self,
        t_s: float,
        kind: EventKind,
        reason: str,
        fact: Fact | None = None,
        state: MissionState | GateState | None = None,
    ) -> None:
        self._facts += [] if fact is None else [fact]
        self._found.append(make_event(t_s, kind, reason, fact, state))


def describe_checks(checks: Sequence[Check]) -> str:
    """Say what the list before the start found, in one line."""
    bad = [f"{check.name}: {check.text}" for check in checks if not check.is_ok]
    good = ", ".join(_name_good(check) for check in checks if check.is_ok)
    if not bad:
        return f"before the start all is good: {good}"
    return f"before the start not good: {'; '.join(bad)}" + (f". Good: {good}" if good else "")


def _name_good(check: Check) -> str:
    return f"{check.name} ({check.text})" if check.text else check.name


class EventLog:
    """A tap that writes one line for each change, never one for each tick.

    `on_failure` is called once when the disk fails under way; the events are kept, and written as
    soon as the disk takes them. Raises: RecordingError: the file cannot be created.
    """

    def __init__(self, path: Path, on_failure: Callable[[str], None] = lambda _: None) -> None:
        self._path, self._on_failure = path, on_failure
        self._events: list[Event] = []
        self._sieve = EventSieve()
        self._waiting = b""
        self._has_failed = False
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("wb", buffering=0)
        except OSError as error:
            raise self._make_error(error) from error

    @property
    def events(self) -> tuple[Event, ...]:
        return tuple(self._events)

    @property
    def dropouts(self) -> dict[ComingAndGoing, Dropouts]:
        """Dropouts until now, of the parts that had any."""
        return self._sieve.dropouts

    def list_since(self, index: int) -> list[Event]:
        """List the events after the first `index`; any thread may call it."""
        return self._events[index:]

    def list_kind(self, kind: EventKind) -> tuple[Event, ...]:
        return tuple(event for event in self._events if event.kind == kind)

    def __call__(self, record: TickRecord) -> None:
        for event in self._sieve(record):
            self.add(event)

    def add(self, event: Event) -> None:
        """Add an event that no tick holds, such as a recording that could not be begun."""
        self._events.append(event)
        self._waiting += write_event(event) + b"\n"
        self._write()

    def close(self) -> None:
        """Write what waits and close the file. Safe to call twice."""
        if not self._file.closed:
            self._write()
            self._file.close()

    def _write(self) -> None:
        """Write whole lines only; what does not fit waits."""
        if not self._waiting:
            return
        end = self._file.tell()
        try:
            rest = memoryview(self._waiting)
            while rest:
                rest = rest[self._file.write(rest) :]
        except OSError as error:
            with suppress(OSError):
                self._file.seek(end)
                self._file.truncate(end)
            if not self._has_failed:
                self._has_failed = True
                self._on_failure(str(self._make_error(error)))
        else:
            self._waiting, self._has_failed = b"", False

    def _make_error(self, error: OSError) -> RecordingError:
        return RecordingError(
            f"cannot write {self._path}: {error.strerror or error}; "
            "check that the folder is writable and the disk has room"
        )


def read_events(path: Path) -> tuple[Event, ...]:
    """Read an event log.

    Raises: RecordingError: no such file, or a line in it is no event.
    """
    try:
        lines = path.read_bytes().splitlines()
        return tuple(msgspec.json.decode(line, type=Event) for line in lines if line)
    except OSError as error:
        raise RecordingError(explain_unreadable(path, error)) from error
    except msgspec.MsgspecError as error:
        raise RecordingError(f"{path} is not an event log: {error}; name another file") from error


def read_whole_events(path: Path) -> tuple[Event, ...]:
    """Read the events that are whole: a run that was killed may have left half a line.

    Raises: RecordingError: no such file.
    """
    events = []
    try:
        lines = path.read_bytes().splitlines()
    except OSError as error:
        raise RecordingError(explain_unreadable(path, error)) from error
    for line in lines:
        with suppress(msgspec.MsgspecError, ValueError):
            events.append(msgspec.json.decode(line, type=Event))
    return tuple(events)
