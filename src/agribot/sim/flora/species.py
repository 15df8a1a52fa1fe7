"""The plants that can grow in a simulated field, as meshes of a variant and a growth stage.

Everything is scaled to unit height, so that the size of a plant is one factor.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from agribot.core.errors import DescriptionError
from agribot.core.messages import PlantClass
from agribot.sim.flora import crops, weeds
from agribot.sim.flora.fronds import grow_carrot, grow_chamomile, grow_mayweed, grow_parsley
from agribot.sim.flora.habit import SEEDLING_STAGE, STAGES, Species, stem_blade, strap_blade
from agribot.sim.flora.mesh import (
    Leaves,
    Mesh,
    build_leaf_rhombi,
    build_leaf_strips,
    build_leaf_triangles,
    merge_meshes,
)

LODS = 5
_FROM_SEEDLINGS = (SEEDLING_STAGE, *STAGES)

# All species; a new one goes to the end: the leaf textures are drawn in this order, and those that
# the shipped network was trained on must not change.
_ALL = (
    Species("sugar_beet", PlantClass.CROP, 0.25, crops.grow_sugar_beet, 7, (76, 128, 50),
            (150, 184, 112), (150, 172, 104), 8, 0.10, 0),
    Species("maize", PlantClass.CROP, 0.60, crops.grow_maize, 7, (82, 138, 52), (142, 178, 104),
            (112, 152, 78), 0, 0.08, 1),
    Species("lettuce", PlantClass.CROP, 0.18, crops.grow_lettuce, 6, (112, 158, 66),
            (176, 200, 132), (168, 192, 124), 7, 0.12, 2),
    Species("grass", PlantClass.WEED, 0.15, weeds.grow_grass, 4, (94, 138, 55), (124, 162, 84),
            (122, 130, 78), 0, 0.10, 3),
    Species("goosefoot", PlantClass.WEED, 0.15, weeds.grow_goosefoot, 8, (86, 131, 66),
            (140, 172, 114), (126, 146, 96), 5, 0.14, 4),
    Species("thistle", PlantClass.WEED, 0.15, weeds.grow_thistle, 16, (82, 127, 62),
            (148, 174, 116), (134, 150, 104), 6, 0.12, 5),
    Species("amaranth", PlantClass.WEED, 0.15, weeds.grow_amaranth, 6, (80, 122, 54),
            (132, 150, 98), (148, 96, 82), 9, 0.12, 6),
    Species("carrot", PlantClass.CROP, 0.20, grow_carrot, 3, (74, 134, 52), (118, 164, 84),
            (120, 158, 84), 0, 0.10, 7, is_compound=True, stages=_FROM_SEEDLINGS),
    Species("onion", PlantClass.CROP, 0.30, crops.grow_onion, 6, (86, 134, 84), (112, 156, 108),
            (150, 182, 128), 0, 0.06, 8),
    Species("chickweed", PlantClass.WEED, 0.08, weeds.grow_chickweed, 5, (98, 148, 62),
            (140, 178, 96), (132, 158, 88), 3, 0.10, 9),
    Species("plantain", PlantClass.WEED, 0.08, weeds.grow_plantain, 6, (84, 132, 58),
            (128, 164, 92), (142, 150, 96), 0, 0.12, 10),
    Species("charlock", PlantClass.WEED, 0.15, weeds.grow_charlock, 12, (96, 140, 54),
            (146, 176, 100), (132, 152, 92), 6, 0.13, 11),
    Species("chamomile", PlantClass.WEED, 0.15, grow_chamomile, 3, (90, 140, 62), (122, 164, 88),
            (124, 158, 88), 0, 0.10, 12, is_compound=True, stages=_FROM_SEEDLINGS),
    Species("parsley", PlantClass.CROP, 0.20, grow_parsley, 3, (72, 134, 66), (118, 166, 92),
            (120, 160, 88), 0, 0.10, 13, is_compound=True),
    Species("millet", PlantClass.WEED, 0.15, weeds.grow_millet, 9, (112, 158, 60),
            (146, 180, 92), (130, 150, 80), 0, 0.08, 14),
    Species("knotweed", PlantClass.WEED, 0.12, weeds.grow_knotweed, 5, (88, 140, 64),
            (132, 168, 96), (150, 130, 88), 0, 0.10, 15, stages=_FROM_SEEDLINGS),
    Species("quickweed", PlantClass.WEED, 0.12, weeds.grow_quickweed, 6, (94, 146, 62),
            (136, 174, 96), (138, 158, 98), 4, 0.12, 16),
    Species("milk_thistle", PlantClass.WEED, 0.15, weeds.grow_milk_thistle, 12, (72, 116, 84),
            (226, 234, 216), (160, 180, 140), 9, 0.10, 17),
    Species("mayweed", PlantClass.WEED, 0.15, grow_mayweed, 3, (92, 144, 62), (124, 166, 88),
            (126, 156, 88), 0, 0.10, 18, is_compound=True),
    Species("fodder_beet", PlantClass.CROP, 0.30, crops.grow_fodder_beet, 12, (92, 132, 58),
            (176, 198, 140), (178, 194, 132), 8, 0.14, 19),
)  # fmt: skip
SPECIES: dict[str, Species] = {kind.name: kind for kind in _ALL}


def find_species(name: str) -> Species:
    """Find a species by its name.

    Raises: DescriptionError: the species is unknown.
    """
    found = SPECIES.get(name)
    if found is None:
        known = ", ".join(SPECIES)
        raise DescriptionError(f"unknown plant species '{name}'; use one of: {known}")
    return found


def _build_level(kinds: list[Leaves], segments: int, lod: int) -> Mesh:
    if lod < 2:
        pieces = segments if lod == 0 else max(3, (segments + 1) // 2)
        strips = [build_leaf_strips(kinds[0], pieces)]
        strips += [build_leaf_strips(kind, _count_side_pieces(kind, pieces)) for kind in kinds[1:]]
        return merge_meshes(strips)
    if lod == 2:
        return merge_meshes([build_leaf_rhombi(kind, 1.1, folded=True) for kind in kinds])
    if lod == 3:
        return build_leaf_rhombi(kinds[0], 1.2)
    return build_leaf_triangles(_thin_leaves(kinds[0]), 2.2)


def _count_side_pieces(kind: Leaves, pieces: int) -> int:
    """Return fewer segments for side leaves, which are small, and one for straight stems."""
    if kind.profile is stem_blade:
        return 1
    return 2 * pieces if kind.profile is strap_blade else min(pieces, 4)


def _thin_leaves(leaves: Leaves) -> Leaves:
    """Return half of the leaves, spread over the plant."""
    thinned = {name: getattr(leaves, name)[::2] for name in Leaves._fields[:-2]}
    return leaves._replace(**thinned)


def _add_occlusion(mesh: Mesh) -> Mesh:
    """Darken what lies low and inside, where neighbouring leaves hide the sky."""
    outward = np.hypot(mesh.vertices_m[:, 0], mesh.vertices_m[:, 1])
    outward = outward / max(float(outward.max()), 1e-6)
    openness = np.clip(0.15 + 0.9 * mesh.vertices_m[:, 2] + 0.35 * outward, 0.0, 1.0)
    return mesh._replace(tone=(mesh.tone * (0.58 + 0.42 * openness)).astype(np.float32))


@lru_cache(maxsize=2048)
def build_plant_lods(species: str, seed_variant: int, stage: float) -> tuple[Mesh, ...]:
    """Build all levels of detail of one plant of unit height, finest first."""
    kind = find_species(species)
    rng = np.random.default_rng([kind.cell, seed_variant, round(stage * 1000)])
    leaves = kind.habit(rng, stage)
    near = leaves[1:] if kind.is_compound else leaves
    levels = [_build_level(near if lod < 3 else leaves, kind.segments, lod) for lod in range(LODS)]
    factor = 1.0 / levels[0].height_m
    return tuple(_add_occlusion(level.scale(factor)) for level in levels)


def build_plant_mesh(species: str, seed_variant: int, lod: int, stage: float) -> Mesh:
    """Return a plant of unit height; multiply the vertices by its size.

    Raises: DescriptionError: the species is unknown.
    """
    return build_plant_lods(species, seed_variant, stage)[lod]


def find_nearest_stage(species: str, size_m: float) -> float:
    """Return the modelled growth stage of a plant of this height."""
    kind = find_species(species)
    grown = size_m / kind.nominal_size_m
    return min(kind.stages, key=lambda stage: abs(stage - grown))
