"""One weed map from those of several runs and robots.

Maps are merged by their rows, never by what was made of them: the union of all rows, each once, is
put into groups anew. So the order does not matter, a map merged with itself is itself, and merging
merged maps is merging all of their maps at once.

Two rows of different maps are one plant if they pass the gate of the weed map: Mahalanobis distance
with both covariances, plus a cost for unlike classes. The best pairs join first, and no map has two
rows in a group. Positions are fused by covariance intersection, which holds for any correlation, as
of one camera mount in two runs (Julier and Uhlmann 1997; weights of Niehsen 2002).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from agribot.autonomy.weeds.map import GATE_CHI2, MAX_CLASS_COST, REACH_SIGMA
from agribot.autonomy.weeds.near_pairs import find_near_pairs
from agribot.autonomy.weeds.plant_table import (
    DECISIONS,
    OUTCOMES,
    ROW,
    IndexArray,
    PlantTable,
    Rows,
    compute_std_m,
    is_crop,
    move_to_datum,
    number_groups,
    read_column,
)
from agribot.autonomy.weeds.track import MAX_CLASS_LOGIT
from agribot.core.errors import RecordingError
from agribot.core.geo import MapFrame
from agribot.core.messages import FloatArray, PlantClass

MAX_REACH_M = 0.5  # largest distance of two sights of one plant, however uncertain both places are
MAX_APART_M = 20_000.0  # largest distance of two datums: a local map is flat only near its origin
SAME_PLANT_M = 0.25  # largest shift of a row of a later state of the same map
CHUNK = 65_536  # pairs at a time
SWAPPED_RATIO, LEAST_PAIRS = 0.5, 20


def merge_maps(tables: Sequence[PlantTable]) -> PlantTable:
    """Merge weed maps; see the top of this file.

    Raises: RecordingError: maps of places far apart, of one name that differ, or of swapped
        classes.
    """
    joined = _drop_repetitions(_join(tables))
    first, second = _find_candidates(joined)
    _check_classes(joined, first, second)
    rows = joined.rows.copy()
    rows["group"] = _group(rows, first, second)
    return joined._replace(rows=rows)


def fuse(table: PlantTable) -> PlantTable:
    """Make one row of each group: what a merged map says of that plant.

    Map, id and times are those of the row with the most sightings. A plant that as much speaks for
    a crop as for a weed is a crop.
    """
    if not table.is_merged:
        return table
    order = np.lexsort((table.rows["id"], table.rows["map"], -table.rows["sightings"]))
    order = order[np.argsort(table.rows["group"][order], kind="stable")]
    rows = table.rows[order]
    group: IndexArray = rows["group"]
    _, begin, counts = np.unique(group, return_index=True, return_counts=True)
    fused = rows[begin].copy()
    several = counts > 1
    joint = _fuse_rows(rows, begin)
    for name in joint.dtype.names or ():
        fused[name][several] = joint[name][several]
    return table._replace(rows=fused)


def _join(tables: Sequence[PlantTable]) -> PlantTable:
    datum = min((t.datum for t in tables), key=lambda d: (d.lat_deg, d.lon_deg, d.alt_m))
    names = sorted({name for table in tables for name in table.maps})
    frame, parts = MapFrame(datum), []
    for table in tables:
        away_m = math.hypot(
            *frame.map_from_geodetic(table.datum.lat_deg, table.datum.lon_deg, datum.alt_m)[:2]
        )
        if away_m > MAX_APART_M:
            raise RecordingError(
                f"the maps {tables[0].maps[0]} and {table.maps[0]} lie {away_m / 1000:.0f} km "
                f"apart, more than {MAX_APART_M / 1000:.0f} km; merge maps of one field"
            )
        rows = move_to_datum(table, datum).rows.copy()
        number_of = np.array([names.index(name) for name in table.maps], dtype=np.int32)
        if len(rows):
            of_table: npt.NDArray[np.int32] = rows["map"]
            rows["map"] = number_of[of_table]
        parts.append(rows)
    return PlantTable(datum, tuple(names), np.concatenate(parts))


def _drop_repetitions(table: PlantTable) -> PlantTable:
    """Keep the latest state of every row; a map may be given twice, or as it was earlier."""
    rows = table.rows
    by = ("y_map_m", "x_map_m", "confidence", "treated_s", "sightings", "last_seen_s", "id", "map")
    order = np.lexsort([np.nan_to_num(read_column(rows, name), nan=-1e300) for name in by])
    rows = rows[order]
    is_again = (rows["map"][1:] == rows["map"][:-1]) & (rows["id"][1:] == rows["id"][:-1])
    moved_m = np.hypot(np.diff(read_column(rows, "x_map_m")), np.diff(read_column(rows, "y_map_m")))
    std_m = compute_std_m(rows)
    far = is_again & (moved_m > np.maximum(SAME_PLANT_M, 2 * REACH_SIGMA * std_m[1:]))
    if far.any():
        at = int(np.argmax(far))
        raise RecordingError(
            f"two maps are named {table.maps[rows['map'][at]]}, but plant {rows['id'][at]} of one "
            f"stands {moved_m[at]:.2f} m from that of the other: their ids are swapped, or they "
            "are maps of different runs; give one another name: merge NAME=FILE"
        )
    return table._replace(rows=rows[np.append(~is_again, True)[: len(rows)]])


def _find_candidates(table: PlantTable) -> tuple[IndexArray, IndexArray]:
    """Find the pairs of rows that may be one plant, best first."""
    rows = table.rows
    if len(table.maps) < 2 or not len(rows):
        return np.empty(0, np.int64), np.empty(0, np.int64)
    std_m = compute_std_m(rows)
    reach_m = min(MAX_REACH_M, max(0.05, 2.0 * REACH_SIGMA * float(std_m.max())))
    i, j = find_near_pairs(table.xy_m, reach_m)
    i, j = np.minimum(i, j), np.maximum(i, j)
    is_other = rows["map"][i] != rows["map"][j]
    i, j = i[is_other], j[is_other]
    cost = _compute_cost(rows, i, j)
    passed = cost <= GATE_CHI2
    i, j, cost = i[passed], j[passed], cost[passed]
    best = np.lexsort((j, i, cost))
    return i[best], j[best]


def _compute_cost(rows: Rows, i: IndexArray, j: IndexArray) -> FloatArray:
    """Squared distance in sigmas plus the cost of unlike classes, (P,)."""
    one, other = rows[i], rows[j]
    dx_m, dy_m = (
        read_column(other, name) - read_column(one, name) for name in ("x_map_m", "y_map_m")
    )
    xx, xy, yy = (
        read_column(one, name) + read_column(other, name) for name in ("xx_m2", "xy_m2", "yy_m2")
    )
    distance2 = (dx_m**2 * yy - 2.0 * dx_m * dy_m * xy + dy_m**2 * xx) / (xx * yy - xy**2)
    doubt = np.minimum(np.abs(_find_logit(one)), np.abs(_find_logit(other)))
    unlike = is_crop(one) != is_crop(other)
    cost: FloatArray = distance2 + np.where(unlike, np.minimum(2.0 * doubt, MAX_CLASS_COST), 0.0)
    return cost


def _find_logit(rows: Rows) -> FloatArray:
    """Log-odds of weed against crop, (N,); 0 where no map says how sure it is."""
    confidence = np.nan_to_num(read_column(rows, "confidence"), nan=0.5)
    share: FloatArray = np.clip(confidence, 1e-6, 1.0 - 1e-6)
    sign: FloatArray = np.where(is_crop(rows), -1.0, 1.0)
    return sign * np.log(share / (1.0 - share))


def _check_classes(table: PlantTable, first: IndexArray, second: IndexArray) -> None:
    """Refuse maps that call most of their common plants by opposite names."""
    rows, crop = table.rows, is_crop(table.rows)
    pair = rows["map"][first].astype(np.int64) * len(table.maps) + rows["map"][second]
    for number in np.unique(pair):
        of_both = pair == number
        unlike = float(np.mean(crop[first[of_both]] != crop[second[of_both]]))
        if of_both.sum() >= LEAST_PAIRS and unlike > SWAPPED_RATIO:
            one, other = divmod(int(number), len(table.maps))
            raise RecordingError(
                f"{table.maps[one]} and {table.maps[other]} call {100 * unlike:.0f} % of the "
                f"{of_both.sum()} plants that both have by opposite names: weed and crop are "
                "swapped in one of them; import it again with --classes"
            )


def _group(rows: Rows, first: IndexArray, second: IndexArray) -> IndexArray:
    """Join the best pairs first; return the group of each row, in the order of their first rows.

    A pair joins only if all rows of the two groups pass the gate with each other: a chain of near
    plants is not one plant.
    """
    members: dict[int, list[int]] = {}
    head = np.arange(len(rows))
    map_of = rows["map"]
    for i, j in _iterate_pairs(first, second):
        a, b = int(head[i]), int(head[j])
        if a == b:
            continue
        left, right = members.get(a, [a]), members.get(b, [b])
        if len(left) + len(right) > 2 and not _may_join(rows, map_of, left, right):
            continue
        low, high = min(a, b), max(a, b)
        joined = sorted(left + right)
        head[joined] = low
        members.pop(high, None)
        members[low] = joined
    return number_groups(head)


def _iterate_pairs(first: IndexArray, second: IndexArray) -> Iterator[tuple[int, int]]:
    """Iterate in pieces: a million pairs of Python numbers would take as much as the map."""
    for begin in range(0, len(first), CHUNK):
        piece = slice(begin, begin + CHUNK)
        yield from zip(first[piece].tolist(), second[piece].tolist(), strict=True)


def _may_join(rows: Rows, map_of: npt.NDArray[np.int32], left: list[int], right: list[int]) -> bool:
    if set(map_of[left].tolist()) & set(map_of[right].tolist()):
        return False
    i, j = (side.ravel() for side in np.meshgrid(left, right))
    return bool((_compute_cost(rows, i, j) <= GATE_CHI2).all())


def _fuse_rows(rows: Rows, begin: IndexArray) -> Rows:
    """Fuse rows that are sorted by group; groups start at `begin`."""

    def add(values: FloatArray) -> FloatArray:
        sums: FloatArray = np.add.reduceat(values, begin)
        return sums

    joint = np.zeros(len(begin), dtype=[(n, ROW[n]) for n in _FUSED])
    x_m, y_m, xx_m2, xy_m2, yy_m2 = (
        read_column(rows, name) for name in ("x_map_m", "y_map_m", "xx_m2", "xy_m2", "yy_m2")
    )
    weight = 1.0 / (xx_m2 + yy_m2)
    weight /= np.repeat(add(weight), np.diff(np.append(begin, len(rows))))
    det = xx_m2 * yy_m2 - xy_m2**2
    ixx, ixy, iyy = (weight * part / det for part in (yy_m2, -xy_m2, xx_m2))
    ix = add(ixx * x_m + ixy * y_m)
    iy = add(ixy * x_m + iyy * y_m)
    sxx, sxy, syy = add(ixx), add(ixy), add(iyy)
    det = sxx * syy - sxy**2
    joint["xx_m2"], joint["xy_m2"], joint["yy_m2"] = syy / det, -sxy / det, sxx / det
    joint["x_map_m"] = (syy * ix - sxy * iy) / det
    joint["y_map_m"] = (sxx * iy - sxy * ix) / det
    logit = add(_find_logit(rows))
    joint["plant"] = np.where(logit > 0.0, PlantClass.WEED, PlantClass.CROP)
    bound = np.minimum(np.abs(logit), MAX_CLASS_LOGIT)
    joint["confidence"] = 1.0 / (1.0 + np.exp(-bound))
    joint["sightings"] = add(rows["sightings"])
    known = np.isfinite(rows["area_m2"])
    with np.errstate(invalid="ignore"):
        joint["area_m2"] = add(np.where(known, rows["area_m2"], 0.0)) / add(known.astype(float))
    _fuse_work(rows, begin, joint)
    return joint


_FUSED = (
    "plant", "decision", "outcome", "reason", "sightings", "x_map_m", "y_map_m", "xx_m2",
    "xy_m2", "yy_m2", "area_m2", "confidence",
)  # fmt: skip


def _fuse_work(rows: Rows, begin: IndexArray, joint: Rows) -> None:
    """Say what came of it in any of the runs: "seen again" before "treated" before "missed"."""
    rank = np.array([OUTCOMES.index(o) for o in ("", "missed", "treated", "seen again")])
    rank_of = np.argsort(rank)[rows["outcome"]]
    outcome = rank[np.maximum.reduceat(rank_of, begin)]
    was_treated = np.isin(outcome, [OUTCOMES.index("treated"), OUTCOMES.index("seen again")])
    is_crop_now = joint["plant"] == PlantClass.CROP
    decision = np.where(is_crop_now, DECISIONS.index("spare"), rows["decision"][begin])
    joint["decision"] = np.where(was_treated, DECISIONS.index("treat"), decision)
    is_open = joint["decision"] == DECISIONS.index("treat")
    joint["outcome"] = np.where(is_open, outcome, 0)
    reason = np.maximum.reduceat(rows["reason"], begin)
    joint["reason"] = np.where(was_treated | is_crop_now, 0, reason)
