"""The full-physics joint fit: whole rallies by multiple shooting, with fallbacks shot by shot.

Unknown are the ball's states at the nodes, each flight's spin, contact times, and the rally's drag, restitution and
friction; known are pixels, ground marks, players, the bounce law, and priors. A play is first solved as a whole; shots
that come out implausible or far off their pixels are solved again alone, from several starts, and what still fails is
left to the line method.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pgm_data.ball import BallEvents, BallTrack
from pgm_data.geometry.camera import Camera
from pgm_data.lift.ball.physics_result import MOST, Piece, assemble
from pgm_data.lift.ball.rally_plan import Surroundings
from pgm_data.lift.ball.rally_plays import Play, RallyFrames, plays, rally_frames
from pgm_data.lift.ball.rally_problem import SolverOptions
from pgm_data.lift.ball.rally_rounds import PlayFit, RoundOptions, solve_rounds
from pgm_data.lift.ball.solution import BallSolution, PlayersAt
from pgm_data.lift.ball.world import BallWorld
from pgm_data.lift.camera_doubt import CameraDoubt

SHORT = 4
"""Plays of at most so many contacts are tried from several starts."""
TRIED_TOPSPIN = 200.0
"""Topspin and backspin of further starts, rad/s."""


@dataclass(frozen=True, kw_only=True)
class PhysicsOptions:
    """How the full-physics fit runs."""

    iterations: int = 30
    """Most IPOPT iterations of one fit."""
    tolerance: float = 1e-3
    """IPOPT's, of the gradient of the cost by unknowns scaled to about 1."""
    rounds: int = 6
    """Most fits from one start, between which pictures change flights and outliers drop out."""
    bend: float = 3.0
    """Where the robust loss bends, standard deviations."""
    cut: float = 4.5
    """Pixels further off than this many standard deviations are outliers."""
    support: float = 0.9
    """A spin or drag is free where its posterior standard deviation is below this share of the prior's; elsewhere it
    is held at the prior's mean, and its prior uncertainty goes into all covariances."""
    starts: int = 3
    """Most further starts of a shot whose first fit is poor."""
    poor_chi2: float = 2.0
    """Reduced chi-squared of a shot above which further starts are tried."""
    failed_chi2: float = 25.0
    """Reduced chi-squared of a shot above which it counts as not solved."""


def physics_preset(name: str) -> PhysicsOptions:
    """The options of a preset: draft, standard or best.

    Raises:
        ValueError: If there is no such preset.
    """
    presets = {
        "draft": PhysicsOptions(iterations=15, tolerance=1e-2, rounds=2, starts=0),
        "standard": PhysicsOptions(),
        "best": PhysicsOptions(iterations=100, tolerance=1e-5, rounds=10, starts=8, poor_chi2=1.4),
    }
    if name not in presets:
        raise ValueError(f"physics preset: expected one of {', '.join(presets)}, got {name!r}")
    return presets[name]


def solve_physics(
    track: BallTrack,
    events: BallEvents,
    camera: Camera,
    *,
    world: BallWorld,
    doubt: CameraDoubt,
    players: PlayersAt | None,
    options: PhysicsOptions,
    start: BallSolution | None = None,
) -> BallSolution:
    """The ball in metres by the full-physics fit.

    Args:
        track: The ball in the picture.
        events: Contacts and ends of plays; their kinds stay, their times are solved for within their deviations.
        camera: One camera a frame; NaN where a frame has none: it is then no measurement.
        world: What the ball flies in.
        doubt: How far the camera may be off.
        players: Where players are; None where not known.
        options: How.
        start: The line method's solution of the same track, to fall back to; None without one.

    Raises:
        ValueError: If the camera does not have one row a frame.
    """
    frames = rally_frames(track, camera, doubt)
    pieces: list[Piece] = []
    around = Surroundings(camera=camera, world=world, players=players)
    for play in plays(events):
        if frames is None:
            pieces.append(Piece(play=play, solved=None, said="no picture with a camera"))
        else:
            pieces += _Solver(frames, around, doubt, options).pieces(play)
    return assemble(track, events, pieces, world, start)


