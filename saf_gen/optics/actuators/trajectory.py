"""Trajectories with piecewise constant acceleration, of the motor and of what it moves with play.

A piece is (begin, position, speed, acceleration), in seconds and travels. It lasts until the next piece begins; the
last piece does not end. The direction does not change within a piece. Only the four basic operations and square roots
are used, which all machines round in the same way.
"""

from bisect import bisect_left, bisect_right
from math import copysign, inf, sqrt

TrajectoryPiece = tuple[float, float, float, float]
Trajectory = list[TrajectoryPiece]


def trajectory_at(trajectory: Trajectory, seconds: float) -> tuple[float, float]:
    """Return position and speed at a time, which must not be before the first piece."""
    begin, position, speed, acceleration = trajectory[bisect_right(trajectory, (seconds, inf)) - 1]
    elapsed = seconds - begin
    return position + elapsed * (speed + acceleration * elapsed / 2), speed + acceleration * elapsed


def move_fastest(
    target: float, begin: float, *, position: float, speed: float, max_speed: float, acceleration: float
) -> Trajectory:
    """Return the fastest trajectory from a position and speed at the time ``begin`` to rest at ``target``.

    It consists of full acceleration, maximum speed if the distance is long enough, and full braking, which is the
    time-optimal control of a double integrator.
    """
    stop = position + speed * abs(speed) / (2 * acceleration)  # position of rest if it brakes now
    direction = 1.0 if target >= stop else -1.0
    ahead = direction * speed
    if ahead < 0:  # it must reverse first
        reversed_at = begin - ahead / acceleration
        limits = {"max_speed": max_speed, "acceleration": acceleration}
        rest = move_fastest(target, reversed_at, position=stop, speed=0.0, **limits)
        return [(begin, position, speed, direction * acceleration), *rest]
    distance = direction * (target - position)
    peak = sqrt(max(acceleration * distance + ahead * ahead / 2, 0.0))
    top = max(min(peak, max_speed), ahead)
    gain, brake = (top * top - ahead * ahead) / (2 * acceleration), top * top / (2 * acceleration)
    trajectory, time = [], begin
    if top > ahead:
        trajectory.append((time, position, speed, direction * acceleration))
        time += (top - ahead) / acceleration
    if peak > top > 0 and distance > gain + brake:
        trajectory.append((time, position + direction * gain, direction * top, 0.0))
        time += (distance - gain - brake) / top
    if top > 0:
        trajectory.append((time, target - direction * brake, direction * top, -direction * acceleration))
        time += top / acceleration
    return [*trajectory, (time, target, 0.0, 0.0)]


def apply_backlash(motor: Trajectory, seat: float, *, backlash: float) -> Trajectory:
    """Return the trajectory of the lens seat, which starts at ``seat`` and which the motor moves with backlash.

    The motor moves freely until it is half the backlash ahead of the seat; from there on it moves the seat along.
    """
    if backlash == 0:
        return motor
    half, trajectory = backlash / 2, []
    for number, (begin, position, speed, acceleration) in enumerate(motor):
        if number + 1 == len(motor):
            trajectory.append((begin, seat, 0.0, 0.0))
            break
        end, position_at_end = motor[number + 1][:2]
        direction = copysign(1.0, speed or acceleration)
        gap = half - direction * (position - seat)
        if gap > 0:
            ahead, rate = direction * speed, direction * acceleration
            reached = ahead * ahead + 2 * rate * gap
            delay = 2 * gap / (ahead + sqrt(reached)) if reached > 0 else inf
            trajectory.append((begin, seat, 0.0, 0.0))
            if begin + delay >= end:
                continue
            trajectory.append((begin + delay, seat, speed + acceleration * delay, acceleration))
        else:
            trajectory.append((begin, position - direction * half, speed, acceleration))
        seat = position_at_end - direction * half
    return trajectory


def pieces_until(trajectory: Trajectory, seconds: float) -> Trajectory:
    """Return the pieces of a trajectory that begin before a time."""
    return trajectory[: bisect_left(trajectory, (seconds,))]
