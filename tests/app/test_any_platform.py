"""A run drives any platform that its settings name, also one without ground truth."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import pytest

from agribot.app.open_run import open_run
from agribot.app.platform_lock import PlatformLock
from agribot.app.rerun import read_pass, rerun
from agribot.app.simulated_run import SimulatedRun
from agribot.autonomy.plan.mission import mission
from agribot.autonomy.plan.mission.job_start import plan_job
from agribot.autonomy.plan.tasks.row_task import RowTask
from agribot.cli.main import main
from agribot.core import config, platforms
from agribot.core.errors import ConfigError, PlatformError
from agribot.core.facts import StoppedBy
from agribot.core.messages import Inbox, PressStop, RobotCommand, SensorBatch, Who

BENCH = '''
from agribot.core.messages import (
    GnssFix, GnssQuality, ImuSample, Inbox, MagSample, SensorBatch, WheelSample,
)

class Bench:
    """A robot on blocks: its sensors speak, it stays where it is."""

    def __init__(self, config, robot):
        self.inbox, self.tick, self.is_closed = Inbox(), 0, False
        self.datum = config.field.datum

    def read(self):
        self.tick += 1
        t_s = self.tick * 0.02
        requests, hand = self.inbox.drain(t_s)
        fix = GnssFix(t_s=t_s, lat_deg=self.datum.lat_deg, lon_deg=self.datum.lon_deg,
                      alt_m=self.datum.alt_m, pos_std_m=0.02, quality=GnssQuality.RTK_FIXED)
        return SensorBatch(
            t_s=t_s, requests=requests, hand=hand,
            wheels=(WheelSample(t_s=t_s, angle_rad=(0.0,) * 4, speed_radps=(0.0,) * 4),),
            imu=(ImuSample(t_s=t_s, gyro_radps=(0.0,) * 3, accel_mps2=(0.0, 0.0, 9.81)),),
            mag=(MagSample(t_s=t_s, field_t=(0.0, 3e-5, -3e-5)),) if self.tick % 5 == 0 else (),
            gnss=(fix,) if self.tick % 10 == 0 else (),
        )

    def write(self, command):
        self.command = command

    def close(self):
        self.is_closed = True
'''
SETTINGS = ["perception.enabled=false", "duration_s=3"]


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The name of a platform that is one file of somebody's own."""
    (tmp_path / "my_bench.py").write_text(BENCH)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(platforms, "_KINDS", dict(platforms._KINDS))
    platforms.register_platform("bench", "my_bench:Bench")
    return "bench"


def test_a_platform_of_ones_own_is_one_file_and_a_registration(bench: str, tmp_path: Path) -> None:
    settings = config.load("farm", [f"platform={bench}", *SETTINGS])
    with open_run(settings, tmp_path / "run") as run:
        assert not isinstance(run, SimulatedRun)
        ticks = list(run.ticks())
        report = run.finish()
    estimate = ticks[-1].estimate
    assert math.hypot(estimate.x_map_m, estimate.y_map_m) < 0.2  # the stack took its sensors
    assert run.platform.is_closed  # type: ignore[attr-defined]
    assert "3 s, as asked" in report.reason


def test_a_second_program_on_the_same_platform_is_refused_until_the_first_has_ended(
    bench: str, tmp_path: Path
) -> None:
    settings = config.load("farm", [f"platform={bench}", *SETTINGS])
    with open_run(settings, tmp_path / "first"):
        with pytest.raises(
            PlatformError, match=f"process {os.getpid()}\\) drives platform = 'bench'"
        ):
            open_run(settings, tmp_path / "second")
        assert not (tmp_path / "second").exists()
    with open_run(settings, tmp_path / "second") as run:
        assert next(run.ticks()).batch.t_s > 0.0
    broken = config.load("farm", ["platform=my_bench:no_such", *SETTINGS])
    for _ in range(2):
        with pytest.raises(ConfigError, match="no_such"):
            open_run(broken, tmp_path / "third")


