"""A simulated robot with bridges that waits for goals, driven faster than the clock in a thread."""

from __future__ import annotations

import argparse
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from unittest import mock

from agribot.app.simulated_run import SimulatedRun, simulate
from agribot.cli.run import bridging
from agribot.core import config
from agribot.core.fact_text import render
from agribot.ros import robot_link
from tests.waiting import PATIENCE_S

SETTINGS = ("perception.enabled=false", "record.enabled=false", "mission.waits_for_goals=true")


@contextmanager
def driven_robot(
    out_dir: Path, *options: str, pause_s: float = 0.002, settings: Sequence[str] = SETTINGS
) -> Iterator[SimulatedRun]:
    parser = argparse.ArgumentParser()
    bridging.add_arguments(parser)
    parsed = parser.parse_args(options)
    ticks, over = threading.Event(), threading.Event()

    def drive() -> None:
        for _ in session.ticks():
            ticks.set()
            if over.is_set():
                return
            time.sleep(pause_s)

    with (
        mock.patch.object(robot_link, "PATIENCE_S", PATIENCE_S),  # a busy machine answers late
        simulate(config.load("farm", list(settings)), out_dir) as session,
    ):
        driver = threading.Thread(target=drive, daemon=True)
        with bridging.open_bridges(parsed, session):
            driver.start()
            assert ticks.wait(PATIENCE_S), "the robot does not tick"
            try:
                yield session
            finally:
                over.set()
                driver.join(PATIENCE_S)


def list_texts(session: SimulatedRun, *codes: str) -> list[str]:
    """List the texts of the facts in its log that are, or hold, one of these codes."""
    events = session.event_log.list_since(0)
    return [render(event.fact) for event in events if {event.code, *event.causes} & {*codes}]
