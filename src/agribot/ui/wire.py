"""Every message between robot, server, page and hands, and every body of the page's requests.

Nothing else says what crosses the wire: `web/src/wire.ts` and the list of the page's screens are
generated from this module (`make generate`), the tests' robot and clients are built from it.

A message is a JSON object whose `kind` names one of these structs, in both directions. What asks
for something carries an `id` that its sender chose; what answers it carries the same one. Frames
and units are those of `core.messages`: the map is East-North-Up, `_map_m` are its metres; `mono_ms`
is the robot's steady clock, which no clock of a page or of the day disturbs.

A text `reason` that is made of a fact has `reason_fact` beside it, and so has every other such text
by its own name. It stays in the server, which writes the text in the language of each page.
"""

from __future__ import annotations

import struct
from typing import Any, Literal

import msgspec
from msgspec import UNSET, UnsetType

from agribot.core.facts import AnyFact
from agribot.core.messages import GateState, PlantClass, SensorState, requests

# The robot's own requests cross as they are.
Message = requests.Message
Request = requests.Request
AnyRequest = requests.AnyRequest
Who = requests.Who
MissionAction = requests.MissionAction
RecordingAction = requests.RecordingAction
ShapeKind = requests.ShapeKind
PressStop = requests.PressStop
ClearStop = requests.ClearStop
ControlMission = requests.ControlMission
ControlRecording = requests.ControlRecording
MarkMoment = requests.MarkMoment
GoTo = requests.GoTo
CorrectPose = requests.CorrectPose
PointOut = requests.PointOut
DrawShape = requests.DrawShape

# The page's screens in the order of its rail: each is the file of its name in `web/src/screens`.
# The first four are the tabs of a phone.
SCREENS = (
    "drive", "teleop", "camera", "weeds", "plan", "plots", "robot", "recordings", "settings",
    "health",
)  # fmt: skip

# Name and unit of every signal that a plot can show; a sample is its time and these, in order.
SIGNALS = (
    ("v_mps", "m/s"),
    ("yaw_rate_radps", "rad/s"),
    ("v_commanded_mps", "m/s"),
    ("yaw_rate_commanded_radps", "rad/s"),
    ("cross_track_m", "m"),
    ("heading_error_rad", "rad"),
    ("pos_std_m", "m"),
    ("yaw_std_rad", "rad"),
    ("battery_v", "V"),
    ("protection_m", "m"),
)

# A picture on its way to a page: kind (0 image, 1 mask), step of the ladder of sizes, nothing,
# number of the frame, the clock of the day (ms). A JPEG or PNG file follows.
CAMERA_HEAD = struct.Struct(">BBHId")
# The same from the robot to the server: kind, number, clock (ms), height and width. Pixels follow.
PIXELS_HEAD = struct.Struct(">BIdHH")

# Endings of the names of what stands beside a text: its fact, and what a page compares instead, the
# kinds of that fact and of those inside it.
FACT, KINDS = "_fact", "_kinds"

Vec2 = tuple[float, float]
Mode = Literal["mission", "paused", "teleop", "stopped", "waiting", "done", "replay"]
Role = Literal["operator", "viewer"]
SeatState = Literal["you", "free", "other"]
EventLevel = Literal["info", "warn", "fault"]
CheckState = Literal["ok", "warn", "fault"]
CasterState = Literal["asked", "connected", "failed"]
CalibrationPhase = Literal["driving", "computing", "found", "failed"]
CalibrationAction = Literal["look", "start", "cancel", "accept", "undo"]
SettingType = Literal["number", "boolean", "string", "choice"]
SettingValue = float | bool | str
PanelKind = Literal["layer", "plot", "form", "image", "button", "listener"]
Sample = list[float | None]


class BadMessage(Exception):
    """A message that is not one of those accepted there; `id` is the one it carries."""

    def __init__(self, reason: str, id: str = "") -> None:
        super().__init__(reason)
        self.id = id


# ---------------------------------------------------------------- page to server


class Ping(Message, frozen=True, kw_only=True):
    """Answered at once by a pong; `sent_ms` is the sender's own clock."""

    sent_ms: float


