"""A lidar measures what stands around it, by geometry, and reaches files and displays."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path

import msgspec
import numpy as np
import pytest
from mcap.reader import make_reader

from agribot.app.robot_of_run import load_robot_of_run
from agribot.cli.main import main
from agribot.core import topics
from agribot.core.config import PerceptionConfig, RunConfig, SimConfig
from agribot.core.errors import DescriptionError
from agribot.core.messages import FloatArray, LaserScan, PlantClass
from agribot.core.robot import LidarSpec, Origin, RobotSpec, Shape
from agribot.core.world import HeightField, Obstacle, Plant, Walker, Waypoint, WorldSpec
from agribot.description.lidar import LINK, fit_lidar
from agribot.description.loader import check_robot, load_robot
from agribot.description.package import ROOT
from agribot.record.ticks import strip_pixels
from agribot.ros.messages.device_rosmsg import make_laser_scan
from agribot.sim.ground_surface import build_ground_surface
from agribot.sim.plant_states import PlantStates
from agribot.sim.platform import SimPlatform
from agribot.sim.ray_scene import RayScene
from agribot.sim.sensors.lidar import Lidar
from agribot.sim.state import HISTORY_COLUMNS
from tests.record import record_samples

HALF_TURN = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
SENSOR = """<gazebo reference="base_link"><sensor name="front" type="{kind}">
  <pose>0.3 0 0.2 0 0 0</pose><update_rate>{rate}</update_rate>
  <{block}><scan><horizontal><samples>181</samples><resolution>1</resolution>
    <min_angle>-1.57</min_angle><max_angle>1.57</max_angle></horizontal>
    <vertical><samples>{layers}</samples></vertical></scan>
    <range><min>0.1</min><max>8</max></range>
    <noise><type>gaussian</type><mean>0</mean><stddev>0.02</stddev></noise></{block}>
  <plugin name="laser" filename="libgazebo_ros_laser.so"/></sensor></gazebo>"""


def thing(kind: str, size_m: tuple[float, float, float], x_m: float, y_m: float, z_m: float = 0.5,
          yaw_rad: float = 0.0) -> Obstacle:  # fmt: skip
    shape = Shape(kind=kind, size_m=size_m, origin=Origin(xyz_m=(0.0, 0.0, z_m)))
    return Obstacle(name=kind, kind=kind, x_map_m=x_m, y_map_m=y_m, z_map_m=0.0, yaw_rad=yaw_rad,
                    shapes=(shape,))  # fmt: skip


def scene(world: WorldSpec, states: PlantStates | None = None) -> RayScene:
    states = PlantStates(len(world.plants)) if states is None else states
    return RayScene(world, build_ground_surface(world), states)


def look(world: WorldSpec, height_m: float = 0.5, directions: FloatArray = HALF_TURN,
         t_s: float = 0.0) -> list[float]:  # fmt: skip
    ranges_m: list[float] = (
        scene(world).cast(np.array([0.0, 0.0, height_m]), directions, 10.0, t_s).tolist()
    )
    return ranges_m


def test_rays_meet_boxes_cylinders_and_balls_where_they_stand(meadow: WorldSpec) -> None:
    world = msgspec.structs.replace(
        meadow,
        obstacles=(
            thing("box", (1.0, 2.0, 1.0), 3.0, 0.0),
            thing("cylinder", (0.3, 1.0, 0.0), 0.0, 4.0),
            thing("sphere", (0.5, 0.0, 0.0), -5.0, 0.0),
        ),
    )
    assert look(world) == pytest.approx([2.5, 3.7, 4.5, math.inf])
    assert look(world, height_m=1.2) == [math.inf] * 4  # over box and cylinder, past the ball
    turned = thing("box", (1.0, 1.0, 1.0), 3.0, 0.0, yaw_rad=math.pi / 4.0)
    corner_m = look(msgspec.structs.replace(meadow, obstacles=(turned,)))[0]
    assert corner_m == pytest.approx(3.0 - math.sqrt(0.5))


def test_rays_agree_with_a_march_in_small_steps(meadow: WorldSpec) -> None:
    """A ball, a crown and a turned box from many sides, by being inside of them and no formula."""
    plant = Plant(species="sugar_beet", plant=PlantClass.CROP, x_map_m=1.5, y_map_m=1.0,
                  yaw_rad=0.0, size_m=0.4, seed=1)  # fmt: skip
    world = msgspec.structs.replace(
        meadow, plants=(plant,), obstacles=(thing("sphere", (0.6, 0.0, 0.0), -1.5, 0.7, 0.3),)
    )
    angles = np.linspace(-math.pi, math.pi, 120)
    rays = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
    found = look(world, 0.2, rays)
    steps = np.arange(0.0, 4.0, 0.001)
    radius_m = 1.42 * 0.4  # of a crown by its height
    for ray, range_m in zip(rays, found, strict=True):
        x, y = steps * ray[0], steps * ray[1]
        in_ball = (x + 1.5) ** 2 + (y - 0.7) ** 2 + 0.1**2 < 0.36
        in_crown = ((x - 1.5) ** 2 + (y - 1.0) ** 2) / radius_m**2 + (0.2 / 0.4) ** 2 < 1.0
        inside = np.flatnonzero(in_ball | in_crown)
        expected = steps[inside[0]] if len(inside) else math.inf
        assert range_m == pytest.approx(expected, abs=0.03)


def test_a_plant_that_lies_is_passed_over(meadow: WorldSpec) -> None:
    plant = Plant(species="maize", plant=PlantClass.CROP, x_map_m=2.0, y_map_m=0.0, yaw_rad=0.0,
                  size_m=0.8, seed=1)  # fmt: skip
    world = msgspec.structs.replace(meadow, plants=(plant,))
    states, start = PlantStates(1), np.array([0.0, 0.0, 0.3])
    rays = scene(world, states)
    assert rays.cast(start, HALF_TURN, 10.0, 0.0)[0] < 2.0
    states.cut(0, 1.0, 0.0)
    assert rays.cast(start, HALF_TURN, 10.0, 2.0)[0] == math.inf


def test_rays_meet_the_ground_of_a_slope_and_below_them(meadow: WorldSpec) -> None:
    down = np.array([[0.6, 0.0, -0.8]])
    assert look(meadow, 0.8, down) == pytest.approx([1.0])
    east_m = np.linspace(-20.0, 20.0, 81)
    rise = HeightField(height_m=np.tile(0.1 * east_m, (81, 1)), x_min_m=-20.0, y_min_m=-20.0,
                       resolution_m=0.5)  # fmt: skip
    hill = msgspec.structs.replace(meadow, terrain=rise)
    assert look(hill, 0.5) == pytest.approx([5.0, math.inf, math.inf, math.inf], abs=0.01)


def test_a_walker_is_met_where_it_is_at_that_time(meadow: WorldSpec) -> None:
    points = tuple(
        Waypoint(t_s=t, x_map_m=x, y_map_m=0.0, yaw_rad=0.0) for t, x in ((0.0, 2.0), (4.0, 6.0))
    )
    shape = Shape(kind="cylinder", size_m=(0.25, 1.8, 0.0), origin=Origin(xyz_m=(0.0, 0.0, 0.9)))
    walker = Walker(name="worker", kind="person_walking", shapes=(shape,), waypoints=points)
    world = msgspec.structs.replace(meadow, walkers=(walker,))
    ahead = [look(world, t_s=t)[0] for t in (0.0, 1.0, 3.0)]
    assert ahead == pytest.approx([1.75, 2.75, 4.75])


def scan(robot: RobotSpec, world: WorldSpec, count: int = 1, seed: int = 0) -> list[LaserScan]:
    settings = RunConfig(perception=PerceptionConfig(enabled=False), seed=seed)
    platform = SimPlatform(settings, robot, world)
    scans: list[LaserScan] = []
    while len(scans) < count:
        scans += platform.read().scans
    return scans


def measure(robot: RobotSpec, world: WorldSpec, count: int = 1) -> list[LaserScan]:
    """Scans of a robot that stands at the origin and looks East, without its physics."""
    lidar = Lidar(robot, scene(world), np.random.default_rng(0))
    row = np.zeros(HISTORY_COLUMNS)
    row[:7] = 0.0, 0.0, robot.base_height_m, 1.0, 0.0, 0.0, 0.0
    return [lidar.sample(0.1 * k, row) for k in range(count)]


@pytest.fixture(scope="module")
def walled(meadow: WorldSpec) -> WorldSpec:
    """A wall whose face stands 3 m ahead of the robot's middle, where it looks East."""
    wall = thing("box", (0.2, 20.0, 2.0), 3.1, 0.0, 1.0)
    return msgspec.structs.replace(meadow, obstacles=(wall,), spawn_yaw_map_rad=0.0)


