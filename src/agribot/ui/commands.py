"""What a page may ask for, judged by role, seat and source before the robot hears of it."""

from __future__ import annotations

import asyncio
import time
from typing import Any, Protocol, TypeGuard

import msgspec

from agribot.autonomy.plan.errand import STANDING_MPS
from agribot.core.json_number import is_number
from agribot.ui.channel import Channel
from agribot.ui.hub import Hub

MAX_NAME = 40
MAX_TEXT = 500
SCALES = (0.2, 0.5, 0.8, 1.0)
FIRST_SCALE = 0.5
SHAPES = ("polygon", "route")
MAX_CORNERS = 500
POSE_STD_M, POSE_STD_RAD = 0.3, 0.1  # of a place and a direction shown with a finger on a map
MAX_HAND_AGE_S = 0.5  # of a request to move: a hand that let go meanwhile cannot be heard yet
MISSION_ACTIONS = ("start", "pause", "resume", "cancel", "skip_row", "return_home")
RECORD_ACTIONS = {"start": "start_recording", "stop": "stop_recording"}


class Refused(Exception):
    """A page broke the rules; its line is cut."""


class Page(Protocol):
    """The connection that a request came by."""

    session: str
    name: str
    role: str | None

    @property
    def channel(self) -> Channel: ...

    def tell(self, message: dict[str, Any]) -> None: ...

    def acknowledge(self, count: int) -> None: ...


