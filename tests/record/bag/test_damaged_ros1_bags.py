"""ROS 1 bags with damaged chunks are read on behind them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rosbags import rosbag1

from agribot.cli.main import main
from agribot.record.bag.opening import open_bag
from agribot.record.damage import Damage, collect_damage
from tests.record import damaged_files
from tests.record.bag import bag_samples as samples
from tests.record.damaged_files import KINDS, Kind

SEEDS = range(12)
Messages = set[tuple[str, int, bytes]]


def _read(path: Path) -> tuple[Messages, list[Damage]]:
    with collect_damage() as found, open_bag(path) as bag:
        return {(m.topic.name, m.log_ns, m.data) for m in bag.messages()}, found


def _list_chunks(path: Path) -> list[tuple[int, int, int, int]]:
    """List where chunks begin and end, and their first and last time."""
    with rosbag1.Reader(path) as reader:
        return [
            (info.pos, _find_end(reader.chunks[info.pos]), info.start_time, info.end_time)
            for info in reader.chunk_infos
        ]


def _find_end(chunk: rosbag1.reader.Chunk) -> int:
    return chunk.datapos + chunk.datasize


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("compression", ["", "LZ4", "BZ2"])
def test_all_messages_outside_of_damaged_chunks_are_read_and_a_loss_is_named(
    compression: str, kind: Kind, tmp_path: Path
) -> None:
    path = tmp_path / "drive.bag"
    samples.write_ros1(path, compression=compression)
    sound, chunks, (whole, _) = path.read_bytes(), _list_chunks(path), _read(path)
    for seed in SEEDS:
        data, start, end = damaged_files.damage(sound, kind, np.random.default_rng(seed))
        if start < chunks[0][0]:
            continue  # the header of the bag
        path.write_bytes(data)
        hit = [chunk for chunk in chunks if chunk[0] < end and chunk[1] > start]
        kept = {
            message
            for message in whole
            if not any(low <= message[1] < high for _, _, low, high in hit)
        }
        if not kept:
            continue  # cut off before the first message
        read, damages = _read(path)
        assert kept <= read, seed
        # Without compression, no checksum says that the bytes of a message have changed.
        assert read <= whole or not compression, seed
        if len(read) < len(whole):
            assert any(damage.lost_messages != 0 for damage in damages), seed


@pytest.mark.parametrize("compression", ["LZ4", "BZ2"])
def test_a_damaged_chunk_is_counted_by_the_index_with_the_times_around_it(
    compression: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "drive.bag"
    samples.write_ros1(path, compression=compression)
    (start, end, low_ns, high_ns), (whole, _) = _list_chunks(path)[4], _read(path)
    data = bytearray(path.read_bytes())
    data[(start + end) // 2] ^= 0x10
    path.write_bytes(data)
    read, (damage,) = _read(path)
    assert damage.lost_messages == len(whole) - len(read) > 0
    assert damage.after_ns is not None and damage.before_ns is not None
    assert low_ns - samples.STEP_NS <= damage.after_ns <= low_ns
    assert high_ns - 1 <= damage.before_ns <= high_ns + samples.STEP_NS
    assert main(["bag", "track", str(path), "-o", str(tmp_path / "drive.gpx")]) == 1
    assert f"note: {damage.describe()}" in capsys.readouterr().err


def test_a_message_whose_bytes_fit_no_more_costs_itself_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "drive.bag"
    samples.write_ros1(path)
    data = bytearray(path.read_bytes())
    at = data.index(b"message 7")
    data[at - 2] = 0x7F  # of the length of the text
    path.write_bytes(data)
    assert main(["bag", "csv", str(path), "/text", "-o", str(tmp_path / "text.csv")]) == 1
    assert len((tmp_path / "text.csv").read_text().splitlines()) == 1 + 49
    assert "a message on /text is no std_msgs/msg/String" in capsys.readouterr().err
    assert main(["bag", "convert", str(path), str(tmp_path / "drive.mcap")]) == 1
    assert samples.counts(tmp_path / "drive.mcap") == {"/fix": 50, "/text": 49}
    assert "1 messages of /text left out" in capsys.readouterr().err
