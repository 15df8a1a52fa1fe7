"""Settings of a run: one tree of structs, TOML files and `--set a.b=c` on top.

Defaults carry their physical reason; ranges stand beside the field. An unknown key is an
error that names the file, the key and the nearest known one.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterable, Mapping
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

import msgspec
import tomli_w

from agribot.core.errors import ConfigError
from agribot.core.geo import Datum
from agribot.core.messages import SafetyInput
from agribot.core.own_world import WORLD, OwnWorld
from agribot.core.platforms import find_platform
from agribot.core.plugins import find_settings, resolve_plugins
from agribot.core.suggestions import suggest_name
from agribot.core.table_text import read_text_file

Positive = Annotated[float, msgspec.Meta(gt=0)]
NonNegative = Annotated[float, msgspec.Meta(ge=0)]
Ratio = Annotated[float, msgspec.Meta(ge=0, le=1)]
Count = Annotated[int, msgspec.Meta(ge=1)]


class Config(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of every settings struct."""


class FieldConfig(Config, frozen=True):
    """Place of the crop rows, as the planter drilled them, in the map frame of `datum`.

    Rows are parallel; each further one lies `row_pitch_m` to the right of the row direction.
    `row_curvature_radpm` bends them, to the left where it is positive; direction, length and
    curvature are those of the first row, at its first plant.
    """

    datum: Datum = Datum(lat_deg=21.161289, lon_deg=72.787022)  # the origin of the map on Earth
    datum_source: str = ""  # source of the datum, from `--origin`; a simulated world goes there
    # Declination of magnetic north, east positive; None: on a real robot that of the World Magnetic
    # Model at the datum today, in the simulator 0.
    declination_deg: Annotated[float, msgspec.Meta(ge=-180, le=180)] | None = None
    first_row_start_map_m: tuple[float, float] = (1.0, 2.0)  # the first plant of the first row
    # Direction of the rows, counter-clockwise from East.
    row_yaw_deg: Annotated[float, msgspec.Meta(ge=-360, le=360)] = 90.0
    row_length_m: Positive = 10.0  # distance of the first plant and the last
    # Curvature of the first row, left positive; 0: straight.
    row_curvature_radpm: Annotated[float, msgspec.Meta(ge=-0.2, le=0.2)] = 0.0
    row_pitch_m: Positive = 1.0  # distance of neighbouring rows
    row_count: Annotated[int, msgspec.Meta(ge=1, le=10000)] = 6  # number of rows
    has_crop: bool = True  # false: nothing grows in the rows yet, and no camera finds them
    row_map_std_m: NonNegative = 0.03  # offset of real rows from these lines, 1 sigma
    # Distance of neighbouring plants in a row; None: not regular.
    plant_spacing_m: Positive | None = None
    # The weed map of an earlier run (its weeds.geojson), by whose crop the robot knows its place.
    plant_map: str = ""
    # East, North and radius of what stands in the way: the pole of a base station, a well.
    obstacles_map_m: tuple[tuple[float, float, NonNegative], ...] = ()
    # A map of map_server (YAML with PNG or PGM): its occupied cells are kept out of.
    keep_out: str = ""
    keep_out_unknown: bool = False  # its unknown cells are kept out of, too
    # Corners of areas, East and North, that no part of the robot may enter.
    keep_out_map_m: tuple[tuple[tuple[float, float], ...], ...] = ()
    # The mark on which the robot is put down before a run, and how well; None: anywhere.
    start_map_m: tuple[float, float] | None = None
    # Heading of the robot on the mark.
    start_yaw_deg: Annotated[float, msgspec.Meta(ge=-360, le=360)] | None = None
    start_std_m: Positive = 0.05  # error of its place on the mark, 1 sigma
    start_yaw_std_deg: Positive = 3.0  # error of its heading there, 1 sigma
    # Settings of this group that a simulated run takes from its world, which is not the profile's.
    from_world: tuple[str, ...] = ()


