"""Features of the tokens of many texts, made once and kept on disk: a frozen encoder says the same each time."""

import hashlib
import json
import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float16, Float32, Int

from pgm_data.dataset.files import TEMPORARY_SUFFIX
from pgm_models.animation.text_encoders import TextEncoder

TOKENS_FILE = "tokens.f16"
"""Numbers of all tokens, one text after the other: float16, little-endian."""
ROWS_FILE = "rows.npz"
"""Where each text's tokens lie, and its digest."""
ABOUT_FILE = "about.json"
"""What made them."""
TEXTS_AT_A_TIME = 256
"""Texts that are encoded or copied before they are written."""
DIGEST_BYTES = 16
"""Of the sum that a text is known by."""
DIGITS_OF_A_KEY = 16
"""Hexadecimal digits that the folder of a list of texts is called by."""


@dataclass(frozen=True, eq=False, kw_only=True)
class TextFeatures:
    """Token features of a list of texts, read from disk where they are asked for; each process opens its own map."""

    folder: Path
    """Where they lie."""
    identity: str
    """Of the encoder that made them."""
    width: int
    """Numbers of a token, E."""
    starts: Int[np.ndarray, " texts"]
    """First token of each text."""
    counts: Int[np.ndarray, " texts"]
    """Tokens of each text."""

    @cached_property
    def _tokens(self) -> Float16[np.ndarray, "tokens E"]:
        return _mapped(self.folder / TOKENS_FILE, self.width)

    def __getstate__(self) -> dict[str, object]:
        """All but the open map."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}

    def rows(self, ids: Int[np.ndarray, " U"]) -> tuple[Float32[np.ndarray, "U L E"], Bool[np.ndarray, "U L"]]:
        """Features of the texts in those rows, padded by zeros to the longest of them; and which are tokens.

        Raises:
            ValueError: If there is no such row.
        """
        bad = (ids < 0) | (ids >= len(self.starts))
        if bad.any():
            raise ValueError(f"ids: expected rows of {len(self.starts)} texts, got {ids[bad][0]}")
        starts, counts = self.starts[ids], self.counts[ids]
        place = np.arange(counts.max(initial=0))
        mask = place < counts[:, None]
        # Padding reads its text's last token, which is surely there.
        index = starts[:, None] + np.minimum(place, counts[:, None] - 1)
        # Torch turns half into single precision many at once, numpy one by one.
        tokens = torch.from_numpy(np.take(self._tokens, index, axis=0)).float()
        return tokens.mul_(torch.from_numpy(mask)[..., None]).numpy(), mask


def text_features(
    texts: Sequence[str],
    encoder: TextEncoder,
    folder: Path,
    *,
    longest: int = 64,
    show: Callable[[str], None] = lambda line: None,
    device: torch.device | str = "cpu",
) -> TextFeatures:
    """Token features of the texts, from the folder where the same encoder made them, else made now and kept there.

    Each list of texts and encoder has a folder of its own inside; a list that shares texts with another has those
    copied. The folder appears when it is whole. Memory does not grow with the number of texts but for 32 bytes each.

    Args:
        texts: What rows refer to; a text may come twice.
        encoder: Frozen.
        folder: Made where it is missing.
        longest: Tokens kept of a text, its first ones and its end token.
        show: Told how far it is.
        device: Where the encoder computes.

    Raises:
        ValueError: If a feature is not finite in float16; names the text.
    """
    if longest < 1:
        raise ValueError(f"longest: expected at least 1, got {longest}")
    digests = _digests(texts)
    key = hashlib.sha256(f"{encoder.identity} {longest} {len(texts)} ".encode() + digests.tobytes()).hexdigest()
    place = folder / f"{encoder.name}-{key[:DIGITS_OF_A_KEY]}"
    if not (place / ABOUT_FILE).is_file():
        temporary = folder / f".{place.name}.{os.getpid()}{TEMPORARY_SUFFIX}"
        temporary.mkdir(parents=True, exist_ok=True)
        try:
            _write(temporary, texts, digests, encoder, longest=longest, show=show, device=device)
            _rename(temporary, place)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
    with np.load(place / ROWS_FILE) as rows:
        return TextFeatures(
            folder=place,
            identity=encoder.identity,
            width=encoder.width,
            starts=rows["starts"],
            counts=rows["counts"],
        )


def _write(
    place: Path,
    texts: Sequence[str],
    digests: np.ndarray,
    encoder: TextEncoder,
    *,
    longest: int,
    show: Callable[[str], None],
    device: torch.device | str,
) -> None:
    """All files of a list of texts, into an empty folder."""
    about = {"identity": encoder.identity, "longest": longest, "width": encoder.width}
    different, first, same = np.unique(digests, return_index=True, return_inverse=True)
    starts, counts = np.zeros((2, len(different)), np.int64)
    earlier, here, there = _shared(place.parent, about, different)
    new = np.setdiff1d(np.arange(len(different)), here)
    end = 0
    with (place / TOKENS_FILE).open("wb") as file:
        for rows in _parts(len(here)):
            kept, tokens = _copied(earlier, there[rows], encoder.width)
            file.write(tokens.tobytes())
            starts[here[rows]], counts[here[rows]] = end + np.cumsum(kept) - kept, kept
            end += len(tokens)
        for rows in _parts(len(new)):
            kept, tokens = _encoded([texts[int(k)] for k in first[new[rows]]], encoder, longest, device)
            file.write(tokens.tobytes())
            starts[new[rows]], counts[new[rows]] = end + np.cumsum(kept) - kept, kept
            end += len(tokens)
            show(f"{encoder.name}: {min(rows.stop, len(new))} of {len(new)} texts")
    np.savez(place / ROWS_FILE, starts=starts[same], counts=counts[same], digests=digests)
    (place / ABOUT_FILE).write_text(json.dumps({**about, "texts": len(texts), "tokens": end}, indent=2) + "\n")


def _parts(rows: int) -> Iterator[slice]:
    return (slice(begin, begin + TEXTS_AT_A_TIME) for begin in range(0, rows, TEXTS_AT_A_TIME))


def _shared(
    folder: Path, about: Mapping[str, object], digests: np.ndarray
) -> tuple[Path, Int[np.ndarray, " shared"], Int[np.ndarray, " shared"]]:
    """The earlier list of texts in the folder that has most of the digests: its folder, their rows here, and there."""
    best = folder, np.zeros(0, np.int64), np.zeros(0, np.int64)
    # Names that begin with a dot are lists that other processes are still writing.
    for file in sorted(folder.glob(f"[!.]*/{ABOUT_FILE}")):
        told = json.loads(file.read_text(encoding="utf-8"))
        if all(told.get(name) == value for name, value in about.items()):
            with np.load(file.with_name(ROWS_FILE)) as rows:
                _, here, there = np.intersect1d(digests, rows["digests"], return_indices=True)
            if len(here) > len(best[1]):
                best = file.parent, here, there
    return best


def _copied(
    place: Path, rows: Int[np.ndarray, " U"], width: int
) -> tuple[Int[np.ndarray, " U"], Float16[np.ndarray, "N E"]]:
    """How many tokens texts of an earlier list have, and all of them, one text after the other."""
    with np.load(place / ROWS_FILE) as earlier:
        starts, counts = earlier["starts"][rows], earlier["counts"][rows]
    index = np.repeat(starts - np.cumsum(counts) + counts, counts) + np.arange(counts.sum())
    return counts, np.take(_mapped(place / TOKENS_FILE, width), index, axis=0)


def _encoded(
    texts: Sequence[str], encoder: TextEncoder, longest: int, device: torch.device | str
) -> tuple[Int[np.ndarray, " U"], Float16[np.ndarray, "N E"]]:
    """How many tokens of each text are kept, and all of them, one text after the other."""
    features, mask = encoder.tokens(texts, device=device)
    place = mask.cumsum(1) - 1
    last = place.amax(1, keepdim=True)
    keep = mask & ((place < longest - 1) | (place == last))
    tokens = features[keep].half()
    if not bool(torch.isfinite(tokens).all()):
        bad = int((~torch.isfinite(features.half()) & keep[..., None]).any(2).any(1).nonzero()[0])
        raise ValueError(f"text {texts[bad][:60]!r}: expected features that are finite in float16, got others")
    return keep.sum(1).numpy(), tokens.numpy()


def _digests(texts: Sequence[str]) -> np.ndarray:
    """A sum of each text, as byte strings, which numpy can sort."""
    sums = b"".join(hashlib.blake2b(text.encode(), digest_size=DIGEST_BYTES).digest() for text in texts)
    return np.frombuffer(sums, f"S{DIGEST_BYTES}")


def _mapped(path: Path, width: int) -> Float16[np.ndarray, "tokens E"]:
    """The tokens of a file, read where they are looked at."""
    if path.stat().st_size == 0:
        return np.zeros((0, width), np.float16)
    return np.asarray(np.memmap(path, "<f2", mode="r").reshape(-1, width))


def _rename(temporary: Path, place: Path) -> None:
    """The folder under its own name; where another process was faster, its folder stays."""
    try:
        temporary.rename(place)
    except OSError:
        if not (place / ABOUT_FILE).is_file():
            raise
