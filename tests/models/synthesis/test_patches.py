"""Batches of patches: the same whenever asked for, beside the graphics, with the rays of their own pixels."""

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_data.geometry.camera import project
from pgm_data.scene import Scene, load_scene
from pgm_models.synthesis.frames import FrameStore, frames_of_work
from pgm_models.synthesis.object_boxes import scaled_pixels
from pgm_models.synthesis.patches import (
    PatchOptions,
    PatchSource,
    draw_corner,
    free_corners,
    rays_in,
    states_in,
)
from pgm_models.synthesis.picture_shelf import PictureShelf
from pgm_models.train import Batch
from tests.models.synthesis.drawn_matches import FRAMES, LATER, SIZE, colours, drawn_matches

TENNIS_OBJECTS = len(load_scene("tennis").objects)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return drawn_matches(tmp_path_factory.mktemp("tennis"))


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene("tennis")


@pytest.fixture
def store(folder: Path, scene: Scene) -> FrameStore:
    return frames_of_work(folder / "work", scene=scene)


def same(one: Batch, other: Batch) -> bool:
    """Whether two batches hold the same, bit by bit."""
    assert one.tensors.keys() == other.tensors.keys()
    equal = [
        torch.equal(value.nan_to_num(nan=-7.0), other.tensors[name].nan_to_num(nan=-7.0))
        for name, value in one.tensors.items()
    ]
    return one.names == other.names and all(equal)


def test_a_batch_depends_on_nothing_but_seed_and_number(store: FrameStore) -> None:
    options = PatchOptions(patch=16, patches=2, pairs=2, seed=3)
    source = PatchSource(store, options)
    batches = [source.batch(index) for index in range(5)]
    # Another order, no memory for pictures, and another process's copy.
    forgetful = PatchSource(replace(store, shelf=PictureShelf(0)), options)
    again = pickle.loads(pickle.dumps(source))
    for index in (4, 0, 3, 3):
        assert same(forgetful.batch(index), batches[index]) and same(again.batch(index), batches[index])
    assert not same(batches[0], batches[1])
    assert not same(PatchSource(store, replace(options, seed=4)).batch(0), batches[0])


@pytest.mark.parametrize("limit", [None, (96, 54)])
def test_rays_and_targets_are_of_the_same_pixels(folder: Path, scene: Scene, limit: tuple[int, int] | None) -> None:
    store = frames_of_work(folder / "work", picture=limit, scene=scene)
    batch = PatchSource(store, PatchOptions(patch=16, patches=3, pairs=2)).batch(1)
    rays, targets = rays_in(batch), batch.tensors["targets"]
    rows, patch_frame = batch.tensors["rows"].tolist(), batch.tensors["patch_frame"].tolist()
    assert targets.shape == (12, 3, 16, 16) and patch_frame == [0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3]
    frames = rays.frame.unflatten(0, (12, 256))
    assert frames.tolist() == [[frame] * 256 for frame in patch_frame]
    points = rays.at(torch.full((len(rays),), 7.0)).unflatten(0, (12, 256)).double().numpy()
    for number, frame in enumerate(patch_frame):
        row = rows[frame]
        pixels, seen = project(store.cameras[row], points[number])
        assert seen.all()
        left, top = batch.tensors["patch_corner"][number].tolist()
        x, y = np.meshgrid(np.arange(left, left + 16), np.arange(top, top + 16))
        np.testing.assert_allclose(pixels, np.stack([x.ravel(), y.ravel()], axis=1), atol=2e-3)
        shown = int(store.video_frame[row]) + LATER * int(store.clip[row])
        expected = colours(pixels[:, 0], pixels[:, 1], shown, store.size)
        found = 255 * targets[number].flatten(1).T.numpy()
        assert np.abs(found - expected).max() < 9 and np.abs((found - expected).mean(axis=0)).max() < 2.4
        crop = store.rgb(row)[top : top + 16, left : left + 16]
        np.testing.assert_allclose(found.reshape(16, 16, 3), crop, atol=1e-3)


