"""What happens in a play and when, as far as captions speak of it."""

from dataclasses import dataclass

import numpy as np

from pgm_data.simulate.tennis.caption_motion import speeds
from pgm_data.simulate.tennis.caption_spans import Cuts
from pgm_data.simulate.tennis.play import Play, Shot, Stroke


@dataclass(frozen=True, eq=False, kw_only=True)
class Hit:
    """One stroke with what it did to the ball."""

    stroke: Stroke
    shot: Shot | None
    """None where the player swings and misses."""
    is_return: bool
    """The first stroke after a serve that is in."""
    is_last: bool
    """No other stroke hits the ball after it."""
    clips_net: bool
    """The ball touches the net on its way and lands."""
    passing: bool
    """Goes past an opponent who is at the net."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Course:
    """A play, read for captions."""

    play: Play
    hits: tuple[Hit, ...]
    serve_s: float
    """Of the serve's contact; the play's end where there is no serve."""
    decided_s: float
    """When it shows how the play ends: the ball meets the net or the ground outside, or bounces a second time."""
    speeds: tuple[np.ndarray, np.ndarray]
    """m/s at the knots of each player's plan."""

    @property
    def last(self) -> Hit | None:
        """The last stroke that hits the ball."""
        return next((hit for hit in reversed(self.hits) if hit.shot is not None), None)

    def of(self, player: int, start_s: float, end_s: float) -> list[Hit]:
        """The player's strokes from start_s to end_s, misses among them."""
        return [h for h in self.hits if h.stroke.player == player and start_s <= h.stroke.time < end_s]

    def ball_before(self, time: float) -> Hit | None:
        """Whose ball is in play just before a time: the last stroke that hit it, None before the serve."""
        return next((h for h in reversed(self.hits) if h.shot is not None and h.stroke.time < time), None)

    def next_own(self, player: int, time: float) -> Hit | None:
        """The player's next stroke at or after a time."""
        return next((h for h in self.hits if h.stroke.player == player and h.stroke.time >= time), None)


def course_of(play: Play) -> Course:
    """The play with its strokes and shots brought together."""
    shot_of = {shot.stroke: shot for shot in play.shots}
    last = max(shot_of, default=-1)
    serve = next((s for s in play.strokes if s.kind == "serve"), None)
    first_after = next((i for i, s in enumerate(play.strokes) if i in shot_of and s.kind != "serve"), -1)
    hits = tuple(
        Hit(
            stroke=stroke,
            shot=shot_of.get(i),
            is_return=i == first_after and serve is not None and stroke.player != serve.player,
            is_last=i == last,
            clips_net=i in shot_of and _clips_net(play, shot_of[i]),
            passing=i in shot_of and _passes(play, stroke, shot_of[i]),
        )
        for i, stroke in enumerate(play.strokes)
    )
    return Course(
        play=play,
        hits=hits,
        serve_s=play.duration_s if serve is None else serve.time,
        decided_s=_decided(play, shot_of[last]) if last >= 0 else play.duration_s,
        speeds=(speeds(play.plans[0]), speeds(play.plans[1])),
    )


def cuts_of(course: Course, player: int, rng: np.random.Generator) -> Cuts:
    """Where this player's course may be cut: at strokes and bounces, at the end, where it starts and stops."""
    times: list[float] = []
    worth: list[float] = []
    for hit in course.hits:
        own = hit.stroke.player == player
        times.append(hit.stroke.time + (0.25 if own else 0.04))
        worth.append(2.5 if own else 1.2)
    for contact in course.play.ball.contacts:
        if contact.kind in ("bounce", "net"):
            times.append(contact.time + 0.04)
            worth.append(0.3)
    times.append(course.decided_s + 0.4)
    worth.append(1.2)
    moving = course.speeds[player] > 0.6
    changes = np.flatnonzero(moving[1:] != moving[:-1]) + 1
    found = np.concatenate([np.array(times), course.play.plans[player].times[changes]])
    value = np.concatenate([np.array(worth), np.full(len(changes), 0.7)])
    return Cuts(times=found, worth=value * rng.uniform(0.6, 1.4, len(value)))


def _contacts_after(play: Play, shot: Shot) -> list[tuple[str, float]]:
    """Kinds and times of what the ball touches after a shot, up to the next hit."""
    after = []
    for contact in play.ball.contacts[shot.contact + 1 :]:
        if contact.kind == "hit":
            break
        after.append((contact.kind, contact.time))
    return after


def _clips_net(play: Play, shot: Shot) -> bool:
    after = _contacts_after(play, shot)
    return (
        shot.result in ("in", "let") and bool(after) and after[0][0] == "net" and bool(np.isfinite(shot.landing).all())
    )


def _passes(play: Play, stroke: Stroke, shot: Shot) -> bool:
    plan = play.plans[1 - stroke.player]
    knot = min(round(stroke.time * 50), len(plan.path) - 1)
    near_net = abs(float(plan.path[knot, 1])) < 5.0
    return near_net and stroke.kind == "drive" and shot.result == "in"


def _decided(play: Play, shot: Shot) -> float:
    after = _contacts_after(play, shot)
    if not after:
        return play.strokes[shot.stroke].time
    bounces = [time for kind, time in after if kind == "bounce"]
    if shot.result == "net":
        return next((time for kind, time in after if kind in ("net", "bounce")), after[-1][1])
    if shot.result == "in":
        return bounces[1] if len(bounces) > 1 else after[-1][1]
    return bounces[0] if bounces else after[-1][1]