def test_scans_have_the_angles_noise_and_limits_of_the_lidar(
    rover: RobotSpec, walled: WorldSpec
) -> None:
    spec = LidarSpec(link="camera_link", samples=91, min_angle_rad=-math.pi / 2,
                     max_angle_rad=math.pi / 2, range_max_m=4.0, noise_std_m=0.02)  # fmt: skip
    robot = msgspec.structs.replace(rover, lidar=spec)
    scans = measure(robot, walled, 40)
    ahead = [float(s.ranges_m[45]) for s in scans]
    assert np.mean(ahead) == pytest.approx(3.0, abs=0.015)
    assert np.std(ahead) == pytest.approx(0.02, rel=0.4)
    angles = scans[0].min_angle_rad + scans[0].step_rad * np.arange(91)
    expected = 3.0 / np.cos(angles)
    ranges_m = scans[0].ranges_m
    assert np.all(np.isinf(ranges_m[expected > 4.1])) and np.isinf(ranges_m).any()
    seen = expected < 3.9
    assert ranges_m[seen] == pytest.approx(expected[seen], abs=0.1)
    close = msgspec.structs.replace(spec, range_min_m=3.5)
    (near,) = measure(msgspec.structs.replace(rover, lidar=close), walled)
    assert near.ranges_m[45] == -math.inf


