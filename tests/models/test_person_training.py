from functools import cache

import numpy as np
import pytest
import torch
from pgm_cli.train import main

from pgm_data.detect.players.person_network import CHANNELS, PersonCalibration, PersonNetwork, StripPeople, read_peaks
from pgm_data.detect.players.person_strips import FEET_ROW, PERSON_PX
from pgm_data.geometry.camera import project
from pgm_data.scene import load_scene
from pgm_models.detectors.person_backdrops import SIZE, prepare_backdrops
from pgm_models.detectors.person_crops import (
    COLUMNS,
    Piece,
    camera_of,
    cut_piece,
    ground_before,
    piece_map,
    random_piece,
    seen_people,
    shown_cells,
    truth_of,
)
from pgm_models.detectors.person_figures import draw_cast, draw_people, place_people
from pgm_models.detectors.person_net import PersonNet
from pgm_models.detectors.person_run import export_people
from pgm_models.detectors.person_task import PersonTask, PersonTaskOptions, calibrate, judge, score
from pgm_models.train import TrainOptions, train

TENNIS = load_scene("tennis")
TALL = TENNIS.person_height_m


@pytest.fixture(scope="module")
def courts(tmp_path_factory):
    """Two courts of two views."""
    return prepare_backdrops(tmp_path_factory.mktemp("courts"), TENNIS, worlds=2, views=2, seed=3)


@cache
def cast():
    """A handful of people."""
    return draw_cast(3, TENNIS, players=4, others=3, officials=1, matches=1)


@pytest.fixture(scope="module")
def scene(courts):
    """A picture with people, its camera, and who stands there."""
    rng = np.random.default_rng(5)
    backdrop = courts.each[0]
    bgr = courts.pictures.read(0).copy()
    standing = draw_people(bgr, place_people(rng, cast(), backdrop), backdrop, rng)
    return bgr, camera_of(backdrop.view), standing


def answer_of(truth) -> np.ndarray:
    """What a network that knows the truth says."""
    answer = np.full((len(CHANNELS), *truth.heat.shape), -9.0)
    answer[0] = np.where((truth.heat == 1.0) & (truth.counted > 0), 9.0, -9.0)
    answer[1] = np.where(truth.player > 0.5, 5.0, -5.0)
    answer[2:] = truth.place
    return answer.astype(np.float32)


def test_people_are_drawn_where_the_truth_says_they_stand(courts, scene):
    bgr, camera, standing = scene
    empty = courts.pictures.read(0)
    changed = np.abs(bgr.astype(int) - empty).max(axis=2) > 12
    assert len(standing) >= 4 and {person.part for person in standing} >= {"plays", "official"}
    nearest = standing[-1]  # nobody stands before it
    pixels = project(camera, nearest.vertices)[0]
    inside = ((pixels >= 0) & (pixels < np.array(SIZE) - 1)).all(axis=1)
    columns, rows = np.round(pixels[inside]).astype(int).T
    assert inside.any() and changed[rows, columns].mean() > 0.8
    feet = nearest.vertices[nearest.vertices[:, 2] < 0.3, :2]
    if len(feet):
        assert np.linalg.norm(feet.mean(axis=0) - nearest.ground) < 0.35


def test_a_perfect_answer_gives_back_who_stands_where(scene):
    bgr, camera, standing = scene
    ground = ground_before(camera)
    people = seen_people(standing, ground)
    asked = 0
    for person, body in zip(people, standing, strict=True):
        piece = Piece(
            depth=person.depth * 0.99,
            side=person.side,
            pixel_from_metre=PERSON_PX / TALL * np.diag([1.0, -1.0]),
            column=0.5 * (COLUMNS - 1),
            person_height_m=TALL,
        )
        where = piece_map(piece, ground, camera)
        truth = truth_of(piece, people, ground, shown_cells(where, SIZE))
        peaks = read_peaks(answer_of(truth)[None], least=0.0)
        middle = piece.plane(peaks.feet)
        stretch = ground.height / (ground.height - middle[:, 1])
        back = ground.world(piece.depth * stretch, middle[:, 0] * stretch, np.zeros(len(stretch)))[:, :2]
        if person.part == "seated" or not len(back):
            continue
        away = np.linalg.norm(back - body.ground, axis=1)
        if away.min() > 1e-6:  # out of the picture, or behind somebody
            continue
        asked += 1
        k = int(away.argmin())
        assert (peaks.player[k] > 0) == (person.part == "plays")
        corners = piece.plane(peaks.box[k].reshape(2, 2))
        seen = project(camera, ground.world(np.full(2, piece.depth), corners[:, 0], corners[:, 1]))[0]
        exact = project(camera, body.vertices)[0]
        size = np.ptp(exact, axis=0).max()
        np.testing.assert_allclose(seen[0], exact.min(axis=0), atol=0.05 * size)
        np.testing.assert_allclose(seen[1], exact.max(axis=0), atol=0.05 * size)
    assert asked >= 3