def test_the_lock_of_a_process_that_was_killed_is_nobodys(tmp_path: Path) -> None:
    code = (
        "import sys, time; from pathlib import Path; "
        "from agribot.app.platform_lock import PlatformLock; "
        "lock = PlatformLock('robot', Path(sys.argv[1])); print('held', flush=True); time.sleep(60)"
    )
    words = [sys.executable, "-c", code, str(tmp_path)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(PlatformError, match=f"process {holder.pid}"):
            PlatformLock("robot", tmp_path)
        PlatformLock("another robot", tmp_path).close()
        holder.kill()
    lock = PlatformLock("robot", tmp_path)
    lock.close()
    lock.close()


@pytest.mark.figures
def test_a_report_without_truth_has_nulls_where_only_the_truth_could_tell(
    bench: str, tmp_path: Path
) -> None:
    words = ["run", "farm", "--platform", bench, "--out", str(tmp_path / "run")]
    main([*words, *(word for setting in SETTINGS for word in ("--set", setting))])
    report = json.loads((tmp_path / "run" / "report.json").read_text())
    by = report["tracking"].pop("plants_crushed_by")
    assert set(report["tracking"].values()) == {None} == set((by or {"": None}).values())
    assert set(report["estimate"].values()) == {None}
    assert report["mission"]["coverage_ratio"] is None
    assert report["mission"]["rows_total"] == 6  # what the robot knows itself stays
    assert report["mission"]["rows_done"] == 0
    assert not report["ok"]
    assert (tmp_path / "run" / "report.html").exists()


def test_a_drive_without_truth_replays_to_the_same_commands(
    bench: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with open_run(config.load("farm", [f"platform={bench}", *SETTINGS]), tmp_path / "run") as run:
        list(run.ticks())
        run.finish()
    assert main(["replay", str(tmp_path / "run" / "run.mcap")]) == 0
    assert "identical" in capsys.readouterr().out


def test_a_plan_that_was_late_is_late_again_in_a_replay(
    bench: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def plan_slowly(*words: Any) -> Any:
        time.sleep(0.2)  # many ticks of a bench that nothing slows down
        return plan_job(*words)

    monkeypatch.setattr(mission, "plan_job", plan_slowly)
    monkeypatch.setattr(RowTask, "planning_s", 0.1)  # beside the loop, as that of a field plan
    start = ["field.start_map_m=[0,0]", "field.start_yaw_deg=0", "field.obstacles_map_m=[]"]
    settings = config.load("farm", [f"platform={bench}", *SETTINGS, *start])
    with open_run(settings, tmp_path / "run") as run:
        list(run.ticks())
        run.finish()
    before = read_pass(tmp_path / "run" / "run.mcap")
    late = [tick.is_plan_late for tick in before]
    assert any(late) and not all(late), {(t.status.state, t.status.reason) for t in before}
    again, _ = rerun(tmp_path / "run" / "run.mcap", settings)
    assert [tick.status for tick in again] == [tick.status for tick in before]
    assert [tick.is_plan_late for tick in again] == late


def test_a_platform_may_be_named_by_module_and_function(bench: str, tmp_path: Path) -> None:
    with open_run(
        config.load("farm", ["platform=my_bench:Bench", *SETTINGS]), tmp_path / "run"
    ) as run:
        assert next(run.ticks()).batch.t_s == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("banana", "known: sim"),
        ("no_such_module:open", "No module named 'no_such_module'"),
        ("json:no_such_name", "has no attribute 'no_such_name'"),
        ("json:__name__", "is not a function but str"),
        ("os:system", "does not take the settings of the run and the robot"),
    ],
)
def test_a_platform_that_is_none_is_refused_before_anything_is_written(
    name: str, words: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match="platform = ") as refusal:
        open_run(config.load("farm", [f"platform='{name}'", *SETTINGS]), tmp_path / "run")
    assert words in str(refusal.value)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("builtins:isinstance", "'builtins:isinstance' failed: TypeError: isinstance"),
        ("os.path:join", "'os.path:join' failed: TypeError: expected str"),
        ("builtins:print", "gives NoneType, which has no inbox, read, write, close"),
    ],
)
def test_a_function_that_opens_no_platform_is_refused_with_how_to_write_one(
    name: str, words: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=r"docs/contribute/platform\.md") as refusal:
        open_run(config.load("farm", [f"platform='{name}'", *SETTINGS]), tmp_path / "run")
    assert words in str(refusal.value)


def test_a_name_is_registered_once() -> None:
    with pytest.raises(ConfigError, match="'sim' is registered already"):
        platforms.register_platform("sim", lambda config, robot: Silent())


def test_requests_reach_any_platform_through_its_inbox(bench: str, tmp_path: Path) -> None:
    settings = config.load("farm", [f"platform={bench}", *SETTINGS])
    with open_run(settings, tmp_path / "run") as run:
        ticks = run.ticks()
        next(ticks)
        run.inbox.post(PressStop(), Who("a person"))
        assert next(ticks).status.stopped_fact == StoppedBy("a person")
        assert "my_bench" in sys.modules


class Silent:
    """The least that is a platform."""

    def __init__(self) -> None:
        self.inbox = Inbox()

    def read(self) -> SensorBatch:
        return SensorBatch(t_s=0.0)

    def write(self, command: RobotCommand) -> None: ...

    def close(self) -> None: ...
