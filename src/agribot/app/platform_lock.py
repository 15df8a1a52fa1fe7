"""One program for each robot: who drives a platform holds a lock until its process ends."""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
from pathlib import Path

from agribot.app.run_folder import open_locked
from agribot.core.errors import PlatformError, explain_os_error


class PlatformLock:
    """Claims a platform of this computer by its name; the lock of a dead process is free.

    Raises: PlatformError: another process drives it.
    """

    def __init__(self, platform: str, folder: Path | None = None) -> None:
        """`folder` holds the locks of all users; None: that of the system's temporary files."""
        digest = hashlib.sha256(platform.encode()).hexdigest()[:16]
        where = Path(tempfile.gettempdir()) if folder is None else folder
        self._path = where / f"agribot-{digest}.lock"
        with explain_os_error(
            f"cannot make sure that no other program drives platform = '{platform}': {self._path}",
            "look who owns that file",
            PlatformError,
        ):
            lock = open_locked(self._path)
        if lock is None:
            raise PlatformError(
                f"another agribot{_name_holder(self._path)} drives platform = '{platform}'; "
                "wait for its end, or stop it"
            )
        self._file = lock
        with contextlib.suppress(OSError):  # other users must be able to try it
            self._path.chmod(0o666)
        self._file.truncate(0)
        self._file.write(f"{os.getpid()}".encode())
        self._file.flush()

    def close(self) -> None:
        """Safe to call twice. The file stays: who waits for it must not lock another one."""
        if not self._file.closed:
            self._file.truncate(0)
            self._file.close()


def _name_holder(path: Path) -> str:
    """Name the process that wrote itself into a lock."""
    with contextlib.suppress(OSError):
        text = path.read_text(encoding="ascii", errors="replace").strip()
        if text.isdigit():
            return f" (process {text})"
    return ""
