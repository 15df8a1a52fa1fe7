"""A receiver in another place than the map: it does not begin there, and both are named."""

from __future__ import annotations

import pytest

from agribot.autonomy.estimate.localizer import Localizer
from agribot.core.config import EstimateConfig, FieldConfig
from agribot.core.geo import Datum
from agribot.core.messages import Estimate
from tests.autonomy.estimate.noisy_rover import record, stand
from tests.autonomy.estimate.paper_robot import robot
from tests.autonomy.estimate.playback import play

HERE = FieldConfig().datum  # where the recordings are made


def stand_in_map_of(datum: Datum) -> Estimate:
    field = FieldConfig(datum=datum)
    return play(record(stand, 3.0), Localizer(EstimateConfig(), field, robot()))[-1]


@pytest.mark.parametrize(
    ("lat_deg", "lon_deg", "away_km"),
    [(48.7, 9.2, "6085"), (21.161289, 72.9, "12"), (-21.161289, -107.212978, "12751")],
    ids=["another continent", "the next town", "the other side of the Earth"],
)
def test_a_receiver_far_from_the_map_gives_no_position_but_both_places(
    lat_deg: float, lon_deg: float, away_km: str
) -> None:
    last = stand_in_map_of(Datum(lat_deg=lat_deg, lon_deg=lon_deg))
    assert not last.ok
    assert "the receiver is at 21.16" in last.reason
    assert (
        f"{away_km} km in a straight line from the map's origin at {lat_deg:.5f}, {lon_deg:.5f}"
        in last.reason
    )
    assert "more than 10 km" in last.reason


def test_a_receiver_within_ten_kilometres_of_the_origin_has_a_position() -> None:
    last = stand_in_map_of(Datum(lat_deg=HERE.lat_deg, lon_deg=72.86))
    assert last.ok, last.reason
    assert -8000.0 < last.x_map_m < -7000.0
