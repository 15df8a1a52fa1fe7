"""What the robot is: the values that the URDF/xacro description was read into.

Only `agribot.description` builds these; physics, odometry, camera and exports all read them.
"""

from __future__ import annotations

import math

import msgspec
import numpy as np

from agribot.core.errors import DescriptionError
from agribot.core.geo import LINK_FROM_OPTICAL, transform
from agribot.core.implement.spec import ImplementSpec
from agribot.core.messages import WHEEL_NAMES, FloatArray, Vec3


class Origin(msgspec.Struct, frozen=True, kw_only=True):
    """A URDF origin: metres and fixed-axis roll, pitch, yaw."""

    xyz_m: Vec3 = (0.0, 0.0, 0.0)
    rpy_rad: Vec3 = (0.0, 0.0, 0.0)

    def matrix(self) -> FloatArray:
        """Make `parent_from_child`, (4, 4)."""
        return transform(self.xyz_m, self.rpy_rad)


class Shape(msgspec.Struct, frozen=True, kw_only=True):
    """Geometry of a visual or a collision element.

    `size_m` is (x, y, z) of a box, (radius, length, 0) of a cylinder, (radius, 0, 0) of a
    sphere and the scale of a mesh.
    """

    kind: str
    size_m: Vec3
    origin: Origin = Origin()
    mesh: str = ""
    rgba: tuple[float, float, float, float] = (0.7, 0.7, 0.7, 1.0)


class Link(msgspec.Struct, frozen=True, kw_only=True):
    """`inertia_kgm2` is (ixx, iyy, izz, ixy, ixz, iyz) about `com`, in its axes."""

    name: str
    mass_kg: float = 0.0
    com: Origin = Origin()
    inertia_kgm2: tuple[float, float, float, float, float, float] = (0.0,) * 6
    visuals: tuple[Shape, ...] = ()
    collisions: tuple[Shape, ...] = ()


class Joint(msgspec.Struct, frozen=True, kw_only=True):
    name: str
    kind: str
    parent: str
    child: str
    origin: Origin = Origin()
    axis: Vec3 = (1.0, 0.0, 0.0)
    effort_nm: float = math.inf
    velocity_radps: float = math.inf
    damping_nmspr: float = 0.0
    friction_nm: float = 0.0
    gear_ratio: float = 1.0


class TyreSpec(msgspec.Struct, frozen=True, kw_only=True):
    """Tyre on soil. `friction_*` is already the smaller of wheel and ground, as ODE takes it.

    While the wheel rolls on by `relaxation_length_m`, its contact patch is renewed: at rest the
    bristles are a spring, on the move slip s is a force of stiffness * length * s up to friction.
    """

    friction_longitudinal_ratio: float = 1.0
    friction_lateral_ratio: float = 1.0
    normal_stiffness_npm: float = 1e4
    normal_damping_ratio: float = 0.4
    bristle_stiffness_npm: float = 5e3
    relaxation_length_m: float = 0.03
    rolling_resistance_ratio: float = 0.03


GRAVITY_MPS2 = 9.81
REACTION_S = 0.2  # delay until the brakes bite: a tick, the network of the motor board, its lag


