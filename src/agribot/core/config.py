"""Settings of a run: one tree of structs, TOML files and `--set a.b=c` on top.

Defaults carry their physical reason; ranges stand beside the field. An unknown key is an
error that names the file, the key and the nearest known one.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import tomli_w

from agribot.core.errors import ConfigError, add_advice
from agribot.core.geo import Datum
from agribot.core.messages import SafetyInput
from agribot.core.own_world import WORLD, OwnWorld
from agribot.core.platforms import find_platform
from agribot.core.plugins import find_settings, resolve_plugins
from agribot.core.suggestions import suggest_name
from agribot.core.toml_tree import (
    check_finite,
    check_keys,
    drop_none,
    name_setting,
    parse_toml,
    read_toml,
)

Positive = Annotated[float, msgspec.Meta(gt=0)]
NonNegative = Annotated[float, msgspec.Meta(ge=0)]
Ratio = Annotated[float, msgspec.Meta(ge=0, le=1)]
Count = Annotated[int, msgspec.Meta(ge=1)]


class Config(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of every settings struct."""


class FieldConfig(Config, frozen=True):
    """Place of the crop rows, as the planter drilled them, in the map frame of `datum`.

    Rows are parallel; each further one lies `row_pitch_m` to the right of the row direction.
    Direction, length and curvature are those of the first row, at its first plant.
    """

    datum: Datum = Datum(lat_deg=21.161289, lon_deg=72.787022)  # origin of the map
    datum_source: str = ""  # `--origin`; a simulated world moves there
    # Magnetic declination, east positive; unset: by the World Magnetic Model, in the simulator 0.
    declination_deg: Annotated[float, msgspec.Meta(ge=-180, le=180)] | None = None
    first_row_start_map_m: tuple[float, float] = (1.0, 2.0)  # first plant of the first row
    # Direction, counter-clockwise from East.
    row_yaw_deg: Annotated[float, msgspec.Meta(ge=-360, le=360)] = 90.0
    row_length_m: Positive = 10.0  # first plant to last plant
    # Curvature, left positive; 0: straight.
    row_curvature_radpm: Annotated[float, msgspec.Meta(ge=-0.2, le=0.2)] = 0.0
    row_pitch_m: Positive = 1.0  # distance of rows
    row_count: Annotated[int, msgspec.Meta(ge=1, le=10000)] = 6  # number of rows
    has_crop: bool = True  # false: nothing grows in the rows yet
    row_map_std_m: NonNegative = 0.03  # offset of real rows from these lines
    # Distance of plants in a row; unset: not regular.
    plant_spacing_m: Positive | None = None
    # Weed map of an earlier run, by whose crop the robot knows its place.
    plant_map: str = ""
    # East, North and radius of what stands in the way.
    obstacles_map_m: tuple[tuple[float, float, NonNegative], ...] = ()
    # Map of map_server (YAML) with occupied cells to keep out of.
    keep_out: str = ""
    keep_out_unknown: bool = False  # its unknown cells too
    # Corners of areas that no part of the robot may enter.
    keep_out_map_m: tuple[tuple[tuple[float, float], ...], ...] = ()
    # Mark on which a run starts; unset: anywhere.
    start_map_m: tuple[float, float] | None = None
    # Direction there, counter-clockwise from East.
    start_yaw_deg: Annotated[float, msgspec.Meta(ge=-360, le=360)] | None = None
    start_std_m: Positive = 0.05  # error of its place there
    start_yaw_std_deg: Positive = 3.0  # error of its direction there
    # Place of the robot after its last run.
    left_map_m: tuple[float, float] | None = None
    # Settings of this group that a simulated run takes from its world.
    from_world: tuple[str, ...] = ()


class MissionConfig(Config, frozen=True):
    speed_mps: Annotated[float, msgspec.Meta(gt=0, le=2.0)] = 0.4  # along rows and straights
    turn_speed_mps: Annotated[float, msgspec.Meta(gt=0, le=2.0)] = 0.3  # in turns
    headland_m: Positive = 1.0  # straight past the last plant before turning
    plant_clearance_m: NonNegative = 0.15  # wheel edge to stem
    # Body to obstacles and keep-out areas.
    obstacle_clearance_m: NonNegative = 0.3
    waypoint_radius_m: Positive = 0.15  # distance at which a waypoint counts as reached
    # A waypoint farther from the origin or from the robot is refused.
    max_waypoint_distance_m: Positive = 1000.0
    # Farther from the path than this, and than 3 sigma of the pose, the mission fails.
    off_path_limit_m: Positive = 0.5
    resume_limit_m: Positive = 0.5  # moved farther while it stood, it does not go on
    waits_for_goals: bool = False  # waits for goals and visits them
    # Longest time without headway; then the mission fails, or pauses beside crop.
    stall_timeout_s: Positive = 60.0
    # Stuck, the robot backs out and tries again, this often at one place before it stops.
    free_tries: Annotated[int, msgspec.Meta(ge=0, le=10)] = 5
    # Position across the row known this well, the robot drives at full speed.
    full_speed_std_m: Positive = 0.08
    max_row_std_m: Positive = 0.25  # known this badly, it stands


