"""Which entries of a training window are given: the six masking strategies, and mixtures of them.

An *element* is a property or an action at one frame. A strategy hides the same way properties and actions; then half
of the windows get all their actions back. All draws are made on the generator's device, where the masks lie.
"""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

import torch
from jaxtyping import Bool, Int
from torch import Generator, Tensor

Masks = tuple[Bool[Tensor, "B T P"], Bool[Tensor, "B T A"]]
"""`known` of properties and of actions: True where given, False where to be generated or not told."""
Strategy = Callable[[int, int, Sequence[int], int, Generator], Masks]
"""Of (windows, frames, object of each property, actions, generator).

Objects are numbers, those of players their indices: action `a` is of object `a`.
"""

WHOLE_TEXT = 0.5
"""Share of the windows whose actions are all given, whatever the strategy."""


def few_elements(batch: int, frames: int, objects: Sequence[int], actions: int, generator: Generator) -> Masks:
    """Masks where each element is unknown with probability 0.25, apart from all others (strategy i)."""
    return _each_element(0.25, batch, frames, len(objects), actions, generator)


def half_elements(batch: int, frames: int, objects: Sequence[int], actions: int, generator: Generator) -> Masks:
    """Masks where each element is unknown with probability 0.5, apart from all others (strategy ii)."""
    return _each_element(0.5, batch, frames, len(objects), actions, generator)


def inside_block(batch: int, frames: int, objects: Sequence[int], actions: int, generator: Generator) -> Masks:
    """Masks where all elements of consecutive frames are unknown (strategy iii).

    The length is uniform from 1 to all frames, the place uniform among those where it fits.
    """
    return _all_elements(~_block(batch, frames, 1, frames, generator), len(objects), actions)


def outside_block(batch: int, frames: int, objects: Sequence[int], actions: int, generator: Generator) -> Masks:
    """Masks where all elements are unknown but those of consecutive frames (strategy iv, the complement of iii).

    The known length is uniform from 1 to all frames but one, so that something is unknown; of a single frame nothing
    is known.
    """
    return _all_elements(_block(batch, frames, min(1, frames - 1), frames - 1, generator), len(objects), actions)


def last_frames(batch: int, frames: int, objects: Sequence[int], actions: int, generator: Generator) -> Masks:
    """Masks where all elements of the last frames are unknown (strategy v).

    Their number is uniform from 1 to all frames but the first; a single frame is unknown.
    """
    count = _whole(1, max(frames - 1, 1), batch, generator)
    frame = torch.arange(frames, device=generator.device)
    return _all_elements(frame < frames - count[:, None], len(objects), actions)


def some_properties(batch: int, frames: int, objects: Sequence[int], actions: int, generator: Generator) -> Masks:
    """Masks where a set of properties is unknown in all frames (strategy vi); never an empty set.

    In half of the windows it is a set of single properties, its size uniform from 1 to all, with the same share of
    the actions, from none to all. In the other half it is a set of whole objects, its size uniform from 1 to all: all
    properties of a player or of the ball, and the player's actions: opponent modelling.
    """
    device = generator.device
    share = torch.rand(batch, generator=generator, device=device, dtype=torch.float64)
    single = _subset((share * len(objects)).long() + 1, len(objects), generator)
    single_text = _subset((share * (actions + 1)).long(), actions, generator)
    names = sorted(set(objects))
    hidden = _subset(_whole(1, len(names), batch, generator), len(names), generator)
    whole = hidden[:, torch.tensor([names.index(entry) for entry in objects], dtype=torch.long, device=device)]
    columns = [names.index(action) if action in names else len(names) for action in range(actions)]
    padded = torch.cat([hidden, torch.zeros_like(hidden[:, :1])], dim=1)
    whole_text = padded[:, torch.tensor(columns, dtype=torch.long, device=device)]
    by_object = torch.rand(batch, 1, generator=generator, device=device) < 0.5
    unknown = torch.where(by_object, whole, single)
    unknown_text = torch.where(by_object, whole_text, single_text)
    return ~unknown[:, None].expand(-1, frames, -1), ~unknown_text[:, None].expand(-1, frames, -1)