def test_pieces_are_mirrored_and_stretched_with_their_people(scene):
    bgr, camera, standing = scene
    ground = ground_before(camera)
    people = seen_people(standing, ground)
    mirrored = 0
    for seed in range(12):
        piece = random_piece(np.random.default_rng(seed), people, ground, TALL, np.array([15.0, 70.0]))
        pixels = np.random.default_rng(seed).uniform(0, 79, (5, 2))
        np.testing.assert_allclose(piece.pixels(piece.plane(pixels)), pixels, atol=1e-9)
        ahead = piece.pixels(np.array([[piece.side + 1.0, 0.0], [piece.side, 1.0]]))
        mirrored += ahead[0, 0] < piece.column
        assert ahead[1, 1] < FEET_ROW - 15
        assert cut_piece(bgr, piece_map(piece, ground, camera)).shape == (80, COLUMNS, 3)
    assert 0 < mirrored < 12


def test_batches_repeat_and_differ(courts):
    one, two = (
        PersonTask(
            TENNIS, courts, courts, (cast(), cast()), PersonTaskOptions(batch=8, per_picture=4), held_out_pieces=4
        )
        for _ in range(2)
    )
    for name, value in one.batch(3).tensors.items():
        assert torch.equal(value, two.batch(3).tensors[name]), name
    assert not torch.equal(one.batch(0).tensors["strips"], one.batch(1).tensors["strips"])


def test_a_network_learns_a_handful_of_pieces(courts, tmp_path):
    options = PersonTaskOptions(batch=8, per_picture=8)
    task = PersonTask(TENNIS, courts, courts, (cast(), cast()), options, held_out_pieces=4)
    batch = task.batch(0)
    task.batch = lambda index: batch  # the same pieces over and over
    torch.manual_seed(0)
    training = TrainOptions(steps=30, learning_rate=1e-2, average=0.5, log_every=1000, threads=1, clip=10.0)
    network = train(PersonNet(), task, training, tmp_path / "run", provenance={}).network
    with torch.no_grad():
        before, _ = task.loss(PersonNet().eval(), batch)
        after, _ = task.loss(network, batch)
    assert float(after) < 0.5 * float(before)
    assert set(task.validate(network)) == {"recall", "recall_at_half", "precision_at_half", "role", "feet_px"}


def test_perfect_answers_score_perfectly_and_calibrate_upwards(courts):
    task = PersonTask(TENNIS, courts, courts, (cast(), cast()), PersonTaskOptions(), held_out_pieces=48)
    truths = [truth for _, truth in task._held_out]
    answers = np.stack([answer_of(truth) for truth in truths])
    figures = score(judge(answers, truths))
    assert figures["recall_at_half"] > 0.97 and figures["precision_at_half"] > 0.99 and figures["role"] > 0.97
    assert figures["feet_px"] < 1e-3
    silent = answers.copy()
    silent[:, 0] = -9.0
    assert score(judge(silent, truths))["recall"] == 0.0
    noisy = (
        answers + np.random.default_rng(0).normal(0, 3, answers.shape) * (np.arange(len(CHANNELS)) < 2)[:, None, None]
    )
    judged = judge(noisy, truths)
    said = calibrate(judged)
    assert abs(said.person(judged.person).mean() - judged.right.mean()) < 0.02


def test_onnx_equals_torch_for_strips_of_any_number_and_width(tmp_path):
    torch.manual_seed(0)
    network = PersonNet().train()
    with torch.no_grad():
        for _ in range(3):  # norms with statistics and weights that folding must not lose
            network(torch.randint(0, 256, (2, 80, 96, 3), dtype=torch.uint8))
        for parameter in network.parameters():
            parameter.add_(0.05 * torch.randn_like(parameter))
    network.eval()
    path = tmp_path / "person.onnx"
    export_people(network, PersonCalibration(person_shift=0.5), path, about={"step": 3})
    reader = PersonNetwork.load(path)
    assert reader.calibration == PersonCalibration(person_shift=0.5)
    assert path.stat().st_size < 400_000 and not list(tmp_path.glob("*.data"))
    for count, columns in ((1, 64), (5, 160)):
        strips = np.random.default_rng(0).integers(0, 256, (count, 80, columns, 3), dtype=np.uint8)
        with torch.no_grad():
            expected = network(torch.from_numpy(strips)).numpy()
        np.testing.assert_allclose(reader.answers(strips), expected, atol=2e-3)


def test_a_short_run_leaves_a_network_that_the_finder_takes(tmp_path, capsys):
    run = tmp_path / "run"
    argv = ["people", "--out", str(run), "--courts", "1", "--people", "2", "--steps", "1", "--batch", "4"]
    assert main([*argv, "--threads", "1"]) == 0
    assert "wrote" in capsys.readouterr().out
    StripPeople.load(run / "person.onnx")
    with pytest.raises(ValueError, match="expected 2 worlds of 6 views"):
        main([*argv[:4], "2", *argv[5:], "--resume"])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--courts", "0"], "--courts: expected 1 or more, got 0"),
        (["--people", "0"], "--people: expected 1 or more, got 0"),
        (["--batch", "1"], "--batch: expected at least 2"),
    ],
)
def test_bad_options_are_named(words, said, tmp_path):
    with pytest.raises(Exception, match=said):
        main(["people", "--out", str(tmp_path / "run"), *words])
