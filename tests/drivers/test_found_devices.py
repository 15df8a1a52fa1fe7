"""Boards, receivers, cameras and gamepads are found by what the system says of them."""

from __future__ import annotations

import json
import os
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from agribot.drivers.probe.found_devices import explain_access, find_devices
from agribot.drivers.probe.gpsd_probe import ask_gpsd
from tests.drivers.device_tree import link, plug_camera, plug_gamepad, plug_serial, put

UBLOX = "usb-u-blox_AG_-_www.u-blox.com_u-blox_GNSS_receiver-if00"


def test_a_receiver_is_told_from_a_board_and_named_so_that_it_can_be_found_again(
    tmp_path: Path,
) -> None:
    plug_serial(tmp_path, "ttyACM0", "1546:01a9", UBLOX)
    plug_serial(tmp_path, "ttyACM1", "2341:0042", "usb-Arduino_Mega-if00")
    plug_serial(tmp_path, "ttyUSB0", "1a86:7523")
    receiver, mega, chip = find_devices(tmp_path)
    assert (receiver.is_receiver, receiver.path) == (True, f"/dev/serial/by-id/{UBLOX}")
    assert (mega.is_receiver, mega.what, mega.node) == (False, "Arduino Mega 2560", "/dev/ttyACM1")
    assert (chip.path, chip.usb) == ("/dev/ttyUSB0", "1a86:7523")
    assert "CH340" in chip.what


def test_a_device_of_an_unknown_maker_is_called_as_it_calls_itself(tmp_path: Path) -> None:
    plug_serial(tmp_path, "ttyACM0", "cafe:0001", product="Weather station")
    assert [device.what for device in find_devices(tmp_path)] == ["Weather station"]


def test_the_tenth_line_comes_after_the_second(tmp_path: Path) -> None:
    for number in (10, 2, 0):
        plug_serial(tmp_path, f"ttyUSB{number}", "0403:6001")
    assert [d.node for d in find_devices(tmp_path)] == [
        "/dev/ttyUSB0", "/dev/ttyUSB2", "/dev/ttyUSB10"
    ]  # fmt: skip


def test_a_camera_counts_once_although_it_has_a_second_device_for_data(tmp_path: Path) -> None:
    plug_camera(tmp_path, "video0", "HD Camera")
    plug_camera(tmp_path, "video1", "HD Camera", index=1)
    plug_gamepad(tmp_path, "js0", "Wireless Controller")
    put(tmp_path, "dev/ttyAMA0")
    put(tmp_path, "dev/ttyS0")  # of a PC: there is most often nothing behind it
    found = {device.kind: device for device in find_devices(tmp_path)}
    assert len(found) == len(find_devices(tmp_path)) == 3
    assert (found["camera"].node, found["camera"].what) == ("/dev/video0", "HD Camera")
    assert found["gamepad"].path == "/dev/input/js0"
    assert found["serial"].node == "/dev/ttyAMA0"


def test_a_gamepad_need_only_be_read(tmp_path: Path) -> None:
    plug_gamepad(tmp_path, "js0", "Pad")
    plug_serial(tmp_path, "ttyACM0", "1546:01a9")
    usable = {d.kind: d.is_usable for d in find_devices(tmp_path, lambda _, mode: mode == os.R_OK)}
    assert usable == {"gamepad": True, "serial": False}


def test_a_line_that_the_user_may_not_open_names_the_group_that_may(tmp_path: Path) -> None:
    plug_serial(tmp_path, "ttyACM0", "1546:01a9")
    (device,) = find_devices(tmp_path, lambda *_: False)
    assert not device.is_usable
    assert f"usermod -aG {device.group}" in explain_access(device, frozenset())
    assert "log out" in explain_access(device, frozenset({device.group}))


def test_a_machine_without_dev_or_with_broken_links_has_no_devices(tmp_path: Path) -> None:
    assert find_devices(tmp_path) == []
    link(tmp_path, "dev/serial/by-id/gone", "../../ttyUSB9")
    put(tmp_path, "dev/ttyUSB0")
    (device,) = find_devices(tmp_path)
    assert (device.path, device.usb) == ("/dev/ttyUSB0", "")


@contextmanager
def answering(*lines: bytes) -> Iterator[int]:
    """Listen as a gpsd does, and say `lines` to one who asks."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            caller, _ = server.accept()
            with caller:
                for line in lines:
                    caller.sendall(line)
                caller.recv(100)

        thread = threading.Thread(target=serve)
        thread.start()
        yield server.getsockname()[1]
        thread.join()


VERSION = json.dumps({"class": "VERSION", "release": "3.22"}).encode() + b"\r\n"


def test_a_gpsd_tells_its_release_and_the_lines_that_it_holds() -> None:
    devices = {"class": "DEVICES", "devices": [{"path": "/dev/ttyACM0"}, {"odd": 1}, 3]}
    with answering(VERSION, json.dumps(devices).encode() + b"\n") as port:
        state = ask_gpsd(port=port)
    assert state is not None
    assert (state.release, state.paths) == ("3.22", ("/dev/ttyACM0",))


@pytest.mark.parametrize("said", [b"SSH-2.0-nonsense\r\n", b"{" * 500 + b"\n", b""])
def test_something_else_at_the_port_is_no_gpsd(said: bytes) -> None:
    with answering(said) as port:
        state = ask_gpsd(port=port, wait_s=0.2)
    assert state is None or state.release == ""


def test_where_nothing_listens_there_is_no_gpsd() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    assert ask_gpsd(port=port) is None
