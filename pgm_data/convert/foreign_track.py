"""A foreign track as ours: its rows on a clip's frames, its pixels in the video's picture."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pgm_data.ball import BallTrack
from pgm_data.convert.frame_clock import FrameClock
from pgm_data.convert.track_csv import TrackRows


@dataclass(frozen=True, kw_only=True)
class TrackOptions:
    """How a foreign track is taken."""

    sigma_px: float = 1.0
    """Standard deviation of each coordinate in the video's picture, px; at least that of the pixel's own steps."""
    width: int | None = None
    """Width of the video's picture, px; where it is known, pixels must lie in it."""
    height: int | None = None
    track_width: int | None = None
    """Width of the picture that the file's pixels are of, where it was resized, px."""
    track_height: int | None = None

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        if not 0 < self.sigma_px < np.inf:
            raise ValueError(f"sigma_px: expected above 0, got {self.sigma_px}")
        for name in ("width", "height", "track_width", "track_height"):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise ValueError(f"{name}: expected at least 1, got {value}")
        sizes = (self.width is None) + (self.height is None), (self.track_width is None) + (self.track_height is None)
        if 1 in sizes or (sizes[1] == 0 and sizes[0] != 0):
            raise ValueError(
                "width, height: expected both, and of the video too where the track's are given, got "
                f"{self.width} x {self.height} and {self.track_width} x {self.track_height}"
            )


def track_of_rows(rows: TrackRows, clock: FrameClock, options: TrackOptions | None = None) -> BallTrack:
    """The ball's track over the clock's frames; rows of other frames are passed over, as is what was interpolated.

    Scores that are not all within 0 to 1 are no probabilities: the ball's is then 1 where it was detected.

    Raises:
        ValueError: If no row is of a frame of the clock, or a pixel lies outside the picture.
    """
    options = options or TrackOptions()
    pixels = in_video(rows, options)
    at = np.searchsorted(clock.video_frame, rows.frame).clip(0, len(clock.video_frame) - 1)
    own = clock.video_frame[at] == rows.frame
    if not own.any():
        span = f"from {clock.video_frame[0]} to {clock.video_frame[-1]}"
        got = f"{rows.frame[0]} to {rows.frame[-1]}" if len(rows.frame) else "none"
        raise ValueError(f"{rows.path}: frame: expected frames of the clip, {span}, got {got}")
    measured = rows.visible & ~rows.is_interpolated & own
    known = rows.score[measured]
    is_probability = np.isfinite(known).all() and ((known >= 0) & (known <= 1)).all()
    frames = len(clock.video_frame)
    track_pixels, sigma, score = np.full((frames, 2), np.nan), np.full(frames, np.nan), np.full(frames, np.nan)
    track_pixels[at[measured]] = pixels[measured]
    sigma[at[measured]] = options.sigma_px
    score[at[measured]] = known if is_probability else 1.0
    return BallTrack(
        times=clock.capture_time,
        is_duplicate=clock.is_duplicate,
        pixels=track_pixels,
        sigma_px=sigma,
        score=score,
        streak_px=np.full((frames, 2), np.nan),
    )


def in_video(rows: TrackRows, options: TrackOptions) -> Float[np.ndarray, "rows 2"]:
    """The rows' pixels in the video's picture: resized corner on corner, as pictures are, not centre on centre.

    Raises:
        ValueError: If one lies outside the picture, where its size is known.
    """
    pixels = np.array(rows.pixels)
    if options.width is None or options.height is None:
        return pixels
    size = np.array([options.width, options.height], dtype=float)
    own_size = size
    if options.track_width is not None and options.track_height is not None:
        own_size = np.array([options.track_width, options.track_height], dtype=float)
    with np.errstate(invalid="ignore"):
        outside = (pixels < -1) | (pixels > own_size)
    wrong = np.argwhere(outside & ~rows.is_interpolated[:, None])
    if len(wrong):
        row, axis = wrong[0]
        x, y = pixels[row]
        swapped = x <= own_size[1] and y <= own_size[0]
        hint = "; are x and y swapped?" if swapped else "; was the picture resized?" if not outside.all() else ""
        raise ValueError(
            f"{rows.path}: frame {rows.frame[row]}: {'xy'[axis]}: expected a pixel of a picture of "
            f"{own_size[0]:.0f} x {own_size[1]:.0f}, got {x:g}, {y:g}{hint}"
        )
    return (pixels + 0.5) * (size / own_size) - 0.5
