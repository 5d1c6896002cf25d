"""Players by lot: different bodies, hands, speed and manners."""

import numpy as np

from pgm_data.simulate.body.figure import draw_figure
from pgm_data.simulate.tennis.play import Athlete

LEFT_HANDED_SHARE = 0.13
ONE_HANDED_BACKHAND_SHARE = 0.2


def draw_athlete(rng: np.random.Generator, identity: str) -> Athlete:
    """A professional of this name by lot."""

    def about(mean: float, sd: float) -> float:
        return mean + sd * float(np.clip(rng.normal(), -2.0, 2.0))

    hand = "left" if rng.random() < LEFT_HANDED_SHARE else "right"
    return Athlete(
        identity=identity,
        figure=draw_figure(rng, hand),
        backhand_hands=1 if rng.random() < ONE_HANDED_BACKHAND_SHARE else 2,
        top_speed=about(7.2, 0.4),
        acceleration=about(9.2, 0.5),
        reaction_s=about(0.15, 0.015),
        power=about(1.0, 0.04),
        topspin=about(1.0, 0.1),
        attacks_net=float(np.clip(rng.beta(1.6, 3.5), 0.02, 0.98)),
        steadiness=about(1.0, 0.08),
    )