class EstimateConfig(Config, frozen=True):
    """Beliefs of the filter about its sensors; 1 sigma, densities per square root of second."""

    gyro_bias_std_radps: Positive = 0.0035  # 0.2 deg/s: MEMS turn-on bias
    gyro_walk_rad_per_sqrt_s: Positive = 0.0004  # 0.02 deg: data sheets say 0.01
    wheel_scale_std_ratio: Positive = 0.04  # tyre pressure and load
    slip_std_rad: Positive = 0.026  # 1.5 deg of crabbing across a slope
    position_walk_m_per_sqrt_m: Positive = 0.018  # drift of wheels on soil
    mag_std_rad: Positive = 0.07  # 4 deg after calibration
    mag_bias_std_rad: Positive = 0.087  # 5 deg of hard iron
    # The robot's own iron, T forward and left, from `agribot calibrate magnetometer`.
    mag_offset_t: tuple[float, float] = (0.0, 0.0)
    mag_shape: tuple[float, float, float] = (
        1.0,
        0.0,
        1.0,
    )  # (xx, xy, yy) that makes a circle of the ellipse
    mag_learn: bool = True  # learn what is left of it while driving
    gate_sigma: Positive = 4.0  # readings farther off are rejected
    recover_after: Count = 25  # rejected in a row before the uncertainty grows
    # Probability that the true error exceeds the protection level.
    protection_risk: Annotated[float, msgspec.Meta(gt=0, lt=0.1)] = 1e-3
    # Most slip in turns that the filter may learn; 0: none.
    max_turn_loss_ratio: Annotated[float, msgspec.Meta(ge=0, le=0.5)] = 0.3
    row_gate_sigma: Positive = 3.5  # gate for a crop's distance from its row
    # Less sure of its row, the robot asks a person.
    row_certainty: Ratio = 0.9
    gnss_timeout_s: Positive = 10.0  # longest time without a fix; then only dead reckoning is left
    dead_reckoning_std_m: Positive = 1.0  # largest position error of dead reckoning
    wheel_timeout_s: Positive = 0.3  # longest gap between wheel readings
    imu_timeout_s: Positive = 0.3  # longest gap between IMU readings


class ControlConfig(Config, frozen=True):
    length_m: Positive = 0.4  # distance in which an error is taken out
    delay_s: NonNegative = 0.2  # actuator lag and dead time
    max_yaw_rate_radps: Positive = 1.0  # largest yaw rate


class CalibrationConfig(Config, frozen=True):
    """Results of `agribot calibrate` for one robot; unset: as in its description."""

    wheel_radius_m: Positive | None = None  # rolling, under load
    yaw_multiplier: Positive | None = None  # effective separation over the track
    # GNSS antenna, forward and left of the turning centre.
    antenna_m: tuple[float, float] | None = None
    camera_height_m: Positive | None = None  # over the ground
    # Rotation of the camera's link in base_link.
    camera_rpy_rad: tuple[float, float, float] | None = None
    # Encoder counts of a turn of the wheel, all four edges, of an `agribot` board.
    counts_per_turn: Annotated[float, msgspec.Meta(ge=4, le=1e6)] | None = None
    # Speed of a wheel at 24 V without load; of an `agribot` board.
    full_speed_radps: Annotated[float, msgspec.Meta(ge=0.1, le=1e3)] | None = None
    # Resistance of a motor with its wires, 24 V over its stall current; unset: not watched.
    winding_ohm: Annotated[float, msgspec.Meta(gt=0, le=1e3)] | None = None


