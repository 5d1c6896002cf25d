"""Hand-made plays: people who stand or glide upright, and a ball on parabolas between given contacts."""

from dataclasses import dataclass, replace

import numpy as np

from pgm_data.dataset.clip_ball import ClipBall, EventRows, ShotRows
from pgm_data.dataset.clip_players import ClipPlayers, PlayerTrack
from pgm_data.geometry.rigid import rotation_from_rotvec, rotvec_from_rotation
from pgm_data.scene import Scene, load_scene
from pgm_data.skeleton import world_from_joints

TENNIS = load_scene("tennis")
BLOCKS = load_scene("blocks")
FPS = 25.0
G = np.array([0.0, 0.0, -9.81])


def times_of(seconds: float, fps: float = FPS) -> np.ndarray:
    return np.arange(round(seconds * fps)) / fps


def facing(heading: np.ndarray | float, rows: int) -> np.ndarray:
    """Axis-angle of bodies that look along headings (radians anticlockwise from world +y)."""
    h = np.broadcast_to(np.asarray(heading, dtype=float), rows)
    left, ahead = np.stack([-np.cos(h), -np.sin(h), 0 * h], -1), np.stack([-np.sin(h), np.cos(h), 0 * h], -1)
    up = np.broadcast_to([0.0, 0.0, 1.0], left.shape)
    return rotvec_from_rotation(np.stack([left, up, ahead], axis=-1))


def person(
    index: int,
    xy: np.ndarray,
    heading: np.ndarray | float | None = None,
    *,
    z: np.ndarray | float = 0.0,
    scene: Scene = TENNIS,
) -> PlayerTrack:
    """A person with arms out on a level path; looks at the net unless a heading is given."""
    skeleton = scene.players[index].skeleton
    assert skeleton is not None
    rows = len(xy)
    heading = (0.0 if index == 0 else np.pi) if heading is None else heading
    translations = np.repeat(skeleton.rest_translations[None], rows, axis=0)
    translations[:, 0, :2] = xy
    translations[:, 0, 2] = skeleton.rest_translations[0, 1] + np.broadcast_to(z, rows)
    rotations = np.zeros_like(translations)
    rotations[:, 0] = facing(heading, rows)
    joints = world_from_joints(skeleton.parents, rotations, translations)[1]
    return PlayerTrack(
        name=scene.players[index].name,
        identity=np.full(rows, f"person{index}", dtype=object),
        box_px=np.zeros((rows, 4)) + [0.0, 0.0, 1.0, 1.0],
        keypoints_px=np.zeros((rows, len(skeleton.keypoint_names), 2)),
        keypoint_score=np.ones((rows, len(skeleton.keypoint_names))),
        root_position=translations[:, 0].copy(),
        joints=joints,
        joint_rotations=rotations,
        joint_translations=translations,
        root_cov=np.zeros((rows, 3, 3)),
        contact=np.repeat((np.broadcast_to(z, rows) < 0.02)[:, None], 2, axis=1).astype(float),
        reprojection_px=np.zeros(rows),
        status=np.full(rows, "measured", dtype=object),
    )


def standing(index: int, at: tuple[float, float], rows: int) -> PlayerTrack:
    return person(index, np.broadcast_to(np.asarray(at, dtype=float), (rows, 2)))


