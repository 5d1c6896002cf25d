"""From what a player means to what the racket does: a launch towards the target, then the hand's scatter."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.flight.aim import Launch, aim, launched, net_clearance
from pgm_data.simulate.flight.course import FlightWorld
from pgm_data.simulate.tennis.choice import Intent

RADS_PER_RPM = 2.0 * np.pi / 60.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Strike:
    """The ball just after a hit."""

    velocity: Float[np.ndarray, " 3"]
    spin: Float[np.ndarray, " 3"]
    """Angular velocity, world, rad/s."""
    target: Float[np.ndarray, " 2"]
    """World x, y that was aimed at."""
    topspin_rpm: float


def struck(
    rng: np.random.Generator, intent: Intent, player: int, ball: Float[np.ndarray, " 3"], world: FlightWorld
) -> Strike:
    """The ball after a stroke of player 0 (near) or 1 (far) at a place."""
    forward = 1.0 if player == 0 else -1.0
    target = forward * intent.target
    launch = _launch(intent, ball, target, world)
    speed = float(np.linalg.norm(launch.velocity))
    direction = launch.velocity / speed
    # Elevation and azimuth scatter on their own, as do speed and spin.
    elevation = np.arcsin(np.clip(direction[2], -1.0, 1.0)) + intent.elevation_sd * rng.normal()
    azimuth = np.arctan2(direction[1], direction[0]) + intent.azimuth_sd * rng.normal()
    speed *= float(np.clip(1.0 + intent.speed_sd * rng.normal(), 0.5, 1.2))
    share = float(np.clip(1.0 + 0.06 * rng.normal(), 0.6, 1.4))
    elevation = float(np.clip(elevation, -1.5, 1.5))
    flat = np.cos(elevation)
    velocity = speed * np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
    return Strike(velocity=velocity, spin=share * launch.spin, target=target, topspin_rpm=share * intent.topspin_rpm)


def _launch(intent: Intent, ball: np.ndarray, target: np.ndarray, world: FlightWorld) -> Launch:
    """A launch to the target that clears the net; slower and deeper, or in the end faster, where it must be."""
    topspin, sidespin = intent.topspin_rpm * RADS_PER_RPM, intent.sidespin_rpm * RADS_PER_RPM
    found: Launch | None = None
    speed = intent.speed
    for _ in range(9):
        launch = aim(ball, target, speed, topspin, sidespin, world, high=intent.high)
        if launch is None:
            if found is not None:
                break
            speed *= 1.12
            continue
        found = launch
        if intent.high or net_clearance(ball, launch, world) >= intent.clearance:
            return launch
        # A little deeper and a little slower at once.
        speed *= 0.965 if intent.kind == "drive" else 0.985 if intent.kind == "serve" else 0.94
        target = _deeper(target, 0.35 if intent.kind == "drive" else 0.15, 10.6 if intent.kind == "drive" else 5.9)
    if found is None:
        # In a storm there may be no way; then it is hit up and along.
        azimuth = float(np.arctan2(target[1] - ball[1], target[0] - ball[0]))
        return launched(intent.speed, 0.35, azimuth, topspin, sidespin)
    return found


def _deeper(target: np.ndarray, by: float, most: float) -> np.ndarray:
    """The target further from the net, up to a depth."""
    depth = abs(float(target[1]))
    return target * np.array([1.0, max(depth, min(depth + by, most)) / depth])
