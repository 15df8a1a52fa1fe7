"""THE table of topics: name, struct, ROS type, nominal rate, QoS and the original's name.

Recorder, displays and bridges read it; none of them invents a name of its own. Inside the robot
there is no bus: `stack.tick` is the data flow, and topics exist only at its edge.
"""

from __future__ import annotations

from typing import Literal

import msgspec

from agribot.core.messages import (
    BaseFix,
    BatterySample,
    BumperSample,
    CameraFrame,
    Estimate,
    GnssFix,
    GnssStatus,
    ImuSample,
    LaserScan,
    MagSample,
    MappedPlant,
    MissionStatus,
    Path,
    RobotCommand,
    Scene,
    TickRecord,
    WheelSample,
)


class Qos(msgspec.Struct, frozen=True, kw_only=True):
    """Quality of service for late or lossy subscribers of ROS 2; history is always keep-last."""

    reliable: bool = True
    latched: bool = False  # durability transient_local
    depth: int = 10


# A reliable publisher matches reliable and best-effort subscribers alike.
STREAM = Qos()
LATCHED = Qos(latched=True, depth=1)
LATEST = Qos(reliable=False, depth=1)

Direction = Literal["out", "in", "both"]


class Topic(msgspec.Struct, frozen=True, kw_only=True):
    """One row of the table.

    `rate_hz` is nominal, None for "when it changes". `struct` is the message that carries the
    value inside the robot, None where the content is not a struct (TF, the URDF text).
    `ros_type` is empty for a channel that only AGRIBOT reads. `seed_alias` and `seed_ros_type`
    are what the original AGRIBOT called it, for its own tools; empty where it had none.
    `other_names` are further names under which every network has it; a recording has it once.
    """

    name: str
    ros_type: str
    struct: type[msgspec.Struct] | None = None
    rate_hz: float | None = None
    qos: Qos = STREAM
    direction: Direction = "out"
    seed_alias: str = ""
    seed_ros_type: str = ""
    other_names: tuple[str, ...] = ()
    about: str = ""

    @property
    def names(self) -> tuple[str, ...]:
        """All names under which every network has it, its own first."""
        return (self.name, *self.other_names)

    def list_named(self) -> list[Topic]:
        """List the topic under each of its names, for a network that knows one name for each."""
        return [msgspec.structs.replace(self, name=name, other_names=()) for name in self.names]


