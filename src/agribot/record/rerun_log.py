"""A recording for Rerun: map, pictures, curves and a place on Earth."""

from __future__ import annotations

import math
import os
import shutil
import sys
import sysconfig
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from agribot.core import topics
from agribot.core.errors import ConfigError
from agribot.core.extras import format_install
from agribot.core.messages import MissionStatus
from agribot.record.bag.opening import open_bag
from agribot.record.foreign import ForeignData, read_foreign

_NAME = "agribot"
_SCREENS = ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")
_TIMELINE = "robot_time"
_NUMBERS = (
    topics.DISTANCE, topics.BEARING, topics.ANGLE, topics.HEADING_RAW, topics.HEADING_FILTERED,
)  # fmt: skip
_GREEN, _BLUE, _WHITE = (20, 190, 60), (30, 140, 255), (230, 230, 230)
_LINE_M, _GOAL_M = 0.02, 0.12
_UNKNOWN_M = 100.0  # deviation that means no place yet
Show = Callable[[Any], None]


def write_rerun(recording: Path, target: Path | None) -> int:
    """Write an .rrd file, or with None send to the viewer, which is started; count the messages.

    Of another robot's recording: its tracks and curves, and how many points they have.

    Raises: ConfigError: rerun-sdk is not installed, or its viewer cannot open. RecordingError: it
        cannot be read, or nothing in it can be shown.
    """
    try:
        import rerun
    except ImportError as error:
        raise ConfigError(
            f"agribot view rerun needs rerun-sdk; {format_install('view')}"
        ) from error
    stream: Any = rerun.RecordingStream(_NAME)
    shower, count = _RerunWriter(rerun, stream), 0
    with open_bag(recording) as bag:
        known = {t.name for t in bag.topics if t.count and t.name in shower.shows and bag.knows(t)}
        foreign = None if known else read_foreign(recording)
        if target is None:
            _start_viewer(stream)
        else:
            stream.save(str(target))
        stream.send_blueprint(_lay_out(rerun.blueprint))
        for message, value in bag.values(frozenset(known)) if known else ():
            stream.set_time(_TIMELINE, duration=message.log_ns * 1e-9)
            shower.shows[message.topic.name](value)
            count += 1
    if foreign is not None:
        count = shower.foreign(foreign)
    shower.finish()
    stream.disconnect()  # writes the end of the file
    return count


def _start_viewer(stream: Any) -> None:
    """Start the viewer that was installed with this program, else that of the PATH.

    Raises: ConfigError: no viewer is installed, or there is no screen for it.
    """
    program = shutil.which("rerun", path=sysconfig.get_path("scripts")) or shutil.which("rerun")
    instead = "-o FILE.rrd writes a file that 'rerun FILE.rrd' opens on any machine"
    if program is None:
        raise ConfigError(
            f"Rerun's viewer is not installed; {format_install('view')}, or {instead}"
        )
    if sys.platform == "linux" and not any(map(os.environ.get, _SCREENS)):
        raise ConfigError(f"Rerun's viewer needs a screen, and DISPLAY is not set; {instead}")
    # Rerun looks for it in the PATH alone.
    os.environ["PATH"] = os.pathsep.join((str(Path(program).parent), os.environ.get("PATH", "")))
    stream.spawn()


def _lay_out(views: Any) -> Any:
    """Put map and camera above, curves that belong together below."""

    def curves(name: str, *topics_of_it: str) -> Any:
        contents = [f"/curves/{topic}" for topic in topics_of_it]
        return views.TimeSeriesView(origin="/curves", name=name, contents=contents)

    pictures = views.Vertical(
        views.Spatial2DView(origin="/camera/image", name="camera"),
        views.Tabs(
            views.Spatial2DView(origin="/camera/network", name="what the network sees"),
            views.MapView(origin="/earth", name="on Earth"),
            views.TextLogView(origin="/mission", name="mission"),
        ),
    )
    plots = views.Horizontal(
        curves("speed, m/s", "speed_mps", "commanded_mps"),
        curves("turn rate, rad/s", "commanded_radps"),
        curves("heading, deg", "heading/raw", "heading/filtered"),
        curves("to the goal, m", "distance"),
    )
    above = views.Horizontal(
        views.Spatial3DView(origin="/map", name="map"), pictures, column_shares=[3, 2]
    )
    return views.Blueprint(
        views.Vertical(above, plots, row_shares=[3, 1]),
        views.BlueprintPanel(state="collapsed"),
        views.SelectionPanel(state="collapsed"),
        views.TimePanel(state="collapsed"),
        auto_views=False,
    )


