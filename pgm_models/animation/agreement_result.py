"""How often words and deeds agree, counted: the rows of an agreement, what chance would reach, and its table."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from pgm_data.caption.claims import Claims
from pgm_models.animation.hit_windows import FIELDS, SHOT, TARGET, HitWindows

Words = Literal["right", "reworded", "shuffled", "none"]
"""Which texts a model is given: the main captions, others of the same spans, those of other windows, or none."""
ROWS = ("ceiling", *get_args(Words), "shuffled, as told", "chance", "commonest")
"""What is measured. `as told`: against the captions that were given; else always against the window's own."""
PARTS: Mapping[str, tuple[str, ...]] = {**{name: (name,) for name in FIELDS}, "shot": SHOT, "target": TARGET}
"""What must agree, each of those that are claimed: single fields, and the shot and its target as a whole."""
KINDS = ("all", "serves", "rally")
Read = Mapping[str, str] | None


@dataclass(frozen=True, kw_only=True)
class AgreementRow:
    """How often something agrees with what captions claim."""

    words: str
    """Of `ROWS`."""
    part: str
    """Of `PARTS`."""
    kind: str
    """Of `KINDS`: which hits."""
    windows: int
    """Whose caption claims it."""
    agreed: float
    """How many of them agree; of chance, as many as are to be expected."""
    read: int
    """In how many of them the rules can tell at all."""

    @property
    def share(self) -> float:
        """Of the windows whose caption claims it; NaN of none."""
        return self.agreed / self.windows if self.windows else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """Of the share, 95 %. Source: Wilson, J. Am. Stat. Assoc. 22 (1927)."""
        if not self.windows:
            return float("nan"), float("nan")
        z, n = 1.959963984540054, self.windows
        middle = (self.share + z**2 / (2 * n)) / (1 + z**2 / n)
        reach = z / (1 + z**2 / n) * (self.share * (1 - self.share) / n + z**2 / (4 * n**2)) ** 0.5
        return max(middle - reach, 0.0), min(middle + reach, 1.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class AgreementResult:
    """Whether play does what the words say."""

    rows: tuple[AgreementRow, ...]
    windows: int
    rate: float
    """Of the states that are read, frames a second; the mean over windows."""
    hit: Mapping[str, float]
    """Of the ceiling and of each kind of words, in what share of windows the player hits the ball at all."""

    def row(self, words: str, part: str, kind: str = "all") -> AgreementRow:
        """The row of that name.

        Raises:
            ValueError: If there is none.
        """
        for row in self.rows:
            if (row.words, row.part, row.kind) == (words, part, kind):
                return row
        raise ValueError(f"agreement: expected words, part and kind that were measured, got {words}, {part}, {kind}")


def _claimed(claims: Claims, part: str) -> dict[str, str]:
    """What a caption claims of a part: its fields that are not empty."""
    said = {name: str(getattr(claims, name)) for name in PARTS[part]}
    return {name: word for name, word in said.items() if word}


def _of_kind(claims: Claims, kind: str) -> bool:
    return kind == "all" or (claims.stroke == "serve") == (kind == "serves")


def tallied(words: str, claims: Sequence[Claims], reads: Sequence[Read]) -> list[AgreementRow]:
    """How often what was read agrees with the claims, window by window."""
    rows = []
    for part in PARTS:
        for kind in KINDS:
            pairs = [
                (said, read)
                for caption, read in zip(claims, reads, strict=True)
                if _of_kind(caption, kind) and (said := _claimed(caption, part))
            ]
            agreed = sum(_agrees(said, read) for said, read in pairs)
            told = sum(read is not None and all(read[name] for name in said) for said, read in pairs)
            rows.append(
                AgreementRow(words=words, part=part, kind=kind, windows=len(pairs), agreed=float(agreed), read=told)
            )
    return rows


def _agrees(said: Mapping[str, str], read: Read) -> bool:
    return read is not None and all(read[name] == word for name, word in said.items())


def chance_rows(windows: HitWindows, real: Sequence[Read]) -> list[AgreementRow]:
    """Captions against the real hits of all other windows by the same player, serves against serves: on average."""
    rows = []
    serves = np.array([claims.stroke == "serve" for claims in windows.claims])
    for part in PARTS:
        found: list[tuple[str, float, float]] = []
        for row, claims in enumerate(windows.claims):
            same = np.flatnonzero((windows.player == windows.player[row]) & (serves == serves[row]))
            others = [real[k] for k in same.tolist() if k != row]
            said = _claimed(claims, part)
            if said and others:
                told = np.mean([read is not None and all(read[name] for name in said) for read in others])
                kind = "serves" if serves[row] else "rally"
                found.append((kind, float(np.mean([_agrees(said, read) for read in others])), float(told)))
        for kind in KINDS:
            own = [entry for entry in found if kind in ("all", entry[0])]
            agreed, told = sum(entry[1] for entry in own), round(sum(entry[2] for entry in own))
            rows.append(AgreementRow(words="chance", part=part, kind=kind, windows=len(own), agreed=agreed, read=told))
    return rows


def commonest_rows(claims: Sequence[Claims]) -> list[AgreementRow]:
    """The most frequent claim against all: what always saying the same would reach."""
    rows = []
    for part in PARTS:
        for kind in KINDS:
            said = [tuple(sorted(_claimed(caption, part).items())) for caption in claims if _of_kind(caption, kind)]
            said = [entry for entry in said if entry]
            most = max((said.count(entry) for entry in set(said)), default=0)
            rows.append(
                AgreementRow(
                    words="commonest", part=part, kind=kind, windows=len(said), agreed=float(most), read=len(said)
                )
            )
    return rows


def agreement_table(result: AgreementResult, parts: Sequence[str] = tuple(PARTS), kind: str = "all") -> str:
    """Shares in percent with their intervals and counts, a line each kind of words, as Markdown."""
    measured = [words for words in ROWS if any(row.words == words for row in result.rows)]
    lines = [f"| words | {' | '.join(parts)} | hits |", "|---" * (len(parts) + 2) + "|"]
    for words in measured:
        cells = []
        for part in parts:
            row = result.row(words, part, kind)
            low, high = row.interval
            cells.append(f"{100 * row.share:.1f} ({100 * low:.0f} to {100 * high:.0f}) of {row.windows}")
        hit = f"{100 * result.hit[words]:.1f}" if words in result.hit else ""
        lines.append(f"| {words} | {' | '.join(cells)} | {hit} |")
    return "\n".join(lines)


def agreement_to_json(result: AgreementResult) -> dict[str, object]:
    """The result as JSON values."""
    return {
        "windows": result.windows,
        "rate": result.rate,
        "hit": dict(result.hit),
        "rows": [
            {name: getattr(row, name) for name in row.__dataclass_fields__}
            | {"share": None if not row.windows else row.share, "interval": list(row.interval) if row.windows else None}
            for row in result.rows
        ],
    }
