"""The noise of simulated sensors is changed by peers while it runs: ROS 1, ROS 2, one truth."""

from __future__ import annotations

import socket
import struct
import subprocess
import xmlrpc.client
from collections.abc import Iterator
from contextlib import closing
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest

from agribot.core.config import PerceptionConfig, RunConfig, SimConfig
from agribot.core.geo import Datum
from agribot.core.world import WorldSpec
from agribot.description.loader import load_robot
from agribot.ros.ros1 import tcpros
from agribot.ros.ros1.noise_server import GROUPS, Ros1NoiseServer
from agribot.ros.ros1.reconfigure_types import (
    DESCRIPTION,
    SET_PARAMETERS,
    encode,
    load_reconfigure_types,
    make_config,
    read_config,
)
from agribot.ros.ros2 import wire
from agribot.ros.ros2.noise_server import Ros2NoiseServer
from agribot.ros.ros2.services import load_service_types
from agribot.ros.sensor_noise import SensorNoise
from agribot.sim.platform import SimPlatform
from tests import machine
from tests.ros.live import Talk, free_port, zenoh_peer
from tests.ros.ros1_system import Ros1, ask
from tests.waiting import wait_for

WORLD = WorldSpec(name="meadow", datum=Datum(lat_deg=21.161289, lon_deg=72.787022, alt_m=4.5))
MARK = wire.pack_attachment(1, 0, b"g" * 16).hex()


class Sensors:
    """A standing simulated robot without errors of its own, and what peers make of its noise."""

    def __init__(self, *, is_open: bool = True) -> None:
        config = RunConfig(
            seed=1, perception=PerceptionConfig(enabled=False), sim=SimConfig(sensors="ideal")
        )
        self.platform = SimPlatform(config, load_robot(), WORLD)
        self.refused = list[str]()
        self.noise = SensorNoise(self.platform, is_open=is_open, report=self.refused.append)

    def gyro_std(self, ticks: int = 50) -> float:
        gyro = [s.gyro_radps for _ in range(ticks) for s in self.platform.read().imu]
        return float(np.std(gyro))


@pytest.fixture
def sensors() -> Sensors:
    return Sensors()


def test_the_noise_is_there_from_the_next_sample_on_and_gone_again(sensors: Sensors) -> None:
    assert sensors.gyro_std() < 1e-4
    assert sensors.noise.change("gyro", "gaussian_noise", 0.05, "test") == ""
    first = sensors.platform.read().imu[0].gyro_radps
    assert max(map(abs, first)) > 1e-3
    assert sensors.gyro_std() == pytest.approx(0.05, rel=0.1)
    assert sensors.noise.change("gyro", "gaussian_noise", 0.0, "test") == ""
    assert sensors.gyro_std() < 1e-4


@pytest.mark.parametrize(
    ("sensor", "parameter", "value", "limit"),
    [
        ("gyro", "gaussian_noise", 11.0, "give 0 to 10 rad/s"),
        ("gnss", "offset", -101.0, "give -100 to 100 m"),
        ("accel", "scale_error", 11.0, "give -10 to 10 times"),
        ("mag", "drift_frequency", 1000.0, "give 0 to 100 Hz"),
        ("gyro", "drift", float("nan"), "finite"),
    ],
)
def test_a_value_out_of_range_is_refused_with_the_limit(
    sensors: Sensors, sensor: str, parameter: str, value: float, limit: str
) -> None:
    before = sensors.noise.read(sensor)
    assert limit in sensors.noise.change(sensor, parameter, value, "test")
    assert limit in sensors.refused[0]
    assert sensors.noise.read(sensor) == before


def test_of_several_values_all_are_taken_or_none(sensors: Sensors) -> None:
    assert sensors.noise.change_all("gyro", {"offset": 0.1, "gaussian_noise": -1.0}, "test")
    assert sensors.noise.read("gyro")["offset"] == 0.0
    assert not sensors.noise.change_all("gyro", {"offset": 0.1, "gaussian_noise": 0.2}, "test")
    assert sensors.noise.read("gyro")["offset"] == 0.1


