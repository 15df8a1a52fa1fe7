"""A recording in other people's viewers: what they are given, read back by others' readers."""

from __future__ import annotations

import json
import re
import struct
import subprocess
import sysconfig
from pathlib import Path
from shutil import which
from typing import Any
from xml.etree import ElementTree

import pytest
from rosbags.typesys import Stores, get_typestore

from agribot.cli.main import main
from agribot.cli.run.view import find_view
from agribot.core import topics
from agribot.ros.messages.rosmsg import load_types
from agribot.ros.ros2 import wire
from tests.record.bag.bag_samples import write_run
from tests.ros.live import free_port, zenoh_peer
from tests.waiting import wait_for

JAZZY = get_typestore(Stores.ROS2_JAZZY)
RERUN = Path(sysconfig.get_path("scripts")) / "rerun"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    write_run(folder / "run.mcap")
    return folder


def test_rerun_gets_tracks_plan_pictures_curves_and_a_place_on_earth(
    run: Path, tmp_path: Path
) -> None:
    target = tmp_path / "run.rrd"
    assert main(["view", "rerun", str(run), "-o", str(target)]) == 0
    subprocess.run([RERUN, "rrd", "verify", target], check=True, timeout=120, capture_output=True)
    printed = subprocess.run(
        [RERUN, "rrd", "print", target], check=True, timeout=120, capture_output=True, text=True
    ).stdout
    assert "ContainerBlueprint:" in printed  # which says what is shown where
    found = set(re.findall(r"/[a-z_]+(?:/[a-z_]+)*", printed))
    assert {
        "/map/estimate", "/map/plan", "/map/robot", "/camera/image", "/earth/fix",
        "/curves/speed_mps", "/curves/commanded_mps", "/curves/heading/raw", "/mission",
    } <= found  # fmt: skip


@pytest.mark.parametrize("is_in_path", [True, False])
def test_reruns_viewer_is_started_where_it_was_installed_with_the_program(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_in_path: bool
) -> None:
    started: list[str | None] = []
    monkeypatch.setattr("rerun.RecordingStream.spawn", lambda _: started.append(which("rerun")))
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setenv("PATH", str(RERUN.parent if is_in_path else tmp_path))
    assert main(["view", "rerun", str(run)]) == 0
    assert started == [str(RERUN)]


