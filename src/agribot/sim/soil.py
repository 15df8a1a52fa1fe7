"""Soil under a wheel: how far it gives way, along, across and down, and what that costs.

Pressure and sinkage follow Bekker, p = (k_c / b + k_phi) z^n, under a rigid wheel of width b as in
his "Introduction to Terrain-Vehicle Systems" (1969):
z = (3 W / (b (3 - n) k sqrt(D)))^(2 / (2 n + 1)), and pressing the track costs b k z^(n+1) / (n+1)
per metre. Slip digs the wheel in by (1 + s) / (1 - s / 2) (Lyasko 2010). Shear follows Janosi and
Hanamoto (1961), tau = (c + sigma tan phi) (1 - exp(-j / K)), with the displacement j = slip times
contact length along and across as one vector; for tractor tyres that is the curve of Brixius (1987,
ASAE 87-1622), 0.88 (1 - exp(-0.1 Bn)) (1 - exp(-7.5 s)) + 0.04, whose limit holds here too.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from agribot.core.errors import DescriptionError, describe_range
from agribot.core.robot import RobotSpec
from agribot.core.world import Soil, SoilClass, SoilStrength, WorldSpec
from agribot.sim.tyre import Terrain


class SoilKind(NamedTuple):
    """A soil when dry; `wet_cone_index_kpa` and `wet_friction_ratio` are what water leaves."""

    cone_index_kpa: float  # cone index of the top 15 cm
    wet_cone_index_kpa: float
    k_c_npm: float  # N / m^(n + 1)
    k_phi_npm2: float  # N / m^(n + 2)
    exponent: float
    cohesion_pa: float
    friction_deg: float
    shear_m: float
    wet_friction_ratio: float


# k_c, k_phi, n, c, phi: the table of terrain values in Wong, "Theory of Ground Vehicles": sandy
# loam at 23 % and at 11 % water (Strong and Buchele), dry sand (Land Locomotion Laboratory). K:
# 0.6 cm for the densest clay, 1 cm for firm sand, 2.5 cm for loose sand (the same book); firm loam
# lies between, where slip and side slip are those of tractor tyres on firm soil. Cone indices:
# Brixius' classes firm, tilled and soft. Assumed: moduli and cohesion fall with the cone index, and
# water takes a fifth of tan phi.
SOILS: dict[SoilClass, SoilKind] = {
    "firm": SoilKind(1800.0, 900.0, 11.42e3, 808.96e3, 0.4, 9.65e3, 35.0, 0.0072, 0.8),
    "tilled": SoilKind(450.0, 250.0, 52.53e3, 1127.97e3, 0.9, 4.83e3, 20.0, 0.010, 0.8),
    "soft": SoilKind(300.0, 120.0, 0.99e3, 1528.43e3, 1.1, 1.04e3, 28.0, 0.025, 0.8),
}
# Share of the cohesion that a rubber tread mobilises: assumed; tillage tools have 0.3 to 0.7.
ADHESION_RATIO = 0.5
# Displacement aside at which soil gives way, against that along: 0.4 of K under rigid wheels on
# sand (Ishigami, Miwa, Nagatani, Yoshida 2007, J. Field Robotics 24(3)). Assumed for tyres, such
# that skid-steer robots turn as their makers found.
ASIDE_RATIO = 0.9
# Brixius: most gross traction, its growth with the mobility number, deflection over section height.
MOST_TRACTION, BRIXIUS_RATE, DEFLECTION_RATIO = 0.92, 0.1, 0.2
# Share of the sinkage that springs back under the leaving wheel: assumed, dense soils have more.
ELASTIC_RATIO = 0.1
# Depth of virgin soil as hard as a rut, as a share of the rut's. Ruts then deepen by 1, 1.23, 1.36,
# 1.40 in four passes; Abebe, Tanaka, Yamazaki (1989) measured z n^(1/a) with a from 2 to 4.
HARDENING_RATIO = 0.7


# Share of the strength in mud: the law holds while wheels sink in by less than their radius.
LEAST_STRENGTH_RATIO = 0.15


class SurfaceFactor(NamedTuple):
    """Factors of the soil's strength where the surface is fully covered."""

    friction_ratio: float
    cone_index_ratio: float


