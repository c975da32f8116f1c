"""Courses: a place over time in pieces of constant acceleration. The motor's, and the lens seat's behind it.

A piece is (begins at, place, speed, acceleration), in seconds and travels; it goes on until the next one
begins, the last for ever. Within a piece the direction does not change. Only the four operations and square
roots are used, which every machine rounds alike.
"""

from bisect import bisect_right
from math import copysign, inf, sqrt

__all__ = ["Trajectory", "TrajectoryPiece", "apply_backlash", "plan_move", "state_at"]

TrajectoryPiece = tuple[float, float, float, float]
Trajectory = list[TrajectoryPiece]


def state_at(course: Trajectory, seconds: float) -> tuple[float, float]:
    """Place and speed at a time, not before the first piece begins."""
    begin, place, speed, acceleration = course[bisect_right(course, (seconds, inf)) - 1]
    passed = seconds - begin
    return place + passed * (speed + acceleration * passed / 2), speed + acceleration * passed


def plan_move(to: float, begin: float, place: float, speed: float, top: float, rate: float) -> Trajectory:
    """The fastest course to rest at ``to`` within a ``top`` speed and a ``rate`` of its change.

    Full acceleration, top speed where the way is long enough, full braking: the time-optimal control of a
    double integrator.
    """
    stop = place + speed * abs(speed) / (2 * rate)  # where it comes to rest if it brakes now
    way = 1.0 if to >= stop else -1.0
    ahead = way * speed
    if ahead < 0:  # it must turn round first
        turned = plan_move(to, begin - ahead / rate, stop, 0.0, top, rate)
        return [(begin, place, speed, way * rate), *turned]
    distance = way * (to - place)
    peak = sqrt(max(rate * distance + ahead * ahead / 2, 0.0))
    most = max(min(peak, top), ahead)
    gain, brake = (most * most - ahead * ahead) / (2 * rate), most * most / (2 * rate)
    course, time = [], begin
    if most > ahead:
        course.append((time, place, speed, way * rate))
        time += (most - ahead) / rate
    if peak > most > 0 and distance > gain + brake:
        course.append((time, place + way * gain, way * most, 0.0))
        time += (distance - gain - brake) / most
    if most > 0:
        course.append((time, to - way * brake, way * most, -way * rate))
        time += most / rate
    return [*course, (time, to, 0.0, 0.0)]


def apply_backlash(motor: Trajectory, seat: float, play: float) -> Trajectory:
    """What moves behind ``play`` (in all), and stands at ``seat`` when the motor's course begins.

    The motor moves freely until it is half the play ahead of the seat, and takes it along from there.
    """
    if play == 0:
        return motor
    half, course = play / 2, []
    for number, (begin, place, speed, acceleration) in enumerate(motor):
        if number + 1 == len(motor):
            course.append((begin, seat, 0.0, 0.0))
            break
        end, place_at_end = motor[number + 1][:2]
        way = copysign(1.0, speed or acceleration)
        gap = half - way * (place - seat)
        if gap > 0:
            ahead, rate = way * speed, way * acceleration
            reached = ahead * ahead + 2 * rate * gap
            takes = 2 * gap / (ahead + sqrt(reached)) if reached > 0 else inf
            course.append((begin, seat, 0.0, 0.0))
            if begin + takes >= end:
                continue
            course.append((begin + takes, seat, speed + acceleration * takes, acceleration))
        else:
            course.append((begin, place - way * half, speed, acceleration))
        seat = place_at_end - way * half
    return course
