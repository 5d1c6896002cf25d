"""What the tables say about each hit: who, where body and ball are then, what the ball does next."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from pgm_data.dataset.clip_ball import ClipBall, nearest_frames
from pgm_data.dataset.clip_players import ClipPlayers, PlayerTrack
from pgm_data.geometry.rigid import rotation_from_rotvec
from pgm_data.scene import Scene, SceneObject

RPM = 60.0 / (2.0 * np.pi)
REACH_S = 0.25
"""A player's state counts for a hit this near to a frame that has one."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Contacts:
    """One row a hit whose player is known, in order of time; in the hitting player's own frame (see `court_areas`)."""

    event: Int[np.ndarray, " hits"]
    player: Int[np.ndarray, " hits"]
    time: Float[np.ndarray, " hits"]
    ball: Float[np.ndarray, "hits 3"]
    """Own frame, z above the ground, metres; NaN where unknown."""
    ball_std: Float[np.ndarray, " hits"]
    """Of its place on the level, metres; NaN where unknown."""
    body: Float[np.ndarray, "hits 3"]
    """The root; own frame, metres."""
    right: Float[np.ndarray, "hits 2"]
    """The body's own right, level, in the own frame."""
    head_height: Float[np.ndarray, " hits"]
    """The highest joint above the ground, metres."""
    left_wrist: Float[np.ndarray, "hits 3"]
    """Own frame, metres."""
    right_wrist: Float[np.ndarray, "hits 3"]
    speed: Float[np.ndarray, " hits"]
    """After the hit, m/s."""
    apex: Float[np.ndarray, " hits"]
    """Highest point until the next contact, above the ground, metres."""
    topspin: Float[np.ndarray, " hits"]
    """Revolutions a minute; backspin below 0."""
    topspin_std: Float[np.ndarray, " hits"]
    landing: Float[np.ndarray, "hits 2"]
    """Own frame, metres; NaN where nothing lands."""
    landing_std: Float[np.ndarray, "hits 2"]
    taken: Float[np.ndarray, "hits 2"]
    """Where the next player hits it before it lands, own frame; NaN where nobody does."""
    in_probability: Float[np.ndarray, " hits"]
    after: tuple[tuple[int, ...], ...]
    """Rows of the events after each hit, up to the next hit (excluded) of anybody."""
    next_event: Int[np.ndarray, " hits"]
    """Row of the next hit of anybody; -1 where there is none."""


def contacts_of(
    players: ClipPlayers,
    ball: ClipBall,
    capture_time: Float[np.ndarray, " frames"],
    scene: Scene,
    look: Int[np.ndarray, " players"],
) -> Contacts:
    """The contacts of the clip's hits; hits that nobody can be named for are left out."""
    events, shots = ball.events, ball.shots
    hits = np.flatnonzero(events.kind == "hit")
    who = _players(ball, hits, scene, look)
    hits, who = hits[who >= 0], who[who >= 0]
    every = np.flatnonzero(events.kind == "hit")
    following = np.searchsorted(every, hits, side="right")
    next_hit = np.array([every[k] if k < len(every) else -1 for k in following], dtype=np.int64)
    ends = np.where(next_hit < 0, len(events.time), next_hit)
    after = tuple(tuple(range(hit + 1, end)) for hit, end in zip(hits.tolist(), ends.tolist(), strict=True))
    sign = np.where(look[who] < 0, -1.0, 1.0)
    floors = np.array([player.region_m[0][2] if player.region_m else 0.0 for player in scene.players])
    floor = floors[who] if len(who) else np.zeros(0)
    frame = nearest_frames(events.time, ball.capture_time)
    std = np.sqrt(np.maximum(np.diagonal(ball.position_cov, axis1=1, axis2=2), 0.0))
    at = events.position[hits].copy()
    known = np.isfinite(at).all(axis=1)
    at[~known] = ball.position[frame[hits[~known]]]
    flight = {int(start): row for row, start in enumerate(shots.start_event)}
    row = np.array([flight.get(int(hit), -1) for hit in hits], dtype=np.int64)
    landing, landing_std = _landings(ball, hits, row, after, std[frame])
    spin, spin_std = _of(shots.spin, row), _of(shots.spin_std, row)
    topspin, topspin_std = _topspin(spin, spin_std, _velocity(ball, hits, at, next_hit, frame))
    bodies = [
        _body(players.players[p], scene.players[p], capture_time, float(events.time[hit]))
        for hit, p in zip(hits.tolist(), who.tolist(), strict=True)
    ]
    own = np.stack([sign, sign, np.ones_like(sign)], axis=-1)
    drop = np.stack([0 * floor, 0 * floor, floor], axis=-1)
    stacked = np.array(bodies, dtype=np.float64).reshape(len(hits), 5, 3)
    taken = np.full((len(hits), 2), np.nan)
    airborne = (next_hit >= 0) & np.array([not any(events.kind[k] == "bounce" for k in rows) for rows in after], bool)
    taken[airborne] = events.position[next_hit[airborne], :2]
    return Contacts(
        event=hits,
        player=who,
        time=events.time[hits],
        ball=at * own - drop,
        ball_std=std[frame[hits], :2].max(axis=1) if len(hits) else np.zeros(0),
        body=stacked[:, 0] * own - drop,
        right=stacked[:, 1, :2] * sign[:, None],
        head_height=stacked[:, 2, 2] - floor,
        left_wrist=stacked[:, 3] * own - drop,
        right_wrist=stacked[:, 4] * own - drop,
        speed=_of(shots.start_speed, row),
        apex=_apexes(ball, hits, at) - floor,
        topspin=topspin,
        topspin_std=topspin_std,
        landing=landing * sign[:, None],
        landing_std=landing_std,
        taken=taken * sign[:, None],
        in_probability=_of(shots.in_probability, row),
        after=after,
        next_event=next_hit,
    )