class Receipt(Message, frozen=True, kw_only=True):
    """How many messages the page has received since it was opened."""

    count: int


class UseName(Request, frozen=True, kw_only=True):
    """What the others are shown as the name of this page's operator."""

    name: str


class TakeSeat(Request, frozen=True, kw_only=True):
    """Operate the robot from now on; `force` takes the seat from its holder."""

    force: bool = False


class LeaveSeat(Request, frozen=True, kw_only=True):
    """Hand the operator's seat back."""


class DriveByHand(Message, frozen=True, kw_only=True):
    """A body twist that holds for a moment; `mono_ms` is the robot's clock when it was wanted."""

    v_mps: float
    yaw_rate_radps: float
    mono_ms: float | None = None


class ScaleSpeed(Request, frozen=True, kw_only=True):
    """The share of the robot's speed that this page's hand may use."""

    ratio: float


PageRequest = (
    UseName | TakeSeat | LeaveSeat | ScaleSpeed | PressStop | ClearStop | ControlMission
    | ControlRecording | MarkMoment | GoTo | CorrectPose | PointOut | DrawShape
)  # fmt: skip
PageMessage = Ping | Receipt | DriveByHand | PageRequest


# ---------------------------------------------------------------- what is shown, to the page


class GnssState(msgspec.Struct, frozen=True, kw_only=True):
    """The newest fix; `quality` has the numbers of NMEA GGA field 6; 0 is no fix."""

    lat_deg: float
    lon_deg: float
    quality: int
    std_m: float | None


class BatteryState(msgspec.Struct, frozen=True, kw_only=True):
    voltage_v: float
    charge_pct: float | None


class MissionProgress(msgspec.Struct, frozen=True, kw_only=True):
    """How far the mission is: `row` is -1 between rows, `eta_s` null unless it drives."""

    state: str
    reason: str = ""
    reason_fact: AnyFact | UnsetType = UNSET
    reason_kinds: list[str] | UnsetType = UNSET
    row: int = -1
    rows_total: int = 0
    rows_done: int = 0
    s_m: float = 0.0
    length_m: float = 0.0
    eta_s: float | None = None
    waypoints_total: int = 0
    waypoints_reached: int = 0
    leg: str = ""
    refusal: str = ""
    refusal_fact: AnyFact | UnsetType = UNSET


class CalibrationProgress(msgspec.Struct, frozen=True, kw_only=True):
    """A calibration that is under way, or has ended and is not put aside yet.

    `directions` are those that the compass has seen until now; null for any other.
    """

    kind: str
    phase: CalibrationPhase
    motion: str
    share: float
    reason: str
    directions: list[bool] | None


class ReplayProgress(msgspec.Struct, frozen=True, kw_only=True):
    """Where in the recording of this name the page is."""

    name: str
    t_s: float
    start_s: float
    end_s: float
    speed: float


class ImplementLine(msgspec.Struct, frozen=True, kw_only=True):
    """One line of the implement's own status, in its own words."""

    name: str
    text: str


class ShownGate(msgspec.Struct, frozen=True, kw_only=True):
    """State of the last gate before the motors, the time from which on it is so, and why.

    `reason` is empty where the state of the robot says it already.
    """

    state: GateState
    since_s: float
    reason: str = ""
    reason_fact: AnyFact | UnsetType = UNSET
    reason_kinds: list[str] | UnsetType = UNSET


class StartCheck(msgspec.Struct, frozen=True, kw_only=True, array_like=True):
    """An item of the list before the start, and what is wrong with it; good where nothing is.

    `remark` is what is to be known of one that is good.
    """

    name: str
    wrong: str = ""
    remark: str = ""
    wrong_kinds: list[str] = []
    remark_kinds: list[str] = []
    wrong_fact: AnyFact | None = None
    remark_fact: AnyFact | None = None


class SensorDoubt(msgspec.Struct, frozen=True, kw_only=True):
    """What is held against a sensor, and the time from which on."""

    sensor: str
    state: SensorState
    since_s: float | None = None
    reason: str = ""
    reason_fact: AnyFact | UnsetType = UNSET
    reason_kinds: list[str] | UnsetType = UNSET


