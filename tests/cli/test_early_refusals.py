"""What a run cannot have is refused before the simulator starts, which takes half a minute."""

from __future__ import annotations

from pathlib import Path

import pytest

from agribot.cli.main import main
from agribot.core.errors import ConfigError
from agribot.ros.ros1.master import check_master


@pytest.fixture(autouse=True)
def no_simulator(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def start(*_: object, **__: object) -> None:
        raise AssertionError("the simulator was started")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("agribot.app.open_run.SimulatedRun", start)
    monkeypatch.setattr("agribot.sim.platform.SimPlatform", start)


@pytest.mark.parametrize(
    ("line", "absent", "words"),
    [
        ("run farm --dds", "cyclonedds", "[dds]'"),
        ("run farm --ros2", "zenoh", "[ros]'"),
        ("run farm --foxglove", "foxglove", "[foxglove]'"),
        ("run farm --source gnss=ros2:/fix", "zenoh", "gnss=ros2:/fix needs eclipse-zenoh"),
        ("sim --world empty --dds", "cyclonedds", "[dds]'"),
        ("sim --world empty --ros2", "xxhash", "[ros]'"),
    ],
)
def test_an_absent_package_of_a_network_is_named_first(
    line: str, absent: str, words: str, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.setattr("agribot.core.extras._is_installed", lambda module: module != absent)
    assert main(line.split()) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("ros1 farm --ros-master BAD", "ROS master BAD: not an address; write http://HOST:PORT"),
        ("run farm --source imu=ros1:/imu --ros-master BAD", "ROS master BAD"),
        ("run farm --source imu=ros1://robot:99999/imu", "ROS master http://robot:99999"),
        ("run farm --source imu=ros1://[::1/imu", "write imu=ros2:/topic"),
        (
            "run farm --source gnss=gpsd: --source gnss=tcp://rover:2947",
            "gnss=gpsd: and --source gnss=tcp://rover:2947: a sensor comes from one place",
        ),
        ("run farm --source imu=dds:/imu", "write imu=ros2:/topic"),
        ("ros2 farm --ros-domain 500", "give 0 to 232"),
        ("run farm --source imu=ros2:/imu --ros-domain 500", "give 0 to 232"),
        ("foxglove farm --image-rate 500", "--image-rate 500"),
        ("sim --world empty --ros1 --ros-master BAD", "ROS master BAD"),
        ("run farm --ui --tls-cert a.crt", "--tls-cert and --tls-key belong together"),
        ("run farm --ui --tls-cert a.crt --tls-key a.key", "are no certificate and its key"),
        ("run farm --ui --token-file .", "--token-file .: Is a directory"),
        ("sim --world empty --ros2 --ros-domain -1", "give 0 to 232"),
    ],
)
def test_an_address_that_is_none_is_refused_first(
    line: str, words: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("agribot.core.extras._is_installed", lambda _: True)
    assert main(line.split()) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    "uri",
    [
        "http://127.0.0.1:11311",
        "http://[::1]:11311",
        "http://[fe80::1]:11311/",
        "http://barn.local:11311/",
        "https://barn.local",
    ],
)
def test_addresses_of_masters_are_taken_as_they_are(uri: str) -> None:
    assert check_master(uri) == uri


@pytest.mark.parametrize(
    "uri",
    [
        "junk", "barn:11311", "http://", "http://:11311", "http://barn:", "http://barn:0",
        "http://barn:99999", "http://barn:x", "http://[::1:11311", "http://::1:11311",
        "ftp://barn:11311", "http://barn:11311/RPC2", "http://barn:11311?x", "http://a@barn:11311",
        "http://ba rn:11311", "http://barn:11311\n",
    ],
)  # fmt: skip
def test_what_is_no_address_of_a_master_is_refused(uri: str) -> None:
    with pytest.raises(ConfigError, match="not an address; write http://HOST:PORT"):
        check_master(uri)
