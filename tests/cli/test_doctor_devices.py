"""The doctor says of each device what it is for, and of each trouble what to do."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from agribot.cli.doctor import doctor_devices, doctor_machine
from agribot.cli.doctor.doctor_findings import CheckResult
from agribot.drivers.probe.gpsd_probe import GpsdState
from tests.drivers.device_tree import plug_camera, plug_gamepad, plug_serial, put


def test_each_device_comes_with_the_words_that_use_it(tmp_path: Path) -> None:
    plug_serial(tmp_path, "ttyACM0", "1546:01a9", "usb-receiver")
    plug_camera(tmp_path, "video2", "HD Camera")
    plug_gamepad(tmp_path, "js0", "Pad")
    found = {f.what: f for f in doctor_devices.check_devices(tmp_path)}
    assert {f.state for f in found.values() if f.what != "contactor"} == {"ok"}
    assert "--source gnss=serial:/dev/serial/by-id/usb-receiver" in (
        found["serial /dev/ttyACM0"].detail
    )
    assert "agribot live 2" in found["camera /dev/video2"].detail
    assert "teleop joystick --joy /dev/input/js0" in found["gamepad /dev/input/js0"].detail


def test_a_machine_without_devices_is_not_ill(tmp_path: Path) -> None:
    found = list(doctor_devices.check_devices(tmp_path))
    assert [f.state for f in found] == ["missing"] * 4


def test_a_contactor_counts_as_absent_also_where_a_relay_may_be_plugged_in(tmp_path: Path) -> None:
    for is_chip_there in (False, True):
        if is_chip_there:
            plug_serial(tmp_path, "ttyUSB0", "1a86:7523")
        found = {f.what: f for f in doctor_devices.check_devices(tmp_path)}["contactor"]
        assert found.state == "missing"
        assert "nothing but the red button takes the motors' power" in found.detail
        assert ("/dev/ttyUSB0 may be one" in found.detail) is is_chip_there


def test_a_plugged_in_board_that_may_not_be_used_is_bad_but_a_spare_uart_is_not(
    tmp_path: Path,
) -> None:
    plug_serial(tmp_path, "ttyUSB0", "1a86:7523")
    put(tmp_path, "dev/ttyAMA0")
    found = {f.what: f for f in doctor_devices.check_devices(tmp_path, lambda *_: False)}
    assert found["serial /dev/ttyUSB0"].state == "bad"
    assert "usermod" in found["serial /dev/ttyUSB0"].detail
    assert found["serial /dev/ttyAMA0"].state == "missing"


def test_programs_that_take_boards_away_are_named_where_a_board_is_plugged_in(
    tmp_path: Path,
) -> None:
    put(tmp_path, "proc/77/comm", "ModemManager\n")
    put(tmp_path, "proc/78/comm", "brltty\n")
    assert all(f.state == "missing" for f in doctor_devices.check_devices(tmp_path))
    plug_serial(tmp_path, "ttyUSB0", "1a86:7523")
    warned = [f.what for f in doctor_devices.check_devices(tmp_path) if f.state == "warning"]
    assert warned == ["ModemManager", "brltty"]


@pytest.mark.parametrize(
    ("state", "expected", "words"),
    [
        (None, "missing", "apt install gpsd"),
        (GpsdState(release="", paths=()), "warning", "no gpsd"),
        (GpsdState(release="3.22", paths=()), "warning", "/etc/default/gpsd"),
        (GpsdState(release="3.22", paths=("/dev/ttyACM0",)), "ok", "gnss=gpsd:"),
    ],
)
def test_gpsd_is_used_where_it_has_a_receiver(
    state: GpsdState | None, expected: str, words: str
) -> None:
    (finding,) = doctor_devices.check_gpsd(lambda: state)
    assert finding.state == expected
    assert words in finding.detail


def only(findings: Iterator[CheckResult]) -> CheckResult:
    (finding,) = findings
    return finding


@pytest.mark.parametrize(
    ("bits", "words"),
    [("0x1", "the supply is too weak"), ("0x4", "it is throttled"), ("50000", "was too weak")],
)
def test_a_raspberry_pi_with_a_weak_supply_or_no_fan_is_warned_of(
    bits: str, words: str, tmp_path: Path
) -> None:
    put(tmp_path, doctor_machine.PI_THROTTLED, bits + "\n")
    finding = only(doctor_machine.check_heat(tmp_path))
    assert finding.state == "warning"
    assert words in finding.detail


def put_zone(root: Path, number: int, name: str, celsius: float, limit_c: float) -> None:
    zone = f"sys/class/thermal/thermal_zone{number}"
    put(root, f"{zone}/type", name)
    put(root, f"{zone}/temp", f"{celsius * 1000:.0f}")
    put(root, f"{zone}/trip_point_0_type", "active")
    put(root, f"{zone}/trip_point_0_temp", "30000")
    put(root, f"{zone}/trip_point_1_type", "passive")
    put(root, f"{zone}/trip_point_1_temp", f"{limit_c * 1000:.0f}")


def test_the_zone_that_is_nearest_to_its_own_limit_decides(tmp_path: Path) -> None:
    put_zone(tmp_path, 0, "gpu-thermal", 70.0, 99.0)
    put_zone(tmp_path, 1, "cpu-thermal", 60.0, 85.0)
    put(tmp_path, doctor_machine.PI_THROTTLED, "0x0")
    finding = only(doctor_machine.check_heat(tmp_path))
    assert (finding.state, finding.detail) == ("ok", "25 °C below the limit of cpu-thermal")
    put_zone(tmp_path, 0, "gpu-thermal", 97.0, 99.0)
    finding = only(doctor_machine.check_heat(tmp_path))
    assert finding.state == "warning"
    assert "gpu-thermal is 2 °C below" in finding.detail


def test_a_processor_that_the_kernel_holds_back_is_throttled(tmp_path: Path) -> None:
    put(tmp_path, "sys/class/thermal/cooling_device0/type", "pwm-fan")
    put(tmp_path, "sys/class/thermal/cooling_device0/cur_state", "2")
    assert only(doctor_machine.check_heat(tmp_path)).state == "missing"
    put(tmp_path, "sys/class/thermal/cooling_device1/type", "cpufreq-cpu0")
    put(tmp_path, "sys/class/thermal/cooling_device1/cur_state", "3")
    assert "cpufreq-cpu0 is throttled" in only(doctor_machine.check_heat(tmp_path)).detail


def test_room_for_recordings_is_judged_before_the_drive(tmp_path: Path) -> None:
    def state(free_bytes: float) -> str:
        return only(doctor_machine.check_disk(tmp_path, lambda _: free_bytes)).state

    assert [state(free) for free in (100e6, 1e9, 50e9)] == ["bad", "warning", "ok"]


@pytest.mark.parametrize(
    ("steered", "expected"), [(True, "ok"), (False, "warning"), (None, "missing")]
)
def test_a_clock_that_nothing_steers_is_warned_of(steered: bool | None, expected: str) -> None:
    assert only(doctor_machine.check_clock(lambda: steered)).state == expected


def test_the_kernel_is_asked_about_its_clock_without_setting_it() -> None:
    assert doctor_machine.is_clock_steered() in (True, False, None)


@pytest.mark.parametrize(
    ("version", "machine", "bad"),
    [
        ((3, 11), "aarch64", []),
        ((3, 10), "aarch64", ["python"]),
        ((3, 12), "armv7l", ["architecture"]),
    ],
)
def test_old_pythons_and_32_bit_systems_are_refused(
    version: tuple[int, int], machine: str, bad: list[str]
) -> None:
    found = doctor_machine.check_python(version, machine)
    assert [f.what for f in found if f.state == "bad"] == bad


def test_a_jetson_is_told_that_its_own_python_is_too_old(tmp_path: Path) -> None:
    assert list(doctor_machine.check_board(tmp_path)) == []
    put(tmp_path, "proc/device-tree/model", "NVIDIA Jetson Orin Nano Developer Kit\0")
    put(tmp_path, "etc/nv_tegra_release", "# R36 (release), REVISION: 4.0, GCID: 1\n")
    finding = only(doctor_machine.check_board(tmp_path))
    assert "Orin Nano" in finding.detail
    assert "deploy/install.sh" in finding.detail
    assert os.sep not in finding.what
