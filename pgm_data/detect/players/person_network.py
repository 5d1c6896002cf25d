"""People in the strips of a picture, by the network that `pgm-train people` trained."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Float32, Int, UInt8

from pgm_data.dataset.clip_camera import ClipCamera
from pgm_data.detect.onnx_file import network_file, open_network
from pgm_data.detect.players.candidates import PersonCandidates, Pictures
from pgm_data.detect.players.person_frames import frames_to_look_at, joined, nobody, people_of
from pgm_data.detect.players.person_strips import PERSON_PX, ROWS, StripPlan, cut_strips, plan_strips, strip_maps
from pgm_data.geometry.camera import Camera, project
from pgm_data.scene import Scene

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

PERSON_NETWORK = "person.onnx"
"""File name of the network that ships with the package."""
STRIDE = 4
"""Strip pixels per cell of the answers."""
CHANNELS = ("person", "player", "left", "top", "right", "bottom", "feet_right", "feet_down")
"""Of the answers: logit of a person about this cell, and that it plays; its box's edges away from the cell's centre,
and its feet to the right of and below it, in heights of a standing person.
"""
APART = 1
"""Cells on each side of a peak in which no weaker one counts."""


@dataclass(frozen=True, kw_only=True)
class StripPeopleOptions:
    """How much of what the network says is kept."""

    least_person: float = 0.15
    """Candidates under this probability of a person are left out."""
    most: int = 24
    """Candidates a frame."""
    same_across: float = 0.3
    """Two candidates whose middles lie closer than this across, in heights of a person, may be one person."""
    same_down: float = 0.35
    """Likewise along the picture's height."""


