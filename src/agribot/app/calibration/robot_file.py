"""The settings of one robot on disk: what was measured of it, kept from run to run.

Every change keeps the file before it, so that each can be undone, the newest first.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import msgspec
import tomli_w

from agribot.core.config import assign, from_tree
from agribot.core.errors import ConfigError, RecordingError
from agribot.core.toml_tree import read_toml
from agribot.core.whole_file import write_at_once
from agribot.description.package import split_arguments


class RobotFile:
    """`HOME/robots/NAME.toml`; without one, the robot is as described."""

    def __init__(self, home: Path, robot: str) -> None:
        """`robot` is a packaged name or a description's file, as in the settings of a run."""
        name, _ = split_arguments(robot)
        self.path = home / "robots" / f"{Path(name).name.split('.')[0]}.toml"

    def settings(self) -> tuple[str, ...]:
        """List the settings as a.b=c, in the order of the file; empty without a file.

        Raises: ConfigError: broken, or a setting that does not exist or does not fit.
        """
        return tuple(_flatten(self._tree(), ""))

    def add(self, settings: Iterable[str]) -> None:
        """Add settings, keeping the file before as a backup.

        Raises: ConfigError: one that does not fit. RecordingError: it cannot be written.
        """
        tree = self._tree()
        for setting in settings:
            assign(tree, setting)
        from_tree(tree, str(self.path))
        backup = self._backup(self._last_number() + 1)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            before = self.path.read_bytes() if self.path.exists() else b""
            write_at_once(backup, before)
            try:
                write_at_once(self.path, tomli_w.dumps(tree).encode())
            except OSError:
                backup.unlink()  # else it would undo a change that never was
                raise
        except OSError as error:
            raise self._make_error(error) from error

    @property
    def can_undo(self) -> bool:
        return bool(self._backups())

    def undo(self) -> None:
        """Restore the file as it was before its newest change.

        Raises: ConfigError: there is no change to take back. RecordingError: it cannot be written.
        """
        backups = self._backups()
        if not backups:
            raise ConfigError(
                f"{self.path} has no earlier state to go back to; calibrate the robot"
            )
        newest = backups[-1]
        try:
            if newest.stat().st_size:
                newest.replace(self.path)
            else:  # there was no file before
                self.path.unlink(missing_ok=True)
                newest.unlink()
        except OSError as error:
            raise self._make_error(error) from error

    def _make_error(self, error: OSError) -> RecordingError:
        return RecordingError(
            f"cannot write {self.path}: {error.strerror or error}; make room, or point "
            "AGRIBOT_HOME at a folder that you may write"
        )

    def _last_number(self) -> int:
        """Find the number of the newest backup, also where older ones were deleted."""
        backups = self._backups()
        return int(backups[-1].suffix.removeprefix(".bak")) if backups else 0

    def _backup(self, number: int) -> Path:
        return self.path.with_suffix(f".bak{number:04}")

    def _backups(self) -> list[Path]:
        return sorted(self.path.parent.glob(f"{self.path.stem}.bak[0-9][0-9][0-9][0-9]"))

    def _tree(self) -> dict[str, Any]:
        try:
            tree = read_toml(self.path) if self.path.exists() else {}
        except ConfigError as error:
            raise ConfigError(
                f"{self.path} cannot be read: {error}; fix it, or delete it to go back to the "
                "robot's description"
            ) from error
        from_tree(tree, str(self.path))
        return tree


def _flatten(tree: Mapping[str, Any], at: str) -> Iterable[str]:
    for key, value in tree.items():
        if isinstance(value, Mapping):
            yield from _flatten(value, f"{at}{key}.")
        else:
            yield f"{at}{key}={msgspec.json.encode(value).decode()}"
