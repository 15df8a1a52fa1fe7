"""A real `agribot run` at the pace of the clock, killed without warning at a random moment."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

from agribot.record.bag.info import read_info
from agribot.record.events import read_events
from agribot.record.recovery import recover
from agribot.record.replay import read_ticks

ROOT = Path(__file__).parents[2]


class Killed(NamedTuple):
    """How long the run drove by its own log line for each tick, and what its file kept."""

    ran_s: float
    kept_s: float
    recovered: int
    notes: tuple[str, ...]

    @property
    def lost_s(self) -> float:
        return self.ran_s - self.kept_s


def kill_a_run(out: Path, after_s: float) -> Killed:
    """`after_s` counts from its first recorded second."""
    command = [
        sys.executable, "-m", "tests.record.killed_run", str(out),
    ]  # fmt: skip
    environment = {**os.environ, "PYTHONPATH": f"{ROOT / 'src'}{os.pathsep}{ROOT}"}
    with subprocess.Popen(command, stdout=subprocess.PIPE, cwd=ROOT, env=environment) as process:
        assert process.stdout is not None
        lines = [process.stdout.readline()]  # the first tick
        end_s = time.monotonic() + after_s
        while time.monotonic() < end_s:
            lines.append(process.stdout.readline())
        process.kill()
        lines += process.stdout.readlines()
    ran_s = float([line for line in lines if line.endswith(b"\n")][-1])
    ticks = list(read_ticks(out / "run.mcap"))
    saved = recover(out / "run.mcap", out / "saved.mcap")
    read_events(out / "events.jsonl")
    return Killed(
        ran_s=ran_s,
        kept_s=ticks[-1].batch.t_s if ticks else 0.0,
        recovered=saved.messages,
        notes=(*read_info(out / "saved.mcap").notes, *read_info(out / "saved.mcap").damage),
    )


def main() -> None:
    """The run itself, which says after each tick how far it is."""
    from agribot.app.simulated_run import simulate
    from agribot.cli.run.page import Pacer
    from agribot.core import config

    settings = config.load("farm", ["perception.enabled=false"])
    with simulate(settings, Path(sys.argv[1])) as session:
        pacer = Pacer(1.0)
        for record in session.ticks():
            os.write(1, f"{record.batch.t_s!r}\n".encode())
            pacer.wait(record.batch.t_s)


if __name__ == "__main__":
    main()
