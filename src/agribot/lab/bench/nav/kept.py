"""Missions that are finished on disk, so that a long benchmark goes on where it was interrupted."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec

from agribot.core.errors import ConfigError, RecordingError
from agribot.core.version import __version__
from agribot.lab.bench.nav.job import Job
from agribot.lab.bench.nav.judge import Outcome
from agribot.lab.bench.nav.scenario import Scenario


class _Block(msgspec.Struct, frozen=True, kw_only=True):
    """One line of the file."""

    version: str
    scenario: Scenario
    is_original: bool
    has_level: bool
    outcomes: tuple[Outcome, ...]


class KeptMissions:
    """A file of one line for each block of missions; what is asked for again is read from it."""

    def __init__(self, path: Path) -> None:
        """Read what the file holds, if there is one; a last line that was cut off does not count.

        Raises: ConfigError: it is no such file, or of another version.
        """
        self._path = path
        self._found: dict[tuple[bytes, bool, bool], dict[int, Outcome]] = {}
        try:
            content = path.read_bytes() if path.exists() else b""
        except OSError as error:
            raise ConfigError(
                f"--keep {path}: cannot be read: {error.strerror or error}"
            ) from error
        self._whole_bytes = content.rfind(b"\n") + 1
        for number, line in enumerate(content[: self._whole_bytes].splitlines(), 1):
            try:
                block = msgspec.json.decode(line, type=_Block)
            except msgspec.MsgspecError as error:
                raise ConfigError(
                    f"--keep {path}: line {number} holds no missions ({error}); give another file"
                ) from error
            if block.version != __version__:
                raise ConfigError(
                    f"--keep {path}: missions of version {block.version}, this is {__version__}; "
                    "give another file"
                )
            self._remember(block)

    def find(self, job: Job) -> dict[int, Outcome]:
        """Return the finished missions of a job's scenario, whatever its seeds, by seed."""
        return self._found.get(_name(job.scenario, job), {})

    def add(self, job: Job, outcomes: Sequence[Outcome]) -> None:
        """Append missions to the file.

        Raises: RecordingError: it cannot be written.
        """
        block = _Block(
            version=__version__, scenario=job.scenario, is_original=job.is_original,
            has_level=job.has_level, outcomes=tuple(outcomes),
        )  # fmt: skip
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with self._path.open("ab") as file:
                file.truncate(self._whole_bytes)
                file.write(msgspec.json.encode(block) + b"\n")
                self._whole_bytes = file.tell()
        except OSError as error:
            raise RecordingError(
                f"cannot write {self._path}: {error.strerror or error}; make room and run the same "
                "command again"
            ) from error
        self._remember(block)

    def _remember(self, block: _Block) -> None:
        found = self._found.setdefault(_name(block.scenario, block), {})
        found.update((outcome.seed, outcome) for outcome in block.outcomes)


def _name(scenario: Scenario, what: Job | _Block) -> tuple[bytes, bool, bool]:
    return msgspec.json.encode(scenario), what.is_original, what.has_level
