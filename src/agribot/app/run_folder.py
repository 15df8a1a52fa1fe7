"""The folder of a run: it belongs to one run, while it drives and ever after."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any, BinaryIO

from agribot.core.errors import OTHER_OUT, RecordingError, explain_os_error

# Files that make a folder that of a run.
RUN_FILES = (
    "run.mcap", "events.jsonl", "mission.json", "job.json", "report.json", "config.toml",
)  # fmt: skip
# Further files of a run; a person may have files of these names, too.
MADE_FILES = ("plan.geojson", "field.geojson", "weeds.geojson", "map.png", "report.html")
LOCK_NAME = "run.lock"


class RunFolder:
    """Claims a folder until it is closed; the system lets go of it if the process is killed.

    Raises: RecordingError: it holds a run or files that a run writes, another process drives one
        in it, or it is read-only.
    """

    def __init__(self, path: Path) -> None:
        check_free(path)
        self._path, self._lock_path = path, path / LOCK_NAME
        self._is_new = not path.exists()
        with explain_os_error(f"cannot write into {path}", OTHER_OUT):
            path.mkdir(parents=True, exist_ok=True)
            lock = open_locked(self._lock_path)
        if lock is None:
            raise _make_driven_error(path)
        self._lock = lock
        try:
            check_free(path)  # another run may have come and gone meanwhile
        except RecordingError:
            self.close()
            raise

    def give_back(self) -> None:
        """As `close`, of a run that never began: the folder is as it was before."""
        with contextlib.suppress(OSError):
            _remove_run(self._path)
        self.close()
        if self._is_new:
            with contextlib.suppress(OSError):  # somebody put something there
                self._path.rmdir()

    def close(self) -> None:
        """Safe to call twice."""
        if not self._lock.closed:
            self._lock.close()
            with contextlib.suppress(OSError):
                self._lock_path.unlink()


def check_free(path: Path) -> None:
    """Refuse a folder with files of a run.

    Raises: RecordingError: the folder holds files that a run would overwrite.
    """
    check_holds_no_run(path)
    held = _list_files(path, MADE_FILES)
    if held:
        raise RecordingError(
            f"{path} holds files that a run writes ({', '.join(held)}); choose another --out "
            "folder, or move them away"
        )


def check_holds_no_run(path: Path) -> None:
    """Refuse a folder with a run.

    Raises: RecordingError: the folder holds a run, whose files another one would overwrite.
    """
    held = _list_files(path, RUN_FILES)
    if held:
        go_on = f", or go on with that run: agribot run --resume {path}"
        raise RecordingError(
            f"{path} holds a run already ({', '.join(held)}); choose another --out folder"
            f"{go_on if 'mission.json' in held else ''}"
        )


def check_not_driven(path: Path) -> None:
    """Refuse a folder in which a process drives a run.

    Raises: RecordingError: a process drives a run in this folder.
    """
    lock_path = path / LOCK_NAME
    if not lock_path.exists():
        return
    try:
        lock = open_locked(lock_path)
    except OSError:
        return  # a folder that cannot be written is not being written
    if lock is None:
        raise _make_driven_error(path)
    lock.close()


def clear_run(path: Path) -> None:
    """Remove the files of a run that is to be repeated from its beginning.

    Raises: RecordingError: a process drives it, or they cannot be removed.
    """
    check_not_driven(path)
    with explain_os_error(f"cannot clear {path}", "name another folder with --out"):
        _remove_run(path)


def _list_files(path: Path, names: tuple[str, ...]) -> list[str]:
    with explain_os_error(f"cannot look into {path}", "name another folder with --out"):
        return [name for name in names if (path / name).exists()]


def _remove_run(path: Path) -> None:
    for name in (*RUN_FILES, *MADE_FILES):
        (path / name).unlink(missing_ok=True)


def _make_driven_error(path: Path) -> RecordingError:
    return RecordingError(
        f"another agribot drives a run in {path}; wait for its end, or choose another folder"
    )


def open_locked(path: Path) -> BinaryIO | None:
    """Lock a file and open it; None where another process has it.

    Raises: OSError: no such place.
    """
    # An existing file may be another user's, which this user cannot create anew.
    file: BinaryIO = path.open("rb+") if path.exists() else path.open("ab")
    try:
        _lock(file)
    except (BlockingIOError, PermissionError):
        file.close()
        return None
    except OSError:
        pass  # this disk knows no locks; the check of the run's files is left
    return file


def _lock(file: BinaryIO) -> None:
    try:
        import fcntl
    except ImportError:  # Windows
        import msvcrt

        system: Any = msvcrt
        system.locking(file.fileno(), system.LK_NBLCK, 1)
    else:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