class SafetyConfig(Config, frozen=True):
    """Limits of the supervisor, the last gate before the motors."""

    max_pos_std_m: Positive = 3.0  # position known worse, the robot stands
    max_yaw_std_rad: Positive = 0.6  # heading known worse, the robot stands
    # Largest speed of any command.
    max_speed_mps: Annotated[float, msgspec.Meta(gt=0, le=2.0)] = 1.0
    max_yaw_rate_radps: Positive = 1.2  # largest yaw rate of any command
    max_tilt_rad: Positive = 0.6  # tilted more, the robot stops
    geofence_margin_m: Positive = 5.0  # around the path, without a boundary of the field
    # Distance over a field's boundary that the robot may reach by its own pose.
    fence_tolerance_m: NonNegative = 0.1
    # The same for a robot that is off by `fence_sigma` times the 1 sigma of its position.
    fence_unsure_m: NonNegative = 0.3
    fence_sigma: NonNegative = 2.0  # sigmas of the position kept off the boundary
    # The same without carrier corrections.
    fence_single_sigma: NonNegative = 3.5
    # Largest age of a request to drive by hand.
    hand_timeout_s: Annotated[float, msgspec.Meta(gt=0, le=0.5)] = 0.2
    # Reaction of the mission when the operator's page is gone.
    on_operator_lost: Literal["continue", "pause"] = "continue"
    # Wheels or IMU silent for longer stop the robot.
    sensor_timeout_s: Positive = 0.3
    # Pictures or the network later than this switch the tool off.
    camera_timeout_s: Positive = 1.0
    # Charge below which the robot goes home.
    low_charge_ratio: Ratio = 0.2
    empty_charge_ratio: Ratio = 0.08  # charge below which it stands
    # Voltage below which it goes home, where no charge is known; 0: not used.
    low_battery_v: NonNegative = 0.0
    empty_battery_v: NonNegative = 0.0  # voltage below which it stands
    # Inputs that the board must report, or the robot stands; unset: those of the platform.
    must_report: tuple[SafetyInput, ...] | None = None
    # A lidar of the robot's description must report, and missions wait for what is in their way.
    stops_for_obstacles: bool = True
    obstacle_stop_m: Positive = 2.0  # way to an obstacle at which the robot stands
    obstacle_slow_m: Positive = 4.0  # way to an obstacle at which it drives slowly
    clock_jump_s: Positive = 1.0  # longest gap between ticks


DEFAULT_MODEL = "agribot-plants"  # a network that knows five crops, and finds single plants


class PerceptionConfig(Config, frozen=True):
    enabled: bool = True  # use a camera
    model: str = DEFAULT_MODEL  # network: a packaged name or ONNX file
    camera_rate_hz: Annotated[float, msgspec.Meta(gt=0, le=60)] = 10.0  # pictures a second
    # Time from a picture to its plants; a robot reports pictures that come 0.2 s later.
    latency_s: Annotated[float, msgspec.Meta(gt=0, le=5)] = 0.2
    min_plant_area_m2: NonNegative = 2e-4  # smaller spots are no plants
    min_confidence: Ratio = 0.6  # less sure spots, and stems, are no plants
    max_range_m: Positive = 1.6  # plants farther away are not used
    threads: Annotated[int, msgspec.Meta(ge=1, le=64)] = 1  # threads of the network


class WeedConfig(Config, frozen=True):
    # Sightings this near are one plant.
    merge_radius_m: Positive = 0.12
    min_sightings: Count = 3  # fewest sightings of a plant in the map
    min_confidence: Ratio = 0.5  # least confidence of a plant in the map


LeafRule = Literal["any", "rows", "mapped", "alone", "none"]


class TreatmentConfig(Config, frozen=True):
    enabled: bool = True  # the implement works
    margin_m: NonNegative = 0.04  # most ground treated around a weed
    crop_guard_m: NonNegative = 0.05  # around a stem of crop, never treated
    # Error of a stem's place that all looks share: camera mount, ground, network
    look_std_m: NonNegative = 0.02
    # Error by wheels and gyro from the last look to the tool
    way_std_m: NonNegative = 0.012
    # Leaves of crop that may be treated: any, none, of plants alone in the map, of all mapped ones,
    # or of these and beside the row.
    leaves: LeafRule = "alone"
    # Least distance from another row for the rule `rows`; at most 5 cm less than that of rows.
    beside_row_m: Positive = 0.4
    # Beside rows, ground is also sprayed where the score of a weed's stem is this high; 1: nowhere.
    least_weed_score: Ratio = 1.0
    prescription: str = ""  # file of zones with rates; nothing outside is treated
    prescription_column: str = ""  # column of litres per hectare; empty: by usual names
    depth_m: Positive | None = None  # depth of a hoe's blades; unset: as deep as they reach


