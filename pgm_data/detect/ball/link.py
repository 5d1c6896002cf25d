"""The ball's track in the picture, out of what detectors take for it frame by frame.

Candidates are linked into tracklets, each one flight, and the tracklets into the path that is the ball's with the
highest probability over the whole clip. The track holds detections only: a frame in which none fits has none.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from pgm_data.ball import BallTrack
from pgm_data.detect.ball.candidates import BallCandidates
from pgm_data.detect.ball.link_chain import ChainModel, best_chain, meetings, tracklet_features
from pgm_data.detect.ball.link_fill import FillModel, filled
from pgm_data.detect.ball.link_lattice import Lattice, lattice_of
from pgm_data.detect.ball.link_tracklets import LocalFit, MotionModel, Tracklets, local_fit, tracklets_of

TRACKLET_WEIGHTS = np.array([0.004, 0.081, 0.436, 0.64, 0.221, 0.241, 0.076, 0.543, -1.985])
"""Log odds that a tracklet is the ball's by `tracklet_features`: a logistic regression on simulated clips."""
ROW_WEIGHTS = np.array([2.4, 0.2, -0.4, 0.35])
"""Log odds of a row by a constant, its tracklet's log odds, its distance from the fit, and its score's log odds: of
simulated clips, the constant one lower, as real pictures hold more that moves."""
FILL_WEIGHTS = np.array([0.9, 0.5])
"""Log odds of a row that completes the track by a constant and what it is worth; of simulated clips."""
FILL_PASSES = 2
"""How often the track is completed: the second time also from what the first one added."""


@dataclass(frozen=True, kw_only=True)
class LinkOptions:
    """How candidates are linked."""

    motion: MotionModel = MotionModel()
    """How a ball moves in the picture."""
    chain: ChainModel = ChainModel()
    """How its flights follow each other."""
    fill: FillModel = FillModel()
    """What completes them."""
    least_score: float = 0.5
    """Rows less probably the ball are left out."""
    furthest: float = 5.0
    """So are those further from the fit by their neighbours, standard deviations."""


