"""Measure how often the leaderboard's 95 % intervals hold the truth, in simulated evaluations with a known truth.

    python -m studies.ranking.interval_coverage [--trials 2000] [--scenes 20 7] [--each N] [--only rate ...] [--earlier]

Prints a Markdown table for each kind of interval: success rates, medians of the error, mean times, differences of two
methods, ranks. Every other scene moves and has 12 sequences, the others have 6;
or each scene has N, such as the 2 of scenes that are drawn at random.
Each number is the fraction of trials in which the interval held the truth, followed by the mean width. ``--earlier``
adds the percentile bootstrap over scenes with 1,000 draws, which the leaderboard used before. Random streams are named
("interval_coverage", kind, law, rate, scenes). With 2,000 trials, a coverage of 0.95 has a standard error of 0.005.
"""

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import expit

from saf_gen.core.seeds import make_generator
from saf_gen.leaderboard.intervals import difference_intervals, mean_interval, median_interval, rate_intervals
from saf_gen.leaderboard.ranking import rank_intervals

STILL, MOVING = 6, 12
LAWS = ("beta 0.02", "beta 0.1", "beta 0.3", "beta 0.6", "two kinds", "logit-normal")
"""Laws of the rates of scenes about their mean: beta laws, named by the correlation of two sequences of a scene; scenes
that are easy (99.9 %) or hard (30 %); normal logits with a standard deviation of 1.5."""
RATES = (0.5, 0.9, 0.97, 1.0)
PAIRS = ((0.5, 0.5), (0.6, 0.5), (0.9, 0.9), (0.95, 0.9), (0.97, 0.97), (0.99, 0.97))
WORLDS = ("shared difficulty", "rare failures")
"""Ways in which methods fail: all according to the difficulty of a scene, which they share in part; or every other
method in most sequences of a few scenes, and the others occasionally in all scenes."""
BOARDS = {
    "12, spread": (0.99, 0.985, 0.98, 0.97, 0.965, 0.96, 0.95, 0.93, 0.9, 0.85, 0.7, 0.4),
    "12, all alike": (0.95,) * 12,
    "12, even steps": tuple(np.linspace(0.9, 0.5, 12)),
    "64 as in results.md": (  # a page that has gone; the name seeds the random stream
        *(0.99, 0.97, 0.97, 0.96, 0.96, 0.95, 0.94, 0.93, 0.93, 0.93, 0.92, 0.92, 0.92, 0.915, 0.915, 0.915),
        *(0.91, 0.91, 0.91, *np.linspace(0.9, 0.7, 36), *np.linspace(0.43, 0.05, 9)),
    ),
}
ERRORS = {"alike": 0.0, "scenes differ twofold": 0.7, "scenes differ sevenfold": 2.0, "one scene in seven fails": -1.0}
"""Law of absolute errors: normal, times exp(sd · scene). In the last, one scene in seven loses half of its answers."""
TIMES = {"normal": 0.0, "skewed": 0.5, "very skewed": 1.0}
"""Standard deviation of the logarithm of a scene's mean time; 0 stands for normal times."""


@dataclass(frozen=True)
class Coverage:
    """The fraction of trials in which an interval held the truth, and its mean width."""

    case: str
    held: float
    width: float
    trials: int

    def __str__(self) -> str:
        return f"{self.held:.3f} ({self.width:.3f})"


def count_sequences(scenes: int, each: int) -> np.ndarray:
    """Return the number of sequences of each scene: ``each``, or for 0 that of scenes of which every other moves."""
    return np.full(scenes, each) if each else np.where(np.arange(scenes) % 2 < 1, MOVING, STILL)


def draw_rates(law: str, mean: float, *, shape: tuple[int, ...], random: np.random.Generator) -> np.ndarray:
    """Return random rates of scenes that follow a law with the given mean."""
    if mean >= 1:
        return np.ones(shape)
    if law.startswith("beta"):
        size = 1 / float(law.split()[1]) - 1
        return random.beta(mean * size, (1 - mean) * size, size=shape)
    if law == "two kinds":
        easy, hard = (0.999, 0.3) if mean > 0.6 else (0.9, 0.1)
        return np.where(random.random(shape) < (easy - mean) / (easy - hard), hard, easy)
    return expit(_find_logit(mean, 1.5) + 1.5 * random.standard_normal(shape))


