"""Layers that programs outside of the robot add to the map: by HTTP, or by a message of ROS."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec
from msgspec import UNSET

from agribot.ui import wire

MOST_LAYERS = 32
MOST_BYTES = 2_000_000  # size of one layer's data
MOST_NAME = 60
TOPIC = "/agribot/layers"  # std_msgs/String with the same JSON as the body of a PUT
PREFIX = "outside-"


class BadLayer(Exception):
    """A layer that cannot be taken, and why, in one sentence."""


class LayerOrder(wire.OutsideLayer, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a message of ROS asks for: a layer, or (`action`) its end."""

    action: str = "set"


class OutsideLayers:
    """The layers by name. They live as long as the page's server.

    `is_known` returns whether a type of display is known.
    """

    def __init__(self, is_known: Callable[[str], bool]) -> None:
        self._is_known = is_known
        self._layers: dict[str, tuple[wire.OutsideLayer, bytes]] = {}

    def set(self, layer: wire.OutsideLayer) -> str:
        """Add a layer, or replace the one of its name; return its id.

        Raises: BadLayer: no name, an unknown type, too large, or one too many.
        """
        name = layer.name.strip()
        if not 0 < len(name) <= MOST_NAME or not name.isprintable():
            raise BadLayer(
                f"name '{name[:80]}' is unusable; give 1 to {MOST_NAME} printable letters"
            )
        if not self._is_known(layer.type):
            raise BadLayer(f"type '{layer.type[:40]}' is no display; see docs/operator-page.md")
        if (layer.data is None) == (not layer.topic):
            raise BadLayer("data and topic, or neither; give data or a topic such as ros1:/scan")
        if layer.type == "geojson" and not layer.topic:
            _check_geojson(layer.data)
        data = msgspec.json.encode(layer.data)
        if len(data) > MOST_BYTES:
            raise BadLayer(f"{len(data)} bytes of data: at most {MOST_BYTES}; thin it")
        if name not in self._layers and len(self._layers) >= MOST_LAYERS:
            raise BadLayer(f"{MOST_LAYERS} layers are there already; delete one")
        self._layers[name] = (msgspec.structs.replace(layer, name=name, data=None), data)
        return make_id(name)

    def remove(self, name: str) -> bool:
        """Remove a layer; False where none has this name."""
        return self._layers.pop(name, None) is not None

    def obey(self, text: str) -> str:
        """Do what a message of ROS asks for; return what was done.

        Raises: BadLayer: it is no JSON of a layer, or the layer cannot be taken.
        """
        try:
            order = msgspec.json.decode(text, type=LayerOrder)
        except (msgspec.DecodeError, RecursionError) as error:
            raise BadLayer(f"not the JSON of a layer: {error}; correct it") from error
        if order.action == "delete":
            return (
                f"layer '{order.name}' {'removed' if self.remove(order.name) else 'is not there'}"
            )
        if order.action != "set":
            raise BadLayer(f"action '{order.action[:20]}' is unknown; give set or delete")
        fields = {name: getattr(order, name) for name in wire.OutsideLayer.__struct_fields__}
        self.set(wire.OutsideLayer(**fields))
        return f"layer '{order.name}' set"

    def find_order(self, name: str) -> int | None:
        """Find the draw order of a layer; None where it is new or has none."""
        layer, _ = self._layers.get(name.strip(), (None, b""))
        return layer.draw_order if layer else None

    def names(self) -> list[str]:
        return sorted(self._layers)

    def infos(self) -> list[wire.PanelInfo]:
        """Describe the layers like those of Python panels."""
        return [
            wire.PanelInfo(
                id=make_id(name),
                kind="layer",
                title=name,
                type=layer.type,
                style=layer.style,
                refresh_s=1.0,
                visible=layer.visible,
                draw_order=UNSET if layer.draw_order is None else layer.draw_order,
                topic=layer.topic or UNSET,
            )
            for name, (layer, _) in self._layers.items()
        ]

    def read(self, id: str) -> bytes | None:
        """Read the data of a layer as JSON; None where there is no such layer."""
        for name, (_, data) in self._layers.items():
            if make_id(name) == id:
                return data
        return None


def make_id(name: str) -> str:
    """Make the id of a layer, for which two names are never the same."""
    return PREFIX + name.encode().hex()


def _check_geojson(data: Any) -> None:
    if not isinstance(data, dict) or data.get("type") not in ("Feature", "FeatureCollection"):
        raise BadLayer("data of type geojson is unknown; send a Feature or a FeatureCollection")
    features = data.get("features") if data["type"] == "FeatureCollection" else [data]
    if not isinstance(features, list) or not all(_is_feature(one) for one in features):
        raise BadLayer("features are missing; send each with a geometry and its type")


def _is_feature(feature: Any) -> bool:
    if not isinstance(feature, dict):
        return False
    geometry = feature.get("geometry")
    return geometry is None or (isinstance(geometry, dict) and "type" in geometry)
