"""Relief in world files and field plans."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from agribot.core.errors import DescriptionError
from agribot.core.messages import Row
from agribot.core.world import Relief
from agribot.description.field_generator import generate_field
from agribot.description.field_settings import FieldSettings, ReliefSettings, RowsSettings
from agribot.description.sdf_export import write_world
from agribot.description.worlds_sdf import load_world

ROW = Row(index=0, start_map_m=(1.0, 2.0), end_map_m=(1.0, 9.0), curvature_radpm=0.01)
WRITTEN = Relief(
    seed=4, roughness_rms_m=0.01, clods_per_m2=20.0, clod_height_m=0.04, ridge_height_m=0.05,
    track_depth_m=0.02, track_gauge_m=0.8, rows=(ROW,),
)  # fmt: skip


def test_a_written_world_has_its_relief_again(tmp_path: Path) -> None:
    world = msgspec.structs.replace(load_world("empty"), relief=WRITTEN)
    write_world(world, tmp_path / "rough.world")
    assert load_world(str(tmp_path / "rough.world")).relief == WRITTEN


@pytest.mark.parametrize(
    ("tag", "said"),
    [
        ('<agribot:relief rough="1"/>', "use seed, roughness_rms_m"),
        ('<agribot:relief roughness_rms_m="-1"/>', "-1: out of range; give 0 to 0.1"),
        ('<agribot:relief ridge_height_m="0.05"/>', "need rows"),
    ],
)
def test_a_relief_that_cannot_be_is_refused_in_one_line(
    tmp_path: Path, tag: str, said: str
) -> None:
    file = tmp_path / "rough.world"
    write_world(msgspec.structs.replace(load_world("empty"), relief=WRITTEN), file)
    text = file.read_text(encoding="utf-8")
    start, end = text.index("<agribot:relief"), text.index("</agribot:relief>")
    file.write_text(text[:start] + tag + text[end + len("</agribot:relief>") :], encoding="utf-8")
    with pytest.raises(DescriptionError, match=said) as refusal:
        load_world(str(file))
    assert "\n" not in str(refusal.value)


def test_the_ridges_of_a_field_plan_lie_under_its_rows() -> None:
    plan = FieldSettings(rows=RowsSettings(count=3), relief=ReliefSettings(ridge_height_m=0.05))
    relief = generate_field(plan, 7).relief
    assert (relief.seed, relief.ridge_height_m) == (7, 0.05)
    assert [row.start_map_m for row in relief.rows] == [(1.0, 2.0), (2.0, 2.0), (3.0, 2.0)]
    assert generate_field(FieldSettings(), 7).relief == Relief()
