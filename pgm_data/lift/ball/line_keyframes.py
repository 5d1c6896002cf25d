"""Keyframes: the contacts of a play, and where they are before any flight is looked at."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_data.ball import BallEvents
from pgm_data.lift.ball.line_sight import Sights
from pgm_data.lift.ball.solution import PlayersAt
from pgm_data.lift.ball.world import HIT_HEIGHT, BallWorld

GROUND_STD_M = 0.003
"""Of the ball's height at a bounce."""
NET_STD_M = 0.06
MARKED_HEIGHT_STD_M = 1.5
"""Of the height of a ball whose place on the ground is marked."""
OVERHEAD = (1.55, 0.14)
"""Height of the ball at a serve or smash over a person's height, and its standard deviation."""
REACH = 0.4
"""From a wrist to the ball over a person's height: standard deviation along each axis."""
STEP_ASIDE_M = 0.9
"""From a player's root to the ball along the ground: standard deviation along each axis."""
HIGHEST_M = 15.0
"""Balls of which nothing is known are looked for below that."""
OUTSIDE_M = 1.0
"""So far beyond the ground's edge a bounce still counts as lying on it."""
LONGEST_TOSS_S = 2.0
TOGETHER_S = 0.021
"""`first` or `last` no farther than this from a contact is that contact."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Keyframes:
    """Contacts in order of time; arrays of one length."""

    event: Int[np.ndarray, " contacts"]
    """Row of the events."""
    place: Float[np.ndarray, "contacts 3"]
    """First guess, world, m; NaN where there is none."""
    mean: Float[np.ndarray, "contacts 3"]
    """Of the prior of each coordinate."""
    std: Float[np.ndarray, "contacts 3"]
    """inf where there is no prior."""
    tosses: Int[np.ndarray, " tosses"]
    """Contacts that start a server's toss."""
    said: tuple[str, ...]
    """Why there is no place; empty where there is one."""

    @property
    def placed(self) -> Bool[np.ndarray, " contacts"]:
        """Where there is a first guess."""
        return np.asarray(np.isfinite(self.place).all(axis=1))

    def served(self, k: int, sights: Sights, toss: bool, world: BallWorld) -> "Keyframes":
        """The same with the hit in that place a serve: overhead where only its usual height was known, and the flight
        up to it a toss if it is told so.
        """
        place, mean, std = self.place.copy(), self.mean.copy(), self.std.copy()
        tall = person_height(world)
        if mean[k, 2] == world.hit_height.mean and std[k, 2] == world.hit_height.std:
            mean[k, 2], std[k, 2] = world.floor_z + OVERHEAD[0] * tall, OVERHEAD[1] * tall
            place[k] = _within_reach(sights.take(np.array([k])), float(mean[k, 2]), world)
        if toss:
            place[k - 1] = place[k] - _off(sights.take(np.array([k - 1])), place[k][None])[0]
        return replace(self, place=place, mean=mean, std=std, tosses=np.array([k - 1] if toss else [], dtype=np.int64))


def plays_of(events: BallEvents) -> list[Int[np.ndarray, " contacts"]]:
    """Rows of the contacts of each play, in order of time.

    `first` begins a play and `last` ends it; where a hit, bounce or net contact stands at that time, that is the
    contact.
    """
    bounds = np.isin(events.kinds, ("first", "last"))
    solid = np.flatnonzero(~bounds)
    begins, ends, contacts = set(), set(), set(solid.tolist())
    for row in np.flatnonzero(bounds):
        gaps = np.abs(events.times[solid] - events.times[row])
        stands = len(gaps) > 0 and gaps.min() < TOGETHER_S
        contact = int(solid[np.argmin(gaps)]) if stands else int(row)
        contacts.add(contact)
        (begins if events.kinds[row] == "first" else ends).add(contact)
    plays: list[list[int]] = [[]]
    for row in sorted(contacts):
        if row in begins:
            plays.append([])
        plays[-1].append(row)
        if row in ends:
            plays.append([])
    return [np.array(play) for play in plays if play]


def marks_of(events: BallEvents, contacts: Int[np.ndarray, " contacts"]) -> Float[np.ndarray, "contacts 2"]:
    """Ground marks of contacts, those of a `first` or `last` that stands there where they have none of their own."""
    marks = events.ground_px[contacts].copy()
    known = np.flatnonzero(np.isfinite(events.ground_px).all(axis=1) & np.isin(events.kinds, ("first", "last")))
    for k in np.flatnonzero(~np.isfinite(marks).all(axis=1)) if len(known) else []:
        gaps = np.abs(events.times[known] - events.times[contacts[k]])
        if gaps.min() < TOGETHER_S:
            marks[k] = events.ground_px[known[np.argmin(gaps)]]
    return marks


def person_height(world: BallWorld) -> float:
    """Height of a person in that scene, m."""
    return world.hit_height.std / HIT_HEIGHT.std


