"""All sensors of one robot but the camera: built from a preset, sampled from the history."""

from __future__ import annotations

from collections import deque
from typing import Generic, Protocol, TypeVar

from agribot.messages import FloatArray, GnssFix, ImuSample, MagSample, WheelSample
from agribot.robot import RobotSpec, SensorMount
from agribot.sim.clock import NS_PER_S, Schedule
from agribot.sim.random_streams import stream
from agribot.sim.sensors.gnss import Antenna, HectorReceiver, Receiver
from agribot.sim.sensors.imu import Imu
from agribot.sim.sensors.magnetometer import HectorMagnetometer, Magnetometer
from agribot.sim.sensors.presets import HectorGnss, HectorMag, SensorPreset
from agribot.sim.sensors.wheel_encoders import WheelEncoders
from agribot.world import WorldSpec

# Where neither the preset nor the robot description names a rate.
DEFAULT_IMU_HZ, DEFAULT_MAG_HZ, DEFAULT_GNSS_HZ = 200.0, 20.0, 5.0

Sample_co = TypeVar("Sample_co", covariant=True)
Sample = TypeVar("Sample")


class Sensor(Protocol[Sample_co]):
    def sample(self, t_s: float, row: FloatArray) -> Sample_co: ...


class Channel(Generic[Sample]):
    """A sensor and its schedule."""

    def __init__(self, sensor: Sensor[Sample], rate_hz: float, physics_step_ns: int) -> None:
        self._sensor = sensor
        self._schedule = Schedule(rate_hz, physics_step_ns)
        self._step_ns = physics_step_ns

    def samples(self, first_step: int, last_step: int, history: FloatArray) -> tuple[Sample, ...]:
        """Those of the steps after `first_step` up to `last_step`; row 0 is `first_step`."""
        schedule = self._schedule
        if schedule.next_step > last_step:
            return ()
        sensor, step_ns = self._sensor, self._step_ns
        return tuple(
            [
                sensor.sample(step * step_ns / NS_PER_S, history[step - first_step])
                for step in schedule.due(last_step)
            ]
        )


class SensorSuite:
    def __init__(
        self,
        preset: SensorPreset,
        robot: RobotSpec,
        world: WorldSpec,
        seed: int,
        physics_step_ns: int,
    ) -> None:
        wheels = WheelEncoders(preset.wheels, robot.drive)
        self.wheels: Channel[WheelSample] = Channel(wheels, preset.wheels.rate_hz, physics_step_ns)
        imu_hz = _rate_hz(preset.imu.rate_hz, robot.imu, DEFAULT_IMU_HZ)
        imu = Imu(preset.imu, imu_hz, stream(seed, "imu"))
        self.imu: Channel[ImuSample] = Channel(imu, imu_hz, physics_step_ns)
        self.mag: Channel[MagSample] = Channel(
            _magnetometer(preset, world, seed),
            _rate_hz(preset.mag.rate_hz, robot.mag, DEFAULT_MAG_HZ),
            physics_step_ns,
        )
        receiver = _receiver(preset, robot, world, seed)
        self._gnss: Channel[GnssFix] = Channel(
            receiver,
            _rate_hz(preset.gnss.rate_hz, robot.gnss, DEFAULT_GNSS_HZ),
            physics_step_ns,
        )
        self._latency_s = receiver.latency_s
        self._late: deque[GnssFix] = deque()

    def gnss(
        self, first_step: int, last_step: int, history: FloatArray, t_s: float
    ) -> tuple[GnssFix, ...]:
        """The fixes that have arrived by `t_s`; they are `latency_s` late."""
        self._late.extend(self._gnss.samples(first_step, last_step, history))
        arrived = []
        while self._late and self._late[0].t_s + self._latency_s <= t_s + 1e-9:
            arrived.append(self._late.popleft())
        return tuple(arrived)


def _rate_hz(preset_hz: float | None, mount: SensorMount, default_hz: float) -> float:
    return preset_hz or mount.rate_hz or default_hz


def _magnetometer(
    preset: SensorPreset, world: WorldSpec, seed: int
) -> Magnetometer | HectorMagnetometer:
    rng = stream(seed, "mag")
    if isinstance(preset.mag, HectorMag):
        return HectorMagnetometer(preset.mag, world.field_enu_t, rng)
    return Magnetometer(preset.mag, world.field_enu_t, rng)


def _receiver(
    preset: SensorPreset, robot: RobotSpec, world: WorldSpec, seed: int
) -> Receiver | HectorReceiver:
    x_m, y_m, z_m = robot.base_from_link(robot.gnss.link)[:3, 3].tolist()
    antenna = Antenna(world.datum, (x_m, y_m, z_m))
    if isinstance(preset.gnss, HectorGnss):
        return HectorReceiver(preset.gnss, antenna, seed)
    return Receiver(preset.gnss, antenna, seed)