class MissionConfig(Config, frozen=True):
    speed_mps: Annotated[float, msgspec.Meta(gt=0, le=2.0)] = 0.4  # along rows and straights
    turn_speed_mps: Annotated[float, msgspec.Meta(gt=0, le=2.0)] = 0.3  # in turns
    headland_m: Positive = 1.0  # straight run past the last plant before turning
    plant_clearance_m: NonNegative = 0.15  # wheel edge to plant stem, in plan
    # Distance of the robot's body from obstacles and keep-out areas.
    obstacle_clearance_m: NonNegative = 0.3
    waypoint_radius_m: Positive = 0.15  # distance at which a waypoint counts as reached
    # A waypoint farther from the origin is refused, and so is what is farther from the robot.
    max_waypoint_distance_m: Positive = 1000.0
    # Farther from the path than this, and than 3 sigma of the pose, the mission fails.
    off_path_limit_m: Positive = 0.5
    resume_limit_m: Positive = 0.5  # moved farther while it stood, the robot does not go on
    waits_for_goals: bool = False  # begins when it is resumed, visits what it is sent to, and stays
    # Without headway; then the mission fails, or pauses where the robot may reach crop.
    stall_timeout_s: Positive = 60.0
    # Stuck, it backs out along its track and tries again, this often at one place before it stops.
    free_tries: Annotated[int, msgspec.Meta(ge=0, le=10)] = 5
    # Known across the row so well (1 sigma) the robot drives at full speed, so badly not at all.
    full_speed_std_m: Positive = 0.08
    max_row_std_m: Positive = 0.25  # known across the row so badly, the robot does not drive


class EstimateConfig(Config, frozen=True):
    """Beliefs of the filter about its sensors; 1 sigma, densities per square root of second."""

    gyro_bias_std_radps: Positive = 0.0035  # 0.2 deg/s: MEMS turn-on bias
    gyro_walk_rad_per_sqrt_s: Positive = 0.0004  # 0.02 deg: data sheets say 0.01
    wheel_scale_std_ratio: Positive = 0.04  # error of the wheels' radius: tyre pressure and load
    slip_std_rad: Positive = 0.026  # 1.5 deg of crabbing across a slope
    position_walk_m_per_sqrt_m: Positive = 0.018  # drift of wheels on soil, along and across
    mag_std_rad: Positive = 0.07  # 4 deg after calibration
    mag_bias_std_rad: Positive = 0.087  # 5 deg of hard iron
    # Own iron of the robot, from `agribot calibrate magnetometer`; T forward and left, and (xx, xy,
    # yy) of what makes a circle of the ellipse. What is left of it is learnt while driving.
    mag_offset_t: tuple[float, float] = (0.0, 0.0)
    mag_shape: tuple[float, float, float] = (1.0, 0.0, 1.0)  # the ellipse's xx, xy, yy
    mag_learn: bool = True  # learn what is left of the robot's own iron while driving
    gate_sigma: Positive = 4.0  # readings farther off are rejected
    recover_after: Count = 25  # rejected in a row before the filter opens up
    # Probability that the true error exceeds the protection level.
    protection_risk: Annotated[float, msgspec.Meta(gt=0, lt=0.1)] = 1e-3
    # Most of their way that wheels may be learnt to lose in turns on soil; 0 learns nothing.
    max_turn_loss_ratio: Annotated[float, msgspec.Meta(ge=0, le=0.5)] = 0.3
    row_gate_sigma: Positive = 3.5  # gate for a crop's distance from its row
    # Less sure than this of the row in which it is, the robot asks a person.
    row_certainty: Ratio = 0.9
    gnss_timeout_s: Positive = 10.0  # without a fix; only dead reckoning is left then
    dead_reckoning_std_m: Positive = 1.0  # without GNSS, the pose is good up to this 1 sigma
    wheel_timeout_s: Positive = 0.3  # longest gap in the wheel readings of a good pose
    imu_timeout_s: Positive = 0.3  # longest gap in the IMU readings of a good pose