def _of(values: np.ndarray, row: Int[np.ndarray, " hits"]) -> np.ndarray:
    """The rows' values; NaN where the row is -1."""
    if not len(values):
        return np.full((len(row), *values.shape[1:]), np.nan)
    found = values[np.maximum(row, 0)].astype(np.float64)
    found[row < 0] = np.nan
    return found


def _players(ball: ClipBall, hits: np.ndarray, scene: Scene, look: np.ndarray) -> Int[np.ndarray, " hits"]:
    """Index of each hit's player: the one named, else the one at whose end it is, of two that face each other."""
    names = [player.name for player in scene.players]
    found = np.array([names.index(name) if name in names else -1 for name in ball.events.player[hits]], dtype=np.int64)
    facing = len(names) == 2 and sorted(look.tolist()) == [-1, 1]
    y = ball.events.position[hits, 1]
    for k in np.flatnonzero(found < 0):
        if facing and np.isfinite(y[k]) and abs(y[k]) > 0.5:
            found[k] = int(np.flatnonzero(look == (1 if y[k] < 0 else -1))[0])
    return found


def _body(track: PlayerTrack, player: SceneObject, capture_time: np.ndarray, time: float) -> list[np.ndarray]:
    """Root, own right, highest joint, left and right wrist at a time, world; NaN where unknown."""
    unknown = np.full(3, np.nan)
    there = np.flatnonzero(
        np.asarray(track.status != "none", dtype=bool) & np.isfinite(track.root_position).all(axis=1)
    )
    if not len(there):
        return [unknown] * 5
    times, first = np.unique(capture_time[there], return_index=True)
    rows = there[first]
    nearest = int(np.abs(times - time).argmin())
    if abs(times[nearest] - time) > REACH_S:
        return [unknown] * 5
    after = int(np.clip(np.searchsorted(times, time), 1, max(len(times) - 1, 1)))
    pair = rows[[after - 1, min(after, len(times) - 1)]]
    gap = capture_time[pair[1]] - capture_time[pair[0]]
    share = float(np.clip((time - capture_time[pair[0]]) / gap, 0.0, 1.0)) if 0 < gap <= 2 * REACH_S else 0.0
    if not 0 < gap <= 2 * REACH_S:
        pair = rows[[nearest, nearest]]

    def between(values: np.ndarray) -> np.ndarray:
        return (1.0 - share) * values[pair[0]] + share * values[pair[1]]

    joints = between(track.joints)
    rotation = rotation_from_rotvec(track.joint_rotations[pair[0], 0])
    right = np.array([-rotation[0, 0], -rotation[1, 0], 0.0])
    size = float(np.hypot(right[0], right[1]))
    heights = joints[:, 2]
    top = joints[int(np.nanargmax(heights))] if np.isfinite(heights).any() else unknown
    names = player.skeleton.joint_names if player.skeleton is not None else ()
    head = joints[names.index("Head")] if "Head" in names else top
    wrists = [_point(player, joints, name) for name in ("left_wrist", "right_wrist")]
    return [between(track.root_position), right / size if size > 0.2 else unknown, head, *wrists]