def simulate_rates(
    scenes: int, trials: int, *, earlier: bool, each: int = 0, law: str, rate: float
) -> Iterator[Coverage]:
    """Yield the coverage of the success rate's interval."""
    random = make_generator("interval_coverage", "rate", law, str(rate), scenes)
    counts = count_sequences(scenes, each)
    solved = random.binomial(counts, draw_rates(law, rate, shape=(trials, scenes), random=random))
    shares = solved / counts
    yield _cover(f"{law}, {rate:.0%}", rate_intervals(shares, counts), rate)
    if earlier:
        yield _cover("bootstrap", _bootstrap(shares, random), rate)


def draw_solved(
    world: str, rates: Sequence[float], *, scenes: int, each: int, trials: int, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Return which sequences each method solves, bool (trials, methods, scenes, 12), and the number in each scene."""
    counts, shape = count_sequences(scenes, each), (trials, scenes)
    shared, chances = random.standard_normal(shape), []
    for number, rate in enumerate(rates):
        if world == "shared difficulty":
            own = 0.8 * shared + 0.6 * random.standard_normal(shape)
            chances.append(expit(_find_logit(rate, 2.0) + 2.0 * own))
        elif number % 2 and rate > 0.4:
            chances.append(np.where(random.random(shape) < (1 - rate) / 0.6, 0.4, 1.0))
        else:
            chances.append(np.full(shape, rate))
    one, own = random.random((trials, 1, scenes, MOVING)), random.random((trials, len(rates), scenes, MOVING))
    luck = np.where(random.random(one.shape) < 0.5, one, own)  # half of the sequences are equally hard for all methods
    return (luck < np.stack(chances, axis=1)[..., None]) & (np.arange(MOVING) < counts[:, None]), counts


def simulate_differences(
    scenes: int, trials: int, *, earlier: bool, each: int = 0, world: str, rates: tuple[float, float]
) -> Iterator[Coverage]:
    """Yield the coverage of the interval of a difference of two success rates."""
    random = make_generator("interval_coverage", "difference", world, str(rates), scenes)
    solved, counts = draw_solved(world, rates, scenes=scenes, each=each, trials=trials, random=random)
    wins, losses = ((solved[:, a] & ~solved[:, 1 - a]).sum(axis=-1) / counts for a in (0, 1))
    truth = rates[0] - rates[1]
    yield _cover(
        f"{world}, {rates[0]:.0%} and {rates[1]:.0%}", difference_intervals(wins, losses, counts=counts), truth
    )
    if earlier:
        yield _cover("bootstrap", _bootstrap(wins - losses, random), truth)


def simulate_ranks(
    scenes: int, trials: int, *, earlier: bool, each: int = 0, world: str, board: str
) -> Iterator[Coverage]:
    """Yield the coverage of the intervals of ranks, mean over the methods of a leaderboard."""
    random = make_generator("interval_coverage", "rank", world, board, scenes)
    rates = np.array(BOARDS[board])
    true = 1 + (rates[None] > rates[:, None] + 1e-9).sum(axis=1)
    found, drawn = [], []
    for _ in range(trials):
        solved, counts = draw_solved(world, BOARDS[board], scenes=scenes, each=each, trials=1, random=random)
        one = solved[0].transpose(1, 0, 2).astype(float)
        both = one @ one.transpose(0, 2, 1)
        wins = (one.sum(axis=2)[:, :, None] - both).transpose(1, 2, 0) / counts
        found.append(rank_intervals(wins, counts))
        if earlier:
            means = solved[0].sum(axis=-1) / counts @ _draw(scenes, random).T
            ranks = 1 + (means[None] > means[:, None] + 1e-9).sum(axis=1)
            ends = [np.quantile(ranks, q, axis=1, method=m) for q, m in ((0.025, "lower"), (0.975, "higher"))]
            drawn.append(np.stack(ends, axis=1))
    for name, ends in ((f"{world}, {board}", found), ("bootstrap", drawn)):
        if ends:
            yield _cover(name, np.concatenate(ends), np.tile(true, trials))


def simulate_medians(scenes: int, trials: int, *, earlier: bool, each: int = 0, law: str) -> Iterator[Coverage]:
    """Yield the coverage of the interval of the median error."""
    random = make_generator("interval_coverage", "median", law, scenes)
    of_scene = np.repeat(np.arange(scenes), count_sequences(scenes, each))
    truth = float(np.median(_draw_errors(law, np.repeat(np.arange(40_000), 12), random)))
    ends, drawn = [], []
    for _ in range(trials):
        errors = _draw_errors(law, of_scene, random)
        ends.append(median_interval(errors, of_scene) or (0.0, np.inf))
        if earlier:
            order = np.argsort(errors)
            up_to = np.cumsum(scenes * _draw(scenes, random)[:, of_scene[order]], axis=1)
            drawn.append(np.quantile(errors[order][(up_to >= up_to[:, -1:] / 2).argmax(axis=1)], (0.025, 0.975)))
    yield _cover(law, np.array(ends), truth)
    if earlier:
        yield _cover("bootstrap", np.array(drawn), truth)


def simulate_times(scenes: int, trials: int, *, earlier: bool, each: int = 0, law: str) -> Iterator[Coverage]:
    """Yield the coverage of the interval of the mean time to focus."""
    random = make_generator("interval_coverage", "time", law, scenes)
    sd, noise = TIMES[law], random.standard_normal((trials, scenes))
    values = 0.15 * np.exp(sd * noise - sd**2 / 2) if sd else 0.15 + 0.02 * noise
    yield _cover(law, np.array([mean_interval(own) for own in values]), 0.15)
    if earlier:
        yield _cover("bootstrap", _bootstrap(values, random), 0.15)


KINDS: dict[str, tuple[str, Callable[..., Iterator[Coverage]], list[dict[str, object]], float]] = {
    "rate": ("Success rates", simulate_rates, [{"law": law, "rate": rate} for law in LAWS for rate in RATES], 1),
    "median": ("Median errors", simulate_medians, [{"law": law} for law in ERRORS], 0.5),
    "time": ("Mean times", simulate_times, [{"law": law} for law in TIMES], 1),
    "difference": (
        "Differences of two success rates",
        simulate_differences,
        [{"world": world, "rates": rates} for world in WORLDS for rates in PAIRS],
        0.5,
    ),
    "rank": ("Ranks", simulate_ranks, [{"world": world, "board": board} for world in WORLDS for board in BOARDS], 0.05),
}
"""By kind of interval: a heading, the function that simulates it, its cases, and the fraction of the trials to run."""


def _draw_errors(law: str, of_scene: np.ndarray, random: np.random.Generator) -> np.ndarray:
    scenes, sd = of_scene.max() + 1, ERRORS[law]
    hard = np.exp(abs(sd) * random.standard_normal(scenes))
    errors = 0.1 * hard[of_scene] * np.abs(random.standard_normal(len(of_scene)))
    if sd < 0:
        lost = (random.random(scenes) < 1 / 7)[of_scene] & (random.random(len(of_scene)) < 0.5)
        errors = np.where(lost, errors + 5, errors)
    return np.asarray(errors)


def _find_logit(mean: float, sd: float) -> float:
    """Return the mean of the normal logits whose mean rate is ``mean``."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(80)
    weights = weights / weights.sum()
    return float(brentq(lambda centre: float((expit(centre + sd * nodes) * weights).sum()) - mean, -30, 30))


def _draw(scenes: int, random: np.random.Generator) -> np.ndarray:
    return random.multinomial(scenes, np.full(scenes, 1 / scenes), size=1000) / scenes


def _bootstrap(values: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Return percentile intervals of the means over scenes, which the leaderboard used before."""
    weights = _draw(values.shape[1], random)
    return np.array([np.quantile(weights @ own, (0.025, 0.975)) for own in values])


def _cover(case: str, ends: np.ndarray, truth: float | np.ndarray) -> Coverage:
    held = (ends[:, 0] <= truth + 1e-9) & (truth <= ends[:, 1] + 1e-9)
    widths = ends[:, 1] - ends[:, 0]
    return Coverage(case, float(held.mean()), float(widths[np.isfinite(widths)].mean()), len(held))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=2000)
    parser.add_argument("--scenes", type=int, nargs="+", default=[20, 7])
    parser.add_argument("--each", type=int, default=0, help=f"sequences of each scene, at most {MOVING}")
    parser.add_argument("--only", nargs="+", choices=list(KINDS), default=list(KINDS))
    parser.add_argument("--earlier", action="store_true", help="add the bootstrap that was used before")
    given = parser.parse_args()
    if not 0 <= given.each <= MOVING:
        parser.error(f"--each is {given.each}; allowed: 1 to {MOVING}")
    given_too = {"earlier": given.earlier, "each": given.each}
    for kind in given.only:
        title, simulate, cases, share = KINDS[kind]
        trials = max(10, round(given.trials * share))
        ways = [f"{scenes} scenes{way}" for scenes in given.scenes for way in ("", *[", bootstrap"] * given.earlier)]
        print(f"\n{title}, {trials} trials\n\n| case | {' | '.join(ways)} |\n|---{'|---:' * len(ways)}|")
        for case in cases:
            found = [c for scenes in given.scenes for c in simulate(scenes, trials, **given_too, **case)]
            print(f"| {found[0].case} | {' | '.join(map(str, found))} |", flush=True)


if __name__ == "__main__":
    main()
