from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin

from agribot.cli.main import main
from agribot.core import topics
from agribot.core.errors import RecordingError
from agribot.record.bag.convert import ConvertOptions, convert
from agribot.record.bag.info import format_info, read_info
from agribot.record.replay import read_config, read_ticks, read_truth, read_weed_map
from tests.record.bag import bag_samples as samples


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run") / "run.mcap"
    samples.write_run(path)
    return path


@pytest.mark.parametrize("between", ["between.bag", "between.db3", "between"])
def test_a_run_comes_back_from_another_format_without_losing_a_message(
    run: Path, tmp_path: Path, between: str
) -> None:
    there = convert(run, tmp_path / between)
    back = convert(tmp_path / between, tmp_path / "back.mcap")
    assert there.skipped == back.skipped == {}
    assert there.messages_in == there.messages_out == back.messages_out == read_info(run).messages
    before, after = samples.values(run), samples.values(tmp_path / "back.mcap")
    assert before.keys() == after.keys()
    for name, messages in before.items():
        assert repr(after[name]) == repr(messages), name  # NaN equals itself
    assert list(read_ticks(tmp_path / "back.mcap"))[-1].command == list(read_ticks(run))[-1].command
    assert read_config(tmp_path / "back.mcap") == read_config(run)
    assert read_weed_map(tmp_path / "back.mcap") == read_weed_map(run)
    assert np.array_equal(read_truth(tmp_path / "back.mcap"), read_truth(run))
    assert set(read_info(tmp_path / "back.mcap").files) == set(read_info(run).files)


def test_a_ros_1_bag_of_a_run_is_one_for_other_readers(run: Path, tmp_path: Path) -> None:
    convert(run, tmp_path / "run.bag")
    with AnyReader([tmp_path / "run.bag"]) as reader:  # checks the md5 of every type
        kinds = {c.topic: c for c in reader.connections}
        info: Any = kinds[topics.CAMERA_INFO.name]
        assert info.digest == "c9a58c1b0b154e0e6da7578cb991d214"  # sensor_msgs/CameraInfo
        assert kinds[topics.TF.name].digest == "94810edda583a504dfda3829e70d7eec"
        static: Any = kinds[topics.TF_STATIC.name].ext
        assert static.latching == 1
        counted = {t: i.msgcount for t, i in reader.topics.items()}
    expected = samples.counts(run)
    assert {t: n for t, n in counted.items() if t != "/agribot/files"} == expected


def test_a_converted_mcap_opens_in_the_readers_of_others(run: Path, tmp_path: Path) -> None:
    samples.write_ros1(tmp_path / "field.bag")
    convert(tmp_path / "field.bag", tmp_path / "field.mcap")
    with (tmp_path / "field.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        fixes = [m.decoded_message for m in reader.iter_decoded_messages(["/fix"])]
    assert [fix.latitude for fix in fixes] == [49.5 + 1e-6 * i for i in range(50)]
    with AnyReader([tmp_path / "field.mcap"]) as any_reader:
        qos: Any = next(c.ext for c in any_reader.connections if c.topic == "/text")
        assert qos.offered_qos_profiles[0].durability.name == "TRANSIENT_LOCAL"


@pytest.mark.parametrize("plugin", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_a_rosbag2_folder_becomes_a_ros_1_bag_and_comes_back(
    tmp_path: Path, plugin: StoragePlugin
) -> None:
    samples.write_rosbag2(tmp_path / "folder", plugin=plugin)
    convert(tmp_path / "folder", tmp_path / "x.bag")
    storage: Any = plugin.name.lower()
    convert(tmp_path / "x.bag", tmp_path / "again", ConvertOptions(storage=storage))
    assert samples.values(tmp_path / "again") == samples.values(tmp_path / "folder")
    assert len(samples.values(tmp_path / "x.bag")["/fix"]) == 50


def test_chosen_topics_come_alone(run: Path, tmp_path: Path) -> None:
    wanted = (topics.FIX.name, topics.CMD_VEL.name)
    convert(run, tmp_path / "two.bag", ConvertOptions(topics=wanted))
    expected = samples.counts(run)
    assert samples.counts(tmp_path / "two.bag") == {name: expected[name] for name in wanted}
    with pytest.raises(RecordingError, match="/none; it has: /agribot/angle"):
        convert(run, tmp_path / "none.bag", ConvertOptions(topics=("/none",)))
    assert not (tmp_path / "none.bag").exists()


def test_what_only_mcap_can_hold_is_left_out_and_named(tmp_path: Path) -> None:
    path = tmp_path / "json.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("Battery", "jsonschema", b'{"type":"object"}')
        channel = writer.register_channel("/battery", "json", schema)
        writer.add_message(channel, 1, b'{"volts":24}', 1)
        writer.finish()  # type: ignore[no-untyped-call]
    result = convert(path, tmp_path / "out.bag")
    assert result.skipped == {"/battery": 1}
    assert "json messages of Battery fit only into an .mcap" in result.reasons["/battery"]
    copied = convert(path, tmp_path / "copy.mcap")
    assert copied.skipped == {}
    assert samples.values(tmp_path / "copy.mcap") == {"/battery": [(1, b'{"volts":24}')]}


def test_nothing_is_overwritten_and_nothing_half_done_stays(run: Path, tmp_path: Path) -> None:
    (tmp_path / "there.bag").write_text("precious")
    with pytest.raises(RecordingError, match="exists already"):
        convert(run, tmp_path / "there.bag")
    assert (tmp_path / "there.bag").read_text() == "precious"
    (tmp_path / "broken.bag").write_bytes(b"#ROSBAG V2.0\nbroken")
    with pytest.raises(RecordingError):
        convert(tmp_path / "broken.bag", tmp_path / "out.mcap")
    assert {p.name for p in tmp_path.iterdir()} == {"there.bag", "broken.bag"}


def test_info_counts_what_is_there(run: Path, tmp_path: Path) -> None:
    info = read_info(run)
    by_name = {topic.name: topic for topic in info.topics}
    assert info.kind == "MCAP"
    assert info.messages == sum(samples.counts(run).values())
    assert by_name[topics.IMU.name].count == 600
    assert by_name[topics.IMU.name].rate_hz == pytest.approx(200.0, rel=0.01)
    assert by_name[topics.PATH.name].latched
    assert not by_name[topics.FIX.name].latched
    assert "goals.json" in info.files
    text = format_info(info)
    assert "sensor_msgs/msg/NavSatFix" in text
    assert "config.toml" in text


def test_the_command_converts_and_says_what_it_did(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "small.bag"
    assert main(["bag", "convert", str(run), str(out), "--compress", "lz4", "--json"]) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result["messages_out"] == read_info(run).messages
    assert main(["bag", "info", str(out), "--json"]) == 0
    info = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert info["compression"] == "lz4"
    assert main(["bag", "convert", str(run), str(out)]) == 2
    assert "exists already" in capsys.readouterr().err
