"""The simulated robot behind the Platform interface."""

from __future__ import annotations

import math
import subprocess
import sys
import threading

import msgspec
import numpy as np
import pytest

from agribot.core.config import PerceptionConfig, RunConfig, SimConfig
from agribot.core.errors import ConfigError, PlatformError
from agribot.core.geo import MapFrame
from agribot.core.messages import (
    ControlMission,
    DriveCommand,
    ImplementCommand,
    PlantClass,
    RobotCommand,
    SensorBatch,
)
from agribot.core.platform import Platform
from agribot.core.robot import RobotSpec
from agribot.core.world import HeightField, Plant, WorldSpec
from agribot.sim.platform import SimPlatform


def _config(sensors: str = "ideal", seed: int = 0, step_s: float = 0.002) -> RunConfig:
    return RunConfig(
        seed=seed,
        perception=PerceptionConfig(enabled=False),
        sim=SimConfig(sensors=sensors, step_s=step_s),
    )


def _command(v: float = 0.0, yaw_rate: float = 0.0, nozzles: int = 0) -> RobotCommand:
    return RobotCommand(
        t_s=0.0,
        drive=DriveCommand(v_mps=v, yaw_rate_radps=yaw_rate),
        implement=ImplementCommand(sections_on=(True,) * nozzles),
    )


def _run(platform: Platform, command: RobotCommand, ticks: int) -> list[SensorBatch]:
    batches = []
    for _ in range(ticks):
        batches.append(platform.read())
        platform.write(command)
    return batches


def test_each_read_advances_by_one_tick(rover: RobotSpec, meadow: WorldSpec) -> None:
    batches = _run(SimPlatform(_config(), rover, meadow), _command(), 100)
    assert [b.t_s for b in batches] == pytest.approx([0.02 * k for k in range(1, 101)])


@pytest.mark.parametrize("step_s", [0.001, 0.003, 0.005])
def test_sensors_keep_their_rates_on_any_step(
    rover: RobotSpec, meadow: WorldSpec, step_s: float
) -> None:
    batches = _run(SimPlatform(_config(step_s=step_s), rover, meadow), _command(), 250)
    for name, expected in (("wheels", 500), ("imu", 1000), ("mag", 25), ("gnss", 50)):
        times = [sample.t_s for b in batches for sample in getattr(b, name)]
        ticks = [b.t_s for b in batches for _ in getattr(b, name)]
        assert abs(len(times) - expected) <= 1
        assert np.diff(times).min() > 0.0
        assert all(t <= tick + 1e-9 for t, tick in zip(times, ticks, strict=True))


def test_a_fix_arrives_after_its_latency(rover: RobotSpec, meadow: WorldSpec) -> None:
    batches = _run(SimPlatform(_config("m8n"), rover, meadow), _command(), 100)
    delays = [b.t_s - fix.t_s for b in batches for fix in b.gnss]
    assert len(delays) == 9
    assert min(delays) >= 0.15 - 1e-9
    assert max(delays) < 0.15 + 0.02


def test_same_seed_gives_the_same_bytes(rover: RobotSpec, meadow: WorldSpec) -> None:
    def run(seed: int) -> bytes:
        platform = SimPlatform(_config("rtk", seed), rover, meadow)
        return msgspec.msgpack.encode(_run(platform, _command(0.4, 0.2), 150))

    assert run(3) == run(3)
    assert run(3) != run(4)


def test_another_receiver_leaves_the_imu_as_it_was(rover: RobotSpec, meadow: WorldSpec) -> None:
    def imu(sensors: str) -> list[object]:
        batches = _run(SimPlatform(_config(sensors), rover, meadow), _command(0.3), 50)
        return [sample for b in batches for sample in b.imu]

    assert imu("rtk") == imu("m8n")