class ControlConfig(Config, frozen=True):
    length_m: Positive = 0.4  # distance in which an error of the path is taken out
    delay_s: NonNegative = 0.2  # actuator lag and dead time that the follower looks ahead
    max_yaw_rate_radps: Positive = 1.0  # largest yaw rate of the follower


class CalibrationConfig(Config, frozen=True):
    """Results of `agribot calibrate` for one robot; None: as in its description."""

    wheel_radius_m: Positive | None = None  # rolling, under load
    yaw_multiplier: Positive | None = None  # effective separation over the track
    # GNSS antenna, forward and left of the turning centre.
    antenna_m: tuple[float, float] | None = None
    camera_height_m: Positive | None = None  # over the ground
    # Rotation of the camera's link in base_link.
    camera_rpy_rad: tuple[float, float, float] | None = None
    # Encoder counts of a turn of the wheel, all four edges, with its gear; of an `agribot` board.
    counts_per_turn: Annotated[float, msgspec.Meta(ge=4, le=1e6)] | None = None
    # Speed of a wheel at 24 V without load; of an `agribot` board.
    full_speed_radps: Annotated[float, msgspec.Meta(ge=0.1, le=1e3)] | None = None
    # Resistance of a motor with its wires, 24 V over its stall current; None: motors are not
    # watched by it.
    winding_ohm: Annotated[float, msgspec.Meta(gt=0, le=1e3)] | None = None


class SafetyConfig(Config, frozen=True):
    """Limits of the supervisor, the last gate before the motors."""

    max_pos_std_m: Positive = 3.0  # known worse, the robot stands
    max_yaw_std_rad: Positive = 0.6  # heading known worse, the robot stands
    # Largest speed of any command.
    max_speed_mps: Annotated[float, msgspec.Meta(gt=0, le=2.0)] = 1.0
    max_yaw_rate_radps: Positive = 1.2  # largest yaw rate of any command
    max_tilt_rad: Positive = 0.6  # tilted more, the robot stops
    geofence_margin_m: Positive = 5.0  # around the path, where no boundary of a field is known
    # Distance that the robot, by its own pose, may get over a field's boundary: a plan keeps 5 cm
    # off it, and the robot keeps its way to 4 cm where it turns.
    fence_tolerance_m: NonNegative = 0.1
    # The boundary is also kept for a robot that is off by `fence_sigma` times the 1 sigma of its
    # position, along its body and across it; such a robot may get over it by `fence_unsure_m`.
    fence_unsure_m: NonNegative = 0.3
    fence_sigma: NonNegative = 2.0  # sigmas of the position that the boundary is kept away
    # The same with a receiver without carrier corrections, whose errors last: nothing is forgiven.
    fence_single_sigma: NonNegative = 3.5
    # Largest age of a request to drive.
    hand_timeout_s: Annotated[float, msgspec.Meta(gt=0, le=0.5)] = 0.2
    # The client that held the page's seat is gone, or its server is: the mission goes on or pauses.
    on_operator_lost: Literal["continue", "pause"] = "continue"
    # Wheels or IMU silent for longer stop the robot; so late the wheels may follow a command.
    sensor_timeout_s: Positive = 0.3
    # Pictures, or what the network sees in them, missing or late by more switch the tool off.
    camera_timeout_s: Positive = 1.0
    # Charge of the battery: below the first the robot goes home, below the second it stands. A
    # battery that reports its voltage alone is judged by that of the pack; 0: not known.
    low_charge_ratio: Ratio = 0.2
    empty_charge_ratio: Ratio = 0.08  # charge of the battery below which the robot stands
    # Below it the robot goes home, where only the voltage is known.
    low_battery_v: NonNegative = 0.0
    empty_battery_v: NonNegative = 0.0  # below it the robot stands, where only the voltage is known
    # Inputs that the motor board must report (red button, bumper, battery, motors), or the robot
    # stands; None: those that the platform must have.
    must_report: tuple[SafetyInput, ...] | None = None
    clock_jump_s: Positive = 1.0  # between two ticks; the motor board has stopped by then


