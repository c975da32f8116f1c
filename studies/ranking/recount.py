"""Recount a leaderboard with other code: regions, strata, success, intervals and tests from plain HDF5 and records.

    python -m studies.ranking.recount DATASET EVALUATION

By the rules of docs/truth-and-ranking.md, without saf_gen. Lens, truth, region and stratum come from the streams, the
rest from ``records.jsonl`` (recorded track); rectangles inside movers are not recounted. Differences beyond EXACT, or
ENDS for intervals, are printed, with exit code 1. Beyond 13 scenes, signs are flipped at random: p within CHANCE of
0.05 (four standard errors), or an end within 2·ENDS of 0, is too close.
"""

import csv
import json
import math
import sys
from collections import defaultdict
from pathlib import Path

import h5py
import numpy as np

EXACT, ENDS, CHANCE, PATTERNS, MARGIN, SMALLEST = 1e-6, 0.005, 0.015, 20_000, 3, 24
THETA, RHO = (np.sin(np.pi / 2 * (np.arange(n) + 0.5) / n) ** 2 for n in (240, 30))  # even in the prior Beta(1/2, 1/2)
A, B = np.outer(THETA, 1 / RHO - 1), np.outer(1 - THETA, 1 / RHO - 1)
log_gamma = np.vectorize(math.lgamma)


def inside(mask):
    """Return the largest rectangle (top, bottom, left, right) of a mask eroded by MARGIN pixels; zeros if too small."""
    side, best = 2 * MARGIN + 1, (0, 0, 0, 0, (0, 0, 0, 0))
    eroded = np.lib.stride_tricks.sliding_window_view(np.pad(mask, MARGIN), (side, side)).all((2, 3))
    for top in range(len(eroded)):
        free = np.ones(eroded.shape[1], bool)
        for height in range(1, len(eroded) - top + 1):
            free &= eroded[top + height - 1]
            runs = np.flatnonzero(np.diff(np.concatenate([[0], free, [0]]))).reshape(-1, 2).tolist()
            for a, b in runs if height >= SMALLEST else ():
                area = height * (b - a) if b - a >= SMALLEST else 0
                best = max(best, (area, -top, -a, height, (top, top + height, a, b)))  # topmost, leftmost, tallest
    return best[-1] if best[0] else (0, 0, 0, 0)


def read_stream(path, region):
    """Return lens and truth (T,), depth of focus, stratum, and what is wrong with the region of a stream."""
    with h5py.File(path) as file:
        held = {name: file[f"truth/{name}"][()] for name in file.get("truth", {})}
        lens = held.get("lens", file["focus/position"][()] if "focus/position" in file else np.full(1, np.nan))
    truth = held.get("track", np.full(len(lens), held.get("position", np.nan)))
    dof = abs(float(np.subtract(*held.get("depth_of_focus", (np.nan, np.nan)))))
    stratum, fault, target = None, "", held.get("target", np.zeros((1, 1), bool))
    if region == "target" and target.any():
        share = target.sum() / np.prod([np.ptp(np.flatnonzero(target.any(axis))) + 1 for axis in (0, 1)])
        stratum = "80 % and more" if share >= 0.8 else "60 to 80 %" if share >= 0.6 else "below 60 %"
    elif region == "inside":
        found = (0, 0, 0, 0) if "track" in held else inside(target)
        top, bottom, left, right = stated = tuple(map(int, held.get("inside", found)))
        fault = "" if stated == found or "track" in held else f"/truth/inside is {stated}, not {found}"
        if bottom:
            off = abs(held["best_position"][top:bottom, left:right].astype(float) - held["position"])
            stratum = "one depth" if np.mean(off <= dof / 2) >= 0.95 else "relief"
    return lens, truth, dof, stratum, fault


def judge(record, lens, truth, dof, lacking):
    """Return the record with its successes by column; None if the recording has no answer, or nobody knows."""
    off = abs(lens.astype(float) - truth) / dof
    if not off.min() <= 1 or np.isnan(off).any() or record["obstacle"] not in (None, "lens at rest"):
        return None
    frame = record["frame"] if record["status"] == "answered" else math.nan  # without an answer, no success
    error = abs(np.subtract(*(np.interp(frame, np.arange(len(lens)), one) for one in (lens, truth)))) / dof
    rates = {"answerable_half_dof": error <= 0.5, "answerable_1dof": error <= 1, "answerable_2dof": error <= 2}
    sharp = None if record["sequence"] in lacking else (record["sharpness_lost"] or 0) <= 0.05 and error >= 0
    return record | {"rates": rates | {"answerable_lost_5": sharp}}


def by_scene(rows, values):
    """Return the mean of each scene, float (S,): over the sequences of each light, then over its lights."""
    lights, scenes = defaultdict(list), defaultdict(list)
    for row, value in zip(rows, values, strict=True):
        lights[row["scene"], str(row["light"])] += [] if value is None else [value]
    for (scene, _), held in sorted(lights.items()):
        scenes[scene] += [np.mean(held)] if held else []
    return np.array([np.mean(held) for held in scenes.values() if held])


