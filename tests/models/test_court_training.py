from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from pgm_data.detect.court_network import INPUT_SIZE, CourtNetwork, Letterbox, input_from_cell, input_planes
from pgm_data.scene import load_scene
from pgm_models.detectors.augment import (
    AugmentOptions,
    Warp,
    plain_warp,
    random_look,
    random_warp,
    shuffled,
    warp_picture,
)
from pgm_models.detectors.court_task import CourtTask, CourtTaskOptions, mirror_order, point_loss, truth_of
from pgm_models.detectors.distractors import draw_other_court
from pgm_models.detectors.export import export_court, fold_norms
from pgm_models.detectors.heatmap_net import PRESETS, HeatmapNet, multiply_adds
from pgm_models.train import TrainOptions, train

NAMES = load_scene("tennis").court.all_names
STILL = AugmentOptions(
    flip=0.0, zoom=(1.0, 1.0), rotation_deg=0.0, aspect=0.0, shift=0.0, bars=0.0, colour=0.0, grey=0.0,
    soften=0.0, shade=0.0, occlude=0.0, noise=0.0, jpeg=0.0,
)  # fmt: skip


def test_mirroring_exchanges_left_and_right_and_nothing_else():
    order = mirror_order(NAMES)
    assert [NAMES[i] for i in order] == [
        n.replace("left", "?").replace("right", "left").replace("?", "right") for n in NAMES
    ]
    assert NAMES[order[NAMES.index("near_service_T")]] == "near_service_T"
    np.testing.assert_array_equal(order[order], np.arange(len(NAMES)))


def test_mirroring_needs_both_sides():
    with pytest.raises(ValueError, match="none called 'right_post'"):
        mirror_order(("left_post", "centre"))


def test_a_mirrored_frame_has_each_name_where_its_mirror_image_was(toy_frames):
    frame = toy_frames(1).clips[0].frame(0)
    width, order = frame.bgr.shape[1], mirror_order(NAMES)
    mirror = Warp(
        input_from_picture=np.array([[-1.0, 0, width - 1], [0, 1, 0]]),
        mirrored=True,
        window=(-0.5, -0.5, 1000.0, 1000.0),
    )
    truth = truth_of(frame, mirror, order)
    left, right = NAMES.index("near_left_doubles"), NAMES.index("near_right_doubles")
    seen = input_from_cell(truth.cells)
    np.testing.assert_allclose(
        seen[left], [width - 1 - frame.points_px[right, 0], frame.points_px[right, 1]], atol=1e-9
    )
    assert seen[left, 0] < seen[right, 0]


@given(st.integers(0, 10_000))
def test_a_warp_moves_the_picture_as_it_moves_the_points(seed):
    rng = np.random.default_rng(seed)
    warp = random_warp((640, 360), rng, replace(AugmentOptions(), bars=0.0))
    dot = rng.uniform([200, 100], [440, 260])
    x, y = np.meshgrid(np.arange(640), np.arange(360))
    glow = 250 * np.exp(-0.5 * ((x - dot[0]) ** 2 + (y - dot[1]) ** 2) / 4.0**2)
    picture = np.repeat(glow.astype(np.uint8)[:, :, None], 3, axis=2)
    seen = warp_picture(picture, warp, np.random.default_rng(0))[:, :, 0].astype(float)
    expected = warp.points(dot)
    if not (np.all(expected > 30) and np.all(expected < np.array(INPUT_SIZE) - 30)):
        return
    near = seen * ((np.abs(np.indices(seen.shape)[::-1] - expected[:, None, None]) < 25).all(axis=0))
    centre = np.array([(near * np.arange(seen.shape[1])).sum(), (near * np.arange(seen.shape[0])[:, None]).sum()])
    np.testing.assert_allclose(centre / near.sum(), expected, atol=0.15)


def test_the_plain_warp_is_the_readers_letterbox():
    for size in [(640, 360), (1920, 1080), (300, 700), (1001, 333)]:
        pixels = np.array([[0.0, 0.0], [size[0] - 1.0, size[1] - 1.0], [17.3, 40.9]])
        np.testing.assert_allclose(
            plain_warp(size).points(pixels), Letterbox(picture_size=size).input_from_picture(pixels), atol=1e-9
        )


def test_points_outside_are_absent_and_points_just_outside_do_not_count(toy_frames):
    frame = toy_frames(1).clips[0].frame(0)
    points = np.array([[10.0, 10.0], [-0.4, 5.0], [-3.0, 5.0], [-60.0, 5.0], [np.nan, np.nan]])
    frame = replace(frame, points_px=np.concatenate([points, np.full((12, 2), np.nan)]))
    truth = truth_of(frame, plain_warp((640, 360)), np.arange(17))
    assert truth.present[:5].tolist() == [True, True, False, False, False]
    assert truth.counted[:5].tolist() == [True, True, False, True, True]


