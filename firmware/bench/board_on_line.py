"""A board on a serial line of this computer, in real time.

`python -m firmware.bench.board_on_line` prints what `--source base=` takes, the line and what its
motors are: serial:/dev/pts/3?counts_per_turn=2048&full_speed_radps=30. The wheels of that board
turn in the air. With `imu`, it is the IMU board, for `--source imu=`.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import queue
import select
import sys
import tempfile
import threading
import time
import tty
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType

from firmware.bench.avr_bench import COUNTS_PER_TURN, AvrBench, build_library, load_library
from firmware.build import PREBUILT

STEP_S = 0.002
FULL_RADPS, LAG_S = 30.0, 0.05  # of a wheel in the air
READ_BYTES = 4096
KINDS = ("motor", "imu")


class BoardOnLine:
    """Runs a board in a thread of its own, between `with` and its end; `path` is the line.

    A program that opens the line resets the board, as on a Mega. A `pace` below one lets its
    time pass slower than ours; `lag_s` of its time is what it has been late at most.
    """

    def __init__(self, bench: AvrBench, pace: float = 1.0) -> None:
        self.bench, self._pace = bench, pace
        self.speed_radps = [0.0, 0.0, 0.0, 0.0]
        self._ours, theirs = os.openpty()
        for end in (self._ours, theirs):
            tty.setraw(end)
        os.set_blocking(self._ours, False)
        self.path = os.ttyname(theirs)
        os.close(theirs)
        self._line = select.poll()
        self._line.register(self._ours, 0)
        self._is_open = False
        self.lag_s = 0.0
        self._ended = threading.Event()
        self._wanted: queue.SimpleQueue[tuple[Callable[[], None], threading.Event]] = (
            queue.SimpleQueue()
        )
        self._thread = threading.Thread(target=self._run, name="board on a line", daemon=True)

    def __enter__(self) -> BoardOnLine:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self.unplug()

    def do(self, act: Callable[[], None]) -> None:
        """Do something to the bench between two of its steps, and wait for it."""
        is_done = threading.Event()
        self._wanted.put((act, is_done))
        is_done.wait()

    def unplug(self) -> None:
        """End the board, and the line with it. Safe to call twice."""
        if not self._ended.is_set():
            self._ended.set()
            self._thread.join()
            os.close(self._ours)

    def _run(self) -> None:
        begun_s = time.monotonic() - self.bench.t_s / self._pace
        while not self._ended.is_set():
            self._look_who_opens()
            self._exchange()
            while not self._wanted.empty():
                act, is_done = self._wanted.get()
                act()
                is_done.set()
            self._move(self.bench.advance(STEP_S, self.speed_radps))
            ahead_s = begun_s + self.bench.t_s / self._pace - time.monotonic()
            self.lag_s = max(self.lag_s, -ahead_s * self._pace)
            time.sleep(max(0.0, ahead_s))

    def _move(self, duty_ratio: Sequence[float]) -> None:
        """Turn the wheels for a step, as their motors drive them."""
        share = STEP_S / LAG_S
        self.speed_radps = [
            speed + (FULL_RADPS * duty - speed) * share
            for speed, duty in zip(self.speed_radps, duty_ratio, strict=True)
        ]

    def _look_who_opens(self) -> None:
        is_open = not any(event & select.POLLHUP for _, event in self._line.poll(0))
        if is_open and not self._is_open:
            self.bench.reset()
        self._is_open = is_open

    def _exchange(self) -> None:
        """Hand on the bytes of both ends; without a reader, the board's are lost."""
        with contextlib.suppress(OSError):  # nothing came, or no program has the line open
            self.bench.send(os.read(self._ours, READ_BYTES))
        said = self.bench.receive()
        with contextlib.suppress(OSError):
            os.write(self._ours, said)


def name_source(path: str, *, is_imu: bool) -> str:
    """Write what `--source` takes for a board on this line."""
    motors = f"?counts_per_turn={COUNTS_PER_TURN:g}&full_speed_radps={FULL_RADPS:g}"
    return f"serial:{path}" + ("" if is_imu else motors)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        prog="python -m firmware.bench.board_on_line",
        description="Run a board's program on a serial line of this computer until Ctrl-C.",
    )
    parser.add_argument("kind", nargs="?", choices=KINDS, default="motor", help="default: motor")
    is_imu = parser.parse_args(arguments).kind == "imu"
    name = "imu_board" if is_imu else "motor_board"
    with tempfile.TemporaryDirectory() as folder:
        library = load_library(build_library(Path(folder)))
        with BoardOnLine(AvrBench(library, PREBUILT / f"{name}.hex")) as board:
            sys.stdout.write(f"{name_source(board.path, is_imu=is_imu)}\n")
            sys.stdout.flush()
            try:
                threading.Event().wait()
            except KeyboardInterrupt:
                sys.stderr.write("unplugged\n")


if __name__ == "__main__":
    main()