def test_where_reruns_viewer_cannot_open_a_file_is_named_as_the_way_out(
    run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for screen in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(screen, raising=False)
    assert main(["view", "rerun", str(run)]) == 2
    assert "needs a screen" in (told := capsys.readouterr().err) and "-o FILE.rrd" in told
    monkeypatch.setattr("shutil.which", lambda *_, **__: None)
    assert main(["view", "rerun", str(run)]) == 2
    assert "not installed" in (told := capsys.readouterr().err) and "-o FILE.rrd" in told


def test_a_qgis_project_names_layers_that_lie_where_the_robot_was(
    run: Path, tmp_path: Path
) -> None:
    assert main(["view", "qgis", str(run), "-o", str(tmp_path), "--no-open"]) == 0
    root = ElementTree.parse(tmp_path / "agribot.qgs").getroot()
    layers = root.findall("projectlayers/maplayer")
    ids = [layer.findtext("id") for layer in layers]
    assert [layer.findtext("layername") for layer in layers][:2] == ["track", "plan"]
    assert all(len(str(name)) > 10 for name in ids)  # QGIS renames shorter ones
    tree = [node.get("id") for node in root.findall("layer-tree-group/layer-tree-layer")]
    assert tree == ids[::-1]
    for layer in layers:
        source = tmp_path / str(layer.findtext("datasource"))
        for feature in json.loads(source.read_text())["features"]:
            for lon_deg, lat_deg in _positions(feature["geometry"]["coordinates"]):
                assert (lon_deg, lat_deg) == pytest.approx((72.787, 21.1613), abs=1e-3)
        symbols = layer.findall("renderer-v2/symbols/symbol")
        assert [symbol.get("name") for symbol in symbols] == [str(i) for i in range(len(symbols))]


def _positions(coordinates: Any) -> list[Any]:
    return coordinates if isinstance(coordinates[0], list) else [coordinates]


def test_the_foxglove_layout_shows_topics_and_fields_that_exist(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert main(["view", "foxglove", "-o", str(tmp_path / "layout.json")]) == 0
    assert "Import from file" in capsys.readouterr().err
    layout = json.loads((tmp_path / "layout.json").read_text())
    text = json.dumps(layout["configById"])
    named = set(re.findall(r'"(/[a-z_/]+)((?:\.[a-z_]+)*)"', text))
    assert len(named) >= 10
    for name, fields in named:
        topic = topics.find_topic(name)
        assert topic is not None, name
        ros_type = topic.ros_type
        for field in fields.split(".")[1:]:
            members = dict(JAZZY.fielddefs[ros_type][1])
            assert field in members, (name, fields)
            ros_type = str(members[field][1])
    panels = set(re.findall(r'"((?:3D|Image|map|Plot|RawMessages)![a-z]+)"', json.dumps(layout)))
    assert panels == set(layout["configById"])
    assert all(f'"{panel}"' in json.dumps(layout["layout"]) for panel in panels)


@pytest.mark.parametrize(
    ("installed", "ros"),
    [((), "ros2"), (("rviz",), "ros1"), (("rviz2",), "ros2"), (("rviz", "rviz2"), "ros2")],
)
def test_a_recording_is_played_as_ros_2_unless_only_the_rviz_of_ros_1_is_there(
    run: Path, monkeypatch: pytest.MonkeyPatch, installed: tuple[str, ...], ros: str
) -> None:
    played: list[tuple[bool, bool]] = []
    monkeypatch.setattr("shutil.which", lambda name, **_: name if name in installed else None)
    monkeypatch.setattr(
        "agribot.cli.run.view._play", lambda _, options: played.append((options.ros1, options.ros2))
    )
    assert main(["view", "rviz", str(run), "--no-open"]) == 0
    assert played == [(ros == "ros1", ros == "ros2")]


def test_a_recording_is_played_to_another_process_with_its_clock(run: Path) -> None:
    locator = f"tcp/127.0.0.1:{free_port()}"
    key = wire.make_topic_key(0, "/agribot/fix", topics.FIX.ros_type, _hash(topics.FIX))
    clock = wire.make_topic_key(0, "/clock", topics.CLOCK.ros_type, _hash(topics.CLOCK))
    player = _Player(locator, key, clock)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("agribot.cli.run.view.wait_until", player.wait)
        arguments = ["view", "rviz", str(run), "--ros2", "--ros-router", locator, "--no-open"]
        assert main(arguments) == 0
    assert player.is_checked


class _Player:
    """Joins as a peer at the first message, and checks at the last what it heard."""

    def __init__(self, locator: str, key: str, clock: str) -> None:
        self._locator, self._key, self._clock = locator, key, clock
        self._calls = 0
        self.is_checked = False

    def wait(self, _moment_s: float) -> None:
        self._calls += 1
        if self._calls == 1:
            self._peer = zenoh_peer(self._locator)
            self.talk = self._peer.__enter__()
            wait_for(lambda: len(self.talk("dump")["tokens"]) > 10, "the player's topics")
        if self._calls == 1000:
            wait_for(lambda: len(self.heard(self._clock)) > 10, "the clock")
            wait_for(lambda: len(self.heard(self._key)) > 2, "the fixes")
            fix: Any = JAZZY.deserialize_cdr(self.heard(self._key)[0], topics.FIX.ros_type)
            assert fix.latitude == pytest.approx(21.1613, abs=1e-3)
            times_s = [struct.unpack_from("<iI", data, 4) for data in self.heard(self._clock)]
            assert times_s == sorted(times_s)
            self._peer.__exit__(None, None, None)
            self.is_checked = True

    def heard(self, key: str) -> list[bytes]:
        return [bytes.fromhex(data) for data, _ in self.talk("dump")["heard"].get(key, [])]


def _hash(topic: Any) -> str:
    return load_types().hash_rihs01(topic.ros_type)


def test_a_viewer_without_a_recording_says_what_it_needs(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert main(["view", "qgis"]) == 2
    assert "agribot view qgis: no recording" in capsys.readouterr().err
    assert main(["view", "rerun", str(tmp_path / "none.mcap"), "-o", str(tmp_path / "x.rrd")]) == 2
    assert "none.mcap" in capsys.readouterr().err


def test_the_packaged_views_are_there() -> None:
    for name in ("ros1.rviz", "ros2.rviz", "foxglove.json"):
        assert find_view(name).is_file()
