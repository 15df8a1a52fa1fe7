from __future__ import annotations

import os
import pty
import struct
import subprocess
import sys
import time
from pathlib import Path

import pytest

from agribot.ui import wire
from agribot.ui.hand.inputs import STILL, HandRates, KeyHand, MouseHand, StickHand, TerminalInput
from agribot.ui.hand.joystick import JoystickState
from tests.ui.client import Page
from tests.ui.conftest import Robot
from tests.waiting import PATIENCE_S, wait_for


def event(value: int, kind: int, number: int) -> bytes:
    return struct.pack("=IhBB", 1234, value, kind, number)


def test_a_joystick_is_read_in_pieces_of_any_size() -> None:
    data = event(-32767, 0x82, 1) + event(1, 0x01, 4) + event(16384, 0x02, 0)
    for size in (1, 3, 8, 100):
        state = JoystickState()
        for start in range(0, len(data), size):
            state.feed(data[start : start + size])
        assert state.axes == {1: -1.0, 0: pytest.approx(0.5, abs=0.001)}
        assert state.buttons == {4: True}


def test_a_stick_drives_only_while_the_dead_man_button_is_held() -> None:
    state, hand = JoystickState(), StickHand(HandRates())
    state.feed(event(-32767, 0x02, 1))
    assert hand.twist(state) == STILL
    state.feed(event(1, 0x01, 4))
    assert hand.twist(state) == (0.8, 0.0)
    state.feed(event(0, 0x01, 4))
    assert hand.twist(state) == STILL


def test_a_stick_at_rest_stands_still_and_left_on_it_is_left() -> None:
    state, hand = JoystickState(), StickHand(HandRates(scale=0.5))
    state.feed(event(1, 0x01, 4) + event(2000, 0x02, 0) + event(-1500, 0x02, 1))
    assert hand.twist(state) == STILL
    state.feed(event(-32767, 0x02, 0))
    assert hand.twist(state) == (0.0, 0.5)


def test_keys_drive_while_they_repeat_and_let_go_after_the_hold() -> None:
    hand = KeyHand(HandRates())
    assert hand.twist(0.0) == STILL
    hand.press("up", 1.0)
    hand.press("left", 1.2)
    assert hand.twist(1.3) == (0.8, 1.0)
    assert hand.twist(1.45) == (0.0, 1.0)
    assert hand.twist(1.65) == STILL
    hand.press("up", 2.0)
    hand.press("down", 2.1)
    assert hand.twist(2.2) == (-0.5, 0.0)
    hand.press("stop", 2.3)
    assert hand.twist(2.3) == STILL


def test_a_terminal_is_read_also_when_it_cuts_a_word_in_two() -> None:
    terminal = TerminalInput()
    assert [word for word, _, _ in terminal.feed(b"\x1b[A")] == ["up"]
    assert terminal.feed(b"\x1b[") == []
    assert [word for word, _, _ in terminal.feed(b"Dw q")] == ["left", "up", "stop", "quit"]
    assert terminal.feed(b"\x1b[<0;10;") == []
    assert terminal.feed(b"20M\x1b[<32;8;15M\x1b[<0;8;15m") == [
        ("press", 10, 20),
        ("drag", 8, 15),
        ("release", 8, 15),
    ]


def test_dragging_up_drives_forwards_and_letting_go_stands_still() -> None:
    hand = MouseHand(HandRates())
    hand.move("drag", 5, 5, 0.0)
    assert hand.twist(0.0) == STILL
    hand.move("press", 40, 20, 0.1)
    hand.move("drag", 30, 15, 0.2)
    assert hand.twist(0.2) == (0.4, 0.5)
    hand.move("drag", 40, -200, 0.3)
    assert hand.twist(0.3) == (0.8, 0.0)
    hand.move("release", 40, 20, 0.4)
    assert hand.twist(0.4) == STILL


