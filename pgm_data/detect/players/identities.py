"""Who is who in a match: the two players of each run of pictures are two persons, and the persons change ends.

Vocabulary: a RUN is what lies between two cuts of one clip, or a whole clip; nobody changes ends within one. Its
DIFFERENCE is what the near player's look has more than the far one's: a light that falls on both cancels. Runs in which
the persons stand the other way round have the opposite difference, but for what the ends themselves add: a back looks
unlike a front.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from pgm_data.detect.players.looks import NUMBERS
from pgm_data.people import PlayerLooks

PERSONS = "ab"


@dataclass(frozen=True, kw_only=True)
class IdentityOptions:
    """What is taken for the same look, and how sure one must be.

    Raises:
        ValueError: If a value is out of its range.
    """

    light_scatter: float = 7.0
    """Standard deviation from run to run of a part's lightness, L* units."""
    colour_scatter: float = 4.0
    """The same of its a* and b*."""
    end_effect: float = 1.0
    """What the ends add to a difference, in standard deviations of a difference."""
    independent: float = 5.0
    """The numbers of a descriptor hang together: all count as so many."""
    least_apart: float = 4.0
    """How many standard deviations apart the two ways round must be; players who look more alike are nobody's."""
    change_chance: float = 0.15
    """Probability that the players change ends between two runs."""
    least_confidence: float = 0.9
    """Nobody is named in runs that are less sure."""

    def __post_init__(self) -> None:
        """Check the values."""
        for name, good, expected in (
            ("light_scatter", self.light_scatter > 0, "above 0"),
            ("colour_scatter", self.colour_scatter > 0, "above 0"),
            ("end_effect", self.end_effect >= 0, "at least 0"),
            ("independent", self.independent > 0, "above 0"),
            ("least_apart", self.least_apart > 0, "above 0"),
            ("change_chance", 0 < self.change_chance <= 0.5, "above 0 to 0.5"),
            ("least_confidence", 0.5 <= self.least_confidence <= 1, "0.5 to 1"),
        ):
            if not good:
                raise ValueError(f"identity options: {name}: expected {expected}, got {getattr(self, name)}")


@dataclass(frozen=True, eq=False, kw_only=True)
class ClipLooks:
    """What the players of one clip look like.

    Raises:
        ValueError: If there are not as many cuts as frames.
    """

    clip_id: str
    looks: PlayerLooks
    cut: Bool[np.ndarray, " frames"]
    """Whether each frame is the first after a cut inside the clip."""

    def __post_init__(self) -> None:
        """Check the shapes."""
        if len(self.cut) != len(self.looks.descriptors):
            raise ValueError(f"{self.clip_id}: cut: expected {len(self.looks.descriptors)} frames, got {len(self.cut)}")


@dataclass(frozen=True, eq=False, kw_only=True)
class ClipIdentities:
    """Who the players of one clip are."""

    clip_id: str
    identity: Shaped[np.ndarray, "frames players"]
    """`<match>.a` or `<match>.b`, empty where unknown."""
    confidence: Float[np.ndarray, "frames players"]
    """Probability that it is this person and not the other; 0.5 where nothing is known."""


def match_identities(
    clips: Sequence[ClipLooks], match_id: str, *, options: IdentityOptions | None = None
) -> tuple[ClipIdentities, ...]:
    """Who is who in the clips of one match, in their order; nobody where two players look too much alike.

    Person a is the near player of the first run that is known. A scene with one player has one person.

    Raises:
        ValueError: If the clips have different players, or more than two.
    """
    options = options or IdentityOptions()
    names = {clip.looks.names for clip in clips}
    if len(names) > 1 or any(len(each) > len(PERSONS) for each in names):
        raise ValueError(f"match {match_id}: players: expected the same one or two in every clip, got {sorted(names)}")
    runs = [np.unique(np.cumsum(clip.cut), return_inverse=True)[1] for clip in clips]
    first = np.cumsum([0, *(int(run.max(initial=-1)) + 1 for run in runs)])
    if names and len(next(iter(names))) == 2:
        differences = _differences(clips, runs, options)
        same = orientation(differences, options)
    else:
        same = np.ones(int(first[-1]))
    return tuple(
        _named(clip, run, same[start:stop], match_id, options)
        for clip, run, start, stop in zip(clips, runs, first[:-1], first[1:], strict=True)
    )


