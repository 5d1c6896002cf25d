"""Sizes of the synthesis model, from what a test trains in a minute to what the paper trained."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

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
    """Samples of a ray in a volume."""
    width: int
    """Channels of the finest layer that grows a grid."""
    features: int = 19
    """What fields give out, the three colours included."""
    style: int = 32
    """Numbers of an object's style."""
    stylising: Stylising = "grid"
    """Whether cells or samples are dressed in a style."""


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
            fields=FieldOptions(voxels=16, voxel_features=8, texels=32, texel_features=8, samples=12, width=8),
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
            fields=FieldOptions(voxels=16, voxel_features=16, texels=64, texel_features=16, samples=16, width=16),
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
            fields=FieldOptions(voxels=32, voxel_features=32, texels=128, texel_features=32, samples=24, width=16),
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
            fields=FieldOptions(voxels=32, voxel_features=64, texels=256, texel_features=64, samples=32, width=32),
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
