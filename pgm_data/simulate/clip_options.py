"""What a simulated video is like."""

from dataclasses import dataclass
from typing import Literal

from pgm_data.simulate.play import Motion


@dataclass(frozen=True, eq=False, kw_only=True)
class ClipOptions:
    """What a simulated video is like. Raises ValueError for values out of range."""

    frames: int = 250
    width: int = 1280
    height: int = 720
    fps: float = 25.0
    """Frames per second as presented."""
    motion: Motion = "any"
    """Camera: `still`, `drift` (a few pixels), `follow` (pans and zooms), or one of them by lot."""
    duplicates: bool = False
    """Every sixth frame repeats the one before, as after a rate conversion."""
    closeups: bool = False
    """Cut to shots without the court now and then."""
    cropped: bool = False
    """The picture is a part of a larger one: the principal point is off its centre."""
    clean: bool = False
    """No blur, noise or graphics."""
    quality: Literal["draft", "full"] = "full"
    """`draft` paints thin lines by square pixels, which moves their centres locally by up to 0.3 px."""
    shutter: float | None = None
    """Exposure as a share of the time between pictures, 0 to 1; by lot unless given."""
    wind_ms: tuple[float, float] | None = None
    """Wind along x and y, m/s; calm unless given."""
    surface: Literal["hard", "clay", "grass"] | None = None
    """Of a tennis court; by lot unless given."""
    world_seed: int | None = None
    """Of a world of blocks, its light and its sky: the same wherever it is given; the video's own unless given."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name, low, high in (
            ("frames", 1, 10_000_000),
            ("width", 64, 7680),
            ("height", 36, 4320),
            ("fps", 1.0, 240.0),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                raise ValueError(f"ClipOptions.{name}: expected {low} to {high}, got {value}")
        for name, allowed in (
            ("motion", ("any", "still", "drift", "follow")),
            ("quality", ("draft", "full")),
            ("surface", (None, "hard", "clay", "grass")),
        ):
            if getattr(self, name) not in allowed:
                known = ", ".join(str(word) for word in allowed if word is not None)
                raise ValueError(f"ClipOptions.{name}: expected one of {known}, got {getattr(self, name)!r}")
        if self.shutter is not None and not 0.0 <= self.shutter <= 1.0:
            raise ValueError(f"ClipOptions.shutter: expected 0 to 1, got {self.shutter}")
        if self.wind_ms is not None and not all(abs(speed) <= 60.0 for speed in self.wind_ms):
            raise ValueError(f"ClipOptions.wind_ms: expected -60 to 60, got {self.wind_ms}")
