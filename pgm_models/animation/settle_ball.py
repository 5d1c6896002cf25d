"""A generated ball put on the nearest plausible path: exact flights that meet where ground, players or net are.

A model that fills in states frame by frame leaves errors in each: places that no ball flies through, velocities that do
not fit them. The frames are split into flights (`settle_breaks`), fitted together (`settle_flights`), and read off.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Shaped

from pgm_data.caption.court_areas import looks
from pgm_data.lift.ball.world import BallWorld, ball_world
from pgm_data.scene import Scene
from pgm_models.animation.settle_breaks import (
    Costs,
    Flights,
    States,
    find_flights,
    flight_of,
    flown,
    ground_of,
    touches_net,
)
from pgm_models.animation.settle_flights import Air, Joined, Reach, joined_flights, rejoined_flights, states_at
from pgm_models.animation.settle_reach import reached

LASTING_S = 0.15
"""How long errors may last that neighbouring frames share, s."""
MOST_ERRORS = 4.0
"""A miss of so many of a path's errors is none of them."""
SPEED_M_S = 25.0
"""Speed at which the size of a flight's turn is reckoned, m/s."""


@dataclass(frozen=True, kw_only=True)
class SettleBallOptions:
    """What a plausible path is, and how it is found.

    Costs are in squared errors of the size of the path's own; a state that fits costs about six.

    Raises:
        ValueError: If a number is out of range.
    """

    reach_m: float = 2.5
    """Of a player's root: how far off it hits the ball, metres."""
    stroke_m: float = 1.2
    """Level distance from a player's root within which it strikes a ball that it sends back, metres."""
    stroke_farthest_m: float = 2.2
    """Strokes that stay farther off than this wherever in time they are put are left where they are, metres."""
    contact_cost: float = 25.0
    """Of a contact near ground, net or a player."""
    free_cost: float = 150.0
    """Of a change of velocity elsewhere."""
    skipped_cost: float = 20.0
    """Of a frame that a model has blurred with a contact, beside it."""
    skipped_s: float = 0.09
    """Longest time between two frames with such frames between them, s, less a frame."""
    rolling_cost: float = 25.0
    """Of rolling or lying on the ground."""
    held_cost: float = 6.0
    """Of each frame in which a player holds the ball."""
    held_m_s: float = 6.0
    """Fastest that a held ball is, m/s."""
    longest_s: float = 4.0
    """Longest flight, s."""
    least_error_m: float = 0.02
    """The path's errors are taken as at least that, metres."""
    least_error_m_s: float = 0.2
    """The same of velocities, m/s."""
    spin: float = 1.0
    """How much of the scene's spin flights may have; 0 for none."""
    miss_m: float = 0.5
    """Flights that miss each other by more than this (or four errors) do not meet in one contact, metres."""
    known_m: float = 0.1
    """Farthest that a flight may pass from a known place, metres."""
    known_m_s: float = 1.5
    """Farthest that its velocity may be from a known one, m/s."""
    moved_m: float = 3.0
    """A flight that is farther than this (or four errors) from most of its frames fits none of them, metres."""
    rounds: int = 3
    """How often flights are looked for, each time with the errors of the last."""
    steps: int = 6
    """How often flights are fitted together."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name in self.__dataclass_fields__:
            least = 1 if name in {"rounds", "steps"} else 0
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) >= least):
                raise ValueError(f"SettleBallOptions.{name}: expected at least {least}, got {getattr(self, name)}")


@dataclass(frozen=True, eq=False, kw_only=True)
class BallPath:
    """A ball's states as they were made; world, metres, z up.

    Raises:
        ValueError: If a state is not finite or times do not ascend.
    """

    position: Float[np.ndarray, "T 3"]
    """Metres."""
    velocity: Float[np.ndarray, "T 3"]
    """m/s; after the contact, at a contact."""
    known_position: Bool[np.ndarray, " T"]
    """Whether it was given, and not made."""
    known_velocity: Bool[np.ndarray, " T"]
    times: Float[np.ndarray, " T"]
    """Seconds, ascending."""
    roots: Float[np.ndarray, "T players 3"]
    """Of the players, metres; not finite where there is none."""

    def __post_init__(self) -> None:
        """Check that all is finite and in order."""
        if not len(self.times):
            raise ValueError("times: expected at least one frame, got none")
        for name in ("position", "velocity", "times"):
            bad = np.flatnonzero(~np.isfinite(getattr(self, name).reshape(len(self.times), -1)).all(axis=1))
            if len(bad):
                raise ValueError(f"{name}: expected finite numbers, got NaN or infinity in frame {bad[0]}")
        if not (np.diff(self.times) > 0).all():
            raise ValueError("times: expected ascending ones, got two that do not")


@dataclass(frozen=True, eq=False, kw_only=True)
class SettledBall:
    """The same ball on a plausible path; a row a frame, and a row a contact."""

    position: Float[np.ndarray, "T 3"]
    """Metres."""
    velocity: Float[np.ndarray, "T 3"]
    """m/s."""
    moved_m: Float[np.ndarray, " T"]
    """How far each place was moved, metres."""
    status: Shaped[np.ndarray, " T"]
    """`flight`, `ground` (lies or rolls), `held` (by a player: as it was made), or `left` (as it was made, since no
    flight fits)."""
    contact_time: Float[np.ndarray, " contacts"]
    """Seconds, ascending."""
    contact_kind: Shaped[np.ndarray, " contacts"]
    """`bounce`, `hit`, `net`, `ground` (it comes to lie, or leaves), `free` (nothing is near), `held` (a player takes
    it, or lets it go), or `unseen` (more than one contact between two frames: the flights beside it do not meet)."""
    contact_position: Float[np.ndarray, "contacts 3"]
    """Metres."""


def settled_ball(ball: BallPath, scene: Scene, options: SettleBallOptions | None = None) -> SettledBall:
    """The plausible path nearest to a ball's states: flights under gravity, drag and spin between contacts.

    Known values come back to the bit, and flights pass within a millimetre of those next to made ones. Flights end at
    bounces, hits and the net; elsewhere only where nothing else explains the states. Frames are never below the ground,
    a bounce gives back what the scene's restitution lets it (to two deviations). Between few frames, as at 4 Hz, there
    may be several contacts: then the flights on both sides are each their own, and the contact is `unseen`; a flight of
    one frame is that frame's own state. Strokes that turn the ball out of everybody's reach are put where the player
    who sends it back reaches it, if the flight that comes goes there (`settle_reach`).

    Args:
        ball: What was made.
        scene: With its ball and court.
        options: What is plausible.

    Raises:
        ValueError: If the scene has no ball or no court.
    """
    options = options or SettleBallOptions()
    world = ball_world(scene)
    known = ball.known_position | ball.known_velocity
    roots = np.where(np.isfinite(ball.roots), ball.roots, np.inf)
    turn_std = _turn_std(world) * options.spin
    begun, now = _first_states(ball, world, options), (ball.position, ball.velocity)
    states = begun
    costs = _costs(ball, options)
    flights = None
    for _ in range(options.rounds):
        flights = find_flights(states, now, known, roots, world, costs, turn_std)
        now = flights.position, flights.velocity
        states = _measured(begun, flights, ball, options)
    assert flights is not None
    air = Air(world=world, turn_std=turn_std, miss_m=options.miss_m, miss_errors=MOST_ERRORS)
    tied = _tied(states, ball)
    found = joined_flights(tied, flights, known, air, options.steps)
    ends = looks(scene) if roots.shape[1] == len(scene.players) else np.zeros(roots.shape[1], dtype=np.int64)
    reach = Reach(roots=roots, looks=ends, level_m=options.stroke_m, farthest_m=options.stroke_farthest_m)
    put = reached(found, tied, known, reach, world)
    if put.stray.any():
        found = rejoined_flights(put.found, put.states, known, put.stray, air, reach, options.steps)
    return _read_off(found, ball, states, roots, world, options)


def _turn_std(world: BallWorld) -> float:
    """Size of a component of how spin turns a flight, rad/s."""
    spin = world.radius_m * world.spin_std
    return world.lift_per_m * spin * SPEED_M_S / (SPEED_M_S + 2 * spin)


def _step_of(times: np.ndarray) -> float:
    return float(np.median(np.diff(times))) if len(times) > 1 else 1.0


def _costs(ball: BallPath, options: SettleBallOptions) -> Costs:
    return Costs(
        contact=options.contact_cost,
        free=options.free_cost,
        skipped=options.skipped_cost,
        skipped_frames=int(options.skipped_s / _step_of(ball.times)),
        rolling=options.rolling_cost,
        held=options.held_cost,
        held_m_s=options.held_m_s,
        longest_s=options.longest_s,
        reach_m=options.reach_m,
    )


def _first_states(ball: BallPath, world: BallWorld, options: SettleBallOptions) -> States:
    """The path, with errors as neighbouring frames disagree."""
    h = np.diff(ball.times)
    made = ~(ball.known_position | ball.known_velocity)
    steps = made[1:] | made[:-1]
    error_m, error_m_s = np.full(3, options.least_error_m), np.full(3, options.least_error_m_s)
    if steps.any():
        drag = world.drag_per_m.mean
        p, v = flown(ball.position[:-1], ball.velocity[:-1], h / 2, drag)
        q, w = flown(ball.position[1:], ball.velocity[1:], -h / 2, drag)
        push = np.median(np.abs(v - w)[steps], axis=0) * 1.4826
        gap = np.median(np.abs(p - q)[steps], axis=0) * 1.4826
        error_m_s = np.maximum(error_m_s, push / np.sqrt(2))
        error_m = np.maximum(error_m, np.sqrt(np.maximum(gap**2 - (np.median(h) * push / 2) ** 2, 0.0) / 2))
    return _with_errors(ball, error_m, error_m_s, max(1.0, 0.08 / _step_of(ball.times)), options)


def _with_errors(
    ball: BallPath, error_m: np.ndarray, error_m_s: np.ndarray, alike: float, options: SettleBallOptions
) -> States:
    """Errors of each frame: known ones have the least."""
    return States(
        position=ball.position,
        velocity=ball.velocity,
        times=ball.times,
        error_m=np.where(ball.known_position[:, None], options.least_error_m, error_m),
        error_m_s=np.where(ball.known_velocity[:, None], options.least_error_m_s, error_m_s),
        alike=alike,
    )


def _measured(states: States, flights: Flights, ball: BallPath, options: SettleBallOptions) -> States:
    """The same path, with errors as its flights show them."""
    flight = flight_of(flights.first, flights.last, len(ball.times))
    counts = np.where(flights.held, 0, flights.last - flights.first + 1)
    there = (flight >= 0) & (counts[flight] >= 3)
    freedom = max(1.0 - 9.0 * float((counts >= 3).sum()) / max(6.0 * float(counts[counts >= 3].sum()), 1.0), 0.2)
    errors, ratios = [], []
    for given, fitted, known, before in (
        (ball.position, flights.position, ball.known_position, states.error_m),
        (ball.velocity, flights.velocity, ball.known_velocity, states.error_m_s),
    ):
        off = given - fitted
        made = there & ~known
        if made.sum() < 6:
            errors.append(before[~known].mean(axis=0) if (~known).any() else before.mean(axis=0))
            continue
        own = np.median(np.abs(off[made]), axis=0)
        size = 1.4826 * np.sqrt(0.5 * own**2 + 0.5 * np.mean(own**2)) / np.sqrt(freedom)
        # Neighbours tell errors that last; a flight that misses by more than those is a wrong one.
        size = np.minimum(size, before[~known].mean(axis=0) * (1.5 + LASTING_S / _step_of(ball.times)))
        errors.append(size)
        pairs = made[1:] & made[:-1] & (flight[1:] == flight[:-1])
        clipped = off.clip(-3 * size, 3 * size) / np.maximum(size, 1e-12)
        ratios.append(float((clipped[1:] * clipped[:-1])[pairs].sum() / max((clipped[1:][pairs] ** 2).sum(), 1e-12)))
    like = float(np.clip(np.mean(ratios), 0.0, 0.85)) if ratios else 0.0
    error_m, error_m_s = np.maximum(errors[0], options.least_error_m), np.maximum(errors[1], options.least_error_m_s)
    return _with_errors(ball, error_m, error_m_s, (1.0 + like) / (1.0 - like), options)


def _tied(states: States, ball: BallPath) -> States:
    """Known values beside made ones are met, so that the path goes on from them."""

    def beside(known: np.ndarray) -> np.ndarray:
        made = ~known
        near = np.zeros_like(known)
        near[1:] |= made[:-1]
        near[:-1] |= made[1:]
        return (near & known)[:, None]

    return replace(
        states,
        error_m=np.where(beside(ball.known_position), 1e-3, states.error_m),
        error_m_s=np.where(beside(ball.known_velocity), 1e-2, states.error_m_s),
    )


def _read_off(
    found: Joined, ball: BallPath, states: States, roots: np.ndarray, world: BallWorld, options: SettleBallOptions
) -> SettledBall:
    """Each frame from its flight, the frames of contacts from the flight that they are in by time."""
    times = ball.times
    begins = np.concatenate([[-np.inf], found.moment])
    flight = flight_of(found.first, found.last, len(times))
    flight = np.where(flight >= 0, flight, np.searchsorted(begins, times, side="right") - 1)
    p, v = states_at(found, flight, times - times[found.first[flight]], world)
    off_p, off_v = np.linalg.norm(p - ball.position, axis=1), np.linalg.norm(v - ball.velocity, axis=1)
    wrong = (ball.known_position & (off_p > options.known_m)) | (ball.known_velocity & (off_v > options.known_m_s))
    bad = np.zeros(len(found.first), dtype=bool)
    bad[flight[wrong]] = True
    far = off_p > np.maximum(options.moved_m, MOST_ERRORS * np.linalg.norm(states.error_m, axis=1))
    bad |= np.bincount(flight, weights=far, minlength=len(bad)) > 0.5 * np.bincount(flight, minlength=len(bad))
    left = bad[flight] | found.held[flight] | ~np.isfinite(p).all(axis=1) | ~np.isfinite(v).all(axis=1)
    p, v = np.where(left[:, None], ball.position, p), np.where(left[:, None], ball.velocity, v)
    p[:, 2] = np.maximum(p[:, 2], ground_of(p, world))
    position = np.where(ball.known_position[:, None], ball.position, p)
    velocity = np.where(ball.known_velocity[:, None], ball.velocity, v)
    status = np.select(
        [found.held[flight], left, found.rolls[flight]], ["held", "left", "ground"], default="flight"
    ).astype(object)
    kind, place = _contacts(found, times, roots, world, options)
    stays = ~(bad[:-1] & bad[1:])
    return SettledBall(
        position=position,
        velocity=velocity,
        moved_m=np.linalg.norm(position - ball.position, axis=1),
        status=status,
        contact_time=found.moment[stays],
        contact_kind=kind[stays],
        contact_position=place[stays],
    )


def _contacts(
    found: Joined, times: np.ndarray, roots: np.ndarray, world: BallWorld, options: SettleBallOptions
) -> tuple[np.ndarray, np.ndarray]:
    """Kind and place of each contact."""
    before = np.arange(len(found.moment))
    p, _ = states_at(found, before, found.moment - times[found.first[:-1]], world)
    q, _ = states_at(found, before + 1, found.moment - times[found.first[1:]], world)
    place = 0.5 * (p + q)
    near = np.zeros(len(before), dtype=bool)
    for frame in (found.last[:-1], found.first[1:]):
        near |= (np.linalg.norm(place[:, None] - roots[frame], axis=-1) < options.reach_m).any(axis=1)
    kind = np.select(
        [
            found.held[:-1] | found.held[1:],
            ~found.tied,
            found.rolls[:-1] | found.rolls[1:],
            found.bounce,
            near,
            touches_net(place, world, 0.3),
        ],
        ["held", "unseen", "ground", "bounce", "hit", "net"],
        default="free",
    ).astype(object)
    return kind, place
