"""One small packed dataset of tennis that the tests of this folder share and copy before they spoil it."""

from pathlib import Path

import pytest

from pgm_data.dataset.check import check_paths
from pgm_data.dataset.pack import pack_work_folders
from pgm_data.scene import load_scene
from tests.simulate.store_worlds import write_truth_clip

SMALL_LENGTHS = {"a.00": 30, "a.01": 1, "b": 24, "c.00": 25, "c.01": 27, "d": 26}
"""Frames of its clips; a letter is a match."""


@pytest.fixture(scope="session")
def small_work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Clips of truth about four matches."""
    work = tmp_path_factory.mktemp("small") / "work"
    for seed, (name, frames) in enumerate(SMALL_LENGTHS.items()):
        write_truth_clip(work / name, load_scene("tennis"), frames=frames, match_id=name[0], seed=seed)
    return work


@pytest.fixture(scope="session")
def small_dataset(small_work: Path) -> Path:
    """The same packed, with nothing wrong in it; not to be changed."""
    out = small_work.parent / "dataset"
    outcome = pack_work_folders([small_work], out)
    assert outcome.problems == () and sum(outcome.clips.values()) == len(SMALL_LENGTHS)
    assert check_paths([out]) == []
    return out