def test_what_moves_is_that_of_the_frames(store: FrameStore, scene: Scene) -> None:
    batch = PatchSource(store, PatchOptions(patch=8, pairs=3)).batch(0)
    rows = batch.tensors["rows"].numpy()
    found, expected = states_in(batch, scene), store.states(rows)
    for name, poses in expected.poses.items():
        for part, value in vars(poses).items():
            assert torch.equal(getattr(found.poses[name], part), value)
    assert found.balls is not None and expected.balls is not None
    assert torch.equal(found.balls.position, expected.balls.position)
    assert torch.equal(found.balls.path, expected.balls.path) and found.balls.radius == expected.balls.radius
    assert batch.names == tuple(store.place(int(row)) for row in rows)
    assert all(value.dtype in (torch.float32, torch.int64) for value in batch.tensors.values())
    moved = batch.to(torch.device("meta"))
    assert {value.device.type for value in moved.tensors.values()} == {"meta"}


def test_pairs_are_two_frames_of_one_match(store: FrameStore) -> None:
    source = PatchSource(store, PatchOptions(patch=8, pairs=40))
    generator = np.random.default_rng(0)
    rows = np.concatenate([source._pairs(generator) for _ in range(60)])
    assert (store.clip[rows[:, 0]] == store.clip[rows[:, 1]]).all() and (rows[:, 0] != rows[:, 1]).all()
    # Each of the 2 x 36 x 35 pairs is as likely as any other: each frame comes 2400 / 72 times in each place.
    for place in range(2):
        counts = np.bincount(rows[:, place], minlength=2 * FRAMES)
        assert counts.min() > 10 and counts.max() < 65
    steps = (rows[:, 1] - rows[:, 0]) % FRAMES
    assert len(np.unique(steps)) == FRAMES - 1


def test_a_match_of_one_frame_pairs_it_with_itself(store: FrameStore) -> None:
    alone = store[np.array([3, 40, 50])]
    batch = PatchSource(alone, PatchOptions(patch=8, pairs=20, swap=1.0)).batch(0)
    rows = batch.tensors["rows"].reshape(-1, 2).numpy()
    assert {tuple(pair) for pair in rows.tolist()} == {(0, 0), (1, 2), (2, 1)}
    one = PatchSource(store[np.array([7])], PatchOptions(patch=8)).batch(5)
    assert one.tensors["rows"].tolist() == [0, 0]


