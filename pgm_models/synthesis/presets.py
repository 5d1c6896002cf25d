"""Sizes of the synthesis model, from what a test trains in a minute to what the paper trained; and its designs."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from types import MappingProxyType
from typing import Literal, get_args, get_type_hints

from pgm_models.synthesis.stylists import Stylising


@dataclass(frozen=True, kw_only=True)
class FieldOptions:
    """The fields of all objects. A scene's own sizes are the upper limit: nothing is made larger than it asks."""

    voxels: int
    """Cells of a volume along its longest axis."""
    voxel_features: int
    """Values of each."""
    texels: int
    """Cells of a plane along each axis."""
    texel_features: int
    samples: int
    """Samples of a ray in a player's volume."""
    width: int
    """Channels of the finest layer that grows a grid."""
    features: int = 19
    """What fields give out, the three colours included."""
    style: int = 32
    """Numbers of an object's style."""
    stylising: Stylising = "grid"
    """Whether cells or samples are dressed in a style."""
    world_samples: int = 48
    """Samples of a ray in a static world, which is as large as a room: air is passed over, so that many cost little."""
    world_voxels: int = 0
    """Cells of a static world along its longest axis, between `voxels` of which the network makes all; 0 for as many as
    the network makes."""
    world_features: int = 0
    """Values of each; 0 for `voxel_features`."""


@dataclass(frozen=True, kw_only=True)
class EnhancerOptions:
    """The network that turns features into the final picture."""

    widths: tuple[int, ...]
    """Channels of each scale, the finest first; none for no enhancer."""


@dataclass(frozen=True, kw_only=True)
class StyleOptions:
    """The network that reads styles off pictures."""

    widths: tuple[int, ...]
    """Channels of the stem's stages, each half the size of the one before."""
    crop: int
    """Pixels of an object's crop along each axis."""


@dataclass(frozen=True, kw_only=True)
class SynthesisDesign:
    """What the model is made of. Each choice but the first of a field is one that the paper compares with.

    Source: Menapace et al. 2023, section 5.2.2 (ablation), and Menapace et al. 2022, Playable Environments.
    """

    volumes: Literal["voxels", "mlp"] = "voxels"
    """What players and static worlds are kept in: a grown grid; or a network of the place, asked at each sample, which
    dresses by sample whatever `FieldOptions.stylising` says. The volume of blending weights stays a grid."""
    planes: Literal["texels", "mlp"] = "texels"
    """The same for planes and the sky, which a ray still meets once: the paper says no more than `an MLP instead`."""
    deformation: Literal["skinning", "mlp"] = "skinning"
    """What takes samples to a body's rest pose: blended joints; or a network of the place and of a learned code of the
    pose. That code is read off the joints, as states tell these, and not, as in Playable Environments, off pictures."""
    encoder: Literal["shared", "own"] = "shared"
    """What reads styles: crops of a stem's features, by weights that objects share; or a network for each object, which
    sees the crop of the picture alone."""
    picture: Literal["enhanced", "raw", "upsampled"] = "enhanced"
    """How what rays see becomes the picture: by the enhancer; not at all; or, in the manner of Playable Environments,
    one ray for 4 x 4 pixels and a network that makes the full picture of them, without a loss on the rays' colours."""

    def __post_init__(self) -> None:
        """Check the choices."""
        choices = get_type_hints(type(self))
        for field in fields(self):
            value = getattr(self, field.name)
            if value not in get_args(choices[field.name]):
                raise ValueError(
                    f"design.{field.name}: expected {' or '.join(get_args(choices[field.name]))}, got {value!r}"
                )


SYNTHESIS_DESIGNS: Mapping[str, SynthesisDesign] = MappingProxyType(
    {
        "ours": SynthesisDesign(),
        "no_enhancer": SynthesisDesign(picture="raw"),
        "no_deformation": SynthesisDesign(deformation="mlp"),
        "no_planes": SynthesisDesign(planes="mlp"),
        "no_voxels": SynthesisDesign(volumes="mlp"),
        "no_style_encoder": SynthesisDesign(encoder="own"),
        "playable": SynthesisDesign(volumes="mlp", planes="mlp", deformation="mlp", encoder="own", picture="upsampled"),
    }
)
"""By name: ours, the paper's five ablations of it, and a baseline in the manner of Playable Environments."""


def design_named(name: str) -> SynthesisDesign:
    """A design by its name.

    Raises:
        ValueError: If there is none; names those that there are.
    """
    if name not in SYNTHESIS_DESIGNS:
        raise ValueError(f"design: expected one of {', '.join(SYNTHESIS_DESIGNS)}, got {name!r}")
    return SYNTHESIS_DESIGNS[name]


