"""Cameras that nobody held: an orbit, a ride along a line, and paths through key cameras of a file.

All are `PlayCamera`s, a camera for each of the wanted times. Pixels are square, the lens bends nothing and its axis
meets the middle of the picture, but for key cameras that say otherwise.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from pgm_data.geometry.arrays import frozen
from pgm_data.geometry.camera import Camera
from pgm_data.geometry.rigid import rotation_from_rotvec, rotvec_from_rotation
from pgm_data.scene import Scene
from pgm_models.animation.play_camera import PlayCamera

SIZE = (1024, 576)
"""Width and height of pictures where nobody says, px."""
FOV_DEG = 40.0
"""Angle that a picture is wide where nobody says."""
MOST_PIXELS = 65536
"""Widest and highest picture."""
UPRIGHT = 1e-9
"""Sine of the angle to the vertical below which a camera looks straight up or down."""
HALF_TURN = math.pi - 1e-6
"""Radians between neighbouring keys from which on the shortest way from one to the other is not clear."""


@dataclass(frozen=True, eq=False, kw_only=True)
class CameraPath:
    """Cameras at a few times, between which there is one at every time.

    Raises:
        ValueError: If there is no key, times do not rise, a camera is missing, or neighbours look opposite ways.
    """

    times: Float[np.ndarray, " keys"]
    """Of the keys, s, rising."""
    cameras: Camera
    """One a key."""
    size: tuple[int, int]
    """Width and height of the pictures, px."""
    reason: str
    """Where the path is from."""

    def __post_init__(self) -> None:
        """Keep a read-only copy and check the keys."""
        object.__setattr__(self, "times", frozen(self.times))
        cameras = self.cameras.K.shape[:-2]
        if not len(self.times) or cameras != self.times.shape:
            raise ValueError(f"keys: expected as many cameras as times, one or more, got {cameras}, {self.times.shape}")
        refuse_unordered(self.times)
        missing = np.flatnonzero(~np.isfinite(self.cameras.t_cam_from_world).all(axis=-1))
        if len(missing):
            raise ValueError(f"keys[{missing[0]}]: expected a camera, got NaN")
        for number_, angle in enumerate(np.linalg.norm(_turns(self.cameras), axis=-1)):
            if angle >= HALF_TURN:
                raise ValueError(
                    f"keys[{number_ + 1}]: expected a camera turned by less than 180 degrees from that of "
                    f"keys[{number_}], got {math.degrees(angle):.3f}: put another key between them"
                )


@dataclass(frozen=True, kw_only=True)
class Orbit:
    """A circle about a point, at one height, with the eyes on the point.

    Raises:
        ValueError: If a number cannot be.
    """

    aim_world: tuple[float, float, float]
    """What it looks at, world metres."""
    radius_m: float
    """Distance from there, metres."""
    elevation_deg: float = 20.0
    """How high it stands, as seen from the aim: 0 for its height, 90 for above it."""
    azimuth_deg: float = -90.0
    """Where it stands at time 0, as seen from the aim: 0 along x, 90 along y."""
    turn_deg_s: float = 12.0
    """How fast it goes round, degrees a second, counter-clockwise as seen from above."""
    fov_deg: float = FOV_DEG
    """Angle that the picture is wide."""
    size: tuple[int, int] = SIZE
    """Width and height of the pictures, px."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not 0 < self.radius_m < math.inf:
            raise ValueError(f"radius_m: expected above 0, got {self.radius_m}")
        if not -90 < self.elevation_deg < 90:
            raise ValueError(f"elevation_deg: expected above -90 and below 90, got {self.elevation_deg}")
        if not (math.isfinite(self.azimuth_deg) and math.isfinite(self.turn_deg_s)):
            raise ValueError(f"azimuth_deg, turn_deg_s: expected numbers, got {self.azimuth_deg}, {self.turn_deg_s}")
        intrinsics(self.fov_deg, self.size)


