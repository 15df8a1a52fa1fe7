"""What a receiver says, by kinds: what of it is read, what is not, and what to switch on.

Source of the names: u-blox M8 receiver description (UBX-13003221).
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Sequence

from agribot.drivers.gnss import sbf, ubx_older
from agribot.drivers.gnss.fix_kinds import DEAD_RECKONING, HELD
from agribot.drivers.gnss.nmea import Sentence
from agribot.drivers.gnss.nmea_fixes import TIME_FIELDS, TIMELESS
from agribot.drivers.gnss.nmea_headings import HEADING_KINDS, name_kind
from agribot.drivers.gnss.nmea_places import PLACE_KINDS
from agribot.drivers.gnss.ubx import NAV_HPPOSLLH, NAV_PVT, NAV_RELPOSNED, UbxFrame
from agribot.drivers.gnss.unicore import BESTNAV
from agribot.drivers.gnss.unicore import NAMES as UNICORE_NAMES

PATIENCE_S = 3.0  # time without a fix before a receiver is in trouble
MOST_KINDS = 50  # largest number of kinds; noise makes no more
MOST_NAMED = 12
EPOCHS = 40
# Reasons why such positions are no measurement of satellites, and remedies.
NAMED = {
    DEAD_RECKONING: (
        "its positions are dead reckoning, without satellites; give its antenna the open sky"
    ),
    HELD: ("its place is held, as of a base or a clock (time mode); switch that mode off"),
}
NOT_OK = "it calls its own positions not good enough (gnssFixOK is 0); give its antenna open sky"
_NAMES_OF_UBX = {
    (0x01, 0x01): "NAV-POSECEF", (0x01, 0x02): "NAV-POSLLH", (0x01, 0x03): "NAV-STATUS",
    (0x01, 0x04): "NAV-DOP", (0x01, 0x06): "NAV-SOL", (0x01, 0x07): "NAV-PVT",
    (0x01, 0x11): "NAV-VELECEF", (0x01, 0x12): "NAV-VELNED", (0x01, 0x13): "NAV-HPPOSECEF",
    (0x01, 0x14): "NAV-HPPOSLLH", (0x01, 0x20): "NAV-TIMEGPS", (0x01, 0x21): "NAV-TIMEUTC",
    (0x01, 0x22): "NAV-CLOCK", (0x01, 0x26): "NAV-TIMELS", (0x01, 0x30): "NAV-SVINFO",
    (0x01, 0x31): "NAV-DGPS", (0x01, 0x32): "NAV-SBAS", (0x01, 0x35): "NAV-SAT",
    (0x01, 0x3B): "NAV-SVIN", (0x01, 0x3C): "NAV-RELPOSNED", (0x01, 0x43): "NAV-SIG",
    (0x01, 0x61): "NAV-EOE", (0x02, 0x10): "RXM-RAW", (0x02, 0x11): "RXM-SFRB",
    (0x02, 0x13): "RXM-SFRBX", (0x02, 0x14): "RXM-MEASX", (0x02, 0x15): "RXM-RAWX",
    (0x02, 0x32): "RXM-RTCM", (0x02, 0x34): "RXM-COR", (0x0A, 0x04): "MON-VER",
    (0x0D, 0x01): "TIM-TP",
}  # fmt: skip
_READ_OF_UBX = {
    NAV_PVT, NAV_HPPOSLLH, NAV_RELPOSNED, *ubx_older.SIZES, (0x01, 0x04), (0x01, 0x35),
    (0x02, 0x32), (0x02, 0x34), (0x0A, 0x04), (0x05, 0x00), (0x05, 0x01),
}  # fmt: skip
_READ_OF_NMEA = {*TIME_FIELDS, *TIMELESS, *HEADING_KINDS, "GSV", "GSA"}
_PLACES_OF = {
    "UBX": {"NAV-PVT", "NAV-SOL", "NAV-POSLLH"},
    "SBF": {sbf.NAMES[sbf.PVT]},
    "Unicore": {UNICORE_NAMES[BESTNAV]},
    "NMEA": {*PLACE_KINDS},
}
_STATE_A_PLACE = set().union(*_PLACES_OF.values())
# Messages that do not say whether they hold a place.
_WITHOUT_A_WORD = {"NAV-POSLLH"}
_WITH_STATUS = {"NAV-POSLLH", "NAV-STATUS"}
# Settings that make each language state a place, the one that states it best first.
_TO_SWITCH_ON = {
    "UBX": "switch on NAV-PVT: agribot gnss configure URI --save",
    "SBF": "switch on PVTGeodetic and PosCovGeodetic (setSBFOutput)",
    "Unicore": "switch on BESTNAVA, as by the command BESTNAVA 0.1",
    "NMEA": "switch on GGA and RMC, and GST for its accuracy",
    "RTCM": "this is what a base sends: read another of its ports, or set it as a rover",
}


class Heard:
    """Counts what a receiver says by kind, and judges why nothing of it gives a position."""

    def __init__(self) -> None:
        self.languages: set[str] = set()
        self.read: Counter[str] = Counter()
        self.unread: Counter[str] = Counter()
        self.reason = ""  # why the newest position was not taken
        self._epochs_s: dict[str, deque[float]] = {}  # arrivals of each kind that states a place
        self._begun_s = math.inf
        self._fix_s = self._reason_s = -math.inf

    def add(self, language: str, kind: str, arrived_s: float, *, is_read: bool) -> None:
        """Note a message of that kind."""
        self.languages.add(language)
        self._begun_s = min(self._begun_s, arrived_s)
        counts = self.read if is_read else self.unread
        if kind in counts or len(counts) < MOST_KINDS:
            counts[kind] += 1
        if kind in _STATE_A_PLACE:
            self._epochs_s.setdefault(kind, deque(maxlen=EPOCHS)).append(arrived_s)

    @property
    def epochs_s(self) -> Sequence[float]:
        """Arrivals of the newest epochs, with a fix or without."""
        return max(self._epochs_s.values(), key=len, default=())

    @property
    def language(self) -> str:
        """Its language, of several the one that states most; empty before it spoke."""
        has_place = {name for name, kinds in _PLACES_OF.items() if kinds & set(self.read)}
        order = [name for name in _TO_SWITCH_ON if name in (has_place or self.languages)]
        return order[0] if order else ""

    def add_sentence(self, sentence: Sentence, arrived_s: float) -> None:
        """Note an NMEA sentence."""
        kind = name_kind(sentence)
        self.add("NMEA", kind, arrived_s, is_read=kind in _READ_OF_NMEA)

    def add_frame(self, frame: UbxFrame, arrived_s: float) -> None:
        """Note a frame of UBX."""
        name = _NAMES_OF_UBX.get(frame.kind, "UBX {:02X}-{:02X}".format(*frame.kind))
        self.add("UBX", name, arrived_s, is_read=frame.kind in _READ_OF_UBX)

    def add_fix(self, arrived_s: float) -> None:
        """Note that something gave a fix."""
        self._fix_s, self.reason = arrived_s, ""

    def add_reason(self, reason: str, arrived_s: float) -> None:
        """Note why a position is not taken; one without a word keeps that of a moment ago."""
        if reason:
            self.reason, self._reason_s = reason, arrived_s
        elif arrived_s - self._reason_s > PATIENCE_S:
            self.reason = ""

    def name_unread(self) -> tuple[str, ...]:
        """Name the kinds that came and are not read, the most frequent first."""
        return tuple(kind for kind, _ in self.unread.most_common(MOST_NAMED))

    def is_patient(self, arrived_s: float) -> bool:
        """Return whether fixes come, or it began to speak a moment ago."""
        return arrived_s - max(self._fix_s, self._begun_s) < PATIENCE_S

    def explain(self) -> str:
        """Say why what it says gives no position, and what to do; empty while it searches."""
        if self.reason or not self.languages:
            return self.reason
        if _STATE_A_PLACE & set(self.read) - _WITHOUT_A_WORD or set(self.read) >= _WITH_STATUS:
            return ""
        kinds = ", ".join((*self.read, *self.name_unread())[:MOST_NAMED])
        return f"no positions among what it says ({kinds}); {_TO_SWITCH_ON[self.language]}"
