"""Which settings of a field belong to one world, and go with it when another world is chosen."""

from __future__ import annotations

from typing import Any, NamedTuple

WORLD = "Farm"  # default of the settings: the simulated world
OF_A_WORLD = (
    "first_row_start_map_m", "row_yaw_deg", "row_length_m", "row_curvature_radpm", "row_pitch_m",
    "row_count", "plant_spacing_m", "has_crop", "obstacles_map_m", "start_map_m", "start_yaw_deg",
    "datum",
)  # fmt: skip


class OwnWorld(NamedTuple):
    """The world of a profile, and whether the profile states where its rows are."""

    world: object
    has_rows: bool

    @classmethod
    def read(cls, tree: dict[str, Any]) -> OwnWorld:
        """Read it from a profile; one that names no world means the default one and its rows."""
        field = tree.get("field", {})
        has_rows = isinstance(field, dict) and any(key in field for key in OF_A_WORLD)
        return cls(tree.get("world", WORLD), has_rows or "world" not in tree)

    def leave_rows_to_other(self, tree: dict[str, Any], stated: set[str]) -> None:
        """Let the world of the settings in `tree` say where its rows are, if the profile does not.

        What the settings on top of the profile state, `stated`, stays.
        """
        is_own = self.has_rows and tree.get("world", WORLD) == self.world
        field = {} if is_own else tree.setdefault("field", {})
        if not is_own and isinstance(field, dict) and "field" not in stated:
            field["from_world"] = [key for key in OF_A_WORLD if f"field.{key}" not in stated]
