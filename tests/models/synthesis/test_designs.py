"""The designs that the paper compares: each learns, comes back from its file, and is refused where there is none."""

import json
from dataclasses import asdict, replace
from typing import get_args, get_type_hints

import pytest
import torch
from pgm_cli.train import main
from pgm_cli.train_synthesis import SynthesisTraining

from pgm_models.synthesis.frames import read_frames
from pgm_models.synthesis.losses import eye_loss
from pgm_models.synthesis.model import (
    ModelOptions,
    SynthesisModel,
    load_model,
    options_from_json,
    options_to_json,
    save_model,
)
from pgm_models.synthesis.patches import PatchOptions, PatchSource, rays_in, states_in
from pgm_models.synthesis.presets import (
    PRESETS,
    SYNTHESIS_DESIGNS,
    EnhancerOptions,
    PresetChanges,
    SynthesisDesign,
    changed_preset,
    design_named,
)
from pgm_models.synthesis.renderer import render
from pgm_models.synthesis.run import SynthesisRunOptions, train_synthesis
from pgm_models.synthesis.studio import Studio
from pgm_models.synthesis.task import SynthesisTask, rendered_patches
from tests.models.synthesis.drawn_matches import drawn_matches, packed


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """One drawn match of tennis, packed."""
    return packed(drawn_matches(tmp_path_factory.mktemp("drawn"), matches=1, frames=6))


@pytest.fixture(scope="module")
def store(dataset):
    return read_frames(dataset, picture=(64, 36))


@pytest.fixture(scope="module")
def batch(store):
    return PatchSource(store, PatchOptions(patch=12, patches=3, pairs=1, players=1.0, ball=0.0)).batch(0)


def options_of(design: str, preset: str = "nano") -> ModelOptions:
    chosen = PRESETS[preset]
    return ModelOptions(
        scene="tennis",
        fields=replace(chosen.fields, texels=16, voxels=8, width=4),
        enhancer=chosen.enhancer,
        style=chosen.style,
        picture=(64, 36),
        seed=0,
        design=design_named(design),
    )


def model_of(design: str) -> SynthesisModel:
    torch.manual_seed(0)
    return SynthesisModel(options_of(design))


@pytest.mark.parametrize("name", SYNTHESIS_DESIGNS)
def test_each_design_learns_and_comes_back_from_its_file_with_the_same_picture(name, store, batch, tmp_path):
    model = model_of(name)
    task = SynthesisTask(model.options, lambda number: batch, eye_loss(None), held_out=[batch], data={})
    optimiser = torch.optim.Adam(model.parameters(), lr=2e-3)
    losses, reached = [], set()
    for _ in range(5):
        loss, _ = task.loss(model, batch)
        optimiser.zero_grad()
        loss.backward()
        reached |= {each for each, p in model.named_parameters() if p.grad is not None and p.grad.abs().sum() > 0}
        optimiser.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < losses[0]
    # What no patch shows, and what tells nothing but the colours before an upsampler, is not reached.
    missed = {each for each, _ in model.named_parameters()} - reached
    shown = ("fields.bodies", "enhancer", "upsampler", "fields.stylists.smpl24")
    assert not [each for each in missed if each.startswith(shown)], missed
    assert any(each.startswith("fields.bodies") for each in reached)
    assert task.validate(model)["psnr"] > 5
    save_model(tmp_path / "model.safetensors", model.eval(), {})
    again = load_model(tmp_path)
    assert again.options.design == design_named(name)
    styles = model.encoder(store.picture(0)[None], torch.as_tensor(store.boxes_px[:1], dtype=torch.float32))
    pictures = [
        Studio(each, styles.detach(), *store.size).picture(store.cameras[0], store.states([0]))
        for each in (model, again)
    ]
    assert torch.equal(pictures[0].rgb, pictures[1].rgb)
    assert pictures[0].rgb.shape == (3, 36, 64) and 0 <= float(pictures[0].rgb.min())
    torch.testing.assert_close(pictures[0].shares.sum(dim=0), torch.ones(36, 64), atol=1e-4, rtol=0)


def test_designs_differ_from_ours_in_what_they_are_named_for():
    ours = model_of("ours")
    names = {name: {each for each, _ in model_of(name).named_parameters()} for name in SYNTHESIS_DESIGNS}
    own = names["ours"]
    assert ours.enhancer is not None and own - names["no_enhancer"] == {n for n in own if n.startswith("enhancer.")}
    assert own - names["no_deformation"] == {n for n in own if ".skinning." in n}
    assert own - names["no_planes"] == {n for n in own if n.startswith("fields.planes.") and ".grown.steps" in n}
    assert own - names["no_voxels"] == {n for n in own if n.startswith("fields.bodies.smpl24.grown.steps")}
    assert own - names["no_style_encoder"] == {n for n in own if n.startswith("encoder.")} - {"encoder.unseen"}
    assert not any(".steps." in n or n.startswith("enhancer") for n in names["playable"])


