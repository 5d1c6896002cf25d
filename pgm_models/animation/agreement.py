"""Whether generated play does what the words say: strokes and targets of generated hits against their captions.

A model is shown the first frame of windows that begin shortly before a hit, and texts of all frames and players. What
the player hits and where the ball lands is then read from the states it makes by the same rules that caption real play,
and held against what the caption claims. Beside it stand a ceiling (the rules on the real states, at the same rate),
chance (captions of other windows against the real states; the most frequent word), and the model without text.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pgm_data.scene import Scene, load_scene
from pgm_models.animation.agreement_result import (
    AgreementResult,
    Read,
    Words,
    chance_rows,
    commonest_rows,
    tallied,
)
from pgm_models.animation.encode import decode
from pgm_models.animation.generate import wound_in
from pgm_models.animation.hit_windows import (
    HitWindows,
    hits_of,
)
from pgm_models.animation.keyframes import chunk_pieces
from pgm_models.animation.layout import Layout
from pgm_models.animation.settle import settled_windows
from pgm_models.animation.store import StateStore
from pgm_models.animation.text_features import TextFeatures
from pgm_models.animation.window_source import windows_at
from pgm_models.animation.windows import Fill, Windows


@dataclass(frozen=True, kw_only=True)
class AgreementOptions:
    """What a model is shown, and how.

    Raises:
        ValueError: If a number is out of range.
    """

    words: tuple[Words, ...] = get_args(Words)
    """Which texts are tried."""
    given: int = 1
    """First frames that a model is shown."""
    batch: int = 64
    """Windows that are filled in at once, at most."""
    device: str = "cpu"
    """Where windows are put before they are filled in."""
    seed: int = 0
    """Of shuffles and noise."""
    settle: bool = True
    """Whether what is generated is settled before it is read, as `pgm animate` does."""

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name, low in (("given", 1), ("batch", 1), ("seed", 0)):
            if getattr(self, name) < low:
                raise ValueError(f"AgreementOptions.{name}: expected at least {low}, got {getattr(self, name)}")


def agreement(
    fill: Fill,
    store: StateStore,
    features: TextFeatures,
    windows: HitWindows,
    options: AgreementOptions,
    *,
    scene: Scene | None = None,
    show: Callable[[str], None] = lambda line: None,
) -> AgreementResult:
    """How often what is generated agrees with what the captions claim.

    A hit that does not come, or of which the rules cannot tell, does not agree.

    Args:
        fill: What fills in windows.
        store: Real play, which it has not learned from.
        features: Of the store's texts.
        windows: Of the store, as `hit_windows.hit_windows` finds them.
        options: What is shown.
        scene: What the store shows, where it does not ship with the package.
        show: Is told how far it is.

    Raises:
        ValueError: If all frames are shown, or something was filled in that is not finite.
    """
    if options.given >= windows.options.frames:
        raise ValueError(f"given: expected less than the {windows.options.frames} frames, got {options.given}")
    scene = load_scene(store.layout.scene) if scene is None else scene
    other = other_rows(windows, options.seed)
    real, rate = _read_real(store, windows, scene)
    reads: dict[str, tuple[Read, ...]] = {"ceiling": real}
    show(f"ceiling: read {len(windows)} windows")
    for words in options.words:
        texts = _texts(store, windows, words, other)
        reads[words] = _read_filled(fill, store, features, windows, texts, words, scene, options)
        show(f"{words} words: generated and read")
    rows = [row for words, read in reads.items() for row in tallied(words, windows.claims, read)]
    if "shuffled" in reads:
        told = tuple(windows.claims[row] for row in other.tolist())
        rows += tallied("shuffled, as told", told, reads["shuffled"])
    rows += [*chance_rows(windows, real), *commonest_rows(windows.claims)]
    return AgreementResult(
        rows=tuple(rows),
        windows=len(windows),
        rate=float(rate.mean()),
        hit={words: float(np.mean([hit is not None for hit in read])) for words, read in reads.items()},
    )


def upsample(
    fill: Fill,
    windows: Windows,
    factor: int,
    layout: Layout,
    generator: torch.Generator,
    *,
    text: Int[Tensor, "B F A"] | None = None,
    text_known: Bool[Tensor, "B F A"] | None = None,
) -> Windows:
    """Windows at a rate higher by a factor: theirs are keyframes, known to the bit, and what lies between is made.

    All pieces between keyframes are filled in at once, each in windows as long as those given.

    Args:
        fill: What fills them in.
        windows: All of which is known, T frames.
        factor: How many steps of the result are one of theirs.
        layout: Of the states.
        generator: Of the noise.
        text: Rows of `windows.tokens` of the frames of the result, (T - 1) factor + 1 of them; where None, each frame
            has the text of the keyframe before it.
        text_known: Which of those may be seen; all there are where None.
    """
    count, frames, channels = windows.state.shape
    device = windows.state.device
    fine = (frames - 1) * factor + 1
    keys = np.arange(0, fine, factor)
    if text is None:
        text = windows.text[:, torch.from_numpy(np.arange(fine) // factor).to(device)]
    text_known = text >= 0 if text_known is None else text_known
    pieces = chunk_pieces(np.arange(fine), keys, window=frames)
    is_key = np.isin(np.arange(fine), keys)
    state = torch.zeros(count, fine, channels, dtype=windows.state.dtype, device=device)
    state[:, torch.from_numpy(keys).to(device)] = windows.state
    shown_frames = torch.from_numpy(pieces.frames).to(device)
    parts, length = pieces.frames.shape
    properties = windows.valid.shape[-1]
    known = np.broadcast_to(is_key[pieces.frames][None, ..., None], (count, parts, length, properties))
    known = known.reshape(count * parts, length, properties).copy()
    shown = state[:, shown_frames].reshape(count * parts, length, channels)
    wound = torch.from_numpy(wound_in(layout, shown.cpu().numpy(), known)).to(state)
    given = torch.from_numpy(known).to(device)

    def spread(values: Tensor) -> Tensor:
        return values.repeat_interleave(parts, dim=0)

    def cut(values: Tensor) -> Tensor:
        return values[:, shown_frames].reshape(count * parts, length, -1)

    asked = Windows(
        state=wound,
        valid=torch.ones_like(given),
        rate=spread(windows.rate * factor),
        constants=spread(windows.constants),
        text=cut(text),
        tokens=windows.tokens,
        token_mask=windows.token_mask,
        names=tuple(f"{name}, part {part}" for name in windows.names for part in range(parts)),
    )
    filled = fill(asked, given, cut(text_known), generator).to(state).reshape(count, parts, length, channels)
    made = torch.from_numpy(pieces.made).to(device)
    state[:, shown_frames[made]] = filled[:, made]
    return replace(
        windows,
        state=state,
        valid=torch.ones(count, fine, properties, dtype=torch.bool, device=device),
        rate=windows.rate * factor,
        text=text,
    )


def other_rows(windows: HitWindows, seed: int) -> Int[np.ndarray, " windows"]:
    """Another window of each, of a hit by the same player, serve for serve; its own where there is no other."""
    random = np.random.default_rng([seed, 1])
    other = np.arange(len(windows))
    serves = np.array([claims.stroke == "serve" for claims in windows.claims])
    for player in np.unique(windows.player):
        for kind in (False, True):
            rows = random.permutation(np.flatnonzero((windows.player == player) & (serves == kind)))
            other[rows] = np.roll(rows, 1)
    return other


def _read_real(
    store: StateStore, windows: HitWindows, scene: Scene
) -> tuple[tuple[Read, ...], Float[np.ndarray, " windows"]]:
    """What the rules say of the real states at the raised rate, and that rate."""
    real = windows_at(store, windows.fine, windows.options.fine_frames, None)
    rate = real.rate.numpy().astype(np.float64)
    columns = decode(store.layout, real.state.numpy(), real.constants.numpy(), scene=scene)
    return hits_of(columns, rate, windows, scene), rate


def _texts(
    store: StateStore, windows: HitWindows, words: Words, other: Int[np.ndarray, " windows"]
) -> Int[np.ndarray, "windows fine_frames players"]:
    """The text of each player and frame, a row of the store's; -1 where none."""
    if words == "none":
        return np.full(windows.span.shape, -1, dtype=np.int64)
    if words == "reworded":
        counts = np.diff(store.spans.first)[np.maximum(windows.span, 0)]
        # The second of each span's texts, the main one where it has no other.
        return store.spans.text_of(windows.span, np.where(counts > 1, 1.5 / counts, 0.0))
    texts = store.main_texts(windows.span)
    return texts[other] if words == "shuffled" else texts