def test_truth_of_an_arc_matches_its_own_integral(rover: RobotSpec, meadow: WorldSpec) -> None:
    platform = SimPlatform(_config(), rover, meadow)
    x_m = y_m = 0.0
    for _ in range(300):
        platform.read()
        platform.write(_command(0.5, 0.4))
        truth = platform.truth()
        x_m += truth.v_mps * math.cos(truth.yaw_map_rad) * 0.02
        y_m += truth.v_mps * math.sin(truth.yaw_map_rad) * 0.02
    assert (truth.x_map_m, truth.y_map_m) == pytest.approx((x_m, y_m), abs=0.03)
    assert truth.yaw_rate_radps == pytest.approx(0.4, rel=0.035)


def test_ideal_sensors_agree_with_the_truth(rover: RobotSpec, meadow: WorldSpec) -> None:
    platform = SimPlatform(_config(), rover, meadow)
    batches = _run(platform, _command(0.5, 0.3), 200)
    truth, batch = platform.truth(), batches[-1]
    gyro = np.mean([sample.gyro_radps for sample in batch.imu], axis=0)
    assert gyro[2] == pytest.approx(truth.yaw_rate_radps, abs=1e-3)
    fix = batch.gnss[-1]
    east_m, north_m, _ = MapFrame(meadow.datum).map_from_geodetic(
        fix.lat_deg, fix.lon_deg, fix.alt_m
    )
    # The antenna is 6 cm to the right of the centre.
    side = truth.yaw_map_rad - math.pi / 2
    assert east_m == pytest.approx(truth.x_map_m + 0.06 * math.cos(side), abs=1e-4)
    assert north_m == pytest.approx(truth.y_map_m + 0.06 * math.sin(side), abs=1e-4)
    # The compass spoke on the very last step; its x component grows towards North.
    field_x, field_y, _ = batch.mag[-1].field_t
    heading_rad = math.atan2(field_y, field_x)
    error_rad = math.remainder(math.pi / 2 - heading_rad - truth.yaw_map_rad, math.tau)
    assert error_rad == pytest.approx(0.0, abs=1e-5)


