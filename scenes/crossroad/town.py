"""The crossing without its traffic: streets, houses, and what stands on the pavements; life-size metres."""

from __future__ import annotations

from typing import Any

import furniture
import ground
import numpy as np
import surfaces
from ground import END_Z, HOUSE_X, HOUSE_Z, WIDE
from houses import Houses, behind_glass, house, shop_signs
from meshes import glossy, joined, matte, mesh, painted, toned

CORNER_M = 0.5  # thickness of the corner houses' fronts; behind them stand the first of the side street


def town(distance: float, wear: float, seed: int) -> dict[str, Any]:
    """All standing shapes; the main road's middle lies ``distance`` metres before the camera."""
    shift = (0.0, 0.0, -distance)
    random = np.random.default_rng(seed)
    houses, kerbs, slabs = _houses(random), ground.kerbs(random), ground.pavements()
    things = furniture.furniture(random) + furniture.trees(random)
    scene = {
        "road": mesh("road", ground.road().moved(shift), painted(ground.road_picture(wear, random))),
        "side_street": mesh("side_street", ground.street().moved(shift), painted(ground.street_picture(wear, random))),
        "ground": mesh("ground", ground.ground().moved(shift), {"type": "diffuse", "reflectance": 0.18}),
        "pavement": mesh(
            "pavement",
            slabs.moved(shift),
            painted(surfaces.paving((500, 500), (0.016, 0.016), random), tile_m=(8.0, 8.0)),
        ),
        "fixtures": mesh("fixtures", toned(joined([kerbs, *things, *houses.matte])).moved(shift), matte()),
        "windows": mesh("windows", joined(houses.glass).moved(shift), glossy(behind_glass(random), alpha=0.15)),
        "signs": mesh("signs", joined(houses.signs).moved(shift), painted(shop_signs(random))),
    }
    walls = [
        painted(surfaces.plaster(random, 0.52), tile_m=(8.0, 8.0)),
        painted(surfaces.brick(random, 0.20), tile_m=(6.0, 6.0)),
        painted(surfaces.plaster(random, 0.34), tile_m=(8.0, 8.0)),
        painted(surfaces.brick(random, 0.30), tile_m=(6.0, 6.0)),
    ]
    for number, (parts, bsdf) in enumerate(zip(houses.plaster, walls, strict=True)):
        if parts:
            scene[f"walls_{number}"] = mesh(f"walls_{number}", joined(parts).moved(shift), bsdf)
    return scene


def _houses(random: np.random.Generator) -> Houses:
    """Two corner houses and both rows of the side street, closed by a house across its end."""
    row = Houses()
    row.add(house(WIDE + HOUSE_X[0], 3, 0, random, deep=CORNER_M), (-WIDE, 0, HOUSE_Z), 0)
    row.add(house(WIDE - HOUSE_X[1] + 3, 3, 1, random, deep=CORNER_M), (HOUSE_X[1], 0, HOUSE_Z), 0)
    for side, turn in ((0, 90), (1, -90)):
        z = HOUSE_Z - CORNER_M  # the house at the corner shows its wall to both streets
        while z > END_Z:
            first = z == HOUSE_Z - CORNER_M
            width = 12.0 if first else float(random.uniform(8, 13))
            wall, storeys = (side, 3) if first else (int(random.integers(4)), int(random.integers(2, 5)))
            start = z if side else z - width
            # A house that looks towards +x has its left end farther away, one that looks to -x nearer.
            row.add(house(width, storeys, wall, random), (HOUSE_X[side], 0, start + (0 if side else width)), turn)
            z -= width
    row.add(house(34.0, 2, 2, random), (-14.0, 0, END_Z - 8), 0)
    return row