def first_guesses(
    kinds: list[str],
    rows: Int[np.ndarray, " contacts"],
    sights: Sights,
    marks: Sights,
    world: BallWorld,
    hands: list[Float[np.ndarray, "near 3"]],
    roots: list[Float[np.ndarray, "near 3"]],
) -> Keyframes:
    """Where contacts are by their own ray, ground mark or player, each with its prior.

    `hands` and `roots`: world positions of wrists and roots of those who may have hit, at each contact.
    """
    count = len(rows)
    height = world.hit_height
    reach = np.maximum(np.array(world.reach_half_size), world.ground_half_size)
    mean = np.tile([0.0, 0.0, height.mean], (count, 1))
    std = np.tile([*reach, np.inf], (count, 1))
    place = np.full((count, 3), np.nan)
    said = [""] * count
    ground = marks.at_height(0.0)
    top = float(world.net_xz[:, 1].max()) if len(world.net_xz) else 0.0
    for k, kind in enumerate(kinds):
        sight = sights.take(np.array([k]))
        seen = bool(sight.known[0])
        if kind == "bounce":
            mean[k, 2], std[k, 2] = world.radius_m, GROUND_STD_M
            place[k] = sight.at_height(world.radius_m)[0]
            if not np.isfinite(place[k]).all():
                said[k] = "the ray of a bounce does not meet the ground" if seen else "no pixel near a bounce"
            elif (np.abs(place[k, :2]) > np.array(world.ground_half_size) + OUTSIDE_M).any():
                said[k] = f"a bounce lies outside of the ground, at ({place[k, 0]:.1f}, {place[k, 1]:.1f}) m"
                place[k] = np.nan
        elif kind == "net":
            mean[k, 1:], std[k, 1:] = [0.0, 0.5 * top], [NET_STD_M, 0.6 * max(top, 0.1)]
            place[k] = sight.at_net()[0]
            if not np.isfinite(place[k]).all():
                said[k] = "no ray through the net's plane at a net contact"
        elif np.isfinite(ground[k]).all():
            std[k, 2] = MARKED_HEIGHT_STD_M
            tall = _above(sight, ground[k]) if seen else height.mean
            place[k] = [*ground[k, :2], np.clip(tall, min(world.floor_z, 0.0), HIGHEST_M)]
        elif not seen:
            said[k] = f"no pixel near a {kind}"
        elif kind == "hit":
            std[k, 2] = height.std
            place[k] = _within_reach(sight, height.mean, world)
            if len(hands[k]):
                near = hands[k][np.argmin(np.linalg.norm(_off(sight, hands[k]), axis=1))]
                mean[k], std[k] = near, REACH * person_height(world)
                place[k] = near - _off(sight, near[None])[0]
            elif len(roots[k]):
                root = roots[k][np.argmin(np.linalg.norm(_off(sight, roots[k]), axis=1))]
                mean[k, :2], std[k, :2] = root[:2], STEP_ASIDE_M
                place[k] = root - _off(sight, root[None])[0]
        else:
            std[k, 2] = 2 * person_height(world)
            place[k] = _within_reach(sight, height.mean, world)
        if not said[k] and not np.isfinite(place[k]).all():
            said[k] = f"the ray of a {kind} leads nowhere near the ground"
    none = np.zeros(0, dtype=np.int64)
    return Keyframes(event=rows, place=place, mean=mean, std=std, tosses=none, said=tuple(said))


def hitters(
    players: PlayersAt | None, frames: Int[np.ndarray, " contacts"], names: list[str]
) -> tuple[list[Float[np.ndarray, "near 3"]], list[Float[np.ndarray, "near 3"]]]:
    """Wrists and roots at each contact: of the player named, or of all; empty where none are known."""
    if players is None:
        nobody = [np.zeros((0, 3)) for _ in frames]
        return nobody, list(nobody)
    hands, roots = [], []
    for frame, name in zip(frames, names, strict=True):
        who = [players.names.index(name)] if name in players.names else list(range(len(players.names)))
        hands.append(_finite(players.hands[frame, who].reshape(-1, 3)))
        roots.append(_finite(players.root_position[frame, who].reshape(-1, 3)))
    return hands, roots


def _finite(points: np.ndarray) -> np.ndarray:
    return points[np.isfinite(points).all(axis=1)]


def _off(sight: Sights, points: np.ndarray) -> np.ndarray:
    """From the ray's nearest point to each point."""
    offset = points - sight.origin
    return offset - np.maximum(offset @ sight.direction[0], 0.0)[:, None] * sight.direction


def _above(sight: Sights, ground: np.ndarray) -> float:
    """Height at which the ray comes nearest to the vertical line over a place."""
    offset, flat = ground[:2] - sight.origin[0, :2], sight.direction[0, :2]
    size = float(flat @ flat)
    along = max(float(offset @ flat) / size, 0.0) if size > 1e-12 else 0.0
    return float(sight.origin[0, 2] + along * sight.direction[0, 2])


def _within_reach(sight: Sights, height: float, world: BallWorld) -> np.ndarray:
    """The ray's point nearest to that height among those where players reach and balls fly; NaN where it has none."""
    origin, direction = sight.origin[0], sight.direction[0]
    reach = np.maximum(np.array(world.reach_half_size), world.ground_half_size)
    low = np.array([*-reach, min(world.floor_z, 0.0)])
    high = np.array([*reach, HIGHEST_M])
    with np.errstate(all="ignore"):
        one, two = (low - origin) / direction, (high - origin) / direction
        enter = float(np.nanmax(np.append(np.fmin(one, two), 0.0)))
        leave = float(np.nanmin(np.append(np.fmax(one, two), np.inf)))
        wanted = float((height - origin[2]) / direction[2])
    if not (np.isfinite(direction).all() and enter < leave and np.isfinite(leave)):
        return np.full(3, np.nan)
    wanted = wanted if np.isfinite(wanted) else 0.5 * (enter + leave)
    # A level ray above that height comes no nearer to it: the middle of what is left.
    wanted = wanted if wanted > 0 else 0.5 * (enter + leave)
    return origin + float(np.clip(wanted, enter, leave)) * direction
