import json
import signal

import numpy as np
import pytest
import torch
from pgm_cli.train import main

from pgm_models.checkpoint import CHECKPOINT_NAME
from pgm_models.model_file import MODEL_NAME
from pgm_models.synthesis.frames import read_frames
from pgm_models.synthesis.model import load_model
from pgm_models.synthesis.run import SynthesisRunOptions, train_synthesis
from pgm_models.synthesis.studio import Studio
from pgm_models.train import LOG_NAME
from tests.models.synthesis.drawn_matches import drawn_matches, packed


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """Two drawn matches of tennis, packed."""
    return packed(drawn_matches(tmp_path_factory.mktemp("drawn")))


def losses(run):
    lines = [json.loads(line) for line in (run / LOG_NAME).read_text().splitlines()]
    return [line["loss"] for line in lines if "loss" in line]


def options(dataset, run, **changes):
    values = {"preset": "nano", "steps": 4, "threads": 1, "device": "cpu", "held_out": 0.2}
    return SynthesisRunOptions(dataset=dataset, run=run, **{**values, **changes})


def test_a_run_leaves_a_model_that_renders_any_of_its_frames(dataset, tmp_path):
    code = main(
        ["synthesis", str(dataset), "--out", str(tmp_path / "run"), "--preset", "nano", "--steps", "3"]
        + ["--threads", "1", "--device", "cpu", "--held-out", "0.2"]
    )
    assert code == 0
    model = load_model(tmp_path / "run")
    store = read_frames(dataset, picture=model.options.picture)
    boxes = torch.as_tensor(store.boxes_px[:1], dtype=torch.float32)
    styles = model.encoder(store.picture(0)[None], boxes)
    picture = Studio(model, styles, *store.size).picture(store.cameras[0], store.states([0]))
    assert picture.rgb.shape == (3, store.size[1], store.size[0])
    assert torch.isfinite(picture.rgb).all()
    torch.testing.assert_close(picture.shares.sum(dim=0), torch.ones(store.size[1], store.size[0]), atol=1e-4, rtol=0)
    (tmp_path / "run" / MODEL_NAME).unlink()
    again = load_model(tmp_path / "run")  # from the checkpoint
    for name, value in model.state_dict().items():
        assert torch.equal(again.state_dict()[name], value), name


def test_a_few_steps_lower_the_loss_and_a_resumed_run_goes_on_as_if_unbroken(dataset, tmp_path):
    whole = options(dataset, tmp_path / "whole", steps=40)
    train_synthesis(whole, command=["x"])
    assert np.mean(losses(whole.run)[-1:]) < 0.7 * first_loss(dataset, tmp_path)
    broken = options(dataset, tmp_path / "broken", steps=40)

    def stop(line):
        if line.startswith("step 20 "):
            signal.raise_signal(signal.SIGINT)

    assert train_synthesis(broken, command=["x"], show=stop).state == "interrupted"
    assert (broken.run / CHECKPOINT_NAME).exists() and not (broken.run / MODEL_NAME).exists()
    assert train_synthesis(broken, command=["x"]).state == "done"
    assert losses(broken.run)[-1] == losses(whole.run)[-1]


def first_loss(dataset, tmp_path):
    one = options(dataset, tmp_path / "one", steps=1)
    outcome = train_synthesis(one, command=["x"])
    assert outcome.state == "done"
    return losses(one.run)[0]


def test_what_is_no_dataset_and_options_that_cannot_be_are_refused(dataset, tmp_path, capsys):
    for words in (
        ["synthesis", str(tmp_path), "--out", str(tmp_path / "a")],
        ["synthesis", str(dataset), "--out", str(tmp_path / "a"), "--held-out", "1"],
        ["synthesis", str(dataset), "--out", str(tmp_path / "a"), "--steps=-1"],
    ):
        with pytest.raises(Exception, match="expected"):
            main(words)
    assert not (tmp_path / "a").exists()
