"""Boards of one USB name get names that stay: by serial number where it is one, or by socket."""

from __future__ import annotations

import fnmatch
import re
from collections.abc import Mapping
from pathlib import Path

import pytest

from agribot.drivers.probe.found_devices import find_devices
from agribot.drivers.probe.udev_names import read_properties, write_rule
from tests.drivers.device_tree import link, plug_serial, put

# What `udevadm info` says of a Mega 2560 on a Raspberry Pi 4, and of two boards with a CH340 on a
# Raspberry Pi 3 and on a PC.
MEGA = """\
E:ID_BUS=usb
E:ID_VENDOR_ID=2341
E:ID_MODEL_ID=0042
E:ID_SERIAL=Arduino__www.arduino.cc__0042_55330313735351910141
E:ID_SERIAL_SHORT=55330313735351910141
E:ID_USB_INTERFACE_NUM=00
E:ID_USB_DRIVER=cdc_acm
E:ID_PATH=platform-fd500000.pcie-pci-0000:01:00.0-usb-0:1.3:1.0
"""
CH340 = """\
S:serial/by-id/usb-1a86_USB2.0-Ser_-if00-port0
I:5776874
E:ID_VENDOR=1a86
E:ID_VENDOR_ID=1a86
E:ID_MODEL=USB2.0-Ser_
E:ID_MODEL_ENC=USB2.0-Ser\\x21
E:ID_MODEL_ID=7523
E:ID_SERIAL=1a86_USB2.0-Ser_
E:ID_USB_INTERFACE_NUM=00
E:ID_USB_DRIVER=ch341
E:ID_PATH=platform-3f980000.usb-usb-0:1.4:1.0
G:systemd
"""
CH340_OF_PC = """\
E:ID_VENDOR_ID=1a86
E:ID_MODEL_ID=7523
E:ID_SERIAL=1a86_USB_Serial
E:ID_USB_INTERFACE_NUM=00
E:ID_PATH=pci-0000:00:14.0-usb-0:7.2:1.0
"""


def plug(root: Path, name: str, number: str, database: str) -> dict[str, str]:
    put(root, f"sys/class/tty/{name}/dev", number + "\n")
    put(root, f"run/udev/data/c{number}", database)
    return read_properties(f"/dev/{name}", root)


def fits(rule: str, properties: Mapping[str, str], action: str = "add") -> bool:
    """Whether udev would follow a rule for a tty: each key that compares has to, by its pattern."""
    known = {"ACTION": action, "SUBSYSTEM": "tty"}
    known |= {f"ENV{{{key}}}": value for key, value in properties.items()}
    compared = re.findall(r'([A-Z]+(?:\{\w+\})?)(==|!=)"([^"]*)"', rule)
    assigned = re.findall(r'SYMLINK\+="([a-z-]+)"', rule)
    rest = re.sub(r'[A-Z]+(?:\{\w+\})?(==|!=|\+=)"[^"]*"(, )?', "", rule)
    assert (len(assigned), rest) == (1, "")
    return all(
        fnmatch.fnmatchcase(known.get(key, ""), pattern) == (how == "==")
        for key, how, pattern in compared
    )


def test_a_serial_number_goes_before_the_socket_and_names_that_board_alone(tmp_path: Path) -> None:
    mega = plug(tmp_path, "ttyACM0", "166:0", MEGA)
    other = plug(tmp_path, "ttyACM1", "166:1", MEGA.replace("0141", "0777"))
    rule = write_rule("agribot-motor", mega, [other])
    assert 'ENV{ID_SERIAL_SHORT}=="55330313735351910141"' in rule and "ID_PATH" not in rule
    assert 'SYMLINK+="agribot-motor"' in rule
    assert fits(rule, mega) and not fits(rule, other)
    assert fits(rule, {**mega, "ID_PATH": "pci-0000:00:14.0-usb-0:2:1.0"}), "in another socket"
    assert not fits(rule, mega, "remove")


@pytest.mark.parametrize("database", [CH340, CH340_OF_PC])
def test_boards_without_a_number_are_told_apart_by_their_sockets(
    database: str, tmp_path: Path
) -> None:
    mine = plug(tmp_path, "ttyUSB0", "188:0", database)
    moved = re.sub(r":(1\.4|7\.2):", ":1.2:", database)
    other = plug(tmp_path, "ttyUSB1", "188:1", moved)
    rule = write_rule("agribot-imu", mine, [other])
    assert fits(rule, mine) and not fits(rule, other)


@pytest.mark.parametrize("number", ["0001", "123456789ABCDEF", "000000000000", "a*b?[c]d", "12"])
def test_a_number_that_every_chip_of_a_kind_has_is_none(number: str, tmp_path: Path) -> None:
    database = MEGA.replace("E:ID_SERIAL_SHORT=55330313735351910141", f"E:ID_SERIAL_SHORT={number}")
    rule = write_rule("agribot-motor", plug(tmp_path, "ttyACM0", "166:0", database))
    assert "ID_SERIAL_SHORT" not in rule and "usb-0:1.3:1.0" in rule


def test_two_boards_with_one_number_go_by_their_sockets(tmp_path: Path) -> None:
    one = plug(tmp_path, "ttyACM0", "166:0", MEGA)
    two = plug(tmp_path, "ttyACM1", "166:1", MEGA.replace("1.3:", "1.4:"))
    rules = write_rule("agribot-motor", one, [two]), write_rule("agribot-imu", two, [one])
    assert [[fits(rule, board) for board in (one, two)] for rule in rules] == [
        [True, False], [False, True],
    ]  # fmt: skip


def test_what_udev_does_not_know_gets_no_rule(tmp_path: Path) -> None:
    assert read_properties("/dev/ttyAMA0", tmp_path) == {}
    assert write_rule("agribot-motor", {}) == ""
    assert write_rule("agribot-motor", {"ID_PATH": 'a", RUN+="rm'}) == ""


def plug_twins(root: Path) -> None:
    """Two boards of one name: the link by-id is that of the last one plugged in."""
    for k in (0, 1):
        plug_serial(root, f"ttyUSB{k}", "1a86:7523")
        link(root, f"dev/serial/by-path/usb-0:1.{k}", f"../../ttyUSB{k}")
    link(root, "dev/serial/by-id/usb-1a86_USB2.0-Ser_-if00-port0", "../../ttyUSB1")


def test_twins_are_called_by_their_sockets_and_a_single_board_by_its_maker(tmp_path: Path) -> None:
    plug_twins(tmp_path)
    plug_serial(tmp_path, "ttyACM0", "2341:0042", "usb-Arduino_0042-if00")
    link(tmp_path, "dev/serial/by-path/usb-0:1.7", "../../ttyACM0")
    assert {device.node: device.path for device in find_devices(tmp_path)} == {
        "/dev/ttyACM0": "/dev/serial/by-id/usb-Arduino_0042-if00",
        "/dev/ttyUSB0": "/dev/serial/by-path/usb-0:1.0",
        "/dev/ttyUSB1": "/dev/serial/by-path/usb-0:1.1",
    }


def test_a_board_that_a_rule_names_is_called_so(tmp_path: Path) -> None:
    plug_twins(tmp_path)
    link(tmp_path, "dev/agribot-motor", "ttyUSB1")
    assert [device.path for device in find_devices(tmp_path)] == [
        "/dev/serial/by-path/usb-0:1.0", "/dev/agribot-motor",
    ]  # fmt: skip
