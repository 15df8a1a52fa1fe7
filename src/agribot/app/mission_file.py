"""The state of a mission on disk, so that a crash or a reboot loses nothing."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Protocol

import msgspec

from agribot.autonomy.plan.mission.saved_mission import SavedMission
from agribot.core.config import RunConfig
from agribot.core.errors import MissionError
from agribot.core.facts import MissionBroken, MissionDone, RunUnreadable
from agribot.core.messages import TickRecord
from agribot.core.whole_file import write_at_once

FILE_NAME = "mission.json"
PERIOD_S = 1.0
LEFT_STD_M = 0.1  # 1 sigma of where the robot was left, and of rolling on since


class Resumable(Protocol):
    def snapshot(self) -> msgspec.Struct | None: ...


class MissionFile:
    """A tap that writes the mission, or what else must outlive a crash, once a second.

    It also writes on every change of the mission's state.

    Every write replaces the whole file at once: a reader sees the old or the new state. A thread
    writes, so that a slow disk does not hold up the control loop; a newer state replaces one that
    waits for it. `on_failure` gets the time and the error of a disk that begins to fail.
    """

    def __init__(
        self,
        folder: Path,
        mission: Resumable,
        on_failure: Callable[[float, str], None],
        name: str = FILE_NAME,
    ) -> None:
        self._path = folder / name
        self._mission, self._on_failure = mission, on_failure
        self._state = ("", "")
        self._next_s = self._now_s = 0.0
        self._newest: deque[bytes] = deque(maxlen=1)
        self._writer = ThreadPoolExecutor(max_workers=1, thread_name_prefix="mission-file")
        self._failure = self._reported = ""

    def __call__(self, record: TickRecord) -> None:
        self._now_s = record.batch.t_s
        self._report_failure()
        state = record.status.state, record.status.stopped
        if state == self._state and record.batch.t_s < self._next_s:
            return
        self._state, self._next_s = state, record.batch.t_s + PERIOD_S
        self.write()

    def write(self) -> None:
        """Let the thread write the present state."""
        saved = self._mission.snapshot()
        if saved is not None:
            self._newest.append(msgspec.json.encode(saved))
            self._writer.submit(self._write_newest)

    def close(self) -> None:
        """Wait for the last write. Safe to call twice."""
        self._writer.shutdown()
        self._report_failure()

    def _report_failure(self) -> None:
        failure = self._failure
        if failure and not self._reported:
            self._on_failure(self._now_s, failure)
        self._reported = failure

    def _write_newest(self) -> None:
        try:
            write_at_once(self._path, self._newest.popleft(), is_synced=True)
        except IndexError:
            pass  # a write before this one took it along
        except OSError as error:
            self._failure = (
                f"cannot write {self._path}: {error.strerror or error}; make room on the disk: a "
                "run that goes on after a crash goes on from an older state"
            )
        else:
            self._failure = ""


def continue_config(config: RunConfig, saved: SavedMission) -> RunConfig:
    """Return the settings of a run that goes on: its start mark is where the robot stopped."""
    if config.field.start_map_m is None:
        return config
    field = msgspec.structs.replace(
        config.field,
        start_map_m=saved.pose[:2],
        start_yaw_deg=math.degrees(saved.pose[2]),
        start_std_m=max(config.field.start_std_m, LEFT_STD_M),
        from_world=tuple(name for name in config.field.from_world if not name.startswith("start_")),
    )
    return msgspec.structs.replace(config, field=field)


def read_mission(folder: Path) -> SavedMission:
    """Read the saved mission of a run's folder.

    Raises: MissionError: no saved mission, a broken one, or one that has ended.
    """
    path = folder / FILE_NAME
    try:
        saved = msgspec.json.decode(path.read_bytes(), type=SavedMission)
    except OSError as error:
        raise MissionError(RunUnreadable(str(path), str(error.strerror))) from error
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise MissionError(MissionBroken(str(path), str(error))) from error
    if saved.state == "done":
        raise MissionError(MissionDone(str(folder)))
    return saved
