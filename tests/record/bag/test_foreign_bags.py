"""Recordings as the world delivers them: compressed, cut, empty, of unknown types, or none."""

from __future__ import annotations

import shutil
import sqlite3
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer
from rosbags import rosbag1, rosbag2
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import get_types_from_msg

from agribot.cli.main import main
from agribot.core import topics
from agribot.core.errors import RecordingError
from agribot.record.bag.convert import convert
from agribot.record.bag.definitions import make_ros1_store, ros2_store
from agribot.record.bag.info import read_info
from agribot.record.bag.opening import open_bag
from agribot.record.mcap_file import McapFile
from agribot.ros.messages import rosmsg
from tests import nightly
from tests.record.bag import bag_samples as samples


@pytest.mark.parametrize("compression", ["", "LZ4", "BZ2"])
def test_compressed_bags_are_read_and_say_so(tmp_path: Path, compression: str) -> None:
    samples.write_ros1(tmp_path / "a.bag", compression=compression)
    info = read_info(tmp_path / "a.bag")
    assert info.compression == (compression.lower() or "none")
    assert info.messages == 100
    assert info.duration_s == pytest.approx(4.9)
    convert(tmp_path / "a.bag", tmp_path / "a.mcap")
    assert samples.values(tmp_path / "a.mcap") == samples.values(tmp_path / "a.bag")


@pytest.mark.parametrize("compression", ["", "LZ4", "BZ2"])
@pytest.mark.parametrize("share", [0.5, 0.8, 0.97])
def test_a_cut_ros_1_bag_is_read_up_to_the_cut(
    tmp_path: Path, compression: str, share: float
) -> None:
    samples.write_ros1(tmp_path / "whole.bag", count=200, compression=compression)
    data = (tmp_path / "whole.bag").read_bytes()
    cut = tmp_path / "cut.bag"
    cut.write_bytes(data[: 4200 + int((len(data) - 4200) * share)])
    info = read_info(cut)
    assert 0 < info.messages <= 400
    assert any("no index" in note for note in info.notes)
    result = convert(cut, tmp_path / "saved.mcap")
    assert result.messages_out == info.messages
    whole = samples.values(tmp_path / "whole.bag")
    for name, messages in samples.values(tmp_path / "saved.mcap").items():
        assert messages == whole[name][: len(messages)]


def test_a_bag_whose_recorder_died_has_no_index_and_is_read_anyway(tmp_path: Path) -> None:
    samples.write_ros1(tmp_path / "a.bag")
    data = (tmp_path / "a.bag").read_bytes()
    at = data.index(b"index_pos=") + len(b"index_pos=")
    (tmp_path / "dead.bag").write_bytes(data[:at] + bytes(8) + data[at + 8 :])
    assert read_info(tmp_path / "dead.bag").messages == 100
    assert samples.counts(tmp_path / "dead.bag") == samples.counts(tmp_path / "a.bag")


def test_a_dead_bag_is_read_up_to_a_message_without_a_time(tmp_path: Path) -> None:
    samples.write_ros1(tmp_path / "a.bag")
    data = bytearray((tmp_path / "a.bag").read_bytes())
    at = data.index(b"index_pos=") + len(b"index_pos=")
    data[at : at + 8] = bytes(8)
    last = data.rindex(b"op=\x02")  # the last of the file: index and connections come without
    field = data.index(b"time=", last - 60)
    data[field : field + 5] = b"tame="
    (tmp_path / "dead.bag").write_bytes(data)
    assert 0 < read_info(tmp_path / "dead.bag").messages < 100