class State(Message, frozen=True, kw_only=True):
    """The robot at one of its ticks, and the samples of its signals since the state before.

    `pose` is x, y (m) and yaw (rad) in the map, null while it is not known; `tilt_rad` roll and
    pitch. `mono_ms` is when the robot was so. `gnss` is null before the first fix, and again once
    the robot calls GNSS silent. `recording` is the folder that is being written, empty while
    nothing is recorded, null where nothing can be. `checks` is the newest list before a start,
    `doubts` are the sensors that are not fine.
    """

    tick: int
    t_s: float
    epoch: int = 0
    mono_ms: float = 0.0
    pose: tuple[float, float, float] | None = None
    pos_std_m: float | None = None
    yaw_std_rad: float | None = None
    v_mps: float | None = None
    yaw_rate_radps: float | None = None
    cross_track_m: float | None = None
    joints_rad: list[float] = msgspec.field(default_factory=list)
    tilt_rad: tuple[float, float] | None = None
    gnss: GnssState | None = None
    battery: BatteryState | None = None
    mission: MissionProgress | None = None
    mode: Mode = "waiting"
    stop: str = ""
    stop_fact: AnyFact | UnsetType = UNSET
    stop_kinds: list[str] | UnsetType = UNSET
    reason: str = ""
    reason_fact: AnyFact | UnsetType = UNSET
    reason_kinds: list[str] | UnsetType = UNSET
    gate: ShownGate | None = None
    checks: list[StartCheck] = msgspec.field(default_factory=list)
    doubts: list[SensorDoubt] = msgspec.field(default_factory=list)
    implement: list[ImplementLine] = msgspec.field(default_factory=list)
    weed_count: int = 0
    pace_ratio: float | None = None
    recording: str | None = None
    calibration: CalibrationProgress | None = None
    replay: ReplayProgress | None = None
    signals: list[Sample] = msgspec.field(default_factory=list)


class Weed(msgspec.Struct, frozen=True, kw_only=True, array_like=True):
    """A plant of the weed map; on the wire a row of these columns, for there may be 50,000."""

    id: int
    plant: PlantClass
    x_map_m: float
    y_map_m: float
    std_m: float
    confidence: float
    area_m2: float
    sightings: int
    first_seen_s: float
    last_seen_s: float
    treated_s: float | None = None
    left: str = ""


class LogEvent(msgspec.Struct, frozen=True, kw_only=True):
    """A line of the log; `state` is the new one of the mission or the gate, where that changed."""

    t_s: float
    level: EventLevel
    source: str
    text: str
    text_fact: AnyFact | UnsetType = UNSET
    state: str = ""


class TracePiece(Message, frozen=True, kw_only=True, tag="trace"):
    """Places where the robot was, from the one with the number `first` on."""

    epoch: int = 0
    first: int = 0
    points_map_m: list[Vec2] = msgspec.field(default_factory=list)


class PathPiece(Message, frozen=True, kw_only=True, tag="path"):
    """The planned path from its point with the number `first` on; 0 begins another path.

    `rows` is the crop row of each point, -1 between rows.
    """

    epoch: int = 0
    first: int = 0
    points_map_m: list[Vec2] = msgspec.field(default_factory=list)
    rows: list[int] = msgspec.field(default_factory=list)


class WeedChanges(Message, frozen=True, kw_only=True, tag="weeds"):
    """Plants that are new or different, and the numbers of those that are gone."""

    epoch: int = 0
    set: list[Weed] = msgspec.field(default_factory=list)
    gone: list[int] = msgspec.field(default_factory=list)


class NewEvents(Message, frozen=True, kw_only=True, tag="events"):
    epoch: int = 0
    events: list[LogEvent] = msgspec.field(default_factory=list)


class SeenSatellite(msgspec.Struct, frozen=True, kw_only=True, array_like=True):
    """A satellite by system (GP, GL, GA, GB, GQ, SB) and number; `snr_db` is 0 where unheard."""

    system: str
    number: int
    elevation_deg: int
    azimuth_deg: int
    snr_db: int
    is_used: bool


