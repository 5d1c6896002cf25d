"""Which frames of a clip are fitted, and where its pieces end."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_data.geometry.camera import rays
from pgm_data.lift.players.view import PlayerView

APART_S = 1e5
"""Seconds put between pieces, so that nothing ties them."""
_JUMP_M, _JUMP_SPEED = 1.0, 14.0
"""A body whose middle moves by more than this between frames, and this fast, is another one."""
_SPREAD_M = 0.45
"""Standard deviation of a body's points along its height."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Knots:
    """Frames that are fitted."""

    frames: Int[np.ndarray, " knots"]
    clock: Float[np.ndarray, " knots"]
    """Capture times with a long wait between pieces, s."""
    source: Int[np.ndarray, " frames"]
    """For each frame of the clip its knot, that before it where it lies between two, -1 where it is not reached."""
    share: Float[np.ndarray, " frames"]
    """How far it lies towards the next knot, 0 to 1."""


def knots_of(view: PlayerView, *, anchors: Bool[np.ndarray, " frames"], longest_gap_s: float, finest_s: float) -> Knots:
    """The frames to fit: those of pieces that begin and end with an anchor and have no long gap between anchors.

    Args:
        view: The player.
        anchors: Frames with enough points of their own.
        longest_gap_s: The longest time without an anchor that is bridged.
        finest_s: Frames closer to the one before are left out, but for the last of a piece.
    """
    fresh = ~view.is_duplicate & (np.diff(view.times, prepend=-np.inf) > 1e-6)
    at = np.flatnonzero(anchors & fresh)
    count = len(view.times)
    if not len(at):
        none = np.zeros(0, dtype=np.int64)
        return Knots(frames=none, clock=np.zeros(0), source=np.full(count, -1, dtype=np.int64), share=np.zeros(count))
    breaks = (np.diff(view.times[at]) > longest_gap_s) | _jumps(view, at)
    firsts, lasts = at[np.append(True, breaks)], at[np.append(breaks, True)]
    frames, clock = [], []
    source, share = np.full(count, -1, dtype=np.int64), np.zeros(count)
    total = 0
    for piece, (first, last) in enumerate(zip(firsts, lasts, strict=True)):
        inside = np.arange(first, last + 1)[fresh[first : last + 1]]
        inside = _thinned(inside, view.times, finest_s)
        frames.append(inside)
        clock.append(view.times[inside] + piece * APART_S)
        # Repeats after the last frame of the piece show what it shows.
        end = last + 1
        while end < count and not fresh[end] and view.times[end] - view.times[last] < 1e-6:
            end += 1
        span = np.arange(first, end)
        before = np.searchsorted(view.times[inside], view.times[span] + 1e-9, side="right") - 1
        after = np.minimum(before + 1, len(inside) - 1)
        wait = view.times[inside[after]] - view.times[inside[before]]
        late = view.times[span] - view.times[inside[before]]
        source[span] = total + before
        share[span] = np.where(wait > 0, late / np.where(wait > 0, wait, 1.0), 0.0)
        total += len(inside)
    return Knots(frames=np.concatenate(frames), clock=np.concatenate(clock), source=source, share=share)


def _thinned(frames: np.ndarray, times: np.ndarray, finest_s: float) -> np.ndarray:
    """Every so many of the frames, so that they are not closer than this, and the last one."""
    if finest_s <= 0 or len(frames) < 3:
        return frames
    typical = np.median(np.diff(times[frames]))
    stride = max(int(np.floor(finest_s / typical + 1e-6)), 1)
    return np.union1d(frames[::stride], frames[-1:])


def _jumps(view: PlayerView, at: np.ndarray) -> np.ndarray:
    """Whether the body is elsewhere at once between anchors, judged by the middle of its points and their spread."""
    directions = rays(view.camera[at], view.points_px[at])
    middle = np.nanmedian(directions, axis=1)
    spread = np.nanmedian(np.linalg.norm(directions - middle[:, None], axis=-1), axis=1)
    size = np.maximum(np.minimum(spread[1:], spread[:-1]), 1e-6)
    moved = np.linalg.norm(np.diff(middle, axis=0), axis=-1) / size * _SPREAD_M
    return moved > _JUMP_M + _JUMP_SPEED * np.diff(view.times[at])