def interval(fractions, counts):
    """Return the equal-tailed 95 % interval of the mean rate over scenes, of which each is beta-binomial."""
    pairs, times = np.unique(np.round([counts, fractions], 9), axis=1, return_counts=True)
    log = len(counts) * (log_gamma(A + B) - log_gamma(A) - log_gamma(B))
    for n, x, often in zip(*pairs, times, strict=True):
        log += often * (log_gamma(A + n * x) + log_gamma(B + n - n * x) - log_gamma(A + B + n))
    below = np.concatenate([[0], np.cumsum(np.exp(log - log.max()).sum(1))])
    ends = np.sin(np.pi / 2 * np.interp([0.025, 0.975], below / below[-1], np.linspace(0, 1, len(below)))) ** 2
    return ends[0] * (max(fractions) > EXACT), 1.0 if min(fractions) > 1 - EXACT else ends[1]


def level_with_best(wins, counts):
    """Return for each method whether no method is told apart as better; None if that is too close to tell."""
    scenes, level, near = len(counts), [], CHANCE * (len(counts) > 13)
    flips = np.arange(2 ** min(scenes - 1, 12))[:, None] >> np.arange(scenes - 1) & 1  # all patterns, up to 13 scenes
    flips = np.random.default_rng(1).integers(0, 2, (PATTERNS, scenes - 1)) if near else flips
    signs = np.hstack([np.ones((len(flips), 1)), 1 - 2.0 * flips])
    for j in range(len(wins)):
        ahead, verdicts = wins[:, j] - wins[j], set()
        scaled = ahead / np.maximum(np.sqrt((ahead**2).sum(1, keepdims=True)), 1e-12)
        largest = abs(signs @ scaled.T).max(1)
        for k in np.flatnonzero(scaled.sum(1) > 1e-9):
            p, won, lost = (largest >= scaled[k].sum() - 1e-9).mean(), wins[k, j], wins[j, k]
            below, above = won.mean() - interval(won, counts)[0], interval(lost, counts)[1] - lost.mean()
            r = np.corrcoef(won, lost)[0, 1] if won.std() * lost.std() > 0 else 0.0
            low = (won - lost).mean() - math.sqrt(max(below**2 + above**2 - 2 * r * below * above, 0))  # Newcombe
            is_close = abs(p - 0.05) < near or (p <= 0.05 + near and abs(low) < 2 * ENDS)
            verdicts.add(None if is_close else bool(p <= 0.05 and low > 0))
        level.append(False if True in verdicts else None if None in verdicts else True)
    return level


def main(dataset, evaluation):
    """Print the differences between an evaluation and what this module counts, and return the exit code."""
    files = {s["id"]: s["file"] for s in json.loads((dataset / "manifest.json").read_text())["sequences"]}
    records = [json.loads(line) for line in (evaluation / "records.jsonl").read_text().splitlines()]
    regions = {r["sequence"]: r["region"] for r in sorted(records, key=lambda r: "@" not in r["method"])}
    streams = {name: read_stream(dataset / files[name], region) for name, region in regions.items()}
    lacking = {r["sequence"] for r in records if r["status"] == "answered" and r["sharpness_lost"] is None}
    wrong, own = [f"{name}: {fault}" for name, (*_, fault) in streams.items() if fault], defaultdict(list)
    for record in sorted(records, key=lambda r: r["sequence"]):
        *known, stratum, _ = streams[record["sequence"]]
        wrong += [f"{record['sequence']}: stratum {record['stratum']}, not {stratum}"] * (record["stratum"] != stratum)
        own[record["method"]] += filter(None, [judge(record, *known, lacking)])
    hits = {method: [row["rates"]["answerable_1dof"] for row in rows] for method, rows in own.items()}
    wins = np.array([[by_scene(own[a], np.greater(hits[a], hits[b])) for b in own] for a in own])
    counts = np.unique([row["scene"] for row in next(iter(own.values()))], return_counts=True)[1]
    levels, words = dict(zip(own, level_with_best(wins, counts), strict=True)), {"": math.nan, "True": 1, "False": 0}
    for cells in csv.DictReader((evaluation / "leaderboard.csv").read_text().splitlines()):
        rows, level = own[cells["method"]], levels[cells["method"]]
        rates = {name: by_scene(rows, [row["rates"][name] for row in rows]) for name in rows[0]["rates"]}
        low, high, level = (*interval(rates["answerable_1dof"], counts), level) if len(counts) >= 3 else [math.nan] * 3
        numbers = {name: rate.mean() if len(rate) else math.nan for name, rate in rates.items()}
        numbers |= {"answerable_1dof_low": low, "answerable_1dof_high": high, "level_with_best": level}
        for name, value in numbers.items():
            off = 0 if value is None else abs(float(words.get(cells[name], cells[name])) - value)
            same = off <= (ENDS if name.endswith(("low", "high")) else EXACT) or (not cells[name] and math.isnan(value))
            wrong += [] if same else [f"{cells['method']}: {name} is {cells[name] or 'empty'}, not {value}"]
    print(*wrong, f"differences: {len(wrong)}; too close to compare: {[*levels.values()].count(None)}", sep="\n")
    return int(bool(wrong))


if __name__ == "__main__":
    try:
        sys.exit(main(*map(Path, sys.argv[1:3])))
    except OSError as error:
        sys.exit(str(error))
