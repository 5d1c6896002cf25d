"""How a foot stands, rolls off over its toe joint and swings to its next place."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float

from pgm_data.simulate import rotations
from pgm_data.simulate.body.figure import Figure, smpl24
from pgm_data.simulate.body.footsteps import Stances

if TYPE_CHECKING:
    from pgm_data.simulate.body.pelvis import Moments, PelvisCourse

MIDDLE_HEIGHT_M = 1.8
"""Height of the person whose lengths stand in the skeleton file, and here."""
SOLE_BELOW_TOE_M = 0.01
HEEL_BEHIND_ANKLE_M = 0.05
_HIGHEST_PITCH = 0.95
_PIVOT_FROM, _PIVOT_ROOM = 0.45, 0.3
"""Hips may turn this far (radians) over a planted foot before it pivots on its ball, and how much more in the limit."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Build:
    """Lengths of the feet."""

    scale: float
    """Height over MIDDLE_HEIGHT_M."""
    toe_ahead: float
    """Of the ankle at rest, metres, as the next."""
    toe_below: float
    toe_inwards: tuple[float, float]
    """To the left of the ankle, of the left and the right foot."""

    @staticmethod
    def of(figure: Figure) -> "Build":
        """Lengths of a figure's feet."""
        left, right = (figure.translations[smpl24().joint_names.index(name)] for name in ("L_Toe", "R_Toe"))
        return Build(
            scale=figure.height_m / MIDDLE_HEIGHT_M,
            toe_ahead=float(left[2]),
            toe_below=float(-left[1]),
            toe_inwards=(float(left[0]), float(right[0])),
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class StanceEnds:
    """How a foot is pitched at the ends of its stances, so that swings begin and end there."""

    at_land: Float[np.ndarray, " stances"]
    at_lift: Float[np.ndarray, " stances"]
    from_pelvis_at_land: Float[np.ndarray, "stances 2"]
    """World x, y of the toe joint from the pelvis, metres, as the next."""
    from_pelvis_at_lift: Float[np.ndarray, "stances 2"]
    hops: Float[np.ndarray, " stances"]
    """1 where the swing after the stance is the flight of a hop, else 0."""

    @staticmethod
    def of(build: Build, foot: int, stances: Stances, course: "PelvisCourse") -> "StanceEnds":
        """Pitches of one foot."""
        pitches, places = [], []
        for times in (stances.land, stances.lift):
            moment = course.at(np.clip(times, 0.0, course.times[-1]))
            yaw, pivot = _pivoted(stances.yaw, moment.hips)
            pitches.append(_roll(build, stances.toe, yaw, pivot, moment))
            places.append(stances.toe - moment.xy)
        start, end = course.airborne[course.wide == 0.0].T
        landing = np.append(stances.land[1:], np.inf)
        hops = (np.abs(stances.lift[:, None] - start) < 0.02) | (np.abs(landing[:, None] - end) < 0.02)
        return StanceEnds(
            at_land=pitches[0],
            at_lift=pitches[1],
            from_pelvis_at_land=places[0],
            from_pelvis_at_lift=places[1],
            hops=hops.any(axis=1).astype(float),
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class FootPose:
    """One foot at some times."""

    planted: Bool[np.ndarray, " times"]
    ankle: Float[np.ndarray, "times 3"]
    """World metres."""
    forward: Float[np.ndarray, "times 3"]
    """Level unit vector along the foot, world."""
    R_world_from_foot: Float[np.ndarray, "times 3 3"]
    pitch: Float[np.ndarray, " times"]
    """Radians that the heel is up."""
    away: Float[np.ndarray, " times"]
    """0 where the foot stands, rising to 1 and falling in a swing, without a jump."""
    toe_bend: Float[np.ndarray, " times"]
    """Share of the pitch that the toes make good by bending."""


def pose(build: Build, foot: int, stances: Stances, ends: StanceEnds, moment: "Moments") -> FootPose:
    """One foot (0 left, 1 right) over a moving pelvis."""
    times = moment.times
    i = np.maximum(np.searchsorted(stances.land, times, side="right") - 1, 0)
    planted = times < stances.lift[i]
    j = np.minimum(i + 1, len(stances.land) - 1)
    lift = np.where(planted, 0.0, stances.lift[i])
    u = np.where(planted, 0.0, (times - lift) / np.where(planted, 1.0, stances.land[j] - lift))
    way = np.where(planted[:, None], 0.0, stances.toe[j] - stances.toe[i])

    share = _ramp_up_and_down(u)
    toe = stances.toe[i] + share[:, None] * way + np.sin(np.pi * u)[:, None] ** 2 * stances.bulge[i]
    # In a hop feet travel with the pelvis.
    under = ends.from_pelvis_at_lift[i]
    under = under + _smooth(u)[:, None] * (ends.from_pelvis_at_land[j] - under)
    along = np.where(planted, 0.0, ends.hops[i] * _smooth(6.0 * np.minimum(u, 1.0 - u)))
    toe = toe + along[:, None] * (moment.xy + under - toe)
    yaw = stances.yaw[i] + np.where(planted, 0.0, _smooth(u) * (stances.yaw[j] - stances.yaw[i]))
    yaw, pivot = _pivoted(yaw, moment.hips)
    c, s = np.cos(yaw), np.sin(yaw)
    forward = np.stack([-s, c, np.zeros_like(c)], axis=-1)

    length = np.hypot(way[:, 0], way[:, 1])
    ahead = np.sum(way * forward[:, :2], axis=-1)
    rolled = _roll(build, stances.toe[i], yaw, pivot, moment)
    from_lift = ends.at_lift[i] * (1.0 - _smooth(u / 0.7))
    to_land = ends.at_land[j] * _smooth((u - 0.6) / 0.4)
    low = np.clip(1.0 - 2.0 * moment.drop / build.scale, 0.2, 1.0)
    kick = low * np.clip(0.45 * (ahead - 0.7), 0.0, 1.0) * _hump(u, 0.3)
    toes_up = np.clip(0.2 * ahead, 0.0, 0.25) * _hump(u, 0.8)
    high = _smooth((moment.air - 0.05) / 0.15)
    pointed = (0.4 * np.minimum(moment.air / 0.1, 1.0) + 0.5 * high) * np.sin(np.pi * u) ** 2
    pitch = np.where(planted, rolled, from_lift + to_land + kick - toes_up + pointed)

    clear = 0.03 + 0.03 * np.minimum(length, 1.0) + 0.09 * low * np.clip(ahead - 1.2, 0.0, 2.0)
    clear = build.scale * clear * _hump(u, 0.42) + moment.air * ~planted
    # High up, the legs hang.
    clear = clear - 0.04 * build.scale * high * _hump(u, 0.5)
    # Toes up, the heel is the lowest point of the sole; rounded, so that the ankle has no kink.
    heel = -(build.toe_ahead + HEEL_BEHIND_ANKLE_M * build.scale) * np.sin(pitch)
    round_off = 0.08 * u * (1.0 - u)
    lowest = np.where(planted, 0.0, 0.5 * (heel + np.sqrt(heel**2 + round_off**2)))
    toe_height = SOLE_BELOW_TOE_M * build.scale + clear + lowest

    inwards = build.toe_inwards[foot]
    level = build.toe_ahead * np.cos(pitch) - build.toe_below * np.sin(pitch)
    ankle = np.empty((len(times), 3))
    ankle[:, 0] = toe[:, 0] + s * level + c * inwards
    ankle[:, 1] = toe[:, 1] - c * level + s * inwards
    ankle[:, 2] = toe_height + build.toe_below * np.cos(pitch) + build.toe_ahead * np.sin(pitch)
    return FootPose(
        planted=planted,
        ankle=ankle,
        forward=forward,
        R_world_from_foot=rotations.facing(yaw) @ rotations.about(0, pitch),
        pitch=pitch,
        away=_smooth(4.0 * np.minimum(u, 1.0 - u)),
        toe_bend=1.0 - 0.7 * np.sin(np.pi * u) ** 2,
    )


def _roll(build: Build, toe: np.ndarray, yaw: np.ndarray, pivot: np.ndarray, moment: "Moments") -> np.ndarray:
    """How far the heel of a planted foot is up, radians, by how far the pelvis has gone past it."""
    dx, dy = (moment.xy - toe).T
    c, s = np.cos(yaw), np.sin(yaw)
    ahead = -s * dx + c * dy + build.toe_ahead
    across = np.abs(-c * dx - s * dy)
    past = ahead + 0.5 * np.maximum(across - 0.35 * build.scale, 0.0)
    pitch = _HIGHEST_PITCH * _smooth((past / build.scale - 0.08) / 0.5)
    # A deep crouch, unless in a lunge onto this foot, or a pivot takes the heel off the ground, too.
    crouch = 1.2 * np.maximum(moment.drop - 0.18, 0.0) * _smooth((past / build.scale + 0.3) / 0.3)
    # Toes leave the ground last and land first; and who makes himself taller than standing is on them.
    tiptoe = 1.0 - (1.0 - moment.push) * (1.0 - _smooth(-moment.drop / (0.09 * build.scale)))
    pitch = pitch + crouch + 0.3 * np.abs(pivot) + 0.7 * tiptoe
    return _HIGHEST_PITCH * np.tanh(pitch / _HIGHEST_PITCH)


def _pivoted(yaw: np.ndarray, hips: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The foot's yaw and how far it had to pivot on its ball because the hips turned."""
    off = yaw - hips
    beyond = np.maximum(np.abs(off) - _PIVOT_FROM, 0.0)
    held = np.sign(off) * (np.minimum(np.abs(off), _PIVOT_FROM) + _PIVOT_ROOM * np.tanh(beyond / _PIVOT_ROOM))
    return hips + held, off - held


def _smooth(u: np.ndarray) -> np.ndarray:
    """From 0 to 1 without a kink."""
    u = np.clip(u, 0.0, 1.0)
    return u * u * (3.0 - 2.0 * u)


def _hump(u: np.ndarray, peak: float) -> np.ndarray:
    """From 0 up to 1 at the peak and back, level at its ends."""
    return np.sin(np.pi * np.clip(u, 0.0, 1.0) ** (np.log(0.5) / np.log(peak))) ** 2


def _ramp_up_and_down(u: np.ndarray) -> np.ndarray:
    """Share of the way of a swing: speeds up over its first quarter, slows down over its last, even between."""
    a = 0.25
    u = np.clip(u, 0.0, 1.0)
    late = u > 0.5
    v = np.where(late, 1.0 - u, u)
    # Integral of a speed that rises as sin^2 over [0, a].
    rising = 0.5 * v - a / (2.0 * np.pi) * np.sin(np.pi * v / a)
    share = np.where(v < a, rising, 0.5 * a + (v - a)) / (1.0 - a)
    return np.where(late, 1.0 - share, share)
