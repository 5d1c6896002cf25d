"""Play from a prompt: a model asked window by window, keyframes first.

A sequence no longer than the model's windows is filled in at once. A longer one in two stages or more (`keyframes`):
few frames far apart at a low rate, in windows that are shifted along where one does not span them; then the frames
between them, all windows at once. Texts go along to whatever frames they are about. A fixed value is shown to the model
in each window that holds its frame, at that frame: to the first stage where its frame is a keyframe, as the first and
last frame of each fixed stretch are unless they lie too near to another one, and otherwise to the second stage alone.
A goal that lies beyond a window of the first stage is not seen by it, but by a later one: that begins where one window
does not span the sequence at the lowest rate of the training, or at the rate that is asked for. In what comes back,
fixed values are the prompt's own to the bit; at the end the rest is settled: feet that stand rest, and balls fly.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pgm_data.scene import Scene, load_scene
from pgm_models.animation.encode import continuous_known, decode, standardise, unstandardise
from pgm_models.animation.keyframes import Pieces, Plan, plan_of
from pgm_models.animation.layout import Layout
from pgm_models.animation.model import AnimationModel
from pgm_models.animation.prompt import Given, Prompt, given_by
from pgm_models.animation.sample import SampleOptions, filler
from pgm_models.animation.settle import settled
from pgm_models.animation.tangents import nearest_equal
from pgm_models.animation.windows import Fill, Windows

AT_ONCE = 64
"""Most windows in one call of the model."""
UNHELD = 1e-3
"""Metres, metres a second or radians by which a fixed value may be missed before somebody is told."""
RATE_SLACK = 0.02
"""Share by which a rate may leave the range of the training without a warning: keyframes lie at whole frames."""


@dataclass(frozen=True, kw_only=True)
class GenerateOptions:
    """How sequences are made of windows, and windows of noise."""

    sample: SampleOptions = SampleOptions()
    keep: int | None = None
    """Frames that a window keeps when it is shifted along; half of them where None."""
    keyframe_hz: float | None = None
    """Rate of the first stage, frames a second; where None, what lets one window span the sequence."""
    settle: bool = True
    """Whether feet and ball are brought onto what they can do (see `settle`)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Words:
    """Features of a prompt's texts, in the order of its texts."""

    tokens: Float[Tensor, "U L E"]
    mask: Bool[Tensor, "U L"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Play:
    """A generated sequence."""

    prompt: Prompt
    state: Float[np.ndarray, "frames channels"]
    """Standardised; what the prompt fixes is exactly its own."""
    known: Bool[np.ndarray, "frames properties"]
    """What the prompt fixes."""
    constants: Float[np.ndarray, " constants"]
    """Standardised."""
    columns: dict[str, Float[np.ndarray, "frames _"]]
    """Of the contract, in its units, settled; joints follow from the others."""
    settled: tuple[str, ...]
    """How far they were moved for that from what the states say."""
    plan: Plan
    """In what order the frames were made."""
    warnings: tuple[str, ...]
    """What the model was asked for beyond what it was trained with, and what it cannot hold."""


def said_nothing(done: int, total: int) -> None:
    """For who does not ask."""


def generate(
    model: AnimationModel,
    prompt: Prompt,
    options: GenerateOptions,
    *,
    seed: int | None = None,
    scene: Scene | None = None,
    said: Callable[[int, int], None] = said_nothing,
) -> Play:
    """Play that holds to the prompt; the same for the same seed on the same device.

    Args:
        model: Trained on the prompt's scene.
        prompt: Read with the model's layout.
        options: How it is made.
        seed: Of the noise; the prompt's where None.
        scene: What the model is of, where its scene does not ship with the package.
        said: Told how many frames are made, and of how many, now and then.

    Raises:
        ValueError: If an option cannot be.
    """
    generator = torch.Generator().manual_seed(prompt.seed if seed is None else seed)
    given = given_by(prompt, model.layout)
    plan = plan_of(
        given.known,
        rate=prompt.rate,
        window=model.options.frames,
        rates=model.options.rates,
        keyframe_hz=options.keyframe_hz,
        keep=options.keep,
    )
    words = words_of(model, given.texts)
    state = fill_sequence(filler(model, options.sample, scene), given, words, plan, model.layout, generator, said)
    columns, notes = decode(model.layout, state, given.constants, scene=scene), ()
    if options.settle:
        known = {entry.column: given.known[:, row] for row, entry in enumerate(model.layout.properties)}
        times = np.arange(len(state)) / prompt.rate
        found = settled(columns, known, times, load_scene(model.layout.scene) if scene is None else scene)
        columns, notes = found.columns, found.notes
    return Play(
        prompt=prompt,
        state=state,
        known=given.known,
        constants=given.constants,
        columns=columns,
        settled=notes,
        plan=plan,
        warnings=(*rate_warnings(plan, model.options.rates), *unheld_values(prompt, columns)),
    )


def words_of(model: AnimationModel, texts: tuple[str, ...]) -> Words:
    """Features of the texts by the model's own encoder, on its device."""
    if texts:
        tokens, mask = model.text_tokens(texts)
        return Words(tokens=tokens.float(), mask=mask)
    nothing = torch.zeros(0, 1, model.options.encoder_width, device=model.device)
    return Words(tokens=nothing, mask=torch.zeros(0, 1, dtype=torch.bool, device=model.device))


def fill_sequence(
    fill: Fill,
    given: Given,
    words: Words,
    plan: Plan,
    layout: Layout,
    generator: torch.Generator,
    said: Callable[[int, int], None] = said_nothing,
) -> Float[np.ndarray, "frames channels"]:
    """Standardised states of all frames: what is given to the bit, the rest as `fill` has it.

    Windows in which nothing is left to make are not asked for.
    """
    state, done = given.state.copy(), given.known.copy()
    told = given.known[:, layout.property_of_channel]
    made = 0
    for pieces in plan.pieces():
        for part in _parts(pieces, done):
            windows, known = _windows(state, done, given, words, part, plan.rate, layout)
            text_known = windows.text >= 0
            filled = fill(windows, known, text_known, generator).float().cpu().numpy()
            taken = part.made
            state[part.frames[taken]] = filled[taken]
            state = np.where(told, given.state, state)
            done[part.frames[taken]] = True
        made += int(pieces.made.sum())
        said(made, len(state))
    return state


def _parts(pieces: Pieces, done: Bool[np.ndarray, "frames properties"]) -> list[Pieces]:
    """The windows in which there is something to make, so many at a time."""
    open_ = pieces.made & ~done[pieces.frames].all(axis=-1)
    rows = np.flatnonzero(open_.any(axis=1))
    cuts = [rows[start : start + AT_ONCE] for start in range(0, len(rows), AT_ONCE)]
    return [Pieces(frames=pieces.frames[cut], made=pieces.made[cut]) for cut in cuts]


def _windows(
    state: Float[np.ndarray, "frames channels"],
    done: Bool[np.ndarray, "frames properties"],
    given: Given,
    words: Words,
    pieces: Pieces,
    rate: float,
    layout: Layout,
) -> tuple[Windows, Bool[Tensor, "B T P"]]:
    """What the model is shown of the sequence, and which of it is known."""
    device, frames = words.tokens.device, pieces.frames
    count, length = frames.shape
    known = done[frames]
    shown = wound_in(layout, state[frames], known)
    span = frames[:, -1] - frames[:, 0]
    rates = rate * (length - 1) / np.maximum(span, 1) if length > 1 else np.full(count, rate)
    constants = np.tile(given.constants.astype(np.float32), (count, 1))
    windows = Windows(
        state=torch.from_numpy(shown),
        valid=torch.ones(known.shape, dtype=torch.bool),
        rate=torch.from_numpy(rates.astype(np.float32)),
        constants=torch.from_numpy(constants),
        text=torch.from_numpy(given.text[frames]),
        tokens=words.tokens,
        token_mask=words.mask,
        names=tuple(f"frames {first} to {last}" for first, last in frames[:, [0, -1]].tolist()),
    )
    return windows.to(device), torch.from_numpy(known).to(device)


def wound_in(
    layout: Layout, state: Float[np.ndarray, "B T C"], known: Bool[np.ndarray, "B T P"]
) -> Float[np.ndarray, "B T C"]:
    """Windows whose known rotations are tangent vectors as in training; what is not known has zeros.

    The first one known lies within pi and each other one nearest to the one before. All are the same rotations.
    """
    tangent = unstandardise(layout, state)
    for row, entry in enumerate(layout.properties):
        if entry.kind == "rotations":
            vectors = tangent[..., layout.slice_of(row)]
            triples = vectors.reshape(*vectors.shape[:-1], -1, 3)
            tangent[..., layout.slice_of(row)] = nearest_equal(triples, np.zeros(3)).reshape(vectors.shape)
    wound = continuous_known(layout, tangent, known)
    moved = np.abs(wound - unstandardise(layout, state)) > UNHELD
    shown = np.where(moved, standardise(layout, wound), state).astype(np.float32)
    return np.where(known[..., layout.property_of_channel], shown, np.float32(0))


def rate_warnings(plan: Plan, rates: tuple[float, float]) -> tuple[str, ...]:
    """What is to be said of rates that the model was not trained with."""
    stages = {"frames_per_second": plan.rate}
    if len(plan.levels) > 1:
        stages["the first stage"] = plan.keyframe_rate
    low, high = rates[0] * (1 - RATE_SLACK), rates[1] * (1 + RATE_SLACK)
    return tuple(
        f"{name}: expected {rates[0]:g} to {rates[1]:g}, which the model was trained with, got {rate:.4g}"
        for name, rate in stages.items()
        if not low <= rate <= high
    )


def unheld_values(prompt: Prompt, columns: dict[str, Float[np.ndarray, "frames _"]]) -> tuple[str, ...]:
    """What is to be said of fixed values that states cannot hold, as such numbers do not vary in the training data."""
    said = []
    for value in prompt.values:
        if value.column not in columns:
            continue
        made = columns[value.column][value.start : value.end]
        apart = _apart(value.column, made, value.values)
        if apart.max() > UNHELD:
            unit = "rad" if "rotation" in value.column else "m/s" if value.column.endswith("velocity") else "m"
            said.append(
                f"{value.column}: frames {value.start} to {value.end}: expected numbers that vary in the data that the "
                f"model was trained with, got some that do not: they are off by up to {apart.max():.3g} {unit}"
            )
    return tuple(said)


def _apart(
    column: str, made: Float[np.ndarray, "frames numbers"], wanted: Float[np.ndarray, "frames numbers"]
) -> Float[np.ndarray, "frames _"]:
    """How far values are off, in the unit of the column; entry 0 of joint columns does not count."""
    from scipy.spatial.transform import Rotation

    first = 3 if ".joint_" in column else 0
    if "rotation" not in column:
        return np.abs(made - wanted)[:, first:]
    turns = [Rotation.from_rotvec(np.array(v[:, first:]).reshape(-1, 3)) for v in (made, wanted)]
    return (turns[0].inv() * turns[1]).magnitude().reshape(len(made), -1)


def given_spans(play: Play, layout: Layout) -> dict[str, list[list[int]]]:
    """First frame, and frame after the last, of each stretch that the prompt fixes, by column."""
    spans = {}
    for row, entry in enumerate(layout.properties):
        edges = np.flatnonzero(np.diff(play.known[:, row].astype(np.int8), prepend=0, append=0))
        if len(edges):
            spans[entry.column] = edges.reshape(-1, 2).tolist()
    return spans
