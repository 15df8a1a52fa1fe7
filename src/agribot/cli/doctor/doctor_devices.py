"""What `agribot doctor` says of boards, receivers, cameras, gamepads and gpsd."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from agribot.cli.doctor.doctor_findings import CheckResult
from agribot.drivers.probe.found_devices import (
    Access,
    FoundDevice,
    Kind,
    explain_access,
    find_devices,
)
from agribot.drivers.probe.gpsd_probe import GpsdState, ask_gpsd

NONE_FOUND: dict[Kind, tuple[str, str]] = {
    "serial": (
        "serial boards and receivers",
        "none; plug one in, and look whether its cable carries data: dmesg | tail",
    ),
    "camera": (
        "cameras",
        "none in /dev/video*; a ribbon camera must be switched on in the system's settings first",
    ),
    "gamepad": ("gamepads", "none in /dev/input/js*; plug one in, or pair it, to drive by hand"),
}
# Programs that open serial lines to look what is there, and so spoil the first seconds.
MEDDLERS = {
    "ModemManager": "sudo systemctl disable --now ModemManager",
    "brltty": "sudo apt remove brltty (it takes CH340 boards away)",
}


def check_devices(root: Path = Path("/"), access: Access = os.access) -> Iterator[CheckResult]:
    """Check the devices below `root`, which holds `dev`, `sys` and `proc`."""
    devices = find_devices(root, access)
    for kind, (what, detail) in NONE_FOUND.items():
        mine = [device for device in devices if device.kind == kind]
        yield from map(_describe_device, mine)
        if not mine:
            yield CheckResult(what=what, state="missing", detail=detail)
    yield _describe_contactor([device for device in devices if device.may_be_relay])
    if any(device.usb for device in devices):
        yield from _check_meddlers(root)


def check_gpsd(
    ask: Callable[[], GpsdState | None] = ask_gpsd, root: Path = Path("/")
) -> Iterator[CheckResult]:
    """Check whether gpsd runs, and whether it holds a line that a run may want for itself."""
    state = ask()
    if state is None:
        detail = "none answers; it is needed for --source gnss=gpsd: only (sudo apt install gpsd)"
        yield CheckResult(what="gpsd", state="missing", detail=detail)
    elif not state.release:
        detail = "something that is no gpsd answers at its port; find it: ss -ltnp"
        yield CheckResult(what="gpsd", state="warning", detail=detail)
    elif not state.paths:
        detail = f"{state.release} has no receiver; name one in /etc/default/gpsd, DEVICES="
        yield CheckResult(what="gpsd", state="warning", detail=detail)
    else:
        detail = (
            f"{state.release} reads {', '.join(state.paths)}; take it by --source gnss=gpsd: , "
            "the line itself is taken"
        )
        yield CheckResult(what="gpsd", state="ok", detail=detail)


def _describe_contactor(chips: Sequence[FoundDevice]) -> CheckResult:
    """Name what may be a contactor's relay: it says nothing, so that only a person knows."""
    detail = "nothing but the red button takes the motors' power unless a run names a relay: "
    if not chips:
        detail += "--source contactor=lcus:PATH"
        return CheckResult(what="contactor", state="missing", detail=detail)
    paths = ", ".join(chip.node for chip in chips)
    detail += (
        f"--source contactor=lcus:PATH; {paths} may be one, or a board with the same chip: two of "
        "them differ by /dev/serial/by-path"
    )
    return CheckResult(what="contactor", state="missing", detail=detail)


def _describe_device(device: FoundDevice) -> CheckResult:
    what = f"{device.kind} {device.node}"
    named = device.what + (f" ({device.usb})" if device.usb else "")
    if device.is_usable:
        return CheckResult(what=what, state="ok", detail=f"{named}; {_explain_use(device)}")
    is_plugged_in = bool(device.usb) or device.kind != "serial"
    return CheckResult(
        what=what,
        state="bad" if is_plugged_in else "missing",
        detail=f"{named}; you may not use it: {explain_access(device)}",
    )


def _explain_use(device: FoundDevice) -> str:
    if device.kind == "camera":
        return f"its pictures: agribot live {device.node.removeprefix('/dev/video')}"
    if device.kind == "gamepad":
        return f"drive by hand: agribot teleop joystick --joy {device.path}"
    if device.is_receiver:
        return f"--source gnss=serial:{device.path}"
    if "Arduino" in device.what:
        return (
            f"its lasting name is {device.path}; which board it is, by opening it: "
            "agribot doctor --probe"
        )
    return f"its lasting name is {device.path}"


def _check_meddlers(root: Path) -> Iterator[CheckResult]:
    running = set(_list_programs(root))
    for name, cure in MEDDLERS.items():
        if name in running:
            detail = f"it opens serial lines that are plugged in; {cure}"
            yield CheckResult(what=name, state="warning", detail=detail)


def _list_programs(root: Path) -> Sequence[str]:
    found = []
    for path in (root / "proc").glob("[0-9]*/comm"):
        try:
            found.append(path.read_text("utf-8", errors="replace").strip())
        except OSError:  # it has ended
            continue
    return found
