"""All sensors of one robot but the camera: built from a preset, sampled from the history."""

from __future__ import annotations

from collections import deque
from typing import Generic, Protocol, TypeVar

import msgspec

from agribot.core.config import RunConfig
from agribot.core.messages import (
    BaseFix,
    BatterySample,
    FloatArray,
    GnssFix,
    GnssHeading,
    ImuSample,
    MagSample,
    Vec3,
    WheelSample,
)
from agribot.core.robot import RobotSpec, SensorMount
from agribot.core.world import WorldSpec
from agribot.sim.clock import NS_PER_S, Schedule
from agribot.sim.random_streams import make_stream
from agribot.sim.sensors.base_station import BASE_RATE_HZ, BaseStation
from agribot.sim.sensors.battery import BATTERY_RATE_HZ, Battery
from agribot.sim.sensors.dual_antenna import DualAntenna
from agribot.sim.sensors.gnss import Antenna, HectorReceiver, Receiver
from agribot.sim.sensors.imu import Imu
from agribot.sim.sensors.magnetometer import HectorMagnetometer, Magnetometer, turn_field
from agribot.sim.sensors.presets import (
    HectorGnss,
    HectorMag,
    SensorPreset,
    load_imu,
    load_preset,
)
from agribot.sim.sensors.tuning import Tuning
from agribot.sim.sensors.wheel_encoders import WheelEncoders

# Rates if neither the preset nor the robot description names one.
DEFAULT_IMU_HZ, DEFAULT_MAG_HZ, DEFAULT_GNSS_HZ = 200.0, 20.0, 5.0

Sample_co = TypeVar("Sample_co", covariant=True)
Sample = TypeVar("Sample")


class HasTime(Protocol):
    """Anything with a capture time."""

    @property
    def t_s(self) -> float: ...


Timed = TypeVar("Timed", bound=HasTime)


class SensorModel(Protocol[Sample_co]):
    """A sensor that reads a sample out of one row of the physics history."""

    def sample(self, t_s: float, row: FloatArray) -> Sample_co: ...


class SampledSensor(Generic[Sample]):
    """A sensor model with the schedule of its samples."""

    def __init__(self, sensor: SensorModel[Sample], rate_hz: float, physics_step_ns: int) -> None:
        self._sensor = sensor
        self._schedule = Schedule(rate_hz, physics_step_ns)
        self._step_ns = physics_step_ns

    def take_samples(
        self, first_step: int, last_step: int, history: FloatArray
    ) -> tuple[Sample, ...]:
        """Take the samples of the steps after `first_step` up to `last_step`.

        `history` is (steps + 1, HISTORY_COLUMNS); its row 0 is that of `first_step`.
        """
        schedule = self._schedule
        if schedule.next_step > last_step:
            return ()
        sensor, step_ns = self._sensor, self._step_ns
        return tuple(
            [
                sensor.sample(step * step_ns / NS_PER_S, history[step - first_step])
                for step in schedule.pop_due(last_step)
            ]
        )


class DelayedSensor(Generic[Timed]):
    """A sensor whose samples arrive `latency_s` after their time; None is no sample."""

    def __init__(self, channel: SampledSensor[Timed | None], latency_s: float) -> None:
        self._channel = channel
        self.latency_s = latency_s
        self._late: deque[Timed] = deque()

    def take_samples(
        self, first_step: int, last_step: int, history: FloatArray, t_s: float
    ) -> tuple[Timed, ...]:
        """Take the samples of these steps; return those that have arrived by `t_s`.

        `history` is as in `SampledSensor.take_samples`.
        """
        for sample in self._channel.take_samples(first_step, last_step, history):
            if sample is not None:
                self._late.append(sample)
        arrived = []
        while self._late and self._late[0].t_s + self.latency_s <= t_s + 1e-9:
            arrived.append(self._late.popleft())
        return tuple(arrived)


