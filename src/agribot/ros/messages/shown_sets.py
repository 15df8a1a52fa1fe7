"""Messages that add up: markers, textured markers, a grid with its updates, a route and a place."""

from __future__ import annotations

import math
from collections import OrderedDict
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from agribot.ros.messages.shown_messages import (
    Place,
    ShownMessage,
    UnknownFrame,
    Value,
    show_header,
    show_message,
    to_base64,
    to_plain,
)
from agribot.ros.messages.shown_pictures import MOST_TEXTURE_PX, read_picture, shrink, to_file
from agribot.ros.messages.shown_types import GRID_UPDATE, ROUTE_POSITION

Cells = npt.NDArray[np.int8]

MOST_MARKERS = 2000
MOST_MARKER_POINTS = 20_000  # points of all markers together
MOST_CELLS = 400_000
MOST_TEXTURES = 8
_DELETE, _DELETE_ALL = 2, 3
_MESH = 10
_GRID = "nav_msgs/msg/OccupancyGrid"
_ROUTE = "marti_nav_msgs/msg/Route"
_UNKNOWN = -1


class TopicView(Protocol):
    """State of one topic's messages."""

    def take(self, message: Any, t_s: float) -> None:
        """Take a message that arrived at `t_s`."""
        ...

    def show(self, place: Place, t_s: float) -> ShownMessage | None:
        """Show what there is at `t_s`; None before the first message.

        Raises: UnknownFrame: a frame is not known. BridgeError: a picture cannot be read.
        """
        ...


class NewestView:
    """View of messages that stand for themselves: the newest."""

    def __init__(self) -> None:
        self._message: Any = None

    def take(self, message: Any, _t_s: float) -> None:
        self._message = message

    def show(self, place: Place, _t_s: float) -> ShownMessage | None:
        return None if self._message is None else show_message(self._message, place)


class _LivingMarkers:
    """Markers by namespace and number, until they are deleted or their time is over."""

    def __init__(self) -> None:
        self._markers: OrderedDict[tuple[str, int], tuple[Any, float]] = OrderedDict()
        self._heard = False

    def take(self, message: Any, t_s: float) -> None:
        self._heard = True
        for marker in getattr(message, "markers", [message]):
            self._take_one(marker, t_s)

    def _take_one(self, marker: Any, t_s: float) -> None:
        key = (marker.ns, int(marker.id))
        self._markers.pop(key, None)
        if marker.action != _DELETE:
            self._markers[key] = (marker, _end_of_life_s(marker, t_s))
            if len(self._markers) > MOST_MARKERS:
                self._markers.popitem(last=False)

    def _list_living(self, t_s: float) -> list[Any]:
        return [marker for marker, end_s in self._markers.values() if t_s < end_s]


class MarkerView(_LivingMarkers):
    """Shapes that one message can delete together."""

    def _take_one(self, marker: Any, t_s: float) -> None:
        if marker.action == _DELETE_ALL:
            self._markers.clear()
        else:
            super()._take_one(marker, t_s)

    def show(self, place: Place, t_s: float) -> ShownMessage | None:
        if not self._heard:
            return None
        living = self._list_living(t_s)
        shown: list[Value] = [{"action": _DELETE_ALL, "type": 0}]
        unknown: dict[str, int] = {}
        room, cut = MOST_MARKER_POINTS, 0
        for marker in living:
            try:
                header = show_header(marker.header, place)
            except UnknownFrame as error:
                unknown[str(error)] = unknown.get(str(error), 0) + 1
                continue
            cut += max(0, len(marker.points) - max(0, room))
            shown.append(_show_marker(marker, header, max(0, room)))
            room -= len(marker.points)
        meshes = sum(marker.type == _MESH for marker in living)
        problems = [f"{count} of {len(living)} markers: {why}" for why, count in unknown.items()]
        left_out = [f"{cut:,} points of markers left out"] * (cut > 0)
        left_out += [f"{meshes} meshes drawn as boxes"] * (meshes > 0)
        return ShownMessage({"markers": shown}, "; ".join(left_out), "; ".join(problems[:2]))


def _show_marker(marker: Any, header: Value, room: int) -> Value:
    return {
        "header": header,
        "ns": marker.ns,
        "id": int(marker.id),
        "type": int(marker.type),
        "action": 0,
        "pose": to_plain(marker.pose),
        "scale": to_plain(marker.scale),
        "color": to_plain(marker.color),
        "points": to_plain(marker.points[:room]),
        "colors": to_plain(marker.colors[:room]),
        "text": marker.text[:200],
    }


def _end_of_life_s(marker: Any, t_s: float) -> float:
    life = marker.lifetime
    life_s = float(life.sec) + 1e-9 * float(life.nanosec)
    return t_s + life_s if life_s > 0.0 else math.inf


