"""A process that records as fast as it can and says after each tick how far it is, until killed."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from agribot.core.config import load
from agribot.record.recorder import RunRecorder
from tests.record import record_samples as samples


def main() -> None:
    path = Path(sys.argv[1])
    recorder = RunRecorder(path, load("farm"), samples.robot(), samples.URDF, samples.plan())
    records = samples.ticks(3000, seed=2)
    for record in records:
        recorder(record)
        os.write(1, f"{record.batch.t_s!r}\n".encode())
    recorder.close()


if __name__ == "__main__":
    main()