class _RerunWriter:
    """Writer of each topic's look; the tracks are drawn when all messages are read."""

    def __init__(self, rerun: Any, stream: Any) -> None:
        self._rerun, self._stream = rerun, stream
        self._tracks: dict[str, list[tuple[float, float, float]]] = {}
        self._state = ""
        self.shows: dict[str, Show] = {
            topics.ODOMETRY.name: self._estimate,
            topics.GROUND_TRUTH.name: self._truth,
            topics.PATH.name: self._plan,
            topics.GOALS.name: self._goals,
            topics.WEEDS.name: self._weeds,
            topics.IMAGE.name: lambda m: self._picture("camera/image", m),
            topics.OVERLAY.name: lambda m: self._picture("camera/network", m),
            topics.FIX.name: self._fix,
            topics.CMD_VEL.name: self._command,
            topics.STATUS.name: self._status,
        }
        for topic in _NUMBERS:
            self.shows[topic.name] = self._number(topic.name.removeprefix("/agribot/"))

    def finish(self) -> None:
        for name, points in self._tracks.items():
            colour = _WHITE if name == "truth" else _GREEN
            self._lines(f"map/{name}", [points], colour)

    def foreign(self, data: ForeignData) -> int:
        """Log tracks and the first curve of each kind; count their points."""
        curves = {
            "speed_mps": data.speed, "heading/raw": data.heading_raw,
            "heading/filtered": data.heading_filtered, "distance": data.distance,
        }  # fmt: skip
        shown = [line.points for line in data.tracks]
        for line in data.tracks:
            name = line.label.strip("/").replace(" ", "_")
            self._lines(f"map/{name}", [np.pad(line.points, ((0, 0), (0, 1)))], _GREEN)
        for name, lines in curves.items():
            for t_s, value in lines[0].points.tolist() if lines else ():
                self._stream.set_time(_TIMELINE, duration=t_s)
                self._curve(f"curves/{name}", value)
            shown += [line.points for line in lines[:1]]
        return sum(len(points) for points in shown)

    def _log(self, path: str, what: Any, *, static: bool = False) -> None:
        self._stream.log(path, what, static=static)

    def _curve(self, path: str, value: float) -> None:
        if math.isfinite(value):
            self._log(path, self._rerun.Scalars(value))

    def _lines(self, path: str, lines: Any, colour: tuple[int, int, int]) -> None:
        shape = self._rerun.LineStrips3D(lines, colors=[colour], radii=[_LINE_M])
        self._log(path, shape, static=True)

    def _number(self, name: str) -> Show:
        return lambda message: self._curve(f"curves/{name}", float(message.data))

    def _estimate(self, message: Any) -> None:
        place, turn = message.pose.pose.position, message.pose.pose.orientation
        std_m = math.sqrt(max(message.pose.covariance[0], message.pose.covariance[7], 0.0))
        if std_m > _UNKNOWN_M:
            return
        self._tracks.setdefault("estimate", []).append((place.x, place.y, 0.0))
        rerun = self._rerun
        pose = rerun.Transform3D(
            translation=(place.x, place.y, place.z),
            quaternion=rerun.Quaternion(xyzw=(turn.x, turn.y, turn.z, turn.w)),
        )
        self._log("map/robot", pose)
        self._log("map/robot", rerun.Arrows3D(vectors=[(0.5, 0, 0)], radii=[0.05]), static=True)
        self._curve("curves/position_std_m", std_m)
        self._curve("curves/speed_mps", float(message.twist.twist.linear.x))

    def _truth(self, message: Any) -> None:
        place = message.pose.pose.position
        self._tracks.setdefault("truth", []).append((place.x, place.y, 0.0))

    def _plan(self, message: Any) -> None:
        places = [stamped.pose.position for stamped in message.poses]
        self._lines("map/plan", [[(p.x, p.y, 0.0) for p in places]], _BLUE)

    def _goals(self, message: Any) -> None:
        places = [(pose.position.x, pose.position.y, 0.0) for pose in message.poses]
        points = self._rerun.Points3D(places, colors=[_GREEN], radii=[_GOAL_M])
        self._log("map/goals", points, static=True)

    def _weeds(self, message: Any) -> None:
        for marker in message.markers:
            places = [(p.x, p.y, p.z) for p in marker.points]
            colour = tuple(round(255 * c) for c in (marker.color.r, marker.color.g, marker.color.b))
            points = self._rerun.Points3D(places, colors=[colour], radii=[marker.scale.x / 2.0])
            self._log(f"map/plants/{marker.ns}", points)

    def _picture(self, path: str, message: Any) -> None:
        data = np.asarray(message.data).tobytes()
        self._log(path, self._rerun.EncodedImage(contents=data, media_type="image/jpeg"))

    def _fix(self, message: Any) -> None:
        self._log(
            "earth/fix", self._rerun.GeoPoints(lat_lon=[(message.latitude, message.longitude)])
        )

    def _command(self, message: Any) -> None:
        self._curve("curves/commanded_mps", float(message.linear.x))
        self._curve("curves/commanded_radps", float(message.angular.z))

    def _status(self, message: Any) -> None:
        status = msgspec.json.decode(message.data, type=MissionStatus)
        state = ": ".join(filter(None, (status.state, status.leg, status.reason)))
        if state != self._state:
            self._state = state
            self._log("mission", self._rerun.TextLog(state))
