"""Strokes as postures at times: what body and hips do around each contact, seen as a right-hander's."""

import hashlib
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pgm_data.simulate.body import postures
from pgm_data.simulate.body.figure import Figure
from pgm_data.simulate.body.reach import MIDDLE_HEIGHT_M
from pgm_data.simulate.tennis.play import Stroke

Steps = tuple[tuple[str, float], ...]
_DRIVES: dict[str, Steps] = {
    "fh": (("ready", -0.85), ("fh_turn", -0.55), ("fh_back", -0.26), ("fh_drop", -0.10), ("fh_hit", 0.0),
           ("fh_through", 0.10), ("fh_wrap", 0.27), ("ready", 0.80)),
    "bh2": (("ready", -0.85), ("bh2_turn", -0.55), ("bh2_back", -0.26), ("bh2_drop", -0.12), ("bh2_hit", 0.0),
            ("bh2_through", 0.11), ("bh2_up", 0.20), ("bh2_wrap", 0.32), ("ready", 0.85)),
    "bh1": (("ready", -0.85), ("bh1_turn", -0.55), ("bh1_back", -0.26), ("bh1_drop", -0.11), ("bh1_hit", 0.0),
            ("bh1_through", 0.11), ("bh1_wrap", 0.28), ("ready", 0.80)),
}  # fmt: skip
_SLICES: dict[str, Steps] = {
    "fh": (("ready", -0.80), ("fh_turn", -0.50), ("fs_back", -0.20), ("fs_hit", 0.0), ("fs_through", 0.16),
           ("ready", 0.75)),
    "bh": (("ready", -0.80), ("bh1_turn", -0.52), ("bs_back", -0.20), ("bs_hit", 0.0), ("bs_through", 0.16),
           ("ready", 0.75)),
}  # fmt: skip
_VOLLEYS: dict[str, Steps] = {
    "fh": (("ready", -0.48), ("fv_back", -0.15), ("fv_hit", 0.0), ("fv_through", 0.14), ("ready", 0.55)),
    "bh": (("ready", -0.48), ("bv_back", -0.15), ("bv_hit", 0.0), ("bv_through", 0.14), ("ready", 0.55)),
}
_LOBS: dict[str, Steps] = {
    "fh": (("ready", -0.85), ("fh_turn", -0.50), ("fh_drop", -0.17), ("fs_hit", 0.0), ("fl_through", 0.22),
           ("ready", 0.80)),
    "bh1": (("ready", -0.85), ("bh1_turn", -0.50), ("bh1_drop", -0.17), ("bs_hit", 0.0), ("bl_through", 0.22),
            ("ready", 0.80)),
    "bh2": (("ready", -0.85), ("bh2_turn", -0.50), ("bh2_drop", -0.17), ("bh2_hit", 0.0), ("bl2_through", 0.22),
            ("ready", 0.80)),
}  # fmt: skip
_SMASH: Steps = (
    ("ready", -1.0), ("smash_turn", -0.65), ("point_up", -0.36), ("lag", -0.11), ("smite", 0.0), ("past", 0.10),
    ("across", 0.27), ("ready", 0.85),
)  # fmt: skip
_SERVE_END: Steps = (("smite", 0.0), ("past", 0.10), ("across", 0.28), ("ready", 0.95))

# How much of what the contact asks beyond its posture the steps around it share, by their distance from it.
_SHARES_BEFORE = {1: (0.6, 0.3, 0.1), 2: (0.35, 0.2, 0.1)}
_SHARES_AFTER = {1: (0.55, 0.2), 2: (0.3, 0.1)}
_RACKET_ON_ARM_M = 0.43
"""How much further than the knuckles of a straight arm the strings reach."""
GRAVITY = 9.81


@dataclass(frozen=True, eq=False, kw_only=True)
class Swing:
    """One stroke as a right-hander's postures at times."""

    stroke: Stroke
    times: Float[np.ndarray, " steps"]
    """Seconds; the first and the last are the stroke's span."""
    values: Float[np.ndarray, "steps channels"]
    """Postures, as `postures.angles`."""
    hit: int
    """Index of the contact among the steps."""
    toss: int
    """Index of the toss's release; -1 where nothing is tossed."""
    shares: Float[np.ndarray, " steps"]
    """How much each step takes over of what the contact asks beyond its posture."""
    hop: float
    """Height of the jump, metres."""
    palm_side: bool
    """Whether the racket meets the ball with the palm's side of its face."""
    speed: float
    """Of the racket's head at contact, m/s."""


