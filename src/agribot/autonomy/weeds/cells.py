"""Which tracks stand near a place: a hash of square cells."""

from __future__ import annotations

from collections.abc import Iterator
from math import floor

from agribot.autonomy.weeds.track import Track

Cell = tuple[int, int]


class CellIndex:
    """Tracks by the cell they stand in; a look-up costs the area asked for, not the map."""

    def __init__(self, cell_m: float = 0.25) -> None:
        self._cell_m = cell_m
        self._tracks: dict[Cell, list[Track]] = {}
        self._cell_of: dict[int, Cell] = {}

    def place(self, track: Track) -> None:
        """Add a track, or note that it moved."""
        cell = (floor(track.x_map_m / self._cell_m), floor(track.y_map_m / self._cell_m))
        old = self._cell_of.get(track.id)
        if old == cell:
            return
        if old is not None:
            self.remove(track)
        self._tracks.setdefault(cell, []).append(track)
        self._cell_of[track.id] = cell

    def remove(self, track: Track) -> None:
        cell = self._cell_of.pop(track.id)
        self._tracks[cell].remove(track)
        if not self._tracks[cell]:
            del self._tracks[cell]

    def inside(
        self, x_min_m: float, y_min_m: float, x_max_m: float, y_max_m: float
    ) -> Iterator[Track]:
        """Tracks of all cells that touch the rectangle: some stand a little outside it."""
        columns = range(floor(x_min_m / self._cell_m), floor(x_max_m / self._cell_m) + 1)
        rows = range(floor(y_min_m / self._cell_m), floor(y_max_m / self._cell_m) + 1)
        tracks = self._tracks
        for column in columns:
            for row in rows:
                yield from tracks.get((column, row), ())