def _named(
    clip: ClipLooks,
    run: Int[np.ndarray, " frames"],
    same: Float[np.ndarray, " runs"],
    match_id: str,
    options: IdentityOptions,
) -> ClipIdentities:
    """The clip's persons, from the probability of each run that the near player is person a."""
    first_person = same[run] if len(run) else np.empty(0)
    is_a = np.stack([first_person, 1.0 - first_person], axis=1)[:, : len(clip.looks.names)]
    sure = np.maximum(is_a, 1.0 - is_a)
    persons = np.array([f"{match_id}.{letter}" for letter in PERSONS], dtype=object)
    named = np.where(sure >= options.least_confidence, np.where(is_a > 0.5, *persons), "")
    return ClipIdentities(clip_id=clip.clip_id, identity=named.astype(object), confidence=sure)


def _differences(
    clips: Sequence[ClipLooks], runs: Sequence[Int[np.ndarray, " frames"]], options: IdentityOptions
) -> Float[np.ndarray, "runs numbers"]:
    """Differences of all runs in standard deviations; NaN where one of the two was not seen."""
    light = np.array([name.endswith(("_L", "_spread")) for name in NUMBERS])
    floor = np.sqrt(2.0) * np.where(light, options.light_scatter, options.colour_scatter)
    rows = []
    for clip, run in zip(clips, runs, strict=True):
        near, far = clip.looks.descriptors[:, 0], clip.looks.descriptors[:, 1]
        for each in range(int(run.max(initial=-1)) + 1):
            seen = [_typical(player[run == each]) for player in (near, far)]
            error = np.hypot(seen[0][1], seen[1][1])
            rows.append((seen[0][0] - seen[1][0]) / np.hypot(floor, error))
    return np.array(rows).reshape(len(rows), len(NUMBERS))


def _typical(
    descriptors: Float[np.ndarray, "frames numbers"],
) -> tuple[Float[np.ndarray, " numbers"], Float[np.ndarray, " numbers"]]:
    """Median of the frames and its standard error; NaN where no frame was looked at."""
    known = np.isfinite(descriptors)
    count = known.sum(axis=0)
    middle, spread = np.full(descriptors.shape[1], np.nan), np.full(descriptors.shape[1], np.nan)
    some = count > 0
    if some.any():
        columns = descriptors[:, some]
        middle[some] = np.nanmedian(columns, axis=0)
        spread[some] = 1.4826 * np.nanmedian(np.abs(columns - middle[some]), axis=0) / np.sqrt(count[some])
    return middle, spread


def orientation(differences: Float[np.ndarray, "runs numbers"], options: IdentityOptions) -> Float[np.ndarray, " runs"]:
    """Probability of each run that its players stand as in the first one that is known; 0.5 where nothing tells.

    The differences are `ends + way * persons + noise`, way 1 or -1 by run, both vectors fitted along with the ways
    (expectation and maximisation over a hidden Markov chain of ways). Source: Dempster, Laird and Rubin, 1977.

    Args:
        differences: In standard deviations; NaN where not seen.
        options: What is taken for the same look.
    """
    known = np.isfinite(differences)
    if len(differences) == 1:
        # One run has one near and one far player, whatever they look like.
        return np.ones(1)
    z = np.where(known, differences, 0.0)
    # As if so many numbers were independent of each other.
    share = np.minimum(1.0, options.independent / np.maximum(known.sum(axis=1), 1))
    fits = [_fitted(z, known, share, start, options) for start in _starts(z)]
    best = max(fits, key=lambda fit: fit[0]) if fits else None
    if best is None or not best[2]:
        return np.full(len(z), 0.5)
    same = best[1]
    told = np.flatnonzero(np.maximum(same, 1.0 - same) >= options.least_confidence)
    return 1.0 - same if len(told) and same[told[0]] < 0.5 else same