class ReceiverState(Message, frozen=True, kw_only=True, tag="receiver"):
    """The GNSS receiver's status, once a second where it is new; null and empty: not reported.

    Ages are those when the message was made. `quality` has the numbers of NMEA GGA field 6,
    `std_m` is 1 sigma of East and of North. `device` is where it is read from, empty for the
    platform's own receiver. The counts are of all satellites; `satellites` has the most
    important. `correction_hz` counts the messages of `caster` that were passed on, and
    `correction_use_ratio` is the share of those since the state before that the receiver says to
    have used. The troubles are for a person. `unmeasured` is how a place came about without
    satellites ("dead reckoning", "held"), and `unread` names kinds of messages that are not read.
    """

    epoch: int = 0
    is_simulated: bool = False
    device: str = ""
    fix_age_s: float | None = None
    quality: int = 0
    std_m: float | None = None
    rate_hz: float | None = None
    status_age_s: int | None = None
    satellites: list[SeenSatellite] = msgspec.field(default_factory=list)
    used_count: int = 0
    in_view_count: int = 0
    hdop: float | None = None
    pdop: float | None = None
    vdop: float | None = None
    correction_age_s: float | None = None
    correction_hz: float | None = None
    correction_use_ratio: float | None = None
    caster: str = ""
    caster_state: CasterState | None = None
    correction_trouble: str = ""
    line_trouble: str = ""
    unmeasured: str = ""
    position_trouble: str = ""
    unread: list[str] = msgspec.field(default_factory=list)


class SignalTable(msgspec.Struct, frozen=True, kw_only=True):
    names: list[str]
    units: list[str]


class Snapshot(Message, frozen=True, kw_only=True):
    """The beginning of everything that is shown from now on; what is left follows in pieces.

    `epoch` names what is shown, and the stretch of it, as in all that belongs to it. `source` is
    the robot's platform, "replay" or "description".
    """

    epoch: int
    source: str
    name: str
    signals: SignalTable
    trace: TracePiece
    path: PathPiece
    weeds: WeedChanges
    events: NewEvents


Growth = TracePiece | PathPiece | WeedChanges | NewEvents | ReceiverState


# ---------------------------------------------------------------- the rest, to the page


class Hello(Message, frozen=True, kw_only=True):
    """The first message on a line; `run` is another one where the robot's program is."""

    run: int
    session: str
    role: Role
    version: str
    source: str
    seat: SeatState
    holder: str
    clients: int


class SeatChange(Message, frozen=True, kw_only=True, tag="seat"):
    """Who has the operator's seat, and how many pages are connected."""

    seat: SeatState
    holder: str
    clients: int


class LiveState(Message, frozen=True, kw_only=True):
    """What the robot itself does while the page looks at a recording."""

    mode: Mode
    stop: str
    stop_fact: AnyFact | UnsetType = UNSET


class FieldChange(Message, frozen=True, kw_only=True):
    """Another field or task: what the page read of it is out of date."""


class Verdict(Message, frozen=True, kw_only=True):
    """What became of the request with this `id`: done, or why not."""

    id: str
    ok: bool
    reason: str = ""
    reason_fact: AnyFact | UnsetType = UNSET


class Pong(Message, frozen=True, kw_only=True):
    """Answers a ping: its own time, and this machine's clocks."""

    sent_ms: float
    mono_ms: float
    wall_ms: float


class Bye(Message, frozen=True, kw_only=True):
    """The line ends; `reason` is for a person."""

    reason: str


ServerMessage = (
    Hello | Snapshot | State | Growth | LiveState | SeatChange | FieldChange | Verdict | Pong | Bye
)  # fmt: skip


# ---------------------------------------------------------------- server to robot and back


class DriveOrder(Message, frozen=True, kw_only=True):
    """A body twist by the hand of `who`, judged and limited already."""

    v_mps: float
    yaw_rate_radps: float
    who: Who


class RequestOrder(Message, frozen=True, kw_only=True):
    """A request for the robot's inbox; inside an `Ask`, the mission's verdict is wanted."""

    who: Who
    request: AnyRequest


class WatchOrder(Message, frozen=True, kw_only=True):
    """Whether anybody looks at the camera, and at its class mask."""

    camera: bool
    mask: bool


class OperatorLost(Message, frozen=True, kw_only=True):
    who: Who


class Ready(Message, frozen=True, kw_only=True):
    """The server serves."""


