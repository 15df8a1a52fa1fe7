"""A GNSS receiver by what it says: its language, fix, satellites, rate, corrections."""

from __future__ import annotations

import math
from collections import deque

from agribot.core.messages import GnssFix, GnssQuality, GnssStatus
from agribot.drivers.gnss import ubx
from agribot.drivers.gnss.receiver_decoder import ReceiverDecoder
from agribot.drivers.gnss.ubx_setup import MON_VER, ReceiverSetup, Version, read_version
from agribot.drivers.probe.line_answers import LineAnswer

LISTEN_S = 3.6  # three epochs of a receiver that speaks once a second, and what follows them
LEAST_RATE_HZ = 5.0
QUALITY_NAMES = {
    GnssQuality.SINGLE: "single",
    GnssQuality.DGNSS: "DGNSS",
    GnssQuality.RTK_FIXED: "RTK fixed",
    GnssQuality.RTK_FLOAT: "RTK float",
}
_EPOCHS = 40


def name_fix(fix: GnssFix) -> str:
    """Name how a fix came about."""
    return fix.unmeasured or QUALITY_NAMES.get(fix.quality, "none")


class ReceiverSpeaker:
    """A receiver that speaks UBX, NMEA or both; once heard it is asked which one it is."""

    def __init__(self) -> None:
        self._decoder = ReceiverDecoder(lambda _: None)
        self._frames = ubx.UbxDecoder()
        self._fix: GnssFix | None = None
        self._status: GnssStatus | None = None
        self._version: Version | None = None
        self._stamps_s: deque[float] = deque(maxlen=_EPOCHS)
        self._heard_s, self._is_asked = math.inf, False

    @property
    def is_heard(self) -> bool:
        return self._heard_s < math.inf

    def feed(self, data: bytes, now_s: float) -> None:
        for frame in self._frames.feed(data):
            if frame.kind == MON_VER and len(frame.payload) >= 40:
                self._version = read_version(frame.payload)
        for stamp_s, sample in self._decoder.feed(data, now_s):
            if isinstance(sample, GnssFix):
                self._fix = sample
                self._stamps_s.append(stamp_s)
            elif isinstance(sample, GnssStatus):
                self._status = sample
        if self._decoder.heard.languages:
            self._heard_s = min(self._heard_s, now_s)

    def take_to_send(self, now_s: float) -> bytes:
        if self._is_asked or not self.is_heard:
            return b""
        self._is_asked = True
        return ReceiverSetup.ask

    def is_done(self, now_s: float) -> bool:
        return now_s - self._heard_s > LISTEN_S

    @property
    def rate_hz(self) -> float:
        """Rate of its epochs, by its own times where they have any; 0 before the second one."""
        times_s = self._stamps_s if len(self._stamps_s) > 1 else self._decoder.heard.epochs_s
        passed_s = times_s[-1] - times_s[0] if len(times_s) > 1 else 0.0
        return (len(times_s) - 1) / passed_s if passed_s > 0.0 else 0.0

    def answer(self, baud: int) -> LineAnswer:
        status = self._status
        model = self._version.model if self._version else ""
        heard = self._decoder.heard
        words = [f"u-blox {model}".strip() if self._version else "receiver"]
        words += [
            f"{heard.language} at {baud} baud",
            f"{self.rate_hz:.1f} Hz",
            self._describe_fix(),
        ]
        if status is not None:
            used = sum(each.is_used for each in status.satellites)
            words.append(f"{used} of {len(status.satellites)} satellites used")
        words.append(self._describe_corrections())
        unread = heard.name_unread()
        words += [f"not read: {', '.join(unread)}"] if unread else []
        return LineAnswer(
            kind="receiver", detail=", ".join(words), baud=baud, use="gnss",
            advice=tuple(self._advise()), is_good=bool(heard.epochs_s),
            numbers={
                "model": model, "language": heard.language, "rate_hz": round(self.rate_hz, 2),
                "fix": name_fix(self._fix) if self._fix else "none",
                "pos_std_m": self._fix.pos_std_m if self._fix else None,
                "satellites": len(status.satellites) if status else None,
                "satellites_used": sum(s.is_used for s in status.satellites) if status else None,
                "correction_age_s": status.correction_age_s if status else None,
                "corrections_used": status.corrections_used if status else None,
                "unread": list(heard.name_unread()), "trouble": heard.explain(),
            },
        )  # fmt: skip

    @property
    def _has_corrections(self) -> bool:
        status = self._status
        return status is not None and (
            status.correction_age_s is not None or bool(status.corrections_used)
        )

    def _describe_fix(self) -> str:
        trouble = self._decoder.heard.explain()
        if trouble:
            return trouble.partition("; ")[0]
        if self._fix is None:
            return "no fix"
        name = name_fix(self._fix)
        return f"{name} +-{self._fix.pos_std_m:.3f} m"

    def _describe_corrections(self) -> str:
        status = self._status
        if status is None or not self._has_corrections:
            return "no corrections come in"
        age_s, used = status.correction_age_s, status.corrections_used
        words = [] if age_s is None else [f"at most {age_s:.0f} s old"]
        words += [] if used is None else [f"{used} used"]
        return f"corrections come in ({', '.join(words)})"

    def _advise(self) -> list[str]:
        """Say what keeps it from driving well, the gravest first."""
        quality = self._fix.quality if self._fix else None
        heard = self._decoder.heard
        is_ublox, found = self._version is not None or "UBX" in heard.languages, []
        trouble = heard.explain()
        if trouble:
            return [trouble.partition("; ")[2] or trouble]
        if self._fix is None:
            found.append("no fix yet: give its antenna the open sky, and some minutes")
        is_slow = self.rate_hz < LEAST_RATE_HZ
        if is_slow or heard.language == "NMEA" or (is_ublox and "NAV-PVT" not in heard.read):
            why = f"{self.rate_hz:.0f} Hz is slow for driving" if is_slow else "UBX states more"
            how = "agribot gnss configure URI --rate 10 --save"
            found.append(
                f"{why}: {how if is_ublox else 'set its rate by the program of its maker'}"
            )
        if heard.language == "NMEA" and not {"GST", "PQTMEPE"} & set(heard.read):
            found.append("it states no accuracy: switch on its sentence GST")
        if not self._has_corrections and quality not in (
            GnssQuality.RTK_FIXED, GnssQuality.RTK_FLOAT,
        ):  # fmt: skip
            found.append("for RTK add corrections: ?ntrip=ntrip://HOST:2101/MOUNTPOINT")
        elif quality is GnssQuality.RTK_FLOAT:
            found.append("RTK is not fixed yet: wait, with open sky and a base within 20 km")
        return found
