"""Which matches of a dataset are learned from, and which are kept apart."""

from pathlib import Path

import pyarrow.parquet as pq

HELD_OUT_SHARE = 0.05
"""Of the matches, where the dataset does not say which ones."""
LEAST_TO_DIVIDE = 3
"""Fewer matches than this are all learned from."""


def divided_matches(dataset: Path) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Matches to learn from, and matches for validation: those of the split `val`, else every twentieth.

    Matches of the split `test` are in neither. A dataset of one or two matches has none for validation.

    Raises:
        ValueError: If the dataset has no episodes.
    """
    found: dict[str, str] = {}
    paths = sorted((dataset / "meta" / "episodes").glob("chunk-*/file-*.parquet"))
    for path in paths:
        rows = pq.read_table(path, columns=["match_id", "split"]).to_pydict()
        found |= dict(zip(rows["match_id"], rows["split"], strict=True))
    if not found:
        raise ValueError(f"{dataset}: expected a packed dataset with episodes, got none in meta/episodes")
    usable = sorted(match for match, split in found.items() if split == "train")
    said = sorted(match for match, split in found.items() if split == "val")
    if said or len(usable) < LEAST_TO_DIVIDE:
        return tuple(usable), tuple(said)
    kept = set(usable[:: round(1 / HELD_OUT_SHARE)])
    return tuple(match for match in usable if match not in kept), tuple(sorted(kept))
