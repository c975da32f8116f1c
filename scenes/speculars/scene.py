"""A laid table at night: a menu with embossed foil, and round it, nearer and farther, all that glints.

World frame: metres, x right, y up, z towards the camera; the cloth is y = 0, the lens 0.5 m before z = 0.
"""

from __future__ import annotations

from typing import Any

import menu
import mitsuba as mi
import numpy as np
import tableware
from solids import grid, placed, turning
from surfaces import cloudy, glossy, matte, mesh, metal, texture, tones

EYE, AIM = np.array([0.0, 0.10, 0.5]), np.array([0.0, 0.034, 0.0])
# Azimuth from the family's (rad), W of the visible band, share of the samples: most go where the card is lit.
LAMPS = ((-0.42, 2.2, 9.0), (0.50, 1.2, 5.0), (2.55, 0.6, 1.5), (-2.70, 0.6, 1.5))
GLOBES, GLOBE_M, GLOBE = 15, 0.0058, 5.0  # radius; W m^-2 sr^-1: frosted
FLAME_M, FLAME = 0.0045, 16.0
CARD_TILT_DEG = -12.0  # it leans back
STEEL, SILVER, BRASS = (2.6, 3.6), (0.13, 3.4), (0.6, 2.5)  # index and absorption at 555 nm


def build(params: dict[str, Any]) -> dict[str, Any]:
    """Scene dictionary (metres, W m^-2 sr^-1) without sensor and integrator."""
    random = np.random.default_rng([1879, int(params["seed"])])
    rough = float(params["roughness"])
    along = (AIM - EYE) / np.linalg.norm(AIM - EYE)
    z = float((EYE + float(params["distance_m"]) * along)[2])  # of the card's middle
    w, h = menu.CARD_M[0] / 2, menu.CARD_M[1]
    flat = grid(np.array([[(-w, 0.0, 0.0), (w, 0.0, 0.0)], [(-w, h, 0.0), (w, h, 0.0)]]))
    pose = turning([0, 1, 0], float(params["yaw_deg"])) @ turning([1, 0, 0], CARD_TILT_DEG)
    surface = menu.card(float(params["ink"]), float(params["foil_roughness"]), random)
    stick, candle = tableware.candlestick(z, random)
    lights = _globes(z, random)
    scene: dict[str, Any] = {
        "type": "scene",
        "card": mesh("card", placed(flat, [0, 0.001, z], turn=pose), surface, smooth=False),
        "cloth": mesh("cloth", _cloth(random), matte(texture(_weave(random), repeat=(16, 16)))),
        "cutlery": mesh("cutlery", tableware.place_setting(z, random), metal(*STEEL, texture(_handled(rough, random)))),
        "baubles": mesh("baubles", tableware.baubles(z, random), metal(*SILVER, 0.9 * rough)),
        "candlestick": mesh("candlestick", stick, metal(*BRASS, texture(_handled(1.2 * rough, random)))),
        "candle": mesh("candle", candle, matte(0.72)),
        "plate": mesh("plate", tableware.plate(z), glossy(0.34, 0.12)),
        "sequins": mesh("sequins", tableware.sequins(z, random), metal(*SILVER, 0.22)),
        "pearls": mesh("pearls", tableware.pearls(z, random), glossy(0.62, 0.12)),
        "wire": mesh("wire", tableware.wire(lights), matte(tones())),
        "room": _room(random),
    }
    flame = np.asarray(candle.vertices).max(axis=0)[1]
    middle = candle.vertices.mean(axis=0)
    scene["flame"] = _ball([float(middle[0]), float(flame + 0.010), float(middle[2])], FLAME_M, FLAME, 0.5)
    for k, at in enumerate(lights):
        scene[f"globe_{k}"] = _ball(at.tolist(), GLOBE_M, GLOBE, 0.1)
    return scene | _lamps(params)


def _globes(z: float, random: np.random.Generator) -> np.ndarray:
    """Places (n, 3) of a string of lights that winds over the cloth and up some twigs behind."""
    at = np.linspace(0, 1, GLOBES)
    back = -0.12 - 0.62 * at + random.normal(0, 0.012, GLOBES)
    x = (0.085 - 0.10 * back) * np.sin(11.0 * at + random.uniform(0, 6)) + random.normal(0, 0.008, GLOBES)
    y = GLOBE_M + 0.07 * np.clip(at - 0.25, 0, 1) * (1 + 0.6 * np.sin(23 * at))
    return np.stack([x, y, z + back], axis=1)


