"""One closed loop in plain floats: `closed_loop` without its log, to the same last bit."""

from __future__ import annotations

from typing import TYPE_CHECKING

from barc_sim.tuning.course import Result

if TYPE_CHECKING:
    from barc_sim.tuning.course import Course


def drive(course: Course, kp: float, ki: float, kd: float) -> Result:
    """Drive the PID with these gains over `course`."""
    return Result(
        *loop(
            kp,
            ki,
            kd,
            course.constants,
            *course.stretches,
            course.errors,
            [0.0] * course.delay,
        )
    )


# It is long so that it is fast, a call being dearer than a step, and so that Numba can compile it
# as it is: `barc_sim.tuning.compiled`.
def loop(  # noqa: C901, PLR0912, PLR0915
    kp: float,
    ki: float,
    kd: float,
    constants: tuple[float, ...],
    begins: tuple[float, ...],
    ends: tuple[float, ...],
    pushes: tuple[float, ...],
    errors: tuple[float, ...],
    commands: list[float],
) -> tuple[int, float, int, float, float, float]:
    """Return the fields of a `Result`.

    The arithmetic is that of `PID` and, as nobody steers, of `bikeFE` straight ahead, in the same
    order.

    Parameters
    ----------
    kp, ki, kd
        The gains.
    constants, begins, ends, pushes, errors
        As in `Course`; a number of errors is a number of states.
    commands
        As many as steps of delay, zeros: those on their way.
    """
    reference, limit, drag, friction, mass, ts, dt, distance, run_up, first_end = constants
    steps = -1
    squares = greatest = peak = effort = 0.0
    count = 0
    on_first = True
    delay = len(commands)
    oldest = 0
    stretch = 0
    begin, end, push = begins[0], ends[0], pushes[0]
    x = v = integral = 0.0
    previous = errors[0]
    interval = 0.0  # none before the first sample: nothing is added to the integral
    for k in range(len(errors)):
        while x >= end:
            stretch += 1
            begin, end, push = ends[stretch - 1], ends[stretch], pushes[stretch]
        while x < begin:
            stretch -= 1
            begin, end, push = begins[stretch], ends[stretch], pushes[stretch]

        measured = v + errors[k]
        error = reference - measured
        increment = ki * error * interval
        interval = dt
        wanted = kp * error + integral + increment + -kd * (measured - previous) / dt
        previous = measured
        command = wanted
        if wanted > limit:
            command = limit
            if increment <= 0.0:
                integral += increment
        elif wanted < -limit:
            command = -limit
            if increment >= 0.0:
                integral += increment
        else:
            integral += increment

        effort += command * command
        deviation = reference - v
        if x >= run_up:
            squares += deviation * deviation
            count += 1
            if deviation > greatest:
                greatest = deviation
            elif -deviation > greatest:
                greatest = -deviation
        if on_first:
            on_first = x < first_end
            if on_first and v > peak:
                peak = v
        if x >= distance:
            steps = k
            break

        if delay:
            commands[oldest], command = command, commands[oldest]
            oldest = (oldest + 1) % delay
        x += ts * v
        resistance = drag * v * v + friction
        if v > 0.0:
            v_next = v + ts * (command + (push - resistance) / mass)
            if v_next < 0.0:
                v_next = max(v_next, min(v + ts * (command + push / mass), 0.0))
        elif v < 0.0:
            v_next = v + ts * (command + (push + resistance) / mass)
            if v_next > 0.0:
                v_next = min(v_next, max(v + ts * (command + push / mass), 0.0))
        else:
            v_next = v + ts * (command + push / mass)
        v = v_next
    return steps, squares, count, greatest, peak, effort
