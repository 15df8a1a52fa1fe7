"""Friction lies where its surface lies: the ground at large, and patches upon it."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from agribot.core.messages import DriveCommand, FloatArray
from agribot.core.world import GripPatch, WorldSpec
from agribot.description.loader import load_robot
from agribot.description.sdf_export import write_world
from agribot.description.worlds_sdf import load_world
from agribot.sim.grip import build_friction_grid
from agribot.sim.kernel import sample_grid
from agribot.sim.physics import Physics
from agribot.sim.state import VELOCITY

PLANE = """<model name="{name}"><static>1</static><pose>{x} {y} {z} 0 0 0</pose><link name="l">
<collision name="c"><geometry><plane><normal>0 0 1</normal><size>{size} {size}</size></plane>
</geometry>{surface}</collision></link></model>
"""
FRICTION = "<surface><friction><ode><mu>{mu}</mu><mu2>{mu}</mu2></ode></friction></surface>"


def _plane(size: float, mu: float | None, at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> str:
    surface = "" if mu is None else FRICTION.format(mu=mu)
    name = f"p{size}{mu}{at}"
    return PLANE.format(name=name, x=at[0], y=at[1], z=at[2], size=size, surface=surface)


def _world(folder: Path, *planes: str) -> WorldSpec:
    file = folder / "w.world"
    file.write_text(f'<sdf version="1.6"><world name="w">{"".join(planes)}</world></sdf>')
    return load_world(str(file))


def _friction(world: WorldSpec, x_m: float, y_m: float) -> float:
    return sample_grid(build_friction_grid(world), x_m, y_m)[0]


def test_a_slippery_patch_far_away_leaves_the_rest_as_it_is(tmp_path: Path) -> None:
    world = _world(tmp_path, _plane(1.0, 0.05, (56.0, 0.0, 0.0)), _plane(60.0, 0.9))
    assert world.friction_ratio == 0.9
    assert [_friction(world, x, 0.0) for x in (0.0, 55.0, 56.0, 57.0, 500.0)] == [
        0.9, 0.9, 0.05, 0.9, 0.9,
    ]  # fmt: skip


def test_a_plane_that_does_not_tell_has_the_friction_of_sdf(tmp_path: Path) -> None:
    world = _world(tmp_path, _plane(60.0, 0.3), _plane(2.0, None, (5.0, 5.0, 0.0)))
    assert (_friction(world, 0.0, 0.0), _friction(world, 5.0, 5.0)) == (0.3, 1.0)


@pytest.mark.parametrize(
    ("heights", "felt"), [((0.0, 0.0), 0.2), ((0.01, 0.0), 0.4), ((0.0, -0.5), 0.4)]
)
def test_of_patches_that_overlap_the_upper_is_felt_then_the_later(
    tmp_path: Path, heights: tuple[float, float], felt: float
) -> None:
    patches = (_plane(2.0, mu, (5.0, 0.0, z)) for mu, z in zip((0.4, 0.2), heights, strict=True))
    assert _friction(_world(tmp_path, _plane(60.0, 0.9), *patches), 5.0, 0.0) == felt


def test_a_sea_far_below_leaves_the_ground_as_it_is(tmp_path: Path) -> None:
    world = _world(tmp_path, _plane(5000.0, 0.01, (0.0, 0.0, -50.0)), _plane(60.0, 0.9))
    assert [_friction(world, x, 0.0) for x in (0.0, 29.0, 100.0)] == [0.9, 0.9, 0.9]


def test_a_roof_leaves_the_ground_below_as_it_is(tmp_path: Path) -> None:
    world = _world(tmp_path, _plane(60.0, 0.9), _plane(10.0, 0.05, (5.0, 0.0, 5.0)))
    assert (world.friction_ratio, world.grip) == (0.9, ())


def test_a_ground_that_lies_elsewhere_is_still_the_ground(tmp_path: Path) -> None:
    planes = _plane(60.0, 0.3, (0.0, 0.0, 2.0)), _plane(2.0, 0.7, (5.0, 0.0, 2.05))
    world = _world(tmp_path, *planes, _plane(500.0, 0.01, (0.0, 0.0, -50.0)))
    assert [_friction(world, x, 0.0) for x in (0.0, 5.0, 100.0)] == [0.3, 0.7, 0.3]


def test_patches_come_back_from_an_exported_world(tmp_path: Path) -> None:
    first = _world(tmp_path, _plane(60.0, 0.9), _plane(2.0, 0.05, (5.0, 1.0, 0.0)))
    write_world(first, tmp_path / "again.world")
    again = load_world(str(tmp_path / "again.world"))
    assert again.grip == first.grip and again.friction_ratio == first.friction_ratio
    assert again.ground == first.ground and again.obstacles == ()


def _start(world: WorldSpec) -> FloatArray:
    """Half a second of a start at full speed from the middle of the map."""
    physics = Physics(load_robot(), world, 2_000_000)
    physics.command(DriveCommand(v_mps=0.8))
    return physics.advance(200).copy()


def test_wheels_slip_on_a_patch_and_only_there() -> None:
    plain = msgspec.structs.replace(load_world("empty"), spawn_xy_map_m=(0.0, 0.0))

    def with_ice(x_m: float) -> WorldSpec:
        ice = GripPatch(
            friction_ratio=0.03, x_min_m=x_m - 2.0, y_min_m=-2.0, x_max_m=x_m + 2.0, y_max_m=2.0
        )
        return msgspec.structs.replace(plain, grip=(ice,))

    speed = {
        name: float((_start(world)[-1, VELOCITY] ** 2).sum() ** 0.5)
        for name, world in (("plain", plain), ("ice", with_ice(0.0)))
    }
    assert speed["ice"] < 0.03 * 9.8 * 0.4 * 1.05 < 0.5 * speed["plain"]
    assert (_start(with_ice(9.0)) == _start(plain)).all()
