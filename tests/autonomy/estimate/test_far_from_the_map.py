"""A receiver in another place than the map: it does not begin there, and both are named."""

from __future__ import annotations

import pytest

from agribot.autonomy.estimate.localizer import Localizer
from agribot.core.config import EstimateConfig, FieldConfig
from agribot.core.facts import FarFromMap
from agribot.core.geo import Datum
from agribot.core.messages import Estimate
from tests.autonomy.estimate.noisy_rover import record, stand
from tests.autonomy.estimate.paper_robot import robot
from tests.autonomy.estimate.playback import play
from tests.finding import find

HERE = FieldConfig().datum  # where the recordings are made


def stand_in_map_of(datum: Datum) -> Estimate:
    field = FieldConfig(datum=datum)
    return play(record(stand, 3.0), Localizer(EstimateConfig(), field, robot()))[-1]


@pytest.mark.parametrize(
    ("lat_deg", "lon_deg", "away_km"),
    [(48.7, 9.2, 6085.0), (21.161289, 72.9, 12.0), (-21.161289, -107.212978, 12_751.0)],
    ids=["another continent", "the next town", "the other side of the Earth"],
)
def test_a_receiver_far_from_the_map_gives_no_position_but_both_places(
    lat_deg: float, lon_deg: float, away_km: float
) -> None:
    last = stand_in_map_of(Datum(lat_deg=lat_deg, lon_deg=lon_deg))
    assert not last.ok
    far = find(last.fact, FarFromMap)
    assert far.lat_deg == pytest.approx(21.165, abs=0.005)
    assert far.away_m == pytest.approx(1000.0 * away_km, abs=500.0)
    assert (far.origin_lat_deg, far.origin_lon_deg) == (lat_deg, lon_deg)
    assert far.limit_m == 10_000.0


def test_a_receiver_within_ten_kilometres_of_the_origin_has_a_position() -> None:
    last = stand_in_map_of(Datum(lat_deg=HERE.lat_deg, lon_deg=72.86))
    assert last.ok, last.fact
    assert -8000.0 < last.x_map_m < -7000.0
