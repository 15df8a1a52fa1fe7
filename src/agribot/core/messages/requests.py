"""What people and programs ask of a robot, each as a tagged message, and who asks.

A page's requests are these very messages: they keep their type from the wire to the part of the
robot that judges them. `id` is chosen by the sender that waits for an answer.
"""

from __future__ import annotations

import re
from enum import StrEnum
from typing import ClassVar, Literal

import msgspec

from agribot.core.facts import AnyFact
from agribot.core.messages.arrays import MapPoint

# The word of a request in logs, in the mission's table and for peers.
RequestWord = Literal[
    "start", "pause", "resume", "cancel", "stop", "clear_stop", "skip_row", "return_home", "note",
    "set", "pose_estimate", "goto", "visit", "plan", "mark", "start_recording", "stop_recording",
    "nudge_left", "nudge_right", "point_out", "draw_polygon", "draw_route",
]  # fmt: skip
MissionAction = Literal[
    "start", "pause", "resume", "cancel", "skip_row", "return_home", "nudge_left", "nudge_right"
]
RecordingAction = Literal["start", "stop"]
ShapeKind = Literal["polygon", "route"]
LiveSetting = Literal["mission.speed_mps", "treatment.enabled"]
LIVE_SETTINGS: tuple[LiveSetting, ...] = ("mission.speed_mps", "treatment.enabled")


def find_live_setting(name: str) -> LiveSetting | None:
    """Find the setting of a name among those that can be changed under way."""
    return next((setting for setting in LIVE_SETTINGS if setting == name), None)


class AskerKind(StrEnum):
    """What kind of asker sent a request."""

    OPERATOR = "operator"
    VIEWER = "viewer"
    ROS = "ros"  # a peer in ROS 1, ROS 2, DDS or Foxglove
    SCRIPT = "script"  # a program in Python that holds the run
    PROGRAM = "program"  # a part of the robot's own program
    PLUG_IN = "plug-in"
    UNKNOWN = "unknown"  # a visitor without a role, or of a recording of an earlier version


class Who(msgspec.Struct, frozen=True, omit_defaults=True):
    """Who asks. The name is shown to people and decides nothing."""

    name: str = "operator"
    kind: AskerKind = AskerKind.OPERATOR


def name_kind(class_name: str) -> str:
    """Name a tagged message: its class in snake case."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", class_name).lower()


class Message(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag=name_kind):
    """Something that is said once; `kind` names it."""


class Request(Message, frozen=True, kw_only=True):
    """A message that an answer with its `id` settles; without one, only its refusal is sent."""

    id: str = ""


class RobotRequest(Request, frozen=True, kw_only=True):
    """A request that reaches the robot."""

    _word: ClassVar[RequestWord]

    @property
    def word(self) -> RequestWord:
        return self._word


class PressStop(RobotRequest, frozen=True, kw_only=True):
    """Stand still until the stop is cleared; anybody may say so."""

    _word: ClassVar[RequestWord] = "stop"


class StopFor(RobotRequest, frozen=True, kw_only=True):
    """Stand still until the stop is cleared, for a cause."""

    _word: ClassVar[RequestWord] = "stop"
    cause: AnyFact


class ClearStop(RobotRequest, frozen=True, kw_only=True):
    """Let the robot go after a stop."""

    _word: ClassVar[RequestWord] = "clear_stop"


class ControlMission(RobotRequest, frozen=True, kw_only=True):
    """Do `action`.

    "start" restarts a mission that has ended and resumes one that is paused. The two nudges move
    the line of the row under the robot aside, a step each.
    """

    action: MissionAction

    @property
    def word(self) -> RequestWord:
        return self.action


class PauseFor(RobotRequest, frozen=True, kw_only=True):
    """Pause the mission, for a cause."""

    _word: ClassVar[RequestWord] = "pause"
    cause: AnyFact


class GoTo(RobotRequest, frozen=True, kw_only=True):
    """Drive to a place, as RViz's 2D Goal; answered when the mission took or refused it."""

    _word: ClassVar[RequestWord] = "goto"
    x_map_m: float
    y_map_m: float
    yaw_map_rad: float | None = None

    @property
    def place(self) -> tuple[float, ...]:
        """x, y (m, map) and, where it matters, yaw (rad)."""
        yaw = () if self.yaw_map_rad is None else (self.yaw_map_rad,)
        return (self.x_map_m, self.y_map_m, *yaw)


class Visit(RobotRequest, frozen=True, kw_only=True):
    """Make places the mission, which is called `title` from then on."""

    _word: ClassVar[RequestWord] = "visit"
    places_map_m: tuple[MapPoint, ...]
    title: str = ""


class TakePlan(RobotRequest, frozen=True, kw_only=True):
    """Make a field plan (GeoJSON) the mission of a robot that stands."""

    _word: ClassVar[RequestWord] = "plan"
    geojson: str


class ChangeSetting(RobotRequest, frozen=True, kw_only=True):
    """Change one of LIVE_SETTINGS; of one that is on or off, 0 is off."""

    _word: ClassVar[RequestWord] = "set"
    setting: LiveSetting
    value: float


class CorrectPose(RobotRequest, frozen=True, kw_only=True):
    """Where a robot at rest stands, as RViz's 2D Pose Estimate, with one sigma of each."""

    _word: ClassVar[RequestWord] = "pose_estimate"
    x_map_m: float
    y_map_m: float
    yaw_map_rad: float
    std_m: float = 0.3  # place and direction shown with a finger on a map
    std_rad: float = 0.1

    @property
    def pose(self) -> tuple[float, float, float, float, float]:
        """x, y (m, map), yaw (rad) and their sigmas."""
        return self.x_map_m, self.y_map_m, self.yaw_map_rad, self.std_m, self.std_rad


class ControlRecording(RobotRequest, frozen=True, kw_only=True):
    action: RecordingAction

    @property
    def word(self) -> RequestWord:
        return "start_recording" if self.action == "start" else "stop_recording"


class MarkMoment(RobotRequest, frozen=True, kw_only=True):
    """Mark this moment in the recording."""

    _word: ClassVar[RequestWord] = "mark"
    text: str = ""


class AddNote(RobotRequest, frozen=True, kw_only=True):
    """Add a text to the recording; nothing else changes."""

    _word: ClassVar[RequestWord] = "note"
    text: str


class PointOut(RobotRequest, frozen=True, kw_only=True):
    """A place that somebody clicked, for the recording."""

    _word: ClassVar[RequestWord] = "point_out"
    x_map_m: float
    y_map_m: float


class DrawShape(RobotRequest, frozen=True, kw_only=True):
    """A polygon or route that somebody drew, for the recording."""

    shape: ShapeKind
    corners_map_m: tuple[MapPoint, ...]

    @property
    def word(self) -> RequestWord:
        return "draw_polygon" if self.shape == "polygon" else "draw_route"


AnyRequest = (
    PressStop | StopFor | ClearStop | ControlMission | PauseFor | GoTo | Visit | TakePlan
    | ChangeSetting | CorrectPose | ControlRecording | MarkMoment | AddNote | PointOut | DrawShape
)  # fmt: skip


class RequestEvent(msgspec.Struct, frozen=True, kw_only=True):
    """A request at the time at which the robot took it, and who asked."""

    t_s: float
    who: Who
    request: AnyRequest
