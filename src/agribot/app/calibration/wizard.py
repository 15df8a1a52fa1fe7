"""A calibration beside a running stack: it drives as an operator does and ends with a result.

Its commands go through the inbox like those of a person, so that stops, hands, limits and the
watchdog of the base hold it, on every platform alike, and a replay of the recording repeats it.
"""

from __future__ import annotations

import math
import threading
from typing import Any

import msgspec

from agribot.app.calibration.coverage import Coverage
from agribot.app.calibration.figure import FigureDrive
from agribot.app.calibration.kinds import KINDS, CalibrationResult, Kind
from agribot.app.calibration.robot_file import RobotFile
from agribot.app.magnetometer import has_magnetometer
from agribot.autonomy.plan.mission.errand import STANDING_MPS
from agribot.core.config import RunConfig
from agribot.core.errors import AgribotError, MissionError
from agribot.core.facts import (
    AnyFact,
    CalibrationRuns,
    NoResult,
    NoSuchCalibration,
    NothingSeen,
    NoTickYet,
    RobotDrives,
    StopToClear,
)
from agribot.core.messages import (
    STOP,
    AddNote,
    AskerKind,
    Inbox,
    RequestEvent,
    SensorBatch,
    TickRecord,
    Who,
)
from agribot.core.refusal import find_fact
from agribot.core.robot import RobotSpec

BUSY = ("running", "waiting")  # states of a mission that sets off by itself
HARMLESS = ("note", "mark", "set", "start_recording", "stop_recording")
HELD_LIMIT_S = 1.0  # time that the supervisor may hold the robot before the drive is given up
ROOM_MARGIN_M = 1.0


