"""LPIPS, FID and FVD of made pictures, by networks whose weights a user gives; what was not given is not available."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from pgm_models.image_inception import FidNetwork, FvdNetwork, load_fid, load_fvd, words_of
from pgm_models.image_networks import Lpips, MetricUnavailable, load_lpips

CLIP_FRAMES = 16
"""Frames of a clip that FVD looks at; what is left over at a clip's end is not."""


@dataclass(frozen=True, kw_only=True)
class WeightFiles:
    """Where the weights of networks are; None of those that nobody gave."""

    lpips: Path | None = None
    """AlexNet or VGG16."""
    lpips_heads: Path | None = None
    """The linear heads of LPIPS for it."""
    fid: Path | None = None
    """Inception v3."""
    fvd: Path | None = None
    """I3D."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Networks:
    """Those that there are."""

    lpips: Lpips | MetricUnavailable
    fid: FidNetwork | MetricUnavailable
    fvd: FvdNetwork | MetricUnavailable
    device: torch.device

    @property
    def origins(self) -> dict[str, str]:
        """What each figure rests on, or why there is none."""
        found = {"LPIPS": self.lpips, "FID": self.fid, "FVD": self.fvd}
        return {
            name: f"n/a ({each})" if isinstance(each, MetricUnavailable) else each.origin
            for name, each in found.items()
        }

    @torch.inference_mode()
    def distances(
        self, made: Float[np.ndarray, "frames 3 height width"], real: Float[np.ndarray, "frames 3 height width"]
    ) -> Float[np.ndarray, " frames"]:
        """LPIPS of each pair; NaN where it is not available."""
        if isinstance(self.lpips, MetricUnavailable):
            return np.full(len(made), np.nan)
        pair = [torch.from_numpy(each.astype(np.float32)).to(self.device) for each in (made, real)]
        return self.lpips(*pair).double().cpu().numpy()


def load_networks(files: WeightFiles, device: torch.device) -> Networks:
    """The networks whose weights were given.

    Raises:
        FileNotFoundError: If a file is not there.
        ValueError: If one holds something else.
    """
    networks: list = []
    for load in (
        lambda: load_lpips(files.lpips, files.lpips_heads),
        lambda: load_fid(files.fid),
        lambda: load_fvd(files.fvd),
    ):
        try:
            networks.append(load().to(device))
        except MetricUnavailable as error:
            networks.append(error)
    return Networks(lpips=networks[0], fid=networks[1], fvd=networks[2], device=device)


class WordTaker:
    """Takes what FID's and FVD's networks say of a clip's pictures, block by block, frames that follow each other."""

    def __init__(self, networks: Networks) -> None:
        """Nothing taken yet."""
        self._networks = networks
        self._waiting: tuple[np.ndarray, np.ndarray] | None = None
        self._words: dict[str, list[np.ndarray]] = {}

    def __call__(
        self, made: Float[np.ndarray, "frames 3 height width"], real: Float[np.ndarray, "frames 3 height width"]
    ) -> None:
        """Take a block."""
        fid, fvd = self._networks.fid, self._networks.fvd
        pair = {"made": made.astype(np.float32), "real": real.astype(np.float32)}
        if isinstance(fid, FidNetwork):
            for name, pictures in pair.items():
                self._take(f"fid {name}", fid, pictures)
        if isinstance(fvd, FvdNetwork):
            waiting = self._waiting or (made[:0].astype(np.float32), real[:0].astype(np.float32))
            joined = [np.concatenate([before, now]) for before, now in zip(waiting, pair.values(), strict=True)]
            whole = len(joined[0]) // CLIP_FRAMES * CLIP_FRAMES
            for name, pictures in zip(pair, joined, strict=True):
                if whole:
                    self._take(f"fvd {name}", fvd, pictures[:whole].reshape(-1, CLIP_FRAMES, *pictures.shape[1:]))
            self._waiting = (joined[0][whole:], joined[1][whole:])

    @property
    def words(self) -> dict[str, Float[np.ndarray, "rows numbers"]]:
        """What each network said, by `fid made`, `fid real`, `fvd made` and `fvd real`, one row a picture or clip."""
        return {name: np.concatenate(parts) for name, parts in self._words.items()}

    def _take(self, name: str, network: FidNetwork | FvdNetwork, pictures: np.ndarray) -> None:
        found = words_of(network, [torch.from_numpy(pictures)])
        self._words.setdefault(name, []).append(found.astype(np.float32))
