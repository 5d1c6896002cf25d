"""Contacts of a ball whose states were made frame by frame: where its flight breaks, when, and by whom.

Between two frames a ball either flies on, by gravity and drag, or something touches it. A *break* is the velocity that
flight does not explain. Near the ground one that turns the fall into a rise is a bounce; at the net one that stops the
ball is a contact with it; near a player one that sends the ball to the other end is a hit. Breaks of frames that follow
each other are one contact, since a model spreads what happens in an instant over two or three frames.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from pgm_data.dataset.clip_ball import ClipBall, EventRows, ShotRows
from pgm_data.dataset.clip_players import ClipPlayers, PlayerTrack
from pgm_data.scene import Scene
from pgm_models.animation.flight import STEP_S
from pgm_models.animation.flight_breaks import (
    ContactOptions,
    bounces_of,
    breaks,
    crossing_of,
    flown,
    hitters_of,
    meeting_of,
    touches_net,
    world_of,
)

SOON_S = 3.0
"""A ball that flies on longer than this is not followed to the ground, s."""
DETECTED = "detected"


def contacts_of_ball(
    position: Float[np.ndarray, "frames 3"],
    velocity: Float[np.ndarray, "frames 3"],
    times: Float[np.ndarray, " frames"],
    roots: Float[np.ndarray, "frames players 3"],
    scene: Scene,
    options: ContactOptions | None = None,
) -> EventRows:
    """Hits, bounces and net contacts in order of time; `first` and `last` where the known states begin and end.

    Times lie between frames. A hit has the name of the player nearest to it. Probabilities are NaN: none is computed.

    Args:
        position: Of the ball, metres; NaN where there is none.
        velocity: m/s, after the contact at a contact.
        times: Seconds, ascending.
        roots: Of the scene's players, in its order, metres.
        scene: With its ball, court and players.
        options: What counts as a contact.

    Raises:
        ValueError: If the scene has no ball or no court, players differ in number, or times do not ascend.
    """
    options = options or ContactOptions()
    if roots.shape[1] != len(scene.players):
        raise ValueError(f"roots: expected those of {len(scene.players)} players, got {roots.shape[1]}")
    if not (np.diff(times) > 0).all():
        raise ValueError("times: expected ascending ones, got two that do not")
    world = world_of(scene)
    there = _known(position, velocity)
    flying = np.flatnonzero(there[1:] & there[:-1])
    gap = breaks(position, velocity, times, flying, scene)
    noise = options.noise_factor * float(np.median(gap)) if len(gap) else 0.0
    broken = np.zeros(max(len(times) - 1, 0), dtype=bool)
    broken[flying[gap > max(options.least_break_m_s, noise)]] = True

    start = flying[gap > max(options.least_bounce_m_s, noise)]
    bounces, at = bounces_of(position, velocity, times, start, start + 1, scene, options)
    broken[start[bounces]] = False
    found = [_rows("bounce", (times[start] + at.seconds)[bounces], at.position[bounces])]

    start, end = _runs(broken)
    # A bounce that is spread over several frames is none of any two of them.
    spread, at = bounces_of(position, velocity, times, start, end, scene, options)
    met = meeting_of(position, velocity, times, start, end, scene)
    when = times[start] + met.seconds
    player = np.where(spread, -1, hitters_of(met, when, times, roots, scene, options))
    hits = player >= 0
    netted = ~hits & ~spread & touches_net(met, world, options)
    found.append(_rows("bounce", (times[start] + at.seconds)[spread], at.position[spread]))
    found.append(_rows("net", when[netted], met.position[netted]))
    names = np.array([entry.name for entry in scene.players], dtype=object)
    found.append(_rows("hit", when[hits], met.position[hits], names[player[hits]]))
    first, last = _runs(there)
    found += [_rows("first", times[first], position[first]), _rows("last", times[last - 1], position[last - 1])]
    events = _joined(*found)
    rank = np.select([events.kind == "first", events.kind == "last"], [0, 2], default=1)
    order = np.lexsort((rank, events.time))
    return EventRows(**{name: getattr(events, name)[order] for name in EventRows.__dataclass_fields__})


def _known(
    position: Float[np.ndarray, "frames 3"], velocity: Float[np.ndarray, "frames 3"]
) -> Bool[np.ndarray, " frames"]:
    return np.array((np.isfinite(position) & np.isfinite(velocity)).all(axis=1), dtype=bool)


def _runs(truth: Bool[np.ndarray, " rows"]) -> tuple[Int[np.ndarray, " runs"], Int[np.ndarray, " runs"]]:
    """First row of each run of truths, and the row after its last."""
    edges = np.diff(np.concatenate([[False], truth, [False]]).astype(np.int8))
    return np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)


def _rows(
    kind: str,
    time: Float[np.ndarray, " rows"],
    position: Float[np.ndarray, "rows 3"],
    player: Shaped[np.ndarray, " rows"] | None = None,
) -> EventRows:
    """Events of one kind, nobody's unless players are named."""
    count = len(time)
    return EventRows(
        time=time,
        kind=np.full(count, kind, dtype=object),
        player=np.full(count, "", dtype=object) if player is None else player,
        probability=np.full(count, np.nan),
        source=np.full(count, DETECTED, dtype=object),
        position=position,
    )