def _cloth(random: np.random.Generator) -> Any:
    """The table-cloth with the creases of its folding and low waves."""
    x, z = np.meshgrid(np.linspace(-0.8, 0.8, 200), np.linspace(0.4, -1.2, 200), indexing="xy")
    y = 0.0012 * cloudy(x.shape, 9, 2, random) - 0.0015
    for at in (-0.23, 0.21):
        y += 0.0010 * np.exp(-(((x - at) / 0.006) ** 2))
    return grid(np.stack([x, y, z], axis=2))


def _weave(random: np.random.Generator) -> np.ndarray:
    """Dark damask: plain weave of uneven threads of 0.5 mm, 0.10 m a repeat."""
    n, threads = 1000, 200
    at = np.arange(n) / n * threads
    k = at.astype(int)
    warp, weft = (1 + 0.18 * random.standard_normal(threads) for _ in range(2))
    over = ((k[:, None] + k[None, :]) % 2).astype(bool)
    bow = np.abs(np.sin(np.pi * at)) ** 0.6
    tone = np.where(over, warp[k][None, :] * bow[None, :], weft[k][:, None] * bow[:, None])
    return np.clip(0.10 * (0.35 + 0.65 * tone) * (1 + 0.1 * random.standard_normal((n, n))), 0.02, 0.4)


def _handled(rough: float, random: np.random.Generator) -> np.ndarray:
    """Roughness of polished metal that has been handled: smears, water spots, hairlines."""
    n = 384
    picture = np.full((n, n), rough) * (1 + 0.10 * cloudy((n, n), 12, 4, random))
    y, x = np.mgrid[0:n, 0:n] / n
    for _ in range(10):
        cx, cy, r = random.uniform(0, 1), random.uniform(0, 1), random.uniform(0.02, 0.09)
        ridges = 0.5 + 0.5 * np.sin(70 * np.hypot(x - cx + 0.1, y - cy))
        picture += 0.08 * ridges * np.exp(-(((x - cx) / r) ** 2) - ((y - cy) / r) ** 2)
    for _ in range(60):
        cx, cy, a = random.uniform(0, 1), random.uniform(0, 1), random.uniform(0, np.pi)
        along, off = (x - cx) * np.cos(a) + (y - cy) * np.sin(a), (y - cy) * np.cos(a) - (x - cx) * np.sin(a)
        picture[(np.abs(off) < 0.0015) & (np.abs(along) < 0.12)] += 0.06
    return np.clip(picture, 0.06, 0.4)


def _ball(centre: list[float], radius: float, radiance: float, share: float) -> dict[str, Any]:
    return {
        "type": "sphere",
        "center": centre,
        "radius": radius,
        "bsdf": {"type": "diffuse", "reflectance": 0.5},
        "emitter": {"type": "area", "radiance": radiance, "sampling_weight": share},
    }


def _lamps(params: dict[str, Any]) -> dict[str, Any]:
    """Four lamps round the table: two light the card, two beyond it glint on what lies flat."""
    radius, turn = float(params["lamp_mm"]) * 1e-3, np.radians(float(params["lamp_azimuth_deg"]))
    made = {}
    for k, (aside, power, share) in enumerate(LAMPS):
        a = turn + aside
        origin = [0.62 * np.sin(a), 0.55 + 0.02 * k, 0.62 * np.cos(a)]
        pose = mi.ScalarTransform4f().look_at(origin=origin, target=[0, 0.01, 0], up=[0, 1, 0])
        made[f"lamp_{k}"] = {
            "type": "disk",
            "to_world": pose @ mi.ScalarTransform4f().scale(radius),
            "bsdf": {"type": "diffuse", "reflectance": 0.0},
            "emitter": {"type": "area", "radiance": power / (np.pi * radius) ** 2, "sampling_weight": share},
        }
    return made


def _room(random: np.random.Generator) -> dict[str, Any]:
    """A dim room (W m^-2 sr^-1): dark walls, a pale ceiling, a window at dusk, furniture."""
    rows, columns = 96, 192
    up = np.cos((np.arange(rows) + 0.5) / rows * np.pi)[:, None] + np.zeros(columns)
    picture = np.where(up > 0.55, 0.22, 0.075)
    picture[up < 0.0] = 0.03
    for at in random.integers(0, columns, 9):
        tall = int(random.integers(38, 50))
        picture[tall:56, at : at + int(random.integers(4, 16))] *= random.uniform(0.3, 0.8)
    picture[22:44, 20:29] = 1.3
    picture[22:44, 24] = picture[33, 20:29] = 0.10
    return {"type": "envmap", "bitmap": mi.Bitmap(picture.astype(np.float32)[:, :, None].repeat(3, axis=2))}
