"""The nodes of gps_umd: `fix-translator`, `utm-odometry` and `utm-odometry-to-navsatfix`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from agribot.core.errors import RecordingError
from agribot.core.topics import Topic
from agribot.ros.messages import fixes, utm
from agribot.ros.messages.gps_types import GPSFIX_ROS1, GPSFIX_ROS2
from agribot.ros.messages.rosmsg import load_types
from agribot.ros.nodes.stage import EndlessStage, OutgoingMessage


def make_gps_topic(name: str) -> Topic:
    """Make a topic with a GPSFix, whose package has another name in ROS 1."""
    return Topic(
        name=name, ros_type=GPSFIX_ROS2, seed_alias=name, seed_ros_type=GPSFIX_ROS1,
        about="a fix of gps_umd",
    )  # fmt: skip


NAVSAT_IN = Topic(name="/navsat_fix_in", ros_type=fixes.NAVSATFIX)
NAVSAT_OUT = Topic(name="/navsat_fix_out", ros_type=fixes.NAVSATFIX)
GPS_IN, GPS_OUT = make_gps_topic("/gps_fix_in"), make_gps_topic("/gps_fix_out")


class FixTranslator(EndlessStage):
    """Publishes every NavSatFix as a GPSFix, and every GPSFix as a NavSatFix."""

    inputs = (NAVSAT_IN, GPS_IN)
    outputs = (GPS_OUT, NAVSAT_OUT)

    def receive(self, topic: Topic, message: Any, t_s: float) -> Sequence[OutgoingMessage]:
        if topic is NAVSAT_IN:
            translated = fixes.gpsfix_from_navsatfix(message, load_types(), is_ros2=True)
            return (OutgoingMessage(GPS_OUT, translated),)
        return (OutgoingMessage(NAVSAT_OUT, fixes.navsatfix_from_gpsfix(message, load_types())),)


class UtmSettings(NamedTuple):
    """Parameters of the original's nodes, under their names."""

    frame_id: str = ""
    child_frame_id: str = ""
    rot_covariance: float = utm.ROT_COVARIANCE
    append_zone: bool = False
    zone: utm.UtmZone | None = None


class UtmOdometry(EndlessStage):
    """Publishes fixes as odometry on the UTM grid; leaves out invalid and unstamped ones.

    The zone is that of the first fix, so that a robot that drives out of it makes no step.
    """

    def __init__(self, settings: UtmSettings, fix: str = "/fix", odometry: str = "/odom") -> None:
        self._settings, self._zone = settings, settings.zone
        self.inputs = (Topic(name=fix, ros_type=fixes.NAVSATFIX),)
        self.outputs = (Topic(name=odometry, ros_type=utm.ODOMETRY),)

    def receive(self, topic: Topic, message: Any, t_s: float) -> Sequence[OutgoingMessage]:
        settings = self._settings
        try:
            if self._zone is None and message.status.status >= 0:
                self._zone = utm.find_zone(message.latitude, message.longitude)
            made = utm.odometry_from_fix(
                message, load_types(), self._zone, settings.frame_id, settings.child_frame_id,
                settings.rot_covariance, settings.append_zone,
            )  # fmt: skip
        except RecordingError as error:
            self.reason = str(error)
            return ()
        self.reason = "" if made is not None else f"{topic.name} has no fix, or no stamp"
        return (OutgoingMessage(self.outputs[0], made),) if made is not None else ()


class UtmToNavSatFix(EndlessStage):
    """Publishes odometry on the UTM grid as fixes; its frame or the settings give the zone."""

    def __init__(self, settings: UtmSettings, odometry: str = "/odom", fix: str = "/fix") -> None:
        self._settings = settings
        self.inputs = (Topic(name=odometry, ros_type=utm.ODOMETRY),)
        self.outputs = (Topic(name=fix, ros_type=fixes.NAVSATFIX),)

    def receive(self, topic: Topic, message: Any, t_s: float) -> Sequence[OutgoingMessage]:
        settings = self._settings
        try:
            fix = utm.fix_from_odometry(message, load_types(), settings.zone, settings.frame_id)
        except RecordingError as error:
            self.reason = str(error)
            return ()
        self.reason = ""
        return (OutgoingMessage(self.outputs[0], fix),)