def _joined(*parts: EventRows) -> EventRows:
    fields = EventRows.__dataclass_fields__
    return EventRows(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in fields})


def shots_of_contacts(
    events: EventRows,
    position: Float[np.ndarray, "frames 3"],
    velocity: Float[np.ndarray, "frames 3"],
    times: Float[np.ndarray, " frames"],
    scene: Scene,
) -> ShotRows:
    """The flights between contacts: from whom, how fast at first, and where they land, which is the next bounce.

    What states do not tell (spin, drag, whether it was in) is NaN.

    Args:
        events: As of `contacts_of_ball`.
        position: Of the ball, metres.
        velocity: m/s, after the contact at a contact.
        times: Seconds, ascending.
        scene: With its ball.
    """
    # One that is foretold follows the last frame; a flight goes on to it.
    start = np.flatnonzero((events.kind[:-1] != "last") & (np.diff(events.time) > 0))
    # The first frame of the flight, its velocity flown back to the contact.
    frame = np.searchsorted(times, events.time[start] - 1e-9).clip(0, max(len(times) - 1, 0))
    _, after = flown(position[frame], velocity[frame], events.time[start] - times[frame], scene)
    lands = events.kind[start + 1] == "bounce"
    landing = np.where(lands[:, None], events.position[start + 1] * [1.0, 1.0, 0.0], np.nan)
    count = len(start)
    unknown, unknown_3 = np.full(count, np.nan), np.full((count, 3), np.nan)
    return ShotRows(
        start_event=start.astype(np.int64),
        end_event=(start + 1).astype(np.int64),
        player=events.player[start],
        start_speed=np.linalg.norm(after, axis=1),
        spin=unknown_3,
        spin_std=unknown_3,
        drag_per_m=unknown,
        drag_std_per_m=unknown,
        landing_position=landing,
        in_probability=unknown,
        free_parameters=np.full(count, "", dtype=object),
        residual_px=unknown,
        status=np.full(count, DETECTED, dtype=object),
    )