def test_a_mouse_held_still_drives_while_its_terminal_answers_and_else_has_let_go() -> None:
    hand, terminal = MouseHand(HandRates()), TerminalInput()
    hand.move("press", 40, 20, 0.0)
    hand.move("drag", 40, 15, 0.0)
    assert terminal.feed(b"\x1b[0") == []
    assert terminal.feed(b"n") == [("alive", 0, 0)]
    hand.move("alive", 0, 0, 0.3)
    assert hand.twist(0.6) == (0.4, 0.0)
    assert hand.twist(0.71) == STILL
    hand.move("drag", 40, 10, 0.8)
    assert hand.twist(0.8) == STILL, "it must be pressed anew"


def teleop(robot: Robot, *words: str, stdin: int = subprocess.DEVNULL) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "agribot.cli", "teleop", *words, "--port", str(robot.port)],
        stdin=stdin,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_keys_in_a_terminal_reach_the_robot(robot: Robot) -> None:
    ours, theirs = pty.openpty()
    process = teleop(robot, "keyboard", "--scale", "0.5", stdin=theirs)
    try:
        robot.wait_for(wire.DriveOrder)
        os.write(ours, b"\x1b[A")
        order = robot.wait_for(wire.DriveOrder, lambda order: order.v_mps != 0.0)
        assert order.v_mps == pytest.approx(0.4)
        assert order.who == wire.Who("teleop keyboard")
        os.write(ours, b" ")
        robot.wait_for_request("stop")
        os.write(ours, b"q")
        assert process.wait(PATIENCE_S) == 0
        assert robot.of_kind(wire.DriveOrder)[-1].v_mps == 0.0
    finally:
        process.kill()
        process.communicate()
        os.close(ours)
        os.close(theirs)


def test_a_robot_that_is_driven_by_mouse_stops_where_the_terminal_falls_silent(
    robot: Robot,
) -> None:
    ours, theirs = pty.openpty()
    process = teleop(robot, "mouse", "--hold", "1", stdin=theirs)
    try:
        assert process.stderr is not None
        robot.wait_for(wire.DriveOrder)
        os.write(ours, b"\x1b[<0;40;20M\x1b[<32;40;15M")
        robot.wait_for(wire.DriveOrder, lambda order: order.v_mps > 0.0)
        wait_for(lambda: robot.of_kind(wire.DriveOrder)[-1].v_mps == 0.0, "the robot to stand")
        os.write(ours, b"q")
        assert process.wait(PATIENCE_S) == 0
        said = process.stderr.read()
        assert "\x1b[5n" in said and "the terminal was silent for 1 s" in said
    finally:
        process.kill()
        process.communicate()
        os.close(ours)
        os.close(theirs)


def test_a_joystick_that_is_pulled_out_stops_the_robot(robot: Robot, tmp_path: Path) -> None:
    device = tmp_path / "js0"
    os.mkfifo(device)
    stick = os.open(device, os.O_RDWR)
    process = teleop(robot, "joystick", "--joy", str(device))
    try:
        robot.wait_for(wire.DriveOrder)
        os.write(stick, event(-32767, 0x02, 1) + event(1, 0x01, 4))
        robot.wait_for(wire.DriveOrder, lambda order: order.v_mps > 0.0)
        os.close(stick)
        _, errors = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 2
        assert "gone" in errors
        wait_for(lambda: robot.of_kind(wire.DriveOrder)[-1].v_mps == 0.0, "the robot to stand")
        assert robot.of_kind(wire.DriveOrder)[-1].v_mps == 0.0
    finally:
        process.kill()


def test_teleop_says_who_has_the_seat_and_where_no_robot_is(robot: Robot, page: Page) -> None:
    page.send(wire.UseName(name="Ada"))
    page.take_seat()
    ours, theirs = pty.openpty()
    process = teleop(robot, "keyboard", stdin=theirs)
    while process.poll() is None:
        page.send(wire.Ping(sent_ms=0.0))  # or the seat is free before it has begun
        time.sleep(0.1)
    _, errors = process.communicate()
    os.close(ours)
    os.close(theirs)
    assert process.returncode == 2
    assert "Ada has the seat" in errors
    lost = subprocess.run(
        [sys.executable, "-m", "agribot.cli", "teleop", "joystick", "--port", "1"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert lost.returncode == 2
    assert "port 1" in lost.stderr
