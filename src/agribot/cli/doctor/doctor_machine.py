"""What `agribot doctor` says of the computer: Python, board, disk, clock and heat."""

from __future__ import annotations

import ctypes
import datetime
import os
import platform
import re
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from agribot.app.workers import usable_cpus
from agribot.cli.doctor.doctor_findings import CheckResult

LEAST_PYTHON = (3, 11)
# 64-bit machines for which the wheels of every requirement exist.
MACHINES = ("x86_64", "AMD64", "aarch64", "arm64")
GIB = 2**30
LEAST_FREE_BYTES = 200e6  # record.min_free_mb: below it recordings end
LITTLE_FREE_BYTES = 4 * GIB  # some hours of recording with a camera
NEAR_LIMIT_C = 5.0
HOT_C = 80.0  # limit if the system names none
# Raspberry Pi, bits of get_throttled. Source: Raspberry Pi documentation, vcgencmd.
PI_NOW = {
    0: "the supply is too weak",
    1: "the clock is capped",
    2: "it is throttled",
    3: "it is hot",
}
PI_EARLIER = {16: "the supply was too weak", 18: "it was throttled"}
PI_THROTTLED = "sys/devices/platform/soc/soc:firmware/get_throttled"
CLOCK_IS_FREE = 5  # TIME_ERROR of adjtimex(2): nothing steers the clock


def describe_machine(root: Path = Path("/")) -> dict[str, Any]:
    """Describe the machine; null where the system does not say."""
    memory_bytes = None
    if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        memory_bytes = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return {
        "system": platform.platform(),
        "architecture": platform.machine(),
        "board": read_board(root) or None,
        "cpu": _read_cpu_name(root),
        "cpus_usable": usable_cpus(),
        "memory_gib": round(memory_bytes / GIB, 1) if memory_bytes else None,
    }


def read_board(root: Path) -> str:
    """Read what a single-board computer calls itself; empty of a PC."""
    return _read(root / "proc/device-tree/model").rstrip("\0").strip()


def check_python(
    version: tuple[int, int] = sys.version_info[:2], machine: str | None = None
) -> Iterator[CheckResult]:
    machine = platform.machine() if machine is None else machine
    text = ".".join(map(str, version))
    if version < LEAST_PYTHON:
        least = ".".join(map(str, LEAST_PYTHON))
        detail = f"{text} is older than {least}; install a newer one beside it (deploy/install.sh)"
        yield CheckResult(what="python", state="bad", detail=detail)
    else:
        yield CheckResult(what="python", state="ok", detail=f"{text} on {machine}")
    if machine not in MACHINES:
        detail = f"{machine} has no wheels of onnxruntime; install a 64-bit system"
        yield CheckResult(what="architecture", state="bad", detail=detail)


def check_board(root: Path = Path("/")) -> Iterator[CheckResult]:
    board = read_board(root)
    if not board:
        return
    release = _read(root / "etc/nv_tegra_release").partition(",")[0].lstrip("# ")
    detail = " ".join(filter(None, (board, release)))
    if release and not (root / "usr/bin/python3.11").exists():
        detail += "; JetPack's own Python is too old for agribot: deploy/install.sh brings another"
    yield CheckResult(what="board", state="ok", detail=detail)


def check_disk(
    folder: Path = Path(), free_bytes: Callable[[Path], float] | None = None
) -> Iterator[CheckResult]:
    """Check the room for recordings where the command was started."""
    if free_bytes is None:
        free_bytes = lambda path: shutil.disk_usage(path).free  # noqa: E731
    try:
        free = free_bytes(folder)
    except OSError as error:
        yield CheckResult(what="disk", state="bad", detail=f"cannot be asked: {error}")
        return
    text = f"{free / GIB:.1f} GiB free in {folder.absolute()}"
    if free < LEAST_FREE_BYTES:
        detail = f"{text}: no recording; remove old folders under runs/"
        yield CheckResult(what="disk", state="bad", detail=detail)
    elif free < LITTLE_FREE_BYTES:
        detail = f"{text}: few hours of recording; remove old folders under runs/"
        yield CheckResult(what="disk", state="warning", detail=detail)
    else:
        yield CheckResult(what="disk", state="ok", detail=text)


def check_clock(is_steered: Callable[[], bool | None] | None = None) -> Iterator[CheckResult]:
    """Check that something steers the clock, as recordings and receivers are compared by it."""
    steered = (is_steered or is_clock_steered)()
    if steered is None:
        detail = "this system does not say whether its clock is synchronised"
        yield CheckResult(what="clock", state="missing", detail=detail)
    elif steered:
        yield CheckResult(what="clock", state="ok", detail="synchronised")
    else:
        detail = (
            "nothing synchronises it; sudo timedatectl set-ntp true, or without a network take "
            "the receiver's time (gpsd with chrony)"
        )
        yield CheckResult(what="clock", state="warning", detail=detail)