FIX = Topic(
    name="/agribot/fix",
    ros_type="sensor_msgs/msg/NavSatFix",
    struct=GnssFix,
    rate_hz=10.0,
    seed_alias="/agribot/fix",
    seed_ros_type="sensor_msgs/msg/NavSatFix",
    about="GNSS position at the antenna",
)
FIX_VELOCITY = Topic(
    name="/agribot/fix_velocity",
    ros_type="geometry_msgs/msg/Vector3Stamped",
    struct=GnssFix,
    rate_hz=10.0,
    seed_alias="/agribot/fix_velocity",
    seed_ros_type="geometry_msgs/msg/Vector3Stamped",
    about="GNSS velocity, East-North-Up, m/s",
)
EXTENDED_FIX = Topic(
    name="/agribot/extended_fix",
    ros_type="gps_msgs/msg/GPSFix",
    struct=GnssStatus,
    rate_hz=10.0,
    seed_alias="/extended_fix",
    seed_ros_type="gps_common/msg/GPSFix",
    about="full report of a real receiver, errors at 95 %",
)
IMU = Topic(
    name="/agribot/imu",
    ros_type="sensor_msgs/msg/Imu",
    struct=ImuSample,
    rate_hz=200.0,
    seed_alias="/agribot/imu",
    seed_ros_type="sensor_msgs/msg/Imu",
    about="gyro and specific force (REP-145), no orientation",
)
IMU_BIAS = Topic(
    name="/agribot/imu/bias",
    ros_type="sensor_msgs/msg/Imu",
    rate_hz=50.0,
    seed_alias="/agribot/imu/bias",
    seed_ros_type="sensor_msgs/msg/Imu",
    about="true bias of gyro and accelerometer, of a run at 10 Hz; simulation only",
)
MAGNETIC = Topic(
    name="/agribot/magnetic",
    ros_type="sensor_msgs/msg/MagneticField",
    struct=MagSample,
    rate_hz=5.0,
    seed_alias="/magnetic",
    seed_ros_type="geometry_msgs/msg/Vector3Stamped",
    about="magnetic field in body axes, tesla",
)
POLE_FIX = Topic(
    name="/pole/fix",
    ros_type="sensor_msgs/msg/NavSatFix",
    struct=BaseFix,
    rate_hz=5.0,
    seed_alias="/Pole/fix",
    seed_ros_type="sensor_msgs/msg/NavSatFix",
    about="GNSS position of the base station on the pole",
)
SCAN = Topic(
    name="/agribot/scan",
    ros_type="sensor_msgs/msg/LaserScan",
    struct=LaserScan,
    rate_hz=10.0,
    about="lidar, where the robot has one",
)
POLE_FIX_VELOCITY = Topic(
    name="/pole/fix_velocity",
    ros_type="geometry_msgs/msg/Vector3Stamped",
    struct=BaseFix,
    rate_hz=5.0,
    seed_alias="/Pole/fix_velocity",
    seed_ros_type="geometry_msgs/msg/Vector3Stamped",
    about="its velocity, East-North-Up, m/s",
)
BUMPER = Topic(
    name="/agribot/bumper",
    ros_type="geometry_msgs/msg/PointStamped",
    struct=BumperSample,
    about="where the robot touches something, in base_footprint, once a tick",
)
BATTERY = Topic(
    name="/agribot/battery",
    ros_type="sensor_msgs/msg/BatteryState",
    struct=BatterySample,
    rate_hz=1.0,
    about="voltage, current (negative: discharging) and charge",
)
JOINT_STATES = Topic(
    name="/agribot/joint_states",
    ros_type="sensor_msgs/msg/JointState",
    struct=WheelSample,
    rate_hz=50.0,
    seed_alias="/agribot/joint_states",
    seed_ros_type="sensor_msgs/msg/JointState",
    other_names=("/joint_states",),
    about="wheel encoders, the newest sample of each tick",
)
ODOM = Topic(
    name="/odom",
    ros_type="nav_msgs/msg/Odometry",
    rate_hz=50.0,
    seed_alias="/agribot/odom",
    seed_ros_type="nav_msgs/msg/Odometry",
    other_names=("/agribot/odom",),
    about="pose by wheel encoders alone, in odom, from the start (original: the truth)",
)
ODOMETRY = Topic(
    name="/agribot/odometry/estimate",
    ros_type="nav_msgs/msg/Odometry",
    struct=Estimate,
    rate_hz=50.0,
    about="estimated pose in the map with its covariance, twist in the body frame",
)
POSE = Topic(
    name="/agribot/pose",
    ros_type="geometry_msgs/msg/PoseStamped",
    struct=Estimate,
    rate_hz=10.0,
    seed_alias="/currentPose",
    seed_ros_type="geometry_msgs/msg/Pose",
    about="estimated pose in the map (original: vector to the goal)",
)
CMD_VEL = Topic(
    name="/agribot/cmd_vel",
    ros_type="geometry_msgs/msg/Twist",
    struct=RobotCommand,
    rate_hz=50.0,
    direction="both",
    seed_alias="/agribot/cmd_vel",
    seed_ros_type="geometry_msgs/msg/Twist",
    about="the command after the supervisor; with --allow-drive what peers ask for",
)
IMAGE = Topic(
    name="/agribot/camera/image_raw/compressed",
    ros_type="sensor_msgs/msg/CompressedImage",
    struct=CameraFrame,
    rate_hz=1.0,
    about="camera, JPEG; 5 Hz to bridges",
)
IMAGE_RAW = Topic(
    name="/agribot/camera/image_raw",
    ros_type="sensor_msgs/msg/Image",
    struct=CameraFrame,
    rate_hz=5.0,
    seed_alias="/agribot/camera/image_raw",
    seed_ros_type="sensor_msgs/msg/Image",
    about="camera, rgb8; bridges only, with --raw-images",
)
CAMERA_INFO = Topic(
    name="/agribot/camera/camera_info",
    ros_type="sensor_msgs/msg/CameraInfo",
    rate_hz=1.0,
    seed_alias="/agribot/camera/camera_info",
    seed_ros_type="sensor_msgs/msg/CameraInfo",
    about="pinhole of the camera, one for each recorded image",
)
OVERLAY = Topic(
    name="/agribot/camera/overlay/compressed",
    ros_type="sensor_msgs/msg/CompressedImage",
    struct=Scene,
    rate_hz=1.0,
    about="camera with what the network found: weeds red, crops green",
)
PATH = Topic(
    name="/agribot/path",
    ros_type="nav_msgs/msg/Path",
    struct=Path,
    qos=LATCHED,
    about="planned path of the body frame in the map",
)
GOALS = Topic(
    name="/agribot/goals",
    ros_type="geometry_msgs/msg/PoseArray",
    qos=LATCHED,
    about="waypoints in driving order: the row ends",
)
GOAL_FIX = Topic(
    name="/agribot/goal_fix",
    ros_type="sensor_msgs/msg/NavSatFix",
    qos=LATCHED,
    seed_alias="/goal_GPS",
    seed_ros_type="sensor_msgs/msg/NavSatFix",
    about="where the robot is bound for, latitude and longitude",
)
GOAL_POSE = Topic(
    name="/agribot/goal_pose",
    ros_type="geometry_msgs/msg/PoseStamped",
    qos=LATCHED,
    about="goal of a person or program; yaw 0 where none was asked",
)
CLICKED_POINT = Topic(
    name="/clicked_point",
    ros_type="geometry_msgs/msg/PointStamped",
    about="a place that an operator tapped on the page",
)
DRAWN_POLYGON = Topic(
    name="/agribot/polygon",
    ros_type="geometry_msgs/msg/PolygonStamped",
    qos=LATCHED,
    seed_alias="/polygon",
    seed_ros_type="geometry_msgs/msg/PolygonStamped",
    about="a polygon that an operator drew on the page",
)
DRAWN_ROUTE = Topic(
    name="/agribot/route",
    ros_type="nav_msgs/msg/Path",
    qos=LATCHED,
    about="a route that an operator drew on the page, from the robot on; in ROS 1 also `/route` as "
    "marti_nav_msgs/Route",
)
WEEDS = Topic(
    name="/agribot/weeds",
    ros_type="visualization_msgs/msg/MarkerArray",
    struct=MappedPlant,
    rate_hz=1.0,
    qos=LATCHED,
    about="weed map: weeds red, treated grey, crops green",
)
STATUS = Topic(
    name="/agribot/mission/status",
    ros_type="std_msgs/msg/String",
    struct=MissionStatus,
    rate_hz=1.0,
    about="MissionStatus as JSON, at once when its state changes",
)
CALIBRATED = Topic(
    name="/calibrated",
    ros_type="std_msgs/msg/Bool",
    qos=LATCHED,
    seed_alias="/calibrated",
    seed_ros_type="std_msgs/msg/Bool",
    about="true once position and heading are known",
)
DISTANCE = Topic(
    name="/agribot/distance",
    ros_type="std_msgs/msg/Float64",
    struct=Estimate,
    rate_hz=10.0,
    seed_alias="/distance",
    seed_ros_type="std_msgs/msg/Float64",
    about="straight distance to the goal, m",
)
BEARING = Topic(
    name="/agribot/bearing",
    ros_type="std_msgs/msg/Float64",
    struct=Estimate,
    rate_hz=10.0,
    seed_alias="/angleOG",
    seed_ros_type="std_msgs/msg/Float64",
    about="direction to the goal, degrees counter-clockwise from East",
)
ANGLE = Topic(
    name="/agribot/angle",
    ros_type="std_msgs/msg/Float64",
    struct=Estimate,
    rate_hz=10.0,
    seed_alias="/angle",
    seed_ros_type="std_msgs/msg/Float64",
    about="bearing minus heading, left positive, degrees",
)
HEADING_RAW = Topic(
    name="/agribot/heading/raw",
    ros_type="std_msgs/msg/Float64",
    struct=MagSample,
    rate_hz=5.0,
    seed_alias="/Rawheading",
    seed_ros_type="std_msgs/msg/Float64",
    about="heading of the level magnetometer, degrees clockwise from magnetic North",
)
HEADING_FILTERED = Topic(
    name="/agribot/heading/filtered",
    ros_type="std_msgs/msg/Float64",
    struct=Estimate,
    rate_hz=10.0,
    seed_alias="/Filteredheading",
    seed_ros_type="std_msgs/msg/Float64",
    about="estimated heading, degrees clockwise from North",
)
TF = Topic(
    name="/tf",
    ros_type="tf2_msgs/msg/TFMessage",
    rate_hz=50.0,
    seed_alias="/tf",
    seed_ros_type="tf2_msgs/msg/TFMessage",
    about="map -> odom -> base_footprint, and the wheels at 10 Hz; a world alone has no map",
)
TF_STATIC = Topic(
    name="/tf_static",
    ros_type="tf2_msgs/msg/TFMessage",
    qos=LATCHED,
    about="fixed joints and the camera's optical frame",
)
ROBOT_DESCRIPTION = Topic(
    name="/robot_description", ros_type="std_msgs/msg/String", qos=LATCHED, about="URDF"
)
CLOCK = Topic(
    name="/clock",
    ros_type="rosgraph_msgs/msg/Clock",
    rate_hz=50.0,
    qos=LATEST,
    about="simulated time; bridges only",
)
GROUND_TRUTH = Topic(
    name="/ground_truth/odometry",
    ros_type="nav_msgs/msg/Odometry",
    rate_hz=50.0,
    about="true pose and twist, of a run at 10 Hz; simulation only, never seen by the robot",
)
TICK = Topic(
    name="/agribot/tick",
    ros_type="",
    struct=TickRecord,
    rate_hz=50.0,
    about="all of a tick but the pixels, MessagePack, for replay",
)

TOPICS: tuple[Topic, ...] = (
    FIX, FIX_VELOCITY, EXTENDED_FIX, IMU, IMU_BIAS, MAGNETIC, POLE_FIX, POLE_FIX_VELOCITY, SCAN,
    BUMPER, BATTERY, JOINT_STATES, ODOM, ODOMETRY, POSE, CMD_VEL, IMAGE, IMAGE_RAW, CAMERA_INFO,
    OVERLAY, PATH, GOALS, GOAL_FIX, WEEDS, GOAL_POSE, CLICKED_POINT, DRAWN_POLYGON, DRAWN_ROUTE,
    STATUS, CALIBRATED, DISTANCE, BEARING, ANGLE, HEADING_RAW, HEADING_FILTERED, TF, TF_STATIC,
    ROBOT_DESCRIPTION, CLOCK, GROUND_TRUTH, TICK,
)  # fmt: skip


def find_topic(name: str) -> Topic | None:
    """Find the topic of this name or, failing that, of this other or original name."""
    named = (topic for topic in TOPICS if name in topic.names)
    return next(named, next((topic for topic in TOPICS if topic.seed_alias == name), None))