def _read_filled(
    fill: Fill,
    store: StateStore,
    features: TextFeatures,
    windows: HitWindows,
    texts: Int[np.ndarray, "windows fine_frames players"],
    words: str,
    scene: Scene,
    options: AgreementOptions,
) -> tuple[Read, ...]:
    """What the rules say of states that are made with these texts; the noise is the same for all texts."""
    generator = torch.Generator().manual_seed(options.seed)
    factor = windows.options.factor
    reads: list[Read] = []
    for start in range(0, len(windows), options.batch):
        rows = np.arange(start, min(start + options.batch, len(windows)))
        first = windows_at(store, windows.coarse.some(rows), windows.options.frames, None)
        ids, inverse = np.unique(texts[rows], return_inverse=True)
        missing = int(ids[0] < 0)
        tokens, mask = features.rows(ids[missing:])
        fine_text = torch.from_numpy(inverse.reshape(texts[rows].shape) - missing).to(options.device)
        first = replace(first, tokens=torch.from_numpy(tokens), token_mask=torch.from_numpy(mask)).to(options.device)
        first = replace(first, text=fine_text[:, ::factor].contiguous())
        known = torch.zeros_like(first.valid)
        known[:, : options.given] = first.valid[:, : options.given]
        made = fill(first, known, first.text >= 0, generator).to(first.state)
        made = replace(first, state=_finite(made, first.names, words))
        if factor > 1:
            made = upsample(fill, made, factor, store.layout, generator, text=fine_text)
            _finite(made.state, first.names, words)
        columns = decode(store.layout, made.state.cpu().numpy(), made.constants.cpu().numpy(), scene=scene)
        rate = made.rate.cpu().numpy().astype(np.float64)
        if options.settle:
            shown = np.arange(made.state.shape[1]) < (options.given - 1) * factor + 1
            columns = settled_windows(columns, dict.fromkeys(columns, np.tile(shown, (len(rate), 1))), rate, scene)
        reads += hits_of(columns, rate, windows.some(rows), scene)
    return tuple(reads)


def _finite(state: Float[Tensor, "B T C"], names: Sequence[str], words: str) -> Float[Tensor, "B T C"]:
    good = torch.isfinite(state).flatten(1).all(dim=1)
    if not bool(good.all()):
        name = names[int((~good).nonzero()[0])]
        raise ValueError(f"{name}, {words} words: expected finite states to be filled in, got NaN or infinity")
    return state
