"""The bundled network that tells, step by step, what happens to a ball from its track; read by `track_events`."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from pgm_data.detect.ball.track_features import FEATURES, STEP_S
from pgm_data.detect.onnx_file import network_file, open_network

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

CLASSES = ("nothing", "hit", "bounce", "dead_bounce", "net", "toss")
"""What may happen in a step. `dead_bounce`: after the play's last; `toss`: the server lets the ball go."""
NETWORK_FILE = "track_events.onnx"
"""The file that ships with the package."""


class TrackEventNetwork:
    """A loaded network; `shares` may be called from several threads."""

    def __init__(self, session: "InferenceSession") -> None:
        """Use `load`."""
        self._session = session

    @classmethod
    def load(cls, path: Path | None = None) -> "TrackEventNetwork":
        """The network in that file, or the one that ships with the package.

        Raises:
            FileNotFoundError: If there is no such file.
            ValueError: If it is not a network of this kind.
        """
        with network_file(path, shipped=NETWORK_FILE, what="track event network") as file:
            session = open_network(file, threads=1, what="track event network")
            about = session.get_modelmeta().custom_metadata_map
            found = json.loads(about.get("classes", "[]")), json.loads(about.get("step_s", "0"))
            features = session.get_inputs()[0].shape[1:2]
            if found != (list(CLASSES), STEP_S) or features != [FEATURES]:
                raise ValueError(
                    f"track event network {file}: expected the classes {CLASSES}, steps of {STEP_S} s and {FEATURES} "
                    f"features, found {found[0]}, {found[1]} and {features}"
                )
        return cls(session)

    def shares(self, features: Float[np.ndarray, "features steps"]) -> Float[np.ndarray, "classes steps"]:
        """Probability of each of `CLASSES` in each step; they sum to one in a step."""
        (logits,) = self._session.run(["logits"], {"features": features[None].astype(np.float32)})
        return class_shares(np.asarray(logits, dtype=float)[0])


def class_shares(logits: Float[np.ndarray, "classes steps"]) -> Float[np.ndarray, "classes steps"]:
    """Probabilities of the classes from their logits."""
    shares = np.exp(logits - logits.max(axis=0))
    return shares / shares.sum(axis=0)