def test_the_playable_design_follows_one_ray_in_sixteen_and_makes_what_all_rays_would(batch):
    model = model_of("playable").eval()
    with torch.no_grad():
        _, made = rendered_patches(model, model.fields.grids(), batch, jitter=None)
        calls = []
        rays = rays_in(batch)
        from pgm_models.synthesis import task

        def counted(some, *rest, **named):
            calls.append(len(some))
            return render(some, *rest, **named)

        before, task.render = task.render, counted
        try:
            again = rendered_patches(model, model.fields.grids(), batch, jitter=None)[1]
        finally:
            task.render = before
        assert calls == [len(rays) // 16] and torch.equal(made, again)
        model.upsampler, upsampler = None, model.upsampler
        features, _ = _all_features(model, batch)
        torch.testing.assert_close(upsampler(features), made, atol=1e-5, rtol=0)


def _all_features(model, batch):
    """Features of every ray of the patches."""
    from pgm_models.synthesis.fields import Wardrobe

    tensors = batch.tensors
    read = model.encoder(tensors["pictures"], tensors["boxes_px"])
    styles = read[tensors["wears"], torch.arange(read.shape[1])]
    grids = model.fields.grids()
    seen = render(
        rays_in(batch), model.fields, grids, states_in(batch, model.scene), Wardrobe(model.fields, grids, styles)
    )
    patches, _, size, _ = tensors["targets"].shape
    return seen.features.unflatten(0, (patches, size, size)).permute(0, 3, 1, 2), seen


def test_options_say_the_design_and_files_that_do_not_are_ours():
    for name in SYNTHESIS_DESIGNS:
        raw = json.loads(json.dumps(options_to_json(options_of(name))))
        assert options_from_json(raw).design == SYNTHESIS_DESIGNS[name]
    old = json.loads(json.dumps(options_to_json(options_of("ours"))))
    del old["design"], old["fields"]["world_samples"]
    found = options_from_json(old)
    assert found.design == SynthesisDesign() and found.fields.world_samples == 48
    strange = {**old, "design": {"volumes": "cubes"}}
    with pytest.raises(ValueError, match="volumes.*cubes"):
        options_from_json(strange)


def test_an_unknown_design_is_refused_with_the_names_that_there_are(dataset, tmp_path, capsys):
    with pytest.raises(ValueError, match="expected one of ours, no_enhancer, .*, playable, got 'cubes'"):
        train_synthesis(SynthesisRunOptions(dataset=dataset, run=tmp_path / "a", design="cubes"), command=[])
    with pytest.raises(SystemExit) as stopped:
        main(["synthesis", str(dataset), "--out", str(tmp_path / "a"), "--design", "cubes"])
    assert stopped.value.code == 2
    told = capsys.readouterr()
    assert all(name in told.err + told.out for name in SYNTHESIS_DESIGNS)
    assert get_args(get_type_hints(SynthesisTraining)["design"]) == tuple(SYNTHESIS_DESIGNS)


def test_a_design_is_trained_by_command_and_leaves_pictures_of_how_far_it_is(dataset, tmp_path):
    import cv2

    out = tmp_path / "run"
    words = ["--preset", "nano", "--steps", "1", "--threads", "1", "--device", "cpu", "--held-out", "0.4"]
    assert main(["synthesis", str(dataset), "--out", str(out), "--design", "playable", *words]) == 0
    assert load_model(out).options.design == SYNTHESIS_DESIGNS["playable"]
    sheet = cv2.imread(str(out / "samples" / "step_000001.png"))
    assert sheet.shape == (3 * 72 + 8, 128 + 4 + 128, 3)
    # On the left are real frames: blue grows to the right, red downwards.
    left = sheet[:72, :128].astype(float)
    assert (
        left[:, 100:, 0].mean() > left[:, :28, 0].mean() + 40 and left[50:, :, 2].mean() > left[:22, :, 2].mean() + 40
    )
    assert (out / "loss.csv").exists() and (out / "loss.png").exists()


def test_a_changed_preset_has_those_changes_and_no_others():
    nano = PRESETS["nano"]
    assert changed_preset(nano, PresetChanges()) == nano
    changes = PresetChanges(samples=3, voxels=5, enhancer=(), stylising="sample", height=18)
    changed = changed_preset(nano, changes)
    assert changed.picture == (32, 18) and changed.patch == 18 and changed.enhancer == EnhancerOptions(widths=())
    wanted = {"samples": 3, "world_samples": 12, "voxels": 5, "world_voxels": 10, "stylising": "sample"}
    assert asdict(changed.fields) == {**asdict(nano.fields), **wanted}
    with pytest.raises(ValueError, match="voxels: expected 0 or more, got -1"):
        changed_preset(nano, PresetChanges(voxels=-1))