def clip_players(*tracks: PlayerTrack) -> ClipPlayers:
    rows = len(tracks[0].status)
    return ClipPlayers(
        clip_id="made", video_frame=np.arange(rows), timestamp=np.arange(rows) / FPS, players=tuple(tracks)
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Contact:
    kind: str
    time: float
    at: tuple[float, float, float]
    player: str = ""
    spin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    in_probability: float = np.nan


def clip_ball(contacts: list[Contact], times: np.ndarray, *, std: float = 0.0) -> ClipBall:
    """The ball of these contacts; flights land in with the probability that their first contact states."""
    at = np.array([contact.at for contact in contacts], dtype=float).reshape(-1, 3)
    when = np.array([contact.time for contact in contacts], dtype=float)
    position, velocity = np.full((len(times), 3), np.nan), np.full((len(times), 3), np.nan)
    starts = []
    for k in range(len(contacts) - 1):
        span = when[k + 1] - when[k]
        v = (at[k + 1] - at[k]) / span - 0.5 * G * span
        starts.append(v)
        inside = (times >= when[k]) & (times < when[k + 1])
        t = (times[inside] - when[k])[:, None]
        position[inside], velocity[inside] = at[k] + v * t + 0.5 * G * t**2, v + G * t
    there = np.isfinite(position[:, 0])
    first = np.arange(max(len(contacts) - 1, 0), dtype=np.int64)
    lands = [contacts[k + 1].kind == "bounce" for k in first]
    landing = np.array([at[k + 1] * [1, 1, 0] if ok else [np.nan] * 3 for k, ok in zip(first, lands, strict=True)])
    count = len(first)
    return ClipBall(
        clip_id="made",
        video_frame=np.arange(len(times)),
        timestamp=times,
        capture_time=times,
        pixel=np.zeros((len(times), 2)),
        score=np.ones(len(times)),
        position=position,
        velocity=velocity,
        position_cov=np.where(there[:, None, None], np.eye(3) * std**2, np.nan),
        status=np.where(there, "measured", "none").astype(object),
        events=EventRows(
            time=when,
            kind=np.array([c.kind for c in contacts], dtype=object),
            player=np.array([c.player for c in contacts], dtype=object),
            probability=np.ones(len(contacts)),
            source=np.full(len(contacts), "human", dtype=object),
            position=at,
        ),
        shots=ShotRows(
            start_event=first,
            end_event=first + 1,
            player=np.array([contacts[k].player for k in first], dtype=object),
            start_speed=np.array([float(np.linalg.norm(v)) for v in starts]),
            spin=np.array([contacts[k].spin for k in first], dtype=float).reshape(-1, 3),
            spin_std=np.zeros((count, 3)),
            drag_per_m=np.zeros(count),
            drag_std_per_m=np.zeros(count),
            landing_position=landing.reshape(-1, 3),
            in_probability=np.array([contacts[k].in_probability for k in first], dtype=float),
            free_parameters=np.full(count, "", dtype=object),
            residual_px=np.zeros(count),
            status=np.full(count, "solved", dtype=object),
        ),
    )


def turned_about(players: ClipPlayers, ball: ClipBall) -> tuple[ClipPlayers, ClipBall]:
    """The same play with ends changed: the world turned by half a turn, near and far exchanged."""
    half = np.array([-1.0, -1.0, 1.0])
    R = np.diag(half)

    def turn(track: PlayerTrack, name: str) -> PlayerTrack:
        rotations = track.joint_rotations.copy()
        rotations[:, 0] = rotvec_from_rotation(R @ rotation_from_rotvec(rotations[:, 0]))
        return replace(
            track,
            name=name,
            root_position=track.root_position * half,
            joints=track.joints * half,
            joint_rotations=rotations,
        )

    near, far = players.players
    return replace(players, players=(turn(far, near.name), turn(near, far.name))), _moved(ball, half, half, other=True)


def mirrored(players: ClipPlayers, ball: ClipBall) -> tuple[ClipPlayers, ClipBall]:
    """The same play in a mirror that changes left and right."""
    flip, axial = np.array([-1.0, 1.0, 1.0]), np.array([1.0, -1.0, -1.0])
    tracks = []
    for track in players.players:
        names = TENNIS.players[0].skeleton.joint_names  # type: ignore[union-attr]
        other = [{"L_": "R_", "R_": "L_"}.get(name[:2], name[:2]) + name[2:] for name in names]
        swap = [names.index(name) for name in other]
        rotations = track.joint_rotations.copy()
        rotations[:, 0] *= axial
        tracks.append(
            replace(
                track,
                root_position=track.root_position * flip,
                joints=(track.joints * flip)[:, swap],
                joint_rotations=rotations,
                contact=track.contact[:, ::-1],
            )
        )
    return replace(players, players=tuple(tracks)), _moved(ball, flip, axial, other=False)


def _moved(ball: ClipBall, point: np.ndarray, axial: np.ndarray, *, other: bool) -> ClipBall:
    def name(names: np.ndarray) -> np.ndarray:
        swap = {"player0": "player1", "player1": "player0", "": ""} if other else {}
        return np.array([swap.get(n, n) for n in names], dtype=object)

    return replace(
        ball,
        position=ball.position * point,
        velocity=ball.velocity * point,
        events=replace(ball.events, position=ball.events.position * point, player=name(ball.events.player)),
        shots=replace(
            ball.shots,
            landing_position=ball.shots.landing_position * point,
            spin=ball.shots.spin * axial,
            player=name(ball.shots.player),
        ),
    )
