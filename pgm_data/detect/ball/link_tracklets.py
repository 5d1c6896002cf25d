"""Tracklets: runs of candidates that move as a ball in one flight does, in the picture.

Over a short time the ball keeps its velocity but for an acceleration of known size. The best run that ends in each pair
of candidates follows from the best runs that end in its first one (dynamic programming over pairs); what a candidate
is worth is the logarithm of how much more probable the ball is there than something else.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from pgm_data.detect.ball.link_lattice import Lattice

SHORTEST = 2
"""Fewest candidates of a tracklet."""
KINK = 1 << 20
"""Added to where a run came from if its velocity changed there."""
NEIGHBOURS = 4
"""Candidates to each side that a local fit takes."""


@dataclass(frozen=True, kw_only=True)
class MotionModel:
    """How a ball moves in the picture. Lengths as shares of the picture's height."""

    acceleration: float = 1.5
    """Standard deviation of each coordinate's acceleration, heights/s^2."""
    usual_speed: float = 0.6
    """Half of all balls are slower, heights/s, about."""
    top_speed: float = 6.0
    """None is faster, heights/s."""
    lags: int = 3
    """Most steps between distinct pictures from one candidate of a tracklet to the next."""
    lag_s: float = 0.25
    """Longest time between them, s, unless they are of neighbouring pictures."""
    gate: float = 4.0
    """Furthest that a candidate may lie from where it is expected, standard deviations."""
    miss: float = 0.3
    """Price of a picture passed over, to which comes the log odds' share of its candidates all being something else."""
    kink: float = 3.0
    """Price of a change of velocity at a contact."""
    score_share: float = 0.6
    """Share of the score's log odds that counts: scores of neighbouring pictures err together."""
    least_worth: float = 1.0
    """A tracklet worth less is dropped."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Tracklets:
    """Runs of candidates one after the other in flat arrays; no candidate is in two."""

    first: Int[np.ndarray, " tracklets"]
    """Where each begins in the flat arrays."""
    count: Int[np.ndarray, " tracklets"]
    worth: Float[np.ndarray, " tracklets"]
    """Log likelihood ratio of a ball to something else, the first pair included."""
    picture: Int[np.ndarray, " nodes"]
    slot: Int[np.ndarray, " nodes"]

    @property
    def owner(self) -> Int[np.ndarray, " nodes"]:
        """Tracklet of each candidate."""
        return np.repeat(np.arange(len(self.count)), self.count)


def tracklets_of(lattice: Lattice, height: float, model: MotionModel) -> Tracklets:
    """The tracklets of a clip, found best first, none using a candidate of a better one."""
    pictures, slots = lattice.has.shape
    lags = max(1, min(model.lags, pictures - 1))
    value = np.full((pictures, lags, slots, slots), -np.inf)
    came = np.full((pictures, lags, slots, slots), -1, dtype=np.int32)
    if pictures > 1 and slots:
        # That no candidate is the ball is the less probable, the better the best one is.
        unlikely = np.logaddexp(0, np.where(lattice.has, lattice.log_odds, -np.inf)).max(axis=1)
        passed = np.cumsum(model.miss + model.score_share * np.minimum(unlikely, 5.0))
        for at in range(1, pictures):
            _extend(lattice, at, value, came, passed, height, model)
    return _runs(lattice, value, came, model)


def _extend(
    lattice: Lattice,
    at: int,
    value: np.ndarray,
    came: np.ndarray,
    passed: np.ndarray,
    height: float,
    model: MotionModel,
) -> None:
    """Fill in the best runs whose last pair ends in that picture: value[at, lag - 1, slot before, slot]."""
    lags = value.shape[1]
    slots = lattice.has.shape[1]
    lag = np.arange(1, min(lags, at) + 1)
    before = at - lag
    step = lattice.times[at] - lattice.times[before]
    near = (step > 0) & ((step <= model.lag_s) | (lag == 1))
    lag, before, step = lag[near], before[near], step[near]
    if not len(lag):
        return
    moved = lattice.points[at][None, None] - lattice.points[before][:, :, None]
    distance = np.hypot(moved[..., 0], moved[..., 1])
    pair = (
        lattice.has[before][:, :, None] & lattice.has[at] & (distance <= model.top_speed * height * step[:, None, None])
    )
    if not pair.any():
        return
    node = model.score_share * lattice.log_odds[at] - lattice.log_clutter[at]
    node = node - _streak_price(lattice, at, moved, distance, step) - passed[at - 1] + passed[before][:, None, None]
    reach = model.usual_speed * height * step[:, None, None]
    anyhow = node + np.log(reach / (2 * np.pi)) - 1.5 * np.log(reach**2 + distance**2)
    # Begun here, or after a contact at the candidate before.
    begun = model.score_share * lattice.log_odds[before]
    before_kink = value[before].transpose(0, 3, 1, 2).reshape(len(lag), slots, -1)
    origin = before_kink.argmax(axis=2)
    kinked = np.take_along_axis(before_kink, origin[..., None], axis=2)[..., 0] - model.kink
    turned = kinked > begun
    best = np.where(turned, kinked, begun)[:, :, None] + anyhow
    source = np.broadcast_to(np.where(turned, origin + KINK, -1)[:, :, None], best.shape)

    lag2 = np.arange(1, lags + 1)
    earlier = before[:, None] - lag2
    known = earlier >= 0
    earlier = np.maximum(earlier, 0)
    step2 = lattice.times[before][:, None] - lattice.times[earlier]
    known &= step2 > 0
    ratio = (step[:, None] / np.where(known, step2, 1.0))[..., None, None]
    moved2 = lattice.points[before][:, None, None] - lattice.points[earlier][:, :, :, None]
    spread = (model.acceleration * height * step[:, None] * (step[:, None] + step2) / 2) ** 2
    spread = spread[..., None, None] + lattice.variance[before][:, None, None] * (1 + ratio) ** 2
    spread = spread + lattice.variance[earlier][:, :, :, None] * ratio**2
    spread = spread[..., None] + lattice.variance[at]
    miss_x = moved[:, None, None, :, :, 0] - (ratio * moved2[..., 0])[..., None]
    miss_y = moved[:, None, None, :, :, 1] - (ratio * moved2[..., 1])[..., None]
    chi2 = (miss_x**2 + miss_y**2) / spread
    so_far = np.where(known[..., None, None], value[before], -np.inf)
    gain = so_far[..., None] - chi2 / 2 - np.log(2 * np.pi * spread)
    gain = np.where(chi2 <= model.gate**2, gain, -np.inf).reshape(len(lag), -1, slots, slots)
    source2 = gain.argmax(axis=1)
    longer = np.take_along_axis(gain, source2[:, None], axis=1)[:, 0] + node
    better = longer > best
    value[at, lag - 1] = np.where(pair, np.where(better, longer, best), -np.inf)
    came[at, lag - 1] = np.where(pair & better, source2, source)


def _streak_price(
    lattice: Lattice, at: int, moved: np.ndarray, distance: np.ndarray, step: np.ndarray
) -> Float[np.ndarray, "lags slots slots"]:
    """What it costs that a candidate's streak does not lie along the motion, or is longer than it in one frame."""
    streak = lattice.streaks[at]
    length = np.hypot(streak[:, 0], streak[:, 1])
    safe = np.maximum(distance, 1e-9)
    across = np.abs(streak[:, 0] * moved[..., 1] - streak[:, 1] * moved[..., 0]) / safe
    sure = distance**2 / (distance**2 + 9 * lattice.variance[at] + 9.0)
    most = safe * np.minimum(lattice.frame_s / step[:, None, None], 1.0)
    excess = np.maximum(length - 1.2 * most - 4.0, 0.0)
    off = (across**2 * sure + excess**2) / (2.0 + 0.2 * length) ** 2
    return np.minimum(off / 2, 4.0)


