"""A ball that has come to lie on the tape of the net slides off it, to the side where it lies."""

import math

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.flight.air import BallBuild
from pgm_data.simulate.flight.contact import NetShape
from pgm_data.simulate.flight.path import Flight

STEP_S = 1e-3
LEAST_ANGLE = 1e-8
"""No ball lies nearer to the very top, radians: it would stay for ever."""


def slide_off(
    position: Float[np.ndarray, " 3"],
    velocity: Float[np.ndarray, " 3"],
    span: tuple[float, float],
    net: NetShape,
    build: BallBuild,
    gravity: float,
) -> Flight:
    """The ball from one time (seconds) to when it leaves the rounded tape, or to another time.

    It moves without friction on a circle about the tape's axis, across the net: a pendulum upside down.
    """
    axis = net.top_at(float(position[0])) - net.tape_radius_m
    reach = float(np.hypot(position[1], position[2] - axis))
    angle = math.atan2(position[1], position[2] - axis)
    if abs(angle) < LEAST_ANGLE:
        angle = math.copysign(LEAST_ANGLE, angle)
    rate = (velocity[1] * math.cos(angle) - velocity[2] * math.sin(angle)) / reach
    pull = gravity / reach

    def slope(state: np.ndarray) -> np.ndarray:
        return np.array([state[1], pull * math.sin(state[0])])

    states, times = [np.array([angle, rate])], [span[0]]
    while times[-1] < span[1] and (len(times) < 2 or states[-1][1] ** 2 < pull * math.cos(states[-1][0])):
        h = min(STEP_S, span[1] - times[-1])
        now = states[-1]
        k1 = slope(now)
        k2 = slope(now + 0.5 * h * k1)
        k3 = slope(now + 0.5 * h * k2)
        k4 = slope(now + h * k3)
        states.append(now + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
        times.append(times[-1] + h if h == STEP_S else span[1])
    angles, rates = np.array(states).T
    still = np.zeros(len(angles))
    return Flight(
        times=np.array(times),
        positions=np.stack([still + position[0], reach * np.sin(angles), axis + reach * np.cos(angles)], axis=-1),
        velocities=np.stack([still, reach * np.cos(angles) * rates, -reach * np.sin(angles) * rates], axis=-1),
        spins=np.zeros((len(angles), 3)),
        drag_per_m=0.0,
        rolls=True,
    )
