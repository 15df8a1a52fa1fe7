"""The hardware platform drives real firmware over a serial line, in real time."""

from __future__ import annotations

import ctypes
from pathlib import Path

import pytest

from agribot.app.open_run import open_run
from agribot.core import config
from agribot.core.messages import OperatorEvent
from firmware.bench.avr_bench import AvrBench
from firmware.bench.board_on_line import BoardOnLine
from firmware.build import PREBUILT

OPTIONS = "counts_per_turn=2048&full_speed_radps=30"


def test_a_robot_is_armed_driven_by_hand_and_stopped_by_the_red_button_of_its_firmware(
    bench_library: ctypes.CDLL, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("serial", reason="pyserial is missing (pip install 'agribot[hardware]')")
    monkeypatch.setenv("AGRIBOT_HOME", str(tmp_path))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    bench = AvrBench(bench_library, PREBUILT / "motor_board.hex")
    with BoardOnLine(bench) as board:
        base = f"sources.base='serial:{board.path}?{OPTIONS}'"
        settings = config.load("farm", ["platform=hardware", "perception.enabled=false", base])
        with open_run(settings, tmp_path / "run", is_armed=True) as run:
            is_pressed = has_imu = False
            for record in run.ticks():
                run.inbox.drive(0.3, 0.0, "Ann")
                wheels = record.batch.wheels
                has_imu |= bool(record.batch.imu)
                if not is_pressed and wheels and min(wheels[-1].speed_radps) > 1.0:
                    assert record.batch.battery
                    bench.set_estop(pressed=True)
                    is_pressed = True
                if record.status.stopped and is_pressed:
                    break
                if record.status.stopped:  # a busy machine: the board's patience is 0.3 s
                    run.inbox.post(OperatorEvent(t_s=0.0, action="clear_stop"))
                assert record.batch.t_s < 60.0, record.status
            assert is_pressed and has_imu
            assert "red button is pressed" in record.status.stopped
            assert record.command.drive.v_mps == 0.0
    assert not any(bench.duty_ratio)
    bench.close()