def _runs(lattice: Lattice, value: np.ndarray, came: np.ndarray, model: MotionModel) -> Tracklets:
    """Runs read backwards from their ends, the best end first, each up to a candidate that is already used."""
    pictures, lags, slots, _ = value.shape
    ends = value.transpose(0, 3, 1, 2).reshape(pictures * slots, lags * slots) if slots else np.zeros((0, 1))
    best = ends.argmax(axis=1) if len(ends) else np.zeros(0, dtype=np.int64)
    worth = ends[np.arange(len(ends)), best]
    used = np.zeros((pictures, slots), dtype=bool)
    picture: list[int] = []
    slot: list[int] = []
    gained: list[float] = []
    flight: list[int] = []
    flights = 0
    order = np.argsort(-worth, kind="stable")
    for end in order[worth[order] >= model.least_worth].tolist():
        at, j = divmod(end, slots)
        if used[at, j]:
            continue
        lag, i = divmod(int(best[end]), slots)
        run, so_far, number = [(at, j)], [float(worth[end])], [0]
        while True:
            at, j = at - lag - 1, i
            if used[at, j]:  # What lies before belongs to a better run.
                break
            source = int(came[run[-1][0], lag, j, run[-1][1]])
            run.append((at, j))
            number.append(number[-1] + (source >= KINK))  # A kink's own candidate ends the flight before it.
            if source < 0:
                so_far.append(0.0)
                break
            lag, i = divmod(source % KINK, slots)
            so_far.append(float(value[at, lag, i, j]))
        rest = so_far[-1]
        if len(run) < SHORTEST or so_far[0] - rest < model.least_worth:
            continue
        used[tuple(np.array(run).T)] = True
        picture += [node[0] for node in reversed(run)]
        slot += [node[1] for node in reversed(run)]
        gained += np.diff(so_far[::-1], prepend=rest).tolist()
        flight += [flights + number[-1] - n for n in reversed(number)]
        flights += number[-1] + 1
    return _flights(
        np.array(picture, dtype=np.int64),
        np.array(slot, dtype=np.int64),
        np.array(flight, dtype=np.int64),
        np.array(gained, dtype=np.float64),
    )


