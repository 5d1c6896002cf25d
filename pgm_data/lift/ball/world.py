"""What a ball flies in: gravity, air, ground and net, with the priors of a scene's file."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pgm_data.geometry.arrays import frozen
from pgm_data.scene import Prior, Scene

GRAVITY = 9.81
"""m/s^2, along -z."""
AIR_KG_M3 = 1.205
"""Density of air at 20 degrees C and sea level."""
INERTIA = 0.55
"""Moment of inertia over mass radius^2: a thin shell has 2/3, a thick one less (Cross)."""
HIT_HEIGHT = Prior(mean=0.58, std=0.28)
"""Height of the ball over the players' floor at a hit, as a share of a person's height."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BallWorld:
    """Constants and priors of one scene's ball. Lengths in metres, world frame, z up."""

    radius_m: float
    drag_per_m: Prior
    """C = rho Cd A / (2 m), 1/m: deceleration over squared speed."""
    lift_per_m: float
    """rho A / (2 m), 1/m: Magnus acceleration over squared speed and lift coefficient S / (1 + 2 S); 0 without lift.
    S = radius spin / speed."""
    spin_std: float
    """Prior standard deviation of each component of the spin after a hit about 0, rad/s; 0 without lift."""
    restitution: Prior | None
    """None where the ball does not bounce in play."""
    friction: Prior | None
    ground_half_size: tuple[float, float]
    """Half extent along x and y of the plane z = 0 off which the ball bounces: a table's top, a court's surface."""
    floor_z: float
    """Height of the floor on which players stand: 0, or that of the floor under a table."""
    hit_height: Prior
    """World z of the ball at a hit."""
    reach_half_size: tuple[float, float]
    """Half extent along x and y of where players hit."""
    serve_y: float
    """How far from the net a ball in play may land at most, along y: serves are struck near there. NaN where the court
    does not say."""
    net_xz: Float[np.ndarray, "corners 2"]
    """Top edge of the net over y = 0, x and z, left to right; empty without a net."""

    def __post_init__(self) -> None:
        """Keep a read-only copy."""
        object.__setattr__(self, "net_xz", frozen(self.net_xz))

    @property
    def bounces(self) -> bool:
        """Whether the ball bounces in play."""
        return self.restitution is not None


def ball_world(scene: Scene) -> BallWorld:
    """The world of the scene's ball.

    Raises:
        ValueError: If the scene declares no ball or no court.
    """
    ball, court = scene.ball, scene.court
    if ball is None or court is None:
        lacks = "ball" if ball is None else "court"
        raise ValueError(f"scene {scene.name}: expected a {lacks}, since a ball is to be placed in metres, got none")
    corners = np.array([corner for player in scene.players for corner in player.region_m], dtype=float).reshape(-1, 3)
    half = court.surface_half_size
    floor = float(corners[:, 2].min()) if len(corners) else 0.0
    reach = np.abs(corners[:, :2]).max(axis=0) if len(corners) else np.array(half)
    height = scene.person_height_m
    names = (*court.point_names, *court.high_names)
    points = np.concatenate([court.points_world, court.high_world])
    net = points[[names.index(name) for name in court.net_top]]
    return BallWorld(
        radius_m=ball.radius_m,
        drag_per_m=ball.drag_per_m,
        lift_per_m=AIR_KG_M3 * np.pi * ball.radius_m**2 / (2 * ball.mass_kg) if ball.lift == "spin" else 0.0,
        spin_std=ball.spin_std_rad_s,
        restitution=ball.restitution,
        friction=ball.friction,
        ground_half_size=half,
        floor_z=floor,
        hit_height=Prior(mean=floor + HIT_HEIGHT.mean * height, std=HIT_HEIGHT.std * height),
        reach_half_size=(float(reach[0]), float(reach[1])),
        serve_y=float(court.in_play[:, 1, 1].max()) if len(court.in_play) else float("nan"),
        net_xz=net[:, [0, 2]].reshape(-1, 2),
    )