def test_who_only_watches_changes_nothing() -> None:
    watched = Sensors(is_open=False)
    assert "--allow-drive" in watched.noise.change("gyro", "offset", 0.1, "test")
    assert watched.noise.read("gyro")["offset"] == 0.0


class Ros2Peer:
    def __init__(self, talk: Talk) -> None:
        self._talk = talk

    def __call__(self, name: str, *fields: Any) -> Any:
        types = load_service_types()
        service = f"rcl_interfaces/srv/{name}"
        snake = "".join(f"_{c.lower()}" if c.isupper() else c for c in name).strip("_")
        request = types.types[f"{service}_Request"](*fields)
        data = bytes(types.serialize_cdr(request, f"{service}_Request"))
        key = wire.make_topic_key(
            0, f"/agribot_sensors/{snake}", service, types.hash_rihs01(service)
        )
        ((payload, _),) = wait_for(
            lambda: self._talk("call", key, data.hex(), MARK), f"an answer of {name}"
        )
        return types.deserialize_cdr(bytes.fromhex(payload), f"{service}_Response")

    def set(self, name: str, value: float) -> Any:
        make = load_service_types().types
        nothing = np.zeros(0)
        packed = make["rcl_interfaces/msg/ParameterValue"](
            3, False, 0, value, "", nothing.astype(np.uint8), nothing.astype(bool),
            nothing.astype(np.int64), nothing, [],
        )  # fmt: skip
        parameter = make["rcl_interfaces/msg/Parameter"](name, packed)
        return self("SetParameters", [parameter]).results[0]


def test_parameters_of_ros2_change_the_noise_and_say_their_limits(sensors: Sensors) -> None:
    router = f"tcp/127.0.0.1:{free_port()}"
    server = Ros2NoiseServer(sensors.noise, sensors.refused.append, router=router)
    with closing(server), zenoh_peer(router) as talk:
        peer = Ros2Peer(talk)
        name = "gyro.gaussian_noise"
        (described,) = peer("DescribeParameters", [name]).descriptors
        (limits,) = described.floating_point_range
        assert (limits.from_value, limits.to_value) == (0.0, 10.0)
        assert "rad/s" in described.description
        assert sensors.gyro_std() < 1e-4
        assert peer.set(name, 0.05).successful
        assert sensors.gyro_std() == pytest.approx(0.05, rel=0.1)
        refused = peer.set(name, 50.0)
        assert not refused.successful
        assert "give 0 to 10 rad/s" in refused.reason
        sensors.platform.tune("gyro", "gaussian_noise", 0.5)  # as the page and Python do
        assert peer("GetParameters", [name]).values[0].double_value == 0.5


def test_the_service_is_that_of_dynamic_reconfigure() -> None:
    """The sum that its own tools compare (printed by them for dynamic_reconfigure/Reconfigure)."""
    assert SET_PARAMETERS.md5 == "bb125d226a21982a4a98760418dc2672"


@pytest.fixture(scope="module")
def ros1(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ros1]:
    with closing(Ros1(tmp_path_factory.mktemp("noise"))) as ros:
        yield ros


@machine.needs("roscore")
def test_rosparam_of_a_real_ros1_changes_the_noise(ros1: Ros1, sensors: Sensors) -> None:
    name = f"{GROUPS['gyro']}/gaussian_noise"
    with closing(Ros1NoiseServer(sensors.noise, ros1.uri)):
        assert _run(ros1, "rosparam", "get", name) == "0.0"
        _run(ros1, "rosparam", "set", name, "0.05")
        wait_for(lambda: sensors.noise.read("gyro")["gaussian_noise"] == 0.05, "the new value")
        assert sensors.gyro_std() == pytest.approx(0.05, rel=0.1)
        _run(ros1, "rosparam", "set", name, "77")
        wait_for(lambda: ask(ros1.uri, "getParam", name)[2] == 0.05, "the value to be put back")
        assert "give 0 to 10 rad/s" in sensors.refused[-1]
        _run(ros1, "rosparam", "set", name, "loud")
        wait_for(lambda: ask(ros1.uri, "getParam", name)[2] == 0.05, "the value to be put back")
        assert sensors.noise.read("gyro")["gaussian_noise"] == 0.05


