"""Every value that crosses a layer. Immutable, SI units, the unit in the name.

Frames (REP-103, REP-105):
    map     local East-North-Up, metres, origin at the field datum.
    body    on the ground under the robot's centre: x forward, y left, z up.
    camera  optical: x right, y down, z forward.
Yaw is counter-clockwise from East, radians, in (-pi, pi].
`t_s` is the capture time on the platform clock, never the time a value was read.
"""

from agribot.core.messages.arrays import ByteArray, ComplexArray, FloatArray, Four, MapPoint, Vec3
from agribot.core.messages.command import STOP, DriveCommand, ImplementCommand, RobotCommand
from agribot.core.messages.estimate import (
    FINE,
    Estimate,
    SensorState,
    SensorVerdict,
    SensorVerdicts,
)
from agribot.core.messages.gate import Check, GateState, GateStatus
from agribot.core.messages.mission import (
    Goal,
    MissionState,
    MissionStatus,
    Path,
    RequestAnswer,
    Row,
)
from agribot.core.messages.operator import INBOX_LIMIT, HandDrive, Inbox
from agribot.core.messages.requests import (
    LIVE_SETTINGS,
    AddNote,
    AnyRequest,
    AskerKind,
    ChangeSetting,
    ClearStop,
    ControlMission,
    ControlRecording,
    CorrectPose,
    DrawShape,
    GoTo,
    LiveSetting,
    MarkMoment,
    MissionAction,
    PauseFor,
    PointOut,
    PressStop,
    RecordingAction,
    RequestEvent,
    RequestWord,
    ShapeKind,
    StopFor,
    TakePlan,
    Visit,
    Who,
)
from agribot.core.messages.seen import (
    CropCover,
    GroundPlant,
    MappedPlant,
    PlantClass,
    RowLine,
    Scene,
    WeedScores,
)
from agribot.core.messages.sensors import (
    MIDDLE_WHEEL_NAMES,
    WHEEL_NAMES,
    BaseFix,
    BatterySample,
    BoardSample,
    BumperSample,
    CameraFrame,
    ContactorSample,
    DeviceNote,
    GnssFix,
    GnssHeading,
    GnssQuality,
    GnssStatus,
    ImuSample,
    LaserScan,
    MagSample,
    MiddleWheel,
    ObstacleSample,
    OtherSample,
    SafetyInput,
    Satellite,
    SensorBatch,
    Unmeasured,
    WheelSample,
)
from agribot.core.messages.tick import TickRecord, Tracking

__all__ = [
    "FINE", "INBOX_LIMIT", "LIVE_SETTINGS", "MIDDLE_WHEEL_NAMES", "STOP", "WHEEL_NAMES",
    "AddNote", "AnyRequest", "AskerKind", "BaseFix", "BatterySample", "BoardSample", "BumperSample",
    "ByteArray", "CameraFrame", "ChangeSetting", "Check", "ClearStop", "ComplexArray",
    "ContactorSample", "ControlMission", "ControlRecording", "CorrectPose", "CropCover",
    "DeviceNote", "DrawShape", "DriveCommand", "Estimate", "FloatArray", "Four", "GateState",
    "GateStatus", "GnssFix", "GnssHeading", "GnssQuality", "GnssStatus", "GoTo", "Goal",
    "GroundPlant", "HandDrive", "ImplementCommand", "ImuSample", "Inbox", "LaserScan",
    "LiveSetting", "MagSample", "MapPoint", "MappedPlant", "MarkMoment", "MiddleWheel",
    "MissionAction", "MissionState", "MissionStatus", "ObstacleSample", "OtherSample", "Path",
    "PauseFor", "PlantClass", "PointOut", "PressStop", "RecordingAction", "RequestAnswer",
    "RequestEvent",
    "RequestWord", "RobotCommand", "Row", "RowLine", "SafetyInput", "Satellite", "Scene",
    "SensorBatch", "SensorState", "SensorVerdict", "SensorVerdicts", "ShapeKind", "StopFor",
    "TakePlan", "TickRecord", "Tracking", "Unmeasured", "Vec3", "Visit", "WeedScores",
    "WheelSample", "Who",
]  # fmt: skip
