"""What keeps weeds in the row from being treated: the names of plants, or the rules of the tool.

One row of a weedy field is driven once, by the shipped network. Beside the robot's own tool others
work in the same drive, each for itself: with the map of the shipped network or of one that makes no
mistakes, and by other rules. The simulator's truth says what each of them met.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import msgspec

from agribot.core import config
from agribot.core.config import DEFAULT_MODEL, RunConfig, TreatmentConfig
from agribot.core.implement.kind import ImplementEffect, WetsLeaves
from agribot.core.implement.row_shares import find_nearest_row
from agribot.core.messages import PlantClass, Row
from agribot.core.row_shape import row_length_m
from agribot.core.world import Plant
from agribot.description.field_generator import generate_field
from agribot.description.field_settings import FieldSettings, read_field_settings
from agribot.description.package import ROOT
from agribot.description.sdf_export import write_world
from agribot.lab.bench.side_tools import SHIPPED, TRUE, SideTools, Variant

BANDS_M = (0.05, 0.10, 0.15)  # borders between bands of distance from the line of the row, m
HALF_STRIP_M = 0.5  # half width of the ground along the row that counts, m
WEEDS_PER_M2 = 6.0
NEAR = {"crop_guard_m": 0.02, "look_std_m": 0.01, "way_std_m": 0.0}  # 4 cm off the stems
# Settings of the treatment in place of those of the profile `beet`.
RULES: dict[str, dict[str, Any]] = {
    "shipped": {},
    "4 cm off stems": NEAR,
    "over leaves": {"leaves": "any"},
    "4 cm, over leaves": {**NEAR, "leaves": "any"},
}


class BandShare(NamedTuple):
    """Weeds of a band of distance from the row's line, and those of them that were treated."""

    treated: int
    of: int


class ToolOutcome(msgspec.Struct, frozen=True, kw_only=True):
    """Results of a tool: weeds by their distance, up to each of BANDS_M and farther off."""

    names: str
    rule: str
    treated: int
    weeds: int
    bands: tuple[BandShare, ...]
    crops: int
    crops_hit: int
    sprayed_ratio: float
    crop_leaves_wet_ratio: float


def drive_row(
    seed: int, length_m: float, model: str = DEFAULT_MODEL, seconds: float | None = None
) -> list[ToolOutcome]:
    """Drive one row, or its first `seconds`, and return what each tool met.

    Raises: AgribotError: no such network, or the robot cannot start.
    """
    from agribot.app.simulated_run import simulate

    with TemporaryDirectory() as folder:
        world = Path(folder) / "field.world"
        write_world(generate_field(plan_row(length_m), seed), world)
        settings = _load(world, seed, length_m, model, seconds)
        with simulate(settings, Path(folder) / "run") as session:
            side = SideTools(session, vary_treatment(settings.treatment))
            for _ in session.ticks():
                pass
            plants, rows = session.world.plants, session.referee.rows
            return [describe(key, tool.effect, plants, rows) for key, tool in side.tools.items()]


def plan_row(length_m: float) -> FieldSettings:
    """Plan one row of the packaged beet field, with more weeds."""
    plan = read_field_settings(ROOT / "fields" / "beet.toml")
    replace = msgspec.structs.replace
    return replace(
        plan,
        rows=replace(plan.rows, count=1, length_m=length_m),
        weeds=replace(plan.weeds, density_per_m2=WEEDS_PER_M2),
    )


def vary_treatment(shipped: TreatmentConfig) -> dict[Variant, TreatmentConfig]:
    """Vary the settings of a treatment by the rules, for either network's names."""
    return {
        (names, rule): msgspec.structs.replace(shipped, **settings)
        for names in (SHIPPED, TRUE)
        for rule, settings in RULES.items()
    }