class DriveSpec(msgspec.Struct, frozen=True, kw_only=True):
    """Skid-steer drive.

    `wheel_radius_m`, `track_m` and `wheelbase_m` are measured on the geometry.
    `plugin_diameter_m` and `plugin_separation_m` are what the original drive plugin was given
    (wrongly); they matter only for its compatibility mode. `yaw_multiplier` scales the track
    to the effective separation of a skidding vehicle, (a^2 + b^2) / b^2 for equal friction.
    `torque_nm` is the drive plugin's limit at each wheel; encoder ticks count on the motor shaft.
    """

    wheel_radius_m: float
    wheel_width_m: float
    track_m: float
    wheelbase_m: float
    plugin_diameter_m: float
    plugin_separation_m: float
    yaw_multiplier: float
    torque_nm: float
    gear_ratio: float
    encoder_ticks_per_rev: int
    command_timeout_s: float
    max_speed_mps: float
    max_yaw_rate_radps: float
    max_accel_mps2: float
    max_yaw_accel_radps2: float
    rotor_inertia_kgm2: float
    servo_gain_nmspr: float
    rate_hz: float
    # Speed controller of a wheel that is driven by torque: Nm per rad/s, rad and rad/s^2.
    pid_p_nmspr: float = 0.3
    pid_i_nmprad: float = 3.0
    pid_d_nms2prad: float = 0.0005
    # Torque of the motor itself before the gear, and the share that the gear leaves.
    motor_torque_nm: float = math.inf
    gear_efficiency_ratio: float = 1.0
    # The motor as felt at the wheel, behind the gear: V = R I + k w, T = k (I - I0). The defaults
    # are a 150 W motor at 10:1 (maxon RE 40, 148867) and a servo controller of its data sheet.
    torque_constant_nmpa: float = 0.302
    winding_ohm: float = 0.299
    no_load_a: float = 0.137
    controller_efficiency_ratio: float = 0.95
    regeneration_ratio: float = 0.0  # share of the braking power that goes back into the battery

    @property
    def wheel_torque_nm(self) -> float:
        """Most torque at a wheel: of the motor behind its gear, and of the drive's own limit."""
        geared_nm = self.motor_torque_nm * self.gear_ratio * self.gear_efficiency_ratio
        return min(self.torque_nm, geared_nm)

    @property
    def effective_separation_m(self) -> float:
        return self.track_m * self.yaw_multiplier

    def with_plugin_geometry(self) -> DriveSpec:
        """Return the drive with the geometry that the original's plugin was configured with."""
        return msgspec.structs.replace(
            self,
            wheel_radius_m=self.plugin_diameter_m / 2.0,
            track_m=self.plugin_separation_m,
            yaw_multiplier=1.0,
        )

    def wheel_speeds_radps(self, v_mps: float, yaw_rate_radps: float) -> tuple[float, float]:
        """Compute the left and right wheel speed for a body twist."""
        half_m = self.effective_separation_m / 2.0
        return (
            (v_mps - yaw_rate_radps * half_m) / self.wheel_radius_m,
            (v_mps + yaw_rate_radps * half_m) / self.wheel_radius_m,
        )


class CameraSpec(msgspec.Struct, frozen=True, kw_only=True):
    """Camera; `link` is the frame with x forward, the optical frame follows REP-103.

    `distortion` is k1, k2, p1, p2 of the lens in OpenCV's model; all zero is a pinhole.
    """

    link: str
    width_px: int
    height_px: int
    hfov_rad: float
    rate_hz: float
    noise_std: float
    clip_near_m: float
    clip_far_m: float
    distortion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    @property
    def focal_px(self) -> float:
        return self.width_px / (2.0 * math.tan(self.hfov_rad / 2.0))

    def matrix(self) -> FloatArray:
        """Make the intrinsic matrix (3, 3), as in CameraInfo: pixel (0, 0) is centred at (0, 0)."""
        focal = self.focal_px
        return np.array(
            [
                [focal, 0.0, (self.width_px - 1) / 2.0],
                [0.0, focal, (self.height_px - 1) / 2.0],
                [0.0, 0.0, 1.0],
            ]
        )


class SensorMount(msgspec.Struct, frozen=True, kw_only=True):
    """Place of a sensor and its rate; `tags` keeps the plugin's own numbers."""

    link: str
    rate_hz: float
    tags: dict[str, str] = {}


class LidarSpec(msgspec.Struct, frozen=True, kw_only=True):
    """A lidar that scans a plane, about z of its link from the first angle to the last."""

    link: str
    rate_hz: float = 10.0
    samples: int = 720
    min_angle_rad: float = -math.pi
    max_angle_rad: float = math.pi
    range_min_m: float = 0.15
    range_max_m: float = 12.0
    noise_std_m: float = 0.0

    @property
    def step_rad(self) -> float:
        """Angle from ray to ray; 0 of a single one."""
        return (self.max_angle_rad - self.min_angle_rad) / max(self.samples - 1, 1)