class GridView:
    """An occupancy grid and the rectangles of it that changed."""

    def __init__(self) -> None:
        self._grid: Any = None
        self._cells: Cells = np.zeros((0, 0), dtype=np.int8)

    def take(self, message: Any, _t_s: float) -> None:
        if message.__msgtype__ == GRID_UPDATE:
            self._change(message)
            return
        height, width = int(message.info.height), int(message.info.width)
        cells = np.asarray(message.data, dtype=np.int8)
        if cells.size == height * width:
            self._grid, self._cells = message, cells.reshape(height, width).copy()

    def _change(self, update: Any) -> None:
        x, y, width, height = (int(getattr(update, n)) for n in ("x", "y", "width", "height"))
        cells = np.asarray(update.data, dtype=np.int8)
        rows, columns = self._cells.shape
        is_inside = 0 <= x <= columns - width and 0 <= y <= rows - height
        if is_inside and cells.size == width * height:
            self._cells[y : y + height, x : x + width] = cells.reshape(height, width)

    def show(self, place: Place, _t_s: float) -> ShownMessage | None:
        if self._grid is None:
            return None
        info = self._grid.info
        every = max(1, math.ceil(math.sqrt(self._cells.size / MOST_CELLS)))
        cells = _fold_cells(self._cells, every)
        height, width = cells.shape
        value = {
            "header": show_header(self._grid.header, place),
            "info": {
                "resolution": float(info.resolution) * every,
                "width": width,
                "height": height,
                "origin": to_plain(info.origin),
            },
            "data": to_base64(cells),
        }
        rows, columns = self._cells.shape
        note = f"{columns} x {rows} cells folded to {width} x {height}" if every > 1 else ""
        return ShownMessage(value, note)


class RouteView:
    """A route, and the place on it that somebody is at."""

    def __init__(self) -> None:
        self._route: Any = None
        self._position: Any = None

    def take(self, message: Any, _t_s: float) -> None:
        if message.__msgtype__ == ROUTE_POSITION:
            self._position = message
        else:
            self._route = message

    def show(self, place: Place, _t_s: float) -> ShownMessage | None:
        if self._route is None:
            return None
        shown = show_message(self._route, place)
        position_m = self._find_position_m()
        known = {} if position_m is None else {"position_m": position_m}
        return shown._replace(value=shown.value | known)

    def _find_position_m(self) -> float | None:
        """Find how far along the route the place is; None where its point is not on the route."""
        passed_m, before = 0.0, None
        for point in self._route.route_points if self._position is not None else ():
            at = point.pose.position
            passed_m += 0.0 if before is None else math.hypot(at.x - before.x, at.y - before.y)
            if point.id == self._position.id:
                return passed_m + float(self._position.distance)
            before = at
        return None


def _fold_cells(cells: Cells, every: int) -> Cells:
    """Make one cell of a square of them: the most occupied; unknown is less than free."""
    if every == 1:
        return cells
    height, width = (-(-side // every) for side in cells.shape)
    padded = np.full((height * every, width * every), _UNKNOWN, dtype=np.int8)
    padded[: cells.shape[0], : cells.shape[1]] = cells
    folded: Cells = padded.reshape(height, every, width, every).max(axis=(1, 3))
    return folded


class TextureView(_LivingMarkers):
    """Textured markers, each a picture on the ground."""

    def show(self, place: Place, t_s: float) -> ShownMessage | None:
        if not self._heard:
            return None
        living = self._list_living(t_s)
        kept = living[-MOST_TEXTURES:]
        notes = [f"the newest {MOST_TEXTURES} of {len(living)} pictures"] * (
            len(kept) < len(living)
        )
        shown = []
        for marker in kept:
            value, note = _show_texture(marker, place)
            shown.append(value)
            notes += [note] * bool(note)
        return ShownMessage({"markers": shown}, "; ".join(notes[:3]))


def _show_texture(marker: Any, place: Place) -> tuple[Value, str]:
    header = show_header(marker.header, place)
    whole = read_picture(marker.image)
    picture, note = shrink(whole, MOST_TEXTURE_PX)
    value = {
        "header": header,
        "pose": to_plain(marker.pose),
        "resolution": float(marker.resolution) * whole.width / picture.width,
        "alpha": to_plain(float(marker.alpha)),
        "image": to_file(picture, "png"),
    }
    return value, note


def make_view(ros_type: str) -> TopicView:
    """Make the view of a topic of this type."""
    if ros_type.startswith("visualization_msgs/msg/Marker"):
        return MarkerView()
    if ros_type.startswith("marti_visualization_msgs/msg/TexturedMarker"):
        return TextureView()
    if ros_type in (_ROUTE, ROUTE_POSITION):
        return RouteView()
    return GridView() if ros_type in (_GRID, GRID_UPDATE) else NewestView()


def adds_up(ros_type: str) -> bool:
    """Return whether every message of this type counts, not the newest alone."""
    return not isinstance(make_view(ros_type), NewestView)