@dataclass(frozen=True, kw_only=True)
class PersonCalibration:
    """What a network's own words are worth, measured on pictures it was not trained on."""

    person_slope: float = 1.0
    """Of the logit of the true probability of a person over the network's."""
    person_shift: float = 0.0
    """The logit of the true probability where the network's is 0."""
    player_slope: float = 1.0
    """As for a person."""
    player_shift: float = 0.0
    """As for a person."""

    def person(self, logits: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
        """Probability of a person."""
        return _probability(self.person_slope * logits + self.person_shift)

    def player(self, logits: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
        """Probability that a person plays."""
        return _probability(self.player_slope * logits + self.player_shift)


def _probability(logits: np.ndarray) -> np.ndarray:
    return np.asarray(1 / (1 + np.exp(-np.clip(logits, -60, 60))), dtype=float)


@dataclass(frozen=True, eq=False, kw_only=True)
class Peaks:
    """Where the network sees people in strips."""

    strip: Int[np.ndarray, " peaks"]
    """Which of the strips."""
    feet: Float[np.ndarray, "peaks 2"]
    """Column and row, strip pixels."""
    box: Float[np.ndarray, "peaks 4"]
    """Left, top, right, bottom, strip pixels."""
    person: Float[np.ndarray, " peaks"]
    """Logit of a person."""
    player: Float[np.ndarray, " peaks"]
    """Logit that it plays."""


def read_peaks(answers: Float32[np.ndarray, "strips channels high wide"], *, least: float) -> Peaks:
    """The cells with a person's logit of `least` or more and none higher next to them, the highest first."""
    heat = answers[:, 0]
    padded = np.pad(heat, ((0, 0), (APART, APART), (APART, APART)), constant_values=-np.inf)
    span = range(2 * APART + 1)
    high, wide = heat.shape[1:]
    around = np.max([padded[:, row : row + high, column : column + wide] for row in span for column in span], axis=0)
    strip, row, column = np.nonzero((heat >= least) & (heat >= around))
    order = np.argsort(-heat[strip, row, column], kind="stable")
    strip, row, column = strip[order], row[order], column[order]
    said = answers[strip, :, row, column].astype(float)
    x, y = (column + 0.5) * STRIDE - 0.5, (row + 0.5) * STRIDE - 0.5
    box = np.stack([x, y, x, y], axis=1) + PERSON_PX * said[:, 2:6] * np.array([-1.0, -1.0, 1.0, 1.0])
    feet = np.stack([x, y], axis=1) + PERSON_PX * said[:, 6:8]
    return Peaks(strip=strip, feet=feet, box=box, person=said[:, 0], player=said[:, 1])


class PersonNetwork:
    """A loaded network."""

    def __init__(self, session: "InferenceSession", calibration: PersonCalibration) -> None:
        """Use `load`."""
        self._session = session
        self.calibration = calibration
        """From the file."""

    @classmethod
    def load(cls, path: Path | None = None, *, threads: int = 1) -> "PersonNetwork":
        """The network in that file, or the one that ships with the package.

        Raises:
            FileNotFoundError: If there is no such file.
            ValueError: If it is no network for people in strips.
        """
        with network_file(path, shipped=PERSON_NETWORK, what="person network") as file:
            session = open_network(file, threads=threads, what="person network")
            about = session.get_modelmeta().custom_metadata_map
            inputs = [i.name for i in session.get_inputs()]
            if not {"person_channels", "calibration"} <= set(about) or inputs != ["strips"]:
                raise ValueError(
                    f"person network {file}: expected person_channels and calibration in its metadata and the input "
                    f"strips, found metadata {sorted(about)} and inputs {inputs}"
                )
            channels = tuple(json.loads(about["person_channels"]))
            if channels != CHANNELS:
                raise ValueError(f"person network {file}: expected the answers {CHANNELS}, found {channels}")
            return cls(session, PersonCalibration(**json.loads(about["calibration"])))

    def answers(
        self, strips: UInt8[np.ndarray, "strips rows columns 3"]
    ) -> Float32[np.ndarray, "strips channels high wide"]:
        """The network's own answers (`CHANNELS`), from strips in blue, green, red."""
        (answers,) = self._session.run(["answers"], {"strips": strips})
        return np.asarray(answers)


class StripPeople:
    """People by their looks alone, in strips of the picture where they are of one size; a `PersonFinder`."""

    def __init__(self, network: PersonNetwork, *, every: int = 1, options: StripPeopleOptions | None = None) -> None:
        """A finder that looks at every so manyth distinct frame."""
        if every < 1:
            raise ValueError(f"people in strips: every: expected 1 or more, got {every}")
        self._network, self._every = network, every
        self._options = options or StripPeopleOptions()

    @classmethod
    def load(
        cls,
        path: Path | None = None,
        *,
        threads: int = 1,
        every: int = 1,
        options: StripPeopleOptions | None = None,
    ) -> "StripPeople":
        """The finder with the network in that file, or with the one that ships with the package.

        Raises:
            FileNotFoundError: If there is no such file.
            ValueError: If it is no network for people in strips, or `every` is below 1.
        """
        return cls(PersonNetwork.load(path, threads=threads), every=every, options=options)

    def find(self, pictures: Pictures, clip: ClipCamera, *, size: tuple[int, int], scene: Scene) -> PersonCandidates:
        """People in the frames of a clip that have a camera; see `PersonFinder`.

        Raises:
            ValueError: If a picture has another size, there are fewer pictures than frames, or the scene says neither
                where its players may be nor where its court is.
        """
        seen: list[tuple[int, PersonCandidates]] = []
        key, plan, maps = b"", None, np.zeros((0, ROWS, 0, 2), np.float32)
        for frame, bgr in frames_to_look_at(pictures, clip, size=size, every=self._every):
            camera = clip.camera[frame]
            arrays = (camera.K, camera.distortion, camera.R_cam_from_world, camera.t_cam_from_world)
            now = b"".join(a.tobytes() for a in arrays)
            if now != key:
                key, plan = now, plan_strips(camera, size=size, scene=scene)
                maps = maps if plan is None else strip_maps(plan, camera)
            if plan is not None:
                seen.append((frame, self._seen(bgr, camera, plan, maps)))
        return joined(seen)

    def look(self, bgr: UInt8[np.ndarray, "height width 3"], camera: Camera, *, scene: Scene) -> PersonCandidates:
        """People in one picture with its camera, as of frame 0."""
        size = (bgr.shape[1], bgr.shape[0])
        plan = plan_strips(camera, size=size, scene=scene)
        return nobody() if plan is None else self._seen(bgr, camera, plan, strip_maps(plan, camera))

    def _seen(self, bgr: np.ndarray, camera: Camera, plan: StripPlan, maps: np.ndarray) -> PersonCandidates:
        options, calibration = self._options, self._network.calibration
        answers = self._network.answers(cut_strips(bgr, maps))
        share = np.clip(options.least_person, 1e-6, 1 - 1e-6)
        least = float((np.log(share / (1 - share)) - calibration.person_shift) / calibration.person_slope)
        peaks = read_peaks(answers, least=least)
        peaks = _some(peaks, _distinct(peaks, plan, options)[: options.most])
        corners = peaks.box.reshape(-1, 2, 2)
        # The lower left and upper right corners as well: a picture may be turned against the strip.
        four = np.stack([corners[:, [0, 0, 1, 1], 0], corners[:, [0, 1, 0, 1], 1]], axis=-1)
        world = plan.world(np.repeat(peaks.strip[:, None], 4, axis=1), four)
        pixels, _ = project(camera, world.reshape(-1, 3))
        pixels = pixels.reshape(-1, 4, 2)
        ground = plan.ground(peaks.strip, peaks.feet)
        boxes = np.concatenate([pixels.min(axis=1), pixels.max(axis=1)], axis=1)
        return people_of(boxes, ground, calibration.person(peaks.person), calibration.player(peaks.player))


def _some(peaks: Peaks, rows: np.ndarray) -> Peaks:
    return Peaks(
        strip=peaks.strip[rows],
        feet=peaks.feet[rows],
        box=peaks.box[rows],
        person=peaks.person[rows],
        player=peaks.player[rows],
    )


def _distinct(peaks: Peaks, plan: StripPlan, options: StripPeopleOptions) -> np.ndarray:
    """Rows of peaks that are not the same person as a stronger one in this strip or another."""
    side, up = plan.plane(peaks.strip, peaks.feet)
    middle = up + 0.5 * PERSON_PX / plan.px_per_m
    depth = plan.depths[peaks.strip]
    # Directions from the camera, as shares of the depth: what lies behind one another has the same.
    seen = np.stack([side / depth, (middle - plan.view.height) / depth], axis=1)
    tall = (PERSON_PX / plan.px_per_m) / depth
    room = np.array([options.same_across, options.same_down])
    kept: list[int] = []
    for row in range(len(depth)):
        away = np.abs(seen[kept] - seen[row]) / np.maximum(tall[kept], tall[row])[:, None]
        if not (away < room).all(axis=1).any():
            kept.append(row)
    return np.array(kept, dtype=np.int64)