class SensorSuite:
    """The sensors of one run, each with its own random stream."""

    def __init__(
        self,
        config: RunConfig,
        robot: RobotSpec,
        world: WorldSpec,
        physics_step_ns: int,
    ) -> None:
        """Build the sensors.

        Raises: ConfigError: unknown preset, or a rate that the physics cannot give.
        """
        preset, seed = load_preset(config.sim.sensors), config.seed
        imu_errors = load_imu(config.sim.imu) if config.sim.imu else preset.imu
        self._tunings = {
            name: Tuning(make_stream(seed, f"tuning {name}")) for name in ("accel", "gyro", "mag")
        }
        wheels = WheelEncoders(preset.wheels, robot.drive, robot.middle_wheels)
        self.wheels: SampledSensor[WheelSample] = SampledSensor(
            wheels, preset.wheels.rate_hz, physics_step_ns
        )
        imu_hz = _choose_rate_hz(imu_errors.rate_hz, robot.imu, DEFAULT_IMU_HZ)
        tunings = self._tunings["accel"], self._tunings["gyro"]
        imu = Imu(imu_errors, imu_hz, make_stream(seed, "imu"), tunings)
        self._imu = imu
        self.imu: SampledSensor[ImuSample] = SampledSensor(imu, imu_hz, physics_step_ns)
        self.mag = _make_magnetometer(
            preset, config, robot, world, self._tunings["mag"], physics_step_ns
        )
        receiver = _make_receiver(preset, robot, world, seed)
        self._tunings |= {"gnss": receiver.tuning, "gnss_velocity": receiver.velocity_tuning}
        gnss_hz = _choose_rate_hz(preset.gnss.rate_hz, robot.gnss, DEFAULT_GNSS_HZ)
        self.gnss: DelayedSensor[GnssFix] = DelayedSensor(
            SampledSensor(receiver, gnss_hz, physics_step_ns), receiver.latency_s
        )
        self.headings = _make_dual_antenna(preset, receiver, seed, physics_step_ns)
        self.base = _make_base_station(preset, config, receiver, world, physics_step_ns)
        self.battery: SampledSensor[BatterySample] = SampledSensor(
            Battery(), BATTERY_RATE_HZ, physics_step_ns
        )

    def find_imu_bias(self) -> tuple[Vec3, Vec3]:
        """Find the biases of accelerometer, m/s^2, and gyro, rad/s, at the last sample."""
        return self._imu.bias

    def tune(self, sensor: str, parameter: str, value: float) -> None:
        """Set an error for the samples from now on; `check_tuning` has checked the names."""
        self._tunings[sensor].set(parameter, value)


def _choose_rate_hz(preset_hz: float | None, mount: SensorMount, default_hz: float) -> float:
    return preset_hz or mount.rate_hz or default_hz


def _make_magnetometer(
    preset: SensorPreset,
    config: RunConfig,
    robot: RobotSpec,
    world: WorldSpec,
    tuning: Tuning,
    physics_step_ns: int,
) -> SampledSensor[MagSample] | None:
    """Build the magnetometer, unless the preset or the robot has none."""
    errors = preset.mag
    if errors == "none" or robot.mag is None:
        return None
    rng, declination_deg = make_stream(config.seed, "mag"), config.sim.declination_deg
    sensor: SensorModel[MagSample]
    if isinstance(errors, HectorMag):
        turned_deg = errors.declination_deg + declination_deg
        errors = msgspec.structs.replace(errors, declination_deg=turned_deg)
        sensor = HectorMagnetometer(errors, world.field_enu_t, rng, tuning)
    else:
        sensor = Magnetometer(errors, turn_field(world.field_enu_t, declination_deg), rng, tuning)
    rate_hz = _choose_rate_hz(errors.rate_hz, robot.mag, DEFAULT_MAG_HZ)
    return SampledSensor(sensor, rate_hz, physics_step_ns)


def _make_receiver(
    preset: SensorPreset, robot: RobotSpec, world: WorldSpec, seed: int
) -> Receiver | HectorReceiver:
    x_m, y_m, z_m = robot.base_from_link(robot.gnss.link)[:3, 3].tolist()
    antenna = Antenna(world.datum, (x_m, y_m, z_m))
    if isinstance(preset.gnss, HectorGnss):
        return HectorReceiver(preset.gnss, antenna, seed)
    return Receiver(preset.gnss, antenna, seed)


def _make_dual_antenna(
    preset: SensorPreset, receiver: Receiver | HectorReceiver, seed: int, physics_step_ns: int
) -> DelayedSensor[GnssHeading] | None:
    errors = None if isinstance(preset.gnss, HectorGnss) else preset.gnss.heading
    if errors is None:
        return None
    sensor = DualAntenna(errors, receiver, make_stream(seed, "gnss heading"))
    return DelayedSensor(SampledSensor(sensor, errors.rate_hz, physics_step_ns), receiver.latency_s)


def _make_base_station(
    preset: SensorPreset,
    config: RunConfig,
    receiver: Receiver | HectorReceiver,
    world: WorldSpec,
    physics_step_ns: int,
) -> DelayedSensor[BaseFix] | None:
    if config.sim.base_station == "off":
        return None
    is_common = config.sim.base_station == "common"
    station = BaseStation(preset.gnss, receiver, world, config.seed, is_common=is_common)
    return DelayedSensor(SampledSensor(station, BASE_RATE_HZ, physics_step_ns), receiver.latency_s)