def link_candidates(
    candidates: BallCandidates,
    *,
    times: Float[np.ndarray, " frames"],
    is_duplicate: Bool[np.ndarray, " _"],
    size: tuple[int, int],
    here_from_previous: Float[np.ndarray, "_ 3 3"] | None,
    options: LinkOptions,
) -> BallTrack:
    """The ball's track: at most one candidate a frame, with its probability.

    Args:
        candidates: One row a frame; those of repeats are not looked at.
        times: Capture times, s; a repeat has its source's.
        is_duplicate: Which frames are repeats.
        size: Width and height of the picture, px.
        here_from_previous: For each frame what takes pixels of the frame before to it, the first one's unused; None
            where the camera stood still.
        options: How.

    Raises:
        ValueError: If lengths differ, or times are not finite or fall.
    """
    frames = len(times)
    for name, rows in (
        ("is_duplicate", len(is_duplicate)),
        ("candidates", len(candidates.score)),
        ("here_from_previous", frames if here_from_previous is None else len(here_from_previous)),
    ):
        if rows != frames:
            raise ValueError(f"linking the ball: {name}: expected {frames} rows, one a time, got {rows}")
    if not np.isfinite(times).all() or (np.diff(times) < 0).any():
        raise ValueError("linking the ball: times: expected finite ones that never fall, got others")
    lattice = lattice_of(
        candidates, times=times, is_duplicate=is_duplicate, size=size, here_from_previous=here_from_previous
    )
    linked = _linked(lattice, float(size[1]), options)
    pixels, streak = np.full((frames, 2), np.nan), np.full((frames, 2), np.nan)
    sigma, score = np.full(frames, np.nan), np.full(frames, np.nan)
    row, slot = lattice.rows[linked.picture], linked.slot
    pixels[row] = candidates.pixels[row, slot]
    streak[row] = candidates.streak_px[row, slot]
    sigma[row] = np.hypot(candidates.sigma_px[row, slot], linked.excess / lattice.scale[linked.picture, slot])
    score[row] = linked.score
    return BallTrack(
        times=times, is_duplicate=is_duplicate, pixels=pixels, sigma_px=sigma, score=score, streak_px=streak
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _Linked:
    """Candidates of the track, at most one a picture."""

    picture: np.ndarray
    slot: np.ndarray
    score: np.ndarray
    excess: np.ndarray
    """By how much each lies further from the fit than its own standard deviation explains, px."""


def _linked(lattice: Lattice, height: float, options: LinkOptions) -> _Linked:
    """The candidates that are the ball."""
    tracklets = tracklets_of(lattice, height, options.motion)
    apart = local_fit(lattice, tracklets, height, options.motion, with_itself=False)
    joined = local_fit(lattice, tracklets, height, options.motion, with_itself=True)
    gain = tracklet_features(lattice, tracklets, apart, height) @ TRACKLET_WEIGHTS
    follows = meetings(lattice, tracklets, joined, height, options.motion, options.chain)
    begin_s = lattice.times[tracklets.picture[tracklets.first]]
    end_s = lattice.times[tracklets.picture[tracklets.first + tracklets.count - 1]]
    chosen, together = best_chain(gain, begin_s, end_s, follows, options.chain)
    features = row_features(lattice, tracklets, apart, chosen, together)
    picture, slot = tracklets.picture[features.node], tracklets.slot[features.node]
    score = 1 / (1 + np.exp(-np.clip(features.values @ ROW_WEIGHTS, -30, 30)))
    good = (score >= options.least_score) & (features.off <= options.furthest)
    # Where two tracklets share a picture, the better candidate stands for it.
    order = np.lexsort((-score, picture))
    order = order[good[order]]
    order = order[np.append(True, np.diff(picture[order]) > 0)] if len(order) else order
    picture, slot, score, excess = picture[order], slot[order], score[order], features.excess[order]
    owner = tracklets.owner[features.node[order]]
    for _ in range(FILL_PASSES):
        more = filled(lattice, picture, slot, owner, height, options.motion, options.fill)
        added = 1 / (1 + np.exp(-np.clip(FILL_WEIGHTS[0] + FILL_WEIGHTS[1] * more.worth, -30, 30)))
        kept = added >= options.least_score
        picture, slot = np.append(picture, more.picture[kept]), np.append(slot, more.slot[kept])
        score, owner = np.append(score, added[kept]), np.append(owner, more.owner[kept])
        excess = np.append(excess, np.zeros(int(kept.sum())))
        order = np.argsort(picture)
        picture, slot, score, owner, excess = picture[order], slot[order], score[order], owner[order], excess[order]
    return _Linked(picture=picture, slot=slot, score=score, excess=excess)


@dataclass(frozen=True, eq=False, kw_only=True)
class RowFeatures:
    """What the candidates of the chosen tracklets are judged by."""

    node: np.ndarray
    """Place in the tracklets' flat arrays."""
    values: np.ndarray
    """As `ROW_WEIGHTS` has them."""
    off: np.ndarray
    """Distance from the fit by the neighbours, standard deviations of a coordinate."""
    excess: np.ndarray


def row_features(
    lattice: Lattice, tracklets: Tracklets, apart: LocalFit, chosen: np.ndarray, together: np.ndarray
) -> RowFeatures:
    """Of every candidate of the chosen tracklets."""
    of_tracklet = np.full(len(tracklets.count), np.nan)
    of_tracklet[chosen] = np.clip(together, -6, 6)
    node = np.flatnonzero(np.isfinite(of_tracklet[tracklets.owner]))
    picture, slot = tracklets.picture[node], tracklets.slot[node]
    off2 = ((lattice.points[picture, slot] - apart.place[node]) ** 2).sum(axis=1)
    expected = lattice.variance[picture, slot] + apart.variance[node]
    off = np.sqrt(off2 / expected)
    values = [
        np.ones(len(node)),
        of_tracklet[tracklets.owner[node]],
        np.minimum(off, 5.0),
        lattice.log_odds[picture, slot],
    ]
    return RowFeatures(
        node=node,
        values=np.stack(values, axis=1),
        off=off,
        excess=np.sqrt(np.maximum(off2 / 2 - expected, 0.0)),
    )


def merge_candidates(a: BallCandidates, b: BallCandidates, *, within_px: float = 4.0) -> BallCandidates:
    """The candidates of two finders in each frame, best first; a place that both found is kept once.

    Where both found it, the surer place and streak stand with the higher score.

    Raises:
        ValueError: If they are not of the same frames.
    """
    if len(a.score) != len(b.score):
        raise ValueError(f"merging candidates: expected frames of one clip, got {len(a.score)} and {len(b.score)}")
    apart = a.pixels[:, :, None] - b.pixels[:, None]
    same = np.hypot(apart[..., 0], apart[..., 1]) <= within_px
    # Each of b stands for the one of a that it lies on; that one of a then goes.
    partner = np.where(same, a.score[:, :, None], -1.0)
    own = partner.max(axis=1, initial=-1.0)
    score_b = np.where(own >= 0, np.fmax(b.score, own), b.score)
    with np.errstate(invalid="ignore"):
        gone = same.any(axis=2)
    source = partner.argmax(axis=1) if a.score.shape[1] else np.zeros(b.score.shape, dtype=np.int64)
    rows = np.arange(len(a.score))[:, None]
    pixels_b, sigma_b, streak_b = b.pixels, b.sigma_px, b.streak_px
    if a.score.shape[1]:
        surer = (own >= 0) & (a.sigma_px[rows, source] < b.sigma_px)
        pixels_b = np.where(surer[..., None], a.pixels[rows, source], pixels_b)
        sigma_b = np.where(surer, a.sigma_px[rows, source], sigma_b)
        blind = np.isnan(streak_b).any(axis=-1) & (own >= 0)
        streak_b = np.where((surer | blind)[..., None], a.streak_px[rows, source], streak_b)
    score = np.concatenate([np.where(gone, np.nan, a.score), score_b], axis=1)
    order = np.argsort(np.where(np.isnan(score), 1.0, -score), axis=1, kind="stable")
    empty = np.isnan(np.take_along_axis(score, order, axis=1))

    def merged(of_a: np.ndarray, of_b: np.ndarray) -> np.ndarray:
        both = np.concatenate([of_a, of_b], axis=1)
        taken = both[rows, order]
        return np.where(empty if taken.ndim == 2 else empty[..., None], np.nan, taken)

    return BallCandidates(
        pixels=merged(a.pixels, pixels_b),
        sigma_px=merged(a.sigma_px, sigma_b),
        score=merged(a.score, score_b),
        streak_px=merged(a.streak_px, streak_b),
    )
