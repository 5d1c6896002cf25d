"""The ball in metres by the paper's method: keyframes, motion under drag between them, rays met with it.

Keyframes are contacts whose place is known by themselves: bounces, hits with a ground mark or a player, else hits at
their usual height. Between two of them the ball moves as `line_path` says; `line_adjust` moves the keyframes, within
what they leave open, so that flights agree with the pixels, with gravity and with what a bounce takes. A frame's
position is its ray's point in the plane parallel to the net that the ball has come to; without a pixel, the flight's.

Source: promptable game models, appendix on 3D ball localization; keyframes without a mark, their adjustment and all
uncertainty are ours.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from pgm_data.ball import BallEvents, BallTrack
from pgm_data.geometry.camera import Camera
from pgm_data.lift.ball.line_adjust import TOSS_M, Adjusted, Known, Unknowns, adjusted
from pgm_data.lift.ball.line_keyframes import LONGEST_TOSS_S, Keyframes, first_guesses, hitters, marks_of, plays_of
from pgm_data.lift.ball.line_place import Frames, Ground, placed_play
from pgm_data.lift.ball.line_sight import Sights, doubted, no_sights, sights_at
from pgm_data.lift.ball.line_times import meetings
from pgm_data.lift.ball.line_write import Writing
from pgm_data.lift.ball.solution import BallSolution, PlayersAt
from pgm_data.lift.ball.world import BallWorld
from pgm_data.lift.camera_doubt import CameraDoubt
from pgm_data.scene import Prior

BOUNCED = (0.6, 0.3)
"""Surface speed by topspin after a bounce over the speed of the ball, and its standard deviation: friction turns it."""
BOUNCED_ASIDE = 0.15
"""Standard deviation of the same by sidespin."""
LEAST_SPIN = 1e-4
"""m/s, where the ball has no spin."""
LEAST_DRAG_STD = 1e-7
"""1/m, where the drag is exact."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LineOptions:
    """How the line method goes about it."""

    drag: Prior | None = None
    """Drag constant, 1/m, such as serve speeds give it; that of the scene's ball where None."""
    passes: int = 2
    """How often |v| over the speed along the ground is taken from the flight that came out; 0 is the paper's own
    equation, which puts lobs off by decimetres."""
    mark_px: float = 3.0
    """Standard deviation of each coordinate of a ground mark."""
    model_px: float = 0.3
    """What flights leave unexplained in the picture, added to every pixel's standard deviation, px."""
    least_time_std_s: float = 0.002
    """Times of contacts count as no better known."""
    longest_flight_s: float = 40.0
    """Two contacts farther apart bound no flight."""


@dataclass(frozen=True, eq=False, kw_only=True)
class _Setting:
    """A whole clip."""

    track: BallTrack
    events: BallEvents
    camera: Camera
    world: BallWorld
    doubt: CameraDoubt
    players: PlayersAt | None
    options: LineOptions
    drag: Prior
    lit: Int[np.ndarray, " cameras"]
    """Frames with a camera."""
    seen: Int[np.ndarray, " pixels"]
    """Frames with a measured pixel that has a ray."""
    sights: Sights
    """Their rays."""
    sigma_px: Float[np.ndarray, " pixels"]


@dataclass(frozen=True, eq=False, kw_only=True)
class _Play:
    """Contacts of one play, as far as they are known before any flight is looked at."""

    keys: Keyframes
    times: Float[np.ndarray, " contacts"]
    """Where the ways in the picture meet, s."""
    sights: Sights
    """Rays of the contacts."""
    marks: Sights


def solve_line(
    track: BallTrack,
    events: BallEvents,
    camera: Camera,
    *,
    world: BallWorld,
    doubt: CameraDoubt,
    players: PlayersAt | None,
    options: LineOptions,
) -> BallSolution:
    """The ball in metres in every frame between contacts, with its uncertainty; `camera` has one camera a frame.

    What cannot be placed is `none`, and the flights say why; nothing but a wrong length raises.

    Raises:
        ValueError: If camera or players have another number of frames than the track.
    """
    rows = len(track.times)
    for name, count in (("camera", len(camera.K)), ("players", rows if players is None else len(players.hands))):
        if count != rows:
            raise ValueError(f"solve_line: {name}: expected one for each of {rows} frames, got {count}")
    with_camera = np.isfinite(camera.K).all(axis=(1, 2))
    seen = np.flatnonzero(track.measured & with_camera)
    sights = sights_at(camera, seen, track.pixels[seen])
    seen, sights = seen[sights.known], sights.take(sights.known)
    setting = _Setting(
        track=track,
        events=events,
        camera=camera,
        world=world,
        doubt=doubt,
        players=players,
        options=options,
        drag=options.drag or world.drag_per_m,
        lit=np.flatnonzero(with_camera),
        seen=seen,
        sights=sights,
        sigma_px=np.sqrt(track.sigma_px[seen] ** 2 + doubt.pixel_std**2 + options.model_px**2),
    )
    writing = Writing(track, events, setting.drag)
    for contacts in plays_of(events):
        play = _play(setting, contacts)
        for part in _parts(setting, play, writing):
            _solve(setting, play, part, writing)
    return writing.solution()


