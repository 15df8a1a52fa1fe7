"""A robot in the simulator, its page in a process of its own, and what happens when that dies."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from agribot.app.simulated_run import SimulatedRun, simulate
from agribot.cli.run.page import Pacer
from agribot.core import config
from agribot.core.messages import TickRecord
from agribot.ui import wire
from agribot.ui.address import Address
from agribot.ui.robot_side import server_process
from agribot.ui.robot_side.operator_page import OperatorPage
from tests import nightly
from tests.ui.client import Page
from tests.waiting import PATIENCE_S, wait_for

SETTINGS = ["perception.enabled=false", "seed=1"]
LOST = "operator lost (the page's server)"


@contextmanager
def simulated(folder: Path, *settings: str) -> Iterator[tuple[SimulatedRun, OperatorPage, Page]]:
    loaded = config.load("farm", [*SETTINGS, *settings])
    with (
        simulate(loaded, folder / "run") as session,
        OperatorPage(session, Address(port=0)) as page,
        Page(page.server.port) as browser,
    ):
        browser.take_seat()
        yield session, page, browser


def drive(
    session: SimulatedRun, browser: Page | None, seconds: float, v_mps: float = 0.3
) -> list[TickRecord]:
    """Ticks at the pace of the clock, with a hand on the stick when a page is given."""
    ticks, records = session.ticks(), []
    from_s = session.last.batch.t_s if session.last else 0.0
    pacer, next_s = Pacer(1.0), from_s
    for record in ticks:
        records.append(record)
        if browser is not None and record.batch.t_s >= next_s:
            next_s += 0.05
            mono_ms = 1e3 * time.monotonic()
            browser.send(wire.DriveByHand(v_mps=v_mps, yaw_rate_radps=0.0, mono_ms=mono_ms))
        if record.batch.t_s >= from_s + seconds:
            break
        pacer.wait(record.batch.t_s)
    return records


def drive_until(
    session: SimulatedRun,
    is_so: Callable[[TickRecord], object],
    browser: Page | None = None,
    meanwhile: Callable[[], object] = lambda: None,
) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while session.last is None or not is_so(session.last):
        assert time.monotonic() < end_s, session.last
        meanwhile()
        drive(session, browser, 0.1)


def drive_by_hand(session: SimulatedRun, browser: Page) -> None:
    """Until it drives; a page on a busy machine lets go for a moment now and then."""
    drive_until(session, lambda record: record.command.drive.v_mps > 0.1, browser)


def stopped_after_s(records: list[TickRecord]) -> float:
    """From the first record until the robot is commanded to stand still for good."""
    moving = [r.batch.t_s for r in records if r.command.drive.v_mps != 0.0]
    return (moving[-1] if moving else records[0].batch.t_s) - records[0].batch.t_s


def test_the_robot_stands_soon_after_its_operators_line_is_cut(tmp_path: Path) -> None:
    with simulated(tmp_path) as (session, _, browser):
        drive_by_hand(session, browser)
        browser.line.socket.close()
        assert stopped_after_s(drive(session, None, 1.0)) <= 0.5


def test_the_robot_stands_soon_after_the_page_falls_silent(tmp_path: Path) -> None:
    with simulated(tmp_path) as (session, _, browser):
        drive_by_hand(session, browser)
        assert stopped_after_s(drive(session, None, 1.0)) <= 0.5


@nightly.one_by_one("after", [("pause", "paused"), ("continue", "running")], in_suite=1)
def test_a_killed_server_stops_the_hand_and_the_mission_goes_on_as_configured(
    tmp_path: Path, after: tuple[str, str]
) -> None:
    policy, state = after
    with simulated(tmp_path, f'safety.on_operator_lost="{policy}"') as (session, page, browser):
        drive_by_hand(session, browser)
        resume_until_it_runs(session, browser)
        assert page.server.process.pid is not None
        os.kill(page.server.process.pid, signal.SIGKILL)
        drive_until(session, lambda _: LOST in reasons(session))
        assert drive(session, None, 0.2)[-1].status.state == state


def test_a_server_that_hangs_counts_as_the_loss_of_the_operator_who_goes_on_afterwards(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server_process, "HANG_S", PATIENCE_S)
    with simulated(tmp_path, 'safety.on_operator_lost="pause"') as (session, page, browser):
        resume_until_it_runs(session, browser)
        pid = page.server.process.pid
        assert pid is not None

        def hang() -> None:  # again, where something else let it go on
            os.kill(pid, signal.SIGSTOP)

        drive_until(session, lambda _: LOST in reasons(session), meanwhile=hang)
        drive_until(session, lambda record: record.status.state == "paused", meanwhile=hang)
        os.kill(pid, signal.SIGCONT)
        resume_until_it_runs(session, browser)


def reasons(session: SimulatedRun) -> list[str]:
    return [event.reason for event in session.event_log.events]


def resume_until_it_runs(session: SimulatedRun, browser: Page) -> None:
    def resume() -> None:
        browser.send(wire.ControlMission(action="resume"))

    drive_until(session, lambda record: record.status.state == "running", meanwhile=resume)


def test_a_hand_on_the_stick_when_the_server_is_killed_lets_go(tmp_path: Path) -> None:
    with simulated(tmp_path) as (session, page, browser):
        drive_by_hand(session, browser)
        assert page.server.process.pid is not None
        os.kill(page.server.process.pid, signal.SIGKILL)
        assert stopped_after_s(drive(session, None, 1.0)) <= 0.5


def test_a_stop_by_the_page_holds_until_it_is_cleared(tmp_path: Path) -> None:
    with simulated(tmp_path) as (session, _, browser):
        drive_by_hand(session, browser)
        browser.send(wire.PressStop())
        drive_until(session, lambda record: record.status.stopped, browser)
        records = drive(session, browser, 1.0)
        assert {record.command.drive.v_mps for record in records[1:]} == {0.0}
        state = browser.receive(wire.State)
        while state.mode != "stopped":
            state = browser.receive(wire.State)
        assert "stopped by operator 1" in state.stop
        assert browser.ask(wire.ClearStop()).ok
        drive_by_hand(session, browser)


def test_a_simulation_ahead_of_the_clock_waits_for_a_hand(tmp_path: Path) -> None:
    with simulated(tmp_path) as (session, page, browser):
        drive_until(session, lambda _: page.pace_limit == 1.0, browser)
        wait_for(lambda: page.pace_limit > 1.0, "the simulation to run ahead again")
