"""A method in the closed loop: it moves the lens of a running camera, and has a budget of time.

All methods of a sequence begin with the lens at the same place, drawn by the sequence's seed. A search that
commands the lens is on its own. One that estimates on a recording is given a sweep: the lens goes to the
nearer end of its travel, then to the other one, and back to where the search says; the sweep ends with the
last window that the search looks at. Judged is where the lens is at the end, against the truth of then.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from saf_gen import seeds
from saf_gen.contest.answer import asked
from saf_gen.contest.terms import Terms
from saf_gen.exposed import Exposed
from saf_gen.methods import Method
from saf_gen.parts import Answer, commands
from saf_gen.region import Region
from saf_gen.rig.film import Film
from saf_gen.rig.live import BudgetSpentError, Live
from saf_gen.rig.sweep import Sweep
from saf_gen.take import Take

__all__ = ["Run", "ended", "run_method", "running", "spent"]

SETTLED = 1e-4  # of the travel: then the lens is said to rest


@dataclass(frozen=True, eq=False)
class Run:
    """What came of a method on a running camera.

    ``path`` (n,) is where the lens truly was, to the end; ``answered`` the frame at which the method was
    done; ``budget`` in frames; ``problem`` why it failed, '' where it did not; ``sent`` the places to which
    the lens was sent, in turn, the first of them where it stood.
    """

    answer: Answer
    problem: str
    answered: int
    path: np.ndarray
    budget: int
    windows: int
    seconds: float
    sent: tuple[float, ...] = ()


def running(
    take: Take,
    exposed: Exposed,
    region: Region,
    measure: Callable[..., float],
    terms: Terms,
    *,
    threads: int | None = None,
) -> Live:
    """A camera that begins to run, its lens where all methods of the sequence begin.

    ``exposed`` is of the rows that ``region`` needs, for all methods. Raises BadInput for terms that the
    recording cannot keep.
    """
    return Live(
        Film(take, exposed, region, threads=threads),
        measure,
        terms.actuator,
        start=float(seeds.generator(take.seed, "closed loop", "start").uniform(0, 1)),
        seed=seeds.integer(take.seed, "closed loop", "lens"),
        budget=terms.frames(take)[0],
        readout_hz=take.sensor.readout_hz,
    )


def ended(live: Live, answer: Answer, to: float | None, *, budget: int, problem: str = "") -> Run:
    """The run of a method that is done: the lens goes to its last place, where it says one, and settles.

    Raises what the camera met where the stacks cannot be filmed, whatever the method made of it.
    """
    if live.damage is not None:
        raise live.damage
    answered = live.now
    if to is not None:
        live.move(to)
        with suppress(BudgetSpentError):  # the lens is judged where it is then
            live.settle(SETTLED)
    return Run(
        answer,
        problem,
        answered,
        live.path[: live.now].copy(),
        budget,
        live.windows,
        live.seconds,
        tuple(live.sent),
    )


def spent(budget: int) -> str:
    """What is said of a method that had no answer when its time was over."""
    return f"the budget of {budget} frames was spent"


def run_method(
    take: Take, exposed: Exposed, region: Region, method: Method, terms: Terms, *, threads: int | None = None
) -> Run:
    """Let a method find the focus. ``exposed`` is of the rows that ``region`` needs, for all methods.

    Whatever the method raises or answers becomes a run. Raises BadInput for terms that the recording cannot
    keep, and what the stacks raise where they cannot be read.
    """
    budget, sweep = terms.frames(take)
    live = running(take, exposed, region, method.measure, terms, threads=threads)
    try:
        done = _commanded(live, method) if commands(method.search) else _swept(live, method, sweep)
    except BudgetSpentError:
        return ended(live, Answer(), None, budget=budget, problem=spent(budget))
    answer, to, problem = done
    return ended(live, answer, to, budget=budget, problem=problem)


def _commanded(live: Live, method: Method) -> tuple[Answer, float | None, str]:
    """The answer, where the lens goes then, and what is wrong with it."""
    answer, problem = asked(method.search, live, bill=live.bill)
    return answer, _inside(answer.position), problem


def _swept(live: Live, method: Method, frames: int) -> tuple[Answer, float | None, str]:
    """The same, of a search that is given a sweep."""
    begin, end = (0.0, 1.0) if live.sent[0] < 0.5 else (1.0, 0.0)
    live.move(begin)
    live.settle()
    view = Sweep(live, begin, end, frames=frames)
    answer, problem = asked(method.search, view, bill=live.bill)
    live.course = None
    if answer.frame is None:
        return answer, None, problem
    if not -0.5 <= answer.frame <= view.frames - 0.5:
        return Answer(), None, f"answered frame {answer.frame}, which is not of the sweep"
    return answer, _inside(view.position_at(answer.frame)), ""


def _inside(place: float | None) -> float | None:
    """A place that the lens can be sent to: a noisy position sensor may read a little outside the travel."""
    return None if place is None else min(max(float(place), 0.0), 1.0)
