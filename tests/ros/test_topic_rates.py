"""The rates of docs/topics.md, counted over simulated time: of a world alone and of a run."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from agribot.app.simulated_run import simulate
from agribot.core import config, topics
from agribot.core.messages import DriveCommand, RobotCommand, TickRecord
from agribot.core.topics import Topic
from agribot.description.loader import load_robot
from agribot.ros.messages.camera_log import CameraLog
from agribot.ros.messages.topic_writer import TopicWriter
from agribot.ros.messages.world_topic_writer import WorldTick, WorldTopicWriter
from agribot.ros.tick_publisher import RunSources, TickPublisher
from agribot.sim.platform import SimPlatform
from tests.record import record_samples as samples

FOR_S = 4.0
SETTINGS = ("world='empty'", "sim.sensors='rtk'", "sim.base_station='common'",
            "perception.enabled=false", "record.enabled=false", "seed=2")  # fmt: skip
# What needs a camera, a lidar, a tool, a collision or a real receiver, or comes when it changes.
ELSEWHERE = {
    topics.EXTENDED_FIX.name, topics.IMAGE.name, topics.IMAGE_RAW.name, topics.CAMERA_INFO.name,
    topics.OVERLAY.name, topics.TICK.name, topics.SCAN.name,
}  # fmt: skip
OF_A_RUN_AT_10_HZ = {topics.GROUND_TRUTH.name, topics.IMU_BIAS.name}


class Count:
    """A sink and a gateway that count the messages of each topic, and keep times of TF apart."""

    def __init__(self) -> None:
        self.seen: Counter[str] = Counter()

    def __call__(self, topic: Topic, _log_ns: int, _data: bytes, _publish_ns: int) -> None:
        self.seen[topic.name] += 1

    def publish(self, topic: Topic, _data: bytes, _t_ns: int) -> None:
        self.seen[topic.name] += 1

    def step(self, _record: TickRecord) -> None:
        pass

    def close(self) -> None:
        pass

    def rates_hz(self, for_s: float) -> dict[str, float]:
        return {name: count / for_s for name, count in self.seen.items()}


def check(rates_hz: dict[str, float], wanted: dict[str, float], for_s: float) -> None:
    """One message more or less at either end, since counting begins and ends anywhere."""
    for name, rate_hz in wanted.items():
        assert rates_hz.get(name, 0.0) == pytest.approx(rate_hz, abs=1.5 / for_s), name


def nominal_hz() -> dict[str, float]:
    return {
        topic.name: topic.rate_hz
        for topic in topics.TOPICS
        if topic.rate_hz is not None and topic.name not in ELSEWHERE
    }


def test_a_world_alone_publishes_its_topics_at_the_rates_of_the_table() -> None:
    settings = config.load("farm", SETTINGS)
    robot = load_robot(settings.robot)
    count = Count()
    with_a_world = SimPlatform(settings, robot, _world(settings))
    writer = WorldTopicWriter(count, robot, samples.URDF, CameraLog(robot, 0.0, 80))
    latched: Counter[str] = Counter()
    while (batch := with_a_world.read()).t_s < 1.0 + FOR_S:
        if batch.t_s == 1.0:  # the first fixes have arrived, which are late
            latched += count.seen
            count.seen.clear()
        drive = DriveCommand(v_mps=0.3, yaw_rate_radps=0.1)
        with_a_world.write(RobotCommand(t_s=batch.t_s, drive=drive))
        truth = with_a_world.truth()
        pose = (truth.x_map_m, truth.y_map_m, truth.yaw_map_rad)
        writer(WorldTick(batch, drive, pose, (0.0, 0.0), with_a_world.imu_bias))
    of_a_world = [
        topics.FIX, topics.FIX_VELOCITY, topics.IMU, topics.IMU_BIAS, topics.MAGNETIC,
        topics.POLE_FIX, topics.POLE_FIX_VELOCITY, topics.BATTERY, topics.JOINT_STATES,
        topics.ODOM, topics.CMD_VEL, topics.GROUND_TRUTH, topics.HEADING_RAW,
    ]  # fmt: skip
    wanted = {topic.name: topic.rate_hz or 0.0 for topic in of_a_world}
    wanted[topics.TF.name] = 50.0 + 10.0  # odom -> base_footprint, and the wheels
    check(count.rates_hz(FOR_S), wanted, FOR_S)
    latched += count.seen
    for topic in (topics.CALIBRATED, topics.TF_STATIC, topics.ROBOT_DESCRIPTION):
        assert latched[topic.name] == 1


def _world(settings: config.RunConfig):  # type: ignore[no-untyped-def]
    from agribot.app.run_world import make_run_world

    return make_run_world(settings).world


def test_a_run_publishes_every_topic_at_the_rate_of_the_table(tmp_path: Path) -> None:
    settings = config.load("farm", [*SETTINGS, f"duration_s={2 * FOR_S}"])
    count, began_s, ended_s = Count(), 0.0, 0.0
    with simulate(settings, tmp_path) as session:
        sources = RunSources(
            lambda: session.stack.mission.path, truth=session.truth, imu_bias=session.imu_bias,
            weed_map=session.weed_map.plants,
        )  # fmt: skip
        robot = session.robot
        publisher = TickPublisher(
            [count], robot, settings.field.datum, samples.URDF, CameraLog(robot, 0.0, 80), sources
        )
        for record in session.ticks():
            publisher._step(_item(publisher, record))
            if not began_s and record.status.goal_map_m is not None:
                began_s = record.batch.t_s  # it is bound for somewhere from here on
                count.seen.clear()
            ended_s = record.batch.t_s
    for_s = ended_s - began_s
    assert for_s > FOR_S / 2.0
    wanted = nominal_hz() | dict.fromkeys(OF_A_RUN_AT_10_HZ, 10.0)
    wanted[topics.TF.name] = 50.0 + 10.0
    del wanted[topics.WEEDS.name]  # looked at once a second, and published when it changes
    rates_hz = count.rates_hz(for_s)
    rates_hz[topics.STATUS.name] = round(rates_hz[topics.STATUS.name])  # and at each change
    check(rates_hz, wanted, for_s)


def _item(publisher: TickPublisher, record: TickRecord):  # type: ignore[no-untyped-def]
    """What the publisher would put into its queue, without its thread, which may drop it."""
    kept: list[object] = []
    publisher._queue.put = kept.append  # type: ignore[method-assign, assignment]
    publisher(record)
    return kept[0]


@pytest.mark.parametrize(("asked_hz", "wanted_hz"), [(1.0, 1.0), (5.0, 5.0)])
def test_images_go_out_at_the_rate_that_was_asked_for(asked_hz: float, wanted_hz: float) -> None:
    robot, count = samples.robot(), Count()
    camera = CameraLog(robot, asked_hz, 80, keeps_raw=True)
    writer = TopicWriter(count, robot, config.load("farm").field.datum, samples.URDF, camera)
    noise = np.random.default_rng(1)
    for index in range(round(FOR_S * 50)):
        writer(samples.tick(index, noise, with_camera=True))
    rates = count.rates_hz(FOR_S)
    names = (topics.IMAGE.name, topics.IMAGE_RAW.name, topics.CAMERA_INFO.name)
    check(rates, dict.fromkeys(names, wanted_hz), FOR_S)
    extended = topics.EXTENDED_FIX  # of a receiver that says more than where it is
    assert rates[extended.name] == pytest.approx(extended.rate_hz or 0.0, abs=0.5)
