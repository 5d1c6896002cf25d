"""Where a player stands to the ball at contact: what tactics plan for and strokes must be able to do."""

from typing import Literal

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.body.figure import Figure

MIDDLE_HEIGHT_M = 1.84
LOWEST_BALL_M = 0.12
"""Centre of the lowest ball that a racket can meet."""
EXTRA_REACH_M = 0.45
"""How much further out than at ease a fully stretched player meets the ball."""
OVERHEAD_REACH = (1.30, 1.56)
"""Lowest and highest ball of a serve or smash over the player's height, the jump included."""
GROUND_REACH = 1.05
"""Highest ball of a ground stroke or volley over the player's height."""

# (outward to the side of the stroke, ahead towards the net), metres, of a player of middle height
_AT_EASE = {
    ("overhead", 1): (0.10, 0.38),
    ("forehand", 1): (0.74, 0.38),
    ("backhand", 2): (0.56, 0.40),
    ("backhand", 1): (0.66, 0.46),
}


def contact_offset(
    figure: Figure, side: Literal["forehand", "backhand", "overhead"], hands: Literal[1, 2], stretch: float = 0.0
) -> Float[np.ndarray, " 2"]:
    """(right, ahead), metres: the ball from the pelvis at contact, for a player who looks at the net.

    Overheads count as hit on the racket's side. `stretch` 0 to 1 moves the ball outwards by up to EXTRA_REACH_M.
    """
    out, ahead = _AT_EASE[side, hands]
    scale = figure.height_m / MIDDLE_HEIGHT_M
    right = (1.0 if figure.hand == "right" else -1.0) * (-1.0 if side == "backhand" else 1.0)
    return np.array([right * (scale * out + EXTRA_REACH_M * stretch), scale * ahead])


def pelvis_at_contact(
    figure: Figure,
    player: int,
    ball_xy: Float[np.ndarray, " 2"],
    side: Literal["forehand", "backhand", "overhead"],
    hands: Literal[1, 2],
    stretch: float = 0.0,
) -> Float[np.ndarray, " 2"]:
    """World x, y of the pelvis from which player 0 (near) or 1 (far) meets a ball at this place."""
    right, ahead = contact_offset(figure, side, hands, stretch)
    towards_net = 1.0 if player == 0 else -1.0
    return ball_xy - towards_net * np.array([right, ahead])