class _Solver:
    """Solves plays of one clip."""

    def __init__(self, frames: RallyFrames, around: Surroundings, doubt: CameraDoubt, options: PhysicsOptions) -> None:
        self.frames, self.around, self.doubt, self.options = frames, around, doubt, options
        self.rounds = RoundOptions(
            solver=SolverOptions(iterations=options.iterations, tolerance=options.tolerance),
            bend=options.bend,
            cut=options.cut,
            rounds=options.rounds,
            support=options.support,
        )

    def pieces(self, play: Play) -> list[Piece]:
        """The play in pieces: one if all is well."""
        found: list[Piece] = []
        for part in self._seen(play):
            found += self._solved(part) if isinstance(part, Play) else [part]
        return found

    def _seen(self, play: Play) -> list[Play | Piece]:
        """Runs of shots with measurements, and the shots without, which nobody can place."""
        cuts = _shots(play)
        counts = self._counts(play, cuts)
        parts: list[Play | Piece] = []
        run: int | None = None
        for (first, last), count in zip(cuts, counts, strict=True):
            if count >= LEAST_PIXELS:
                run = first if run is None else run
                continue
            if run is not None:
                parts.append(play.part(run, first))
                run = None
            said = f"{count} pictures of the ball, {LEAST_PIXELS} wanted"
            parts.append(Piece(play=play.part(first, last), solved=None, said=said))
        if run is not None:
            parts.append(play.part(run, len(play) - 1))
        return parts

    def _counts(self, play: Play, cuts: list[tuple[int, int]]) -> list[int]:
        times = self.frames.times[self.frames.measured]
        return [int(((times >= play.times[a]) & (times <= play.times[b])).sum()) for a, b in cuts]

    def _solved(self, play: Play) -> list[Piece]:
        """A run of shots: as a whole, or the poor shots alone and the runs of good ones between them."""
        cuts = _shots(play)
        if len(cuts) == 1:
            return [self._alone(play)]
        whole = self._best(play, starts=0)
        bad = [whole is None or self._wrong(whole, a, b) for a, b in cuts]
        if whole is not None and not any(bad):
            return [Piece(play=play, solved=whole, said=whole.fit.said)]
        pieces: list[Piece] = []
        run: int | None = None
        for (first, last), wrong in zip(cuts, bad, strict=True):
            if not wrong:
                run = first if run is None else run
                continue
            if run is not None:
                pieces += self._run(play.part(run, first))
                run = None
            pieces.append(self._alone(play.part(first, last)))
        if run is not None:
            pieces += self._run(play.part(run, len(play) - 1))
        return pieces

    def _run(self, play: Play) -> list[Piece]:
        """A run of shots that were good, without their poor neighbours."""
        cuts = _shots(play)
        if len(cuts) > 1:
            again = self._best(play, starts=0)
            if again is not None and not any(self._wrong(again, a, b) for a, b in cuts):
                return [Piece(play=play, solved=again, said=again.fit.said)]
        return [self._alone(play.part(a, b)) for a, b in cuts]

    def _alone(self, play: Play) -> Piece:
        """One shot by itself."""
        best = self._best(play, starts=self.options.starts)
        if best is None:
            return Piece(play=play, solved=None, said="nothing measured")
        if self._wrong(best, 0, len(play) - 1):
            chi2 = float(best.flight_chi2.max())
            far = f"reduced chi-squared {chi2:.0f}" if best.fit.converged else "no end of its fit"
            why = "implausible" if best.implausible().any() else far
            return Piece(play=play, solved=None, said=f"physics failed: {why}; {best.fit.said}")
        return Piece(play=play, solved=best, said=best.fit.said)

    def _best(self, play: Play, *, starts: int) -> PlayFit | None:
        """The best fit of a play over whether it begins with a serve, and over further starts if it is poor."""
        serves = self._serve_first(play)
        tried = [self._from(play, serve=serve) for serve in serves]
        best = min((t for t in tried if t is not None), key=_score, default=None)
        if best is None or starts == 0 or not self._poor(best):
            return best
        serve = serves[int(np.argmin([np.inf if t is None else _score(t) for t in tried]))]
        for shift, topspin in self._further(play)[:starts]:
            other = self._from(play, serve=serve, shift_s=shift, topspin=topspin)
            if other is not None and _score(other) < _score(best):
                best = other
            if not self._poor(best):
                break
        return best

    def _from(self, play: Play, **how) -> PlayFit | None:
        return solve_rounds(self.frames, play, self.around, doubt=self.doubt, options=self.rounds, **how)

    def _serve_first(self, play: Play) -> list[bool]:
        """Whether to take the first hit for an overhead serve: both ways where the first shot does not tell."""
        if play.serve < 0 or np.isfinite(play.ground_px[play.serve]).all():
            return [False]
        cuts = _shots(play)
        # A toss before the serve goes with it.
        first = play.part(0, cuts[min(play.serve, len(cuts) - 1)][1])
        if len(first) == len(play):
            return [True, False]
        scores = [np.inf if t is None else _score(t) for t in (self._from(first, serve=s) for s in (True, False))]
        if not np.isfinite(scores).any():
            return [False]
        if abs(scores[0] - scores[1]) > DECIDED:
            return [scores[0] < scores[1]]
        return [True, False]

    def _further(self, play: Play) -> list[tuple[Float[np.ndarray, " contacts"], float]]:
        """Other starts of a short play: contact times shifted by a picture, and spin either way."""
        inner = np.array([kind == "bounce" for kind in play.kinds], dtype=float)
        inner[[0, -1]] = 0.0
        step = self.frames.interval_s * inner
        gap = 0.4 * np.append(np.diff(play.times), np.inf)
        step = np.minimum(step, gap)
        none = 0 * inner
        found = [(none, TRIED_TOPSPIN), (none, -TRIED_TOPSPIN)]
        if inner.any():
            found = [(step, 0.0), (-step, 0.0), *found, (step, TRIED_TOPSPIN), (-step, -TRIED_TOPSPIN)]
        return found if len(play) <= SHORT else []

    def _poor(self, solved: PlayFit) -> bool:
        return (
            not solved.fit.converged
            or bool(solved.implausible().any())
            or bool(solved.flight_chi2.max() > self.options.poor_chi2)
        )

    def _wrong(self, solved: PlayFit, first: int, last: int) -> bool:
        """Whether flights between two contacts came out as no ball's, far off their pixels, or off most of them.

        One that lost most of its pixels as outliers may stand where its neighbours place it well. A fit that stopped
        on its way may be as good as at rest; one that agrees with its pixels poorly as well is no solution.
        """
        if not solved.fit.converged and solved.flight_chi2.max() > self.options.poor_chi2:
            return True
        own = np.arange(first, last)
        too_far = solved.flight_chi2[own] > self.options.failed_chi2
        lost = solved.kept[own] < MOST
        if lost.any():
            rows = np.isin(solved.fit.plan.picture_flight, own[lost])
            spread = np.sqrt(np.trace(solved.information.position_cov[rows], axis1=1, axis2=2))
            too_far = np.append(too_far, last - first == len(solved.kept) or spread.max() > PLACED_M)
        return bool(too_far.any() or solved.implausible()[own].any())


LEAST_PIXELS = 4
"""Fewer pictures of the ball in a shot place nothing."""
PLACED_M = 1.0
"""A flight whose own pixels were left out stays where its neighbours place it at least this well, m."""
DECIDED = 4.0
"""Costs that differ by more than this decide between a serve and another hit: odds of 50 to 1."""


def _score(solved: PlayFit) -> float:
    """Cost by which starts compare; an implausible one loses against any other."""
    return solved.score + (1e6 if solved.implausible().any() else 0.0)


def _shots(play: Play) -> list[tuple[int, int]]:
    """First and last contact of each shot: from hit to hit, the ends of the play counting as such."""
    hits = [k for k, kind in enumerate(play.kinds) if kind == "hit" or k in (0, len(play) - 1)]
    return list(zip(hits[:-1], hits[1:], strict=True))
