"""Texts and tables are read as the editors and spreadsheets of this world save them."""

from __future__ import annotations

from pathlib import Path

import pytest

from agribot.app.field_work import read_plan_text
from agribot.autonomy.plan.ways.waypoint_text import parse_waypoints
from agribot.cli.run.drive_source import read_script
from agribot.core.config import RunConfig
from agribot.core.geo import Datum
from agribot.core.table_text import (
    decode_text,
    find_encoding,
    find_separator,
    read_decimal,
    recode_text,
)
from agribot.core.toml_tree import read_toml
from agribot.description.conditions import load_condition_preset
from agribot.description.drawn_rows import read_drawn_rows
from agribot.description.markup import find_place, parse_xml
from agribot.gis.geojson import read_json
from agribot.lab.dataset.foreign.shapes import decode_json
from agribot.lab.dataset.foreign.yolo import read_names, read_yolo
from agribot.ui.small_yaml import read_yaml

# As the Notepad of Windows and its PowerShell save a text.
WINDOWS = ["utf-8-sig", "utf-16", "cp1252"]

TABLE = "name;lat;lon\nGröße;52,1;11,6\n"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_a_table_is_decoded_as_its_spreadsheet_saved_it(encoding: str) -> None:
    assert decode_text(TABLE.encode(encoding)) == TABLE


@pytest.mark.parametrize("mark", ["utf-16-le", "utf-16-be"])
def test_both_orders_of_bytes_are_read_by_their_mark_and_none_is_guessed(mark: str) -> None:
    assert decode_text(("\ufeff" + TABLE).encode(mark)) == TABLE
    with pytest.raises(ValueError, match=r"holds zero bytes.*as CSV UTF-8"):
        decode_text(TABLE.encode(mark))


def test_a_letter_that_falls_between_two_pieces_of_a_file_stays_one() -> None:
    data = TABLE.encode()
    assert find_encoding(data[i : i + 1] for i in range(len(data))) == "utf-8"


def test_a_decimal_comma_counts_where_commas_do_not_separate() -> None:
    assert find_separator("name;lat;lon") == ";"
    assert find_separator("lat,lon") == ","
    assert read_decimal("-11,625", ";") == -11.625
    for text, separator in (("11,6", ","), ("1,000,5", ";"), ("1,000.5", ";"), ("", ";")):
        with pytest.raises(ValueError, match="could not convert"):
            read_decimal(text, separator)


def test_excel_may_name_its_separator_before_the_names() -> None:
    text = "sep=;\nlat;lon\n52,5;11,6\n"
    assert parse_waypoints(text, "w.csv") == ((52.5, 11.6),)


@pytest.mark.parametrize("encoding", WINDOWS)
def test_every_text_that_people_write_is_read_as_windows_saves_it(
    encoding: str, tmp_path: Path
) -> None:
    def save(name: str, text: str) -> Path:
        path = tmp_path / name
        path.write_bytes(text.replace("\n", "\r\n").encode(encoding))
        return path

    rows = '{"type": "LineString", "rübe": 1, "coordinates": [[11.6, 48.2], [11.6, 48.2001]]}'
    assert read_toml(save("a.toml", 'name = "Rübe"\n')) == {"name": "Rübe"}
    assert load_condition_preset(str(save("p.toml", 'about = "Wärme"\n'))).about == "Wärme"
    assert read_json(save("a.json", '{"name": "Rübe"}')) == {"name": "Rübe"}
    assert len(read_drawn_rows(save("rows.geojson", rows), Datum(lat_deg=48.2, lon_deg=11.6))) == 1
    assert read_script(save("s.txt", "# Übung\n0 0.4 0\n"), hold=False) is not None
    plan = str(save("plan.geojson", "{}\n\n"))
    assert read_plan_text(RunConfig(profile="farm", plan=plan)) == "{}\n\n"


@pytest.mark.parametrize("encoding", WINDOWS)
def test_labels_and_their_names_are_read_as_windows_saves_them(encoding: str) -> None:
    def encode(text: str) -> bytes:
        return text.replace("\n", "\r\n").encode(encoding)

    assert decode_json(encode('{"label": "Rübe"}')) == {"label": "Rübe"}
    assert read_yaml(encode("names:\n  0: Rübe\n")) == {"names": {0: "Rübe"}}
    names = read_names("classes.txt", encode("Rübe\nDistel\n"))
    assert names == {0: "Rübe", 1: "Distel"}
    (shape,) = read_yolo("a", encode("0 0.1 0.1 0.2 0.1 0.2 0.2\n"), names).shapes
    assert shape.name == "Rübe"


def test_a_large_text_in_utf_8_is_not_copied() -> None:
    data = TABLE.encode()
    assert recode_text(data) is data
    assert recode_text(TABLE.encode("utf-16")) == data


@pytest.mark.parametrize("encoding", WINDOWS)
def test_a_robot_and_a_world_are_read_as_windows_saves_them(encoding: str) -> None:
    head = '\r\n<?xml version="1.0" encoding="UTF-8"?>\r\n'
    text = f'{head}<robot name="Rübe">\r\n<link name="a"/></robot>'
    root = parse_xml(text.encode(encoding), "r.urdf")
    assert root.get("name") == "Rübe"
    assert find_place(root[0]) == ("r.urdf", 4)
