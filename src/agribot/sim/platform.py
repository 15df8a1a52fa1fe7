"""SimPlatform: the simulated robot behind the same interface as a real one."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from agribot.core.config import RunConfig
from agribot.core.encounter import Encounter
from agribot.core.errors import ConfigError, PlatformError
from agribot.core.implement.kind import WetsLeaves
from agribot.core.messages import (
    STOP,
    BumperSample,
    ByteArray,
    CameraFrame,
    FloatArray,
    ImplementCommand,
    Inbox,
    LaserScan,
    RobotCommand,
    SensorBatch,
    Vec3,
)
from agribot.core.robot import DriveSpec, RobotSpec
from agribot.core.world import WorldSpec
from agribot.sim.attitude import read_roll_pitch_yaw, read_rotation
from agribot.sim.camera_sensor import CameraSensor, TrueView
from agribot.sim.clock import NS_PER_S, Schedule, round_step_ns
from agribot.sim.contactor import SimContactors
from agribot.sim.driven_physics import DrivenPhysics, WheelDriver
from agribot.sim.faults.bodies import move_start
from agribot.sim.faults.layer import FaultLayer
from agribot.sim.faults.schedule import read_faults
from agribot.sim.field_effects import PlantDamage
from agribot.sim.ground_surface import GroundSurface
from agribot.sim.implements.kinds import fit_effect
from agribot.sim.physics import Physics
from agribot.sim.plant_states import PlantStates
from agribot.sim.random_streams import make_stream
from agribot.sim.sensors.suite import SampledSensor, SensorSuite
from agribot.sim.sensors.tuning import check_tuning
from agribot.sim.state import ANGULAR, POSITION, VELOCITY
from agribot.sim.truth import Truth
from agribot.sim.underside import Part
from agribot.sim.visit_log import VisitLog
from agribot.sim.walkers import PersonWatch

if TYPE_CHECKING:
    from agribot.sim.ray_scene import RayScene

TREATED_EVERY_S = 0.5  # plants that a tool has worked are looked up this often


class SimPlatform:
    """Lock-step: `read` advances by exactly one tick of the stack under the last command."""

    def __init__(
        self,
        config: RunConfig,
        robot: RobotSpec,
        world: WorldSpec,
        *,
        board: DriveSpec | None = None,
        began_s: float = 0.0,
        driver: WheelDriver | None = None,
    ) -> None:
        """Build the world; `board` is the drive that the motor board assumes, else the true one.

        `driver` turns the wheels in place of that board.

        `began_s` is how old the job is that the robot goes on with: the faults of the settings
        count from the job's begin.

        Raises:
            ConfigError: unknown sensor preset, a rate that the physics cannot give, or a fault
                that is wrong or never comes.
            DescriptionError: the robot has an implement of an unregistered kind.
        """
        self._step_ns = round_step_ns(config.sim.step_s)
        self._robot = robot
        faults = read_faults(config, has_camera=robot.camera is not None, began_s=began_s)
        world = move_start(world, faults) if faults else world
        self.faults = FaultLayer(faults, config, robot, world) if faults else None
        self._ticks = Schedule(config.tick_hz, self._step_ns)
        self._sensors = SensorSuite(config, robot, world, self._step_ns)
        self._plants = PlantStates(len(world.plants))
        self._physics = _make_physics(config, robot, world, self._step_ns, board, driver)
        self._feed, self._frames = _make_camera(
            config, robot, world, self._step_ns, self._plants, self._physics.ground
        )
        self._rays, self._lidar = _make_lidar(
            config, robot, world, self._step_ns, self._plants, self._physics.ground
        )
        self._damage = PlantDamage(robot, world, self._plants, self._physics.ground)
        self._implement = fit_effect(robot.implement, world, robot.base_height_m)
        self._treated_s = 0.0
        self._persons, self._visit_log = PersonWatch(robot, world), VisitLog(robot, world.walkers)
        count = config.sim.contactors
        self._contactors = SimContactors(count) if count else None
        self.inbox = Inbox()
        self._tunings: deque[tuple[str, str, float]] = deque()
        self._tuning_taps: list[Callable[[str, str, float], None]] = []
        self._base_height_m = robot.base_height_m
        self._truth: Truth | None = None
        self._silent_after_s = 0.0
        self._closed = False

    def read(self) -> SensorBatch:
        """Advance one tick and return what the sensors delivered meanwhile.

        Raises: PlatformError: the platform is closed or its physics diverged.
        """
        if self._closed:
            raise PlatformError("the simulator is closed; build a new SimPlatform to go on")
        while self._tunings:
            self._sensors.tune(*self._tunings.popleft())
        first = self._physics.step
        last = self._ticks.pop()
        if self.faults is not None:
            self._suffer(self.faults, first * self._step_ns / NS_PER_S)
        self._switch_power(first * self._step_ns / NS_PER_S)
        history = self._physics.advance(last - first)
        t_s = last * self._step_ns / NS_PER_S
        self._affect_field(first * self._step_ns / NS_PER_S, t_s)
        sensors = self._sensors
        requests, hand = self.inbox.drain(t_s)
        batch = SensorBatch(
            t_s=t_s,
            wheels=sensors.wheels.take_samples(first, last, history),
            imu=sensors.imu.take_samples(first, last, history),
            mag=sensors.mag.take_samples(first, last, history) if sensors.mag else (),
            gnss=sensors.gnss.take_samples(first, last, history, t_s),
            frames=self._frames.take_samples(first, last, history) if self._frames else (),
            requests=requests,
            hand=hand,
            base=sensors.base.take_samples(first, last, history, t_s) if sensors.base else (),
            headings=(
                sensors.headings.take_samples(first, last, history, t_s) if sensors.headings else ()
            ),
            bumper=self._read_bumper(t_s),
            battery=sensors.battery.take_samples(first, last, history),
            contactor=() if self._contactors is None else (self._contactors.read(t_s),),
            scans=self._lidar.take_samples(first, last, history) if self._lidar else (),
        )
        return batch if self.faults is None else self.faults.alter(batch)

    def write(self, command: RobotCommand) -> None:
        """Hand a command to the motor board and the implement.

        Raises: PlatformError: a number is not finite, or the command is for another implement.
        """
        drive = command.drive
        if not (math.isfinite(drive.v_mps) and math.isfinite(drive.yaw_rate_radps)):
            raise PlatformError(
                f"drive command v = {drive.v_mps} m/s, yaw rate = {drive.yaw_rate_radps} rad/s "
                "is not finite; the board refuses it and keeps the last one until its timeout"
            )
        if self._closed:
            raise PlatformError("simulator: closed, it takes no commands; open it anew")
        if self._contactors is not None:  # on a line of their own, which needs no motor board
            self._contactors.command(self._now_s, is_cut=command.is_power_cut)
        if self.faults is not None and not self.faults.hears(self._now_s):
            return
        self._implement.command(self._now_s, command.implement)
        self._physics.command(drive)
        self._silent_after_s = self._now_s + self._robot.drive.command_timeout_s

    def close(self) -> None:
        if not self._closed:
            self._physics.command(STOP)
            self._implement.command(self._now_s, ImplementCommand())
            self._closed = True

    def limit_torque(self, wheel: str, torque_nm: float) -> None:
        """Limit the torque of a motor, as a fault; at 0 it is dead and its wheel rolls freely."""
        self._physics.limit_torque(wheel, torque_nm)

    @property
    def has_power(self) -> bool:
        """Whether the motors have power."""
        return self._contactors is None or self._contactors.feed_motors

    def tune(self, sensor: str, parameter: str, value: float) -> None:
        """Change a sensor's error from any thread, for all samples from the next read on.

        The error adds to those of the preset. Sensors: gnss (m), gnss_velocity (m/s),
        accel (m/s^2), gyro (rad/s), mag (T); parameters: gaussian_noise, offset, drift,
        drift_frequency (Hz), scale_error (1 without an error).

        Raises: ConfigError: unknown name, or a value that the parameter cannot have.
        """
        check_tuning(sensor, parameter, value)
        self._tunings.append((sensor, parameter, value))
        for tap in self._tuning_taps:
            tap(sensor, parameter, value)

    def add_tuning_tap(self, tap: Callable[[str, str, float], None]) -> None:
        """Call `tap` with every change of an error, in the thread that changes it."""
        self._tuning_taps.append(tap)

    def truth(self) -> Truth:
        """Return the true state of the robot; the same object until the next read."""
        if self._truth is None or self._truth.t_s != self._now_s:
            self._truth = self._measure_truth()
        return self._truth

    @property
    def imu_bias(self) -> tuple[Vec3, Vec3]:
        """The true biases of accelerometer, m/s^2, and gyro, rad/s, at the last sample."""
        return self._sensors.find_imu_bias()

    @property
    def gnss_latency_s(self) -> float:
        """Time from the epoch of a fix until it arrives."""
        return self._sensors.gnss.latency_s

    def _measure_truth(self) -> Truth:
        row = self._physics.history[-1]
        rotation = read_rotation(row)
        roll, pitch, yaw = read_roll_pitch_yaw(row)
        arm_m = rotation[:, 2] * -self._base_height_m
        origin = row[POSITION] + arm_m
        # Yaw about the body's own z axis leaves its origin where it is; tilting does not.
        angular = row[ANGULAR]
        forward_mps = rotation[:, 0] @ row[VELOCITY] - angular[1] * self._base_height_m
        return Truth(
            t_s=self._now_s,
            x_map_m=float(origin[0]),
            y_map_m=float(origin[1]),
            yaw_map_rad=yaw,
            v_mps=float(forward_mps),
            yaw_rate_radps=float(angular[2]),
            roll_rad=roll,
            pitch_rad=pitch,
        )

    def truth_mask(self, frame_index: int) -> ByteArray | None:
        """Return the true class ids of a recent frame, (height, width); None if it is too old."""
        return None if self._feed is None else self._feed.truth_mask(frame_index)

    @property
    def crushed(self) -> set[int]:
        """Crops that the robot crushed, as indices into the world's plants."""
        return self._damage.crushed

    @property
    def brushed(self) -> set[int]:
        """Crops whose leaves the robot touched and that live, as indices."""
        return self._damage.brushed

    def restore_plants(self, crushed_by: Mapping[int, Part], treated: Sequence[int]) -> None:
        """Let plants lie that earlier runs of the job crushed, or took with the implement."""
        for index, part in crushed_by.items():
            self._plants.crush(index, 0.0, part, 0.0)
        if self._robot.implement is not None and self._robot.implement.cuts_plants:
            for index in treated:
                self._plants.cut(index, 0.0, 0.0)

    @property
    def plants(self) -> PlantStates:
        """State of all plants; nothing but the simulator may change it."""
        return self._plants

    @property
    def person_distance_min_m(self) -> float | None:
        """Smallest distance of the robot's outline to a person's; None without a person."""
        return self._persons.least_m

    @property
    def visits(self) -> tuple[Encounter, ...]:
        """What became of those who stepped into the robot's way."""
        return self._visit_log.visits

    def find_touched(self) -> str | None:
        """Return the name of the obstacle or walker that the robot touches, None if none."""
        return self._physics.find_touched()

    @property
    def treated(self) -> dict[int, float]:
        """Plants that the implement worked on: index -> time of the first touch, s."""
        return self._implement.treated

    @property
    def wet_leaves(self) -> dict[int, float]:
        """Crop plants with wet leaves: index -> share of their leaf area."""
        return self._implement.wet_leaves if isinstance(self._implement, WetsLeaves) else {}

    @property
    def offsets_m(self) -> dict[int, float]:
        """Weeds that the tool worked near: index -> distance from the middle of a section."""
        return self._implement.offsets_m if isinstance(self._implement, WetsLeaves) else {}

    def add_view_tap(self, tap: Callable[[TrueView], None]) -> None:
        """Let `tap` see what each frame truly shows, before the frame goes out.

        Raises: PlatformError: the robot has no camera, or it is off.
        """
        if self._feed is None:
            raise PlatformError("the simulated robot takes no pictures; set perception.enabled")
        self._feed.view_taps.append(tap)

    @property
    def motion(self) -> tuple[FloatArray, FloatArray]:
        """Rows of the physics history at the start and the end of the last tick."""
        return self._physics.history[0], self._physics.history[-1]

    @property
    def looks(self) -> dict[int, int]:
        """Plants that the camera showed: index -> in how many pictures well enough to be seen."""
        if self._feed is None:
            return {}
        seen = np.flatnonzero(self._feed.looks)
        return dict(zip(seen.tolist(), self._feed.looks[seen].tolist(), strict=True))

    @property
    def worked_m2(self) -> float:
        """Ground that the implement worked; passing twice counts twice."""
        return self._implement.worked_m2

    @property
    def _now_s(self) -> float:
        return self._physics.step * self._step_ns / NS_PER_S

    def _suffer(self, faults: FaultLayer, t_s: float) -> None:
        """Let faults act on body and ground for the tick that begins now."""
        appeared = faults.act(t_s, self._physics)
        if appeared is not None and self._feed is not None:
            self._feed.add_obstacle(appeared)
        if appeared is not None and self._rays is not None:
            self._rays.add_obstacle(appeared)
        if self._feed is not None:
            self._feed.shift_mount(faults.find_mount_shift_m(t_s))

    def _switch_power(self, t_s: float) -> None:
        """Let the contactors feed the motors, or not, for the tick that begins now."""
        if self._contactors is not None:
            on = () if self.faults is None else self.faults.list_names(t_s)
            has_current = not {"button.pressed", "contactor.silent"}.intersection(on)
            self._contactors.step(t_s, has_current=has_current, is_welded="contactor.welded" in on)
            self._physics.switch_power(is_on=self._contactors.feed_motors)

    def _affect_field(self, start_s: float, end_s: float) -> None:
        before, after = self._physics.history[0], self._physics.history[-1]
        if start_s > self._silent_after_s:
            self._implement.command(start_s, ImplementCommand())
        if not self._physics.is_held:
            self._damage.update(end_s, before, after)
        self._implement.update(end_s, before, after, end_s - start_s)
        self._physics.pull(self._implement.pull())
        if self._persons.has_persons:
            truth = self.truth()
            self._persons.update(end_s, truth.x_map_m, truth.y_map_m, truth.yaw_map_rad)
        if self._visit_log.has_visitors:
            self._visit_log.update(self.truth())
        if end_s - self._treated_s >= TREATED_EVERY_S:
            self._treated_s = end_s
            self._note_treated()

    def _note_treated(self) -> None:
        """Let the plants know what the implement has done to them."""
        spec = self._robot.implement
        if spec is None or not (spec.cuts_plants or spec.wets_ground):
            return
        yaw_rad = read_roll_pitch_yaw(self._physics.history[-1])[2]
        for index, t_s in self._implement.treated.items():
            if spec.cuts_plants:
                self._plants.cut(index, t_s, yaw_rad)
            else:
                self._plants.spray(index, t_s)

    def _read_bumper(self, t_s: float) -> tuple[BumperSample, ...]:
        place = self._physics.find_contact_body_m()
        return (
            () if place is None else (BumperSample(t_s=t_s, x_body_m=place[0], y_body_m=place[1]),)
        )


