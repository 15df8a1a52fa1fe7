"""Add panels to the operator's page from Python: a map layer, a form, a button, an image, a plot.

python examples/03_panels_of_your_own.py --stay     # open the address that it prints
"""

from __future__ import annotations

import io
import sys
from pathlib import Path
from tempfile import mkdtemp

import msgspec
from PIL import Image

import agribot
from agribot import panels
from agribot.core.geo import MapFrame
from agribot.ui.address import Address


class Spraying(msgspec.Struct):
    litres_per_ha: float = 150.0
    note: str = ""


def main() -> None:
    staying = "--stay" in sys.argv
    settings = agribot.load("farm", ["perception.enabled=false", "duration_s=10"])
    frame = MapFrame(settings.field.datum)
    marks: list[dict[str, object]] = []

    def mark() -> str:
        estimate = run.last.estimate if run.last else None
        if estimate is None or not estimate.ok:
            return "no position yet"
        lat_deg, lon_deg, _ = frame.geodetic_from_map(estimate.x_map_m, estimate.y_map_m)
        place = {"type": "Point", "coordinates": [lon_deg, lat_deg]}
        marks.append({"type": "Feature", "geometry": place, "properties": {}})
        return f"{len(marks)} marks"

    def sky() -> bytes:
        file = io.BytesIO()
        Image.new("RGB", (64, 32), (90, 150, 230)).save(file, format="PNG")
        return file.getvalue()

    panels.layer(
        "Marks", lambda: {"type": "FeatureCollection", "features": marks}, {"color": "#d07000"}
    )
    panels.button("Mark this place", mark, needs_seat=False)
    panels.form(Spraying, lambda given: sys.stdout.write(f"{given}\n"))
    panels.image("Sky", sky, refresh_s=5.0)
    panels.plot("Speeds", ["v_mps", "v_commanded_mps"])

    with (
        agribot.simulate(settings, Path(mkdtemp())) as run,
        agribot.OperatorPage(run, Address(port=None), panels.shared) as page,
    ):
        sys.stdout.write(f"page: {page.url}\n")
        for record in run.ticks():
            if round(record.batch.t_s * 50) == 250:
                sys.stdout.write(f"after 5 s: {mark()}\n")
        run.finish()
        if staying:
            for _ in run.idle():
                pass


if __name__ == "__main__":
    main()