def _flights(picture: np.ndarray, slot: np.ndarray, flight: np.ndarray, gained: np.ndarray) -> Tracklets:
    """The runs cut into their flights; those too short to be judged go."""
    long = np.bincount(flight)[flight] >= SHORTEST if len(flight) else np.zeros(0, dtype=bool)
    _, flight, count = np.unique(flight[long], return_inverse=True, return_counts=True)
    return Tracklets(
        first=np.cumsum(count) - count,
        count=count,
        worth=np.bincount(flight, gained[long], len(count)).astype(np.float64),
        picture=picture[long],
        slot=slot[long],
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class LocalFit:
    """Where neighbours in its tracklet put each candidate: a parabola in time through them."""

    place: Float[np.ndarray, "nodes 2"]
    velocity: Float[np.ndarray, "nodes 2"]
    """Px/s."""
    variance: Float[np.ndarray, " nodes"]
    """Of each coordinate of the place, px^2."""
    velocity_variance: Float[np.ndarray, " nodes"]


def local_fit(
    lattice: Lattice, tracklets: Tracklets, height: float, model: MotionModel, *, with_itself: bool
) -> LocalFit:
    """The fit at each candidate, by up to `NEIGHBOURS` to each side and, if asked, by the candidate itself."""
    owner = tracklets.owner
    nodes = len(owner)
    beside = np.arange(-NEIGHBOURS, NEIGHBOURS + 1)
    index = np.arange(nodes)[:, None] + beside
    inside = (index >= 0) & (index < nodes)
    index = np.clip(index, 0, max(nodes - 1, 0))
    inside &= owner[index] == owner[:, None]
    if not with_itself:
        inside[:, NEIGHBOURS] = False
    times = lattice.times[tracklets.picture]
    points = lattice.points[tracklets.picture, tracklets.slot]
    variance = lattice.variance[tracklets.picture, tracklets.slot]
    fit = parabolas(
        times[index] - times[:, None],
        points[index] - points[:, None],
        np.where(inside, 1 / variance[index], 0.0),
        unit=lattice.frame_s,
        height=height,
        model=model,
    )
    return LocalFit(
        place=points + fit.place, velocity=fit.velocity, variance=fit.variance, velocity_variance=fit.velocity_variance
    )


def parabolas(
    after: Float[np.ndarray, "nodes beside"],
    places: Float[np.ndarray, "nodes beside 2"],
    weight: Float[np.ndarray, "nodes beside"],
    *,
    unit: float,
    height: float,
    model: MotionModel,
) -> LocalFit:
    """Place and velocity at time 0 of parabolas through places, their acceleration held small by the motion's prior.

    Args:
        after: Times, s.
        places: Px.
        weight: Inverse variance of each, 0 for none.
        unit: Time in which the equations are solved, s.
        height: Of the picture, px.
        model: How the ball moves.
    """
    scaled = after / unit
    design = np.stack([np.ones_like(scaled), scaled, scaled**2 / 2], axis=-1)
    prior = np.diag([1e-8, (model.top_speed * height * unit) ** -2, (2 * model.acceleration * height * unit**2) ** -2])
    weighted = (weight[..., None] * design).swapaxes(1, 2)
    cov = np.linalg.inv(weighted @ design + prior)
    state = cov @ (weighted @ places)
    return LocalFit(
        place=state[:, 0],
        velocity=state[:, 1] / unit,
        variance=cov[:, 0, 0],
        velocity_variance=cov[:, 1, 1] / unit**2,
    )
