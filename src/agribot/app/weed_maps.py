"""The weed map of a run, of a recording, or of a file in any of the formats."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import msgspec

from agribot.app.whole_job import FILE_NAME, JobSoFar
from agribot.autonomy.weeds.plant_table import PlantTable
from agribot.core.errors import RecordingError
from agribot.gis.weeds.files import read_map
from agribot.record.replay import read_config, read_weed_map
from agribot.record.weeds import WEED_FILE, tabulate_run

RECORDING = "run.mcap"


def open_map(place: str, classes: Mapping[str, str] | None = None) -> PlantTable:
    """Open PATH, or NAME=PATH to give the map of one run another name.

    A run that was cut off has its map in `job.json`.
    Raises: RecordingError: no weed map there, or a broken one.
    """
    name, separator, rest = place.partition("=")
    path = Path(rest if separator else place)
    name = name if separator else ""
    if separator and not name:
        raise RecordingError(f"'{place}': no name; write NAME=PATH")
    table = _open(path, classes)
    if not name:
        return table
    if len(table.maps) > 1:
        raise RecordingError(
            f"{path} is merged from {len(table.maps)} maps; only the map of one run can be named"
        )
    return table._replace(maps=(name,))


def _open(path: Path, classes: Mapping[str, str] | None) -> PlantTable:
    if path.is_dir():
        return _open_run(path)
    if path.suffix == ".mcap":
        return _open_recording(path)
    return read_map(path, path.name.partition(".")[0], classes)


def _open_run(folder: Path) -> PlantTable:
    if (folder / WEED_FILE).is_file():
        return read_map(folder / WEED_FILE, folder.resolve().name)
    job = folder / FILE_NAME
    if job.is_file() and (folder / RECORDING).is_file():
        try:
            done = msgspec.json.decode(job.read_bytes(), type=JobSoFar)
        except msgspec.MsgspecError as error:
            raise RecordingError(
                f"{job} is broken: {error}; name the run's weeds.geojson"
            ) from error
        plants = [track.message() for track in done.plants if track.is_mapped]
        name = Path(done.runs[0].folder).name if done.runs else folder.name
        return tabulate_run(plants, read_config(folder / RECORDING), name)
    if (folder / RECORDING).is_file():
        return _open_recording(folder / RECORDING)
    raise RecordingError(
        f"{folder} holds no weed map: neither {WEED_FILE} nor {RECORDING}; name the folder of a run"
    )


def _open_recording(path: Path) -> PlantTable:
    return tabulate_run(read_weed_map(path), read_config(path), path.resolve().parent.name)
