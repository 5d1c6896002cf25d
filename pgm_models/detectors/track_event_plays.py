"""Simulated plays to learn contacts from: where the ball truly was and what happened to it, at any time asked."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from pgm_data.dataset.tables import read_table
from pgm_data.detect.ball.track_network import CLASSES
from pgm_data.geometry.arrays import frozen
from pgm_models.detectors.clip_pictures import NoFrames

HIT, BOUNCE, DEAD_BOUNCE, NET, TOSS = (CLASSES.index(n) for n in ("hit", "bounce", "dead_bounce", "net", "toss"))
CLASS_OF = {"hit": HIT, "bounce": BOUNCE, "net": NET, "first": TOSS}
GRAVITY = 9.81
REBOUND = 0.75
"""Speed of a ball after a bounce over the one before, in dribbles."""


@dataclass(frozen=True, eq=False, kw_only=True)
class TruePlay:
    """The ball of one play in the world."""

    times: Float[np.ndarray, " knots"]
    """Rising, s; its events among them."""
    positions: Float[np.ndarray, "knots 3"]
    """World metres; straight between knots is near enough."""
    event_times: Float[np.ndarray, " events"]
    """Never falling, s."""
    event_classes: Int[np.ndarray, " events"]
    """Places in `CLASSES`."""

    def at(self, times: Float[np.ndarray, " samples"]) -> Float[np.ndarray, "samples 3"]:
        """Positions at these times; NaN before the first knot and after the last."""
        return np.stack(
            [np.interp(times, self.times, self.positions[:, i], left=np.nan, right=np.nan) for i in range(3)], axis=1
        )


def find_plays(dataset: Path) -> tuple[TruePlay, ...]:
    """The plays of all clips under the dataset that show one from its toss on, in order of their folders' names.

    Raises:
        ValueError: If there is none.
    """
    folders = sorted(path.parent for path in dataset.rglob("events.parquet"))
    plays = tuple(play for folder in folders if (play := read_play(folder)) is not None)
    if not plays:
        raise NoFrames(f"{dataset}: expected clip folders with the truth of a play, got none")
    return plays


def read_play(folder: Path) -> TruePlay | None:
    """The play of a clip's folder; None where it has no toss or no hit."""
    events, ball = read_table(folder / "events.parquet"), read_table(folder / "ball.parquet")
    frames = read_table(folder / "camera.parquet")
    kinds, times = events["kind"].astype(str), events["time"].astype(float)
    if "first" not in kinds or "hit" not in kinds:
        return None
    known = np.isfinite(ball["ball.position"]).all(axis=1) & ~frames["frame.is_duplicate"]
    contact = np.isfinite(events["position"]).all(axis=1)
    knots = np.concatenate([frames["frame.capture_time"][known], times[contact]])
    places = np.concatenate([ball["ball.position"][known], events["position"][contact]])
    knots, index = np.unique(knots, return_index=True)
    named = np.isin(kinds, list(CLASS_OF))
    return TruePlay(
        times=frozen(knots),
        positions=frozen(places[index]),
        event_times=frozen(times[named]),
        event_classes=_classes(kinds[named], times[named]),
    )


def _classes(kinds: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Places in `CLASSES`. The first contact after the last hit ends the play: later bounces are of a dead ball."""
    classes = np.array([CLASS_OF[kind] for kind in kinds], dtype=int)
    contacts = times[(times > times[kinds == "hit"].max()) & np.isin(kinds, ("bounce", "net"))]
    if len(contacts):
        classes[(classes == BOUNCE) & (times > contacts.min())] = DEAD_BOUNCE
    return classes


def with_dribbles(play: TruePlay, rng: np.random.Generator) -> TruePlay:
    """The play with its server bouncing the ball some times before the toss, which is no event."""
    toss = play.event_times[play.event_classes == TOSS][0]
    hand = play.at(np.array([toss]))[0]
    rest = float(rng.uniform(0.3, 2.0))
    cycles = [_dribble(rng) for _ in range(int(rng.integers(1, 9)))]
    ends = np.cumsum([times[-1] for times, _ in cycles])
    times = np.concatenate([t + e - t[-1] for (t, _), e in zip(cycles, ends, strict=True)]) - ends[-1] + toss - rest
    heights = np.concatenate([h for _, h in cycles])
    forward = rng.uniform(0.2, 0.6) * (-np.sign(hand[1]) if hand[1] else 1.0)
    places = np.stack(
        [
            hand[0]
            + rng.uniform(-0.3, 0.3)
            + 0.03 * rng.standard_normal(len(cycles)).repeat([len(t) for t, _ in cycles]),
            np.full(len(times), hand[1] + forward),
            heights,
        ],
        axis=1,
    )
    kept = play.times >= toss - 0.25 * rest
    knots = np.concatenate([times, play.times[kept]])
    knots, index = np.unique(knots, return_index=True)
    return replace(play, times=knots, positions=np.concatenate([places, play.positions[kept]])[index])


def _dribble(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Times from 0 and heights of one bounce from the hand to the ground, back, and held for a while."""
    hand, push = rng.uniform(0.7, 1.1), rng.uniform(0.3, 3.0)
    landing = np.sqrt(push**2 + 2 * GRAVITY * hand)
    down = (landing - push) / GRAVITY
    up = REBOUND * landing
    caught = min(hand, 0.95 * up**2 / (2 * GRAVITY))
    rise = (up - np.sqrt(up**2 - 2 * GRAVITY * caught)) / GRAVITY
    held = rng.uniform(0.02, 0.4)
    falling, rising = np.linspace(0.0, down, 15)[:-1], np.linspace(0.0, rise, 15)
    times = np.concatenate([falling, down + rising, [down + rise + held]])
    heights = np.concatenate(
        [hand - push * falling - GRAVITY * falling**2 / 2, up * rising - GRAVITY * rising**2 / 2, [hand]]
    )
    return times, heights + 0.0335
