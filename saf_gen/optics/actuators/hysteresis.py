"""Hysteresis of a piezo by the model of Prandtl and Ishlinskii: a weighted sum of play operators [1]_, [2]_.

A play operator of width d follows its input u like a lens with the play d follows its motor: it stays where it is until
u is d/2 ahead of it. With n operators of the widths d = (i - ½)/n, all of the weight w = 4h/n, the drive is at::

    y = (1 - 2h)·u + w·Σ P_d[u] - h

From end to end of the travel, u = y at both ends and y is the hysteresis h lower on the way up than on the way down in
the middle. After a reversal, y has moved by φ(D) = (1 - 2h)·D + w·Σ max(0, D - d) when u has moved by D; for many
operators this is the parabola (1 - 2h)·D + 2h·D² of the Rayleigh law. A loop of the stroke A is therefore h·A² wide and
has the area 2h·A³/3: small strokes have small loops, also as fractions of the stroke, as piezos do [3]_.

The path depends on the order of the input's turning points and not on its speed. An input that returns to a turning
point returns the output to its value there and leaves no memory of the loop between; loops between the same two inputs
are congruent. Creep, and a drive that is not symmetric, are left out.

References
----------
.. [1] M. Brokate, J. Sprekels, Hysteresis and Phase Transitions, 1996, doi:10.1007/978-1-4612-4048-8.
.. [2] K. Kuhnen, Modeling, Identification and Compensation of Complex Hysteretic Nonlinearities, European Journal of
   Control 9, 2003, doi:10.3166/ejc.9.407-418.
.. [3] S. Devasia, E. Eleftheriou, S. O. R. Moheimani, A Survey of Control Issues in Nanopositioning, IEEE Transactions
   on Control Systems Technology 15, 2007, doi:10.1109/TCST.2007.903345.
"""

from collections.abc import Sequence

from saf_gen.optics.actuators.trajectory import Trajectory, apply_backlash, trajectory_at

OPERATORS = 16
"""Number of play operators, which must be even; with 16, a loop is within h/500 of the parabolas."""
WIDTHS = tuple((i + 0.5) / OPERATORS for i in range(OPERATORS))
"""Widths d of the play operators, as fractions of the travel."""


def operators_at_rest(position: float) -> list[float]:
    """Return the states of the operators of a drive that went to ``position`` from the middle of its travel.

    In the middle it had no memory, as after turns to and fro that grew smaller and smaller.
    """
    return [min(max(0.5, position - d / 2), position + d / 2) for d in WIDTHS]


def drive_position(position: float, operators: Sequence[float], *, hysteresis: float) -> float:
    """Return where the drive is, 0 to 1, for the input ``position`` and the states of the operators."""
    return (1 - 2 * hysteresis) * position + 4 * hysteresis / OPERATORS * sum(operators) - hysteresis


def apply_hysteresis(
    motor: Trajectory, operators: Sequence[float], *, hysteresis: float
) -> tuple[Trajectory, list[Trajectory]]:
    """Return the trajectory of a drive with hysteresis, and those of its operators, which start at ``operators``.

    All of them are exact: a sum of pieces of constant acceleration is again such pieces, in one direction each.
    """
    plays = [apply_backlash(motor, state, backlash=d) for state, d in zip(operators, WIDTHS, strict=True)]
    times = sorted({piece[0] for trajectory in (motor, *plays) for piece in trajectory})
    weight, at = 4 * hysteresis / OPERATORS, [-1] * (OPERATORS + 1)
    driven = []
    for time in times:
        sums = [-hysteresis, 0.0, 0.0]
        for k, trajectory in enumerate((motor, *plays)):
            while at[k] + 1 < len(trajectory) and trajectory[at[k] + 1][0] <= time:
                at[k] += 1
            begin, position, speed, acceleration = trajectory[at[k]]
            share, passed = weight if k else 1 - 2 * hysteresis, time - begin
            sums[0] += share * (position + passed * (speed + acceleration * passed / 2))
            sums[1] += share * (speed + acceleration * passed)
            sums[2] += share * acceleration
        driven.append((time, sums[0], sums[1], sums[2]))
    return driven, plays


def states_at(plays: Sequence[Trajectory], seconds: float) -> list[float]:
    """Return the states of the operators at a time, which must not be before their first pieces."""
    return [trajectory_at(play, seconds)[0] for play in plays]