@pytest.mark.parametrize("name", ["a.bag", "a.mcap", "a.db3"])
def test_no_cut_hangs_or_ends_in_a_traceback(
    tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    samples.write_ros1(tmp_path / "source.bag", count=20)
    if name != "a.bag":
        convert(tmp_path / "source.bag", tmp_path / name)
    else:
        (tmp_path / name).write_bytes((tmp_path / "source.bag").read_bytes())
    data = (tmp_path / name).read_bytes()
    dice = np.random.default_rng(5)
    for length in dice.integers(0, len(data), size=8):
        path = tmp_path / f"cut{Path(name).suffix}"
        path.write_bytes(data[:length])
        assert main(["bag", "info", str(path)]) in (0, 2)
    for _ in range(8):  # and no damage in the middle
        damaged = bytearray(data)
        at = int(dice.integers(0, len(data) - 16))
        damaged[at : at + 16] = dice.bytes(16)
        path.write_bytes(damaged)
        out = tmp_path / "out.mcap"
        assert main(["bag", "convert", str(path), str(out)]) in (0, 1, 2)
        out.unlink(missing_ok=True)
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("empty.bag", b"", "empty"),
        ("empty.mcap", b"", "empty"),
        ("empty.db3", b"", "empty"),
        ("wrong.bag", b"PK\x03\x04 a zip archive", "no recording"),
        ("wrong.mcap", b"hello, I am a text", "no recording"),
        ("old.bag", b"#ROSBAG V1.2\n...", "version 1.2"),
        ("head.mcap", b"\x89MCAP0\r\n", "cut off before its first message"),
        ("head.bag", b"#ROSBAG V2.0\n", "cut off before its first message"),
        ("head.db3", b"SQLite format 3\x00" + bytes(84), "cannot be read"),
        ("huge.mcap", b"\x89MCAP0\r\n\x01" + b"\xff" * 8, "cut off before its first message"),
    ],
)
def test_what_is_no_recording_is_refused_with_the_reason(
    tmp_path: Path, name: str, content: bytes, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    for command in (["info", str(path)], ["convert", str(path), str(tmp_path / "out.bag")]):
        assert main(["bag", *command]) == 2
        said = capsys.readouterr().err
        assert message in said
        assert len(said.strip().splitlines()) == 1
    assert [p.name for p in tmp_path.iterdir()] == [name]


def test_missing_files_and_empty_folders_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="check the path"):
        read_info(tmp_path / "none.bag")
    (tmp_path / "folder").mkdir()
    with pytest.raises(RecordingError, match="empty folder"):
        read_info(tmp_path / "folder")
    (tmp_path / "folder" / "notes.txt").write_text("nothing")
    with pytest.raises(RecordingError, match="no rosbag2 folder"):
        read_info(tmp_path / "folder")


def test_a_type_of_somebody_else_goes_along_with_its_definition(tmp_path: Path) -> None:
    store = make_ros1_store()
    store.register(get_types_from_msg("Header header\nfloat32[] teeth\n", "rake/msg/Rake"))
    writer = rosbag1.Writer(tmp_path / "rake.bag")
    with writer:
        rake = writer.add_connection("/rake", "rake/msg/Rake", typestore=store)
        head = store.types["std_msgs/msg/Header"](
            3, store.types["builtin_interfaces/msg/Time"](1, 2), "r"
        )
        message = store.types["rake/msg/Rake"](head, np.array([1.5, 2.5], dtype=np.float32))
        writer.write(rake, 1_000_000_000, store.serialize_ros1(message, "rake/msg/Rake"))
    convert(tmp_path / "rake.bag", tmp_path / "rake.mcap")
    convert(tmp_path / "rake.mcap", tmp_path / "back.bag")
    found = samples.values(tmp_path / "back.bag")
    assert found == samples.values(tmp_path / "rake.bag")
    assert found["/rake"][0][1]["teeth"] == [1.5, 2.5]


def test_a_type_without_definition_is_left_out_and_the_rest_converted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    samples.write_rosbag2(tmp_path / "bag")
    database = sqlite3.connect(tmp_path / "bag" / "bag.db3")
    with database:
        database.execute("DELETE FROM message_definitions")
        database.execute(
            "INSERT INTO topics VALUES (99, '/secret', 'acme_msgs/msg/Secret', 'cdr', '[]', '')"
        )
        database.execute("INSERT INTO messages VALUES (null, 99, 1700000000000000001, x'00010000')")
    database.close()
    path = tmp_path / "bag" / "bag.db3"
    topics = {topic.name: topic for topic in read_info(path).topics}
    assert topics["/fix"].known
    assert not topics["/secret"].known
    assert main(["bag", "convert", str(path), str(tmp_path / "out.mcap")]) == 1
    said = capsys.readouterr().err
    assert "1 messages of /secret left out: no definition of acme_msgs/msg/Secret" in said
    assert samples.counts(tmp_path / "out.mcap") == {"/fix": 50}


def test_a_rosbag2_folder_without_its_metadata_is_read(tmp_path: Path) -> None:
    samples.write_rosbag2(tmp_path / "bag", plugin=StoragePlugin.MCAP)
    (tmp_path / "bag" / "metadata.yaml").unlink()
    info = read_info(tmp_path / "bag")
    assert info.messages == 50
    assert any("metadata.yaml is missing" in note for note in info.notes)


