from __future__ import annotations

import shutil
import threading
from pathlib import Path
from typing import cast

import msgspec
import numpy as np
import pytest

from agribot.app.mission_file import FILE_NAME, MissionFile
from agribot.autonomy.plan.mission.mission import Mission
from agribot.core.messages import TickRecord
from tests.record import record_samples as samples


class Counting:
    """Stands for a mission: every state that is asked for is another one."""

    def __init__(self) -> None:
        self.asked = 0

    def snapshot(self) -> dict[str, int]:
        self.asked += 1
        return {"asked": self.asked}


def ticks(count: int) -> list[TickRecord]:
    """A second apart, so that each is due."""
    record = samples.tick(0, np.random.default_rng(0))
    return [
        msgspec.structs.replace(record, batch=msgspec.structs.replace(record.batch, t_s=float(t)))
        for t in range(count)
    ]


def refuse(_t_s: float, text: str) -> None:
    raise AssertionError(text)


def stored(folder: Path) -> int:
    return cast(int, msgspec.json.decode((folder / FILE_NAME).read_bytes())["asked"])


def test_a_disk_that_hangs_does_not_hold_up_the_loop_and_the_newest_state_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mission, disk = Counting(), threading.Event()
    replace = Path.replace

    def hang(self: Path, target: Path) -> Path:
        assert disk.wait(30.0)
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", hang)
    file = MissionFile(tmp_path, cast(Mission, mission), refuse)
    for record in ticks(20):
        file(record)  # comes back while the disk hangs
    assert mission.asked == 20
    assert not (tmp_path / FILE_NAME).exists()
    disk.set()
    file.close()
    assert stored(tmp_path) == 20


def test_a_write_that_fails_is_told_once_and_tried_again(tmp_path: Path) -> None:
    """The loop drives on: a folder that is gone, that comes back, and that is gone again."""
    said: list[tuple[float, str]] = []
    folder, mission = tmp_path / "gone", Counting()
    file = MissionFile(folder, cast(Mission, mission), lambda t_s, text: said.append((t_s, text)))

    def write(record: TickRecord) -> None:
        file(record)
        file._writer.submit(lambda: None).result()  # the thread has come to it

    records = ticks(8)
    for record in records[:3]:
        write(record)
    folder.mkdir()
    for record in records[3:6]:
        write(record)
    assert stored(folder) == 6
    shutil.rmtree(folder)
    for record in records[6:]:
        write(record)
    file.close()
    file.close()
    assert [t_s for t_s, _ in said] == [1.0, 7.0]
    assert all("cannot write" in text and "make room" in text for _, text in said)
