"""A GNSS receiver on a line: its fixes, heading and status, and corrections on their way to it.

`receiver_decoder.py` reads its bytes, whichever language they are in; gpsd's reports are read here.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from agribot.core.facts import AnyFact
from agribot.core.messages import DeviceNote, GnssFix, GnssHeading, GnssStatus
from agribot.core.platform import Sensor
from agribot.core.stamp_clock import SampleQueue
from agribot.drivers.gnss import gpsd, nmea
from agribot.drivers.gnss.corrections import CorrectionLink
from agribot.drivers.gnss.heard import Heard
from agribot.drivers.gnss.ntrip import Caster
from agribot.drivers.gnss.receiver_decoder import ReceiverDecoder, Stamped
from agribot.drivers.gnss.sky import Sky
from agribot.drivers.line.byte_streams import ByteStream, OpenStream, StreamReader
from agribot.drivers.line.caster_login import CasterLogin
from agribot.drivers.line.clock_watch import ClockWatch
from agribot.drivers.line.line_watch import LineWatch

if TYPE_CHECKING:
    import ssl

_MOST_OTHERS = 8  # receivers that are reported
_SILENT_REPORTS = 20  # reports of another receiver that show one silent; two seconds and more
_UNREAD = ("ATT", "IMU")  # reports of gpsd about the robot that are not read
_MOST_NOTES = 32  # largest number of notes that wait for a tick


class GpsdDecoder:
    """Reports of gpsd about one receiver; that of `device`, or the first that it reports.

    Without `device` another one takes its place that speaks while the first is silent: a receiver
    that was unplugged may come back under another name.
    """

    def __init__(self, refuse: Callable[[str], None], device: str = "") -> None:
        self._refuse, self._device = refuse, device
        self._is_chosen = bool(device)
        self._others: set[str] = set()
        self._of_others = 0  # positions since the last one of ours
        self._lines, self._fixes = gpsd.JsonLineDecoder(), gpsd.GpsdFixes(refuse)
        self._heard = Heard()
        self.sky = Sky(self._heard)
        self.last_fix: nmea.StampedFix | None = None

    @property
    def broken(self) -> int:
        """Count of lines that were no report."""
        return self._lines.bad

    @property
    def is_accuracy_known(self) -> bool:
        """Whether the accuracy of the newest fix is the receiver's word, not what is usual."""
        return self._fixes.is_accuracy_known

    def feed(self, data: bytes, arrived_s: float = 0.0) -> Stamped:
        """Decode what arrived; the stamp of what comes without a fix is 0."""
        found: Stamped = []
        for report in self._lines.feed(data):
            if not self._is_ours(report):
                continue
            if report.get("class") in _UNREAD:
                self._heard.unread[str(report["class"])] += 1
            try:
                if report.get("class") == "SKY":
                    self.sky.add_sky(report)
            except (KeyError, ValueError, TypeError, AttributeError, OverflowError) as error:
                self._refuse(f"SKY that cannot be read: {error}")
            fix = self._fixes.add(report)
            if fix is not None:
                self.last_fix = fix
                found.append((fix.stamp_s, fix.fix))
            elif not (self._fixes.lacks_fix and report.get("class") in ("TPV", "SKY")):
                continue
            stamp_s = fix.stamp_s if fix is not None else 0.0
            status = self.sky.make_status(stamp_s, arrived_s)
            found += [(stamp_s, status)] if status else []
        return found

    def _is_ours(self, report: Mapping[str, Any]) -> bool:
        """Return whether a report is of our receiver: positions of two make no way of one."""
        device = report.get("device")
        if not isinstance(device, str) or report.get("class") not in ("TPV", "GST", "SKY"):
            return True
        is_position = report["class"] == "TPV"
        is_silent = not self._is_chosen and self._of_others >= _SILENT_REPORTS
        if is_position and (not self._device or is_silent):
            self._device = device
        self._of_others = (self._of_others + is_position) if device != self._device else 0
        is_ours = device == self._device or not self._device
        if not is_ours and device not in self._others and len(self._others) < _MOST_OTHERS:
            self._others.add(device)
            self._refuse(f"gpsd reports {device} too; taken is {self._device}")
        return is_ours


