"""A single file of a rosbag2 folder that was compressed as a whole."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import pytest
import zstandard
from rosbags.rosbag2 import StoragePlugin

from agribot.core.errors import RecordingError
from agribot.record.bag.info import read_info
from tests.record.bag import bag_samples as samples


def pack(tmp_path: Path, plugin: StoragePlugin) -> Path:
    samples.write_rosbag2(tmp_path / "whole", plugin=plugin)
    (file,) = (f for f in (tmp_path / "whole").iterdir() if f.suffix in (".mcap", ".db3"))
    packed = tmp_path / f"{file.name}.zstd"
    packed.write_bytes(zstandard.compress(file.read_bytes()))
    return packed


@pytest.fixture(autouse=True)
def room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of temporary files; it is empty at the end."""
    folder = tmp_path / "room"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_it_is_read_alone_and_in_a_folder_without_metadata(
    tmp_path: Path, room: Path, plugin: StoragePlugin
) -> None:
    packed = pack(tmp_path, plugin)
    info = read_info(packed)
    assert info.kind.endswith(" in a zstd file")
    assert (info.messages, info.size_bytes) == (50, packed.stat().st_size)
    assert samples.values(packed) == samples.values(tmp_path / "whole")
    (tmp_path / "rest").mkdir()
    shutil.copy(packed, tmp_path / "rest")
    assert samples.counts(tmp_path / "rest") == {"/fix": 50}
    assert not list(room.iterdir())


def test_a_packed_file_that_is_damaged_is_read_up_to_there_and_named(tmp_path: Path) -> None:
    samples.write_rosbag2(tmp_path / "whole", count=8000, plugin=StoragePlugin.MCAP)
    data = bytearray(zstandard.compress((tmp_path / "whole" / "whole.mcap").read_bytes()))
    data[len(data) // 2 :] = bytes(len(data) // 2)
    packed = tmp_path / "bad.mcap.zstd"
    packed.write_bytes(data)
    info = read_info(packed)
    assert 1000 < info.messages < 8000
    assert info.has_gaps
    assert "bad.mcap.zstd: its compressed data is damaged behind the first" in info.damage[0]


def test_of_a_file_that_was_cut_off_comes_what_is_there_or_the_reason(
    tmp_path: Path, room: Path
) -> None:
    packed = pack(tmp_path, StoragePlugin.MCAP)
    cut = tmp_path / "cut.mcap.zstd"
    cut.write_bytes(packed.read_bytes()[:40])
    with pytest.raises(RecordingError, match=r"cut.mcap.zstd was unpacked, but cut.mcap is empty"):
        read_info(cut)
    cut.write_bytes(packed.read_bytes()[:4] + b"\xff" * 300)
    with pytest.raises(RecordingError, match=r"cut.mcap.zstd is no sound zstd file"):
        read_info(cut)
    assert not list(room.iterdir())
