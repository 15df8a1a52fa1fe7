"""AGRIBOT by slower clocks: a machine too busy for real time has more of it between ticks."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence

PACES = (1.0, 0.25, 0.1)  # of the program's clocks, in the order in which they are tried
SLOWLY = """
import runpy, sys, time
pace, sleep = float(sys.argv.pop(1)), time.sleep
def slow(clock):
    begun_s = clock()
    return lambda *_: begun_s + (clock() - begun_s) * pace
time.monotonic, time.time = slow(time.monotonic), slow(time.time)
time.sleep = lambda seconds: sleep(seconds / pace)
runpy.run_module("agribot.cli", run_name="__main__")
"""


def run_agribot(words: Sequence[str], pace: float) -> subprocess.CompletedProcess[str]:
    """Start it at a pace, and wait for its end."""
    program = ["-m", "agribot.cli"] if pace == 1.0 else ["-c", SLOWLY, str(pace)]
    return subprocess.run(
        [sys.executable, *program, *words], capture_output=True, text=True, check=False
    )
