"""Numbers of professional singles: speeds, spins, targets, places, as quantiles and shares.

Summary statistics fitted to ball tracking of two hard-court matches (about 1,100 serves and 2,500 other shots); the
shots themselves are not here. Quantiles stand at the chances `CHANCES` and are joined by straight lines. Landing places
are what players aim at: narrower than where balls land, since execution scatters them.
"""

from dataclasses import dataclass

import numpy as np

CHANCES = (0.02, 0.25, 0.5, 0.75, 0.98)

Quantiles = tuple[float, float, float, float, float]


def drawn(rng: np.random.Generator, quantiles: Quantiles) -> float:
    """A value by lot from quantiles at `CHANCES`."""
    return float(np.interp(rng.random(), CHANCES, quantiles))


@dataclass(frozen=True, eq=False, kw_only=True)
class Strokes:
    """How one kind of stroke is played."""

    speed: Quantiles
    """m/s at the hit."""
    topspin_rpm: Quantiles
    """Negative backspin."""
    depth: Quantiles
    """Aimed distance of the landing from the net, metres."""
    elevation_sd: float
    """Scatter of the launch's elevation at ease, degrees."""
    azimuth_sd: float
    """Scatter of the launch's azimuth at ease, degrees."""


_DEEP: Quantiles = (5.2, 7.2, 8.3, 9.4, 10.9)

DRIVES = {
    "forehand": Strokes(
        speed=(19.0, 31.0, 35.2, 38.4, 44.0),
        topspin_rpm=(1100.0, 2350.0, 2880.0, 3350.0, 4100.0),
        depth=_DEEP,
        elevation_sd=1.02,
        azimuth_sd=2.0,
    ),
    "backhand": Strokes(
        speed=(17.0, 27.0, 31.5, 34.3, 38.0),
        topspin_rpm=(850.0, 1400.0, 1650.0, 2150.0, 3150.0),
        depth=_DEEP,
        elevation_sd=1.02,
        azimuth_sd=2.0,
    ),
}
RETURN_DRIVES = {
    "forehand": Strokes(
        speed=(18.3, 25.6, 30.0, 34.4, 42.0),
        topspin_rpm=(850.0, 1250.0, 1450.0, 1800.0, 2600.0),
        depth=_DEEP,
        elevation_sd=1.2,
        azimuth_sd=2.1,
    ),
    "backhand": Strokes(
        speed=(19.0, 25.6, 29.9, 33.2, 37.0),
        topspin_rpm=(800.0, 1130.0, 1340.0, 1520.0, 1950.0),
        depth=_DEEP,
        elevation_sd=1.2,
        azimuth_sd=2.1,
    ),
}
SLICES = {
    "forehand": Strokes(
        speed=(15.0, 19.8, 22.4, 24.0, 27.0),
        topspin_rpm=(-3000.0, -2350.0, -2000.0, -1650.0, -1250.0),
        depth=(4.5, 6.2, 7.6, 9.0, 10.3),
        elevation_sd=1.0,
        azimuth_sd=1.5,
    ),
    "backhand": Strokes(
        speed=(16.5, 21.4, 22.4, 24.0, 26.3),
        topspin_rpm=(-3750.0, -2950.0, -2450.0, -2050.0, -1400.0),
        depth=(5.0, 7.2, 8.4, 9.5, 10.7),
        elevation_sd=0.9,
        azimuth_sd=1.4,
    ),
}
VOLLEY = Strokes(
    speed=(12.0, 17.5, 20.5, 23.0, 29.0),
    topspin_rpm=(-3300.0, -2100.0, -1750.0, -1350.0, -900.0),
    depth=(4.0, 6.2, 7.4, 9.0, 10.6),
    elevation_sd=1.3,
    azimuth_sd=1.8,
)
SMASH = Strokes(
    speed=(28.0, 36.0, 42.0, 48.0, 53.0),
    topspin_rpm=(-600.0, 0.0, 400.0, 900.0, 1800.0),
    depth=(4.5, 6.0, 7.2, 8.8, 10.4),
    elevation_sd=0.9,
    azimuth_sd=1.6,
)
LOB = Strokes(
    speed=(15.5, 17.5, 18.6, 19.6, 21.0),
    topspin_rpm=(-1800.0, -1300.0, -600.0, 600.0, 1800.0),
    depth=(8.0, 9.3, 10.0, 10.5, 11.2),
    elevation_sd=1.4,
    azimuth_sd=1.8,
)
DROP = Strokes(
    speed=(10.0, 11.5, 12.5, 13.5, 15.0),
    topspin_rpm=(-2800.0, -2300.0, -1900.0, -1500.0, -1000.0),
    depth=(1.8, 2.4, 2.8, 3.4, 4.5),
    elevation_sd=1.0,
    azimuth_sd=1.4,
)

