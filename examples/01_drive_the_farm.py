"""Run the farm mission from Python and look at every tick.

python examples/01_drive_the_farm.py
"""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import mkdtemp

import agribot


def main() -> None:
    settings = agribot.load("farm", ["seed=1", "perception.enabled=false", "duration_s=30"])
    with agribot.simulate(settings, Path(mkdtemp())) as run:
        for record in run.ticks():
            estimate = record.estimate
            if round(record.batch.t_s * 50) % 250 == 0:
                sys.stdout.write(
                    f"{record.batch.t_s:5.1f} s  East {estimate.x_map_m:+6.2f} m  "
                    f"North {estimate.y_map_m:+6.2f} m  known to {estimate.pos_std_m:.3f} m\n"
                )
        report = run.finish()
    sys.stdout.write(f"{report.reason}; files in {run.out_dir}\n")


if __name__ == "__main__":
    main()