def _play(setting: _Setting, contacts: np.ndarray) -> _Play:
    events, track = setting.events.take(contacts), setting.track
    met = meetings(
        events.times,
        np.maximum(events.time_std, setting.options.least_time_std_s),
        track.times[setting.seen],
        track.pixels[setting.seen],
        setting.sigma_px,
    )
    sights = marks = no_sights(len(contacts))
    if len(setting.lit):
        near = setting.lit[_nearest(track.times[setting.lit], met.times)]
        pixels = (met.pixels, marks_of(setting.events, contacts))
        sights, marks = (sights_at(setting.camera, near, px) for px in pixels)
    players = setting.players if len(track.times) else None
    hands, roots = hitters(players, _nearest(track.times, met.times), [str(name) for name in events.players])
    kinds = [str(kind) for kind in events.kinds]
    keys = first_guesses(kinds, contacts, sights, marks, setting.world, hands, roots)
    return _Play(keys=keys, times=met.times, sights=sights, marks=marks)


def _parts(setting: _Setting, play: _Play, writing: Writing) -> list[np.ndarray]:
    """Runs of contacts that can be placed together; the flights that cannot are written down."""
    keys = play.keys
    placed, rows = keys.placed, len(keys.event)
    cuts = []
    for k in range(rows - 1):
        why = "; ".join(word for word in (keys.said[k], keys.said[k + 1]) if word)
        span = play.times[k + 1] - play.times[k]
        if not why and span > setting.options.longest_flight_s:
            why = f"its contacts lie {span:.0f} s apart"
        if not why and not span > 0:
            why = "its contacts are one in time"
        if why:
            writing.nothing(int(keys.event[k]), int(keys.event[k + 1]), why)
            cuts.append(k + 1)
    runs = [run[placed[run]] for run in np.split(np.arange(rows), cuts)]
    return [run for run in runs if len(run) > 1]


def _solve(setting: _Setting, play: _Play, part: np.ndarray, writing: Writing) -> None:
    """Places, times and frames of a run of contacts, written down."""
    keys = play.keys
    options: list[Keyframes] = [keys]
    first = _first_hit(setting, play, part)
    if first is not None:
        kinds = setting.events.kinds[keys.event]
        toss = first > 0 and kinds[first - 1] == "first" and first - 1 in part
        toss = toss and play.times[first] - play.times[first - 1] < LONGEST_TOSS_S
        options.append(keys.served(first, play.sights, bool(toss), setting.world))
    try:
        if len(options) > 1:
            # The first few contacts tell a serve from a ball hit at its usual height.
            few = part[:4]
            tries = [_adjust(setting, play, one, few) for one in options]
            widths = [_width(one, first) for one in options]
            best = int(np.argmin([tried[1].cost + width for tried, width in zip(tries, widths, strict=True)]))
            keys = options[best]
            known, solved = tries[best] if len(few) == len(part) else _adjust(setting, play, keys, part)
        else:
            known, solved = _adjust(setting, play, keys, part)
        _write(setting, play, part, known, solved, writing)
    except np.linalg.LinAlgError as error:
        for one, two in zip(keys.event[part[:-1]], keys.event[part[1:]], strict=True):
            writing.nothing(int(one), int(two), f"its equations have no solution: {error}")


def _width(keys: Keyframes, hit: int | None) -> float:
    """What a hypothesis pays for how much it leaves open: logarithms of its priors' standard deviations."""
    tosses = keys.tosses
    drift = 2 * len(tosses) * np.log(TOSS_M) - np.log(keys.std[tosses, :2]).sum()
    return float(np.log(keys.std[hit, 2]) + drift)


def _adjust(setting: _Setting, play: _Play, keys: Keyframes, part: np.ndarray) -> tuple[Known, Adjusted]:
    known = _known(setting, play, keys, part)
    return known, adjusted(_start(setting, play, keys, part), known)


def _first_hit(setting: _Setting, play: _Play, part: np.ndarray) -> int | None:
    """The play's first hit if it is in this part, has no ground mark and its ray is known: it may be a serve."""
    hits = np.flatnonzero(setting.events.kinds[play.keys.event] == "hit")
    open_hit = len(hits) > 0 and hits[0] in part and not play.marks.known[hits[0]] and play.sights.known[hits[0]]
    return int(hits[0]) if open_hit else None


