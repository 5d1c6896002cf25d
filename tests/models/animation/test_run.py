import json
from dataclasses import replace

import pytest
import torch

from pgm_models.animation import run
from pgm_models.animation.matches import divided_matches
from pgm_models.animation.model import load_model
from pgm_models.animation.run import AnimationRunOptions, train_animation
from pgm_models.checkpoint import CHECKPOINT_NAME, load_checkpoint
from pgm_models.model_file import MODEL_NAME
from pgm_models.train import LOG_NAME


@pytest.fixture(scope="module")
def begin(tennis_dataset, tmp_path_factory):
    """Options of a short run, its states and texts shared with the others of this file."""
    place = tmp_path_factory.mktemp("training")

    def options(name, **changes):
        values = {"preset": "nano", "batch": 4, "steps": 4, "threads": 1, "device": "cpu", "cache": place / "cache"}
        return AnimationRunOptions(dataset=tennis_dataset, run=place / name, **{**values, **changes})

    return options


@pytest.fixture(autouse=True)
def no_pictures(request, monkeypatch):
    """Pictures take seconds; one test wants them."""
    if "pictures" not in request.node.name:
        monkeypatch.setattr(run, "_look", lambda windows: lambda model, place, step: None)


def losses(place):
    lines = [json.loads(line) for line in (place / LOG_NAME).read_text().splitlines()]
    return [line["loss"] for line in lines if "loss" in line]


def test_a_run_leaves_a_model_its_losses_and_pictures(begin):
    options = begin("whole", steps=40)
    told = []
    outcome = train_animation(options, command=["pgm-train", "animation"], show=told.append)
    assert outcome.state == "done" and outcome.step == 40
    assert told[0] == "reading what the states are made of" and "2 matches to learn from" in " ".join(told)
    model = load_model(options.run)
    assert model.layout.channels > 100 and model.options.frames == 8
    checkpoint = load_checkpoint(options.run / CHECKPOINT_NAME)
    assert checkpoint.provenance["command"] == ["pgm-train", "animation"]
    (options.run / MODEL_NAME).unlink()
    again = load_model(options.run)  # from the checkpoint
    for name, value in model.state_dict().items():
        assert torch.equal(again.state_dict()[name], value), name
    assert (options.run / "samples" / "step_000040.png").stat().st_size > 10_000
    assert (options.run / "loss.csv").exists()


def test_a_resumed_run_has_the_losses_of_an_unbroken_one(begin):
    whole = begin("unbroken", steps=40)
    train_animation(whole, command=["x"])
    broken = begin("broken", steps=40)

    class Stopped(Exception):
        pass

    def stop(line):
        if line.startswith("step 20"):
            raise Stopped

    with pytest.raises(Stopped):
        train_animation(replace(broken, checkpoint_minutes=1e-9), command=["x"], show=stop)
    at = load_checkpoint(broken.run / CHECKPOINT_NAME).step
    assert 0 < at < 40
    outcome = train_animation(broken, command=["x"])
    assert outcome.step == 40
    assert losses(broken.run) == losses(whole.run)
    assert torch.equal(
        load_model(broken.run).denoiser.state_dict()["state_output.weight"],
        load_model(whole.run).denoiser.state_dict()["state_output.weight"],
    )


@pytest.mark.parametrize("design", ["paper", "velocity", "transformer", "lstm", "playable"])
def test_every_design_trains_at_the_same_task(begin, design):
    options = begin(design, design=design, steps=2)
    assert train_animation(options, command=["x"]).state == "done"
    assert load_model(options.run).options.design.prior is False


def test_a_world_without_ball_and_court_trains_too(blocks_dataset, tmp_path):
    options = AnimationRunOptions(
        dataset=blocks_dataset, run=tmp_path / "run", preset="nano", batch=4, steps=2, threads=1, device="cpu"
    )
    train_animation(options, command=["x"])
    model = load_model(options.run)
    assert [entry.column for entry in model.layout.properties] == [
        "player0.root_position",
        "player0.root_rotation",
        "player0.joint_rotations",
    ]


def test_a_run_of_other_options_is_not_gone_on_with(begin):
    options = begin("first", steps=2)
    train_animation(options, command=["x"])
    with pytest.raises(ValueError, match="learning_rate"):
        train_animation(replace(options, learning_rate=0.5), command=["x"])


def test_a_batch_that_does_not_divide_is_refused(begin):
    with pytest.raises(ValueError, match="multiple of its 3 parts, got 4"):
        train_animation(begin("odd", accumulate=3), command=["x"])


def test_matches_are_kept_apart_where_there_are_enough(tennis_dataset, tmp_path):
    training, held_out = divided_matches(tennis_dataset)
    assert len(training) == 2 and held_out == ()
    with pytest.raises(ValueError, match="expected a packed dataset with episodes"):
        divided_matches(tmp_path)
