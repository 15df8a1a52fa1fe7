"""What a receiver or gpsd sent, as a log by UTC."""

from __future__ import annotations

import calendar
from collections.abc import Iterator
from pathlib import Path

from agribot.app.localization.log import LogChannel, LogEntry
from agribot.core.errors import CHECK_PATH, explain_os_error
from agribot.core.messages import FloatArray, GnssFix, GnssHeading
from agribot.drivers.gnss import nmea
from agribot.drivers.gnss.receiver import GpsdDecoder
from agribot.drivers.gnss.receiver_decoder import ReceiverDecoder

BLOCK_BYTES = 4096
DATE_BYTES = 1 << 20  # bytes at the start in which a date is sought
_EPOCH_S = 10 * 365 * nmea.DAY_S  # time above which stamps have a date


class ReceiverLog:
    """Reader of a receiver's log. Sentences give the time of the day, and RMC or ZDA the date."""

    def __init__(self, path: Path, *, is_gpsd: bool = False) -> None:
        """`is_gpsd` says that the file holds reports of gpsd, as of `gpspipe -w`."""
        self.path = path
        self.notes: list[str] = []
        self._make_decoder = GpsdDecoder if is_gpsd else ReceiverDecoder
        kind = "reports of gpsd" if is_gpsd else "NMEA or UBX"
        self.channels: tuple[LogChannel, ...] = (
            LogChannel(sensor="gnss", source=path.name, kind=kind),
        )

    def entries(self) -> Iterator[LogEntry]:
        decoder = self._make_decoder(self._note)
        midnight_s = _find_midnight(next(self._read(DATE_BYTES), b""))
        logged_s = 0.0
        for data in self._read(BLOCK_BYTES):
            for stated_s, sample in decoder.feed(data):
                if isinstance(sample, GnssFix):
                    # Without a date a stamp counts from the midnight before the first, and a day.
                    has_date = stated_s > _EPOCH_S
                    stamp_s = stated_s if has_date else stated_s - nmea.DAY_S + midnight_s
                    logged_s = max(logged_s, stamp_s)
                    yield LogEntry("gnss", stamp_s, logged_s, "", sample)
                elif isinstance(sample, GnssHeading) and logged_s:
                    # The heading is of the same epoch, by a clock without a date.
                    yield LogEntry("heading", logged_s, logged_s, "", sample)
        if decoder.broken:
            self._note(f"{decoder.broken} messages left out that are broken")

    def _read(self, size: int) -> Iterator[bytes]:
        reading = explain_os_error(f"cannot read {self.path}", CHECK_PATH)
        with reading, self.path.open("rb") as file:
            while data := file.read(size):
                yield data

    def read_transforms(self) -> dict[str, tuple[str, FloatArray]]:
        return {}

    def _note(self, text: str) -> None:
        note = f"{self.path.name}: {text}"
        if len(self.notes) < 5 and note not in self.notes:
            self.notes.append(note)


def _find_midnight(data: bytes) -> float:
    """Find the first date of a receiver, as seconds since 1970; 0 without one."""
    sentences = nmea.SentenceDecoder().feed(data)
    dates = (_read_midnight(each) for each in sentences if each.kind in ("RMC", "ZDA"))
    return next((date for date in dates if date is not None), 0.0)


def _read_midnight(sentence: nmea.Sentence) -> float | None:
    """Read the date; None where it stands not yet."""
    fields = sentence.fields
    try:
        if sentence.kind == "ZDA":
            day, month, year = (int(text) for text in fields[1:4])
        else:
            date = fields[8]
            day, month, year = int(date[:2]), int(date[2:4]), 2000 + int(date[4:6])
        return float(calendar.timegm((year, month, day, 0, 0, 0)))
    except (ValueError, IndexError):
        return None