def is_overhead(stroke: Stroke) -> bool:
    """Whether the racket meets the ball above the head."""
    return stroke.side == "overhead" or stroke.kind in ("serve", "smash")


def swing_of(figure: Figure, stroke: Stroke, pelvis: Float[np.ndarray, " 2"], since: float, until: float) -> Swing:
    """A stroke's postures.

    Args:
        figure: Whose.
        stroke: The stroke.
        pelvis: World x, y of the pelvis at the contact, by the plan.
        since: Seconds before the contact within which it must begin.
        until: Seconds after the contact within which it must be over.
    """
    steps, toss = _steps(stroke)
    names = [name for name, _ in steps]
    offsets = np.array([offset for _, offset in steps])
    hit = int(np.argmin(np.abs(offsets)))
    chance = _chances(stroke)
    offsets = offsets * np.where(offsets < 0, 1.0 if toss >= 0 else 1.0 + 0.06 * chance[0], 1.0 + 0.08 * chance[1])
    # A hurried stroke keeps its order and gets quicker.
    offsets = offsets * np.where(offsets < 0, min(1.0, since / -offsets[0]), min(1.0, until / offsets[-1]))
    values = np.stack([postures.angles(name) for name in names])
    varied = np.ones(len(names), bool)
    varied[[0, hit, -1]] = False
    if toss >= 0:
        varied[toss] = False
    wobble = np.deg2rad(3.0) * np.outer(chance[2 : 2 + len(names)], np.cos(np.arange(14) * (1.0 + chance[2])))
    values[:, postures.RACKET] += np.where(varied[:, None], wobble, 0.0)
    shares = _shares(len(names), hit, stroke.hands)
    _bend(figure, stroke, pelvis, values, shares)
    if stroke.hands == 1 and stroke.stretch > 0.4:
        # A far ball leaves the other hand behind.
        values[shares >= _SHARES_BEFORE[1][0], postures.HOLD.start] = 0.0
    return Swing(
        stroke=stroke,
        times=stroke.time + offsets,
        values=values,
        hit=hit,
        toss=toss,
        shares=shares,
        hop=_hop(figure, stroke, pelvis, float(values[hit, postures.HIPS][1])),
        palm_side=stroke.side != "backhand",
        speed=_head_speed(stroke) * (1.0 + 0.06 * chance[3]),
    )


def _steps(stroke: Stroke) -> tuple[Steps, int]:
    two = stroke.hands == 2 and stroke.side == "backhand"
    side = "fh" if stroke.side == "forehand" else ("bh2" if two else "bh1")
    flat = "fh" if side == "fh" else "bh"
    if stroke.kind == "serve":
        return _serve(stroke)
    if is_overhead(stroke):
        return _SMASH, -1
    if stroke.kind in ("volley", "half_volley"):
        return (_LOBS["bh2"] if two else _VOLLEYS[flat]), -1
    if stroke.kind in ("slice", "drop") and not two:
        return _SLICES[flat], -1
    return (_LOBS if stroke.kind == "lob" else _DRIVES)[side], -1


def _serve(stroke: Stroke) -> tuple[Steps, int]:
    """Hands together, down together, up with the toss, racket behind, up to the ball."""
    rise_s = stroke.time - stroke.toss_time
    if not 0.2 < rise_s < 3.0:
        raise ValueError(f"Stroke.toss_time: expected 0.2 to 3 s before {stroke.time}, got {stroke.toss_time}")
    late = min(1.0, rise_s / 0.75)
    steps = (
        *(("stance", -rise_s - 2.6), ("stance", -rise_s - 0.85), ("wind", -rise_s - 0.38), ("release", -rise_s)),
        *(("trophy", -0.43 * late), ("lag", -0.12 * late)),
        *_SERVE_END,
    )
    return steps, 3


def _shares(count: int, hit: int, hands: int) -> np.ndarray:
    shares = np.zeros(count)
    shares[hit] = 1.0
    for k, share in enumerate(_SHARES_BEFORE[hands]):
        if hit - 1 - k > 0:
            shares[hit - 1 - k] = share
    for k, share in enumerate(_SHARES_AFTER[hands]):
        if hit + 1 + k < count - 1:
            shares[hit + 1 + k] = share
    return shares