DEFAULT_MODEL = "agribot-plants"  # a network that knows five crops, and finds single plants


class PerceptionConfig(Config, frozen=True):
    enabled: bool = True  # a camera looks
    model: str = DEFAULT_MODEL  # the network: a packaged name or an ONNX file
    camera_rate_hz: Annotated[float, msgspec.Meta(gt=0, le=60)] = 10.0  # pictures a second
    # Time from the picture to its plants. A simulation waits for it, so that it repeats; a robot in
    # real time uses plants as soon as they are there, and reports pictures that come 0.2 s later.
    latency_s: Annotated[float, msgspec.Meta(gt=0, le=5)] = 0.2
    min_plant_area_m2: NonNegative = 2e-4  # smaller spots on the ground are no plants
    min_confidence: Ratio = 0.6  # less sure spots, and stems, are no plants
    max_range_m: Positive = 1.6  # pixel footprint beyond it is too long for a position
    threads: Annotated[int, msgspec.Meta(ge=1, le=64)] = 1  # threads of the network


class WeedConfig(Config, frozen=True):
    # Sightings so near are one plant, but for weeds that one picture showed side by side.
    merge_radius_m: Positive = 0.12
    min_sightings: Count = 3  # before a plant is in the map
    min_confidence: Ratio = 0.5  # least confidence of a plant in the map


LeafRule = Literal["any", "rows", "mapped", "alone", "none"]


class TreatmentConfig(Config, frozen=True):
    enabled: bool = True  # the implement works
    margin_m: NonNegative = 0.04  # most that is treated around a weed, where its place is unsure
    crop_guard_m: NonNegative = 0.05  # around the stem of a crop plant, which is never treated
    # Error of a stem's place, 1 sigma, alike in all looks: mount of the camera, ground, network
    look_std_m: NonNegative = 0.02
    # Error of a stem's place, 1 sigma, by wheels and gyro from the last look to the tool
    way_std_m: NonNegative = 0.012
    # Leaves of crop that may be treated: any, as by an agent that the crop endures; none; or those
    # of plants that stand alone in the map, of all whose stem is mapped, or these and those beside
    # the row.
    leaves: LeafRule = "alone"
    # Least distance between a row of mapped crops and another row, for the rule `rows`. At most 5
    # cm less than the distance of rows.
    beside_row_m: Positive = 0.4
    # Beside rows, ground is sprayed where a network that finds plants makes a stem of a weed so
    # sure in the mean of its looks, also where none is on the map; 1: nowhere.
    least_weed_score: Ratio = 1.0
    prescription: str = ""  # file of zones with rates; nothing is treated outside them
    prescription_column: str = ""  # column with litres per hectare; empty: by its usual names
    depth_m: Positive | None = None  # depth of a hoe's blades; None: as deep as they reach


class RecordConfig(Config, frozen=True):
    enabled: bool = True  # run.mcap is written
    image_rate_hz: NonNegative = 1.0  # pictures a second in the recording; 0: none
    jpeg_quality: Annotated[int, msgspec.Meta(ge=1, le=95)] = 80  # quality of these pictures
    max_file_mb: NonNegative = 0.0  # a new file begins at this size; 0: one file
    max_total_mb: NonNegative = 0.0  # above it, the oldest files go; 0: no limit
    min_free_mb: NonNegative = 200.0  # free space of the disk; below it, files go or recording ends
    # Folder of the frames that an operator keeps; empty: `frames` beside the run.
    frames_dir: str = ""