class Alive(Message, frozen=True, kw_only=True):
    """The server's loop goes round."""


class PreviewGoal(Message, frozen=True, kw_only=True):
    """The way to a goal, as it would be planned now."""

    goal: GoTo


class ListPanels(Message, frozen=True, kw_only=True):
    pass


class ReadPanel(Message, frozen=True, kw_only=True):
    panel: str


class SubmitPanel(Message, frozen=True, kw_only=True):
    panel: str
    values: dict[str, Any]


class Calibrate(Message, frozen=True, kw_only=True):
    """Do `action`; where it is a start, of the calibration of this name."""

    action: CalibrationAction
    by: str
    name: str = ""


class SaveFrame(Message, frozen=True, kw_only=True):
    """Keep the newest frame of the camera for training."""


class FindPlantPicture(Message, frozen=True, kw_only=True):
    x_map_m: float
    y_map_m: float


Question = (
    RequestOrder | PreviewGoal | ListPanels | ReadPanel | SubmitPanel | Calibrate | SaveFrame
    | FindPlantPicture
)  # fmt: skip


class Ask(Message, frozen=True, kw_only=True):
    """A question to the robot's program, which an answer with its `id` settles."""

    id: int
    question: Question


class Answer(Message, frozen=True, kw_only=True):
    """What came of a question: a value, a refusal or an error.

    `value` is of the type that the question has; `refusal` is why it is not wanted, `error`
    what failed.
    """

    id: int
    value: Any = None
    refusal: AnyFact | None = None
    error: str = ""


class TickCounts(Message, frozen=True, kw_only=True):
    """Totals of the robot's program until now: samples by sensor, and CPU time."""

    wall_s: float
    t_s: float
    cpu_s: float
    samples: dict[str, int]


class End(Message, frozen=True, kw_only=True):
    """The robot's program ends, and its server with it."""


RobotMessage = State | Growth | TickCounts | Answer | End
RobotOrder = DriveOrder | RequestOrder | WatchOrder | OperatorLost | Ready | Alive | Ask


# ---------------------------------------------------------------- bodies of HTTP requests


class Login(msgspec.Struct, frozen=True, kw_only=True):
    token: str


class LoginNeeded(msgspec.Struct, frozen=True, kw_only=True):
    """All that a caller without a session gets."""

    version: str
    needs_login: bool = True


class SessionInfo(msgspec.Struct, frozen=True, kw_only=True):
    """What is served here, and to whom."""

    version: str
    run: int
    profile: str
    source: str
    role: Role
    lan_url: str | None
    qr_svg: str | None
    camera: bool
    needs_login: bool = False


class Problem(msgspec.Struct, frozen=True, kw_only=True):
    """Every refusal: one sentence for a person."""

    error: str


class DatumPlace(msgspec.Struct, frozen=True, kw_only=True):
    """The origin of the map."""

    lat_deg: float
    lon_deg: float


class FieldRow(msgspec.Struct, frozen=True, kw_only=True):
    """A crop row: its ends, its curvature (left positive) and the points to draw it by."""

    index: int
    start_map_m: Vec2
    end_map_m: Vec2
    curvature_radpm: float
    points_map_m: list[Vec2]


class Field(msgspec.Struct, frozen=True, kw_only=True):
    """The ground that a map shows.

    `rows` are the task's, swaths of a plan too; `crop_map_m` are all rows of crop that stand there.
    `declination_deg` is that of magnetic North as the robot takes it, East positive.
    """

    name: str
    datum: DatumPlace
    datum_source: str
    declination_deg: float
    rows: list[FieldRow]
    crop_map_m: list[list[Vec2]]
    boundary_map_m: list[Vec2] | None
    obstacles_map_m: list[list[Vec2]]
    waypoints_map_m: list[Vec2]
    start_map_m: Vec2 | None


class CameraInfo(msgspec.Struct, frozen=True, kw_only=True):
    """`body_from_camera` is a 4x4 matrix by rows."""

    width_px: int
    height_px: int
    hfov_rad: float
    body_from_camera: list[float]


