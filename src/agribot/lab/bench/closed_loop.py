"""What the robot's network sees while the robot drives: per class, by crop, growth and light.

The whole robot drives generated fields and the Farm world; the simulator's own masks judge every
frame, at the camera's resolution and at every distance, also where a plant is a few pixels.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt
import tomli_w

from agribot.core import config
from agribot.core.config import DEFAULT_MODEL
from agribot.core.toml_tree import drop_none
from agribot.core.world import Light, WorldSpec
from agribot.description.conditions import load_condition_preset
from agribot.description.field_generator import generate_field
from agribot.description.field_settings import FieldSettings, read_field_settings
from agribot.description.package import ROOT
from agribot.description.sdf_export import write_world
from agribot.description.worlds_sdf import load_world
from agribot.lab.train.evaluate import CLASS_NAMES, Scores, compute_scores

Confusion = npt.NDArray[np.int64]
FARM = "farm"
PRESET = "field"  # preset of the ground, the plants' places and the camera's mount
BEET = "beet"
# Least IoU of the network on the beet field, pooled over its drives.
LEAST_IOU = {"weed": 0.70, "crop": 0.85}


def _make_sun(height_deg: float, diffuse: float, ambient: float) -> Light:
    """Make a sun from the side of the rows, which run north."""
    height_rad, turn_rad = math.radians(height_deg), math.radians(-20.0)
    across = math.cos(height_rad)
    return Light(
        to_sun=(across * math.cos(turn_rad), across * math.sin(turn_rad), math.sin(height_rad)),
        diffuse=diffuse,
        ambient=ambient,
    )


LIGHTS = {
    "noon": _make_sun(65.0, 0.80, 0.50),
    "low sun": _make_sun(22.0, 0.90, 0.40),
    "overcast": _make_sun(50.0, 0.12, 0.90),
}
# Field -> species and its middle height, metres. The packaged network was never shown the last two.
CROPS = {
    BEET: ("sugar_beet", 0.18),
    "lettuce": ("lettuce", 0.13),
    "maize": ("maize", 0.25),
    "carrot": ("carrot", 0.13),
    "onion": ("onion", 0.18),
}
HEIGHT_RATIOS = (0.5, 1.0, 1.4)  # growth stages, times the middle height
FIELDS = (*CROPS, FARM)


class Condition(msgspec.Struct, frozen=True, kw_only=True):
    """`height_ratio` is None on the Farm world, whose plants are as they are."""

    field: str
    light: str
    height_ratio: float | None
    seed: int


class ClosedLoopDrive(msgspec.Struct, frozen=True, kw_only=True):
    condition: Condition
    frames: int
    scores: Scores


def conditions(
    fields: Sequence[str], lights: Sequence[str], ratios: Sequence[float], seeds: Sequence[int]
) -> list[Condition]:
    stages: dict[str, Sequence[float | None]] = {
        name: (None,) if name == FARM else ratios for name in fields
    }
    return [
        Condition(field=name, light=light, height_ratio=ratio, seed=seed)
        for name in fields
        for ratio, light, seed in itertools.product(stages[name], lights, seeds)
    ]


def run_conditions(
    wanted: Sequence[Condition],
    seconds: float,
    model: str = DEFAULT_MODEL,
    show_line: Callable[[str], None] = lambda line: None,
    preset: str = PRESET,
) -> dict[str, Any]:
    """Drive each condition for the given simulated seconds.

    What else differs from seed to seed is drawn from `preset`, but for light and growth.
    Raises: AgribotError: no such network or preset, or the robot cannot start.
    """
    drives = []
    for condition in wanted:
        drives.append(_drive(condition, seconds, model, preset))
        show_line(_format_line(_format_name(condition), drives[-1].scores))
    pooled = {name: _pool(drives, name) for name in dict.fromkeys(c.field for c in wanted)}
    return {
        "model": model,
        "preset": preset,
        "seconds": seconds,
        "drives": [msgspec.to_builtins(drive) for drive in drives],
        "fields": {name: msgspec.to_builtins(score) for name, score in pooled.items()},
        "by": {
            "light": _group(drives, lambda c: c.light),
            "height_ratio": _group(
                [d for d in drives if d.condition.height_ratio is not None],
                lambda c: f"{c.height_ratio:g}",
            ),
        },
    }


def meets_limits(result: dict[str, Any]) -> bool:
    """Whether the beet field, where it was driven, keeps LEAST_IOU."""
    beet = result["fields"].get(BEET)
    return beet is None or all(
        (beet["iou"][name] or 0.0) >= least for name, least in LEAST_IOU.items()
    )


def format_table(result: dict[str, Any]) -> str:
    """Format the pooled results as lines of text."""
    lines = [f"{'':34}" + "".join(f"{name:>8}" for name in (*CLASS_NAMES, "mIoU", "frames"))]
    groups = {"field": result["fields"], **result["by"]}
    for kind, group in groups.items():
        lines += [
            _format_line(f"{kind} {name}", msgspec.convert(s, Scores)) for name, s in group.items()
        ]
    return "\n".join(lines)


def _drive(condition: Condition, seconds: float, model: str, preset: str) -> ClosedLoopDrive:
    from agribot.app.simulated_run import simulate

    profile = FARM if condition.field == FARM else BEET
    with TemporaryDirectory() as folder:
        world = Path(folder) / "field.world"
        write_world(_make_world(condition), world)
        around = Path(folder) / "around.toml"
        around.write_text(_write_preset(preset), encoding="utf-8")
        settings = [
            f"world={world}",
            f"sim.preset={around}",
            f"seed={condition.seed}",
            f"duration_s={seconds}",
            f"perception.model={model}",
            "record.enabled=false",
        ]
        with simulate(config.load(profile, settings), Path(folder) / "run") as session:
            for _ in session.ticks():
                pass
            session.finish()
            confusion, meter = session.referee.confusion, session.meter
    frames = meter.frames if meter is not None else 0
    return ClosedLoopDrive(
        condition=condition, frames=frames, scores=compute_scores(confusion, frames)
    )


def _make_world(condition: Condition) -> WorldSpec:
    """Make the packaged beet field with another crop, growth and seed."""
    if condition.field == FARM:
        world = load_world("Farm", seed=condition.seed)
    else:
        world = generate_field(_make_plan(condition), condition.seed)
    return msgspec.structs.replace(world, light=LIGHTS[condition.light])


def _write_preset(name: str) -> str:
    """Write the preset without what a condition sets itself, light and growth."""
    preset = load_condition_preset(name)
    around = msgspec.structs.replace(
        preset, sun_elevation_deg=None, cloud_ratio=(0.0, 0.0), growth_ratio=(1.0, 1.0)
    )
    return tomli_w.dumps(drop_none(msgspec.to_builtins(around)))


def _make_plan(condition: Condition) -> FieldSettings:
    """Plan the packaged beet field with another crop, growth and seed."""
    plan = read_field_settings(ROOT / "fields" / "beet.toml")
    species, height_m = CROPS[condition.field]
    crop = msgspec.structs.replace(
        plan.crop, species=species, height_m=height_m * (condition.height_ratio or 1.0)
    )
    return msgspec.structs.replace(plan, crop=crop)


def _pool(drives: Sequence[ClosedLoopDrive], field: str) -> Scores:
    return _sum([drive for drive in drives if drive.condition.field == field])


def _sum(drives: Sequence[ClosedLoopDrive]) -> Scores:
    confusion = np.sum([drive.scores.confusion for drive in drives], axis=0)
    return compute_scores(confusion.astype(np.int64), sum(drive.frames for drive in drives))


def _group(drives: Sequence[ClosedLoopDrive], key: Callable[[Condition], str]) -> dict[str, Any]:
    def groups() -> Iterator[tuple[str, list[ClosedLoopDrive]]]:
        for name in dict.fromkeys(key(drive.condition) for drive in drives):
            yield name, [drive for drive in drives if key(drive.condition) == name]

    return {name: msgspec.to_builtins(_sum(group)) for name, group in groups()}


def _format_name(condition: Condition) -> str:
    stage = "" if condition.height_ratio is None else f" x {condition.height_ratio:g}"
    return f"{condition.field}{stage}, {condition.light}, seed {condition.seed}"


def _format_line(name: str, score: Scores) -> str:
    cells = (score.iou[label] for label in CLASS_NAMES)
    shown = "".join("       -" if value is None else f"{value:8.3f}" for value in cells)
    return f"{name:34}{shown}{score.miou:8.3f}{score.images:8d}"