def test_messages_of_a_big_endian_computer_become_a_ros_1_bag(tmp_path: Path) -> None:
    store = ros2_store()
    with rosbag2.Writer(tmp_path / "big", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        fix = writer.add_connection("/fix", "sensor_msgs/msg/NavSatFix", typestore=store)
        message = samples.nav_sat_fix(store, samples.START_NS)
        data = store.serialize_cdr(message, fix.msgtype, little_endian=False)
        writer.write(fix, samples.START_NS, data)
    result = convert(tmp_path / "big", tmp_path / "big.bag")
    assert (result.messages_out, result.skipped) == (1, {})
    ((_, value),) = samples.values(tmp_path / "big.bag")["/fix"]
    assert value["latitude"] == 49.5


def test_the_files_of_a_folder_are_read_in_the_order_of_their_times(tmp_path: Path) -> None:
    """By name the eleventh comes before the second."""
    folder, store = tmp_path / "drive", ros2_store()
    folder.mkdir()
    for part in range(12):
        with rosbag2.Writer(tmp_path / "part", version=9, storage_plugin=StoragePlugin.MCAP) as one:
            fix = one.add_connection("/fix", "sensor_msgs/msg/NavSatFix", typestore=store)
            t_ns = samples.START_NS + part * samples.STEP_NS
            message = samples.nav_sat_fix(store, t_ns)
            one.write(fix, t_ns, store.serialize_cdr(message, fix.msgtype))
        (tmp_path / "part" / "part.mcap").rename(folder / f"drive_{part}.mcap")
        shutil.rmtree(tmp_path / "part")
    with open_bag(folder) as bag:
        times_ns = [message.log_ns for message in bag.messages()]
    assert len(times_ns) == 12 and times_ns == sorted(times_ns)


@pytest.mark.parametrize("plugin", list(StoragePlugin))
@pytest.mark.parametrize("mode", list(rosbag2.CompressionMode)[1:])
def test_a_compressed_rosbag2_folder_is_read(
    tmp_path: Path, plugin: StoragePlugin, mode: rosbag2.CompressionMode
) -> None:
    if (plugin, mode) == (StoragePlugin.SQLITE3, rosbag2.CompressionMode.STORAGE):
        return  # there is no such file
    store = ros2_store()
    writer = rosbag2.Writer(tmp_path / "bag", version=9, storage_plugin=plugin)
    writer.set_compression(mode, rosbag2.CompressionFormat.ZSTD)
    with writer:
        fix = writer.add_connection("/fix", "sensor_msgs/msg/NavSatFix", typestore=store)
        for index in range(5):
            t_ns = samples.START_NS + index * samples.STEP_NS
            message = samples.nav_sat_fix(store, t_ns)
            writer.write(fix, t_ns, store.serialize_cdr(message, fix.msgtype))
    values = samples.values(tmp_path / "bag")["/fix"]
    assert [value["latitude"] for _, value in values] == [49.5] * 5


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("use_chunking", [True, False])
def test_mcap_without_index_or_chunks_is_read(
    tmp_path: Path, compression: CompressionType, use_chunking: bool
) -> None:
    path = tmp_path / "plain.mcap"
    with path.open("wb") as file:
        writer = Writer(
            file, compression=compression, use_chunking=use_chunking, use_statistics=False,
            use_summary_offsets=False, repeat_channels=False, repeat_schemas=False,
        )  # fmt: skip
        writer.start()
        schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data")
        channel = writer.register_channel("/number", "cdr", schema)
        for index in range(20):
            data = b"\0\1\0\0" + np.float64(index).tobytes()
            writer.add_message(channel, index * 1000, data, index * 1000)
        writer.finish()  # type: ignore[no-untyped-call]
    assert read_info(path).messages == 20
    convert(path, tmp_path / "out.bag")
    numbers = [value["data"] for _, value in samples.values(tmp_path / "out.bag")["/number"]]
    assert numbers == [float(i) for i in range(20)]


@nightly.one_by_one("count", (20_000, 1_000_000), in_suite=1)
def test_very_many_messages_are_counted_and_converted(tmp_path: Path, count: int) -> None:
    data = rosmsg.to_cdr(rosmsg.make_float64(1.5))
    file = McapFile(tmp_path / "many.mcap")
    for number in range(count):
        file.write(topics.DISTANCE, number, data, number)
    file.close()
    assert read_info(tmp_path / "many.mcap").messages == count
    assert convert(tmp_path / "many.mcap", tmp_path / "many.bag").messages_out == count
    assert read_info(tmp_path / "many.bag").messages == count
