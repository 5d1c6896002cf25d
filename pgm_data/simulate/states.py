"""What is true in every frame of one shot: the one form in which worlds hand their truth to tables and pictures."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

EventKind = Literal["hit", "bounce", "net", "first", "last"]


@dataclass(frozen=True, eq=False, kw_only=True)
class PlayerStates:
    """One player object in every frame."""

    identity: str
    """The person, constant in a match."""
    handedness: Literal["left", "right"] | None
    """The hand of the racket, where there is one."""
    rotations: Float[np.ndarray, "frames joints 3 3"]
    """R_parent_from_joint; entry 0 is R_world_from_root."""
    translations: Float[np.ndarray, "frames joints 3"]
    """t_parent_from_joint, metres; entry 0 is the root's position in the world."""
    joints: Float[np.ndarray, "frames joints 3"]
    """World positions, metres."""
    contact: Bool[np.ndarray, "frames 2"]
    """Whether the left, the right foot stands on the ground."""
    keypoints: Float[np.ndarray, "frames keypoints 3"]
    """World positions of the scene's 2D keypoint set, metres."""
    hull_centres: Float[np.ndarray, "frames balls 3"]
    """World positions of balls that together wrap the body, metres: its box in the picture is theirs."""
    hull_radii: Float[np.ndarray, " balls"]
    """Metres."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BallStates:
    """The ball in every frame; NaN where there is none."""

    position: Float[np.ndarray, "frames 3"]
    """World metres, the centre."""
    velocity: Float[np.ndarray, "frames 3"]
    """m/s; at a contact, the one after it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BallEvent:
    """One contact of the ball, or the start or end of its course."""

    time: float
    """Seconds, capture time of the shot."""
    kind: EventKind
    player: str
    """Player object that hit, such as player0; empty where none did."""
    position: Float[np.ndarray, " 3"]
    """World metres, centre of the ball."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BallFlight:
    """One flight between two events."""

    start_event: int
    """Index into the shot's events."""
    end_event: int
    player: str
    """Who hit it; empty where nobody did."""
    start_speed: float
    """m/s."""
    spin: Float[np.ndarray, " 3"]
    """Angular velocity after the start, world, rad/s."""
    drag_per_m: float
    """rho Cd A / (2 m), 1/m, of this flight."""
    landing: Float[np.ndarray, " 3"]
    """Where it first meets the ground, world metres; NaN where it does not."""
    lands_in: bool | None
    """Whether that is inside of the court that counts; None where nothing lands or nothing counts."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Caption:
    """One span of one player, in several words."""

    player: int
    """Index of the player object."""
    start_s: float
    """Capture time of the shot."""
    end_s: float
    texts: tuple[str, ...]
    """The main text first, then others that say the same."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ShotStates:
    """The truth of one shot apart from its cameras."""

    players: tuple[PlayerStates, ...]
    """By the scene's order of player objects; empty where the scene has none."""
    ball: BallStates | None
    """None where the scene has no ball."""
    events: tuple[BallEvent, ...]
    flights: tuple[BallFlight, ...]
    captions: tuple[Caption, ...]
