"""The single geometries in GeoJSON (RFC 7946), whatever they are collected in."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

Member = tuple[dict[str, Any], dict[str, Any]]


def list_geometries(node: dict[str, Any]) -> Iterator[Member]:
    """List points, lines and polygons with the properties of their features.

    Features without a place are left out, collections and multi-geometries split.
    Raises: KeyError, TypeError, AttributeError: no GeoJSON.
    """
    if node["type"] == "FeatureCollection":
        for feature in node["features"]:
            yield from list_geometries(feature)
    elif node["type"] == "Feature":
        properties = node.get("properties") or {}
        for geometry in split_geometry(node["geometry"]):
            yield geometry, properties
    else:
        for geometry in split_geometry(node):
            yield geometry, {}


def split_geometry(geometry: dict[str, Any] | None) -> Iterator[dict[str, Any]]:
    """Split a collection or a multi-geometry into single ones; nothing of none."""
    if geometry is None:
        return
    if not isinstance(geometry, dict):
        raise TypeError(f"expected a GeoJSON object, got {type(geometry).__name__}")
    kind = str(geometry["type"])
    if kind == "GeometryCollection":
        for part in geometry["geometries"]:
            yield from split_geometry(part)
    elif kind.startswith("Multi"):
        for coordinates in geometry["coordinates"]:
            yield {"type": kind.removeprefix("Multi"), "coordinates": coordinates}
    else:
        yield geometry