class Commands:
    def __init__(self, hub: Hub, page: Page) -> None:
        self._hub, self._page = hub, page
        self._scale = FIRST_SCALE
        self._is_driving = False
        self._requests: set[asyncio.Task[None]] = set()

    def obey(self, text: str) -> None:
        """Raises: Refused: no JSON object, or not of the kinds that a page sends."""
        try:
            message = msgspec.json.decode(text)
        except (msgspec.DecodeError, ValueError, RecursionError) as error:
            raise Refused(f"not JSON: {error}") from error
        if not isinstance(message, dict) or not isinstance(message.get("k"), str):
            raise Refused("a message is a JSON object with a kind 'k'")
        self._hub.seat.heard(self._page.session, time.monotonic())
        kind = message["k"]
        handler = getattr(self, f"_on_{kind}", None) if kind.isidentifier() else None
        if handler is None:
            raise Refused(f"unknown kind {kind[:40]!r}")
        handler(message)

    def let_go(self) -> None:
        """The line is gone: whatever it drove stands still."""
        if self._is_driving:
            self._drive(0.0, 0.0)

    def _on_ping(self, message: dict[str, Any]) -> None:
        """Answered with this machine's clocks: by them a page knows how old states are."""
        clocks = {"mono_ms": time.monotonic() * 1e3, "wall_ms": time.time() * 1e3}
        self._page.tell({"k": "pong", "c": message.get("c"), **clocks})

    def _on_got(self, message: dict[str, Any]) -> None:
        """How many messages the page has received since it was opened."""
        count = message.get("n")
        if not isinstance(count, int) or isinstance(count, bool) or count < 0:
            raise Refused("an acknowledgement needs the number n of messages received so far")
        self._page.acknowledge(count)

    def _on_name(self, message: dict[str, Any]) -> None:
        name = str(message.get("name", "")).strip()
        name = "".join(letter for letter in name if letter.isprintable())[:MAX_NAME]
        if name:
            self._page.name = name

    def _on_take(self, message: dict[str, Any]) -> None:
        hub, page = self._hub, self._page
        reason = self._not_operator()
        if not reason:
            before = hub.seat.holder
            is_forced = message.get("force") is True
            reason = hub.seat.take(page.session, page.name, time.monotonic(), force=is_forced)
            if not reason and before != page.session:
                hub.order({"c": "drive", "v": 0.0, "w": 0.0, "by": page.name})
                hub.note(page.name, "takes the operator's seat")
        self._ack(message, reason)
        hub.tell_seat()

    def _on_release(self, message: dict[str, Any]) -> None:
        if self._hub.seat.release(self._page.session):
            self._drive(0.0, 0.0)  # a calibration ends as well
            self._hub.note(self._page.name, "leaves the operator's seat")
            self._hub.tell_seat()
        self._ack(message, "")

    def _on_drive(self, message: dict[str, Any]) -> None:
        """Requests without the seat are dropped; the page sees in `seat` why."""
        v_mps, yaw_rate_radps = message.get("v"), message.get("w")
        if not is_number(v_mps) or not is_number(yaw_rate_radps):
            raise Refused("a drive request needs finite numbers v (m/s) and w (rad/s)")
        if self._no_seat() or ((v_mps or yaw_rate_radps) and _is_late(message.get("mono_ms"))):
            return
        robot = self._hub.about.robot
        limit_mps = self._scale * robot["max_speed_mps"]
        limit_radps = self._scale * robot["max_yaw_rate_radps"]
        self._drive(_clamped(v_mps, limit_mps), _clamped(yaw_rate_radps, limit_radps))

    def _on_scale(self, message: dict[str, Any]) -> None:
        value = message.get("value")
        if value not in SCALES:
            raise Refused(f"speed scale {value!r} is none of {SCALES}")
        self._scale = value
        self._ack(message, "")

    def _on_stop(self, message: dict[str, Any]) -> None:
        """Everybody may stop the robot: no seat, no role, also while a recording is shown."""
        self._hub.stops.press(self._page.name)
        self._is_driving = False
        self._ack(message, "")

    def _on_clear_stop(self, message: dict[str, Any]) -> None:
        if not self._no_seat():
            self._hub.stops.clear()
        self._operate(message, "clear_stop")

    def _on_mission(self, message: dict[str, Any]) -> None:
        action = str(message.get("action"))
        if action not in MISSION_ACTIONS:
            self._ack(message, f"this version of the mission knows no '{action[:40]}'")
            return
        self._operate(message, action)

    def _on_mark(self, message: dict[str, Any]) -> None:
        reason = self._not_operator()
        if not reason:
            text = str(message.get("text", "")).strip()[:MAX_TEXT]
            self._hub.event("mark", self._page.name, text)
        self._ack(message, reason)

    def _on_record(self, message: dict[str, Any]) -> None:
        """Begin or end a recording; nothing moves, so that no seat is needed."""
        action = RECORD_ACTIONS.get(str(message.get("action")))
        if action is None:
            raise Refused(f"a recording knows {', '.join(RECORD_ACTIONS)}")
        reason = self._not_operator()
        if not reason:
            self._hub.event(action, self._page.name)
        self._ack(message, reason)

    def _on_goto(self, message: dict[str, Any]) -> None:
        """A place to drive to, as RViz's 2D Goal; answered when the mission took or refused it."""
        place = (message.get("x"), message.get("y"), message.get("yaw"))
        numbers = tuple(float(number) for number in place if is_number(number))
        if len(numbers) != len(place) - (place[2] is None):
            raise Refused("a goal needs finite numbers x, y (m, map) and yaw (rad) or null")
        reason = self._no_seat()
        if reason:
            self._ack(message, reason)
            return
        request = asyncio.create_task(self._request(message, "goto", numbers))
        self._requests.add(request)
        request.add_done_callback(self._requests.discard)

    async def _request(
        self, message: dict[str, Any], action: str, numbers: tuple[float, ...]
    ) -> None:
        self._ack(message, await self._hub.request(action, self._page.name, numbers=numbers))

    def _on_point(self, message: dict[str, Any]) -> None:
        """A place that somebody clicked: into the recording, as RViz's Publish Point."""
        x_m, y_m = message.get("x"), message.get("y")
        if not is_number(x_m) or not is_number(y_m):
            raise Refused("a point needs finite numbers x and y (m, map)")
        self._hub.note(self._page.name, f"point: East {x_m:.3f} m, North {y_m:.3f} m")
        self._ack(message, "")

    def _on_shape(self, message: dict[str, Any]) -> None:
        """A polygon or route that somebody drew: into the recording."""
        what, corners = message.get("what"), message.get("xy")
        if what not in SHAPES or not _is_line(corners):
            raise Refused(f"a shape is one of {SHAPES} with up to {MAX_CORNERS} corners [x, y] (m)")
        places = ", ".join(f"{x_m:.2f} {y_m:.2f}" for x_m, y_m in corners)
        self._hub.note(self._page.name, f"{what} (East North, m): {places}")
        self._ack(message, "")

    def _on_pose_estimate(self, message: dict[str, Any]) -> None:
        """Where the robot stands, as RViz's 2D Pose Estimate; only a robot at rest believes it."""
        pose = message.get("x"), message.get("y"), message.get("yaw")
        stds = message.get("std_m", POSE_STD_M), message.get("std_rad", POSE_STD_RAD)
        numbers = tuple(float(value) for value in (*pose, *stds) if is_number(value))
        if len(numbers) != len(pose) + len(stds) or min(numbers[3:]) <= 0.0:
            raise Refused("a pose needs finite numbers x, y (m, map), yaw (rad) and sigmas above 0")
        reason = self._no_seat()
        if not reason and not self._is_at_rest():
            reason = "the robot drives; pause its mission first"
        if not reason:
            self._hub.event("pose_estimate", self._page.name, numbers=numbers)
        self._ack(message, reason)

    def _operate(self, message: dict[str, Any], action: str) -> None:
        reason = self._no_seat()
        if not reason:
            self._hub.event(action, self._page.name)
        self._ack(message, reason)

    def _is_at_rest(self) -> bool:
        text = self._hub.live.state_text
        speed_mps = msgspec.json.decode(text)["vel"][0] if text else None
        return speed_mps is not None and abs(speed_mps) <= STANDING_MPS

    def _drive(self, v_mps: float, yaw_rate_radps: float) -> None:
        self._is_driving = bool(v_mps or yaw_rate_radps)
        order = {"c": "drive", "v": v_mps, "w": yaw_rate_radps, "by": self._page.name}
        self._hub.order(order)

    def _no_seat(self) -> str:
        reason = self._not_operator()
        if not reason and self._hub.seat.holder != self._page.session:
            reason = "take the operator's seat first"
        return reason

    def _not_operator(self) -> str:
        if self._page.role != "operator":
            return "you are logged in as a viewer, who may look on and stop the robot"
        if self._page.channel is not self._hub.live or self._hub.live.source == "replay":
            return "a recording is shown; nothing can be commanded in it"
        if self._hub.is_robot_gone:
            return "the robot's program has ended"
        return ""

    def _ack(self, message: dict[str, Any], reason: str) -> None:
        if "id" in message or reason:
            answer = {"k": "ack", "id": message.get("id"), "ok": not reason, "reason": reason}
            self._page.tell(answer)


def _is_late(sent_ms: object) -> bool:
    """By the sender's estimate of this machine's clock; a hand that gives none is believed."""
    return is_number(sent_ms) and time.monotonic() - sent_ms / 1e3 > MAX_HAND_AGE_S


def _is_line(corners: object) -> TypeGuard[list[list[float]]]:
    return (
        isinstance(corners, list)
        and 0 < len(corners) <= MAX_CORNERS
        and all(isinstance(p, list) and len(p) == 2 and all(map(is_number, p)) for p in corners)
    )


def _clamped(value: float, limit: float) -> float:
    return min(max(float(value), -limit), limit)
