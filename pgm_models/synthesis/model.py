"""The synthesis model as one thing: fields, style encoder, enhancer, and the file it is kept in."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor, nn

from pgm_data.scene import load_scene
from pgm_models.checkpoint import weights_digest
from pgm_models.model_file import stored_model, write_model
from pgm_models.synthesis.enhancer import Enhancer
from pgm_models.synthesis.fields import Fields
from pgm_models.synthesis.presets import EnhancerOptions, FieldOptions, StyleOptions, SynthesisDesign
from pgm_models.synthesis.sparse_pictures import Upsampler
from pgm_models.synthesis.style_encoder import OwnStyleEncoders, StyleEncoder

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
    tensors, more = {}, {}
    if model.match_styles:
        tensors[STYLES] = torch.stack([*model.match_styles.values()])
        more[STYLES] = json.dumps([*model.match_styles])
    write_model(path, "synthesis", model, options_to_json(model.options), about, tensors=tensors, more=more)


def load_model(run: Path, device: torch.device | str = "cpu") -> SynthesisModel:
    """The model of a run's folder or of a file, with averaged weights, in evaluation mode.

    Raises:
        ValueError: If there is none; says what was found.
    """
    stored = stored_model(run, "synthesis")
    model = SynthesisModel(options_from_json(stored.options))
    stored.into(model, apart=(STYLES,))
    names = json.loads(stored.more.get(STYLES, "[]"))
    if names:
        model.keep_styles(dict(zip(names, stored.tensors[STYLES], strict=True)))
    return model.to(device)
