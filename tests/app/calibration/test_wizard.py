"""A calibration drives through the mux like a hand: it ends well, and at every objection."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest.mock import ANY

import msgspec
import pytest

from agribot.app.calibration.kinds import KINDS
from agribot.app.calibration.measured_robot import apply_calibration
from agribot.app.calibration.robot_file import RobotFile
from agribot.app.calibration.wizard import Wizard
from agribot.app.rerun import compare_passes, read_pass, rerun
from agribot.app.simulated_run import simulate
from agribot.core import config
from agribot.core.facts import (
    NoResult,
    NoSuchCalibration,
    RobotDrives,
    SensorSilent,
    StoppedBy,
    StopToClear,
)
from agribot.core.messages import STOP, Inbox, TickRecord, Who
from agribot.description.loader import load_robot
from tests import nightly
from tests.asking import BY_WORD
from tests.finding import is_like
from tests.waiting import wait_for

SETTINGS = (
    'world="empty"',
    "perception.enabled=false",
    "mission.waits_for_goals=true",
    "sim.sensors=rtk",
    "field.start_map_m=[0.0,0.0]",
    "field.start_yaw_deg=90.0",
    "field.obstacles_map_m=[]",
)
CHEAP = ("sim.sensors=m8n", "safety.max_pos_std_m=50.0")


class Bench:
    """A simulated robot on empty ground with a wizard, ticked by the test."""

    def __init__(self, folder: Path, *settings: str) -> None:
        self.config = config.load("farm", [*SETTINGS, *settings])
        self.session = simulate(self.config, folder / "run")
        self.file = RobotFile(folder / "home", self.config.robot)
        session = self.session
        self.wizard = Wizard(session.inbox, session.robot, self.config, self.file)
        session.add_tap(self.wizard)
        self._ticks: Iterator[TickRecord] = session.ticks()

    def do(self, what: str, kind: str = "") -> dict[str, Any]:
        return self.wizard.answer({"do": what, "kind": kind, "by": "Anna"})

    def post(self, action: Any) -> None:
        self.session.inbox.post(BY_WORD[action], Who("Bert"))

    def tick_until(self, is_it: Callable[[TickRecord], bool], limit_s: float = 400.0) -> TickRecord:
        for record in self._ticks:
            if is_it(record):
                return record
            assert record.batch.t_s < limit_s, "it did not come to that"
        raise AssertionError("the run ended before")

    def stand_ready(self) -> None:
        """A calibration needs no position: it is what may give one."""
        self.tick_until(lambda record: record.batch.t_s > 1.0)

    def phase(self) -> str:
        now = self.wizard.describe_progress()
        return now["phase"] if now else "idle"

    def drive_to_the_end(self, kind: str) -> dict[str, Any]:
        self.stand_ready()
        assert self.do("start", kind)["refusal"] is None
        self.tick_until(lambda _: self.phase() != "driving")
        return self.wait_for_result()

    def wait_for_result(self) -> dict[str, Any]:
        wait_for(lambda: self.phase() != "computing", "the result")
        return self.do("look")


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    made = Bench(tmp_path, "record.enabled=false")
    with made.session:
        yield made


@nightly.by_day(
    "test_the_compass_is_better_against_the_gyro_after_than_before",
    "tests/sim/test_drive_calibration.py::test_command_says_how_wrong_the_description_is",
    "tests/app/calibration/test_robot_file.py::test_a_run_believes_the_file_and_an_option_more",
)
def test_a_wheel_of_another_size_is_found_and_taken_over_by_the_next_run(tmp_path: Path) -> None:
    bench = Bench(tmp_path, "calibration.wheel_radius_m=0.1")
    with bench.session as session:
        found = bench.drive_to_the_end("drive")["found"]
        assert found["ok"], found["reasons"]
        radius = next(change for change in found["changes"] if change["label"] == "Wheel radius")
        assert radius["before"] == 0.1
        assert radius["after"] == pytest.approx(0.0888, abs=0.003)
        assert bench.do("accept")["refusal"] is None
        session.finish("enough")
    (path,) = (tmp_path / "run").glob("run.mcap")
    before = read_pass(path)
    again, _ = rerun(path, bench.config)
    assert compare_passes(before, again).first is None  # bit by bit, the drive included
    next_run = config.load("farm", [*SETTINGS, *bench.file.settings()])
    assert next_run.calibration.wheel_radius_m == pytest.approx(radius["after"], abs=1e-5)
    believed = apply_calibration(load_robot(), next_run.calibration)
    assert believed.drive.wheel_radius_m == next_run.calibration.wheel_radius_m


def test_the_compass_is_better_against_the_gyro_after_than_before(tmp_path: Path) -> None:
    bench = Bench(tmp_path, "record.enabled=false", *CHEAP)
    with bench.session:
        bench.stand_ready()
        assert bench.do("start", "magnetometer")["refusal"] is None
        seen = [0]
        while bench.phase() == "driving":
            bench.tick_until(lambda record: True)
            seen.append(sum((bench.wizard.describe_progress() or {})["directions"]))
        found = bench.wait_for_result()["found"]
        assert bench.do("accept")["refusal"] is None
    assert found["ok"], found["reasons"]
    next_run, wanted = (
        config.load("farm", [*SETTINGS, *measured]).estimate
        for measured in (bench.file.settings(), found["settings"])
    )
    assert next_run == wanted != bench.config.estimate
    assert seen == sorted(seen) and 1 <= seen[100] <= 3  # standing, then a straight leg
    assert seen[-1] == found["changes"][-1]["after"] == 36
    scatter = found["changes"][0]
    assert scatter["after"] < scatter["before"]
    before_deg, after_deg = (max(map(abs, side)) for side in found["errors_deg"])
    assert after_deg < before_deg < 4.0 * scatter["before"]
    assert [text.partition("=")[0] for text in found["settings"]] == [
        "estimate.mag_offset_t",
        "estimate.mag_shape",
    ]


def test_a_motor_without_power_is_named(bench: Bench) -> None:
    bench.session.simulator.limit_torque("left_wheel_F", 0.0)
    bench.session.simulator.limit_torque("right_wheel_R", 0.0)
    found = bench.drive_to_the_end("motors")["found"]
    assert found is not None
    assert bench.do("accept")["refusal"] == NoResult()  # nothing to take over


def test_a_fit_that_fails_as_nobody_foresaw_ends_the_calibration_and_lets_another_begin(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> Any:
        raise ZeroDivisionError("float division by zero")

    monkeypatch.setitem(KINDS, "motors", KINDS["motors"]._replace(find=fail))
    now = bench.drive_to_the_end("motors")["now"]
    assert now["phase"] == "failed" and "ZeroDivisionError: float division" in now["reason"]
    assert bench.tick_until(lambda record: record.command.drive == STOP)
    assert bench.do("start", "motors")["refusal"] is None


@pytest.mark.parametrize("action", ["stop", "pause", "resume", "goto", "cancel"])
def test_whatever_else_is_asked_of_the_robot_ends_it_at_once(bench: Bench, action: str) -> None:
    bench.stand_ready()
    assert bench.do("start", "motors")["refusal"] is None
    bench.tick_until(lambda record: record.command.drive.v_mps > 0.2)
    bench.post(action)
    ended = bench.tick_until(lambda _: bench.phase() == "failed")
    assert "Bert" in bench.do("look")["now"]["reason"]
    still = bench.tick_until(lambda record: record.command.drive == STOP)
    assert still.batch.t_s - ended.batch.t_s < 0.5


def test_a_hand_and_the_loss_of_the_operator_end_it(bench: Bench) -> None:
    takes: dict[str, Callable[[], None]] = {
        "Bert took the robot": lambda: bench.session.inbox.drive(0.1, 0.0, Who("Bert")),
        "Ann is not heard": lambda: bench.wizard.interrupt("Ann is not heard any more"),
    }
    for reason, take in takes.items():
        bench.stand_ready()
        bench.tick_until(lambda record: abs(record.estimate.v_mps) < 0.01)
        assert bench.do("start", "motors")["refusal"] is None
        bench.tick_until(lambda record: record.command.drive.v_mps > 0.2)
        take()
        bench.tick_until(lambda _: bench.phase() == "failed")
        assert reason in bench.do("look")["now"]["reason"]


def test_it_is_refused_while_a_mission_runs_or_a_stop_holds(bench: Bench) -> None:
    bench.stand_ready()
    bench.post("stop")
    bench.tick_until(lambda record: bool(record.batch.requests))
    assert bench.do("start", "motors")["refusal"] == StopToClear(StoppedBy("Bert"))
    bench.post("clear_stop")
    bench.post("resume")
    bench.tick_until(lambda record: record.status.state == "running")
    assert bench.do("start", "motors")["refusal"] == RobotDrives()
    assert is_like(bench.do("start", "tyres")["refusal"], NoSuchCalibration("tyres", ANY))


def test_a_robot_that_is_held_gives_up_and_says_why(bench: Bench) -> None:
    """A board that hears no wheels: the supervisor holds, and the drive does not wait for ever."""
    bench.stand_ready()
    bench.do("start", "motors")
    bench.tick_until(lambda record: record.command.drive.v_mps > 0.2)
    simulator = bench.session.simulator

    class Deaf:
        inbox = simulator.inbox

        def read(self) -> Any:
            return msgspec.structs.replace(simulator.read(), wheels=())

        def write(self, command: Any) -> None:
            simulator.write(command)

        def close(self) -> None: ...

    bench.session.platform = Deaf()
    ended = bench.tick_until(lambda _: bench.phase() == "failed")
    assert is_like(ended.status.stopped_fact, SensorSilent("wheels", ANY, ANY, ANY))
    assert bench.do("look")["now"]["reason"] == ended.status.stopped, "at once, in its own words"
    still = bench.tick_until(lambda record: record.command.drive == STOP)
    assert still.batch.t_s == pytest.approx(ended.batch.t_s, abs=0.05)


@pytest.mark.parametrize("lacks", ["mag", "preset", "camera"])
def test_a_robot_is_offered_no_calibration_of_what_it_does_not_have(
    lacks: str, tmp_path: Path
) -> None:
    robot = load_robot("agribot")
    if lacks != "preset":
        robot = msgspec.structs.replace(robot, **{lacks: None})
    sensors = "m8n-1" if lacks == "preset" else "m8n"
    settings = config.load("farm", [*SETTINGS, f"sim.sensors={sensors}"])
    wizard = Wizard(Inbox(), robot, settings, RobotFile(tmp_path, "agribot"))
    absent = {"camera", "row-view"} if lacks == "camera" else {"magnetometer"}
    offered_in_order = [kind["name"] for kind in wizard.answer({})["kinds"]]
    assert {*offered_in_order} == {*KINDS} - absent
    for name in absent:
        told = wizard.answer({"do": "start", "kind": name, "by": "Anna"})
        assert told["refusal"] == NoSuchCalibration(name, ", ".join(offered_in_order))