@dataclass(frozen=True, kw_only=True)
class Dolly:
    """A ride along a straight line with the eyes on one point; it starts and stops softly.

    Raises:
        ValueError: If a number cannot be.
    """

    start_world: tuple[float, float, float]
    """Where it begins, world metres."""
    end_world: tuple[float, float, float]
    """Where it ends, world metres."""
    aim_world: tuple[float, float, float]
    """What it looks at, world metres; not on its way."""
    duration_s: float
    """From start to end; before and after it stands still."""
    fov_deg: float = FOV_DEG
    """Angle that the picture is wide."""
    size: tuple[int, int] = SIZE
    """Width and height of the pictures, px."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not 0 < self.duration_s < math.inf:
            raise ValueError(f"duration_s: expected above 0, got {self.duration_s}")
        intrinsics(self.fov_deg, self.size)


def intrinsics(fov_deg: float, size: tuple[int, int]) -> Float[np.ndarray, "3 3"]:
    """K of a lens that shows so wide an angle from the left edge of the picture to its right edge, px.

    Raises:
        ValueError: If the angle is not above 0 and below 180 degrees, or the picture has no pixel or too many.
    """
    if not 0 < fov_deg < 180:
        raise ValueError(f"fov_deg: expected above 0 and below 180, got {fov_deg}")
    width, height = size
    if not (1 <= width <= MOST_PIXELS and 1 <= height <= MOST_PIXELS):
        raise ValueError(f"width, height: expected 1 to {MOST_PIXELS}, got {width}, {height}")
    focal = width / 2 / math.tan(math.radians(fov_deg) / 2)
    return np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]])


def looking_at(
    position_world: Float[np.ndarray, "*#batch 3"],
    aim_world: Float[np.ndarray, "*#batch 3"],
    roll_deg: Float[np.ndarray, "*#batch"] | float = 0.0,
) -> Float[np.ndarray, "*batch 3 3"]:
    """R_cam_from_world of upright cameras at the positions that see the aims in the middle of their pictures.

    A camera that looks straight down or up has the world's x to the right. A roll turns the camera clockwise about its
    axis, as seen from behind it.

    Raises:
        ValueError: If a camera stands on its aim.
    """
    forward = np.asarray(aim_world - position_world, dtype=np.float64)
    distance = np.linalg.norm(forward, axis=-1, keepdims=True)
    if not (distance > 0).all():
        raise ValueError("look_at: expected a point away from the camera's position, got the position itself")
    forward = forward / distance
    right = np.stack([forward[..., 1], -forward[..., 0], np.zeros_like(forward[..., 0])], axis=-1)
    level = np.linalg.norm(right, axis=-1, keepdims=True)
    right = np.where(level > UPRIGHT, right / np.where(level > UPRIGHT, level, 1.0), np.array([1.0, 0.0, 0.0]))
    down = np.cross(forward, right)
    # Straight up and down the x axis is level to rounding only.
    right = np.cross(down, forward)
    R = np.stack([right, down, forward], axis=-2)
    R = R / np.linalg.norm(R, axis=-1, keepdims=True)
    roll = np.radians(np.asarray(roll_deg, dtype=np.float64))
    about_axis = np.stack([np.zeros_like(roll), np.zeros_like(roll), -roll], axis=-1)
    return rotation_from_rotvec(about_axis) @ R


def orbit(options: Orbit, times: Float[np.ndarray, " frames"]) -> PlayCamera:
    """The camera that goes round, at the times, s."""
    azimuth = np.radians(options.azimuth_deg + options.turn_deg_s * times)
    elevation = math.radians(options.elevation_deg)
    level, up = options.radius_m * math.cos(elevation), options.radius_m * math.sin(elevation)
    away = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.full_like(azimuth, up)], axis=-1)
    aim = np.array(options.aim_world, dtype=np.float64)
    return _aimed(aim + away, aim, options.fov_deg, options.size, "orbit")


def dolly(options: Dolly, times: Float[np.ndarray, " frames"]) -> PlayCamera:
    """The camera that rides, at the times, s.

    Raises:
        ValueError: If it runs into what it looks at.
    """
    share = np.clip(times / options.duration_s, 0.0, 1.0)
    share = share * share * (3 - 2 * share)
    start, end = (np.array(point, dtype=np.float64) for point in (options.start_world, options.end_world))
    position = start + share[:, None] * (end - start)
    return _aimed(position, np.array(options.aim_world, dtype=np.float64), options.fov_deg, options.size, "dolly")


def usual_orbit(scene: Scene, size: tuple[int, int] = SIZE) -> Orbit:
    """An orbit that sees where the scene's play is: about the middle of the court, or of where players may be."""
    lower, upper = play_area(scene)
    middle, reach = (lower + upper) / 2, float(np.linalg.norm((upper - lower)[:2])) / 2
    # So far that the circle about the area fits into the narrower side of the picture.
    narrow = math.atan(math.tan(math.radians(FOV_DEG) / 2) * min(1.0, size[1] / size[0]))
    return Orbit(
        aim_world=(float(middle[0]), float(middle[1]), 0.5 * scene.person_height_m),
        radius_m=0.6 * reach / math.tan(narrow),
        elevation_deg=25.0,
        size=size,
    )


def play_area(scene: Scene) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
    """Lower and upper corner of a box that holds the court's surface and where the scene's players may be, metres.

    A scene that says neither has 10 metres each way.
    """
    corners = [np.array(player.region_m, dtype=np.float64) for player in scene.players if player.region_m]
    if scene.court is not None:
        x, y = scene.court.surface_half_size
        corners.append(np.array([[-x, -y, 0.0], [x, y, 0.0]]))
    if not corners:
        corners.append(np.array([[-10.0, -10.0, 0.0], [10.0, 10.0, 3.0]]))
    return np.min([low for low, _ in corners], axis=0), np.max([high for _, high in corners], axis=0)