class Robot(msgspec.Struct, frozen=True, kw_only=True):
    name: str
    urdf_url: str
    footprint_body_m: list[Vec2]
    max_speed_mps: float
    max_yaw_rate_radps: float
    camera: CameraInfo | None
    wheel_joints: list[str]
    has_compass: bool = True
    tool_width_m: float | None = None  # width of its implement, which a plan is made for


class SignalInfo(msgspec.Struct, frozen=True, kw_only=True):
    name: str
    unit: str
    fields: list[str]


class RecordingInfo(msgspec.Struct, frozen=True, kw_only=True):
    """`ok` is null for a run that has no report."""

    name: str
    utc: str
    size_bytes: int
    duration_s: float | None
    profile: str | None
    ok: bool | None
    reason: str
    files: list[str]


class Recordings(msgspec.Struct, frozen=True, kw_only=True):
    disk_free_bytes: int
    current: str | None
    recordings: list[RecordingInfo]


class ReplayWish(msgspec.Struct, frozen=True, kw_only=True):
    """Show a recording from `t_s` on, or the robot again where `name` is null; 0 is a pause."""

    name: str | None = None
    speed: float = 1.0
    t_s: float | None = None


class Shown(msgspec.Struct, frozen=True, kw_only=True):
    """What the caller's pages look at now."""

    source: str
    replay: ReplayProgress | None = None


class MarkText(msgspec.Struct, frozen=True, kw_only=True):
    text: str = ""


class KeptFrame(msgspec.Struct, frozen=True, kw_only=True):
    """A frame kept on the robot for training, and how many lie there."""

    folder: str
    image: str
    count: int


class PlantPictureFile(msgspec.Struct, frozen=True, kw_only=True):
    """The picture of a plant and when it was taken; empty where none is kept."""

    jpeg: bytes = b""
    t_s: float = 0.0


class Setting(msgspec.Struct, kw_only=True):
    key: str
    value: SettingValue
    default: SettingValue | None
    type: SettingType
    unit: str
    live: bool
    about: str
    min: float | None = None
    max: float | None = None
    choices: list[str] | None = None


class SettingGroup(msgspec.Struct, frozen=True, kw_only=True):
    name: str
    keys: list[Setting]


class SettingGroups(msgspec.Struct, frozen=True, kw_only=True):
    groups: list[SettingGroup]


class SettingsReply(msgspec.Struct, frozen=True, kw_only=True):
    """Each key is applied or refused for itself."""

    applied: dict[str, SettingValue]
    refused: dict[str, str]


class CalibrationStart(msgspec.Struct, frozen=True, kw_only=True):
    kind: str = ""


class CalibrationKind(msgspec.Struct, frozen=True, kw_only=True):
    name: str
    title: str
    about: str
    ground: str
    duration_s: float


class CalibrationChange(msgspec.Struct, frozen=True, kw_only=True):
    label: str
    unit: str
    before: float | None
    after: float
    std: float | None


class CalibrationFound(msgspec.Struct, frozen=True, kw_only=True):
    """`errors_deg` are those by direction, before and after, of the compass."""

    ok: bool
    reasons: list[str]
    changes: list[CalibrationChange]
    settings: list[str]
    errors_deg: tuple[Sample, Sample] | None


class Calibrations(msgspec.Struct, frozen=True, kw_only=True):
    kinds: list[CalibrationKind]
    now: CalibrationProgress | None
    found: CalibrationFound | None
    file: str
    settings: list[str]
    broken: str
    can_undo: bool


class HealthCheck(msgspec.Struct, frozen=True, kw_only=True):
    name: str
    state: CheckState
    text: str
    advice: str = ""
    value: float | str | None = None


class SensorRate(msgspec.Struct, frozen=True, kw_only=True):
    topic: str
    expected_hz: float | None
    measured_hz: float | None


class ServerCost(msgspec.Struct, frozen=True, kw_only=True):
    cpu_s: float
    memory_bytes: int


class Health(msgspec.Struct, frozen=True, kw_only=True):
    checks: list[HealthCheck]
    rates: list[SensorRate]
    cpu_ratio: float | None
    memory_bytes: int
    server: ServerCost
    log: list[LogEvent]


