"""Run the farm mission from Python and look at every tick.

python examples/01_drive_the_farm.py
"""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import mkdtemp

from agribot.app.session import Session
from agribot.core import config


def main() -> None:
    settings = config.load("farm", ["seed=1", "perception.enabled=false", "duration_s=30"])
    with Session(settings, Path(mkdtemp())) as session:
        for record in session.ticks():
            estimate = record.estimate
            if round(record.batch.t_s * 50) % 250 == 0:
                sys.stdout.write(
                    f"{record.batch.t_s:5.1f} s  East {estimate.x_map_m:+6.2f} m  "
                    f"North {estimate.y_map_m:+6.2f} m  known to {estimate.pos_std_m:.3f} m\n"
                )
        report = session.finish()
    sys.stdout.write(f"{report.reason}; files in {session.out_dir}\n")


if __name__ == "__main__":
    main()