# Friction: roads of Taborek in Wong, earth 0.68 dry and 0.55 wet, gravel 0.6. Assumed: straw, and
# all cone indices.
SURFACES: dict[str, SurfaceFactor] = {
    "wet_ratio": SurfaceFactor(0.81, 0.6),
    "stones_ratio": SurfaceFactor(0.88, 1.0),
    "residue_ratio": SurfaceFactor(0.7, 1.0),
}


class SoilLaw(NamedTuple):
    """Parameters of the soil under one tyre for the kernel.

    `sunk` is the grid of how deep wheels have pressed the ground for good, m.
    """

    is_rigid: bool
    modulus: float  # modulus of sinkage, N / m^(n + 2)
    exponent: float
    sink_scale: float
    sink_power: float
    width_m: float
    adhesion_npm: float
    tan_friction: float
    shear_m: float
    aside_ratio: float  # share of `shear_m` for displacements to the side
    most_traction: float
    shear_damping_spm: float
    elastic_ratio: float
    hardening_ratio: float
    sunk: Terrain


def make_soil_law(
    robot: RobotSpec,
    world: WorldSpec,
    wheel_mass_kg: float,
    sunk: Terrain,
    mud_ratio: float = 1.0,
) -> SoilLaw:
    """Derive the law for a robot's wheels; mud leaves `mud_ratio` of the strength.

    Raises: DescriptionError: a moisture that does not exist.
    """
    kind, softened = _weaken(world.strength, world.soil, mud_ratio)
    drive, load_n = robot.drive, robot.mass_kg * world.gravity_mps2 / len(robot.wheel_names)
    width_m, diameter_m = drive.wheel_width_m, 2.0 * drive.wheel_radius_m
    modulus = kind.k_c_npm / width_m + kind.k_phi_npm2
    shape = width_m * (3.0 - kind.exponent) * modulus * math.sqrt(diameter_m)
    mobility = kind.cone_index_kpa * 1e3 * width_m * diameter_m / load_n
    mobility *= (1.0 + 5.0 * DEFLECTION_RATIO) / (1.0 + 3.0 * width_m / diameter_m)
    most = MOST_TRACTION * (1.0 - math.exp(-BRIXIUS_RATE * mobility))
    return SoilLaw(
        is_rigid=world.strength.soil_class == "rigid",
        modulus=modulus,
        exponent=kind.exponent,
        sink_scale=3.0 / shape,
        sink_power=2.0 / (2.0 * kind.exponent + 1.0),
        width_m=width_m,
        adhesion_npm=ADHESION_RATIO * kind.cohesion_pa * width_m,
        tan_friction=math.tan(math.radians(kind.friction_deg)) * softened,
        shear_m=kind.shear_m,
        aside_ratio=ASIDE_RATIO,
        most_traction=most,
        shear_damping_spm=math.sqrt(most * load_n / kind.shear_m * wheel_mass_kg / 2.0) / load_n,
        elastic_ratio=ELASTIC_RATIO,
        hardening_ratio=HARDENING_RATIO,
        sunk=sunk,
    )


def compute_surface_friction(soil: Soil) -> float:
    """Return the share of the friction that water, stones and straw on the soil leave."""
    left = 1.0
    for name, factor in SURFACES.items():
        left *= 1.0 - getattr(soil, name) * (1.0 - factor.friction_ratio)
    return left


def _weaken(strength: SoilStrength, soil: Soil, mud_ratio: float) -> tuple[SoilKind, float]:
    """Return the soil with its water, and the share of tan phi that is left."""
    moisture = strength.moisture_ratio
    if not 0.0 <= moisture <= 1.0:
        raise DescriptionError(f"moisture_ratio {moisture:g}: {describe_range(0.0, 1.0)}")
    kind = SOILS["firm" if strength.soil_class == "rigid" else strength.soil_class]
    left = (kind.wet_cone_index_kpa / kind.cone_index_kpa) ** moisture * max(
        mud_ratio, LEAST_STRENGTH_RATIO
    )
    for name, factor in SURFACES.items():
        left *= 1.0 - getattr(soil, name) * (1.0 - factor.cone_index_ratio)
    weak = kind._replace(
        cone_index_kpa=kind.cone_index_kpa * left,
        k_c_npm=kind.k_c_npm * left,
        k_phi_npm2=kind.k_phi_npm2 * left,
        cohesion_pa=kind.cohesion_pa * left,
    )
    return weak, (1.0 - moisture * (1.0 - kind.wet_friction_ratio)) * mud_ratio