RANDOM: tuple[Strategy, ...] = (few_elements, half_elements)
BLOCK: tuple[Strategy, ...] = (inside_block, outside_block)
LAST: tuple[Strategy, ...] = (last_frames,)
OPPONENT: tuple[Strategy, ...] = (some_properties,)

MASKS: Mapping[str, tuple[Strategy, ...]] = MappingProxyType(
    {
        "all": RANDOM + BLOCK + LAST + OPPONENT,
        "random": RANDOM,
        "random+block": RANDOM + BLOCK,
        "random+last": RANDOM + LAST,
        "random+opponent": RANDOM + OPPONENT,
    }
)
"""Mixtures by name, each of its strategies as often as the others: those that the paper's ablation compares."""


def draw_masks(
    batch: int,
    frames: int,
    objects: Sequence[int],
    actions: int,
    generator: Generator,
    *,
    group: str = "all",
) -> Masks:
    """Masks of training windows, each by a strategy of the group, all as likely; and half with all actions known.

    `objects` names the object of each property by a number: the index of its player, another one of the ball.

    Raises:
        ValueError: If the group is unknown, or there is no property or no frame.

    Source: the paper's appendix Training Details, Animation Model.
    """
    if group not in MASKS:
        raise ValueError(f"group: expected one of {', '.join(MASKS)}, got {group!r}")
    if not objects or frames < 1:
        raise ValueError(f"masks: expected a property and a frame, got {len(objects)} and {frames}")
    strategies = MASKS[group]
    drawn = [strategy(batch, frames, objects, actions, generator) for strategy in strategies]
    pick = torch.randint(len(strategies), (batch,), generator=generator, device=generator.device)
    window = torch.arange(batch, device=generator.device)
    known = torch.stack([masks[0] for masks in drawn])[pick, window]
    text_known = torch.stack([masks[1] for masks in drawn])[pick, window]
    whole = torch.rand(batch, 1, 1, generator=generator, device=generator.device) < WHOLE_TEXT
    return known, text_known | whole


def drop_text(text_known: Bool[Tensor, "B T A"], share: float, generator: Generator) -> Bool[Tensor, "B T A"]:
    """The same, with no action known in that share of the windows: what guidance is trained with."""
    keep = torch.rand(len(text_known), 1, 1, generator=generator, device=generator.device) >= share
    return text_known & keep.to(text_known.device)


def _each_element(
    unknown: float, batch: int, frames: int, properties: int, actions: int, generator: Generator
) -> Masks:
    draws = torch.rand(batch, frames, properties + actions, generator=generator, device=generator.device)
    known = draws >= unknown
    return known[..., :properties], known[..., properties:]


def _all_elements(known: Bool[Tensor, "B T"], properties: int, actions: int) -> Masks:
    return known[..., None].expand(-1, -1, properties), known[..., None].expand(-1, -1, actions)


def _block(batch: int, frames: int, shortest: int, longest: int, generator: Generator) -> Bool[Tensor, "B T"]:
    """Consecutive frames, their number uniform between the two (both may come), their place uniform."""
    length = _whole(shortest, longest, batch, generator)
    place = torch.rand(batch, generator=generator, device=generator.device, dtype=torch.float64)
    start = (place * (frames - length + 1)).long()
    frame = torch.arange(frames, device=generator.device)
    return (frame >= start[:, None]) & (frame < (start + length)[:, None])


def _subset(size: Int[Tensor, " B"], count: int, generator: Generator) -> Bool[Tensor, "B count"]:
    """That many of `count` things, any of them as likely."""
    score = torch.rand(len(size), count, generator=generator, device=generator.device)
    return score.argsort(1).argsort(1) < size[:, None]


def _whole(lowest: int, highest: int, batch: int, generator: Generator) -> Int[Tensor, " B"]:
    """Whole numbers, uniform between the two (both may come)."""
    return torch.randint(lowest, highest + 1, (batch,), generator=generator, device=generator.device)
