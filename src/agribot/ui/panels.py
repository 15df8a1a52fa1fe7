"""Panels that a program adds to the page from Python: layers, plots, forms, images, buttons.

Each is described to the page as JSON and drawn there by a panel of its kind; no JavaScript.
"""

from __future__ import annotations

import base64
import threading
import time
from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import msgspec
from msgspec import UNSET

from agribot.ui import wire

GeoJson = dict[str, Any]
Action = Callable[[], object]


class Panel(NamedTuple):
    """What the page gets, and the functions behind it."""

    info: wire.PanelInfo
    read: Callable[[], Any] | None = None
    submit: Callable[[Any], object] | None = None


class Panels:
    """Functions given here are called in threads of their own, never in the control loop."""

    def __init__(self) -> None:
        self._panels: dict[str, Panel] = {}
        self._lock = threading.Lock()

    def layer(
        self,
        name: str,
        geojson: GeoJson | Callable[[], GeoJson],
        style: dict[str, Any] | None = None,
        refresh_s: float = 1.0,
        *,
        type: str = "geojson",
        draw_order: int | None = None,
        visible: bool = True,
    ) -> None:
        """Draw GeoJSON (longitude, latitude) on the map; a function is asked again and again.

        `style` may hold color, width_px, radius_px and opacity. With another `type`, such as
        laserscan, marker or occupancy_grid, `geojson` is a ROS message as a dict, and `style`
        holds the options of that display. `draw_order` 0 is the top. A layer that is given again
        under its name replaces the one before.
        """
        read = geojson if callable(geojson) else lambda: geojson
        info = wire.PanelInfo(
            id=_id("layer", name),
            kind="layer",
            title=name,
            style=style or {},
            refresh_s=refresh_s,
            type=type,
            visible=visible,
            draw_order=UNSET if draw_order is None else draw_order,
        )
        self._add(Panel(info, read))

    def plot(self, title: str, fields: list[str]) -> None:
        """Plot signals by their names, as `/api/v1/topics` lists them."""
        id = _id("plot", title)
        self._add(Panel(wire.PanelInfo(id=id, kind="plot", title=title, fields=list(fields))))

    def form(
        self, model: type[msgspec.Struct], on_submit: Callable[[Any], object], title: str = ""
    ) -> None:
        """Add a form with a field for each of the struct's; `on_submit` gets a checked instance."""
        name = title or model.__name__
        schema = msgspec.json.schema(model)
        info = wire.PanelInfo(id=_id("form", name), kind="form", title=name, schema=schema)

        def submit(values: Any) -> object:
            return on_submit(msgspec.convert(values, model, strict=False))

        self._add(Panel(info, submit=submit))

    def image(self, title: str, image: Callable[[], bytes], refresh_s: float = 1.0) -> None:
        """Show what the function returns: the bytes of a PNG or JPEG file."""
        id = _id("image", title)
        info = wire.PanelInfo(id=id, kind="image", title=title, refresh_s=refresh_s)
        self._add(Panel(info, image))

    def button(self, title: str, on_click: Action, needs_seat: bool = True) -> None:
        """`on_click` is called when somebody presses; text that it returns is shown."""
        id = _id("button", title)
        info = wire.PanelInfo(id=id, kind="button", title=title, needs_seat=needs_seat)
        self._add(Panel(info, submit=lambda _values: on_click()))

    def listen(
        self,
        what: Literal["point", "polygon", "route"],
        on_points: Callable[[list[list[float]]], object],
        title: str = "",
    ) -> None:
        """`on_points` gets what the operator draws with the map's tools: [x, y] in the map, m.

        A route begins where the robot is. Text that the function returns is shown.
        """
        name = title or what
        info = wire.PanelInfo(id=_id("listener", name), kind="listener", title=name, what=what)

        def submit(values: Any) -> object:
            return on_points(msgspec.convert(values["points"], list[list[float]]))

        self._add(Panel(info, submit=submit))

    def infos(self) -> list[wire.PanelInfo]:
        with self._lock:
            return [panel.info for panel in self._panels.values()]

    def read(self, id: str) -> Any:
        """Return the data of a panel.

        Raises: LookupError: no such panel, or of a kind without data.
        """
        panel = self._find_panel(id)
        if panel.read is None:
            raise LookupError(f"a {panel.info.kind} has no data")
        return _readable(panel.read())

    def submit(self, id: str, values: Any) -> wire.PanelReply:
        """Hand in what a person entered in a panel.

        Raises: LookupError: no such panel, or of a kind that takes nothing.
        """
        panel = self._find_panel(id)
        if panel.submit is None:
            raise LookupError(f"a {panel.info.kind} takes nothing")
        result = panel.submit(values)
        return wire.PanelReply(text="" if result is None else str(result), at_s=time.time())

    def _find_panel(self, id: str) -> Panel:
        panel = self._panels.get(id)
        if panel is None:
            raise LookupError(f"no panel '{id}'")
        return panel

    def _add(self, panel: Panel) -> None:
        with self._lock:
            self._panels[panel.info.id] = panel


def _id(kind: str, title: str) -> str:
    letters = "".join(letter if letter.isalnum() else "-" for letter in title.lower())
    return f"{kind}-{letters}"


def _readable(data: Any) -> Any:
    """Bytes do not fit into JSON as they are."""
    return {"base64": base64.b64encode(data).decode()} if isinstance(data, bytes) else data


# The panels of a program that has only one page, which is nearly every program.
shared = Panels()
layer, plot, form = shared.layer, shared.plot, shared.form
image, button, listen = shared.image, shared.button, shared.listen