def test_styles_are_swapped_where_both_frames_see_the_same_person(store: FrameStore) -> None:
    source = PatchSource(store, PatchOptions(patch=8, pairs=80))
    wears = source.batch(0).tensors["wears"]
    own = torch.arange(160)[:, None]
    other = (own // 2) * 2 + 1 - own % 2
    assert ((wears == own) | (wears == other)).all()
    swapped = (wears == other).float()
    assert torch.equal(swapped[::2], swapped[1::2]), "both frames of a pair or none"
    assert swapped.shape == (160, TENNIS_OBJECTS) and (swapped.mean(dim=0) - 0.5).abs().max() < 0.2
    for swap, expected in ((0.0, own), (1.0, other)):
        always = PatchSource(store, PatchOptions(patch=8, pairs=9, swap=swap)).batch(0).tensors["wears"]
        assert torch.equal(always, expected[:18].expand(18, TENNIS_OBJECTS))


def test_styles_stay_where_people_change_or_are_not_seen(store: FrameStore) -> None:
    identity, boxes = store.identity.copy(), store.boxes_px.copy()
    changed = np.arange(len(store)) % 2 == 0
    identity[changed] = identity[changed][:, ::-1]  # they change ends
    identity[:, 1] = np.where(np.arange(len(store)) % 3 == 0, -1, identity[:, 1])
    gone = np.arange(len(store)) % 5 == 0
    boxes[gone, 2] = np.nan
    store = replace(store, identity=identity, boxes_px=boxes)
    batch = PatchSource(store, PatchOptions(patch=8, pairs=30, swap=1.0)).batch(0)
    pairs = batch.tensors["rows"].reshape(-1, 2).numpy()
    swapped = (batch.tensors["wears"][::2] != torch.arange(0, 60, 2)[:, None]).numpy()
    np.testing.assert_array_equal(swapped[:, 2], ~gone[pairs].any(axis=1))
    for number in range(2):
        one, other = identity[pairs[:, 0], number], identity[pairs[:, 1], number]
        np.testing.assert_array_equal(swapped[:, number], (one == other) | (one < 0) | (other < 0))
    assert swapped[:, 3:].all() and 0 < swapped[:, 0].sum() < 30


def overlap(batch: Batch, store: FrameStore, objects: list[int], patch: int) -> np.ndarray:
    """Whether each patch touches the box of one of the objects."""
    corners = batch.tensors["patch_corner"].numpy()
    rows = batch.tensors["rows"].numpy()[batch.tensors["patch_frame"].numpy()]
    boxes = store.boxes_px[rows][:, objects]
    low, high = corners[:, None] - 0.5, corners[:, None] + patch - 0.5
    return ((boxes[..., :2] <= high) & (boxes[..., 2:] >= low)).all(axis=2).any(axis=1)


def test_patches_show_players_and_ball_as_often_as_asked(store: FrameStore) -> None:
    patch = 6
    for players, ball, objects in ((1.0, 0.0, [0, 1]), (0.0, 1.0, [2])):
        options = PatchOptions(patch=patch, patches=20, pairs=3, players=players, ball=ball)
        batch = PatchSource(store, options).batch(0)
        # A little of them is hidden by graphics.
        assert overlap(batch, store, objects, patch).mean() > 0.9
    everywhere = PatchSource(store, PatchOptions(patch=patch, patches=100, pairs=2, players=0.0, ball=0.0)).batch(0)
    shares = [overlap(everywhere, store, [each], patch).mean() for each in (0, 1, 2)]
    mixed = PatchSource(store, PatchOptions(patch=patch, patches=150, pairs=4)).batch(0)
    there = [overlap(mixed, store, [each], patch).mean() for each in (0, 1, 2)]
    assert shares[2] < 0.03 and 0.27 < there[2] < 0.45
    assert 0.14 < there[0] < 0.14 + 0.5 and 0.14 < there[1] < 0.3, "each player a sixth, and some by chance"


def test_where_nobody_is_patches_lie_anywhere(store: FrameStore) -> None:
    boxes = store.boxes_px.copy()
    boxes[:, :3] = np.nan
    poses = {name: np.full_like(values, np.nan) for name, values in store.rotations.items()}
    empty = replace(
        store, boxes_px=boxes, rotations=poses, translations=poses, ball_position=store.ball_position * np.nan
    )
    batch = PatchSource(empty, PatchOptions(patch=8, patches=100, pairs=2)).batch(0)
    assert not states_in(batch, store.scene).poses["player0"].present.any()
    corners = batch.tensors["patch_corner"].float()
    assert (corners.mean(dim=0) - torch.tensor([92.0, 50.0])).abs().max() < 12
    assert torch.isnan(batch.tensors["boxes_px"][:, :3]).all()


def test_no_patch_touches_graphics(store: FrameStore) -> None:
    for patch in (8, 40):
        batch = PatchSource(store, PatchOptions(patch=patch, patches=60, pairs=2)).batch(2)
        rows = batch.tensors["rows"][batch.tensors["patch_frame"]].tolist()
        for row, (left, top) in zip(rows, batch.tensors["patch_corner"].tolist(), strict=True):
            assert 0 <= left <= SIZE[0] - patch and 0 <= top <= SIZE[1] - patch
            for x0, y0, x1, y1 in store.ui_boxes_px(row):
                beside = left > x1 or left + patch - 1 < x0 or top > y1 or top + patch - 1 < y0
                assert beside, (left, top, x0, y0, x1, y1)


BOX = st.tuples(st.floats(-30, 50), st.floats(-30, 50), st.floats(0.01, 40), st.floats(0.01, 40))


@settings(max_examples=60)
@given(boxes=st.lists(BOX, max_size=3), patch=st.integers(1, 12))
def test_free_corners_are_those_that_looking_at_each_pixel_finds(boxes: list, patch: int) -> None:
    ui = np.array([[x, y, x + width, y + height] for x, y, width, height in boxes]).reshape(-1, 4)
    x, y = np.meshgrid(np.arange(23), np.arange(17))
    hidden = np.zeros((17, 23), dtype=bool)
    for x0, y0, x1, y1 in ui:
        hidden |= (x + 0.5 > x0 - 1) & (x - 0.5 < x1 + 1) & (y + 0.5 > y0 - 1) & (y - 0.5 < y1 + 1)
    expected = np.array(
        [[not hidden[t : t + patch, le : le + patch].any() for le in range(24 - patch)] for t in range(18 - patch)]
    )
    np.testing.assert_array_equal(free_corners((23, 17), patch, ui), expected)


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6), patch=st.integers(1, 17))
def test_a_drawn_patch_is_free_and_shows_its_aim_where_it_can(seed: int, patch: int) -> None:
    rng = np.random.default_rng(seed)
    free = rng.random((18 - patch, 24 - patch)) < 0.5
    free[rng.integers(len(free)), rng.integers(free.shape[1])] = True
    x, y = rng.uniform([-5, -5], [22, 16])
    aim = np.array([x, y, max(x + rng.uniform(0, 9), 0.0), max(y + rng.uniform(0, 9), 0.0)])
    left, top = draw_corner(free, patch, aim, (23, 17), rng)
    assert free[top, left]
    anywhere = draw_corner(np.ones_like(free), patch, aim, (23, 17), rng)
    pixels = np.clip(np.array([aim[:2], aim[2:]]), -0.5, [22.5, 16.5])
    assert (np.array(anywhere) <= pixels[1] + 0.5).all() and (np.array(anywhere) + patch - 1 >= pixels[0] - 0.5).all()


