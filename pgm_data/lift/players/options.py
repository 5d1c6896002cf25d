"""Options of the registration of skeletons, and its presets."""

from dataclasses import dataclass, field
from typing import Literal

from pgm_data.lift.players.contact import ContactLaw
from pgm_data.lift.players.terms import GroundLaw, MotionLaw


@dataclass(frozen=True, eq=False, kw_only=True)
class RegisterOptions:
    """Options of `register_player`."""

    rounds: int = 3
    """How often the fit judges anew which feet stand, and goes on."""
    first_steps: int = 6
    """Steps of the descent before feet are judged."""
    steps: int = 3
    """Steps after each judgement."""
    tolerance: float = 1e-3
    """A descent ends when a step betters the cost by a smaller share."""
    finest_s: float = 0.0
    """Frames closer in time than this are not fitted but interpolated; 0 fits all."""
    longest_gap_s: float = 0.7
    """Time without points that is bridged."""
    fewest_points: int = 4
    """Points with which a frame counts as measured."""
    box_std_share: float = 0.04
    """Standard deviation of a box's lower edge, as a share of its height."""
    motion: MotionLaw = field(default_factory=MotionLaw)
    ground: GroundLaw = field(default_factory=GroundLaw)
    contact: ContactLaw = field(default_factory=ContactLaw)


def register_options(quality: Literal["draft", "standard", "best"]) -> RegisterOptions:
    """Options of a preset.

    Raises:
        ValueError: If there is no such preset.
    """
    presets = {
        "draft": RegisterOptions(rounds=1, first_steps=4, steps=3, finest_s=0.075),
        "standard": RegisterOptions(),
        "best": RegisterOptions(rounds=6, first_steps=10, steps=6, tolerance=1e-5),
    }
    if quality not in presets:
        raise ValueError(f"quality: expected one of {', '.join(presets)}, got {quality!r}")
    return presets[quality]