class SourceConfig(Config, frozen=True):
    """Source of a sensor if not the platform: serial:/dev/ttyACM0; empty: the platform."""

    gnss: str = ""  # position
    imu: str = ""  # gyro and accelerometer
    mag: str = ""  # magnetometer
    wheels: str = ""  # encoders
    camera: str = ""  # pictures
    base: str = ""  # the motor board of `platform = "hardware"`: serial:/dev/ttyACM0?board=agribot
    # Contactor that cuts the motors' power beside the red button: lcus:/dev/ttyUSB3; empty: none.
    contactor: str = ""
    others: str = ""  # topic of samples without a setting here: `OtherSample`


class SimConfig(Config, frozen=True):
    # Physics: in steps of 8 ms the packaged robot's tyres, stiff against roll, would shake it.
    step_s: Annotated[float, msgspec.Meta(ge=0.0005, le=0.005)] = 0.002
    # Preset of sensor errors: rtk, rtk-1, rtk-dual, rtk-trees, m8n, m8n-1, m8n-urban, ...
    sensors: str = "rtk"
    # Density of weeds in place of the world's own: over its areas of weeds, or else over the
    # rectangle of its crops and 0.5 m around it.
    weed_density_per_m2: Annotated[float, msgspec.Meta(ge=0, le=100)] | None = None
    # Differences of the world from its map and from seed to seed: kind, field, hard, or a file.
    preset: str = "kind"
    camera_noise: bool = True  # noise of the sensor and the picture
    camera_body: bool = True  # the robot and its shadow in its own camera's picture
    # Wheels by an ideal speed servo, or by a PID per wheel that commands torque.
    actuation: Literal["servo", "effort"] = "servo"
    # A second receiver at the world's pole, with errors of its own or sharing the slow ones.
    base_station: Literal["off", "independent", "common"] = "off"
    # A robot whose description has none gets a lidar at its front; it only publishes scans.
    lidar: bool = False
    # In the motors' supply, in series; gate and red button open all of them.
    contactors: Annotated[int, msgspec.Meta(ge=0, le=2)] = 2
    imu: str = ""  # another IMU than the sensor preset's: ideal, hector, mpu9265
    # Declination of the true field.
    declination_deg: Annotated[float, msgspec.Meta(ge=-180, le=180)] = 0.0


class RunConfig(Config, frozen=True):
    """All settings of one run; `config.toml` of the output folder holds them resolved."""

    # Name of these settings in reports and folders; the PROFILE of a command.
    profile: str = "farm"
    # Seed of all randomness; up to what TOML and JSON readers take.
    seed: Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)] = 0
    # The robot: `sim`, `firmware`, `hardware`, a registered platform, or module:function.
    platform: str = "sim"
    world: str = WORLD  # simulated world: a packaged name or an SDF file
    # Its description: a packaged name, URDF or xacro, with arguments as in "x.xacro side:=left".
    robot: str = "agribot"
    waypoints: str = ""  # a file of places to visit, the task instead of the rows of the field
    # Drive the rows of the field, or find and draw those of an unmapped field.
    task: Literal["rows", "explore"] = "rows"
    plan: str = ""  # a certified field plan, the task instead of the rows of the field
    tick_hz: Annotated[float, msgspec.Meta(ge=10, le=100)] = 50.0  # rate of the control loop
    duration_s: Positive | None = None  # the run ends after it; none: with its mission
    # Faults of the simulated world, each NAME[=VALUE]@T[+SECONDS]; T in seconds.
    faults: tuple[str, ...] = ()
    field: FieldConfig = FieldConfig()
    mission: MissionConfig = MissionConfig()
    estimate: EstimateConfig = EstimateConfig()
    calibration: CalibrationConfig = CalibrationConfig()
    control: ControlConfig = ControlConfig()
    safety: SafetyConfig = SafetyConfig()
    perception: PerceptionConfig = PerceptionConfig()
    weeds: WeedConfig = WeedConfig()
    treatment: TreatmentConfig = TreatmentConfig()
    record: RecordConfig = RecordConfig()
    sim: SimConfig = SimConfig()
    sources: SourceConfig = SourceConfig()
    # Settings of installed packages that add to the program, by the plugin's name (`agribot
    # plugins`).
    plugins: dict[str, dict[str, Any]] = {}


