"""Windows of real play about a hit that a caption tells of: what is asked of a model, and what the words claim."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from jaxtyping import Bool, Float, Int

from pgm_data.caption.claims import Claims, claims_of_text
from pgm_data.caption.contacts import contacts_of
from pgm_data.caption.court_areas import court_areas, looks
from pgm_data.caption.facts import HitFacts
from pgm_data.caption.measures import play_of_clip
from pgm_data.caption.strokes import hit_facts
from pgm_data.dataset.clip_ball import EventRows
from pgm_data.scene import Scene
from pgm_models.animation.ball_contacts import one_clip
from pgm_models.animation.encode import decode, standardise
from pgm_models.animation.layout import Layout
from pgm_models.animation.store import StateStore
from pgm_models.animation.window_source import WindowPlaces

TARGET = ("zone", "zone_side")
SHOT = ("stroke", "side")
FIELDS = (*SHOT, *TARGET)
"""What of a hit is compared: fields of `HitFacts` and `Claims`."""


@dataclass(frozen=True, kw_only=True)
class HitWindowOptions:
    """Where windows lie about hits.

    Raises:
        ValueError: If a number is out of range.
    """

    windows: int = 256
    """At most; evenly spread over all there are."""
    frames: int = 16
    """That are filled in at once, T."""
    rate: float = 25.0 / 3.0
    """Of those frames, a second: the nearest that the data and the factor allow."""
    factor: int = 3
    """By how much the rate is raised after that, between what was filled in; 1 for not."""
    lead_s: tuple[float, float] = (0.3, 0.6)
    """Least and most time from the first frame to the hit, s; drawn for each."""
    seed: int = 0
    """Of leads."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name, low in (("windows", 1), ("frames", 2), ("factor", 1), ("seed", 0)):
            if getattr(self, name) < low:
                raise ValueError(f"HitWindowOptions.{name}: expected at least {low}, got {getattr(self, name)}")
        if not self.rate > 0:
            raise ValueError(f"HitWindowOptions.rate: expected above 0, got {self.rate}")
        if not 0 <= self.lead_s[0] <= self.lead_s[1]:
            raise ValueError(f"HitWindowOptions.lead_s: expected 0 <= least <= most, got {self.lead_s}")

    @property
    def fine_frames(self) -> int:
        """Frames of a window at the raised rate."""
        return (self.frames - 1) * self.factor + 1


@dataclass(frozen=True, eq=False, kw_only=True)
class HitWindows:
    """Windows that begin shortly before a hit; a row each."""

    options: HitWindowOptions
    """That they were found by."""
    coarse: WindowPlaces
    """Where they lie, at the rate that is filled in first."""
    fine: WindowPlaces
    """The same at the raised rate."""
    player: Int[np.ndarray, " windows"]
    """Who hits."""
    claims: tuple[Claims, ...]
    """What the main caption says of the hit."""
    handedness: tuple[tuple[str, ...], ...]
    """Of each player: left, right, or empty where unknown."""
    past: tuple[EventRows, ...]
    """What became of the ball before the first frame since it was hit last; times from the first frame on, s."""
    span: Int[np.ndarray, "windows fine_frames players"]
    """Caption of each player and frame at the raised rate, a span of the store; -1 where none."""

    def __len__(self) -> int:
        """Number of windows."""
        return len(self.player)

    def some(self, rows: Int[np.ndarray, " some"]) -> "HitWindows":
        """The chosen ones."""
        chosen = rows.tolist()
        return HitWindows(
            options=self.options,
            coarse=self.coarse.some(rows),
            fine=self.fine.some(rows),
            player=self.player[rows],
            span=self.span[rows],
            claims=tuple(self.claims[row] for row in chosen),
            handedness=tuple(self.handedness[row] for row in chosen),
            past=tuple(self.past[row] for row in chosen),
        )


def clip_handedness(dataset: Path, scene: Scene) -> dict[str, tuple[str, ...]]:
    """Of each clip of a packed dataset the hands that its scene's players play with, where all are said."""
    found = {}
    for path in sorted((dataset / "meta" / "episodes").glob("chunk-*/file-*.parquet")):
        names = [f"{player.name}.handedness" for player in scene.players]
        table = pq.read_table(path)
        if not set(names) <= set(table.column_names):
            continue
        rows = zip(table["clip_id"].to_pylist(), *(table[name].to_pylist() for name in names), strict=True)
        found |= {clip: tuple(hand or "" for hand in hands) for clip, *hands in rows}
    return found


