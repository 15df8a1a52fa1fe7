"""Missions that are finished on disk, so that a long benchmark goes on where it was interrupted."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path

import msgspec

from agribot.core.errors import MAKE_ROOM, ConfigError, explain_os_error
from agribot.lab.bench.nav.job import Job
from agribot.lab.bench.nav.judge import Outcome
from agribot.lab.bench.nav.scenario import Scenario

# Folders that decide about a mission: the robot, its sensors, the benchmark.
DECIDING = ("autonomy", "core", "sim/sensors", "lab/bench/nav", "description/urdf")


class _Block(msgspec.Struct, frozen=True, kw_only=True):
    """One line of the file."""

    program: str
    scenario: Scenario
    is_original: bool
    outcomes: tuple[Outcome, ...]


class KeptMissions:
    """A file of one line for each block of missions; what is asked for again is read from it."""

    def __init__(self, path: Path) -> None:
        """Read what the file holds, if there is one; a last line that was cut off does not count.

        Raises: ConfigError: it is no such file, or another program drove its missions.
        """
        self._path, self._program = path, identify_program()
        self._found: dict[tuple[bytes, bool], dict[int, Outcome]] = {}
        with explain_os_error(
            f"{path}: cannot be read", "name another folder with --out", ConfigError
        ):
            content = path.read_bytes() if path.exists() else b""
        self._whole_bytes = content.rfind(b"\n") + 1
        for number, line in enumerate(content[: self._whole_bytes].splitlines(), 1):
            try:
                block = msgspec.json.decode(line, type=_Block)
            except msgspec.MsgspecError as error:
                raise ConfigError(
                    f"{path}: line {number} holds no missions ({error}); give another --out"
                ) from error
            if block.program != self._program:
                raise ConfigError(
                    f"{path}: its missions were driven by the program {block.program}, this is "
                    f"{self._program}; give another --out"
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
            program=self._program, scenario=job.scenario, is_original=job.is_original,
            outcomes=tuple(outcomes),
        )  # fmt: skip
        with explain_os_error(f"cannot write {self._path}", MAKE_ROOM):
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with self._path.open("ab") as file:
                file.truncate(self._whole_bytes)
                file.write(msgspec.json.encode(block) + b"\n")
                self._whole_bytes = file.tell()
        self._remember(block)

    def _remember(self, block: _Block) -> None:
        found = self._found.setdefault(_name(block.scenario, block), {})
        found.update((outcome.seed, outcome) for outcome in block.outcomes)


def _name(scenario: Scenario, what: Job | _Block) -> tuple[bytes, bool]:
    return msgspec.json.encode(scenario), what.is_original


def identify_program() -> str:
    """Return a short digest of all files that decide about a mission."""
    digest = hashlib.sha256()
    for folder in DECIDING:
        _digest(resources.files("agribot").joinpath(folder), digest)
    return digest.hexdigest()[:12]


def _digest(place: Traversable, digest: hashlib._Hash) -> None:
    for entry in sorted(place.iterdir(), key=lambda each: each.name):
        if entry.is_dir():
            _digest(entry, digest)
        elif entry.name.endswith((".py", ".toml", ".xacro", ".urdf")):
            digest.update(entry.name.encode() + entry.read_bytes())
