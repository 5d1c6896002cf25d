"""How a player moves over some time, from the path of its root, in the categories of `facts`.

What no category fits is empty. Speeds are those of people; no threshold depends on the frame rate, since paths are
evened out over capture time first.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from pgm_data.caption.facts import COMPASS, OWN_WAYS
from pgm_data.dataset.clip_players import PlayerTrack
from pgm_data.geometry.rigid import rotation_from_rotvec

RATE_HZ = 50.0
"""Of the evened paths."""
SMOOTH_S = 0.08
"""Standard deviation of the Gaussian that evens positions out."""
LONGEST_STEP_S = 0.3
"""Frames further apart than this are not joined."""
STILL_M, STILL_M_S = 0.35, 0.8
"""A player that goes no further and no faster stays where it is."""
STILL_SLACK_M = 0.3
"""By how much uncertain positions may seem to wander at most."""
LEAST_JUMP_M = 0.2
FALL_S, FALL_M_S = 0.16, 1.3
"""Rising speed that a body in the air loses in that time, at the least."""
LEAST_MOVE_M = 0.45
STRAIGHT = 0.65
"""Displacement over length of a way that counts as one way."""
DIAGONAL = 0.58
"""Smaller over larger component from which on a way is diagonal."""
UNKNOWN_STD_M = 0.5
"""Standard deviation of positions whose covariance is not given."""
SHARED = 0.5
"""Share of a position's standard deviation that does not cancel in a displacement over a second or two."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PlayerPath:
    """An uninterrupted stretch of a player's states on an even grid, in its own frame (the world's without a net)."""

    times: Float[np.ndarray, " knots"]
    """Capture times, s."""
    position: Float[np.ndarray, "knots 2"]
    """Of the root, metres."""
    height: Float[np.ndarray, " knots"]
    """World z of the root, metres."""
    speed: Float[np.ndarray, " knots"]
    """Level, m/s."""
    heading: Float[np.ndarray, " knots"]
    """Where the body looks, radians anticlockwise from +y of the frame, continuous; NaN where unknown."""
    off_ground: Float[np.ndarray, " knots"]
    """Probability that neither foot is on the ground; NaN where unknown."""
    std: Float[np.ndarray, "knots 2"]
    """Of the position, metres."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Movement:
    """What a player's feet do from one moment to another; words of `facts`."""

    motion: str = ""
    way: str = ""
    second_way: str = ""
    gait: str = ""
    starts: bool = False
    stops: bool = False
    jumps: bool = False
    rise_m: float = 0.0
    turn_deg: float = float("nan")
    distance_m: float = 0.0
    top_speed_m_s: float = 0.0


def runs_of(track: PlayerTrack, capture_time: Float[np.ndarray, " frames"]) -> list[tuple[int, int]]:
    """First frame and frame after the last of each uninterrupted stretch of frames with a state."""
    there = np.asarray(track.status != "none", dtype=bool) & np.isfinite(track.root_position).all(axis=1)
    edges = np.diff(np.concatenate([[False], there, [False]]).astype(np.int8))
    far = np.flatnonzero(np.diff(capture_time) > LONGEST_STEP_S) + 1
    runs = []
    for start, end in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True):
        cuts = [int(start), *(int(k) for k in far if start < k < end), int(end)]
        runs += list(zip(cuts[:-1], cuts[1:], strict=True))
    return runs


def path_of(
    track: PlayerTrack, capture_time: Float[np.ndarray, " frames"], start: int, end: int, look: int
) -> PlayerPath | None:
    """The path over frames start to end (excluded); None where they show fewer than two moments.

    Args:
        track: The player.
        capture_time: When each frame was taken, s; a repeat has its source's.
        start: First frame.
        end: Frame after the last; every frame between has a state.
        look: 1 or -1, where the player looks along y at the net; 0 without one.
    """
    times, first = np.unique(capture_time[start:end], return_index=True)
    if len(times) < 2:
        return None
    rows = start + first
    grid = times[0] + np.arange(int(np.floor((times[-1] - times[0]) * RATE_HZ + 1e-6)) + 1) / RATE_HZ
    sign = -1.0 if look < 0 else 1.0
    root = _evened(_on_grid(grid, times, track.root_position[rows]))
    position = sign * root[:, :2]
    velocity = np.gradient(position, axis=0) * RATE_HZ if len(grid) > 1 else np.zeros_like(position)
    with np.errstate(invalid="ignore"):
        variance = np.diagonal(track.root_cov[rows], axis1=1, axis2=2)[:, :2]
        std = np.where(np.isfinite(variance), np.sqrt(np.maximum(variance, 0.0)), UNKNOWN_STD_M)
    ahead = rotation_from_rotvec(track.joint_rotations[rows, 0])[:, :2, 2] * sign
    off = (1.0 - track.contact[rows]).prod(axis=1)
    return PlayerPath(
        times=grid,
        position=position,
        height=root[:, 2],
        speed=np.hypot(velocity[:, 0], velocity[:, 1]),
        heading=_headings(_on_grid(grid, times, ahead)),
        off_ground=_on_grid(grid, times, off[:, None])[:, 0],
        std=_on_grid(grid, times, std),
    )