def _make_physics(
    config: RunConfig,
    robot: RobotSpec,
    world: WorldSpec,
    physics_step_ns: int,
    board: DriveSpec | None,
    driver: WheelDriver | None,
) -> Physics:
    if driver is not None:
        return DrivenPhysics(robot, world, physics_step_ns, driver)
    is_effort = config.sim.actuation == "effort"
    return Physics(robot, world, physics_step_ns, board=board, is_effort=is_effort)


def _make_lidar(
    config: RunConfig,
    robot: RobotSpec,
    world: WorldSpec,
    physics_step_ns: int,
    plants: PlantStates,
    ground: GroundSurface,
) -> tuple[RayScene | None, SampledSensor[LaserScan] | None]:
    if robot.lidar is None:
        return None, None
    from agribot.sim.ray_scene import RayScene
    from agribot.sim.sensors.lidar import Lidar

    scene = RayScene(world, ground, plants)
    lidar = Lidar(robot, scene, make_stream(config.seed, "lidar"))
    return scene, SampledSensor(lidar, robot.lidar.rate_hz, physics_step_ns)


def _make_camera(
    config: RunConfig,
    robot: RobotSpec,
    world: WorldSpec,
    physics_step_ns: int,
    plants: PlantStates,
    ground: GroundSurface,
) -> tuple[CameraSensor | None, SampledSensor[CameraFrame] | None]:
    if not config.perception.enabled:
        return None, None
    if robot.camera is None:
        raise ConfigError(
            f"perception.enabled is true, but robot '{robot.name}' has no camera; "
            "set perception.enabled=false or add a camera to its description"
        )
    noise = make_stream(config.seed, "camera") if config.sim.camera_noise else None
    feed = CameraSensor(
        robot, robot.camera, world, noise, has_body=config.sim.camera_body, plants=plants,
        keeps_weeds=config.sim.preset == "kind", ground=ground,
    )  # fmt: skip
    return feed, SampledSensor(feed, config.perception.camera_rate_hz, physics_step_ns)