SIDEWAYS: Quantiles = (0.2, 1.4, 2.2, 2.85, 3.6)
"""Aimed distance of the landing from the court's middle line, metres."""
CROSS_SHARE = {"forehand": 0.56, "backhand": 0.55}
"""How often a ground stroke is aimed to the court's other side."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Serves:
    """First or second serves."""

    speed: Quantiles
    """m/s at the hit."""
    topspin_rpm: Quantiles
    sidespin_rpm: Quantiles
    directions: tuple[float, float, float]
    """Shares of wide, body, T."""
    wide: Quantiles
    """Aimed distance from the middle line of a wide serve, metres."""
    depth: Quantiles
    """Aimed distance of the landing from the net, metres."""
    elevation_sd: float
    azimuth_sd: float


FIRST_SERVES = Serves(
    speed=(47.5, 51.5, 54.0, 57.0, 62.5),
    topspin_rpm=(100.0, 500.0, 900.0, 1400.0, 2200.0),
    sidespin_rpm=(200.0, 900.0, 1700.0, 2600.0, 4000.0),
    directions=(0.45, 0.08, 0.47),
    wide=(2.6, 3.2, 3.5, 3.7, 3.9),
    depth=(4.5, 4.95, 5.3, 5.6, 6.0),
    elevation_sd=0.86,
    azimuth_sd=1.1,
)
SECOND_SERVES = Serves(
    speed=(37.0, 42.0, 45.5, 48.0, 51.5),
    topspin_rpm=(900.0, 1600.0, 2100.0, 2700.0, 3800.0),
    sidespin_rpm=(200.0, 900.0, 1500.0, 2300.0, 3500.0),
    directions=(0.3, 0.38, 0.32),
    wide=(1.9, 2.4, 2.8, 3.2, 3.6),
    depth=(3.9, 4.3, 4.7, 5.1, 5.6),
    elevation_sd=0.62,
    azimuth_sd=0.85,
)
BODY: Quantiles = (1.1, 1.6, 1.9, 2.2, 2.7)
CENTRE: Quantiles = (0.15, 0.3, 0.45, 0.7, 1.1)
"""Aimed distance from the middle line of body serves and of serves down the T, metres."""

SERVE_HEIGHT: Quantiles = (1.505, 1.525, 1.535, 1.542, 1.55)
"""Contact of a serve over the player's height."""
SERVE_DEPTH = {1: (11.17, 11.28, 11.36, 11.46, 11.62), 2: (11.24, 11.36, 11.47, 11.56, 11.72)}
"""Contact of a first or second serve from the net, metres."""
SERVE_SIDEWAYS = {"right": (0.4, 0.55, 0.7, 0.8, 1.0), "left": (0.6, 1.1, 1.3, 1.45, 1.7)}
"""Contact of a serve from the middle line, in the server's right and left court, metres."""
RECEIVER_DEPTH = {1: (13.3, 14.2, 14.6, 15.0, 15.8), 2: (12.5, 13.5, 14.1, 14.8, 15.6)}
"""Where the receiver of a first or second serve waits, from the net, metres."""
RECEIVER_SIDEWAYS: Quantiles = (3.1, 3.6, 3.8, 3.95, 4.15)

GROUND_HEIGHT = (0.9, 0.3)
"""Contact that ground strokes like best, metres: mean and scatter."""
RETURN_HEIGHT = (1.05, 0.4)
"""The same of returns of serve."""
GROUND_DEPTH = (13.9, 1.1)
RETURN_DEPTH = (12.4, 1.7)
"""Distance from the net at which ground strokes and returns are met most, metres: mean and scatter."""