def test_batches_repeat_and_differ(toy_frames):
    frames = toy_frames(16)
    court = load_scene("tennis").court
    one, two = (
        CourtTask(court, lambda: frames, CourtTaskOptions(batch=4, other_courts=1.0, tiles=0.2), AugmentOptions())
        for _ in range(2)
    )
    for index in (0, 7):
        for name, value in one.batch(index).tensors.items():
            assert torch.equal(value, two.batch(index).tensors[name]), name
    assert not torch.equal(one.batch(0).tensors["picture"], one.batch(1).tensors["picture"])


def test_every_change_of_looks_keeps_the_shape_and_changes_the_picture():
    picture = np.random.default_rng(0).integers(0, 255, (288, 512, 3), dtype=np.uint8)
    names = ("colour", "grey", "soften", "shade", "occlude", "noise", "jpeg")
    for name in names:
        changed = random_look(picture, np.random.default_rng(3), replace(STILL, **{name: 1.0}))
        assert changed.shape == picture.shape and changed.dtype == np.uint8
        assert not np.array_equal(changed, picture), name
    np.testing.assert_array_equal(random_look(picture, np.random.default_rng(3), STILL), picture)
    assert shuffled(picture, np.random.default_rng(0)).shape == picture.shape


def test_another_sports_court_is_drawn_only_where_ours_is_seen(toy_frames):
    clip = toy_frames(8).clips[0]
    blank = np.zeros((360, 640, 3), np.uint8)
    drawn = draw_other_court(blank, clip.frame(0), np.random.default_rng(0))
    assert drawn.any() and not blank.any()
    assert not clip.frame(7).has_court
    assert draw_other_court(blank, clip.frame(7), np.random.default_rng(0)) is blank


def test_loss_is_nothing_for_the_perfect_answer_and_more_for_any_other():
    cells = torch.tensor([[[20.3, 11.8], [0.0, 0.0]]])
    present, counted = torch.tensor([[True, False]]), torch.ones(1, 2, dtype=torch.bool)
    x, y = torch.arange(128.0), torch.arange(72.0)

    def answer(shift):
        maps = torch.full((1, 2, 72, 128), -60.0)
        maps[0, 0] = -0.5 * ((x - 20.3 - shift) ** 2 + (y[:, None] - 11.8) ** 2)
        return point_loss(maps, torch.tensor([[-60.0, 60.0]]), cells, present, counted, 1.0)

    values = [float(answer(shift)) for shift in (0.0, 0.5, 1.0, 3.0)]
    assert values[0] == pytest.approx(0.0, abs=1e-4)
    assert all(a < b for a, b in pairwise(values))
    assert values[2] == pytest.approx(0.25, abs=1e-3)  # half a squared standard deviation, averaged over two points


@pytest.mark.parametrize("preset", list(PRESETS))
def test_presets_keep_their_size_promises(preset):
    network = HeatmapNet(17, PRESETS[preset])
    assert sum(p.numel() for p in network.parameters()) < 1_000_000
    assert multiply_adds(network, torch.zeros(1, 3, INPUT_SIZE[1], INPUT_SIZE[0])) < 550e6


def test_nano_learns_a_handful_of_pictures(toy_frames, tmp_path):
    frames = toy_frames(8)
    few = np.array([[0, 1], [0, 3], [0, 5], [0, 7]])
    frames = replace(frames, training=few, held_out=few)
    court = load_scene("tennis").court
    options = CourtTaskOptions(preset="nano", batch=4, tiles=0.0, other_courts=0.0)
    task = CourtTask(court, lambda: frames, options, STILL)
    torch.manual_seed(0)
    training = TrainOptions(steps=80, learning_rate=1e-2, average=0.9, log_every=1000, threads=1)
    outcome = train(HeatmapNet(17, PRESETS["nano"]), task, training, tmp_path / "run", provenance={})
    figures = task.validate(outcome.network)
    assert figures["median_px"] < 1.5
    assert figures["found"] > 0.9
    assert figures["no_court_top_score_p95"] < 0.1


def test_onnx_equals_torch_and_carries_the_names(tmp_path):
    torch.manual_seed(0)
    network = HeatmapNet(17, PRESETS["nano"]).train()
    with torch.no_grad():
        for _ in range(3):  # norms with statistics and weights that folding must not lose
            network(torch.rand(2, 3, INPUT_SIZE[1], INPUT_SIZE[0]))
        for parameter in network.parameters():
            parameter.add_(0.05 * torch.randn_like(parameter))
    network.eval()
    path = tmp_path / "court.onnx"
    export_court(network, NAMES, path, about={"step": 3})
    reader = CourtNetwork.load(path, network_file="", names=NAMES)
    picture = np.random.default_rng(0).integers(0, 255, (INPUT_SIZE[1], INPUT_SIZE[0], 3), dtype=np.uint8)
    planes = input_planes(picture)[None]
    with torch.no_grad():
        expected = network(torch.from_numpy(planes))
        folded = fold_norms(network)(torch.from_numpy(planes))
    got = reader.logits(planes)
    for a, b, c in zip(expected, folded, got, strict=True):
        assert float((a - b).abs().max()) < 1e-4
        np.testing.assert_allclose(a.numpy(), c, atol=1e-4)
    assert not list(tmp_path.glob("*.data"))
