"""What `agribot doctor --probe` finds out by opening lines and cameras, and what to run with it."""

from __future__ import annotations

import os
import shlex
import time
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from agribot.cli.doctor.doctor_findings import CheckResult, State
from agribot.cli.standard_error import print_line
from agribot.core import extras
from agribot.drivers.line.byte_streams import SerialStream
from agribot.drivers.line.line_holders import find_holders
from agribot.drivers.probe import udev_names
from agribot.drivers.probe.found_devices import Access, FoundDevice, find_cameras, find_serial_lines
from agribot.drivers.probe.gpsd_probe import GpsdState
from agribot.drivers.probe.line_answers import LineAnswer
from agribot.drivers.probe.line_probe import LineProbe, TunableStream, may_ask_silent, order_bauds

if TYPE_CHECKING:
    from agribot.drivers.probe.camera_probe import CameraAnswer

OpenLine = Callable[[str, int], TunableStream]
TakePictures = Callable[[str], "CameraAnswer"]
RULE_NAMES = {
    "motor board": "agribot-motor", "vesc": "agribot-motor", "odrive": "agribot-motor",
    "imu board": "agribot-imu", "letter imu": "agribot-imu", "rosserial imu": "agribot-imu",
    "receiver": "agribot-receiver",
}  # fmt: skip
ONE_EACH = ("base", "imu", "gnss")


class Probed(msgspec.Struct, frozen=True, kw_only=True):
    """A device and what it is; `source` is what `--source` takes, empty where it is of no use."""

    node: str
    path: str
    what: str
    source: str = ""
    is_good: bool
    answer: LineAnswer | None = None