def list_profiles() -> list[str]:
    folder = resources.files("agribot.core") / "profiles"
    return sorted(
        p.name.removesuffix(".toml") for p in folder.iterdir() if p.name.endswith(".toml")
    )


def load(profile: str, settings: Iterable[str] = ()) -> RunConfig:
    """Read a packaged profile or a TOML file and apply `a.b=c` settings in order.

    A file that does not say how its settings are called is called by its name.

    Raises: ConfigError: unknown profile or key, a value of the wrong type or out of range.
    """
    return from_tree(*_read_tree(profile, settings))


def is_stated(key: str, profile: str, settings: Iterable[str] = ()) -> bool:
    """Return whether a profile or the settings on top state a setting `a.b`, or a part of it.

    Raises: ConfigError: unknown profile, or a setting that cannot be assigned.
    """
    node: object = _read_tree(profile, settings)[0]
    for name in key.split("."):
        if not isinstance(node, dict) or name not in node:
            return False
        node = node[name]
    return True


def _read_tree(profile: str, settings: Iterable[str]) -> tuple[dict[str, Any], str]:
    """Read a profile with settings on top, not checked yet, and say where they come from."""
    source, tree = _read_profile(profile)
    own, stated = OwnWorld.read(tree), set[str]()
    for setting in settings:
        key, _, name = (part.strip() for part in setting.partition("="))
        if key == "profile":
            raise ConfigError(
                f"--set {setting}: it would change a name and no setting; begin with that profile "
                f"instead, as in: agribot run {name}"
            )
        assign(tree, setting)
        stated.add(".".join(key.split(".")[:2]))
        source = f"{source} --set {setting}"
    own.leave_rows_to_other(tree, stated)
    return tree, source


def to_toml(config: RunConfig) -> str:
    return tomli_w.dumps(drop_none(msgspec.to_builtins(config)))


def _read_profile(profile: str) -> tuple[str, dict[str, Any]]:
    path = Path(profile)
    if path.suffix == ".toml":
        if not path.is_file():
            raise ConfigError(f"profile file {profile} does not exist; check the path")
        return profile, {"profile": path.stem, **read_toml(path)}
    if profile not in list_profiles():
        raise ConfigError(
            f"unknown profile '{profile}'{suggest_name(profile, list_profiles())}; "
            f"known: {', '.join(list_profiles())}, or a path to a .toml file"
        )
    text = (resources.files("agribot.core") / "profiles" / f"{profile}.toml").read_text("utf-8")
    return f"{profile}.toml", parse_toml(text, f"{profile}.toml")


def from_tree(tree: dict[str, Any], source: str) -> RunConfig:
    """Check a plain tree and give it types; `source` names it in errors."""
    check_keys(tree, RunConfig, source, "")
    check_finite(tree, source, "")
    try:
        config = msgspec.convert(tree, RunConfig)
        find_platform(config.platform)
        for name, values in config.plugins.items():
            kind = find_settings(name)
            if kind is not None:
                check_keys(values, kind, source, f"plugins.{name}")
        config = msgspec.structs.replace(config, plugins=resolve_plugins(config.plugins))
    except msgspec.ValidationError as error:
        raise ConfigError(f"{source}: {name_setting(str(error), tree)}") from error
    except ConfigError as error:
        raise ConfigError(f"{source}: {error}") from error
    return config


