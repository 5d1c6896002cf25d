"""Where a clip's video is looked for."""

import hashlib
import json
from pathlib import Path

import pytest

from pgm_data.convert.frame_pictures import source_video
from pgm_data.convert.posed_pictures import FieldError

CONTENT = b"a video"
DOCUMENT = {"source_path": "match/a.mp4", "sha256": hashlib.sha256(CONTENT).hexdigest()}


def made_of(work: Path, *given: Path) -> None:
    work.mkdir()
    (work / "run.json").write_text(json.dumps({"options": {"videos": [str(path) for path in given]}}))


@pytest.mark.parametrize("given", ["elsewhere", "elsewhere/match", "elsewhere/match/a.mp4"])
def test_a_video_is_found_where_the_run_that_made_the_folder_read_it(tmp_path, given):
    video = tmp_path / "elsewhere" / "match" / "a.mp4"
    video.parent.mkdir(parents=True)
    video.write_bytes(CONTENT)
    made_of(tmp_path / "work", tmp_path / given)
    assert source_video(tmp_path / "work", DOCUMENT, None) == video
    video.write_bytes(b"another")
    with pytest.raises(FieldError, match="sha256"):
        source_video(tmp_path / "work", DOCUMENT, None)


@pytest.mark.parametrize("run", ["{}", "no json", '{"options": {"videos": 3}}'])
def test_a_run_that_does_not_say_leaves_the_video_missing(tmp_path, run):
    (tmp_path / "run.json").write_text(run)
    with pytest.raises(FieldError, match="nothing there"):
        source_video(tmp_path, DOCUMENT, None)
