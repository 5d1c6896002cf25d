"""What a generated sequence must hold to: a prompt file, checked against its schema and against what a model knows."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_data.dataset.document_check import law_faults
from pgm_data.dataset.documents import document_faults, parse_document
from pgm_data.geometry.arrays import frozen
from pgm_models.animation.encode import encode_constants, encode_known, standardise
from pgm_models.animation.layout import Constant, Layout, Property

MOST_FRAMES = 1_000_000
"""Longest sequence that is generated."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PromptText:
    """What one player does over one span."""

    player: int
    """Index of the player object."""
    start: int
    """First frame."""
    end: int
    """Frame after the last."""
    text: str


@dataclass(frozen=True, eq=False, kw_only=True)
class PromptValue:
    """One column that is fixed over one span."""

    column: str
    start: int
    """First frame."""
    end: int
    """Frame after the last."""
    values: Float[np.ndarray, "frames numbers"]
    """A row a frame, of the whole column, in its unit."""

    def __post_init__(self) -> None:
        """Keep a read-only copy."""
        object.__setattr__(self, "values", frozen(self.values))


@dataclass(frozen=True, eq=False, kw_only=True)
class Prompt:
    """A prompt that a model with a certain layout can follow. Spans of one column, or player, do not overlap."""

    scene: str
    frames: int
    rate: float
    """Frames a second."""
    seed: int
    """0 where the file does not say."""
    texts: tuple[PromptText, ...]
    values: tuple[PromptValue, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class Given:
    """A prompt in a model's numbers."""

    state: Float[np.ndarray, "frames channels"]
    """Standardised; 0 where nothing is fixed."""
    known: Bool[np.ndarray, "frames properties"]
    """What is fixed."""
    text: Int[np.ndarray, "frames players"]
    """Row of `texts`; -1 where nothing is said."""
    texts: tuple[str, ...]
    """Each different text once."""
    constants: Float[np.ndarray, " constants"]
    """Standardised; 0, the average of the training data, where nothing is fixed."""


def read_prompt(path: Path, layout: Layout) -> Prompt:
    """The prompt in the file.

    Raises:
        ValueError: If it does not hold to the schema `prompt`, or asks for what the layout has not; names file and
            field, what was expected and what was found.
    """
    return prompt_of(parse_document(path), layout, place=str(path))


def prompt_of(document: object, layout: Layout, *, place: str = "prompt") -> Prompt:
    """The prompt that a document of the schema `prompt` says.

    A value is one row for all frames of its span, or one a frame, as wide as its column. Entry 0 of joint columns
    repeats the root and fixes nothing. Bones that do not change within a clip are fixed for all frames at once.

    Raises:
        ValueError: As of `read_prompt`.
    """
    faults = [*document_faults("prompt", document)]
    raw: dict[str, Any] = document if isinstance(document, dict) else {}
    if not faults:
        faults = [*law_faults("prompt", raw)]
    if faults:
        raise ValueError(
            f"{place}: {faults[0].field or 'prompt'}: expected {faults[0].expected}, got {faults[0].found}"
        )
    if raw["scene"] != layout.scene:
        raise ValueError(f"{place}: scene: expected {layout.scene}, which the model knows, got {raw['scene']!r}")
    if raw["n_frames"] > MOST_FRAMES:
        raise ValueError(f"{place}: n_frames: expected at most {MOST_FRAMES}, got {raw['n_frames']}")
    texts = tuple(
        _text(entry, layout, f"{place}: texts[{number}]") for number, entry in enumerate(raw.get("texts", ()))
    )
    values = tuple(
        _value(entry, layout, raw["n_frames"], f"{place}: values[{number}]")
        for number, entry in enumerate(raw.get("values", ()))
    )
    _refuse_overlaps(
        [(layout.players[text.player], text.start, text.end) for text in texts], f"{place}: texts", "a text about"
    )
    _refuse_overlaps([(value.column, value.start, value.end) for value in values], f"{place}: values", "a value of")
    return Prompt(
        scene=raw["scene"],
        frames=raw["n_frames"],
        rate=float(raw["frames_per_second"]),
        seed=raw.get("seed", 0),
        texts=texts,
        values=values,
    )


def prompt_to_json(prompt: Prompt) -> dict[str, object]:
    """The document of the schema `prompt` that says the same."""
    return {
        "scene": prompt.scene,
        "n_frames": prompt.frames,
        "frames_per_second": prompt.rate,
        "seed": prompt.seed,
        "texts": [
            {"player": text.player, "start_frame": text.start, "end_frame": text.end, "text": text.text}
            for text in prompt.texts
        ],
        "values": [
            {"column": value.column, "start_frame": value.start, "end_frame": value.end, "value": rows.tolist()}
            for value in prompt.values
            for rows in (value.values[0] if (value.values == value.values[0]).all() else value.values,)
        ],
    }


def given_by(prompt: Prompt, layout: Layout) -> Given:
    """The prompt in the layout's numbers; rotations within pi of their references."""
    state = np.zeros((prompt.frames, layout.channels), dtype=np.float32)
    known = np.zeros((prompt.frames, len(layout.properties)), dtype=bool)
    generated = {entry.column for entry in layout.properties}
    fixed: dict[str, np.ndarray] = {}
    for value in prompt.values:
        if value.column not in generated:
            fixed[value.column] = value.values[:1]
            continue
        row, span = layout.row_of(value.column), slice(value.start, value.end)
        state[span, layout.slice_of(row)] = encode_known(layout, value.column, value.values)
        known[span, row] = True
    told = known[:, layout.property_of_channel]
    text = np.full((prompt.frames, len(layout.players)), -1, dtype=np.int64)
    texts = tuple(dict.fromkeys(entry.text for entry in prompt.texts))
    for entry in prompt.texts:
        text[entry.start : entry.end, entry.player] = texts.index(entry.text)
    bones = encode_constants(layout, fixed)[0] if fixed else np.zeros(layout.constant_channels, dtype=np.float32)
    return Given(
        state=np.where(told, standardise(layout, state), np.float32(0)),
        known=known,
        text=text,
        texts=texts,
        constants=bones,
    )


def _text(entry: Mapping[str, Any], layout: Layout, place: str) -> PromptText:
    if entry["player"] >= len(layout.players):
        players = ", ".join(f"{number} ({name})" for number, name in enumerate(layout.players)) or "no player"
        raise ValueError(f"{place}.player: expected one of {players}, got {entry['player']}")
    if not entry["text"].strip():
        raise ValueError(f"{place}.text: expected words, got {entry['text']!r}")
    return PromptText(player=entry["player"], start=entry["start_frame"], end=entry["end_frame"], text=entry["text"])


def _value(entry: Mapping[str, Any], layout: Layout, frames: int, place: str) -> PromptValue:
    part = _part(entry["column"], layout, f"{place}.column")
    start, end = entry["start_frame"], entry["end_frame"]
    rows = _rows(entry["value"], part.first + part.width, end - start, f"{place}.value")
    if isinstance(part, Constant) and not (start == 0 and end == frames and (rows == rows[0]).all()):
        got = "values that differ" if start == 0 and end == frames else f"frames {start} to {end}"
        raise ValueError(
            f"{place}: expected one value for all frames, 0 to {frames}, since {part.column} does not change within "
            f"the clips that the model was trained with, got {got}"
        )
    return PromptValue(column=part.column, start=start, end=end, values=rows)


def _part(column: str, layout: Layout, place: str) -> Property | Constant:
    """What of the layout the column is."""
    parts = {entry.column: entry for entry in (*layout.properties, *layout.constants)}
    if column in parts:
        return parts[column]
    names = ", ".join(parts)
    if column.partition(".")[0] in layout.players and column.endswith(".joints"):
        why = "which follows from root and rotations and cannot be fixed"
        raise ValueError(f"{place}: expected one of {names}, got {column!r}, {why}")
    raise ValueError(f"{place}: expected one of {names}, got {column!r}")


def _rows(value: object, width: int, frames: int, place: str) -> Float[np.ndarray, "frames numbers"]:
    """A row a frame, from one for all or one for each."""
    own = f"{width} numbers" if width > 1 else "a number"
    expected = f"{own}, or {frames} times {own}, one a frame" if frames > 1 else own
    if width == 1 and not isinstance(value, list):
        value = [value]
    rows: list = value if isinstance(value, list) else []
    if width == 1 and len(rows) == frames and not any(isinstance(row, list) for row in rows):
        rows = [[number] for number in rows]
    elif not any(isinstance(row, list) for row in rows):
        rows = [rows] * frames
    if len(rows) != frames:
        raise ValueError(f"{place}: expected {expected}, got {len(rows)} rows")
    for number, row in enumerate(rows):
        if not isinstance(row, list) or len(row) != width:
            found = f"{len(row)} numbers" if isinstance(row, list) else repr(row)
            raise ValueError(f"{place}: expected {expected}, got {found} in row {number}")
        stray = [item for item in row if not _is_number(item)]
        if stray:
            raise ValueError(f"{place}: expected {expected}, got {stray[0]!r} in row {number}")
    return np.array(rows, dtype=np.float64)


def _is_number(item: object) -> bool:
    return isinstance(item, int | float) and not isinstance(item, bool) and math.isfinite(item)


def _refuse_overlaps(spans: Sequence[tuple[str, int, int]], place: str, what: str) -> None:
    """Refuse spans about one thing that share a frame."""
    order = sorted(range(len(spans)), key=lambda number: spans[number])
    for before, after in zip(order, order[1:], strict=False):
        name, _, end = spans[before]
        if spans[after][0] == name and spans[after][1] < end:
            raise ValueError(
                f"{place}[{after}]: expected frames without {what} {name}, got frame {spans[after][1]}, "
                f"which {place.rpartition(': ')[2]}[{before}] has"
            )