def hit_windows(
    store: StateStore,
    scene: Scene,
    options: HitWindowOptions,
    *,
    matches: tuple[str, ...] | None = None,
    handedness: Mapping[str, tuple[str, ...]] | None = None,
) -> HitWindows:
    """Windows about hits whose caption says what stroke it is or where the ball goes.

    All of a window is known by the data. Hits and bounces are found in the states, as in generated ones.

    Args:
        store: Real play.
        scene: What it shows.
        options: Where windows lie.
        matches: Of which; all where None.
        handedness: Of each clip's players; of clips that are not in it, estimated from the clip.

    Raises:
        ValueError: If there is no such window.
    """
    random = np.random.default_rng(options.seed)
    found: list[tuple[int, int, int, int, Claims, tuple[str, ...], EventRows]] = []
    for segment in store.segments_of(matches).tolist():
        rate, length = float(store.segment_rate[segment]), int(store.segment_length[segment])
        rows = store.rows(segment, 0, length)
        times = store.time[rows].astype(np.float64)
        clip = store.clip_of(segment)
        columns = real_columns(store, segment)
        players, ball = one_clip(columns, times, scene, clip_id=clip)
        if ball is None:
            raise ValueError(f"{scene.name}: expected a scene with a ball, since hits are asked for")
        play = play_of_clip(players, ball, times, scene, (handedness or {}).get(clip, ()))
        step = options.factor * max(1, round(rate / options.rate / options.factor))
        whole = np.array(store.valid[rows].all(axis=1), dtype=bool)
        span = np.asarray(store.span[rows])
        for player, time in zip(play.hits.player.tolist(), play.hits.time.tolist(), strict=True):
            at = (time - times[0]) * rate
            start = int(np.floor(at - random.uniform(*options.lead_s) * rate))
            end = start + (options.frames - 1) * step
            told = int(span[min(int(at + 1e-6), length - 1), player])
            if start < 0 or end >= length or told < 0 or not whole[start : end + 1].all():
                continue
            claims = claims_of_text(store.spans.texts_of(told)[0])
            if claims.hits and any(getattr(claims, name) for name in FIELDS):
                past = _past(ball.events, float(times[start]))
                found.append((segment, start, step, player, claims, play.handedness, past))
    if not found:
        raise ValueError(f"{store.folder}: expected captions of hits with room for a window, got none")
    count = min(len(found), options.windows)
    chosen = np.floor((np.arange(count) + 0.5) * len(found) / count).astype(np.int64)
    segment, start, step, player, claims, hands, past = zip(*(found[k] for k in chosen.tolist()), strict=True)
    coarse = WindowPlaces(segment=np.array(segment), start=np.array(start), stride=np.array(step))
    fine = WindowPlaces(segment=coarse.segment, start=coarse.start, stride=coarse.stride // options.factor)
    first = store.segment_start[fine.segment] + fine.start
    rows = first[:, None] + fine.stride[:, None] * np.arange(options.fine_frames)
    return HitWindows(
        options=options,
        coarse=coarse,
        fine=fine,
        player=np.array(player),
        claims=claims,
        handedness=hands,
        past=past,
        span=np.asarray(store.span[rows]).astype(np.int64),
    )


def real_columns(store: StateStore, segment: int) -> dict[str, Float[np.ndarray, "frames _"]]:
    """Columns of a segment's frames, NaN where the data say nothing."""
    tangent, valid = store.states(segment, 0, int(store.segment_length[segment]))
    state = standardise(store.layout, tangent.astype(np.float64))
    return known_columns(decode(store.layout, state, store.constants[segment]), valid, store.layout)


def known_columns(
    columns: Mapping[str, Float[np.ndarray, "*batch _"]], valid: Bool[np.ndarray, "*batch properties"], layout: Layout
) -> dict[str, Float[np.ndarray, "*batch _"]]:
    """Columns with NaN where a property of the same object is not valid."""
    result = {}
    for name, values in columns.items():
        owner = name.partition(".")[0]
        own = [row for row, entry in enumerate(layout.properties) if entry.column.partition(".")[0] == owner]
        there = np.array(valid[..., own].all(axis=-1), dtype=bool)
        result[name] = np.where(there[..., None], values, np.nan)
    return result


def _past(events: EventRows, start_s: float) -> EventRows:
    """The last hit before the time and what followed it, nobody's and nowhere, with times from then on."""
    before = np.flatnonzero(events.time < start_s)
    hits = before[events.kind[before] == "hit"]
    rows = before[before >= hits[-1]] if len(hits) else before[:0]
    rows = rows[np.isin(events.kind[rows], ("hit", "bounce", "net"))]
    return EventRows(
        time=events.time[rows] - start_s,
        kind=events.kind[rows],
        player=np.full(len(rows), "", dtype=object),
        probability=events.probability[rows],
        source=events.source[rows],
        position=np.full((len(rows), 3), np.nan),
    )


def hits_of(
    columns: Mapping[str, Float[np.ndarray, "windows frames _"]],
    rate: Float[np.ndarray, " windows"],
    windows: HitWindows,
    scene: Scene,
) -> tuple[dict[str, str] | None, ...]:
    """Of each window what its player's first hit is and where the ball goes, by the rules that read data.

    None where the player does not hit the ball. Words are empty where the rules cannot tell.

    Args:
        columns: As of `encode.decode`, finite.
        rate: Frames a second.
        windows: Whose hits are looked for.
        scene: What they show.
    """
    found: list[dict[str, str] | None] = []
    for row, player in enumerate(windows.player.tolist()):
        own = {name: values[row] for name, values in columns.items()}
        times = np.arange(len(next(iter(own.values())))) / float(rate[row])
        facts = _facts(own, times, scene, windows.handedness[row], windows.past[row])
        hits = np.flatnonzero(facts.player == player)
        found.append({name: str(getattr(facts, name)[hits[0]]) for name in FIELDS} if len(hits) else None)
    return tuple(found)


def _facts(
    columns: Mapping[str, Float[np.ndarray, "frames _"]],
    times: Float[np.ndarray, " frames"],
    scene: Scene,
    handedness: tuple[str, ...],
    past: EventRows,
) -> HitFacts:
    players, ball = one_clip(columns, times, scene, past=past, lands=True)
    assert ball is not None  # windows are of scenes with one
    contacts = contacts_of(players, ball, times, scene, looks(scene))
    return hit_facts(contacts, ball, scene, court_areas(scene), handedness)
