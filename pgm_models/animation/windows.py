"""A batch of windows: what the data say, before anything is masked."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor


@dataclass(frozen=True, eq=False, kw_only=True)
class Windows:
    """B windows of T frames; all tensors on one device.

    Raises:
        ValueError: If a state is not finite; names the window.
    """

    state: Float[Tensor, "B T C"]
    """Standardised channels; 0 where a property is not valid."""
    valid: Bool[Tensor, "B T P"]
    """Whether the data say anything of the property."""
    rate: Float[Tensor, " B"]
    """Frames a second."""
    constants: Float[Tensor, "B K"]
    """Standardised; 0, the average, where unknown."""
    text: Int[Tensor, "B T A"]
    """Row among the texts of `tokens`; -1 where there is none."""
    tokens: Float[Tensor, "U L E"]
    """Features of the tokens of each different text of the batch, by the frozen encoder; U may be 0."""
    token_mask: Bool[Tensor, "U L"]
    """Which of them are tokens and not padding."""
    names: tuple[str, ...]
    """Clip, first frame and stride of each window, to name it in errors."""

    def __post_init__(self) -> None:
        """Check that states are finite where the data are on the CPU."""
        if self.state.device.type == "cpu" and not bool(torch.isfinite(self.state).all()):
            bad = int((~torch.isfinite(self.state)).flatten(1).any(1).nonzero()[0])
            raise ValueError(f"{self.names[bad]}: state: expected finite numbers, got NaN or infinity")

    def to(self, device: torch.device | str) -> "Windows":
        """The same windows on another device."""
        moved = {
            name: value.to(device, non_blocking=True)
            for name in self.__dataclass_fields__
            if isinstance(value := getattr(self, name), Tensor)
        }
        return replace(self, **moved)


Fill = Callable[[Windows, Tensor, Tensor, torch.Generator], Tensor]
"""Whatever can fill in windows: known (B,T,P) and text_known (B,T,A) say what of them it may see."""


def first_of(windows: Windows, count: int) -> Windows:
    """The first windows of a batch."""
    return chosen(windows, torch.arange(min(count, len(windows.names))))


def chosen(windows: Windows, rows: Int[Tensor, " rows"]) -> Windows:
    """Those windows of a batch, in that order; the texts stay the batch's."""
    per_window = ("state", "valid", "rate", "constants", "text")
    taken = {name: getattr(windows, name)[rows.to(windows.state.device)] for name in per_window}
    return replace(windows, names=tuple(windows.names[row] for row in rows.tolist()), **taken)
