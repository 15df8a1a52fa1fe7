"""Requests of peers to the robot, the same for every protocol.

A request goes the same way as an operator's: into the inbox, past the supervisor. One that can only
bring the robot to rest is always accepted; one that can move it needs `allow_drive`.
"""

from __future__ import annotations

import math
import struct
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from agribot.autonomy.plan.ways.curves import Place
from agribot.core.messages import (
    AddNote,
    AnyRequest,
    AskerKind,
    ChangeSetting,
    ClearStop,
    ControlMission,
    ControlRecording,
    Estimate,
    Inbox,
    LiveSetting,
    MarkMoment,
    Path,
    PressStop,
    RequestWord,
    Who,
)
from agribot.ros.decoding import make_undecodable
from agribot.ros.robot_link import OnAnswer, OnOutcome, RobotLink

if TYPE_CHECKING:
    from agribot.ros.frames import PeerFrames

MIN_INTERVAL_S = 0.005  # least interval of twists; faster ones are dropped, except those that stop
_REPORT_PERIOD_S = 5.0
_KEPT_REASONS = 100
_MOVING: frozenset[RequestWord] = frozenset(
    {"resume", "clear_stop", "start", "skip_row", "return_home", "goto", "visit", "set"}
)

PlanWay = Callable[[Estimate, Place], Path]  # raises MissionError
Twist = tuple[float, float, float, float, float, float]  # linear x y z, angular x y z

SERVICES: tuple[tuple[str, AnyRequest], ...] = (
    ("/agribot/stop", PressStop()),
    ("/agribot/clear_stop", ClearStop()),
    ("/agribot/start", ControlMission(action="start")),
    ("/agribot/resume", ControlMission(action="resume")),
    ("/agribot/skip_row", ControlMission(action="skip_row")),
    ("/agribot/return_home", ControlMission(action="return_home")),
    ("/agribot/cancel", ControlMission(action="cancel")),
    ("/agribot/mark", MarkMoment()),
    ("/agribot/start_recording", ControlRecording(action="start")),
    ("/agribot/stop_recording", ControlRecording(action="stop")),
)
PAUSE_SERVICE = "/agribot/pause"  # true pauses, false resumes
# Service that takes the pose from the parameters initial_pose.
SET_POSE_SERVICE = "/agribot/set_pose"