class Wizard:
    """A tap of the stack; `answer` may be called from any thread.

    phases: idle -> driving -> computing -> found, or failed with a reason.
    """

    def __init__(self, inbox: Inbox, robot: RobotSpec, config: RunConfig, file: RobotFile) -> None:
        self._inbox, self._robot, self._config, self._file = inbox, robot, config, file
        self._has_compass = has_magnetometer(robot, config)
        self._lock = threading.RLock()
        self._record: TickRecord | None = None
        self._kind: Kind | None = None
        self._drive, self._coverage = FigureDrive(robot.drive), Coverage()
        self._found: CalibrationResult | None = None
        self._phase, self._reason = "idle", ""
        self._who = Who("calibration", AskerKind.PROGRAM)
        self._start_map_m = (math.nan, math.nan)
        self._free_s = -math.inf

    def __call__(self, record: TickRecord) -> None:
        with self._lock:
            self._record = record
            for event in record.batch.requests:
                self._on_event(event)
            hand = record.batch.hand
            if hand and hand[-1].who != self._who:
                self.interrupt(f"{hand[-1].who.name} took the robot")
            if self._phase == "driving" and (objection := self._find_objection(record)):
                self._fail(objection)
            if self._phase == "driving":
                self._drive.driven.scenes.extend(record.scenes)
                self._drive_on(record.batch)

    def interrupt(self, why: str) -> None:
        """End the drive because another client drives, or no client watches any more."""
        with self._lock:
            if self._phase == "driving":
                self._fail(why)

    def describe_progress(self) -> dict[str, Any] | None:
        """Describe the progress for the page's state; None while nothing is going on."""
        kind, phase = self._kind, self._phase
        if kind is None or phase == "idle":
            return None
        motion = self._drive.motion
        return {
            "kind": kind.name,
            "phase": phase,
            "motion": motion.name if motion else "",
            "share": round(self._drive.share, 3),
            "reason": self._reason,
            "directions": self._coverage.seen if kind.shows_directions else None,
        }

    def answer(self, values: dict[str, Any]) -> dict[str, Any]:
        """Do one of look, start, cancel, accept and undo, and return the state after it.

        `refusal` says why it was not done.
        """
        wanted, by = str(values.get("do")), str(values.get("by"))
        refusal: AnyFact | None = None
        try:
            with self._lock:
                if wanted == "start":
                    self._begin(str(values.get("kind")), by)
                elif wanted == "cancel":
                    self._cancel(by)
                elif wanted == "accept":
                    self._accept(by)
                elif wanted == "undo":
                    self._file.undo()
                    self._note(by, f"went back to the earlier {self._file.path}")
        except AgribotError as error:
            refusal = find_fact(error)
        return {**self._describe(), "refusal": refusal}

    @property
    def _kinds(self) -> dict[str, Kind]:
        """The calibrations of what the robot has."""
        has_camera = self._robot.camera is not None
        return {
            name: kind
            for name, kind in KINDS.items()
            if kind.suits(has_compass=self._has_compass, has_camera=has_camera)
        }

    def _describe(self) -> dict[str, Any]:
        try:
            settings, broken = self._file.settings(), ""
        except AgribotError as error:
            settings, broken = (), str(error)
        return {
            "kinds": [
                {"name": kind.name, "title": kind.title, "about": kind.about,
                 "ground": kind.ground, "duration_s": round(kind.duration_s)}
                for kind in self._kinds.values()
            ],
            "now": self.describe_progress(),
            "found": msgspec.to_builtins(self._found) if self._phase == "found" else None,
            "file": str(self._file.path),
            "settings": settings,
            "broken": broken,
            "can_undo": self._file.can_undo,
        }  # fmt: skip

    def _begin(self, name: str, by: str) -> None:
        """Begin to drive the figure of a calibration.

        Raises: MissionError: there is no such calibration, or the robot is not free for it.
        """
        record, kind = self._record, self._kinds.get(name)
        if kind is None:
            known = ", ".join(self._kinds)
            raise MissionError(NoSuchCalibration(name[:40], known))
        if self._phase in ("driving", "computing"):
            raise MissionError(CalibrationRuns())
        if record is None:
            raise MissionError(NoTickYet())
        if record.status.stopped_fact:
            raise MissionError(StopToClear(record.status.stopped_fact))
        if record.status.state in BUSY or abs(record.estimate.v_mps) > STANDING_MPS:
            raise MissionError(RobotDrives())
        if kind.needs_pictures and not (self._config.perception.enabled and self._robot.camera):
            raise MissionError(NothingSeen())
        self._kind, self._found, self._reason = kind, None, ""
        self._drive, self._coverage = FigureDrive(self._robot.drive, kind.figure), Coverage()
        self._who = Who(f"calibration of {by}", AskerKind.PROGRAM)
        estimate = record.estimate
        self._start_map_m = (
            (estimate.x_map_m, estimate.y_map_m) if estimate.ok else (math.nan, math.nan)
        )
        self._free_s = record.batch.t_s
        self._phase = "driving"
        self._note(by, f"starts the calibration '{name}'")

    def _cancel(self, by: str) -> None:
        if self._phase == "driving":
            self._fail(f"cancelled by {by}")
        elif self._phase != "computing":
            self._phase, self._found = "idle", None

    def _accept(self, by: str) -> None:
        """Write the result into the robot's file.

        Raises: MissionError: nothing to accept. ConfigError, RecordingError: as the file.
        """
        found = self._found
        if self._phase != "found" or found is None or not found.ok or not found.settings:
            raise MissionError(NoResult())
        self._file.add(found.settings)
        self._note(by, f"took over {', '.join(found.settings)} into {self._file.path}")
        self._phase, self._found = "idle", None

    def _on_event(self, event: RequestEvent) -> None:
        word = event.request.word
        if word not in HARMLESS and self._phase == "driving":
            self._fail(f"ended by '{word}' of {event.who.name}")

    def _find_objection(self, record: TickRecord) -> str:
        """Say why the robot must not go on; empty where it may."""
        estimate = record.estimate
        if record.status.state in BUSY:
            return "the mission went on"
        if record.status.stopped:
            return record.status.stopped
        if not record.reason or record.command.drive != STOP:
            self._free_s = record.batch.t_s
        if record.batch.t_s - self._free_s > HELD_LIMIT_S:
            return record.reason
        assert self._kind is not None
        limit_m = self._kind.space_m / 2.0 + ROOM_MARGIN_M
        away_m = math.dist((estimate.x_map_m, estimate.y_map_m), self._start_map_m)
        if estimate.ok and away_m > limit_m:  # false where the place is not known
            return f"{away_m:.1f} m from where it began, more than {limit_m:.1f} m"
        return ""

    def _drive_on(self, batch: SensorBatch) -> None:
        seen = msgspec.structs.replace(batch, frames=(), requests=(), notes=(), hand=())
        self._coverage.add(batch)
        try:
            command = self._drive.step(seen)
        except AgribotError as error:
            self._fail(str(error))
            return
        if command is None:
            self._phase = "computing"
            self._inbox.drive(0.0, 0.0, self._who)
            threading.Thread(target=self._compute_result, name="calibration", daemon=True).start()
        else:
            self._inbox.drive(command.v_mps, command.yaw_rate_radps, self._who)

    def _compute_result(self) -> None:
        """Fit in a thread of its own: that takes longer than a tick."""
        kind, driven = self._kind, self._drive.driven
        assert kind is not None
        try:
            found = kind.find(driven, self._robot, self._config)
        except Exception as error:  # noqa: BLE001 - else it would compute for ever
            unforeseen = f"internal error: {type(error).__name__}: {error}"
            with self._lock:
                self._fail(str(error) if isinstance(error, AgribotError) else unforeseen)
            return
        with self._lock:
            self._phase, self._found = "found", found

    def _fail(self, reason: str) -> None:
        self._inbox.drive(0.0, 0.0, self._who)
        self._phase, self._reason = "failed", reason
        self._note(self._who.name, f"ended: {reason}")

    def _note(self, by: str, text: str) -> None:
        self._inbox.post(AddNote(text=text), Who(by, AskerKind.OPERATOR))