def _on_grid(grid: np.ndarray, times: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.stack([np.interp(grid, times, column) for column in values.T], axis=-1)


def _evened(values: np.ndarray) -> np.ndarray:
    """Gaussian averages over time; near the ends over fewer knots."""
    reach = int(np.ceil(3 * SMOOTH_S * RATE_HZ))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / (SMOOTH_S * RATE_HZ)) ** 2)
    kernel /= kernel.sum()
    # Turned about its ends, so that a straight way keeps its speed there.
    padded = np.concatenate(
        [
            2 * values[0] - values[np.minimum(np.arange(reach, 0, -1), len(values) - 1)],
            values,
            2 * values[-1] - values[np.maximum(len(values) - 1 - np.arange(1, reach + 1), 0)],
        ]
    )
    return np.stack([np.convolve(column, kernel, mode="valid") for column in padded.T], axis=-1)


def _headings(ahead: np.ndarray) -> np.ndarray:
    """Continuous angles of level directions; NaN where a body lies."""
    angle = np.arctan2(-ahead[:, 0], ahead[:, 1])
    known = np.isfinite(angle) & (np.hypot(*ahead.T) > 0.3)
    result = np.full(len(angle), np.nan)
    result[known] = np.unwrap(angle[known])
    return result


def movement_between(path: PlayerPath, start_s: float, end_s: float, *, has_net: bool) -> Movement:
    """The player's movement between two capture times that lie within the path."""
    first = int(np.clip(np.searchsorted(path.times, start_s - 1e-9), 0, len(path.times) - 1))
    last = int(np.clip(np.searchsorted(path.times, end_s + 1e-9) - 1, first, len(path.times) - 1))
    if last - first < 3:
        return Movement()
    knots = slice(first, last + 1)
    position, speed, heading = path.position[knots], path.speed[knots], path.heading[knots]
    steps = np.hypot(*np.diff(position, axis=0).T)
    doubt = SHARED * float(np.hypot(*(path.std[first] + path.std[last])) / np.sqrt(2.0))
    turn = int(np.argmax(np.hypot(*(position - position[0]).T) + np.hypot(*(position - position[-1]).T)))
    net = position[-1] - position[0]
    distance, length, top = float(np.hypot(*net)), float(steps.sum()), float(speed.max())
    extent = float(np.hypot(*np.ptp(position, axis=0)))
    motion, way, second_way, gait = "", "", "", ""
    slack = min(2 * doubt, STILL_SLACK_M)
    if top < STILL_M_S + 2 * slack and extent < STILL_M + slack:
        motion = "still"
    elif _turns(position, steps, turn, doubt):
        motion = "turns"
        way, second_way = (way_of(d, has_net=has_net) for d in (position[turn] - position[0], net_of(position, turn)))
        gait = _gait(position[: turn + 1], speed[: turn + 1], heading[: turn + 1], has_net=has_net)
    elif distance >= max(LEAST_MOVE_M, 2 * doubt) and distance >= STRAIGHT * length:
        motion, way = "moves", way_of(net, has_net=has_net)
        gait = _gait(position, speed, heading, has_net=has_net)
    elif length < 2.0 and extent < 0.7:
        motion = "shifts"
    ends = max(min(10, len(speed) // 3), 1)
    calm_before, calm_after = float(speed[:ends].max()) < 0.5, float(speed[-ends:].max()) < 0.5
    turned = heading[np.isfinite(heading)]
    return Movement(
        motion=motion,
        way=way,
        second_way=second_way,
        gait=gait,
        starts=motion == "moves" and calm_before and float(speed[-ends:].min()) > 0.9,
        stops=motion == "moves" and calm_after and not calm_before and top > 1.0,
        jumps=_jumps(path, first, last),
        rise_m=float(path.height[last] - path.height[first]),
        turn_deg=float(np.degrees(turned[-1] - turned[0])) if len(turned) == len(heading) else float("nan"),
        distance_m=distance,
        top_speed_m_s=top,
    )


def net_of(position: np.ndarray, turn: int) -> np.ndarray:
    """The way from the turn to the end."""
    return position[-1] - position[turn]


def _turns(position: np.ndarray, steps: np.ndarray, turn: int, doubt: float) -> bool:
    """Whether the player goes to the place of the turn and comes back from it, clearly."""
    if not 2 < turn < len(position) - 3:
        return False
    one, two = position[turn] - position[0], position[-1] - position[turn]
    sizes = float(np.hypot(*one)), float(np.hypot(*two))
    lengths = float(steps[:turn].sum()), float(steps[turn:].sum())
    clear = all(size >= STRAIGHT * length for size, length in zip(sizes, lengths, strict=True))
    return clear and min(sizes) > max(0.6, 2 * doubt) and float(one @ two) < -0.3 * sizes[0] * sizes[1]


def way_of(displacement: Float[np.ndarray, " 2"], *, has_net: bool) -> str:
    """The word for a displacement: own left, right, forward, back and between, or a compass direction without a net."""
    if not has_net:
        eighth = np.arctan2(displacement[0], displacement[1]) / (np.pi / 4)
        return COMPASS[round(float(eighth)) % 8]
    side = "right" if displacement[0] > 0 else "left"
    along = "forward" if displacement[1] > 0 else "back"
    small, large = sorted(np.abs(displacement))
    if small >= DIAGONAL * large and small >= 0.35:
        return f"{side} {along}"
    return side if abs(displacement[0]) > abs(displacement[1]) else along


def _gait(position: np.ndarray, speed: np.ndarray, heading: np.ndarray, *, has_net: bool) -> str:
    """How the feet go; `move` where it is not clear."""
    top = float(speed.max())
    way = way_of(position[-1] - position[0], has_net=has_net)
    if float(np.hypot(*(position[-1] - position[0]))) < 0.95 and top < 2.2:
        return "step"
    ahead = _share_ahead(position, heading)
    if top > 5.0:
        return "sprint"
    if top > 3.4 and not ahead < 0.4:
        return "run"
    if ahead > 0.6:
        return "walk" if top < 1.9 else "jog" if 2.3 < top < 3.1 else "move"
    if abs(ahead) < 0.45 and top < 3.8 and way not in ("forward", "back"):
        return "sidestep"
    if ahead < -0.7 and top < 3.8 and ("back" in way or way not in OWN_WAYS):
        return "backpedal"
    return "move"


def _share_ahead(position: np.ndarray, heading: np.ndarray) -> float:
    """How much of the way goes where the body looks: 1 ahead, 0 sideways, -1 backwards; NaN where unknown."""
    velocity = np.gradient(position, axis=0)
    ahead = np.stack([-np.sin(heading), np.cos(heading)], axis=-1)
    length = float(np.hypot(*velocity.T).sum())
    return float((velocity * ahead).sum() / length) if length > 0 else float("nan")


def _jumps(path: PlayerPath, first: int, last: int) -> bool:
    """Whether the player leaves the ground, rises and is pulled back as a body in the air is; a climb is no jump."""
    off, height = path.off_ground[first : last + 1], path.height[first : last + 1]
    window = int(FALL_S * RATE_HZ)
    if not np.isfinite(off).all() or len(off) <= window:
        return False
    peak = int(np.argmax(height))
    rise = np.gradient(height) * RATE_HZ
    lost = rise[:-window] - rise[window:]
    in_air = np.lib.stride_tricks.sliding_window_view(off > 0.5, window + 1).all(axis=1)
    falls = bool((in_air & (lost > FALL_M_S)).any())
    return falls and float(height[peak] - height[: peak + 1].min()) > LEAST_JUMP_M


def changes_of(path: PlayerPath) -> Float[np.ndarray, " changes"]:
    """Capture times at which the player starts, stops or turns by more than a right angle's two thirds."""
    moving = path.speed > 0.7
    found = np.flatnonzero(moving[1:] != moving[:-1]) + 1
    reach = int(0.2 * RATE_HZ)
    if len(path.times) > 2 * reach + 2:
        before = path.position[reach:-reach] - path.position[: -2 * reach]
        after = path.position[2 * reach :] - path.position[reach:-reach]
        sizes = np.hypot(*before.T) * np.hypot(*after.T)
        turns = (before * after).sum(axis=1) < 0.5 * sizes
        sharp = turns & (np.minimum(np.hypot(*before.T), np.hypot(*after.T)) > 0.15)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], sharp, [False]]).astype(np.int8)))
        found = np.concatenate([found, reach + edges.reshape(-1, 2).mean(axis=1).astype(np.int64)])
    return path.times[np.unique(found.clip(0, len(path.times) - 1))]


def leaps_of(path: PlayerPath) -> Float[np.ndarray, " changes"]:
    """Capture times at which the player leaves the ground or comes back to it."""
    off = np.nan_to_num(path.off_ground) > 0.5
    return path.times[np.flatnonzero(off[1:] != off[:-1]) + 1]


def split_steps(path: PlayerPath, times: Float[np.ndarray, " hits"]) -> Int[np.ndarray, " steps"]:
    """Knots at which the player is in the air on the spot about the moment of another's hit."""
    off = np.where(np.isfinite(path.off_ground), path.off_ground, 0.0) > 0.5
    near = np.zeros(len(off), dtype=bool)
    for time in times:
        near |= (path.times > time - 0.45) & (path.times < time + 0.45)
    return np.flatnonzero(off & near & (path.speed < 1.5))
