"""The synthesis model as one thing: fields, style encoder, enhancer, and the file it is kept in."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor, nn

from pgm_data.dataset.files import whole_file
from pgm_data.scene import load_scene
from pgm_models.checkpoint import CHECKPOINT_NAME, load_checkpoint, weights_digest
from pgm_models.synthesis.enhancer import Enhancer
from pgm_models.synthesis.fields import Fields
from pgm_models.synthesis.presets import EnhancerOptions, FieldOptions, StyleOptions, SynthesisDesign
from pgm_models.synthesis.sparse_pictures import Upsampler
from pgm_models.synthesis.style_encoder import OwnStyleEncoders, StyleEncoder

MODEL_NAME = "model.safetensors"
"""File name of a run's averaged weights with all that is needed to use them."""
STYLES = "match_styles"
"""Tensor of a model file beside the weights: styles of matches, whose names are in its metadata."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ModelOptions:
    """What a model is, apart from its weights."""

    scene: str
    """Name of the scene, or the path of its file."""
    fields: FieldOptions
    enhancer: EnhancerOptions
    style: StyleOptions
    picture: tuple[int, int]
    """Width and height of the pictures it learned from, pixels."""
    seed: int
    """Of the fixed noise that grids grow from."""
    design: SynthesisDesign = field(default_factory=SynthesisDesign)
    """What it is made of; ours in files that do not say."""


class SynthesisModel(nn.Module):
    """Pictures of any state from any view."""

    _worn: Tensor

    def __init__(self, options: ModelOptions) -> None:
        """Raise ValueError where the scene is none, or declares what cannot be rendered; names the field."""
        super().__init__()
        self.options = options
        self.scene = load_scene(options.scene)
        self.fields = Fields(self.scene, options.fields, seed=options.seed, design=options.design)
        encoder = StyleEncoder if options.design.encoder == "shared" else OwnStyleEncoders
        self.encoder = encoder(options.style, len(self.scene.objects), options.fields.style)
        self.enhancer: Enhancer | None = None
        self.upsampler: Upsampler | None = None
        if options.design.picture == "upsampled":
            self.upsampler = Upsampler(options.fields.features, width=options.enhancer.widths[0])
        elif options.design.picture == "enhanced" and options.enhancer.widths:
            style = len(self.scene.objects) * options.fields.style
            self.enhancer = Enhancer(options.fields.features, style, options.enhancer)
        self._matches: tuple[str, ...] = ()
        nothing = torch.zeros(0, len(self.scene.objects), options.fields.style)
        self.register_buffer("_worn", nothing, persistent=False)

    @property
    def match_styles(self) -> Mapping[str, Float[Tensor, "objects style"]]:
        """What the objects of each match that it learned from look like; none before it is trained to the end."""
        return dict(zip(self._matches, self._worn, strict=True))

    def keep_styles(self, styles: Mapping[str, Float[Tensor, "objects style"]]) -> None:
        """Keep the styles of matches, by name, in place of those kept so far; they are saved with the model."""
        self._matches = tuple(styles)
        self._worn = torch.stack([*styles.values()]).to(self.device) if styles else self._worn[:0]

    @property
    def device(self) -> torch.device:
        """Where the weights lie."""
        return next(self.parameters()).device

    def enhanced(
        self,
        features: Float[Tensor, "pictures features height width"],
        styles: Float[Tensor, "pictures objects style"],
    ) -> Float[Tensor, "pictures 3 height width"]:
        """Final pictures of what rays saw; without an enhancer the colours themselves."""
        if self.upsampler is not None:
            return self.upsampler(features)
        if self.enhancer is None:
            return features[:, :3]
        return self.enhancer(features, styles.flatten(1))


def options_to_json(options: ModelOptions) -> dict[str, object]:
    """The options as JSON values."""
    return asdict(options)


def options_from_json(raw: Mapping) -> ModelOptions:
    """The options that `options_to_json` wrote.

    Raises:
        ValueError: If they are not such.
    """
    try:
        enhancer, style = dict(raw["enhancer"]), dict(raw["style"])
        enhancer["widths"], style["widths"] = tuple(enhancer["widths"]), tuple(style["widths"])
        return ModelOptions(
            scene=str(raw["scene"]),
            fields=FieldOptions(**raw["fields"]),
            enhancer=EnhancerOptions(**enhancer),
            style=StyleOptions(**style),
            picture=(int(raw["picture"][0]), int(raw["picture"][1])),
            seed=int(raw["seed"]),
            design=SynthesisDesign(**raw.get("design", {})),
        )
    except (KeyError, TypeError, IndexError) as error:
        raise ValueError(f"model: expected the options of a synthesis model, got {error!r}") from error


def model_digest(model: SynthesisModel) -> str:
    """SHA-256 of the model's weights, of what it is, and of the styles that it keeps."""
    styles = {f"match {name}": value for name, value in model.match_styles.items()}
    return weights_digest(options_to_json(model.options), {**model.state_dict(), **styles})


def save_model(path: Path, model: SynthesisModel, about: Mapping[str, object]) -> None:
    """Write weights and options as one safetensors file, whole or not at all."""
    from safetensors.torch import save_file

    metadata = {"pgm_synthesis": json.dumps(options_to_json(model.options)), "about": json.dumps(about)}
    tensors = {name: value.detach().cpu().contiguous().clone() for name, value in model.state_dict().items()}
    if model.match_styles:
        tensors[STYLES] = torch.stack([*model.match_styles.values()]).cpu()
        metadata[STYLES] = json.dumps([*model.match_styles])
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as temporary:
        save_file(tensors, temporary, metadata=metadata)


def load_model(run: Path, device: torch.device | str = "cpu") -> SynthesisModel:
    """The model of a run's folder or of a file, with averaged weights, in evaluation mode.

    Raises:
        ValueError: If there is none; says what was found.
    """
    for path in (run, run / MODEL_NAME):
        if path.is_file():
            return _read(path, device)
    if (run / CHECKPOINT_NAME).is_file():
        found = load_checkpoint(run / CHECKPOINT_NAME)
        described = found.options.get("task", {}).get("model")
        if not isinstance(described, dict) or "fields" not in described:
            raise ValueError(f"{run}: expected a run of pgm-train synthesis, got one of another model")
        model = SynthesisModel(options_from_json(described))
        model.load_state_dict(dict(found.average))
        return model.eval().requires_grad_(False).to(device)
    what = "an empty or foreign folder" if run.is_dir() else "nothing there"
    raise ValueError(f"{run}: expected a run of pgm-train synthesis, got {what}")


def _read(path: Path, device: torch.device | str) -> SynthesisModel:
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(path, framework="pt") as file:
            about = file.metadata() or {}
            if "pgm_synthesis" not in about:
                raise ValueError(f"{path}: expected a synthesis model, got a safetensors file of something else")
            model = SynthesisModel(options_from_json(json.loads(about["pgm_synthesis"])))
            model.load_state_dict({name: file.get_tensor(name) for name in file.keys() if name != STYLES})
            names = json.loads(about.get(STYLES, "[]"))
            model.keep_styles(dict(zip(names, file.get_tensor(STYLES), strict=True)) if names else {})
    except (SafetensorError, RuntimeError) as error:
        raise ValueError(f"{path}: expected a synthesis model, got {error}") from error
    return model.eval().requires_grad_(False).to(device)