def test_a_patch_lies_evenly_about_a_point() -> None:
    rng = np.random.default_rng(0)
    free = np.ones((97, 97), dtype=bool)
    drawn = np.array([draw_corner(free, 4, np.array([50.0, 60, 50, 60]), (100, 100), rng) for _ in range(1600)])
    counts = np.zeros((4, 4), dtype=int)
    np.add.at(counts, (drawn[:, 0] - 47, drawn[:, 1] - 57), 1)
    assert counts.sum() == 1600 and counts.min() > 60 and counts.max() < 145


def test_graphics_over_everything_are_refused(store: FrameStore) -> None:
    covered = [replace(clip, ui_boxes_px=np.array([[-5.0, -5.0, 500.0, 500.0]])) for clip in store.clips]
    expected = "clip match1: ui_boxes_px: expected room beside them for a patch of 8 pixels in a picture of 192x108"
    with pytest.raises(ValueError, match=expected):
        PatchSource(replace(store, clips=(store.clips[0], covered[1])), PatchOptions(patch=8))
    # A clip of which no frame is used may be covered.
    PatchSource(replace(store, clips=(store.clips[0], covered[1]))[np.arange(5)], PatchOptions(patch=8))
    half = [replace(clip, ui_boxes_px=np.array([[-5.0, 40.0, 500.0, 500.0]])) for clip in store.clips]
    source = PatchSource(replace(store, clips=tuple(half)), PatchOptions(patch=39, patches=9))
    assert (source.batch(0).tensors["patch_corner"][:, 1] <= 0).all()
    with pytest.raises(ValueError, match="match0: ui_boxes_px: expected room"):
        PatchSource(replace(store, clips=tuple(half)), PatchOptions(patch=40))


def test_a_patch_as_large_as_the_picture_is_the_picture(store: FrameStore) -> None:
    bare = replace(store, clips=tuple(replace(clip, ui_boxes_px=np.zeros((0, 4))) for clip in store.clips))
    batch = PatchSource(bare, PatchOptions(patch=SIZE[1])).batch(0)
    assert (batch.tensors["patch_corner"][:, 1] == 0).all()
    with pytest.raises(ValueError, match="patch: expected at most 108, of 192x108, got 109"):
        PatchSource(bare, PatchOptions(patch=109))


def test_one_pixel_is_a_patch(store: FrameStore) -> None:
    batch = PatchSource(store, PatchOptions(patch=1, patches=5)).batch(0)
    assert batch.tensors["targets"].shape == (10, 3, 1, 1) and len(rays_in(batch)) == 10


