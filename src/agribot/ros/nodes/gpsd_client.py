"""`gpsd-client` of gps_umd: what a gpsd reports, as NavSatFix and GPSFix."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import msgspec

from agribot.core.messages import GnssFix, GnssQuality, GnssStatus
from agribot.core.topics import Topic
from agribot.ros.messages import fixes, rosmsg
from agribot.ros.nodes.gps_umd import make_gps_topic
from agribot.ros.nodes.stage import EndlessStage, OutgoingMessage

EXTENDED_FIX = "/extended_fix"
_UNKNOWN = 0  # type of a covariance
_NOWHERE = GnssFix(
    t_s=0.0, lat_deg=math.nan, lon_deg=math.nan, alt_m=math.nan, pos_std_m=0.0,
    quality=GnssQuality.NONE,
)  # fmt: skip


class GpsdReport(NamedTuple):
    """An epoch: a fix, or none and what the receiver sees meanwhile.

    `stamp_s` is the receiver's time of the fix, 0 without one, `arrived_s` this machine's; both
    since 1970. `is_accuracy_known` says that the accuracy of the fix is the receiver's word.
    """

    stamp_s: float
    arrived_s: float
    fix: GnssFix | None
    status: GnssStatus
    is_accuracy_known: bool = False


class GpsdReports(Protocol):
    """Reports of gpsd, in a thread of their own."""

    def take(self) -> Sequence[GpsdReport]:
        """Take what has come since the last call."""
        ...

    def close(self) -> None: ...


class ClientSettings(NamedTuple):
    """Parameters of the original's node, under their names."""

    frame_id: str = "gps"
    use_gps_time: bool = True
    check_fix_by_variance: bool = True


class GpsdClient(EndlessStage):
    """Publishes every fix as NavSatFix and GPSFix, and without a fix what is seen as GPSFix.

    A NavSatFix without a stated accuracy is left out where `check_fix_by_variance` is set.
    Covariances are in m^2.
    """

    inputs: Sequence[Topic] = ()

    def __init__(self, reports: GpsdReports, settings: ClientSettings, fix: str = "/fix") -> None:
        self._reports, self._settings = reports, settings
        self._fix, self._extended = (
            Topic(name=fix, ros_type=fixes.NAVSATFIX), make_gps_topic(EXTENDED_FIX)
        )  # fmt: skip
        self.outputs = (self._fix, self._extended)
        self.reason = "gpsd has reported no receiver yet"

    def receive(self, topic: Topic, message: Any, t_s: float) -> Sequence[OutgoingMessage]:
        return ()

    def tick(self, t_s: float) -> Sequence[OutgoingMessage]:
        return [said for report in self._reports.take() for said in self._translate(report)]

    def finish(self) -> Sequence[OutgoingMessage]:
        """Let go of gpsd."""
        self._reports.close()
        return ()

    def _translate(self, report: GpsdReport) -> list[OutgoingMessage]:
        settings, found = self._settings, report.fix
        is_timed = settings.use_gps_time and report.stamp_s > 0.0
        t_s = report.stamp_s if is_timed else report.arrived_s
        fix = msgspec.structs.replace(found or _NOWHERE, t_s=t_s)
        extended = rosmsg.make_extended_fix(fix, report.status, settings.frame_id)
        extended.time = report.stamp_s
        said = [OutgoingMessage(self._extended, extended)]
        is_unknown = not report.is_accuracy_known
        if is_unknown:
            extended.position_covariance_type = _UNKNOWN
        if found is None:
            self.reason = "the receiver has no fix"
        elif is_unknown and settings.check_fix_by_variance:
            self.reason = f"gpsd states no accuracy; {self._fix.name} is left out"
        else:
            self.reason = ""
            navsat = rosmsg.make_fix(fix, settings.frame_id)
            if is_unknown:
                navsat.position_covariance_type = _UNKNOWN
            said.append(OutgoingMessage(self._fix, navsat))
        return said