def cameras_at(path: CameraPath, times: Float[np.ndarray, " frames"]) -> PlayCamera:
    """The path's camera at the times, s: at keys that of the key, before the first and after the last one theirs.

    Between keys it turns the shortest way, its centre moves and its focal length is scaled so that none of them
    overshoots a key and that the speed of none jumps there.
    """
    steps = np.linalg.norm(_turns(path.cameras), axis=-1)
    turned = np.concatenate([[0.0], np.cumsum(steps)])
    K, centre = path.cameras.K, path.cameras.position_world
    # Skew, principal point and lens change evenly; focal lengths by factors.
    even = np.concatenate([centre, K[:, [0, 0, 1], [1, 2, 2]], path.cameras.distortion, turned[:, None]], axis=1)
    focal = np.log(K[:, [0, 1], [0, 1]])
    at = np.clip(times, path.times[0], path.times[-1])
    values = _smooth(path.times, np.concatenate([even, focal], axis=1), at)
    segment = np.clip(np.searchsorted(path.times, at, side="right") - 1, 0, max(len(path.times) - 2, 0))
    R = _turned(path.cameras, segment, values[:, 10] - turned[segment])
    made = np.zeros((len(at), 3, 3))
    made[:, [0, 1], [0, 1]] = np.exp(values[:, 11:13])
    made[:, [0, 0, 1], [1, 2, 2]] = values[:, 3:6]
    made[:, 2, 2] = 1.0
    return PlayCamera(
        camera=Camera(
            K=made,
            distortion=values[:, 6:10],
            R_cam_from_world=R,
            t_cam_from_world=-(R @ values[:, :3, None])[..., 0],
        ),
        size=path.size,
        reason=path.reason,
    )


def refuse_unordered(times: Float[np.ndarray, " keys"]) -> None:
    """Refuse times that do not rise.

    Raises:
        ValueError: If one is not finite, or not above the one before; names the key.
    """
    lost = np.flatnonzero(~np.isfinite(times))
    if len(lost):
        raise ValueError(f"keys[{lost[0]}].time: expected a number, got {times[lost[0]]}")
    behind = np.flatnonzero(np.diff(times) <= 0)
    if len(behind):
        place = behind[0] + 1
        raise ValueError(
            f"keys[{place}].time: expected above {times[place - 1]:g}, that of the key before, got {times[place]:g}"
        )


def _turns(cameras: Camera) -> Float[np.ndarray, "_ 3"]:
    """Axis-angle of each key's camera in that of the key before, radians."""
    R = cameras.R_cam_from_world
    return rotvec_from_rotation(R[1:] @ np.swapaxes(R[:-1], -1, -2))


def _turned(
    cameras: Camera, segment: Int[np.ndarray, " frames"], angle: Float[np.ndarray, " frames"]
) -> Float[np.ndarray, "frames 3 3"]:
    """The keys' rotations, each turned so far towards the next one, radians."""
    R = cameras.R_cam_from_world[segment]
    if len(cameras.R_cam_from_world) == 1:
        return R
    turns = _turns(cameras)[segment]
    whole = np.linalg.norm(turns, axis=-1)
    share = np.clip(angle / np.where(whole > 0, whole, 1.0), 0.0, 1.0)
    return rotation_from_rotvec(share[:, None] * turns) @ R


def _smooth(
    times: Float[np.ndarray, " keys"], values: Float[np.ndarray, "keys numbers"], at: Float[np.ndarray, " frames"]
) -> Float[np.ndarray, "frames numbers"]:
    """Values between keys, monotone between neighbours and with speeds that do not jump.

    Source: Fritsch and Butland 1984, as scipy has it.
    """
    from scipy.interpolate import PchipInterpolator

    if len(times) == 1:
        return np.repeat(values, len(at), axis=0)
    with np.errstate(over="ignore"):  # of next to nothing the slope comes out as 0 all the same
        return PchipInterpolator(times, values, axis=0)(at)


def _aimed(
    position_world: Float[np.ndarray, "frames 3"],
    aim_world: Float[np.ndarray, " 3"],
    fov_deg: float,
    size: tuple[int, int],
    reason: str,
) -> PlayCamera:
    frames = len(position_world)
    R = looking_at(position_world, aim_world[None])
    camera = Camera(
        K=np.broadcast_to(intrinsics(fov_deg, size), (frames, 3, 3)),
        distortion=np.zeros((frames, 4)),
        R_cam_from_world=R,
        t_cam_from_world=-(R @ position_world[..., None])[..., 0],
    )
    return PlayCamera(camera=camera, size=size, reason=reason)