class Requests:
    """Posts requests from any thread.

    `report` is called with each refusal and its reason, at most every few seconds for each. With a
    `link`, which must be a tap of the run, peers get the mission's own answers, and with `plan_way`
    routes.
    """

    def __init__(
        self,
        inbox: Inbox,
        *,
        allow_drive: bool = False,
        report: Callable[[str], None] = lambda _text: None,
        now_s: Callable[[], float] = time.monotonic,
        link: RobotLink | None = None,
        frames: PeerFrames | None = None,
        plan_way: PlanWay | None = None,
    ) -> None:
        self.allow_drive, self.link = allow_drive, link
        self.frames, self.plan_way = frames, plan_way
        self._inbox, self._report, self._now_s = inbox, report, now_s
        self._lock = threading.Lock()
        self._next_twist_s = -math.inf
        self._next_report_s: dict[str, float] = {}
        self._unreported: dict[str, int] = {}

    def request_twist(self, twist: Twist, source: str) -> None:
        """Request a body twist; only its forward speed and yaw rate exist on this robot.

        A twist that is not finite is passed on: the supervisor refuses it and stops the robot.
        """
        if not self.allow_drive:
            self.refuse(f"{source}: cmd_vel is refused; start with --allow-drive to take it")
            return
        is_finite = all(map(math.isfinite, twist))
        if not is_finite:
            self.refuse(f"{source}: cmd_vel is not finite; the robot stops")
            twist = (math.nan, 0.0, 0.0, 0.0, 0.0, math.nan)
        v_mps, left, up, roll, pitch, yaw_rate_radps = twist
        if left or up or roll or pitch:
            self.refuse(f"{source}: only linear.x and angular.z of cmd_vel count on this robot")
        moves = is_finite and (v_mps != 0.0 or yaw_rate_radps != 0.0)
        if self._is_too_fast(moves=moves):
            limit_hz = 1.0 / MIN_INTERVAL_S
            self.refuse(f"{source}: cmd_vel comes faster than {limit_hz:.0f} Hz; some are dropped")
            return
        self._inbox.drive(v_mps, yaw_rate_radps, Who(source, AskerKind.ROS))

    def _is_too_fast(self, *, moves: bool) -> bool:
        with self._lock:
            now_s = self._now_s()
            if moves and 0.0 < self._next_twist_s - now_s <= MIN_INTERVAL_S:
                return True  # a larger lead is a clock that was set back
            self._next_twist_s = now_s + MIN_INTERVAL_S
            return False

    def ask(self, request: AnyRequest, source: str, on_outcome: OnOutcome) -> None:
        """Post a request; call `on_outcome` once with what the mission makes of it.

        That is at once where the request is not allowed, else in the robot's thread, or in one of
        its own when the robot has not answered within a few seconds.
        """
        if self.link is None or self._find_refusal(request):
            on_outcome(*self.post(request, source))
            return

        def report_outcome(is_done: bool, text: str) -> None:
            if not is_done:
                self.refuse(f"{source}: {text}")
            on_outcome(is_done, text)

        self.link.ask(request, Who(source, AskerKind.ROS), report_outcome)

    def request_note(self, text: str, source: str) -> None:
        """Put a text into the recording; nothing moves."""
        self.post(AddNote(text=text), source)

    def post(
        self, request: AnyRequest, source: str, on_answer: OnAnswer | None = None
    ) -> tuple[bool, str]:
        """Post a request that is allowed; return whether it was, and the text for the peer.

        `on_answer` is called when the mission took or refused it, if there is a `link`.
        """
        if text := self._find_refusal(request):
            self.refuse(f"{source}: {text}")
            return False, text
        who = Who(source, AskerKind.ROS)
        if on_answer is not None and self.link is not None:
            self.link.post(request, who, on_answer)
        else:
            self._inbox.post(request, who)
        return True, f"'{request.word}' handed to the robot"

    def _find_refusal(self, request: AnyRequest) -> str:
        word = request.word
        if word in _MOVING and not self.allow_drive:
            return f"'{word}' can set the robot in motion; start with --allow-drive to take it"
        return ""

    def request_change(self, setting: LiveSetting, value: float, source: str) -> str:
        """Request a change of one of LIVE_SETTINGS; return the reason if it is refused, or ""."""
        done, text = self.post(ChangeSetting(setting=setting, value=value), source)
        return "" if done else text

    def refuse(self, why: str) -> None:
        """Report a refusal to the operator, with its number of times since the last report."""
        with self._lock:
            now_s = self._now_s()
            if len(self._unreported) > _KEPT_REASONS:  # names in reasons come from the peers
                self._unreported.clear()
                self._next_report_s.clear()
            count = self._unreported[why] = self._unreported.get(why, 0) + 1
            if now_s < self._next_report_s.get(why, -math.inf):
                return
            self._next_report_s[why] = now_s + _REPORT_PERIOD_S
            self._unreported[why] = 0
        self._report(why if count == 1 else f"{why} ({count} times)")


def read_twist_cdr(data: bytes) -> Twist:
    """Read a geometry_msgs/Twist in CDR.

    Raises: BridgeError: the bytes are no twist.
    """
    if len(data) != 52 or data[:2] not in {b"\x00\x01", b"\x00\x00"}:
        raise make_undecodable(data, "geometry_msgs/Twist, which has 52 in CDR")
    order = "<" if data[1] else ">"
    a, b, c, d, e, f = struct.unpack_from(order + "6d", data, 4)
    return (a, b, c, d, e, f)