def describe(
    variant: Variant, effect: ImplementEffect, plants: Sequence[Plant], rows: Sequence[Row]
) -> ToolOutcome:
    """Count what a tool met along the rows; crops hit are those of the whole field."""
    treated = effect.treated
    wet = effect.wet_leaves if isinstance(effect, WetsLeaves) else {}
    ground_m2 = sum(row_length_m(row) for row in rows) * 2.0 * HALF_STRIP_M
    bands = [[0, 0] for _ in range(len(BANDS_M) + 1)]
    crops = [index for index, plant in enumerate(plants) if plant.plant == PlantClass.CROP]
    for index, plant in enumerate(plants):
        place = find_nearest_row(plant.x_map_m, plant.y_map_m, rows)
        if plant.plant != PlantClass.WEED or place is None or place.beyond_m > 0.0:
            continue
        if place.beside_m <= HALF_STRIP_M:
            band = bands[sum(place.beside_m >= border_m for border_m in BANDS_M)]
            band[0] += index in treated
            band[1] += 1
    return ToolOutcome(
        names=variant[0],
        rule=variant[1],
        treated=sum(band[0] for band in bands),
        weeds=sum(band[1] for band in bands),
        bands=tuple(BandShare(*band) for band in bands),
        crops=len(crops),
        crops_hit=sum(index in treated for index in crops),
        sprayed_ratio=effect.worked_m2 / ground_m2,
        crop_leaves_wet_ratio=sum(wet.values()) / len(crops) if crops else 0.0,
    )


def format_table(outcomes: Sequence[ToolOutcome]) -> str:
    """Format the outcomes as lines of text, pooled over the drives."""
    borders = [f"<{100 * border_m:.0f} cm" for border_m in BANDS_M]
    heads = [*borders, f">{100 * BANDS_M[-1]:.0f} cm", "crops hit", "ground", "leaves wet"]
    lines = [f"{'names':8} {'rule':18} {'treated':>12}" + "".join(f"{h:>11}" for h in heads)]
    return "\n".join([*lines, *(_format_line(outcome) for outcome in outcomes)])


def pool(outcomes: Sequence[ToolOutcome]) -> list[ToolOutcome]:
    """Add up the outcomes of several drives, by names and rule; shares are means of the drives."""
    groups: dict[tuple[str, str], list[ToolOutcome]] = {}
    for outcome in outcomes:
        groups.setdefault((outcome.names, outcome.rule), []).append(outcome)
    return [_add_up(group) for group in groups.values()]


def _add_up(group: Sequence[ToolOutcome]) -> ToolOutcome:
    bands = zip(*(outcome.bands for outcome in group), strict=True)
    return ToolOutcome(
        names=group[0].names,
        rule=group[0].rule,
        treated=sum(one.treated for one in group),
        weeds=sum(one.weeds for one in group),
        bands=tuple(
            BandShare(sum(s.treated for s in band), sum(s.of for s in band)) for band in bands
        ),
        crops=sum(one.crops for one in group),
        crops_hit=sum(one.crops_hit for one in group),
        sprayed_ratio=sum(one.sprayed_ratio for one in group) / len(group),
        crop_leaves_wet_ratio=sum(one.crop_leaves_wet_ratio for one in group) / len(group),
    )


def _format_line(outcome: ToolOutcome) -> str:
    cells = [
        *(f"{band.treated} of {band.of}" for band in outcome.bands),
        f"{outcome.crops_hit} of {outcome.crops}",
        f"{100 * outcome.sprayed_ratio:.1f} %",
        f"{100 * outcome.crop_leaves_wet_ratio:.1f} %",
    ]
    treated = f"{outcome.treated} of {outcome.weeds}"
    return f"{outcome.names:8} {outcome.rule:18} {treated:>12}" + "".join(f"{c:>11}" for c in cells)


def _load(world: Path, seed: int, length_m: float, model: str, seconds: float | None) -> RunConfig:
    settings = [
        f"world={world}", f"seed={seed}", f"perception.model={model}", "sim.preset=field",
        "sim.sensors=rtk", "field.row_count=1", f"field.row_length_m={length_m}",
        "record.enabled=false",
    ]  # fmt: skip
    if seconds is not None:
        settings.append(f"duration_s={seconds}")
    return config.load("beet", settings)