def _start(setting: _Setting, play: _Play, keys: Keyframes, part: np.ndarray) -> Unknowns:
    return replace(_priors(setting, play, keys, part)[0], places=keys.place[part], times=play.times[part])


def _priors(setting: _Setting, play: _Play, keys: Keyframes, part: np.ndarray) -> tuple[Unknowns, Unknowns]:
    """Means and standard deviations of all unknowns."""
    events, world = setting.events.take(keys.event[part]), setting.world
    places, spans = keys.place[part], np.diff(play.times[part])
    speed = np.maximum(np.linalg.norm(np.diff(places, axis=0), axis=1) / spans, 3.0)
    spun = world.radius_m * world.spin_std
    bounced = events.kinds[:-1] == "bounce"
    turned = speed if world.lift_per_m > 0 else 0.0 * speed
    still = np.isin(events.kinds, ("first", "last"))
    time_std = np.where(still, 1e-5, np.maximum(events.time_std, setting.options.least_time_std_s))
    drag = setting.drag
    drag = setting.drag
    mean = Unknowns(
        places=keys.mean[part],
        times=events.times,
        topspin=np.where(bounced, BOUNCED[0] * turned, 0.0),
        sidespin=np.zeros(len(spans)),
        drag=np.array([drag.mean]),
    )
    std = Unknowns(
        places=keys.std[part],
        times=time_std,
        topspin=np.maximum(np.where(bounced, BOUNCED[1] * turned, spun), LEAST_SPIN),
        sidespin=np.maximum(np.where(bounced, BOUNCED_ASIDE * turned, spun), LEAST_SPIN),
        drag=np.array([max(drag.std, LEAST_DRAG_STD)]),
    )
    return mean, std


def _known(setting: _Setting, play: _Play, keys: Keyframes, part: np.ndarray) -> Known:
    mean, std = _priors(setting, play, keys, part)
    times = setting.track.times[setting.seen]
    marked = np.flatnonzero(play.marks.known[part])
    kinds = setting.events.kinds[keys.event[part]]
    within = np.arange(1, len(part) - 1)
    bounce, friction = setting.world.restitution, setting.world.friction
    bounced = within[kinds[1:-1] == "bounce"] if bounce is not None and friction is not None else within[:0]
    # A contact's time moves by a few of its standard deviations at most; the frames stay the same meanwhile.
    inside = np.flatnonzero((times >= play.times[part[0]]) & (times <= play.times[part[-1]]))
    return Known(
        times=times[inside],
        sights=setting.sights.take(inside),
        sigma_px=setting.sigma_px[inside],
        marks=play.marks.take(part[marked]),
        marked=marked,
        mark_px=setting.options.mark_px,
        prior=mean,
        prior_std=std,
        bounced=bounced,
        tossed=np.flatnonzero(np.isin(part[:-1], keys.tosses)),
        restitution=bounce or Prior(mean=0.0, std=1.0),
        friction=friction or Prior(mean=0.0, std=1.0),
        lift_per_m=setting.world.lift_per_m,
        passes=setting.options.passes,
    )


def _write(setting: _Setting, play: _Play, part: np.ndarray, known: Known, solved: Adjusted, writing: Writing) -> None:
    times = setting.track.times
    contacts = solved.unknowns.times
    given = setting.events.times[play.keys.event[part]]
    # Frames that a moved contact has left outside take its place.
    low, high = min(contacts[0], given[0]), max(contacts[-1], given[-1])
    rows = np.flatnonzero((times >= low - 1e-9) & (times <= high + 1e-9))
    within = np.flatnonzero(np.isin(setting.seen, rows))
    rays = setting.sights.take(within)
    frames = Frames(
        times=np.clip(times[rows], contacts[0], contacts[-1]),
        seen=np.searchsorted(rows, setting.seen[within]),
        sights=rays,
        sigma_px=setting.sigma_px[within],
    )
    ways = zip(*(doubted(sights, setting.doubt) for sights in (known.sights, known.marks, rays)), strict=True)
    met = setting.events.kinds[play.keys.event[part[1:]]] == "bounce"
    ground = Ground(level=setting.world.radius_m, met=np.asarray(met))
    placed = placed_play(solved, known, frames, list(ways), ground)
    writing.play(play.keys.event[part], rows, solved, placed)


def _nearest(times: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Rows of the times nearest to those wanted; the times rise."""
    if not len(times):
        return np.zeros(len(wanted), dtype=np.int64)
    after = np.minimum(np.searchsorted(times, wanted), len(times) - 1)
    before = np.maximum(after - 1, 0)
    return np.where(wanted - times[before] <= times[after] - wanted, before, after)