def assign(tree: dict[str, Any], setting: str) -> None:
    """Set one `key.subkey=value` in a tree."""
    key, separator, text = setting.partition("=")
    if not separator or not key:
        raise ConfigError(f"--set {setting}: write it as key.subkey=value")
    *parents, leaf = key.strip().split(".")
    node = tree
    for name in parents:
        child = node.setdefault(name, {})
        if not isinstance(child, dict):
            raise ConfigError(f"--set {setting}: '{name}' is a value, not a group of settings")
        node = child
    value = _parse_value(text.strip())
    node[leaf] = _list_faults(value) if key.strip() == "faults" else value


def _parse_value(text: str) -> object:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        return text


def _list_faults(value: object) -> object:
    """Let faults be written without brackets: `A@1;B@2`, or `none`."""
    if not isinstance(value, str):
        return value
    return [] if value == "none" else [word.strip() for word in value.split(";")]


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file as a plain tree.

    Raises: ConfigError: no such file, no text, or not TOML.
    """
    try:
        text = read_text_file(path)
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror}; check the path") from error
    except ValueError as error:
        raise ConfigError(f"{path} cannot be read: {error}") from error
    return parse_toml(text, str(path))


def parse_toml(text: str, source: str) -> dict[str, Any]:
    """Parse TOML text as a plain tree.

    Raises: ConfigError: not TOML; names the source.
    """
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise ConfigError(f"{source} is not valid TOML: nested too deeply") from error
    except ValueError as error:  # also a number of thousands of digits
        raise ConfigError(f"{source} is not valid TOML: {error}") from error


def name_setting(message: str, tree: dict[str, Any]) -> str:
    """Put the setting and its value in front of a message of msgspec."""
    found = re.search(r"^(.*) - at `\$\.([\w.]+)(.*)`$", message)
    if found is None:
        return message
    expected, key, rest = found.groups()
    value: Any = tree
    for name in key.split("."):
        value = value[name]
    return f"{key} = {value!r}: {expected[0].lower()}{expected[1:]}" + (rest and f" at {rest}")


def check_finite(value: object, source: str, at: str) -> None:
    """Refuse numbers that are not finite anywhere in a tree; `at` is where it hangs."""
    if isinstance(value, dict):
        for key, inner in value.items():
            check_finite(inner, source, f"{at}.{key}" if at else key)
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            check_finite(inner, source, f"{at}[{index}]")
    elif isinstance(value, float) and not math.isfinite(value):
        raise ConfigError(f"{source}: {at} = {value}: write a finite number")


def check_keys(tree: Mapping[str, Any], struct: type[msgspec.Struct], source: str, at: str) -> None:
    """Refuse keys that the struct does not have and words that it does not know."""
    known = {field.name: field.type for field in msgspec.structs.fields(struct)}
    for key, value in tree.items():
        where = f"{at}.{key}" if at else key
        if key not in known:
            raise ConfigError(
                f"{source}: unknown setting '{where}'{suggest_name(key, list(known))}; "
                f"known here: {', '.join(known)}"
            )
        kind = known[key]
        words = _find_words(kind)
        for word in value if isinstance(value, list) else [value]:
            if words and word not in words and (get_origin(kind) is Literal or value is not word):
                raise ConfigError(
                    f"{source}: {where} = {value!r}{suggest_name(str(word), words)}; "
                    f"known: {', '.join(words)}"
                )
        if isinstance(value, dict) and isinstance(kind, type) and issubclass(kind, msgspec.Struct):
            check_keys(value, kind, source, where)


def _find_words(kind: Any) -> list[str]:
    """List the words that a setting may be, or that may stand in its list; none of numbers."""
    if get_origin(kind) is Literal:
        return list(get_args(kind))
    return [word for inner in get_args(kind) for word in _find_words(inner)]


def drop_none(tree: dict[str, Any]) -> dict[str, Any]:
    """Leave out the keys without a value: TOML has no null, an absent key says the same."""
    return {
        key: drop_none(value) if isinstance(value, dict) else value
        for key, value in tree.items()
        if value is not None
    }
