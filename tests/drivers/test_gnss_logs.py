"""Logs of real receivers are read as gpsd reads them.

The logs are those of gpsd's regression tests (BSD-2-Clause, the GPSD project), each with gpsd's own
reports beside it: `gpsd-logs` in the folder that AGRIBOT_DATA names.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from agribot.core.messages import GnssFix
from agribot.drivers.gnss.receiver_decoder import ReceiverDecoder

NEAR_DEG = 3e-6
SHARE = 0.9  # of the reports of each side that the other one has, too
PIECE = 256  # bytes
BYTES_PER_S = 3840.0
DATA = Path(os.environ.get("AGRIBOT_DATA", "")) / "gpsd-logs"
LOGS = sorted(path.name for path in DATA.glob("*.log")) if "AGRIBOT_DATA" in os.environ else []
# Whose positions are not gpsd's, and what is said of them.
OTHERWISE = {
    # Three or four satellites and 28 m and more: the receiver does not call one of them good.
    "ublox-glo.log": "gnssFixOK is 0",
    # A plotter that gives GGA, GLL and RMC of one second places that are 0.2 m and more apart.
    "bundg_zeus_9.log": "",
}

Place = tuple[float, float]


def read_log(path: Path) -> tuple[list[Place], ReceiverDecoder]:
    decoder, data = ReceiverDecoder(lambda text: None), path.read_bytes()
    while data.startswith(b"#"):  # comments
        data = data.partition(b"\n")[2]
    found, reason = [], ""
    pieces = [data[k : k + PIECE] for k in range(0, len(data), PIECE)]
    for k, piece in enumerate(pieces):
        found += decoder.feed(piece, k * PIECE / BYTES_PER_S)
        reason = decoder.heard.explain() or reason
    found += decoder.feed(b"", len(data) / BYTES_PER_S + 1.0)
    decoder.heard.reason = reason
    return [(f.lat_deg, f.lon_deg) for _, f in found if isinstance(f, GnssFix)], decoder


def read_reports(path: Path) -> list[Place]:
    """Read the positions of gpsd's reports."""
    lines = path.read_bytes().splitlines()
    reports = [
        json.loads(line.decode("latin-1")) for line in lines if line.startswith(b'{"class":"TPV"')
    ]
    return [(r["lat"], r["lon"]) for r in reports if r.get("mode", 0) >= 2 and "lat" in r]


def measure_share(places: list[Place], others: list[Place]) -> float:
    """Measure the share of places that have one of the others near; 1 without any place."""
    distinct = set(others)
    near = {
        place: any(
            abs(place[0] - other[0]) <= NEAR_DEG and abs(place[1] - other[1]) <= NEAR_DEG
            for other in distinct
        )
        for place in set(places)
    }
    return sum(near[place] for place in places) / len(places) if places else 1.0


@pytest.mark.skipif(not LOGS, reason="AGRIBOT_DATA names no folder with gpsd-logs")
def test_at_least_78_of_80_logs_are_read_as_gpsd_reads_them() -> None:
    assert len(LOGS) - len(OTHERWISE) >= 78


@pytest.mark.skipif(not LOGS, reason="AGRIBOT_DATA names no folder with gpsd-logs")
@pytest.mark.parametrize("name", [name for name in LOGS if name not in OTHERWISE] or [""])
def test_a_log_has_the_positions_that_gpsd_found(name: str) -> None:
    ours, _ = read_log(DATA / name)
    theirs = read_reports(DATA / f"{name}.chk")
    assert bool(ours) == bool(theirs)
    assert measure_share(ours, theirs) >= SHARE
    assert measure_share(theirs, ours) >= SHARE


@pytest.mark.skipif(not LOGS, reason="AGRIBOT_DATA names no folder with gpsd-logs")
@pytest.mark.parametrize(("name", "reason"), OTHERWISE.items())
def test_a_log_that_is_not_taken_as_gpsd_does_has_a_reason(name: str, reason: str) -> None:
    ours, decoder = read_log(DATA / name)
    theirs = read_reports(DATA / f"{name}.chk")
    assert reason in decoder.heard.reason
    assert min(measure_share(ours, theirs), measure_share(theirs, ours)) < SHARE
