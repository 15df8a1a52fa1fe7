"""What a run records and when: from its start on, and whenever an operator says so."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path as FilePath
from typing import Protocol

import msgspec

from agribot.autonomy.plan.mission.saved_mission import SavedMission
from agribot.autonomy.weeds.track import Track
from agribot.core.config import RunConfig
from agribot.core.errors import RecordingError
from agribot.core.messages import MappedPlant, Path, TickRecord
from agribot.core.robot import RobotSpec
from agribot.record.recorder import RunRecorder

FILE_NAME = "run.mcap"
GOALS_ATTACHMENT = "goals.json"
PLAN_ATTACHMENT = "plan.geojson"
PRESCRIPTION_ATTACHMENT = "prescription"
PLANTS_ATTACHMENT = "crop plants"
SAVED_ATTACHMENT = "resumed.json"  # null in a run that began anew
EARLIER_ATTACHMENT = "earlier_plants.json"  # the weed map that a run took over
TRUTH_PERIOD_S = 0.1
ENDED = ("done", "cancelled", "failed")  # states of a mission
Pose = tuple[float, float, float]


def find_recording(path: FilePath) -> FilePath:
    """Find the recording of a run by its folder; a file is one itself."""
    return path / FILE_NAME if path.is_dir() else path


class Recorded(Protocol):
    """The parts of a run that a recording holds besides its ticks."""

    config: RunConfig
    robot: RobotSpec
    out_dir: FilePath

    @property
    def urdf(self) -> str: ...
    @property
    def planned_path(self) -> Path | None: ...
    @property
    def shown_goals_map_m(self) -> Sequence[tuple[float, float]]: ...
    def plants(self) -> tuple[MappedPlant, ...]: ...


class RunRecording:
    """A tap. The recording in the folder of the run begins with it and can be run again.

    One that begins later shows what happened from then on: when an operator says so, or from the
    start of a mission after the first to its end. It lies in a folder of its own beside
    that of the run: `first`, `first-2`, `first-3`. `say` hears when one cannot be made, and when
    one ends early because of the disk.
    """

    def __init__(
        self,
        run: Recorded,
        files: Mapping[str, tuple[str, bytes]],
        say: Callable[[float, str], None],
    ) -> None:
        """`files` are attached by name, with their media type.

        Raises: RecordingError: the file of the run cannot be created or written.
        """
        self._run, self._files, self._say = run, files, say
        self._urdf = run.urdf  # made once: it takes longer than a tick
        self._path: Path | None = None
        self._next_truth_s = self._now_s = 0.0
        self._ended_because = ""
        self.folder: FilePath | None = None
        self._recorder: RunRecorder | None = None
        self._has_ended = self._is_of_mission = False
        if run.config.record.enabled:
            self._begin(run.out_dir)

    def __call__(self, record: TickRecord) -> None:
        words = [event.request.word for event in record.batch.requests]
        for word in words:
            if word == "start_recording":
                self._start(record.batch.t_s)
            if word == "start" and self._has_ended and self._run.config.record.enabled:
                is_new = not self.name
                self._start(record.batch.t_s)
                self._is_of_mission = is_new
        if self._recorder is not None:
            self._follow_path(record.batch.t_s, self._recorder)
            self._recorder(record)
            self._now_s = record.batch.t_s
            self._report_end(self._recorder)
        ended = self._has_ended
        self._has_ended = record.status.state in ENDED
        is_over = self._is_of_mission and self._has_ended and not ended
        if is_over or "stop_recording" in words:
            self.close()

    @property
    def ended_because(self) -> str:
        """Why the last recording ended before its end was requested; empty where it did not."""
        return self._ended_because

    @property
    def name(self) -> str:
        """The folder that is being written; empty while nothing is recorded."""
        is_on = self._recorder is not None and not self._recorder.ended_because
        return self.folder.name if is_on and self.folder is not None else ""

    def truth(self, t_s: float, pose: Pose, twist: tuple[float, float]) -> None:
        if self._recorder is not None and t_s >= self._next_truth_s:
            self._next_truth_s = t_s + TRUTH_PERIOD_S
            self._recorder.truth(t_s, pose, twist)

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        if self._recorder is not None:
            self._recorder.attach(name, media_type, data)

    def fill_disk(self, *, is_full: bool) -> None:
        """Let the disk count as full, as a fault."""
        if self._recorder is not None:
            self._recorder.fill_disk(is_full=is_full)

    def close(self) -> None:
        """Safe to call twice."""
        if self._recorder is not None:
            self._recorder.close()
            self._report_end(self._recorder)
        self._recorder, self._is_of_mission = None, False

    def _report_end(self, recorder: RunRecorder) -> None:
        if recorder.ended_because and not self._ended_because:
            self._ended_because = recorder.ended_because
            self._say(
                self._now_s, f"recording ended early: {self._ended_because}; the robot drives on"
            )

    def _start(self, t_s: float) -> None:
        if self._recorder is not None and not self._recorder.ended_because:
            return
        self.close()
        try:
            self._begin(_free_folder(self._run.out_dir))
        except RecordingError as error:
            self._say(t_s, f"no recording: {error}")

    def _begin(self, folder: FilePath) -> None:
        run = self._run
        recorder = RunRecorder(
            folder / FILE_NAME, run.config, run.robot, self._urdf,
            goals_map_m=run.shown_goals_map_m, weed_map=run.plants,
        )  # fmt: skip
        for name, (media_type, data) in self._files.items():
            recorder.attach(name, media_type, data)
        self._recorder, self.folder, self._path = recorder, folder, None
        self._ended_because = ""

    def _follow_path(self, t_s: float, recorder: RunRecorder) -> None:
        path = self._run.planned_path
        if path is not None and path is not self._path:
            self._path = path
            recorder.set_plan(t_s, path, self._run.shown_goals_map_m)


def files_to_run_again(
    goals_map_m: Sequence[tuple[float, float]],
    saved: SavedMission | None,
    earlier_plants: Sequence[Track],
    plan_text: str,
    prescription: bytes = b"",
    plants: bytes = b"",
) -> dict[str, tuple[str, bytes]]:
    """Collect what a recording needs besides its ticks, by name and with its media type."""
    files = {
        GOALS_ATTACHMENT: ("application/json", msgspec.json.encode(tuple(goals_map_m))),
        SAVED_ATTACHMENT: ("application/json", msgspec.json.encode(saved)),
        EARLIER_ATTACHMENT: ("application/json", msgspec.json.encode(tuple(earlier_plants))),
    }
    if plan_text:
        files[PLAN_ATTACHMENT] = ("application/geo+json", plan_text.encode())
    if prescription:
        files[PRESCRIPTION_ATTACHMENT] = ("application/octet-stream", prescription)
    if plants:
        files[PLANTS_ATTACHMENT] = ("application/json", plants)
    return files


def _free_folder(out_dir: FilePath) -> FilePath:
    """Find the run's folder where it holds no recording, else the next free one beside it."""
    folder, number = out_dir, 1
    while (folder / FILE_NAME).exists() or (number > 1 and folder.exists()):
        number += 1
        folder = out_dir.with_name(f"{out_dir.name}-{number}")
    return folder