def test_the_same_seed_gives_the_same_scans(rover: RobotSpec, walled: WorldSpec) -> None:
    robot = fit_lidar(rover)
    first, second, other = (scan(robot, walled, 2, seed) for seed in (1, 1, 2))
    assert first[1].t_s - first[0].t_s == pytest.approx(0.1)
    assert all(a.ranges_m.tobytes() == b.ranges_m.tobytes()
               for a, b in zip(first, second, strict=True))  # fmt: skip
    assert any(a.ranges_m.tobytes() != b.ranges_m.tobytes()
               for a, b in zip(first, other, strict=True))  # fmt: skip


def test_a_robot_without_a_lidar_scans_nothing_and_one_with_it_drives_the_same(
    rover: RobotSpec, walled: WorldSpec
) -> None:
    settings = RunConfig(perception=PerceptionConfig(enabled=False))
    blind, seeing = (SimPlatform(settings, r, walled) for r in (rover, fit_lidar(rover)))
    for _ in range(20):
        without, with_it = blind.read(), seeing.read()
        assert without.scans == ()
        assert msgspec.structs.replace(with_it, scans=()) == without


@pytest.mark.parametrize(("kind", "block"), [("ray", "ray"), ("gpu_ray", "ray"),
                                             ("gpu_lidar", "lidar"), ("lidar", "ray")])  # fmt: skip
def test_a_description_says_where_the_lidar_is_and_how_it_scans(
    tmp_path: Path, kind: str, block: str
) -> None:
    tag = SENSOR.format(kind=kind, block=block, rate=20, layers=16)
    robot = load_robot(robot_file(tmp_path, tag))
    assert robot.lidar is not None
    told = msgspec.structs.replace(robot.lidar, link="")
    assert told == LidarSpec(
        link="", rate_hz=20.0, samples=181, min_angle_rad=-1.57, max_angle_rad=1.57,
        range_min_m=0.1, range_max_m=8.0, noise_std_m=0.02,
    )  # fmt: skip
    assert robot.base_from_link(robot.lidar.link)[:3, 3].tolist() == pytest.approx([0.3, 0.0, 0.2])
    assert any("of its layers one is simulated" in warning for warning in robot.warnings)
    assert not any("is not simulated" in warning for warning in robot.warnings)


