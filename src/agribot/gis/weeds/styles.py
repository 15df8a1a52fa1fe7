"""How plants of a weed map are drawn elsewhere: a colour for each decision and its outcome."""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree import ElementTree

# Colours of the report: weeds red, treated ones filled green-blue, crop green.
STYLES = {
    "crop": "#2c9a47",
    "weed": "#d6382b",
    "weed, treated": "#2f6fde",
    "weed, missed": "#d98324",
    "weed, spared": "#8a8f98",
    "weed, seen again": "#7b3fb5",
}
# The same rule as `find_style`, in the language of QGIS.
_EXPRESSION = (
    "CASE WHEN \"class\"='crop' THEN 'crop' WHEN \"outcome\" IS NOT NULL THEN 'weed, ' || "
    "\"outcome\" WHEN \"decision\"='spare' THEN 'weed, spared' ELSE 'weed' END"
)


def find_style(values: Mapping[str, object]) -> str:
    if values["class"] == "crop":
        return "crop"
    if values["outcome"] is not None:
        return f"weed, {values['outcome']}"
    return "weed, spared" if values["decision"] == "spare" else "weed"


def make_qgis_style() -> str:
    """Make the style of a layer as QGIS keeps it in a file or in a GeoPackage."""
    root = ElementTree.Element("qgis", version="3.22", styleCategories="Symbology")
    renderer = ElementTree.SubElement(
        root, "renderer-v2", type="categorizedSymbol", attr=_EXPRESSION, symbollevels="0",
        enableorderby="0", forceraster="0",
    )  # fmt: skip
    categories = ElementTree.SubElement(renderer, "categories")
    symbols = ElementTree.SubElement(renderer, "symbols")
    for number, (name, colour) in enumerate(STYLES.items()):
        ElementTree.SubElement(
            categories, "category", symbol=str(number), value=name, label=name, render="true",
            type="string",
        )  # fmt: skip
        symbol = ElementTree.SubElement(symbols, "symbol", name=str(number), type="marker")
        layer = ElementTree.SubElement(symbol, "layer", {"class": "SimpleMarker", "enabled": "1"})
        red, green, blue = (int(colour[at : at + 2], 16) for at in (1, 3, 5))
        for key, value in {
            "name": "triangle" if name == "crop" else "circle",
            "color": f"{red},{green},{blue},255",
            "outline_color": "255,255,255,255", "outline_width": "0.2", "size": "2.2",
            "size_unit": "MM",
        }.items():  # fmt: skip
            ElementTree.SubElement(layer, "prop", k=key, v=value)
    ElementTree.indent(root)
    return "<!DOCTYPE qgis>\n" + ElementTree.tostring(root, encoding="unicode")
