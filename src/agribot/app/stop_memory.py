"""A stop that was not cleared outlives the program, and a machine begins disarmed.

Both are a stop in the inbox before the first tick: the recording holds it, and a replay repeats it.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from pathlib import Path

import msgspec

from agribot.core.errors import PlatformError
from agribot.core.fact_text import render
from agribot.core.facts import AnyFact, Disarmed, Fact, NotCleared, Said
from agribot.core.home import find_machine_file
from agribot.core.messages import AskerKind, ClearStop, Inbox, StopFor, TickRecord, Who
from agribot.core.whole_file import write_at_once

FOLDER = "stops"
START_UP = Who("start-up", AskerKind.PROGRAM)


class RememberedStop(msgspec.Struct, frozen=True, kw_only=True):
    """Why the robot stands, since when, and the folder of the run in which it happened.

    `stopped` is the text of `fact`, and all that earlier versions kept.
    """

    stopped: str
    since: str
    run: str
    platform: str
    fact: AnyFact | None = None


def begin(inbox: Inbox, why: Fact | None) -> None:
    """Let the robot begin stopped for a cause, or cleared without one."""
    inbox.post(ClearStop() if why is None else StopFor(cause=why), START_UP)


class StopMemory:
    """A tap: keeps the stop of a platform in one file for as long as it is not cleared.

    A thread writes, so that a slow disk does not hold up the control loop; `on_failure` gets the
    time and the error. The file belongs to the machine: a run in another folder finds it, too.
    """

    on_failure: Callable[[float, str], None] | None = None

    def __init__(self, platform: str, run: Path) -> None:
        self.path = find_machine_file(FOLDER, platform)
        self._platform, self._run = platform, run
        self._stopped: Fact | None = None
        self._failure = self._reported = ""
        self._writer = ThreadPoolExecutor(max_workers=1, thread_name_prefix="stop-memory")

    def read(self) -> RememberedStop | None:
        """Read what is remembered.

        Raises: PlatformError: the file cannot be read; the robot may have been stopped.
        """
        try:
            return msgspec.json.decode(self.path.read_bytes(), type=RememberedStop)
        except FileNotFoundError:
            return None
        except (OSError, msgspec.DecodeError, UnicodeDecodeError) as error:
            raise PlatformError(
                f"{self.path}, which remembers a stop of this robot, cannot be read: {error}; look "
                "after the robot, and remove the file"
            ) from error

    def hold_back(
        self,
        inbox: Inbox,
        *,
        is_armed: bool,
        is_cleared: bool,
        saved_stop: Fact | None = None,
    ) -> Fact | None:
        """Let the robot begin stopped where it must; returns why, None where it may drive.

        `is_armed` and `is_cleared` are a person's word, `saved_stop` is that of the mission which
        goes on: where the power failed with the stop, it may be all that reached the disk. The
        motor board gets it, too.

        Raises: PlatformError: the file cannot be read.
        """
        remembered = None if is_cleared else self.read()
        why = saved_stop or (None if is_armed else Disarmed())
        if remembered is not None:
            self._stopped = remembered.fact or Said(remembered.stopped)
            why = NotCleared(self._stopped, remembered.since)
        elif is_cleared:
            self._forget()
        begin(inbox, why)
        return why

    def __call__(self, record: TickRecord) -> None:
        stopped = record.status.stopped_fact
        if isinstance(stopped, Disarmed):
            stopped = None
        if isinstance(stopped, NotCleared):
            stopped = stopped.cause
        if stopped != self._stopped:
            self._stopped = stopped
            self._writer.submit(self._keep, stopped)
        if self._failure != self._reported and self.on_failure is not None:
            self._reported = self._failure
            self.on_failure(record.batch.t_s, self._failure)

    def close(self) -> None:
        """Wait for the last write. Safe to call twice."""
        self._writer.shutdown()

    def _keep(self, stopped: Fact | None) -> None:
        since = datetime.now(UTC).isoformat(timespec="seconds")
        kept = RememberedStop(
            stopped=render(stopped), since=since, run=str(self._run.resolve()),
            platform=self._platform, fact=stopped,
        )  # fmt: skip
        try:
            if stopped is not None:
                self.path.parent.mkdir(parents=True, exist_ok=True)
                write_at_once(self.path, msgspec.json.encode(kept), is_synced=True)
            else:
                self._forget()
        except OSError as error:
            self._failure = (
                f"cannot write {self.path}: {error.strerror or error}; a stop is forgotten when "
                "the program ends"
            )

    def _forget(self) -> None:
        self.path.unlink(missing_ok=True)
