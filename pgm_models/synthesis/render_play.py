"""Pictures for the page of `pgm play`: one frame's columns and a camera in, a PNG out."""

from collections import OrderedDict
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from pgm_data.geometry.camera import Camera, same_camera
from pgm_data.scene import Scene
from pgm_models.animation.play_camera import PlayCamera
from pgm_models.processes import device_of
from pgm_models.synthesis.balls import Balls
from pgm_models.synthesis.fields import States
from pgm_models.synthesis.model import SynthesisModel, load_model
from pgm_models.synthesis.play_server import Renderer
from pgm_models.synthesis.render_layers import Filmer, as_bgr
from pgm_models.synthesis.skinning import poses_of

SIZES = 2
"""Sizes of pictures that stay prepared: those of a still view and of one that is being turned."""


class PlayRenderer:
    """Renders frames of play that nobody filmed, in what the first match wore that the model learned from."""

    def __init__(self, model: SynthesisModel) -> None:
        """Nothing is prepared yet."""
        self.model = model
        kept = next(iter(model.match_styles.values()), model.encoder.unseen.detach())
        self._styles: Float[Tensor, "1 objects style"] = kept[None]
        self._filmers: OrderedDict[tuple[int, int], Filmer] = OrderedDict()
        self._latest: Camera | None = None

    def render(self, columns: Mapping[str, Float[np.ndarray, " numbers"]], view: PlayCamera) -> bytes:
        """The picture, a PNG, of one frame's columns; what they do not tell of is not in it.

        Raises:
            ValueError: If the camera's lens has no ray for a pixel.
        """
        import cv2

        filmer, states = self._filmer(view.size), states_of_columns(columns, self.model.scene)
        # A view that is asked for again is kept; one that is being turned is not worth it.
        still = self._latest is not None and same_camera(self._latest, view.camera)
        self._latest = view.camera
        picture = (filmer.still if still else filmer.moving)(view.camera, states)
        return cv2.imencode(".png", as_bgr(picture))[1].tobytes()

    def _filmer(self, size: tuple[int, int]) -> Filmer:
        if size not in self._filmers:
            self._filmers[size] = Filmer(self.model, self._styles, size)
        self._filmers.move_to_end(size)
        while len(self._filmers) > SIZES:
            self._filmers.popitem(last=False)
        return self._filmers[size]


def load_renderer(run: Path, device: str) -> Renderer:
    """What renders for the page, by a run of pgm-train synthesis or its model file.

    Raises:
        ValueError: If it is none, or there is no such device.
    """
    renderer = PlayRenderer(load_model(run, device_of(device)))
    return Renderer(render=renderer.render, scene=renderer.model.scene.name, picture=renderer.model.options.picture)


def states_of_columns(columns: Mapping[str, Float[np.ndarray, " numbers"]], scene: Scene) -> States:
    """What moves in one frame, from its columns; players without joints and a ball without a place are left out."""
    poses = {}
    for player in scene.players:
        assert player.skeleton is not None
        parts = [columns.get(f"{player.name}.{name}") for name in ("joint_rotations", "joint_translations")]
        if parts[0] is not None and parts[1] is not None:
            rows = [np.asarray(part, dtype=np.float64).reshape(1, -1, 3) for part in (parts[0], parts[1])]
            poses[player.name] = poses_of(player.skeleton, rows[0], rows[1])
    position = columns.get("ball.position")
    if scene.ball is None or position is None:
        return States(poses=poses, balls=None)
    place = torch.as_tensor(np.asarray(position)[None], dtype=torch.float32)
    # Nobody says how long the shutter is open.
    return States(poses=poses, balls=Balls(position=place, path=torch.zeros_like(place), radius=scene.ball.radius_m))