def _starts(z: Float[np.ndarray, "runs numbers"]) -> list[Float[np.ndarray, " runs"]]:
    """First guesses of the ways: all alike, and by the main directions with and without the mean taken off."""
    starts = [np.ones(len(z))]
    for rows in (z, z - z.mean(axis=0)):
        if np.any(rows):
            main = np.linalg.svd(rows, full_matrices=False)[2][0]
            starts.append(np.sign(rows @ main + 1e-12))
    return starts


def _fitted(
    z: Float[np.ndarray, "runs numbers"],
    known: Bool[np.ndarray, "runs numbers"],
    share: Float[np.ndarray, " runs"],
    way: Float[np.ndarray, " runs"],
    options: IdentityOptions,
) -> tuple[float, Float[np.ndarray, " runs"], bool]:
    """Logarithm of the likelihood, probability of way 1 of each run, and whether the two ways can be told apart."""
    weight = known * share[:, None]
    persons = ends = np.zeros(z.shape[1])
    likelihood, same = -np.inf, 0.5 * (way + 1.0)
    for _ in range(50):
        ends, persons = _vectors(z, weight, way, options)
        log_same, log_other = (-0.5 * (weight * (z - ends - sign * persons) ** 2).sum(axis=1) for sign in (1.0, -1.0))
        now, same = _chain(log_same, log_other, options.change_chance)
        way = 2.0 * same - 1.0
        if now - likelihood < 1e-6:
            break
        likelihood = now
    prior = -0.5 * share.mean() * float((ends**2).sum()) / max(options.end_effect, 1e-6) ** 2
    return likelihood + prior, same, _apart(ends, persons, weight, way, options) >= options.least_apart


def _vectors(
    z: Float[np.ndarray, "runs numbers"],
    weight: Float[np.ndarray, "runs numbers"],
    way: Float[np.ndarray, " runs"],
    options: IdentityOptions,
) -> tuple[Float[np.ndarray, " numbers"], Float[np.ndarray, " numbers"]]:
    """What the ends and what the persons add, by least squares; the ends' held near 0."""
    count, turned = weight.sum(axis=0), (weight * way[:, None]).sum(axis=0)
    total, signed = (weight * z).sum(axis=0), (weight * way[:, None] * z).sum(axis=0)
    a, d = count + 1.0 / max(options.end_effect, 1e-6) ** 2, count + 1e-3
    determinant = a * d - turned**2
    return (d * total - turned * signed) / determinant, (a * signed - turned * total) / determinant


def _apart(
    ends: Float[np.ndarray, " numbers"],
    persons: Float[np.ndarray, " numbers"],
    weight: Float[np.ndarray, "runs numbers"],
    way: Float[np.ndarray, " runs"],
    options: IdentityOptions,
) -> float:
    """How many standard deviations the two ways round lie apart.

    Where one way was not seen, or hardly, the ends may have made as much of the difference as they can.
    """
    typical = weight.mean(axis=0)
    rarer = min(float((way > 0).sum()), float((way < 0).sum()))
    doubt = 1.0 + (2.0 * options.end_effect / (1.0 + rarer)) ** 2
    return float(np.sqrt((typical * (2.0 * persons) ** 2).sum() / doubt))


def _chain(
    log_same: Float[np.ndarray, " runs"], log_other: Float[np.ndarray, " runs"], change: float
) -> tuple[float, Float[np.ndarray, " runs"]]:
    """Logarithm of the likelihood of a chain of two states, and the probability of the first at each step."""
    log = np.stack([log_same, log_other], axis=1)
    top = log.max(axis=1, keepdims=True)
    local = np.exp(log - top)
    step = np.array([[1.0 - change, change], [change, 1.0 - change]])
    forward, backward = np.empty_like(local), np.ones_like(local)
    likelihood = float(top.sum())
    state = np.array([0.5, 0.5])
    for row in range(len(local)):
        state = (state if row == 0 else state @ step) * local[row]
        likelihood += float(np.log(state.sum()))
        state = state / state.sum()
        forward[row] = state
    for row in range(len(local) - 2, -1, -1):
        after = step @ (local[row + 1] * backward[row + 1])
        backward[row] = after / after.sum()
    both = forward * backward
    return likelihood, both[:, 0] / both.sum(axis=1)
