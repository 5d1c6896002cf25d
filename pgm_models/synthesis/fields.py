"""The fields of a scene's objects: as many as the scene declares, and no others."""

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from pgm_data.scene import Scene, SceneObject
from pgm_models.synthesis.balls import Balls
from pgm_models.synthesis.bodies import Body, BodyGrids
from pgm_models.synthesis.computed_worlds import ComputedVolume
from pgm_models.synthesis.grids import mixed
from pgm_models.synthesis.presets import FieldOptions, SynthesisDesign
from pgm_models.synthesis.skinning import Poses
from pgm_models.synthesis.stylists import Stylist, baked, dressed
from pgm_models.synthesis.surfaces import Plane, Sky, rectangle_of
from pgm_models.synthesis.worlds import StaticVolume, WorldGrids

GROUND_M = 1e-6
"""A plane whose height is less lies on the ground, where a court is painted."""


@dataclass(frozen=True, eq=False, kw_only=True)
class States:
    """What moves in a batch of frames."""

    poses: Mapping[str, Poses]
    """Of each player object."""
    balls: Balls | None
    """None where the scene has no ball."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Grids:
    """What the networks of all fields make, the same for all frames; by object, or by skeleton for players."""

    bodies: Mapping[str, BodyGrids]
    worlds: Mapping[str, WorldGrids]
    surfaces: Mapping[str, Float[Tensor, "cells inputs"]]

    def values(self, key: str) -> Float[Tensor, "cells inputs"]:
        """What is dressed of a field."""
        if key in self.bodies:
            return self.bodies[key].values
        return self.worlds[key].values if key in self.worlds else self.surfaces[key]


class Fields(nn.Module):
    """One field an object; players of one skeleton share theirs."""

    def __init__(
        self, scene: Scene, options: FieldOptions, *, seed: int, design: SynthesisDesign | None = None
    ) -> None:
        """The fields that the scene declares, no larger than it asks for; ours unless a design says otherwise."""
        super().__init__()
        self.scene, self.options, self.design = scene, options, design or SynthesisDesign()
        self.bodies, self.worlds = nn.ModuleDict(), nn.ModuleDict()
        self.planes, self.skies = nn.ModuleDict(), nn.ModuleDict()
        self.stylists, self.paints = nn.ModuleDict(), nn.ModuleDict()
        self.balls = nn.ParameterDict()
        self.key_of: dict[str, str] = {}
        for number, thing in enumerate(scene.objects):
            self._add(thing, seed + 10 * number)

    def _add(self, thing: SceneObject, seed: int) -> None:
        options = self.options
        voxel_features = min(options.voxel_features, thing.features)
        world_features = min(options.world_features or options.voxel_features, thing.features)
        texel_features = min(options.texel_features, thing.features)
        key, inputs = thing.name, texel_features
        match thing.kind:
            case "player":
                assert thing.skeleton is not None
                key, inputs = thing.skeleton.name, voxel_features
                if key not in self.bodies:
                    size = _up_to(thing.grid, options.voxels)
                    self.bodies[key] = Body(
                        thing.skeleton,
                        (size[0], size[1], size[2]),
                        inputs,
                        width=options.width,
                        seed=seed,
                        design=self.design,
                    )
            case "static" if self.design.volumes == "mlp":
                inputs = world_features
                self.worlds[key] = ComputedVolume(thing, inputs, width=options.width)
            case "static":
                inputs = world_features
                self.worlds[key] = StaticVolume(
                    thing,
                    inputs,
                    voxels=options.world_voxels or options.voxels,
                    width=options.width,
                    seed=seed,
                    grown=options.voxels,
                )
            case "ball":
                self.balls[key] = nn.Parameter(torch.randn(1, inputs, generator=torch.Generator().manual_seed(seed)))
            case "plane":
                rectangle = rectangle_of(thing)
                on_ground = abs(rectangle.corner[2]) + abs(rectangle.right[2]) + abs(rectangle.up[2]) < GROUND_M
                court = self.scene.court if on_ground else None
                size = _up_to(thing.grid, options.texels)
                self.planes[key] = Plane(
                    rectangle,
                    (size[0], size[1]),
                    inputs,
                    width=options.width,
                    seed=seed,
                    court=court,
                    design=self.design,
                )
                if court is not None:
                    self.paints[key] = nn.Linear(options.style, options.features)
            case "skybox":
                size = _up_to(thing.grid, options.texels)
                self.skies[key] = Sky((size[0], size[1]), inputs, width=options.width, seed=seed, design=self.design)
        if key not in self.stylists:
            # Of a veil also how much it hides, last: nets of different matches are of different make.
            self.stylists[key] = Stylist(inputs, options.style, options.features + thing.is_veil)
        self.key_of[thing.name] = key

    @property
    def veils(self) -> frozenset[str]:
        """Planes that one sees through."""
        return frozenset(thing.name for thing in self.scene.objects if thing.is_veil and thing.name in self.planes)

    def surface(self, name: str) -> Plane | Sky:
        """The field of a surface, by its object."""
        found = self.planes[name] if name in self.planes else self.skies[name]
        assert isinstance(found, Plane | Sky)
        return found

    def body(self, skeleton: str) -> Body:
        """The field of all players of a skeleton."""
        found = self.bodies[skeleton]
        assert isinstance(found, Body)
        return found

    def world(self, name: str) -> StaticVolume | ComputedVolume:
        """The field of a static object."""
        found = self.worlds[name]
        assert isinstance(found, StaticVolume | ComputedVolume)
        return found

    def computed(self, key: str) -> bool:
        """Whether a field has no cells: its values are computed at each sample, and dressed there."""
        if key in self.bodies or key in self.worlds:
            return self.design.volumes == "mlp"
        return (key in self.planes or key in self.skies) and self.design.planes == "mlp"

    def stylist(self, name: str) -> Stylist:
        """What dresses an object."""
        found = self.stylists[self.key_of[name]]
        assert isinstance(found, Stylist)
        return found

    def grids(self) -> Grids:
        """What all networks make."""
        surfaces = {name: self.surface(name).table() for name in [*self.planes, *self.skies]}
        return Grids(
            bodies={name: self.body(name).grids() for name in self.bodies},
            worlds={name: self.world(name).grids() for name in self.worlds},
            surfaces={**surfaces, **dict(self.balls.items())},
        )


def _up_to(grid: tuple[int, ...], cells: int) -> tuple[int, ...]:
    return tuple(min(own, cells) for own in grid)


class Wardrobe:
    """Dresses points of fields in the styles of their frames, freshly: what training needs."""

    def __init__(self, fields: Fields, grids: Grids, styles: Float[Tensor, "frames objects style"]) -> None:
        """For frames with these styles, objects in the order of the scene."""
        self.fields, self.grids, self.styles = fields, grids, styles

    def style(self, thing: int) -> Float[Tensor, "frames style"]:
        """Styles of an object, by its number."""
        return self.styles[:, thing]

    def wear(
        self,
        thing: int,
        rows: Int[Tensor, "points corners"],
        shares: Float[Tensor, "points corners"],
        frame: Int[Tensor, " points"],
    ) -> Float[Tensor, "points features"]:
        """Features of points of an object: cells about them, their weights, and the points' frames.

        Those of a veil are as `parted_veil` has them.
        """
        name = self.fields.scene.objects[thing].name
        key, stylist = self.fields.key_of[name], self.fields.stylist(name)
        if self.fields.computed(key):
            return stylist(shares, frame, self.style(thing))  # the weights of unit vectors are the values
        return dressed(
            stylist, self.grids.values(key), rows, shares, frame, self.style(thing), self.fields.options.stylising
        )


class BakedWardrobe(Wardrobe):
    """The same for frames that all wear the same, each cell dressed once; for stylising by `grid`."""

    def __init__(self, fields: Fields, grids: Grids, styles: Float[Tensor, "1 objects style"]) -> None:
        """Dress everything.

        Raises:
            ValueError: If there is more than one frame of styles, or the fields are dressed by sample.
        """
        if len(styles) != 1 or fields.options.stylising != "grid":
            raise ValueError(
                f"styles: expected those of one frame, to dress cells, got {len(styles)} to dress by "
                f"{fields.options.stylising}"
            )
        super().__init__(fields, grids, styles)
        self._tables: dict[int, Tensor] = {}
        for number, thing in enumerate(fields.scene.objects):
            key = fields.key_of[thing.name]
            if not fields.computed(key):
                self._tables[number] = baked(fields.stylist(thing.name), grids.values(key), self.style(number))

    def wear(
        self,
        thing: int,
        rows: Int[Tensor, "points corners"],
        shares: Float[Tensor, "points corners"],
        frame: Int[Tensor, " points"],
    ) -> Float[Tensor, "points features"]:
        """Features of points of an object; frames do not matter. What has no cells is dressed anew."""
        if thing not in self._tables:
            return super().wear(thing, rows, shares, torch.zeros_like(frame))
        return mixed(self._tables[thing], rows, shares)
