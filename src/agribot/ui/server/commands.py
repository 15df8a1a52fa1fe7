"""What a page may ask for, judged by role, seat and source before the robot hears of it."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import Any, Protocol

from msgspec import UNSET

from agribot.autonomy.plan.mission.errand import STANDING_MPS
from agribot.core.fact_text import render
from agribot.core.facts import (
    AnyFact,
    RecordingShown,
    RobotDrives,
    RobotEnded,
    SeatNeeded,
    ViewerOnly,
)
from agribot.core.messages import AnyRequest, Who
from agribot.core.request_text import describe_request
from agribot.ui import wire
from agribot.ui.server.channel import Channel
from agribot.ui.server.hub import Hub

MAX_NAME = 40
MAX_TEXT = 500
SCALES = (0.2, 0.5, 0.8, 1.0)
FIRST_SCALE = 0.5
MAX_CORNERS = 500
MAX_HAND_AGE_S = 0.5  # age of a request to move; a hand that let go meanwhile cannot be heard yet


class Refused(Exception):
    """A page broke the rules; its line is cut."""


class Page(Protocol):
    """The connection that a request came by."""

    session: str
    name: str
    role: str | None

    @property
    def who(self) -> Who: ...

    @property
    def channel(self) -> Channel: ...

    def send(self, message: wire.ServerMessage) -> None: ...

    def acknowledge(self, count: int) -> None: ...


class Commands:
    def __init__(self, hub: Hub, page: Page) -> None:
        self._hub, self._page = hub, page
        self._scale = FIRST_SCALE
        self._is_driving = False
        self._requests: set[asyncio.Task[None]] = set()
        self._handlers: dict[type[wire.Message], Callable[[Any], None]] = {
            wire.Ping: self._ping,
            wire.Receipt: self._acknowledge,
            wire.UseName: self._use_name,
            wire.TakeSeat: self._take_seat,
            wire.LeaveSeat: self._leave_seat,
            wire.DriveByHand: self._drive_by_hand,
            wire.ScaleSpeed: self._scale_speed,
            wire.PressStop: self._press_stop,
            wire.ClearStop: self._clear_stop,
            wire.ControlMission: self._control_mission,
            wire.ControlRecording: self._control_recording,
            wire.MarkMoment: self._mark_moment,
            wire.GoTo: self._go_to,
            wire.CorrectPose: self._correct_pose,
            wire.PointOut: self._point_out,
            wire.DrawShape: self._draw_shape,
        }

    def obey(self, message: wire.PageMessage) -> None:
        """Do what a page asks.

        Raises: Refused: a number in it is out of its limits.
        """
        self._hub.seat.note_life(self._page.session, time.monotonic())
        self._handlers[type(message)](message)

    def let_go(self) -> None:
        """Let whatever the lost line drove stand still."""
        if self._is_driving:
            self._drive(0.0, 0.0)

    def _ping(self, message: wire.Ping) -> None:
        """Answered with this machine's clocks: by them a page knows how old states are."""
        mono_ms, wall_ms = time.monotonic() * 1e3, time.time() * 1e3
        self._page.send(wire.Pong(sent_ms=message.sent_ms, mono_ms=mono_ms, wall_ms=wall_ms))

    def _acknowledge(self, message: wire.Receipt) -> None:
        if message.count < 0:
            raise Refused(f"{message.count} messages received; send a count of 0 or more")
        self._page.acknowledge(message.count)

    def _use_name(self, message: wire.UseName) -> None:
        letters = (letter for letter in message.name.strip() if letter.isprintable())
        self._page.name = "".join(letters)[:MAX_NAME] or self._page.name
        self._answer(message)

    def _take_seat(self, message: wire.TakeSeat) -> None:
        hub, page = self._hub, self._page
        reason = self._not_operator()
        if not reason:
            before = hub.seat.holder
            reason = hub.seat.take(page.session, page.name, time.monotonic(), force=message.force)
            if not reason and before != page.session:
                hub.order(wire.DriveOrder(v_mps=0.0, yaw_rate_radps=0.0, who=page.who))
                hub.note(page.who, "takes the operator's seat")
        self._answer(message, reason)
        hub.announce_seat()

    def _leave_seat(self, message: wire.LeaveSeat) -> None:
        if self._hub.seat.release(self._page.session):
            self._drive(0.0, 0.0)  # a calibration ends as well
            self._hub.note(self._page.who, "leaves the operator's seat")
            self._hub.announce_seat()
        self._answer(message)

    def _drive_by_hand(self, message: wire.DriveByHand) -> None:
        """Drop requests without the seat; the page sees in the seat's change why."""
        v_mps, yaw_rate_radps = message.v_mps, message.yaw_rate_radps
        if self._no_seat() or ((v_mps or yaw_rate_radps) and _is_late(message.mono_ms)):
            return
        robot = self._hub.about.robot
        limit_mps = self._scale * robot.max_speed_mps
        limit_radps = self._scale * robot.max_yaw_rate_radps
        self._drive(_clamp(v_mps, limit_mps), _clamp(yaw_rate_radps, limit_radps))

    def _scale_speed(self, message: wire.ScaleSpeed) -> None:
        if message.ratio not in SCALES:
            raise Refused(f"speed scale {message.ratio!r} is unknown; send one of {SCALES}")
        self._scale = message.ratio
        self._answer(message)

    def _press_stop(self, message: wire.PressStop) -> None:
        """Everybody may stop the robot: no seat, no role, also while a recording is shown."""
        self._hub.stops.press(self._page.who)
        self._is_driving = False
        self._answer(message, RobotEnded() if self._hub.is_robot_gone else None)

    def _clear_stop(self, message: wire.ClearStop) -> None:
        if not self._no_seat():
            self._hub.stops.clear()
        self._operate(message)

    def _control_mission(self, message: wire.ControlMission) -> None:
        self._operate(message)

    def _control_recording(self, message: wire.ControlRecording) -> None:
        """Begin or end a recording; nothing moves, so that no seat is needed."""
        reason = self._not_operator()
        if not reason:
            self._hub.send(message, self._page.who)
        self._answer(message, reason)

    def _mark_moment(self, message: wire.MarkMoment) -> None:
        reason = self._not_operator()
        if not reason:
            self._hub.send(wire.MarkMoment(text=message.text.strip()[:MAX_TEXT]), self._page.who)
        self._answer(message, reason)

    def _go_to(self, message: wire.GoTo) -> None:
        """Answered when the mission took or refused it."""
        reason = self._no_seat()
        if reason:
            self._answer(message, reason)
            return
        request = asyncio.create_task(self._request(message))
        self._requests.add(request)
        request.add_done_callback(self._requests.discard)

    async def _request(self, message: AnyRequest) -> None:
        self._answer(message, await self._hub.request(message, self._page.who))

    def _point_out(self, message: wire.PointOut) -> None:
        """Publish and record a place that somebody clicked, as RViz's Publish Point."""
        self._draw(message)
        self._answer(message)

    def _draw_shape(self, message: wire.DrawShape) -> None:
        """Publish and record a polygon or route that somebody drew."""
        corners = message.corners_map_m
        if not 0 < len(corners) <= MAX_CORNERS:
            raise Refused(f"{len(corners)} corners of a shape; send 1 to {MAX_CORNERS}")
        self._draw(message)
        self._answer(message)

    def _draw(self, drawn: wire.PointOut | wire.DrawShape) -> None:
        """Publish what an operator draws; what a viewer draws is a note in the recording."""
        if self._page.role == "operator":
            self._hub.draw(drawn, self._page.who)
        else:
            self._hub.note(self._page.who, describe_request(drawn), "viewer")

    def _correct_pose(self, message: wire.CorrectPose) -> None:
        """Only a robot at rest believes it."""
        if min(message.std_m, message.std_rad) <= 0.0:
            raise Refused(
                f"sigmas {message.std_m:g} m and {message.std_rad:g} rad of a pose; send more "
                "than 0"
            )
        reason = self._no_seat()
        if not reason and not self._is_at_rest():
            reason = RobotDrives()
        if not reason:
            self._hub.send(message, self._page.who)
        self._answer(message, reason)

    def _operate(self, message: wire.ClearStop | wire.ControlMission) -> None:
        reason = self._no_seat()
        if not reason:
            self._hub.send(message, self._page.who)
        self._answer(message, reason)

    def _is_at_rest(self) -> bool:
        state = self._hub.live.state
        speed_mps = None if state is None else state.v_mps
        return speed_mps is not None and abs(speed_mps) <= STANDING_MPS

    def _drive(self, v_mps: float, yaw_rate_radps: float) -> None:
        self._is_driving = bool(v_mps or yaw_rate_radps)
        who = self._page.who
        self._hub.order(wire.DriveOrder(v_mps=v_mps, yaw_rate_radps=yaw_rate_radps, who=who))

    def _no_seat(self) -> AnyFact | None:
        reason = self._not_operator()
        if not reason and self._hub.seat.holder != self._page.session:
            reason = SeatNeeded()
        return reason

    def _not_operator(self) -> AnyFact | None:
        if self._page.role != "operator":
            return ViewerOnly()
        if self._page.channel is not self._hub.live or self._hub.live.source == "replay":
            return RecordingShown()
        return RobotEnded() if self._hub.is_robot_gone else None

    def _answer(self, message: wire.Request, reason: AnyFact | None = None) -> None:
        if message.id or reason:
            verdict = wire.Verdict(
                id=message.id, ok=not reason, reason=render(reason), reason_fact=reason or UNSET
            )
            self._page.send(verdict)


def _is_late(sent_ms: float | None) -> bool:
    """Return whether a request is late by the sender's clock; one without a time is not."""
    return sent_ms is not None and time.monotonic() - sent_ms / 1e3 > MAX_HAND_AGE_S


def _clamp(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)
