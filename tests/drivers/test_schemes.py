"""A sensor from elsewhere is one file and one registration."""

from __future__ import annotations

from pathlib import Path

import pytest

from agribot.app.simulated_run import simulate
from agribot.cli.main import main
from agribot.core import config
from agribot.core.errors import ConfigError
from agribot.core.messages import OtherSample
from agribot.core.platform import Sensor
from agribot.description.loader import load_robot
from agribot.drivers.line import schemes
from agribot.record.replay import read_ticks
from agribot.ros.messages.sensor_readers import make_readers

GYRO = '''
from agribot.core.messages import ImuSample

class Still:
    """An IMU that measures nothing but gravity."""

    def __init__(self, sensor, uri, context):
        self.sensor, self.name = sensor, f"{uri.scheme}:{uri.path}"
        self.is_closed = False

    def take(self, t_s):
        return (ImuSample(t_s=t_s, gyro_radps=(0.0,) * 3, accel_mps2=(0.0, 0.0, 9.81)),)

    def close(self):
        self.is_closed = True
'''
SETTINGS = ("perception.enabled=false", "duration_s=1")


@pytest.fixture
def scheme(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The scheme of a driver that is one file of somebody's own."""
    (tmp_path / "my_gyro.py").write_text(GYRO)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(schemes, "_KINDS", dict(schemes._KINDS))
    schemes.register_scheme("still", "my_gyro:Still", example="still:/any")
    return "still"


def test_a_driver_of_ones_own_is_one_file_and_a_registration(
    scheme: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["run", "farm", "--source", f"imu={scheme}:/bench", "--out", str(tmp_path / "run")]
    main([*words, *(word for setting in SETTINGS for word in ("--set", setting))])
    assert main(["bag", "info", str(tmp_path / "run" / "run.mcap"), "--json"]) == 0
    kept = config.load(str(tmp_path / "run" / "config.toml"))
    assert kept.sources.imu == "still:/bench"


def test_its_samples_take_the_place_of_the_platforms_own(scheme: str, tmp_path: Path) -> None:
    with simulate(config.load("farm", SETTINGS), tmp_path / "run") as run:
        network = schemes.RosNetwork(lambda: 0, str, str)
        uri = schemes.read_uri("--source", f"{scheme}:/bench")
        with schemes.SourceContext(run.robot, network, pytest.fail) as context:
            run.take_sensors([schemes.open_source("imu", uri, context)])
            batches = [record.batch for record in run.ticks()]
    assert {sample.gyro_radps for batch in batches for sample in batch.imu} == {(0.0, 0.0, 0.0)}
    assert any(batch.gnss for batch in batches)  # the others stay


class Beacon:
    """A sensor for which a batch has no field."""

    sensor: Sensor = "others"

    def __init__(self, name: str) -> None:
        self.name = name

    def take(self, t_s: float) -> tuple[OtherSample, ...]:
        return (OtherSample(t_s=t_s, sensor=self.name, numbers=(t_s, 1.0)),)

    def close(self) -> None: ...


def test_sensors_without_a_field_of_their_own_add_up_and_are_recorded(tmp_path: Path) -> None:
    with simulate(config.load("farm", SETTINGS), tmp_path / "run") as run:
        run.take_sensors([Beacon("near"), Beacon("far")])
        batches = [record.batch for record in run.ticks()]
        run.finish()
    assert all([each.sensor for each in batch.others] == ["near", "far"] for batch in batches)
    kept = [tick.batch.others for tick in read_ticks(tmp_path / "run" / "run.mcap")]
    assert kept[: len(batches)] == [batch.others for batch in batches]


def test_no_type_of_ros_message_stands_for_them() -> None:
    with pytest.raises(ConfigError, match="no type of ROS message"):
        make_readers("others", load_robot())


def test_a_scheme_that_nobody_registered_is_refused_with_those_that_are(scheme: str) -> None:
    with pytest.raises(ConfigError, match=r"write gnss=ros2:/topic or .* or gnss=still:/any"):
        schemes.read_uri("--source", "banana:/fix", "gnss=")


def test_a_scheme_is_registered_once() -> None:
    with pytest.raises(ConfigError, match="'ros2' is registered already"):
        schemes.register_scheme("ros2", "my_gyro:Still")


def test_sources_of_one_place_share_what_they_open(scheme: str) -> None:
    class Connection:
        is_closed = False

        def close(self) -> None:
            self.is_closed = True

    with open_bare_context() as context:
        first = context.share("one", Connection)
        assert context.share("one", Connection) is first
        assert context.share("another", Connection) is not first
    assert first.is_closed


def open_bare_context() -> schemes.SourceContext:
    return schemes.SourceContext(load_robot(), schemes.RosNetwork(lambda: 0, str, str), print)
