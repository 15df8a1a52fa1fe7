"""A disk that stalls or fails, and a robot that does not notice before it must."""

from __future__ import annotations

import errno
import io
import os
import threading
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from agribot.core.config import load
from agribot.record import background_file
from agribot.record.background_file import BackgroundFile
from agribot.record.recorder import RunRecorder
from agribot.record.replay import read_ticks
from tests.record import record_samples as samples


def test_what_is_written_is_in_the_file_in_its_order(tmp_path: Path) -> None:
    file = BackgroundFile(tmp_path / "a")
    parts = [bytes([index % 256]) * (index % 97) for index in range(2000)]
    for index, part in enumerate(parts):
        assert file.tell() == sum(map(len, parts[:index]))
        file.write(part)
    file.close()
    file.close()
    assert (tmp_path / "a").read_bytes() == b"".join(parts)


@pytest.fixture
def live(monkeypatch: pytest.MonkeyPatch) -> None:
    """The clock runs as fast as the robot's time, however quickly a test goes through it."""
    seconds = count()
    monkeypatch.setattr("agribot.record.parts.time.monotonic", lambda: float(next(seconds)))


@pytest.mark.usefixtures("live")
def test_a_stalled_disk_holds_up_the_recording_and_not_the_loop(tmp_path: Path) -> None:
    """The file is a pipe without a reader: it takes 64 KiB and then nothing."""
    pipe = tmp_path / "run.mcap"
    os.mkfifo(pipe)
    taken = bytearray()
    may_read = threading.Event()

    def read_late() -> None:
        with pipe.open("rb") as source:
            may_read.wait(120.0)
            taken.extend(source.read())

    reader = threading.Thread(target=read_late, daemon=True)
    reader.start()
    recorder = RunRecorder(pipe, load("farm"), samples.robot(), samples.URDF, samples.plan())
    records = samples.ticks(2000, seed=1)
    for record in records:
        recorder(record)  # would stand still here for ever
    may_read.set()
    recorder.close()
    reader.join(120.0)
    assert len(taken) > 300_000
    whole = tmp_path / "whole.mcap"
    whole.write_bytes(taken)
    assert list(read_ticks(whole)) == records


@pytest.mark.usefixtures("live")
def test_a_disk_that_stalls_for_good_ends_the_recording_with_its_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(background_file, "WAITING_BYTES", 50_000)
    pipe = tmp_path / "run.mcap"
    os.mkfifo(pipe)
    source = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        recorder = RunRecorder(pipe, load("farm"), samples.robot(), samples.URDF, samples.plan())
        for record in samples.ticks(3000, seed=1):
            recorder(record)
        assert "has not taken anything for too long" in recorder.ended_because
        monkeypatch.setattr(background_file, "STALLED_S", 0.05)
        recorder.close()  # does not wait for ever either
    finally:
        os.close(source)


def test_a_full_disk_is_told_with_the_next_call() -> None:
    if not Path("/dev/full").exists():
        return
    file = BackgroundFile(Path("/dev/full"))
    file.write(b"x" * 1000)
    with pytest.raises(OSError, match="No space left"):
        file.drain()
    file.close()


class TightDisk(io.FileIO):
    """A disk with little room, as its file system reports."""

    room_bytes = 50_000

    def write(self, data: Any) -> int:
        if self.tell() + len(data) > self.room_bytes:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return super().write(data)


@pytest.fixture
def tight(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A file on a tight disk; all others lie elsewhere."""
    tight_path, open_file = tmp_path / "run.mcap", Path.open

    def open_tight(path: Path, *mode: Any, **more: Any) -> Any:
        if path == tight_path and mode == ("wb",):
            return TightDisk(path, "w")
        return open_file(path, *mode, **more)

    monkeypatch.setattr(Path, "open", open_tight)
    return tight_path


@pytest.mark.parametrize(
    ("room_bytes", "kept_bytes"), [(400_000, 200_000), (1_600_000, 800_000), (5_000_000, 4_000_000)]
)
def test_a_recording_that_fills_the_disk_gives_back_its_end_but_never_more_than_half(
    room_bytes: int, kept_bytes: int, tight: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(TightDisk, "room_bytes", room_bytes)
    file = BackgroundFile(tight)
    with pytest.raises(OSError, match="No space left"):
        for _ in range(room_bytes // 50_000 + 1):
            file.write(b"x" * 50_000)
            file.drain()
    file.close()
    assert tight.stat().st_size == kept_bytes


@pytest.mark.usefixtures("live")
def test_a_short_recording_on_a_full_disk_can_be_read_up_to_where_it_was_cut(
    tight: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(TightDisk, "room_bytes", 200_000)
    records = samples.ticks(600, seed=4)
    recorder = RunRecorder(tight, load("farm"), samples.robot(), samples.URDF, samples.plan())
    for record in records:
        recorder(record)
    recorder.close()
    assert "No space left" in recorder.ended_because
    kept = list(read_ticks(tight))
    assert 0 < len(kept) < len(records)
    assert kept == records[: len(kept)]
