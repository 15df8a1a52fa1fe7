"""A program of the tests, for the Python of QGIS: open vector layers and print how QGIS sees them.

Takes files as arguments, FILE or FILE|layername=NAME, and writes what it sees to stdout as JSON.
"""

from __future__ import annotations

import json
import sys
from typing import Any

from qgis.core import (  # type: ignore[import-not-found]
    QgsApplication,
    QgsExpressionContextUtils,
    QgsRenderContext,
    QgsVectorLayer,
)


def look_at(place: str) -> dict[str, Any]:
    layer = QgsVectorLayer(place, "layer", "ogr")
    if not layer.isValid():
        return {"valid": False}
    layer.loadDefaultStyle()
    renderer = layer.renderer()
    found: dict[str, Any] = {
        "valid": True,
        "crs": layer.crs().authid(),
        "count": layer.featureCount(),
        "renderer": renderer.type(),
        "drawn": {},
    }
    context = QgsRenderContext()
    expressions = context.expressionContext()
    expressions.appendScopes(QgsExpressionContextUtils.globalProjectLayerScopes(layer))
    renderer.startRender(context, layer.fields())
    for feature in layer.getFeatures():
        expressions.setFeature(feature)
        symbol = renderer.symbolForFeature(feature, context)
        colour = symbol.color().name() if symbol else None
        found["drawn"][str(feature["id"])] = colour
    return found


application = QgsApplication([], False)
application.initQgis()
sys.stdout.write(json.dumps([look_at(place) for place in sys.argv[1:]]) + "\n")