def _point(player: SceneObject, joints: np.ndarray, name: str) -> np.ndarray:
    skeleton = player.skeleton
    if skeleton is None or name not in skeleton.point_names:
        return np.full(3, np.nan)
    return joints[int(skeleton.point_joints[skeleton.point_names.index(name)])]


def _landings(
    ball: ClipBall, hits: np.ndarray, row: np.ndarray, after: tuple[tuple[int, ...], ...], std: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Where each hit's ball first meets the ground, world, and how well that is known."""
    kinds = ball.events.kind
    landing = _of(ball.shots.landing_position, row)[:, :2]
    doubt = np.full((len(hits), 2), np.nan)
    for k, rows in enumerate(after):
        bounce = next((event for event in rows if kinds[event] == "bounce"), None)
        if bounce is not None and np.isfinite(ball.events.position[bounce]).all():
            landing[k], doubt[k] = ball.events.position[bounce, :2], std[bounce, :2]
    probability = _of(ball.shots.in_probability, row)
    # A ball that was taken before it landed is known where it was taken; the rest of its way is a guess.
    guessed = np.isnan(doubt).any(axis=1) & np.isfinite(landing).all(axis=1)
    doubt[guessed] = np.where(np.isfinite(probability[guessed, None]), 0.6, 1.0)
    return landing, doubt


def _velocity(ball: ClipBall, hits: np.ndarray, at: np.ndarray, next_hit: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """Level direction of the ball after each hit."""
    velocity = np.full((len(hits), 2), np.nan)
    for k, hit in enumerate(hits.tolist()):
        first = int(frame[hit])
        later = np.flatnonzero(ball.capture_time > ball.events.time[hit] + 1e-6)
        if len(later):
            there = ball.position[later[0] : min(later[0] + 3, len(ball.position)), :2] - at[k, :2]
            good = np.flatnonzero(np.isfinite(there).all(axis=1))
            if len(good):
                velocity[k] = there[good[-1]]
                continue
        velocity[k] = ball.velocity[first, :2]
    return velocity


def _topspin(spin: np.ndarray, spin_std: np.ndarray, way: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Spin about the level axis across the way, positive where the ball's top moves ahead, and its std, rpm."""
    length = np.hypot(*way.T)
    axis = np.stack([-way[:, 1], way[:, 0]], axis=-1) / np.where(length > 1e-9, length, np.nan)[:, None]
    std = np.sqrt((axis**2 * spin_std[:, :2] ** 2).sum(axis=1))
    return (spin[:, :2] * axis).sum(axis=1) * RPM, std * RPM


def _apexes(ball: ClipBall, hits: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Highest world z from each hit to the next contact; NaN where less than two thirds of the frames know it."""
    apex = np.full(len(hits), np.nan)
    for k, hit in enumerate(hits.tolist()):
        end = ball.events.time[hit + 1] if hit + 1 < len(ball.events.time) else np.inf
        inside = (ball.capture_time >= ball.events.time[hit]) & (ball.capture_time <= end)
        heights = ball.position[inside, 2]
        known = np.isfinite(heights)
        if known.any() and known.mean() > 0.66:
            apex[k] = max(float(heights[known].max()), float(at[k, 2]) if np.isfinite(at[k, 2]) else -np.inf)
    return apex


def estimated_handedness(contacts: Contacts, players: int) -> tuple[str, ...]:
    """Of each player, the hand nearer the ball at its hits over the clip; empty where that is not clear.

    Both hands on the racket say little, a serve says much: each hit votes by how much nearer one wrist is.
    """
    left = np.linalg.norm(contacts.left_wrist - contacts.ball, axis=1)
    right = np.linalg.norm(contacts.right_wrist - contacts.ball, axis=1)
    vote = np.clip((left - right) / 0.3, -2.0, 2.0)
    vote[np.abs(left - right) < 0.2] = 0.0
    words = []
    for player in range(players):
        own = vote[(contacts.player == player) & np.isfinite(vote)]
        total = float(own.sum())
        agreed = len(own) > 0 and float(np.abs(own).sum()) > 0 and abs(total) >= 0.6 * float(np.abs(own).sum())
        words.append("" if abs(total) < 1.5 or not agreed else "right" if total > 0 else "left")
    return tuple(words)
