"""Claims of where the robot is: two that contradict each other, and the odd one out of more."""

from __future__ import annotations

import numpy as np
import pytest

from agribot.autonomy.estimate.witnesses.place_claims import (
    PlaceClaim,
    claim_across,
    claim_place,
    find_disagreement,
)
from agribot.core.facts import PlaceSource, StartAside
from tests.finding import is_like

RIGHT = 1.0 + 0j  # rows run North
STD_M: dict[PlaceSource, float] = {"gnss": 0.014, "rows": 0.05, "mark": 0.05, "left": 0.03}


def claim(source: PlaceSource, place_m: complex) -> PlaceClaim:
    if source == "rows":
        return claim_across(source, place_m, STD_M[source], RIGHT)
    return claim_place(source, place_m, STD_M[source])


def judge(**places_m: complex) -> StartAside | None:
    """Judge claims of these sources, in their order; places are East + i North."""
    return find_disagreement([claim(s, places_m[s]) for s in STD_M if s in places_m])


@pytest.mark.parametrize(
    ("off_m", "words"),
    [(0.4, "east"), (0.4j, "north"), (-0.4, "west"), (-0.4j, "south"), (-0.3 - 0.3j, "south-west"),
     (0.38 + 0.13j, "east")],
)  # fmt: skip
def test_the_direction_is_the_nearest_of_eight(off_m: complex, words: str) -> None:
    assert is_like(judge(gnss=off_m, mark=0j), StartAside(abs(off_m), words, 0.21))


@pytest.mark.parametrize(("other", "limit_m"), [("mark", 0.208), ("left", 0.132)])
def test_two_claims_contradict_each_other_beyond_four_joint_sigmas(
    other: PlaceSource, limit_m: float
) -> None:
    assert judge(gnss=limit_m - 0.01, **{other: 0j}) is None
    found = judge(gnss=limit_m + 0.01, **{other: 0j})
    assert is_like(found, StartAside(limit_m + 0.01, "east", limit_m, against=(other,)))
    assert found is not None and len(found.parts) == 2  # it is open which of them is wrong


def test_a_robot_was_moved_to_its_mark_and_rows_without_a_mark_are_no_matter_of_the_start() -> None:
    assert judge(mark=3.0 + 0j, left=0j) is None
    assert judge(gnss=0.3 + 0j, rows=0j) is None


@pytest.mark.parametrize(
    ("places_m", "found"),
    [
        ({"gnss": 0.4 + 0j, "mark": 0j, "left": 0j},
         StartAside(0.4, "east", 0.117, "gnss", ("mark", "left"))),
        ({"gnss": 0j, "mark": 150j, "left": 0j},
         StartAside(150.0, "north", 0.205, "mark", ("gnss", "left"))),
        ({"gnss": 0j, "mark": 0j, "rows": -0.3 + 2j},
         StartAside(0.3, "west", 0.207, "rows", ("gnss", "mark"))),
        ({"gnss": 0.2 + 0j, "mark": 0j, "rows": 0j},
         StartAside(0.2, "east", 0.152, "gnss", ("rows", "mark"))),
        ({"mark": 0.4 + 0j, "rows": 0j},
         StartAside(0.4, "west", 0.283, "rows", ("mark",))),
    ],
)  # fmt: skip
def test_the_odd_one_out_is_named(places_m: dict[str, complex], found: StartAside) -> None:
    judged = judge(**places_m)
    assert judged is not None and is_like(judged, found, within=0.01)
    part = {"gnss": "gnss", "mark": "start", "rows": "camera"}[found.accuser]
    assert judged.parts == ((part,) if len(found.against) > 1 else (part, "start"))


@pytest.mark.parametrize("left_m", [0.5 + 0j, 30j])
def test_a_robot_that_was_moved_while_it_was_off_starts_from_its_mark(left_m: complex) -> None:
    assert judge(gnss=0.05 + 0j, mark=0j, left=left_m) is None


def test_a_third_claim_shows_a_fix_that_the_mark_alone_lets_pass() -> None:
    assert judge(gnss=0.15 + 0j, mark=0j) is None
    found = judge(gnss=0.15 + 0j, mark=0j, left=0.01j)
    assert found is not None and found.accuser == "gnss"


def test_rows_say_nothing_about_the_place_along_them() -> None:
    assert judge(gnss=0j, mark=0j, rows=5j) is None


def test_honest_claims_agree() -> None:
    """Four claims that are as good as stated are doubted in fewer than one of 300 starts."""
    rng = np.random.default_rng(1)
    doubted = 0
    for _ in range(1000):
        east_north = rng.standard_normal((4, 2))
        claims = {
            s: complex(*(std * e)) for (s, std), e in zip(STD_M.items(), east_north, strict=True)
        }
        doubted += judge(**claims) is not None
    assert doubted <= 3
