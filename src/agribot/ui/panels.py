"""Panels that a program adds to the page from Python: layers, plots, forms, images, buttons.

Each is described to the page as JSON and drawn there by a panel of its kind; no JavaScript.
"""

from __future__ import annotations

import base64
import threading
import time
from collections.abc import Callable
from typing import Any, Literal

import msgspec

GeoJson = dict[str, Any]
Action = Callable[[], object]


class Panel(msgspec.Struct, kw_only=True):
    """What the page is told, and the function behind it."""

    id: str
    kind: str
    title: str
    shown: dict[str, Any] = {}
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
        shown: dict[str, Any] = {"style": style or {}, "refresh_s": refresh_s, "type": type}
        shown["visible"] = visible
        if draw_order is not None:
            shown["draw_order"] = draw_order
        self._add(Panel(id=_id("layer", name), kind="layer", title=name, shown=shown, read=read))

    def plot(self, title: str, fields: list[str]) -> None:
        """Plot signals by their names, as `/api/v1/topics` lists them."""
        shown = {"fields": list(fields)}
        self._add(Panel(id=_id("plot", title), kind="plot", title=title, shown=shown))

    def form(
        self, model: type[msgspec.Struct], on_submit: Callable[[Any], object], title: str = ""
    ) -> None:
        """A form with a field for each of the struct's; `on_submit` gets a checked instance."""
        name = title or model.__name__
        shown = {"schema": msgspec.json.schema(model)}

        def submit(values: Any) -> object:
            return on_submit(msgspec.convert(values, model, strict=False))

        panel = Panel(id=_id("form", name), kind="form", title=name, shown=shown, submit=submit)
        self._add(panel)

    def image(self, title: str, image: Callable[[], bytes], refresh_s: float = 1.0) -> None:
        """Show what the function returns: the bytes of a PNG or JPEG file."""
        shown = {"refresh_s": refresh_s}
        panel = Panel(id=_id("image", title), kind="image", title=title, shown=shown, read=image)
        self._add(panel)

    def button(self, title: str, on_click: Action, needs_seat: bool = True) -> None:
        """`on_click` is called when somebody presses; text that it returns is shown."""
        panel = Panel(
            id=_id("button", title),
            kind="button",
            title=title,
            shown={"needs_seat": needs_seat},
            submit=lambda _values: on_click(),
        )
        self._add(panel)

    def listen(
        self,
        what: Literal["point", "polygon", "route"],
        on_points: Callable[[list[list[float]]], object],
        title: str = "",
    ) -> None:
        """`on_points` gets what the operator draws with the map's tools: [x, y] in the map, m.

        A route begins where the robot is. Text that the function returns is shown.
        """
        panel = Panel(
            id=_id("listener", title or what),
            kind="listener",
            title=title or what,
            shown={"what": what},
            submit=lambda values: on_points(msgspec.convert(values["points"], list[list[float]])),
        )
        self._add(panel)

    def answer(self, name: str, values: Any) -> Any:
        """What the server asks for: the list, the data of one panel, or a submission to it.

        Raises: LookupError: no such panel, or it is not of a kind that has this.
        """
        if name == "panels":
            return [{"id": p.id, "kind": p.kind, "title": p.title, **p.shown} for p in self._all()]
        panel = self._panels.get(values["id"])
        if panel is None:
            raise LookupError(f"no panel '{values['id']}'")
        if name == "panel_data" and panel.read is not None:
            return _readable(panel.read())
        if name == "panel_submit" and panel.submit is not None:
            result = panel.submit(values["values"])
            return {"text": "" if result is None else str(result), "at": time.time()}
        raise LookupError(f"a {panel.kind} has nothing to {name.removeprefix('panel_')}")

    def _all(self) -> list[Panel]:
        with self._lock:
            return list(self._panels.values())

    def _add(self, panel: Panel) -> None:
        with self._lock:
            self._panels[panel.id] = panel


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
