"""The racket as a rigid part of the hand that holds it.

In the frame of the hand's joint (SMPL's L_Hand, R_Hand; at rest x to the person's left, y up, z forward, palm down) the
shaft runs forward, past the thumb, and a little out along the fingers; the face looks where the palm looks.
"""

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.body.figure import Hand

SWEET_SPOT_M = 0.47
"""From the hand's joint to the middle of the strings."""
BUTT_M = -0.07
HEAD_HALF_M = (0.135, 0.105)
"""Half length and half width of the strung head."""
TIP_M = SWEET_SPOT_M + HEAD_HALF_M[0] + 0.012
BALL_RADIUS_M = 0.0335


def shaft_axis(hand: Hand) -> Float[np.ndarray, " 3"]:
    """Unit vector from the butt to the tip, in the hand's frame."""
    out = 0.3 if hand == "left" else -0.3
    axis = np.array([out, 0.0, 1.0])
    return axis / np.linalg.norm(axis)


FACE_NORMAL = np.array([0.0, -1.0, 0.0])
"""Unit normal of the face on the palm's side, in the hand's frame of either hand."""


def sweet_spot(
    R_world_from_hand: Float[np.ndarray, "... 3 3"], hand_position: Float[np.ndarray, "... 3"], hand: Hand
) -> tuple[np.ndarray, np.ndarray]:
    """Middle of the strings and the face's normal on the palm's side, world."""
    middle = hand_position + SWEET_SPOT_M * (R_world_from_hand @ shaft_axis(hand))
    return middle, R_world_from_hand @ FACE_NORMAL


def ball_at_contact(
    R_world_from_hand: Float[np.ndarray, "... 3 3"],
    hand_position: Float[np.ndarray, "... 3"],
    hand: Hand,
    *,
    palm_side: bool,
) -> np.ndarray:
    """Where the centre of a ball lies that touches the middle of the strings; palm side for forehands and overheads."""
    middle, normal = sweet_spot(R_world_from_hand, hand_position, hand)
    return middle + (BALL_RADIUS_M if palm_side else -BALL_RADIUS_M) * normal
