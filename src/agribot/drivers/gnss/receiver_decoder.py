"""Bytes of a receiver in any of its languages, to fixes, headings and states.

UBX, SBF, Unicore's and NMEA differ by their bytes. Of those that state one place at once, the
one that states most counts.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from enum import IntEnum
from typing import NamedTuple

from agribot.core.geo import yaw_from_compass_deg
from agribot.core.messages import GnssFix, GnssHeading, GnssStatus
from agribot.drivers.gnss import nmea, nmea_fixes, nmea_places, sbf, ubx, unicore, unicore_fixes
from agribot.drivers.gnss.heard import NAMED, NOT_OK, Heard
from agribot.drivers.gnss.nmea_headings import read_heading
from agribot.drivers.gnss.rtcm import RtcmDecoder
from agribot.drivers.gnss.sky import Sky
from agribot.drivers.gnss.ubx_older import OlderFixes

ReceiverSample = GnssFix | GnssHeading | GnssStatus
Stamped = list[tuple[float, ReceiverSample]]
SILENT_S = 3.0  # time without an epoch; the slowest receivers have one a second


class Rank(IntEnum):
    """Rank of a source of fixes; a higher one takes the place of a lower one."""

    NMEA = 1
    OLDER_UBX = 2
    BINARY = 3  # NAV-PVT, PVTGeodetic, BESTNAV


class HeadingMount(NamedTuple):
    """Mount of two antennas on the robot, and the accuracy of a heading that states none.

    `offset_deg` is from forward to the line from the first antenna to the second, clockwise;
    `std_deg` is that of a metre of baseline by the data sheet of the ZED-F9P.
    """

    offset_deg: float = 0.0
    std_deg: float = 0.4

    def make_heading(self, heading_deg: float, std_deg: float | None) -> GnssHeading:
        """Make the robot's heading of the antennas', in degrees clockwise from North."""
        return GnssHeading(
            t_s=0.0,
            yaw_map_rad=yaw_from_compass_deg(heading_deg - self.offset_deg),
            std_rad=math.radians(self.std_deg if std_deg is None else std_deg),
        )


class ReceiverDecoder:
    """A receiver that speaks one language or several; `heard` counts what it says.

    One that lost its settings with its power goes on in NMEA, which then counts.
    """

    def __init__(self, refuse: Callable[[str], None], mount: HeadingMount | None = None) -> None:
        self._refuse, self._mount = refuse, mount or HeadingMount()
        self._ubx, self._sbf = ubx.UbxDecoder(), sbf.SbfDecoder()
        self._unicore, self._nmea = unicore.UnicoreDecoder(), nmea.SentenceDecoder()
        self._rtcm = RtcmDecoder()
        self._from_pvt, self._from_older = ubx.UbxFixes(), OlderFixes()
        self._from_sbf, self._from_nmea = sbf.SbfFixes(), nmea_fixes.NmeaFixes(refuse)
        self._epochs_s: dict[Rank, float] = {}  # arrival of the newest of each source
        self._pvt_s = -math.inf
        self._accurate_heading_s = -math.inf
        self.heard = Heard()
        self.sky = Sky(self.heard)
        self.last_fix: nmea.StampedFix | None = None

    @property
    def broken(self) -> int:
        """Count of messages with a wrong checksum; to a reader of sentences all frames have."""
        languages = self.heard.languages
        if "UBX" in languages:
            return self._ubx.bad
        if "SBF" in languages:
            return self._sbf.bad
        return self._unicore.bad + (0 if self._unicore.is_binary else self._nmea.bad)

    def feed(self, data: bytes, arrived_s: float = 0.0) -> Stamped:
        """Decode what arrived; the stamp of what comes without a fix is 0."""
        found: Stamped = []
        self._add_nmea(found, self._from_nmea.give_waiting(arrived_s), arrived_s)
        for ubx_frame in self._ubx.feed(data):
            self._add_ubx(found, ubx_frame, arrived_s)
        for block in self._sbf.feed(data):
            self._add_sbf(found, block, arrived_s)
        for unicore_frame in self._unicore.feed(data):
            self._add_unicore(found, unicore_frame, arrived_s)
        for sentence in self._nmea.feed(data):
            self._add_sentence(found, sentence, arrived_s)
        if not self.heard.languages - {"RTCM"}:
            for message in self._rtcm.feed(data):
                self.heard.add("RTCM", f"RTCM {message.kind}", arrived_s, is_read=False)
        if data and self.heard.languages and not self.heard.is_patient(arrived_s):
            self._add_status(found, 0.0, arrived_s)
        return found

    def _add_ubx(self, found: Stamped, frame: ubx.UbxFrame, arrived_s: float) -> None:
        self.heard.add_frame(frame, arrived_s)
        self.sky.add_frame(frame)
        baseline = ubx.read_baseline(frame)
        if baseline is not None:
            self._add_heading(found, baseline, arrived_s)
        if frame.kind == ubx.NAV_PVT:
            self._pvt_s = arrived_s
            self._note_epoch(Rank.BINARY, arrived_s)
        for fix in self._from_pvt.add(frame):
            self._add_fix(found, fix, arrived_s)
        if ubx.lacks_fix(frame):
            self._lack_fix(found, _explain_pvt(frame), arrived_s)
        self._add_older(found, frame, arrived_s)

    def _add_older(self, found: Stamped, frame: ubx.UbxFrame, arrived_s: float) -> None:
        fixes = self._from_older.add(frame)
        lacks_fix = self._from_older.lacks_fix
        if not (fixes or lacks_fix) or self._is_outranked(Rank.OLDER_UBX, arrived_s):
            return
        self._note_epoch(Rank.OLDER_UBX, arrived_s)
        for fix in fixes:
            self._add_fix(found, fix, arrived_s)
        if lacks_fix:
            self._lack_fix(found, NOT_OK if self._from_older.is_refused else "", arrived_s)

    def _add_sbf(self, found: Stamped, block: sbf.SbfBlock, arrived_s: float) -> None:
        self.heard.add("SBF", block.name, arrived_s, is_read=block.number in sbf.SIZES)
        fixes, headings = self._from_sbf.add(block)
        if block.number == sbf.PVT:
            self._note_epoch(Rank.BINARY, arrived_s)
        for heading in headings:
            self._add_heading(found, heading, arrived_s)
        for fix in fixes:
            self._add_fix(found, fix, arrived_s)
        if sbf.lacks_fix(block):
            self._lack_fix(found, "", arrived_s)

    def _add_unicore(self, found: Stamped, frame: unicore.UnicoreFrame, arrived_s: float) -> None:
        is_read = frame.name in (*unicore.NAMES.values(), *unicore.HEADINGS)
        self.heard.add("Unicore", frame.name, arrived_s, is_read=is_read)
        try:
            self._read_unicore(found, frame, arrived_s)
        except (ValueError, IndexError, struct.error) as error:
            self._refuse(f"{frame.name} that cannot be read: {error}")

    def _read_unicore(self, found: Stamped, frame: unicore.UnicoreFrame, arrived_s: float) -> None:
        if frame.name in unicore.HEADINGS:
            heading = unicore_fixes.read_heading(frame)
            if heading is not None:
                self._add_heading(found, heading, arrived_s)
        if frame.name != unicore.NAMES[unicore.BESTNAV]:
            return
        self._note_epoch(Rank.BINARY, arrived_s)
        fix = unicore_fixes.read_fix(frame)
        if fix is not None:
            self._add_fix(found, fix, arrived_s)
        else:
            self._lack_fix(found, "", arrived_s)

    def _add_sentence(self, found: Stamped, sentence: nmea.Sentence, arrived_s: float) -> None:
        self.heard.add_sentence(sentence, arrived_s)
        fixes = self._from_nmea.add(sentence, arrived_s)
        if arrived_s - self._pvt_s < SILENT_S:
            return
        lacks_fix = False
        try:
            self.sky.add_sentence(sentence)
            self._add_sentence_heading(found, sentence, arrived_s)
            lacks_fix = nmea_places.lacks_fix(sentence)
        except (ValueError, IndexError) as error:
            self._refuse(f"{sentence.kind} that cannot be read: {error}")
        self._add_nmea(found, fixes, arrived_s)
        if lacks_fix and not self._is_outranked(Rank.NMEA, arrived_s):
            self._lack_fix(found, nmea_places.explain(sentence), arrived_s)

    def _add_nmea(self, found: Stamped, fixes: list[nmea.StampedFix], arrived_s: float) -> None:
        for fix in fixes:
            if not self._is_outranked(Rank.NMEA, arrived_s):
                self._add_fix(found, fix, arrived_s)

    def _add_sentence_heading(
        self, found: Stamped, sentence: nmea.Sentence, arrived_s: float
    ) -> None:
        heading = read_heading(sentence)
        if heading is None:
            return
        has_better = arrived_s - self._accurate_heading_s < SILENT_S
        if heading.std_deg is None and has_better:
            return
        self._accurate_heading_s = (
            self._accurate_heading_s if heading.std_deg is None else arrived_s
        )
        made = self._mount.make_heading(heading.heading_deg, heading.std_deg)
        found.append((self._from_nmea.find_stamp_s(heading.time), made))

    def _add_heading(
        self, found: Stamped, heading: ubx.Baseline | sbf.SbfHeading | unicore_fixes.UnicoreHeading,
        arrived_s: float,
    ) -> None:  # fmt: skip
        self._accurate_heading_s = arrived_s
        made = self._mount.make_heading(heading.heading_deg, heading.std_deg)
        found.append((heading.stamp_s, made))

    def _note_epoch(self, rank: Rank, arrived_s: float) -> None:
        self._epochs_s[rank] = arrived_s

    def _is_outranked(self, rank: Rank, arrived_s: float) -> bool:
        return any(
            other > rank and arrived_s - at_s < SILENT_S for other, at_s in self._epochs_s.items()
        )

    def _add_fix(self, found: Stamped, fix: nmea.StampedFix, arrived_s: float) -> None:
        self.last_fix = fix
        if fix.fix.unmeasured:
            self.heard.add_reason(NAMED[fix.fix.unmeasured], arrived_s)
        else:
            self.heard.add_fix(arrived_s)
        found.append((fix.stamp_s, fix.fix))
        self._add_status(found, fix.stamp_s, arrived_s)

    def _lack_fix(self, found: Stamped, reason: str, arrived_s: float) -> None:
        self.heard.add_reason(reason, arrived_s)
        self._add_status(found, 0.0, arrived_s)

    def _add_status(self, found: Stamped, stamp_s: float, arrived_s: float) -> None:
        status = self.sky.make_status(stamp_s, arrived_s)
        if status is not None:
            found.append((stamp_s, status))


def _explain_pvt(frame: ubx.UbxFrame) -> str:
    """Say why a NAV-PVT is no fix, where its receiver does not search."""
    fix_type, is_ok = ubx.read_fix_type(frame.payload)
    return NOT_OK if fix_type in ubx.FIX_TYPES and not is_ok else ""