class ReceiverLink:
    """A receiver's reports by tick, whatever carries its bytes.

    `ReceiverSource` gives it those of a real line; a simulation gives it those of a simulated one.
    """

    def __init__(
        self,
        name: str,
        decoder: ReceiverDecoder | GpsdDecoder,
        now_s: Callable[[], float] = time.monotonic,
        latency_s: float = 0.0,
    ) -> None:
        """`latency_s` passes at least from the epoch of a fix until its last byte."""
        self.decoder, self.now_s = decoder, now_s
        self._fixes: SampleQueue[GnssFix] = SampleQueue(now_s, latency_s=latency_s)
        self._headings: SampleQueue[GnssHeading] = SampleQueue(now_s, latency_s=latency_s)
        self._states: SampleQueue[GnssStatus] = SampleQueue(now_s, latency_s=latency_s)
        self._watch = LineWatch("receiver", name)
        self._clock = ClockWatch(name, lambda: self._fixes.uncertainty_s)

    def feed(self, data: bytes, arrived_s: float) -> None:
        """Take bytes in, in any thread."""
        for stamp_s, sample in self.decoder.feed(data, arrived_s):
            if isinstance(sample, GnssFix):
                self._fixes.put(stamp_s, arrived_s, sample)
            elif isinstance(sample, GnssHeading):
                self._headings.put(stamp_s, arrived_s, sample)
            else:
                self._states.put(stamp_s, arrived_s, sample)

    def take_fixes(self, t_s: float) -> tuple[GnssFix, ...]:
        """Take the fixes captured until `t_s`."""
        return self._fixes.take(t_s)

    def take_more(self, t_s: float) -> dict[str, tuple[Any, ...]]:
        """Take headings and states, and notes on line and clock, by field of the batch."""
        return {
            "notes": (*self._watch.update(t_s, self.decoder.broken), *self._clock.update(t_s)),
            "headings": self._headings.take(t_s),
            "gnss_status": self._states.take(t_s),
        }


class ReceiverSource:
    """A receiver behind a line; the loop takes its samples with their capture time."""

    def __init__(
        self,
        name: str,
        open_stream: OpenStream,
        decoder: ReceiverDecoder | GpsdDecoder,
        notify: Callable[[str], None],
        latency_s: float = 0.0,
        on_open: Callable[[ByteStream], None] = lambda stream: None,
    ) -> None:
        """Open the line and begin to read.

        Raises: ConfigError: the line cannot be opened.
        """
        self.sensor: Sensor = "gnss"
        self.name = name
        self._link = ReceiverLink(f"receiver on {name}", decoder, latency_s=latency_s)
        self._notes: deque[AnyFact] = deque(maxlen=_MOST_NOTES)
        self._corrections: CorrectionLink | None = None
        self._reader = StreamReader(
            f"gnss from {name}", open_stream, self._link.feed, self._link.now_s, notify, on_open,
            hears_silence=True,
        )  # fmt: skip

    def take_corrections(
        self, caster: Caster, login: CasterLogin | None, tls: ssl.SSLContext | None = None
    ) -> None:
        """Feed the receiver with the corrections of a caster from now on."""
        self._corrections = CorrectionLink(
            caster, login, self._reader.write, self._last_fix, self._note, tls=tls
        )
        self._link.decoder.sky.corrections = self._corrections.state

    def take(self, t_s: float) -> tuple[GnssFix, ...]:
        """Take the fixes captured until `t_s`."""
        return self._link.take_fixes(t_s)

    def take_more(self, t_s: float) -> dict[str, tuple[Any, ...]]:
        """Take headings and states of the receiver, and what happened to its corrections."""
        notes = [self._notes.popleft() for _ in range(len(self._notes))]
        more = self._link.take_more(t_s)
        notes_seen = tuple(DeviceNote(t_s=t_s, fact=fact) for fact in notes)
        return more | {"notes": (*notes_seen, *more["notes"])}

    def close(self) -> None:
        """Let go of the line and of the caster. Safe to call twice."""
        if self._corrections is not None:
            self._corrections.close()
        self._reader.close()

    def _note(self, fact: AnyFact) -> None:
        self._notes.append(fact)

    def _last_fix(self) -> nmea.StampedFix | None:
        return self._link.decoder.last_fix
