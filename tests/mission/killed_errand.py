"""A run that is sent to a place and says in every tick where it is; somebody kills it there."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from agribot import config
from agribot.messages import OperatorEvent
from agribot.session import Session

SETTINGS = ["perception.enabled=false", "seed=1", "field.row_count=1", "field.row_length_m=3"]
GOAL = (-1.0, 5.0)


def main() -> None:
    with Session(config.load("farm", SETTINGS), Path(sys.argv[1])) as session:
        for record in session.ticks():
            if round(record.batch.t_s, 2) == 7.0:
                event = OperatorEvent(t_s=0.0, action="goto", source="Ada", numbers=GOAL)
                session.platform.post(event)
            os.write(1, f"{record.status.leg} {record.status.s_m:.2f}\n".encode())


if __name__ == "__main__":
    main()