def test_whole_pictures_are_scaled_with_their_boxes(store: FrameStore) -> None:
    full = PatchSource(store, PatchOptions(patch=8, seed=1)).batch(0)
    small = PatchSource(store, PatchOptions(patch=8, seed=1, whole=48)).batch(0)
    assert full.tensors["pictures"].shape == (2, 3, 108, 192) and small.tensors["pictures"].shape == (2, 3, 27, 48)
    row = int(full.tensors["rows"][0])
    np.testing.assert_allclose(full.tensors["pictures"][0], store.picture(row))
    np.testing.assert_array_equal(full.tensors["boxes_px"], store.boxes_px[full.tensors["rows"].numpy()])
    average = torch.nn.functional.avg_pool2d(full.tensors["pictures"], 4)
    assert (small.tensors["pictures"] - average).abs().max() < 1 / 255
    expected = scaled_pixels(full.tensors["boxes_px"].reshape(-1, 2).double().numpy(), np.array([0.25, 0.25]))
    np.testing.assert_allclose(small.tensors["boxes_px"].reshape(-1, 2), expected, atol=1e-4)
    assert torch.equal(small.tensors["targets"], full.tensors["targets"])


def test_frames_of_later_batches_are_decoded_with_those_of_this_one(store: FrameStore) -> None:
    source = PatchSource(store, PatchOptions(patch=8))
    source.batch(0)
    rows = np.concatenate([source.batch(index).tensors["rows"].numpy() for index in range(1, 40)])
    fresh = replace(store, shelf=PictureShelf(8 * 2**20))
    PatchSource(fresh, PatchOptions(patch=8)).batch(0)
    assert all(fresh.kept(int(row)) for row in rows)
    # Where memory does not reach for that, the batch is the same.
    tight = PatchSource(replace(store, shelf=PictureShelf(3 * 192 * 108 * 3)), PatchOptions(patch=8))
    assert same(tight.batch(7), source.batch(7))
    assert tight.store.shelf.cache.used_bytes <= 3 * 192 * 108 * 3


def test_a_scene_without_a_ball_has_batches(tmp_path: Path) -> None:
    store = frames_of_work(drawn_matches(tmp_path, "blocks", matches=1, frames=4) / "work")
    batch = PatchSource(store, PatchOptions(patch=16, patches=4)).batch(0)
    assert not any(name.startswith("ball.") for name in batch.tensors)
    assert states_in(batch, store.scene).balls is None and batch.tensors["wears"].shape == (2, 3)


def test_what_cannot_be_trained_on_is_refused(store: FrameStore) -> None:
    lost = replace(store.clips[1], video=None, no_video="picture: expected the video v.mp4, got nothing there")
    with pytest.raises(ValueError, match="clip match1: picture: expected the video"):
        PatchSource(replace(store, clips=(store.clips[0], lost)), PatchOptions(patch=8))
    with pytest.raises(ValueError, match="store: expected frames, got none"):
        PatchSource(store[np.zeros(0, dtype=np.int64)], PatchOptions(patch=8))
    folded = replace(store.cameras, distortion=np.tile([-30.0, 0, 0, 0], (len(store), 1)))
    source = PatchSource(replace(store, cameras=folded), PatchOptions(patch=100))
    with pytest.raises(ValueError, match=r"clip match\d, frame \d+: pixels: expected some that the lens has a ray for"):
        source.batch(0)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"patch": 0}, "patch: expected 1 or more, got 0"),
        ({"pairs": 0}, "pairs: expected 1 or more"),
        ({"players": 0.7, "ball": 0.6}, "players, ball: expected shares, 1 at most together, got 0.7, 0.6"),
        ({"ball": -0.1}, "players, ball: expected shares"),
        ({"swap": 1.1}, "swap: expected 0 to 1, got 1.1"),
        ({"seed": -1}, "seed: expected 0 or more, got -1"),
    ],
)
def test_options_out_of_range_are_refused(wrong: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        PatchOptions(**({"patch": 8} | wrong))