def _bend(figure: Figure, stroke: Stroke, pelvis: np.ndarray, values: np.ndarray, shares: np.ndarray) -> None:
    """Change hips and trunk of the steps, in place: knees for low balls, a lunge for far ones."""
    side = -1.0 if stroke.side == "backhand" else 1.0
    hit = int(np.argmax(shares))
    longer = np.sqrt(shares)[:, None]
    values[:, 2:3] += longer * side * np.deg2rad(26.0 if is_overhead(stroke) else 10.0) * stroke.stretch
    if is_overhead(stroke):
        values[:, postures.HIPS] += longer * np.array([0.0, 0.0, 0.0, -np.deg2rad(16.0) * stroke.stretch])
        return
    scale = figure.height_m / MIDDLE_HEIGHT_M
    low = float(np.clip(0.88 * scale - stroke.ball[2], 0.0, 0.8))
    high = float(np.clip(stroke.ball[2] - 1.35 * scale, 0.0, 0.6))
    drop = scale * (0.42 * low + 0.06 * stroke.stretch) - 0.25 * high
    # So low that the arm can reach the ball.
    up, rise = _shoulder(figure), _rise(figure, stroke, pelvis)
    most = up - 0.1 - rise - stroke.ball[2] - float(values[hit, postures.HIPS][1])
    drop = min(max(drop, most), 0.45 * scale)
    lean = np.deg2rad(22.0 * low + (14.0 if side < 0 else 9.0) * stroke.stretch)
    tilt = -side * np.deg2rad((11.0 if side < 0 else 18.0) * stroke.stretch)
    values[:, postures.HIPS] += longer * np.array([-side * np.deg2rad(14.0) * stroke.stretch, drop, lean, tilt])


def _shoulder(figure: Figure) -> float:
    """Height of the racket's shoulder of a player who stands, metres."""
    return figure.translations[0, 1] + float(postures.side_bones(figure.translations, figure.hand)[:5, 1].sum())


def _rise(figure: Figure, stroke: Stroke, pelvis: np.ndarray) -> float:
    """How far above or below the shoulder an almost straight arm meets the ball, metres."""
    net = 1.0 if stroke.player == 0 else -1.0
    bones = postures.side_bones(figure.translations, figure.hand)
    arm = float(np.linalg.norm(bones[5:], axis=1).sum()) + _RACKET_ON_ARM_M
    scale = figure.height_m / MIDDLE_HEIGHT_M
    if is_overhead(stroke):
        shoulder = np.array([0.0, 0.20])
    else:
        right = (1.0 if figure.hand == "right" else -1.0) * (-1.0 if stroke.side == "backhand" else 1.0)
        shoulder = np.array([right * (0.18 + 0.1 * stroke.stretch), 0.05])
    away = float(np.linalg.norm(stroke.ball[:2] - pelvis - net * scale * shoulder))
    return float(np.sqrt(arm**2 - min(away, 0.95 * arm) ** 2))


def _hop(figure: Figure, stroke: Stroke, pelvis: np.ndarray, drop: float) -> float:
    """Height of the jump in which the arm is almost straight, metres."""
    # Servers know where the ball comes down and stretch wholly.
    lower = 0.0 if stroke.kind == "serve" else 0.05
    reach = _shoulder(figure) - lower - 0.11 * stroke.stretch - drop + _rise(figure, stroke, pelvis)
    return float(np.clip(stroke.ball[2] - reach, 0.03 if is_overhead(stroke) else 0.0, 0.7))


def _head_speed(stroke: Stroke) -> float:
    """Of the racket's head at contact, m/s."""
    speed = {
        "serve": 40.0, "smash": 34.0, "drive": 27.0, "slice": 17.0, "volley": 8.5, "half_volley": 8.5, "lob": 13.0,
        "drop": 7.0,
    }[stroke.kind]  # fmt: skip
    if stroke.hands == 2:
        # High balls leave the lower arms of both hands less room.
        speed *= 0.93 - 0.28 * float(np.clip(stroke.ball[2] - 1.25, 0.0, 0.5))
    return speed * (1.0 - 0.15 * stroke.stretch)


def _chances(stroke: Stroke) -> np.ndarray:
    """Sixteen numbers in -1 to 1 that depend on the stroke alone and not on which hand plays it."""
    content = np.array([stroke.time, stroke.ball[1], stroke.ball[2]]).tobytes() + stroke.kind.encode()
    digest = hashlib.blake2b(content, digest_size=32).digest()
    return np.frombuffer(digest, dtype="<u2") / 32767.5 - 1.0