class RecordConfig(Config, frozen=True):
    enabled: bool = True  # write `run.mcap`
    image_rate_hz: NonNegative = 1.0  # pictures a second; 0: none
    jpeg_quality: Annotated[int, msgspec.Meta(ge=1, le=95)] = 80  # quality of these pictures
    max_file_mb: NonNegative = 0.0  # a new file begins at this size; 0: one file
    max_total_mb: NonNegative = 0.0  # above it, the oldest files go; 0: no limit
    min_free_mb: NonNegative = 200.0  # below it on the disk, files go or recording ends
    # Folder of an operator's frames; empty: `frames` beside the run.
    frames_dir: str = ""


class SourceConfig(Config, frozen=True):
    """Source of a sensor if not the platform: serial:/dev/ttyACM0; empty: the platform."""

    gnss: str = ""  # position
    imu: str = ""  # gyro and accelerometer
    mag: str = ""  # magnetometer
    wheels: str = ""  # encoders
    camera: str = ""  # pictures
    base: str = ""  # motor board: serial:/dev/ttyACM0?board=agribot
    # Contactor in the motors' supply: lcus:/dev/ttyUSB3; empty: none.
    contactor: str = ""
    scan: str = ""  # lidar of the robot's description: ros2:/scan
    others: str = ""  # topic of `OtherSample`s


class SimConfig(Config, frozen=True):
    # Step of the physics.
    step_s: Annotated[float, msgspec.Meta(ge=0.0005, le=0.005)] = 0.002
    # Preset of sensor errors: rtk, rtk-dual, m8n, ...
    sensors: str = "rtk"
    # In place of the world's own, over its areas of weeds or around its crops.
    weed_density_per_m2: Annotated[float, msgspec.Meta(ge=0, le=100)] | None = None
    # Differences of the world from its map: kind, field, hard, or a file.
    preset: str = "kind"
    camera_noise: bool = True  # noise of the picture
    camera_body: bool = True  # the robot and its shadow in the picture
    # Ideal speed servo, or a PID per wheel that commands torque.
    actuation: Literal["servo", "effort"] = "servo"
    # Receiver at the world's pole, with errors of its own or sharing the slow ones.
    base_station: Literal["off", "independent", "common"] = "off"
    # A lidar at the front, 0.45 m above the ground.
    lidar: bool = False
    # People, animals and things that step into the robot's way, drawn by the seed.
    visitors: Annotated[int, msgspec.Meta(ge=0, le=100)] = 0
    # Contactors in series in the motors' supply.
    contactors: Annotated[int, msgspec.Meta(ge=0, le=2)] = 2
    imu: str = ""  # IMU in place of the preset's: ideal, hector, mpu9265
    # Declination of the true field.
    declination_deg: Annotated[float, msgspec.Meta(ge=-180, le=180)] = 0.0


class RunConfig(Config, frozen=True):
    """All settings of one run; `config.toml` of the output folder holds them resolved."""

    # Name of these settings in reports and folders.
    profile: str = "farm"
    # Seed of all randomness.
    seed: Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)] = 0
    # Platform: `sim`, `firmware`, `hardware`, a registered one, or module:function.
    platform: str = "sim"
    world: str = WORLD  # world: a packaged name or SDF file
    # Robot: a packaged name, URDF or xacro with arguments: "x.xacro side:=left".
    robot: str = "agribot"
    waypoints: str = ""  # file of places to visit instead of the rows
    # Drive the rows, or find and draw those of an unmapped field.
    task: Literal["rows", "explore"] = "rows"
    plan: str = ""  # certified field plan instead of the rows
    tick_hz: Annotated[float, msgspec.Meta(ge=10, le=100)] = 50.0  # rate of the control loop
    duration_s: Positive | None = None  # unset: the run ends with its mission
    # Faults of the simulated world, each NAME[=VALUE]@T[~RISE][+SECONDS].
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
    # Settings of plugins, by their name (`agribot plugins`).
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
        fact = f"{source}: {name_setting(str(error), tree)}"
        raise ConfigError(add_advice(fact, "give such a value")) from error
    except ConfigError as error:
        raise ConfigError(f"{source}: {error}") from error
    return config


def assign(tree: dict[str, Any], setting: str) -> None:
    """Set one `key.subkey=value` in a tree."""
    key, separator, text = setting.partition("=")
    if not separator or not key:
        raise ConfigError(f"--set {setting}: no value; write it as key.subkey=value")
    *parents, leaf = key.strip().split(".")
    node = tree
    for name in parents:
        child = node.setdefault(name, {})
        if not isinstance(child, dict):
            raise ConfigError(
                f"--set {setting}: '{name}' is a value, not a group; write GROUP.NAME=VALUE"
            )
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