def one_clip(
    columns: Mapping[str, Shaped[np.ndarray, "frames numbers"]],
    times: Float[np.ndarray, " frames"],
    scene: Scene,
    *,
    clip_id: str = "made",
    options: ContactOptions | None = None,
    past: EventRows | None = None,
    lands: bool = False,
) -> tuple[ClipPlayers, ClipBall | None]:
    """The tables of states that no camera saw, for the rules that read data: players, and the ball with its contacts.

    Args:
        columns: By their names in the contract, as `encode.decode` gives them, a row a frame. Players need root and
            joint columns, the ball position and velocity; without the ball's there is no ball.
        times: When each frame is, s.
        scene: Whose players and ball they are.
        clip_id: What to call it.
        options: What counts as a contact.
        past: Events before the first frame, in order of time, that the ball's are put behind; none where None.
        lands: Whether a ball that flies at the last frame is given the bounce that it flies to.

    Raises:
        ValueError: If a column of a player is missing.
    """
    rows = len(times)
    players = tuple(_track(columns, player.name, rows) for player in scene.players)
    clip = ClipPlayers(clip_id=clip_id, video_frame=np.arange(rows), timestamp=times, players=players)
    if scene.ball is None or "ball.position" not in columns or "ball.velocity" not in columns:
        return clip, None
    position = np.asarray(columns["ball.position"], dtype=np.float64)
    velocity = np.asarray(columns["ball.velocity"], dtype=np.float64)
    there = _known(position, velocity)
    roots = np.stack([track.root_position for track in players], axis=1)
    events = contacts_of_ball(position, velocity, times, roots, scene, options)
    if lands and len(times) and there[-1]:
        events = _joined(events, landing_to_come(position[-1], velocity[-1], float(times[-1]), scene))
    if past is not None:
        events = _joined(past, events)
    ball = ClipBall(
        clip_id=clip_id,
        video_frame=np.arange(rows),
        timestamp=times,
        capture_time=times,
        pixel=np.full((rows, 2), np.nan),
        score=np.full(rows, np.nan),
        position=np.where(there[:, None], position, np.nan),
        velocity=np.where(there[:, None], velocity, np.nan),
        position_cov=np.where(there[:, None, None], 0.0, np.full((rows, 3, 3), np.nan)),
        status=np.where(there, "filled", "none").astype(object),
        events=events,
        shots=shots_of_contacts(events, position, velocity, times, scene),
    )
    return clip, ball


def landing_to_come(
    position: Float[np.ndarray, " 3"], velocity: Float[np.ndarray, " 3"], time: float, scene: Scene
) -> EventRows:
    """The bounce of a ball that flies on from there without spin, as a row of events; none that is not soon.

    Args:
        position: Of the ball, metres.
        velocity: m/s.
        time: When that is, s.
        scene: With its ball.
    """
    world = world_of(scene)
    seconds = np.arange(0.0, SOON_S, STEP_S)
    count = len(seconds)
    path, speed = flown(np.tile(position, (count, 1)), np.tile(velocity, (count, 1)), seconds, scene)
    low = np.flatnonzero((path[1:, 2] <= world.radius_m) & (speed[1:, 2] < 0))
    rows = low[:1] if world.bounces else low[:0]
    rest = crossing_of(path[rows], speed[rows], world, rising=False).clip(0.0, STEP_S)
    place, _ = flown(path[rows], speed[rows], rest, scene)
    place[:, 2] = world.radius_m
    return _rows("bounce", time + seconds[rows] + rest, place)


def _track(columns: Mapping[str, np.ndarray], name: str, rows: int) -> PlayerTrack:
    def column(part: str) -> np.ndarray:
        key = f"{name}.{part}"
        if key not in columns:
            raise ValueError(f"{key}: expected the column, got {', '.join(columns)}")
        return np.asarray(columns[key], dtype=np.float64)

    root = column("root_position")
    there = np.array(np.isfinite(root).all(axis=1), dtype=bool)
    return PlayerTrack(
        name=name,
        identity=np.full(rows, "", dtype=object),
        box_px=np.full((rows, 4), np.nan),
        keypoints_px=np.full((rows, 0, 2), np.nan),
        keypoint_score=np.full((rows, 0), np.nan),
        root_position=root,
        joints=column("joints").reshape(rows, -1, 3),
        joint_rotations=column("joint_rotations").reshape(rows, -1, 3),
        joint_translations=column("joint_translations").reshape(rows, -1, 3),
        root_cov=np.where(there[:, None, None], 0.0, np.full((rows, 3, 3), np.nan)),
        contact=np.full((rows, 2), np.nan),
        reprojection_px=np.full(rows, np.nan),
        status=np.where(there, "filled", "none").astype(object),
    )