@machine.needs("roscore")
def test_the_service_of_dynamic_reconfigure_changes_the_noise(ros1: Ros1, sensors: Sensors) -> None:
    group = GROUPS["gnss"]
    with closing(Ros1NoiseServer(sensors.noise, ros1.uri)):
        assert _run(ros1, "rosservice", "type", f"{group}/set_parameters") == (
            "dynamic_reconfigure/Reconfigure"
        )
        done, answer = _call(ros1, f"{group}/set_parameters", {"gaussian_noise": 0.5})
        assert done
        assert read_config(answer) | {"gaussian_noise": 0.5} == read_config(answer)
        assert sensors.noise.read("gnss")["gaussian_noise"] == 0.5
        assert ask(ros1.uri, "getParam", f"{group}/gaussian_noise")[2] == 0.5
        done, why = _call(ros1, f"{group}/set_parameters", {"offset": 1.0, "drift": 500.0})
        assert not done
        assert b"give 0 to 100 m" in why
        assert sensors.noise.read("gnss")["offset"] == 0.0
        kinds = dict(ask(ros1.uri, "getTopicTypes")[2])
        assert kinds[f"{group}/parameter_updates"] == "dynamic_reconfigure/Config"
        assert kinds[f"{group}/parameter_descriptions"] == "dynamic_reconfigure/ConfigDescription"
        told: Any = load_reconfigure_types().deserialize_ros1(
            _latched(ros1, f"{group}/parameter_descriptions", DESCRIPTION), DESCRIPTION
        )
        assert {p.name: p.value for p in told.max.doubles}["offset"] == 100.0


def _run(ros1: Ros1, *command: str) -> str:
    done = subprocess.run(
        command, env=ros1.environment, capture_output=True, text=True, timeout=60, check=True
    )
    return done.stdout.strip()


def _talk(host: str, port: int, header: dict[str, str]) -> socket.socket:
    sock = socket.create_connection((host, port), timeout=60)
    sock.sendall(tcpros.pack_header({"callerid": "/test", **header}))
    answer = tcpros.read_header(tcpros.receive_frame(sock, 100_000))
    assert "error" not in answer, answer
    return sock


def _call(ros1: Ros1, service: str, values: dict[str, float]) -> tuple[bool, bytes]:
    """Call as a client of ROS does, after asking the master for the place."""
    parts = urlsplit(ask(ros1.uri, "lookupService", service)[2])
    header = {"service": service, "md5sum": SET_PARAMETERS.md5}
    request = encode(make_config(values))
    with _talk(str(parts.hostname), int(parts.port or 0), header) as sock:
        sock.sendall(struct.pack("<I", len(request)) + request)
        done = sock.recv(1)
        return done == b"\1", tcpros.receive_frame(sock, 100_000)


def _latched(ros1: Ros1, topic: str, ros_type: str) -> bytes:
    (node,) = ros1.publishers()[topic]
    uri = ask(ros1.uri, "lookupNode", node)[2]
    with xmlrpc.client.ServerProxy(uri) as proxy:
        slave: Any = proxy
        _, _, place = slave.requestTopic("/test", topic, [["TCPROS"]])
    _, md5 = load_reconfigure_types().generate_msgdef(ros_type, ros_version=1)
    header = {"topic": topic, "type": ros_type.replace("/msg/", "/"), "md5sum": md5}
    with _talk(str(place[1]), int(place[2]), header) as sock:
        return tcpros.receive_frame(sock, 100_000)