class MapSource(msgspec.Struct, frozen=True, kw_only=True):
    """A map for the background; `bounds` are west, south, east and north."""

    name: str
    url: str
    minzoom: int
    maxzoom: int
    bounds: tuple[float, float, float, float] | None
    attribution: str | None


class GoalPreview(msgspec.Struct, frozen=True, kw_only=True):
    """The way to a goal before it is sent."""

    points_map_m: list[Vec2]
    length_m: float
    time_s: float


class GoalPlace(msgspec.Struct, frozen=True, kw_only=True):
    x_map_m: float
    y_map_m: float
    yaw_map_rad: float | None = None


class PlanWish(msgspec.Struct, frozen=True, kw_only=True):
    """A field (GeoJSON) to be worked, and how; what is left out keeps its default.

    `margin_m` is left out for that of the field. The crop rows on the map are kept off, unless
    `is_crop_gone`.
    """

    field: dict[str, Any]
    implement_width_m: float | None = None
    headland_passes: int | None = None
    overlap_m: float = 0.05
    margin_m: float | None = None
    swath_yaw_deg: float | None = None
    is_crop_gone: bool = False


class FieldReason(msgspec.Struct, frozen=True, kw_only=True):
    """Why a field or a plan cannot be used, and where."""

    text: str
    text_fact: AnyFact | UnsetType = UNSET
    at_map_m: Vec2 | None = None


class FieldReply(msgspec.Struct, frozen=True, kw_only=True):
    """What was found of a field, less its obstacles; `error` where it is not stored."""

    ok: bool
    reasons: list[FieldReason]
    area_m2: float
    length_m: float
    error: str | UnsetType = UNSET


class PlanReply(msgspec.Struct, frozen=True, kw_only=True):
    """A plan over a field; `path` is longitude and latitude, `error` why it is not used."""

    ok: bool
    reasons: list[FieldReason]
    warnings: list[str] = msgspec.field(default_factory=list)
    length_m: float | None = None
    area_m2: float | None = None
    time_s: float | None = None
    path: list[Vec2] = msgspec.field(default_factory=list)
    certificate: dict[str, Any] | None = None
    error: str | UnsetType = UNSET


class ImportedDisplay(msgspec.Struct, frozen=True, kw_only=True):
    type: str
    title: str
    source: str
    options: dict[str, SettingValue]
    visible: bool
    opacity: float


class LeftOut(msgspec.Struct, frozen=True, kw_only=True):
    """A display of mapviz that has no counterpart."""

    name: str
    why: str


class ViewTarget(msgspec.Struct, frozen=True, kw_only=True):
    target: Literal["map", "position", "heading"]
    turn: float


class ImportedView(msgspec.Struct, frozen=True, kw_only=True):
    """A configuration of mapviz: displays from the lowest to the topmost."""

    displays: list[ImportedDisplay]
    left_out: list[LeftOut]
    view: ViewTarget


class ExportedView(msgspec.Struct, frozen=True, kw_only=True):
    """Displays of the page, and what it stays on, to become a configuration of mapviz."""

    displays: list[Any]
    view: dict[str, Any] = {}


class PanelInfo(msgspec.Struct, frozen=True, kw_only=True):
    """A panel that a program adds to the page, with what its kind has."""

    id: str
    kind: PanelKind
    title: str
    refresh_s: float | UnsetType = UNSET
    fields: list[str] | UnsetType = UNSET
    schema: dict[str, Any] | UnsetType = UNSET
    needs_seat: bool | UnsetType = UNSET
    type: str | UnsetType = UNSET  # type of the display that draws a layer
    style: dict[str, Any] | UnsetType = UNSET
    draw_order: int | UnsetType = UNSET
    visible: bool | UnsetType = UNSET
    what: Literal["point", "polygon", "route"] | UnsetType = UNSET  # shape that a listener hears of
    topic: str | UnsetType = UNSET  # layer's source as SOURCE:NAME, in place of data of its own


class ListedTopic(msgspec.Struct, frozen=True, kw_only=True):
    """A topic that displays can show, and the displays that can."""

    name: str
    type: str
    displays: list[str]
    publishers: list[str] = msgspec.field(default_factory=list)