class DeviceProbe:
    """The devices below `root`, opened one after the other; it keeps what answered."""

    def __init__(
        self, root: Path = Path("/"), access: Access = os.access,
        open_line: OpenLine = SerialStream, now_s: Callable[[], float] = time.monotonic,
        gpsd: GpsdState | None = None, ask: Collection[str] = (),
    ) -> None:  # fmt: skip
        """`gpsd` has receivers in its hands; `ask` are lines to be asked though they are silent."""
        self._root, self._access, self._open_line, self._now_s = root, access, open_line, now_s
        self._gpsd, self._ask = gpsd, ask
        self.found: list[Probed] = []

    def check_lines(self) -> Iterator[CheckResult]:
        """Open each serial line that no other program has, and say what answers."""
        lines = [one for one in find_serial_lines(self._root, self._access) if one.is_usable]
        if lines and not extras.has("hardware"):
            detail = f"were not opened: {extras.format_install('hardware')}"
            yield CheckResult(what="serial lines", state="missing", detail=detail)
            return
        for node in set(self._ask) - {name for one in lines for name in (one.node, one.path)}:
            detail = "--ask names no serial line that was found, or that you may use"
            yield CheckResult(what=f"at {node}", state="warning", detail=detail)
        for device in lines:
            what = f"at {device.node}"
            taken = self._explain_taken(device)
            if taken is not None:
                yield CheckResult(what=what, state=taken[0], detail=taken[1])
                continue
            print_line(f"opening {device.node} ({device.what}) ...")
            try:
                answer = self._probe(device)
            except OSError as error:
                detail = f"cannot be opened: {error.strerror or error}; another program may have it"
                yield CheckResult(what=what, state="warning", detail=detail)
                continue
            yield self._note(device, answer)

    def check_cameras(self, take: TakePictures | None = None) -> Iterator[CheckResult]:
        """Take pictures with each camera that no other program has."""
        cameras = [one for one in find_cameras(self._root, self._access) if one.is_usable]
        if cameras and take is None:
            if not extras.has("camera"):
                detail = f"were not opened: {extras.format_install('camera')}"
                yield CheckResult(what="cameras", state="missing", detail=detail)
                return
            from agribot.drivers.probe.camera_probe import probe_camera as take
        for device in cameras:
            assert take is not None
            yield self._check_camera(device, take)

    def write_command(self) -> tuple[str, str]:
        """Write the command that runs the robot of what was found, and what it lacks, in words.

        The command is empty where nothing of use was found.
        """
        chosen = {
            sensor: one.source
            for sensor in (*ONE_EACH, "camera")
            for one in reversed(self.found)
            if one.is_good and one.source.startswith(f"{sensor}=")
        }
        if self._gpsd is not None and self._gpsd.paths and "gnss" not in chosen:
            chosen["gnss"] = "gnss=gpsd:"
        kinds = {one.answer.kind for one in self.found if one.answer and one.is_good}
        words = ["agribot", "run", "hardware", *(["--ui"] if extras.has("ui") else [])]
        for sensor in (*ONE_EACH, "camera"):
            words += ["--source", chosen[sensor]] if sensor in chosen else []
        if "camera" in chosen:
            words += ["--set", "perception.enabled=true"]
        is_other = "motor board" not in kinds and bool(kinds & {"vesc", "odrive"})
        if is_other:
            words += ["--set", 'safety.must_report=["motors"]']
        lacks = [
            text
            for sensor, text in (("base", "a motor board"), ("gnss", "a receiver"))
            if sensor not in chosen
        ]
        return shlex.join(words) if chosen else "", " and ".join(lacks)

    @property
    def has_own_board(self) -> bool:
        """Whether a board of `firmware/` answered, whose motors have to be stated."""
        return any(one.answer and one.answer.kind == "motor board" for one in self.found)

    def write_rules(self) -> list[str]:
        """Write the rules of udev that name what was found; a comment where one cannot."""
        known = {
            one.node: udev_names.read_properties(one.node, self._root)
            for one in find_serial_lines(self._root, self._access)
        }
        rules, given = [], set[str]()
        for one in self.found:
            name = RULE_NAMES.get(one.answer.kind) if one.answer else None
            if name is None:
                continue
            if name in given:
                rules.append(f"# {one.node} is another one of {name}: {one.what}")
                continue
            others = [known[node] for node in known if node != one.node]
            rule = udev_names.write_rule(name, known.get(one.node, {}), others)
            given.add(name)
            rules.append(rule or f"# {one.node}: udev states no serial number and no socket of it")
        return rules

    def _explain_taken(self, device: FoundDevice) -> tuple[State, str] | None:
        """Say which program has a device, with the state of the finding; None where none has it."""
        real = os.path.realpath(self._root / device.node.lstrip("/"))
        paths = self._gpsd.paths if self._gpsd is not None else ()
        named = {os.path.realpath(self._root / path.lstrip("/")) for path in paths}
        if real in named:
            return "ok", "is left alone: gpsd reads it; take it by --source gnss=gpsd:"
        held = self._explain_held(device)
        return ("warning", held) if held else None

    def _explain_held(self, device: FoundDevice) -> str:
        """Say which other programs have a device open; empty where none has."""
        holders = ", ".join(map(str, sorted(find_holders(device.node, self._root))))
        return f"is left alone: {holders} has it; end that to have it probed" if holders else ""

    def _probe(self, device: FoundDevice) -> LineAnswer:
        bauds = order_bauds(device.what)
        is_named = bool({device.node, device.path} & set(self._ask))
        line = self._open_line(str(self._root / device.node.lstrip("/")), bauds[0])
        try:
            probe = LineProbe(
                line, self._now_s, lambda text: print_line(f"  {text} ..."),
                may_ask=is_named or may_ask_silent(device.what),
            )  # fmt: skip
            return probe.find(bauds)
        finally:
            line.close()

    def _note(self, device: FoundDevice, answer: LineAnswer) -> CheckResult:
        uri = answer.write_uri(device.path)
        source = f"{answer.use}={uri}" if answer.use else ""
        self.found.append(Probed(
            node=device.node, path=device.path, what=answer.detail, source=source,
            is_good=answer.is_good, answer=answer,
        ))  # fmt: skip
        advice = [text.replace("URI", uri).replace("NODE", device.node) for text in answer.advice]
        use = f"--source {shlex.quote(source)}" if source else ""
        is_named = answer.detail.casefold().startswith(answer.kind)
        said = answer.detail if is_named else f"{answer.kind}: {answer.detail}"
        detail = "; ".join(filter(None, (said, use, *advice)))
        return CheckResult(
            what=f"at {device.node}", detail=detail,
            state="ok" if answer.is_good else "missing" if answer.kind == "silent" else "warning",
        )  # fmt: skip

    def _check_camera(self, device: FoundDevice, take: TakePictures) -> CheckResult:
        what = f"at {device.node}"
        if held := self._explain_held(device):
            return CheckResult(what=what, state="warning", detail=held)
        print_line(f"opening {device.node} ({device.what}) ...")
        try:
            seen = take(str(self._root / device.node.lstrip("/")))
        except OSError as error:
            detail = f"{error}; check its cable, and who else uses it"
            return CheckResult(what=what, state="warning", detail=detail)
        by_driver = f", {seen.stated_hz:g} by its driver" if seen.stated_hz else ""
        words = f"{seen.width_px} x {seen.height_px} px, {seen.rate_hz:.1f} Hz measured{by_driver}"
        source = f"camera=v4l2:{device.path}"
        self.found.append(Probed(
            node=device.node, path=device.path, what=words, source=source, is_good=True,
        ))  # fmt: skip
        return CheckResult(what=what, state="ok", detail=f"camera: {words}; --source {source}")
