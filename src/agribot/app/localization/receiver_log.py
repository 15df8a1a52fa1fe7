"""Bytes of a receiver, NMEA or UBX, as a log by UTC."""

from __future__ import annotations

import calendar
from collections.abc import Iterator
from pathlib import Path

from agribot.app.localization.log import LogChannel, LogEntry
from agribot.core.errors import RecordingError
from agribot.core.messages import FloatArray, GnssFix, GnssHeading
from agribot.drivers import nmea
from agribot.drivers.receiver import ReceiverDecoder

BLOCK_BYTES = 4096
_EPOCH_S = 10 * 365 * nmea.DAY_S  # stamps above it have a date


class ReceiverLog:
    """What a receiver sent. Sentences tell the time of the day, and RMC or ZDA the date."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notes: list[str] = []
        self.channels: tuple[LogChannel, ...] = (
            LogChannel(sensor="gnss", source=path.name, kind="NMEA or UBX"),
        )

    def entries(self) -> Iterator[LogEntry]:
        decoder, dates = ReceiverDecoder(self._note), _Dates()
        logged_s = 0.0
        try:
            with self.path.open("rb") as file:
                while data := file.read(BLOCK_BYTES):
                    dates.feed(data)
                    for told_s, sample in decoder.feed(data):
                        stamp_s = told_s if told_s > _EPOCH_S else dates.add_to(told_s)
                        if isinstance(sample, GnssHeading):
                            stamp_s = logged_s  # of two antennas, by a clock without a date
                        logged_s = max(logged_s, stamp_s)
                        if stamp_s and isinstance(sample, GnssFix | GnssHeading):
                            yield LogEntry("gnss", stamp_s, logged_s, "", sample)
        except OSError as error:
            raise RecordingError(
                f"cannot read {self.path}: {error.strerror or error}; check the path"
            ) from error
        if decoder.broken:
            self._note(f"{decoder.broken} messages with a wrong checksum left out")

    def read_transforms(self) -> dict[str, tuple[str, FloatArray]]:
        return {}

    def _note(self, text: str) -> None:
        note = f"{self.path.name}: {text}"
        if len(self.notes) < 5 and note not in self.notes:
            self.notes.append(note)


class _Dates:
    """The day of sentences, from RMC or ZDA."""

    def __init__(self) -> None:
        self._sentences = nmea.SentenceDecoder()
        self._midnight_s: float | None = None

    def feed(self, data: bytes) -> None:
        for sentence in self._sentences.feed(data):
            if self._midnight_s is None and sentence.kind in ("RMC", "ZDA"):
                self._midnight_s = _read_midnight(sentence)

    def add_to(self, stamp_s: float) -> float:
        """Put the first day in front of a stamp, which counts on from it, less one day."""
        return stamp_s - nmea.DAY_S + (self._midnight_s or 0.0) if stamp_s else 0.0


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