def check_declination(day: datetime.date | None = None) -> Iterator[CheckResult]:
    """Check that the World Magnetic Model, which a compass needs, is there and knows the day."""
    from agribot.app.declination import find_magnetic_north, warn_of_model
    from agribot.core.config import FieldConfig
    from agribot.core.errors import ConfigError

    datum = FieldConfig().datum
    try:
        north = find_magnetic_north(datum, day or datetime.date.today())
    except ConfigError as error:
        yield CheckResult(what="declination", state="missing", detail=str(error))
        return
    odd = warn_of_model(north, datum)
    if odd:
        detail = "; ".join(text.removeprefix("declination: ") for text in odd)
        yield CheckResult(what="declination", state="warning", detail=detail)
        return
    detail = (
        f"{north.model} until {north.until_year}; a real robot with a compass needs no "
        "field.declination_deg"
    )
    yield CheckResult(what="declination", state="ok", detail=detail)


def is_clock_steered() -> bool | None:
    """Ask the kernel, which every time service informs; None where it does not answer.

    Source: adjtimex(2).
    """
    try:
        kernel = ctypes.CDLL(None, use_errno=True)
        state = int(kernel.adjtimex(ctypes.create_string_buffer(512)))
    except (OSError, AttributeError, TypeError):  # another system than Linux
        return None
    return None if state < 0 else state != CLOCK_IS_FREE


def check_heat(root: Path = Path("/")) -> Iterator[CheckResult]:
    """Check whether heat or a weak supply slows the computer down, now or since it started."""
    said = _read(root / PI_THROTTLED)
    bits = int(said, 16) if re.fullmatch(r"(0x)?[0-9a-fA-F]+", said) else 0
    now = [text for bit, text in PI_NOW.items() if bits >> bit & 1]
    earlier = [text for bit, text in PI_EARLIER.items() if bits >> bit & 1]
    now += _list_slowed(root)
    hottest = max(_read_zones(root), default=None)
    about = "" if hottest is None else f"{-hottest[0]:.0f} °C below the limit of {hottest[1]}"
    if now or earlier:
        cure = "; a supply of the board's full current, a fan or a heat sink"
        yield CheckResult(what="heat", state="warning", detail=", ".join(now or earlier) + cure)
    elif hottest is None:
        yield CheckResult(what="heat", state="missing", detail="this machine does not say")
    elif hottest[0] > -NEAR_LIMIT_C:
        detail = f"{hottest[1]} is {max(0.0, -hottest[0]):.0f} °C below its limit; a fan helps"
        yield CheckResult(what="heat", state="warning", detail=detail)
    else:
        yield CheckResult(what="heat", state="ok", detail=about)


def _list_slowed(root: Path) -> Iterator[str]:
    """List what the kernel holds back for its heat, and a supply that is too weak."""
    for device in sorted((root / "sys/class/thermal").glob("cooling_device*")):
        kind = _read(device / "type")
        if re.search("cpufreq|processor", kind, re.IGNORECASE) and _read_int(device / "cur_state"):
            yield f"{kind} is throttled"
    for monitor in sorted((root / "sys/class/hwmon").glob("hwmon*")):
        if _read(monitor / "name") == "rpi_volt" and _read_int(monitor / "in0_lcrit_alarm"):
            yield "the supply is too weak"


def _read_zones(root: Path) -> Iterator[tuple[float, str]]:
    """Read how far each zone is above its first limit, in degrees, and its name."""
    for zone in sorted((root / "sys/class/thermal").glob("thermal_zone*")):
        millidegrees = _read_int(zone / "temp")
        if millidegrees is None or millidegrees <= 0:
            continue
        limits = [
            limit
            for path in zone.glob("trip_point_*_type")
            if _read(path) in ("passive", "hot", "critical")
            and (limit := _read_int(path.with_name(path.name.replace("_type", "_temp"))))
            is not None
            and limit > 0
        ]
        limit_c = min(limits) / 1000.0 if limits else HOT_C
        yield millidegrees / 1000.0 - limit_c, _read(zone / "type") or zone.name


def _read_cpu_name(root: Path) -> str | None:
    found = re.search(r"^model name\s*:\s*(.+)$", _read(root / "proc/cpuinfo"), re.MULTILINE)
    return found[1] if found else platform.processor() or None


def _read(path: Path) -> str:
    try:
        return path.read_text("utf-8", errors="replace").strip()
    except OSError:
        return ""


def _read_int(path: Path) -> int | None:
    try:
        return int(_read(path))
    except ValueError:
        return None