class RobotSpec(msgspec.Struct, frozen=True, kw_only=True):
    """A robot as its description gives it: bodies, drive, sensors and implement."""

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    drive: DriveSpec
    tyre: TyreSpec
    imu: SensorMount
    gnss: SensorMount
    mag: SensorMount | None = None  # many robots have none: motors disturb it
    camera: CameraSpec | None = None
    implement: ImplementSpec | None = None
    lidar: LidarSpec | None = None
    middle_wheels: tuple[str, ...] = ()  # driven ones between the corners: right, left, rear first
    warnings: tuple[str, ...] = ()  # gaps of the description, each with its replacement

    def link(self, name: str) -> Link:
        for link in self.links:
            if link.name == name:
                return link
        known = ", ".join(sorted(link.name for link in self.links))
        raise DescriptionError(f"robot '{self.name}' has no link '{name}'; it has: {known}")

    def promise_stop_m(self, v_mps: float, deaf_s: float = 0.0, tilt_rad: float = 0.0) -> float:
        """Return the way until it stands after a stop command at this speed.

        A board that does not hear it stops by itself after `deaf_s`. A robot that was tipped by
        `tilt_rad` falls back, and its middle turns about wheels that roll with it.
        """
        reaction_s = REACTION_S + deaf_s
        falls_m = abs(tilt_rad) * (self.drive.wheelbase_m / 2.0 + self.drive.wheel_radius_m)
        return abs(v_mps) * reaction_s + v_mps**2 / (2.0 * self.drive.max_accel_mps2) + falls_m

    def promise_roll_out_m(self, v_mps: float) -> float:
        """Return the way on which it stands, on level ground, after its motors lost their power.

        Nothing but the rolling resistance of its tyres is counted on, and what turns rolls on, too:
        a wheel, about the axis of its largest moment, with its motor and gear. Infinite where a
        description gives the tyres none.
        """
        turning_kgm2 = sum(
            max(self.link(name).inertia_kgm2[:3]) + self.drive.rotor_inertia_kgm2
            for name in self.wheel_names
        )
        weight_n = GRAVITY_MPS2 * self.mass_kg
        rolling_kg = self.mass_kg + turning_kgm2 / self.drive.wheel_radius_m**2
        rolling_mps2 = self.tyre.rolling_resistance_ratio * weight_n / rolling_kg
        if rolling_mps2 <= 0.0:
            return math.inf
        return abs(v_mps) * REACTION_S + v_mps**2 / (2.0 * rolling_mps2)

    @property
    def wheel_names(self) -> tuple[str, ...]:
        """All wheels: those at the corners as in WHEEL_NAMES, then those between them."""
        return (*WHEEL_NAMES, *self.middle_wheels)

    @property
    def tool_x_m(self) -> float:
        """Tool point on the body: the origin without an implement."""
        return self.implement.x_body_m if self.implement else 0.0

    @property
    def base_height_m(self) -> float:
        """Height of base_link over the ground when the robot stands on its wheels."""
        return self.drive.wheel_radius_m - float(self.base_from_link(WHEEL_NAMES[0])[2, 3])

    def base_from_link(self, name: str) -> FloatArray:
        """Compute the pose of a link in base_link with all joints at zero, (4, 4)."""
        self.link(name)
        parents = {joint.child: joint for joint in self.joints}
        base_from_link = np.eye(4)
        while name != "base_link":
            joint = parents.get(name)
            if joint is None:
                return np.linalg.inv(self._root_from("base_link")) @ base_from_link
            base_from_link = joint.origin.matrix() @ base_from_link
            name = joint.parent
        return base_from_link

    def _root_from(self, name: str) -> FloatArray:
        parents = {joint.child: joint for joint in self.joints}
        root_from_link = np.eye(4)
        while name in parents:
            root_from_link = parents[name].origin.matrix() @ root_from_link
            name = parents[name].parent
        return root_from_link

    def body_from_link(self, name: str) -> FloatArray:
        """Compute the pose of a link in the body frame: on the ground, below base_link, (4, 4)."""
        return transform((0.0, 0.0, self.base_height_m)) @ self.base_from_link(name)

    def body_from_camera(self) -> FloatArray:
        """Compute the pose of the camera's optical frame in the body frame, (4, 4)."""
        if self.camera is None:
            raise DescriptionError(f"robot '{self.name}' has no camera; add a camera sensor")
        return self.body_from_link(self.camera.link) @ LINK_FROM_OPTICAL

    def wheel_xy_body_m(self) -> FloatArray:
        """List the ground contacts of the wheels in the order of `wheel_names`, (n, 2)."""
        return np.array([self.base_from_link(name)[:2, 3] for name in self.wheel_names])

    @property
    def mass_kg(self) -> float:
        return sum(link.mass_kg for link in self.links)
