"""Videos from frames that are kept until all are there."""

import weakref

import numpy as np
import pytest

from pgm_data.scene import load_scene
from pgm_data.simulate.mask_files import DEPTH_UNIT_M
from pgm_data.video import open_video
from pgm_models.synthesis.render_layers import Filmer, as_bgr, depth_of, labels_of
from pgm_models.synthesis.render_run import OtherFrames, RenderPlan, begin_parts, beside, render_clip
from pgm_models.synthesis.render_source import RenderClip, find_clip, read_clip
from tests.models.synthesis.drawn_matches import write_drawn_clip
from tests.models.synthesis.toy_models import PICTURE, toy_model

FRAMES = 6
BLACK = 4
"""Frame without a camera."""


@pytest.fixture(scope="module")
def model():
    return toy_model()


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """A clip without a video, one frame of which has no camera."""
    folder, scene = tmp_path_factory.mktemp("work") / "rally", load_scene("tennis")
    write_drawn_clip(folder, scene, match=0, frames=FRAMES)
    read = read_clip(find_clip(folder), scene, PICTURE)
    row = np.array([0, 1, 2, 3, -1, 5])
    return RenderClip(name=read.name, store=read.store, row=row, rate=read.rate)


def filmer(model):
    return Filmer(model, model.match_styles["match0"][None], PICTURE)


def plan(folder, name="a.mkv", **changes):
    (folder / "parts" / ".pgm").mkdir(parents=True, exist_ok=True)
    values = {"frames": range(FRAMES), "fps": 25.0, "crf": 0, "depth": True, "masks": True}
    return RenderPlan(out=folder / name, parts=folder / "parts", **{**values, **changes})


def frames_of(path):
    """Frames of a video of labels or depth."""
    import av

    with av.open(str(path)) as container:
        return np.stack([frame.to_ndarray() for frame in container.decode(video=0)])


def luma(bgr):
    """Brightness by BT.709, which halving the resolution of colours leaves alone."""
    return bgr.astype(float) @ [0.0722, 0.7152, 0.2126]


def test_a_video_shows_the_frames_and_its_masks_are_the_simulators(model, clip, tmp_path):
    told = []
    outcome = render_clip(clip, filmer(model), plan(tmp_path), lambda done, speed: told.append(done))
    assert outcome.written == tuple(tmp_path / name for name in ("a.mkv", "a.labels.mkv", "a.depth.mkv"))
    assert outcome.rendered == FRAMES - 1 and outcome.samples > 0
    assert told == list(range(1, FRAMES + 1))
    with open_video(outcome.written[0]) as reader:
        video = [frame.bgr() for frame in reader]
    labels, depth = (frames_of(path) for path in outcome.written[1:])
    assert len(video) == len(labels) == len(depth) == FRAMES
    assert labels.dtype == np.uint8 and depth.dtype == np.uint16
    other = filmer(model)
    for number in range(FRAMES):
        if number == BLACK:
            assert video[number].max() <= 1 and not labels[number].any() and not depth[number].any()
            continue
        camera, states = clip.store.cameras[number], clip.store.states([number])
        picture = other.moving(camera, states)
        assert np.abs(luma(video[number]) - luma(as_bgr(picture))).mean() < 4
        np.testing.assert_array_equal(labels[number], labels_of(picture))
        metres = depth_of(picture, camera)
        seen = np.isfinite(metres) & (metres < 131)
        np.testing.assert_allclose(depth[number][seen] * DEPTH_UNIT_M, metres[seen], atol=0.51 * DEPTH_UNIT_M)
        assert not depth[number][~np.isfinite(metres)].any()


def test_an_interrupted_video_goes_on_and_is_the_same_to_the_byte(model, clip, tmp_path):
    whole = plan(tmp_path, "whole.mp4", depth=False)
    render_clip(clip, filmer(model), whole, lambda done, speed: None)
    broken = plan(tmp_path / "b", "broken.mp4", depth=False)

    def stop(done, speed):
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render_clip(clip, filmer(model), broken, stop)
    assert not broken.out.exists() and len(list(broken.parts.glob("*.labels.png"))) == 3
    kept = {path: path.stat().st_mtime_ns for path in broken.parts.glob("*.png")}
    outcome = render_clip(clip, filmer(model), broken, lambda done, speed: None)
    assert outcome.rendered == FRAMES - 1 - 3
    assert all(path.stat().st_mtime_ns == changed for path, changed in kept.items())
    assert outcome.written == (broken.out, beside(broken.out, "labels.mkv"))
    assert broken.out.read_bytes() == whole.out.read_bytes()
    assert outcome.written[1].read_bytes() == beside(whole.out, "labels.mkv").read_bytes()


def test_nothing_stands_under_the_videos_name_before_it_is_whole(model, clip, tmp_path):
    own = plan(tmp_path, "a.mp4", depth=False, masks=False)
    render_clip(clip, filmer(model), plan(tmp_path, "a.mp4", depth=False, masks=False), lambda done, speed: None)
    own.out.unlink()
    (own.parts / "000005.png").write_bytes(b"cut off")
    with pytest.raises(ValueError, match="000005.png: expected a finished frame, got a file that cannot be read"):
        render_clip(clip, filmer(model), own, lambda done, speed: None)
    assert [path.name for path in tmp_path.iterdir()] == ["parts"]


def test_frames_of_other_options_are_not_gone_on_with(tmp_path):
    begin_parts(tmp_path, {"clip": "a", "style": []})
    begin_parts(tmp_path, {"clip": "a", "style": []})
    with pytest.raises(OtherFrames, match="expected style as of the frames in .*, got .'b'."):
        begin_parts(tmp_path, {"clip": "a", "style": ["b"]})


def test_a_frame_that_cannot_be_rendered_is_named(model, clip, tmp_path):
    def fails(*args, **options):
        raise ValueError("pixels: expected some that the lens has a ray for, got [0, 0]")

    made = filmer(model)
    made.moving = fails
    with pytest.raises(ValueError, match="clip rally, frame 0: pixels: expected some"):
        render_clip(clip, made, plan(tmp_path), lambda done, speed: None)


def test_pictures_are_forgotten_once_they_are_written(model, clip, tmp_path):
    pictures, made = [], filmer(model)
    render = made.moving

    def noted(*args, **options):
        picture = render(*args, **options)
        pictures.append(weakref.ref(picture.features))
        return picture

    made.moving = noted
    alive = []
    render_clip(
        clip, made, plan(tmp_path), lambda done, speed: alive.append(sum(one() is not None for one in pictures))
    )
    assert len(pictures) == FRAMES - 1 and alive == [0] * FRAMES