def test_a_lidar_that_cannot_be_is_refused_with_its_line(tmp_path: Path) -> None:
    file = robot_file(tmp_path, SENSOR.format(kind="ray", block="ray", rate=900, layers=1))
    with pytest.raises(
        DescriptionError, match=r"<update_rate> 900: out of range; give 0\.1 to 100"
    ):
        load_robot(file)
    turned = SENSOR.format(kind="ray", block="ray", rate=9, layers=1)
    turned = turned.replace("<max_angle>1.57", "<max_angle>-3")
    findings = check_robot(robot_file(tmp_path, turned))
    assert any("write the smaller first" in f.text and f.is_fault for f in findings)


def robot_file(folder: Path, tag: str) -> str:
    text = (ROOT / "urdf" / "agribot.urdf").read_text()
    (folder / "rover.urdf").write_text(text.replace("</robot>", f"{tag}</robot>"))
    return str(folder / "rover.urdf")


def test_a_setting_gives_the_packaged_robot_a_lidar_at_its_front() -> None:
    settings = RunConfig(sim=SimConfig(lidar=True))
    robot = load_robot_of_run(settings)
    assert robot.lidar is not None and robot.lidar.link == LINK
    x_m, y_m, z_m = robot.body_from_link(LINK)[:3, 3]
    assert (y_m, z_m) == pytest.approx((0.0, 0.45))
    assert x_m == pytest.approx(robot.wheel_xy_body_m()[:, 0].max() + robot.drive.wheel_radius_m)
    assert load_robot_of_run(RunConfig()).lidar is None


def test_the_lidar_of_a_setting_sees_all_around_but_where_the_robot_is_in_its_way(
    rover: RobotSpec,
) -> None:
    assert (free := fit_lidar(rover).lidar) and math.degrees(free.max_angle_rad) == (
        pytest.approx(179.5)
    )
    mast = fit_lidar(load_robot("agribot")).lidar  # of the camera, behind it and 2 cm wide
    assert mast is not None and math.degrees(mast.max_angle_rad) == pytest.approx(166.5)
    assert mast.min_angle_rad == -mast.max_angle_rad
    assert math.degrees(mast.step_rad) == pytest.approx(0.5)
    tall = Shape(kind="box", size_m=(0.4, 0.6, 1.0), origin=Origin(xyz_m=(0.0, 0.0, 0.3)))
    base, *others = rover.links
    links = (msgspec.structs.replace(base, collisions=(tall,)), *others)
    blind = fit_lidar(msgspec.structs.replace(rover, links=links)).lidar
    front_m = float(rover.wheel_xy_body_m()[:, 0].max()) + rover.drive.wheel_radius_m
    corner_rad = math.atan2(0.3, 0.2 - front_m)
    assert blind is not None and blind.max_angle_rad == pytest.approx(corner_rad, abs=0.01)


def test_a_scan_is_a_ros_message_and_no_part_of_a_recorded_tick(
    rover: RobotSpec, walled: WorldSpec
) -> None:
    (found,) = scan(fit_lidar(rover), walled)
    message = make_laser_scan(found, "laser_link")
    assert (message.header.frame_id, len(message.ranges)) == ("laser_link", 719)
    assert message.angle_max == pytest.approx(found.min_angle_rad + 718 * found.step_rad)
    assert (message.range_min, message.range_max) == pytest.approx((0.15, 12.0))
    record = record_samples.ticks(1)[0]
    record = msgspec.structs.replace(
        record, batch=msgspec.structs.replace(record.batch, scans=(found,))
    )
    assert strip_pixels(record).batch.scans == ()


def test_scans_are_in_the_recording_of_a_world_and_its_frame_in_the_tree(tmp_path: Path) -> None:
    out, seen = tmp_path / "sim", Counter[str]()
    run = ["sim", "farm", "--for", "1", "--speed", "max", "--drive=0.2,0", "--out", str(out)]
    assert main([*run, "--set", "sim.lidar=true"]) == 0
    frames = set()
    with (out / "run.mcap").open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            seen[channel.topic] += 1
            if channel.topic == topics.TF_STATIC.name:
                frames |= {LINK} if LINK.encode() in message.data else set()
            if channel.topic == topics.SCAN.name:
                assert schema is not None and schema.name == topics.SCAN.ros_type
    assert 9 <= seen[topics.SCAN.name] <= 11 and frames == {LINK}