def test_true_speed_is_that_of_the_body_frame_even_while_pitching(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    platform = SimPlatform(_config(), rover, meadow)
    truths = []
    for _ in range(60):
        platform.read()
        platform.write(_command(0.8))
        truths.append(platform.truth())
    speed = np.array([t.v_mps for t in truths])
    moved = np.diff([t.x_map_m for t in truths]) / 0.02
    assert max(abs(t.pitch_rad) for t in truths) > 5e-4
    assert np.abs((speed[1:] + speed[:-1]) / 2 - moved).max() < 3e-3


def test_straight_run_of_ten_metres_stays_straight(rover: RobotSpec, meadow: WorldSpec) -> None:
    platform = SimPlatform(_config(), rover, meadow)
    while platform.truth().x_map_m < 10.0:
        platform.read()
        platform.write(_command(0.8))
    truth = platform.truth()
    assert abs(truth.y_map_m) < 1e-3
    assert truth.t_s == pytest.approx(10.0 / 0.789, rel=0.05)


def test_full_turn_on_the_spot_stays_on_the_spot(rover: RobotSpec, meadow: WorldSpec) -> None:
    platform = SimPlatform(_config(), rover, meadow)
    turned_rad = 0.0
    while turned_rad < math.tau:
        platform.read()
        platform.write(_command(0.0, 0.8))
        turned_rad += platform.truth().yaw_rate_radps * 0.02
    truth = platform.truth()
    assert math.hypot(truth.x_map_m, truth.y_map_m) < 1e-3


def test_body_frame_of_a_tilted_robot_is_on_the_ground(rover: RobotSpec, meadow: WorldSpec) -> None:
    grid = np.linspace(-5.0, 5.0, 21)
    height_m = np.tile(math.tan(math.radians(15.0)) * grid, (21, 1))
    terrain = HeightField(height_m=height_m, x_min_m=-5.0, y_min_m=-5.0, resolution_m=0.5)
    world = msgspec.structs.replace(
        meadow, terrain=terrain, spawn_xy_map_m=(1.0, 2.0), spawn_yaw_map_rad=0.3
    )
    platform = SimPlatform(_config(), rover, world)
    truth = platform.truth()
    assert (truth.x_map_m, truth.y_map_m) == pytest.approx((1.0, 2.0), abs=1e-9)
    tilt = math.acos(math.cos(truth.roll_rad) * math.cos(truth.pitch_rad))
    assert math.degrees(tilt) == pytest.approx(15.0, abs=0.2)
    assert truth.pitch_rad < 0.0  # nose up the slope


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_command_that_is_not_finite_is_refused(
    rover: RobotSpec, meadow: WorldSpec, bad: float
) -> None:
    platform = SimPlatform(_config(), rover, meadow)
    with pytest.raises(PlatformError, match="not finite"):
        platform.write(_command(bad))
    with pytest.raises(PlatformError, match="not finite"):
        platform.write(_command(0.0, bad))


def test_events_from_other_threads_arrive_once(rover: RobotSpec, meadow: WorldSpec) -> None:
    platform = SimPlatform(_config(), rover, meadow)
    platform.read()

    def post() -> None:
        for _ in range(50):
            platform.inbox.post(ControlMission(action="pause"))

    threads = [threading.Thread(target=post) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    batch = platform.read()
    assert len(batch.requests) == 200
    assert {event.t_s for event in batch.requests} == {batch.t_s}
    assert platform.read().requests == ()


def test_driving_over_a_crop_and_spraying_a_weed_is_noticed(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    def plant(x_m: float, y_m: float, kind: PlantClass) -> Plant:
        return Plant(
            species="sugar_beet",
            plant=kind,
            x_map_m=x_m,
            y_map_m=y_m,
            yaw_rad=0.0,
            size_m=0.2,
            seed=0,
        )

    plants = (
        plant(1.0, 0.39, PlantClass.CROP),
        plant(1.0, 0.0, PlantClass.CROP),
        plant(1.0, -0.1, PlantClass.WEED),
        plant(1.0, 2.0, PlantClass.WEED),
    )
    platform = SimPlatform(_config(), rover, msgspec.structs.replace(meadow, plants=plants))
    _run(platform, _command(0.8, nozzles=8), 150)
    assert platform.crushed == {0}
    # Eight nozzles cover +-0.4 m, crops and weeds alike.
    assert set(platform.treated) == {0, 1, 2}
    travelled_m = platform.truth().x_map_m
    assert platform.worked_m2 == pytest.approx(0.8 * travelled_m, rel=0.05)


def test_valves_close_when_commands_stop(rover: RobotSpec, meadow: WorldSpec) -> None:
    platform = SimPlatform(_config(), rover, meadow)
    _run(platform, _command(0.8, nozzles=8), 100)
    for _ in range(32):
        platform.read()
    area_m2 = platform.worked_m2
    for _ in range(50):
        platform.read()
    assert platform.worked_m2 == area_m2


def test_closed_platform_says_so(rover: RobotSpec, meadow: WorldSpec) -> None:
    platform = SimPlatform(_config(), rover, meadow)
    platform.close()
    platform.close()
    with pytest.raises(PlatformError, match="closed"):
        platform.read()
    with pytest.raises(PlatformError, match="closed"):
        platform.write(_command())


def test_perception_without_a_camera_is_a_contradiction(
    rover: RobotSpec, meadow: WorldSpec
) -> None:
    blind = msgspec.structs.replace(rover, camera=None)
    with pytest.raises(ConfigError, match=r"perception\.enabled"):
        SimPlatform(RunConfig(), blind, meadow)


def test_unknown_sensor_preset_is_refused(rover: RobotSpec, meadow: WorldSpec) -> None:
    with pytest.raises(ConfigError, match="did you mean 'm8n'"):
        SimPlatform(_config("m8"), rover, meadow)


def test_a_simulator_without_a_camera_loads_no_renderer() -> None:
    """It takes half a CPU second to load."""
    code = (
        "import sys, agribot.app.simulated_run, agribot.sim.referee, agribot.sim.platform;"
        "dear = 'agribot.sim.camera.', 'scipy.ndimage';"
        "print([name for name in sys.modules if name.startswith(dear)])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