@dataclass(frozen=True, kw_only=True)
class Preset:
    """A size, and how it is trained."""

    fields: FieldOptions
    enhancer: EnhancerOptions
    style: StyleOptions
    picture: tuple[int, int]
    """Width and height of the pictures it learns from and makes, pixels."""
    patch: int
    """Pixels of a training patch along each axis."""
    patches: int
    """Patches of a frame in a step."""
    pairs: int
    """Pairs of frames a step."""
    steps: int
    learning_rate: float


PRESETS: Mapping[str, Preset] = MappingProxyType(
    {
        "nano": Preset(
            fields=FieldOptions(
                voxels=16, voxel_features=8, texels=32, texel_features=8, samples=12, width=8, world_voxels=32
            ),
            enhancer=EnhancerOptions(widths=(8, 16)),
            style=StyleOptions(widths=(8, 16), crop=8),
            picture=(128, 72),
            patch=24,
            patches=2,
            pairs=1,
            steps=300,
            learning_rate=5e-3,
        ),
        "tiny": Preset(
            fields=FieldOptions(
                voxels=16, voxel_features=16, texels=64, texel_features=16, samples=16, width=16, world_voxels=64
            ),
            enhancer=EnhancerOptions(widths=(8, 16, 32)),
            style=StyleOptions(widths=(8, 16, 32), crop=8),
            picture=(256, 144),
            patch=32,
            patches=2,
            pairs=1,
            steps=5_000,
            learning_rate=3e-3,
        ),
        "small": Preset(
            fields=FieldOptions(
                voxels=32,
                voxel_features=32,
                texels=128,
                texel_features=32,
                samples=24,
                width=16,
                world_voxels=96,
                world_features=12,
            ),
            enhancer=EnhancerOptions(widths=(16, 32, 64)),
            style=StyleOptions(widths=(16, 32, 64), crop=8),
            picture=(512, 288),
            patch=64,
            patches=1,
            pairs=1,
            steps=25_000,
            learning_rate=2e-3,
        ),
        "base": Preset(
            fields=FieldOptions(
                voxels=32, voxel_features=64, texels=256, texel_features=64, samples=32, width=32, world_voxels=128
            ),
            enhancer=EnhancerOptions(widths=(16, 32, 64)),
            style=StyleOptions(widths=(32, 64, 128), crop=8),
            picture=(1024, 576),
            patch=128,
            patches=1,
            pairs=4,
            steps=60_000,
            learning_rate=1e-3,
        ),
        "paper": Preset(
            fields=FieldOptions(
                voxels=128,
                world_voxels=128,
                voxel_features=512,
                texels=256,
                texel_features=512,
                samples=48,
                width=64,
                style=128,
                stylising="sample",
            ),
            enhancer=EnhancerOptions(widths=(64, 128, 256, 512)),
            style=StyleOptions(widths=(64, 128), crop=8),
            picture=(1024, 576),
            patch=180,
            patches=1,
            pairs=16,
            steps=300_000,
            learning_rate=1e-4,
        ),
    }
)
"""By name."""


@dataclass(frozen=True, kw_only=True)
class PresetChanges:
    """What a run has otherwise than its preset; nothing unless said."""

    samples: int = 0
    """Of `FieldOptions`; those of static worlds change by the same factor. 0 for the preset's."""
    voxels: int = 0
    """Of `FieldOptions`; those of static worlds change by the same factor. 0 for the preset's."""
    enhancer: tuple[int, ...] | None = None
    """Widths of `EnhancerOptions`; None for the preset's."""
    stylising: Stylising | None = None
    """Of `FieldOptions`; None for the preset's."""
    height: int = 0
    """Pixels of the pictures, whose shape stays; 0 for the preset's."""


def changed_preset(preset: Preset, changes: PresetChanges) -> Preset:
    """The preset with those changes. Patches that would not fit into the pictures are made smaller.

    Raises:
        ValueError: If a number is below 0.
    """
    for name in ("samples", "voxels", "height"):
        if getattr(changes, name) < 0:
            raise ValueError(f"{name}: expected 0 or more, got {getattr(changes, name)}")
    own = preset.fields
    samples, voxels = changes.samples or own.samples, changes.voxels or own.voxels
    field_options = replace(
        own,
        samples=samples,
        world_samples=max(1, round(own.world_samples * samples / own.samples)),
        voxels=voxels,
        world_voxels=own.world_voxels and max(2, round(own.world_voxels * voxels / own.voxels)),
        stylising=changes.stylising or own.stylising,
    )
    height = changes.height or preset.picture[1]
    picture = (max(1, round(preset.picture[0] * height / preset.picture[1])), height)
    return replace(
        preset,
        fields=field_options,
        enhancer=preset.enhancer if changes.enhancer is None else EnhancerOptions(widths=changes.enhancer),
        picture=picture,
        patch=min(preset.patch, *picture),
    )