class TopicNetworkInfo(msgspec.Struct, frozen=True, kw_only=True):
    """One network or recording and its topics; `problem` says why it has no topics."""

    source: str
    title: str
    topics: list[ListedTopic] = msgspec.field(default_factory=list)
    problem: str = ""


class TopicWish(msgspec.Struct, frozen=True, kw_only=True):
    """A topic that a display looks at; `after` is the number of the message that it has."""

    source: str
    name: str
    after: int = 0


class TopicWishes(msgspec.Struct, frozen=True, kw_only=True):
    topics: list[TopicWish]


class TopicNews(msgspec.Struct, frozen=True, kw_only=True):
    """What a topic has said; `message` is left out where it is not newer, or has no room.

    `note` says what is wrong with it, `left_out` what was thinned, `is_stale` that it has stopped.
    """

    seq: int = 0
    type: str = ""
    age_s: float | None = None
    rate_hz: float | None = None
    is_stale: bool = False
    note: str = ""
    left_out: str = ""
    message: Any = None


class OutsideLayer(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A layer that a program outside of the robot gives: its data, or the topic that it shows.

    `data` is GeoJSON, or for another `type` of display a ROS message as a dict. `draw_order` 0 is
    the top, -1 the lowest. `name` may be left out where the address has it.
    """

    name: str = ""
    type: str = "geojson"
    data: Any = None
    topic: str = ""
    style: dict[str, Any] = {}
    draw_order: int | None = None
    visible: bool = True


class PanelReply(msgspec.Struct, frozen=True, kw_only=True):
    """What a button or form says to a press; `at_s` is the clock of the day."""

    text: str
    at_s: float = 0.0


# Bodies that the page sends over HTTP, and those that it reads there.
SENT_BODIES = (
    Login, ReplayWish, MarkText, CalibrationStart, GoalPlace, PlanWish, ExportedView, TopicWishes,
)  # fmt: skip
READ_BODIES = (
    LoginNeeded, SessionInfo, Problem, Field, Robot, SignalInfo, Recordings, Shown, KeptFrame,
    SettingGroups, SettingsReply, Calibrations, Health, MapSource, GoalPreview, FieldReply,
    PlanReply, ImportedView, PanelInfo, PanelReply, TopicNetworkInfo, TopicNews,
)  # fmt: skip


# ---------------------------------------------------------------- to bytes and back


class _Addressed(msgspec.Struct):
    id: str = ""


_from_page: msgspec.json.Decoder[PageMessage] = msgspec.json.Decoder(PageMessage)
_from_server: msgspec.json.Decoder[ServerMessage] = msgspec.json.Decoder(ServerMessage)
_from_robot: msgspec.json.Decoder[RobotMessage] = msgspec.json.Decoder(RobotMessage)
_to_robot: msgspec.json.Decoder[RobotOrder] = msgspec.json.Decoder(RobotOrder)


def encode(message: Message) -> bytes:
    return msgspec.json.encode(message)


def read_page_message(data: str | bytes) -> PageMessage:
    """Decode what a page says.

    Raises: BadMessage: nothing that a page may say, with the `id` that it carries.
    """
    try:
        return _from_page.decode(data)
    except msgspec.ValidationError as error:
        raise BadMessage(f"{error}", _id_of(data)) from error
    except (msgspec.DecodeError, RecursionError, UnicodeDecodeError) as error:
        raise BadMessage(f"not JSON: {error}") from error


def read_server_message(data: str | bytes) -> ServerMessage:
    """Decode what a server says.

    Raises: BadMessage: nothing that a server says.
    """
    try:
        return _from_server.decode(data)
    except (msgspec.DecodeError, RecursionError, UnicodeDecodeError) as error:
        raise BadMessage(f"{error}") from error


def read_robot_message(data: bytes) -> RobotMessage:
    """Read a message of the robot's program to its own server, which trusts it."""
    return _from_robot.decode(data)


def read_robot_order(data: bytes) -> RobotOrder:
    """Read an order of the server to its own robot's program, which trusts it."""
    return _to_robot.decode(data)


def _id_of(data: str | bytes) -> str:
    try:
        return msgspec.json.decode(data, type=_Addressed).id
    except (msgspec.DecodeError, RecursionError):
        return ""
