"""A run that is sent to a place and dies on its way there, as by kill -9."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

from agribot.app.simulated_run import simulate
from agribot.core import config
from agribot.core.messages import Who
from tests.asking import go_to

SETTINGS = ["perception.enabled=false", "seed=1", "field.row_count=1", "field.row_length_m=3"]
GOAL = (-1.0, 5.0)


def main() -> None:
    with simulate(config.load("farm", SETTINGS), Path(sys.argv[1])) as session:
        for record in session.ticks():
            if round(record.batch.t_s, 2) == 7.0:
                session.inbox.post(go_to(GOAL), Who("Ada"))
            # A state is on the disk at least once a second; here it drives 0.3 m in one.
            if record.status.leg == "to the goal" and record.status.s_m > 0.8:
                os.kill(os.getpid(), signal.SIGKILL)


if __name__ == "__main__":
    main()
