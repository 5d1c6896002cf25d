"""People by a detector network of the user's own, an ONNX file of one of the layouts that are common.

Boxes of these networks run from pixel edge to pixel edge, 0 at the picture's corner; ours count from the middle of the
corner's pixel.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8

from pgm_data.dataset.clip_camera import ClipCamera
from pgm_data.detect.onnx_file import network_file, open_network
from pgm_data.detect.players.candidates import PersonCandidates, Pictures
from pgm_data.detect.players.person_frames import frames_to_look_at, joined, people_of
from pgm_data.geometry.camera import Camera, meet_plane
from pgm_data.scene import Scene

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

Layout = Literal["yolox", "rtmdet", "rtmdet_boxes", "rtmdet_heads"]
"""`yolox`: one output (1, N, 5 + classes), boxes not yet decoded. `rtmdet`: boxes with scores (1, N, 5) and labels
(1, N), as mmdeploy exports it whole. `rtmdet_boxes`: boxes (1, N, 4) and scores (1, N, classes). `rtmdet_heads`: three
maps of class logits, then three of distances to the box's edges.
"""
LAYOUTS = (
    "one output (1, N, 5 + classes) as YOLOX has it; (1, N, 5) and (1, N), or (1, N, 4) and (1, N, classes), or three "
    "maps (1, classes, h, w) and three (1, 4, h, w) as RTMDet has them"
)
STRIDES = (8, 16, 32)
PERSON = 0
"""Class of people."""
USUAL_SIZE = 640
"""Width and height of the input where the network takes any."""
PADDING = 114
"""Grey of the input where there is no picture."""
RTMDET_MEAN = np.array([103.53, 116.28, 123.675], np.float32)
RTMDET_STD = np.array([57.375, 57.12, 58.395], np.float32)
"""Of blue, green and red, by which RTMDet's input is normalised."""
LARGEST_LOG_SIZE = 12.0
"""Of a box over its stride: more is no logarithm."""


@dataclass(frozen=True, kw_only=True)
class OnnxPeopleOptions:
    """How much of what a detector says is kept."""

    least_person: float = 0.3
    """Boxes under this score are left out."""
    overlap: float = 0.65
    """Of two boxes whose intersection over union is larger, the one with the higher score stays."""
    most: int = 40
    """Boxes a frame."""


class OnnxPeople:
    """People by a network of YOLOX's or RTMDet's layout; a `PersonFinder` that cannot tell who plays."""

    def __init__(
        self,
        session: "InferenceSession",
        layout: Layout,
        input_size: tuple[int, int],
        *,
        every: int = 1,
        options: OnnxPeopleOptions | None = None,
    ) -> None:
        """Use `load`."""
        self._session, self._every = session, every
        self._options = options or OnnxPeopleOptions()
        self.layout: Layout = layout
        """Of the outputs."""
        self.input_size = input_size
        """Width and height, pixels."""

    @classmethod
    def load(
        cls, path: Path, *, threads: int = 1, every: int = 1, options: OnnxPeopleOptions | None = None
    ) -> "OnnxPeople":
        """The finder with the network in that file, looking at every so manyth distinct frame.

        Raises:
            FileNotFoundError: If there is no such file.
            ValueError: If it is no ONNX file or of another layout, or `every` is below 1.
        """
        if every < 1:
            raise ValueError(f"people detector: every: expected 1 or more, got {every}")
        with network_file(path, shipped="", what="people detector") as file:
            session = open_network(file, threads=threads, what="people detector")
        inputs = [tuple(i.shape) for i in session.get_inputs()]
        outputs = [tuple(o.shape) for o in session.get_outputs()]
        size, layout = input_size_of(inputs), layout_of(outputs)
        if size is None or layout is None or session.get_inputs()[0].type != "tensor(float)":
            kinds = [i.type for i in session.get_inputs()]
            raise ValueError(
                f"people detector {path}: expected one input (1, 3, height, width) of floats with multiples of "
                f"{STRIDES[-1]}, and {LAYOUTS}; found inputs {inputs} of {kinds} and outputs {outputs}"
            )
        return cls(session, layout, size, every=every, options=options)

    def find(self, pictures: Pictures, clip: ClipCamera, *, size: tuple[int, int], scene: Scene) -> PersonCandidates:
        """People in the frames of a clip that have a camera; see `PersonFinder`.

        Raises:
            ValueError: If a picture has another size, there are fewer pictures than frames, or the network's answers
                are not what its layout promises.
        """
        shown = frames_to_look_at(pictures, clip, size=size, every=self._every)
        return joined([(frame, self.look(bgr, clip.camera[frame])) for frame, bgr in shown])

    def look(self, bgr: UInt8[np.ndarray, "height width 3"], camera: Camera) -> PersonCandidates:
        """People in one picture with its camera, as of frame 0.

        Raises:
            ValueError: If the network's answers are not what its layout promises.
        """
        boxes, person = self.boxes(bgr)
        feet = np.stack([boxes[:, [0, 2]].mean(axis=1), boxes[:, 3]], axis=1)
        ground = meet_plane(camera, feet)[:, :2]
        return people_of(boxes, ground, person, np.full(len(person), np.nan))

    def boxes(
        self, bgr: UInt8[np.ndarray, "height width 3"]
    ) -> tuple[Float[np.ndarray, "people 4"], Float[np.ndarray, " people"]]:
        """Boxes around people, picture pixels, and their scores, the highest first.

        Raises:
            ValueError: If the network's answers are not what its layout promises.
        """
        filled, scale = letterboxed(bgr, self.input_size)
        if self.layout != "yolox":
            filled = (filled - RTMDET_MEAN) / RTMDET_STD
        planes = np.ascontiguousarray(np.moveaxis(filled, 2, 0)[None], dtype=np.float32)
        name = self._session.get_inputs()[0].name
        answers = [np.asarray(a) for a in self._session.run(None, {name: planes})]
        boxes, person = _DECODERS[self.layout](answers, self.input_size)
        kept = np.flatnonzero(person >= self._options.least_person)
        boxes, person = boxes[kept] / scale - 0.5, person[kept]
        corners = np.concatenate([boxes[:, :2], boxes[:, 2:] - boxes[:, :2]], axis=1)
        chosen = cv2.dnn.NMSBoxes(corners.tolist(), person.tolist(), self._options.least_person, self._options.overlap)
        rows = np.array(chosen, dtype=np.int64).ravel()[: self._options.most]
        return boxes[rows], person[rows]


def input_size_of(inputs: Sequence[tuple]) -> tuple[int, int] | None:
    """Width and height of a detector's input, by the shapes of a network's inputs; None where it is no detector's."""
    if len(inputs) != 1 or len(inputs[0]) != 4 or inputs[0][1] not in (3, None) and not isinstance(inputs[0][1], str):
        return None
    high, wide = (length if isinstance(length, int) else USUAL_SIZE for length in inputs[0][2:])
    if min(high, wide) < STRIDES[-1] or high % STRIDES[-1] or wide % STRIDES[-1]:
        return None
    return wide, high


def layout_of(outputs: Sequence[tuple]) -> Layout | None:
    """The layout by the shapes of a network's outputs, lengths that it leaves open as no integers; None of others."""
    axes = [len(shape) for shape in outputs]
    last = [shape[-1] if shape else None for shape in outputs]
    if axes == [3] and isinstance(last[0], int) and last[0] >= 6:
        return "yolox"
    if axes == [3, 2] and last[0] == 5:
        return "rtmdet"
    if axes == [3, 3] and last[0] == 4:
        return "rtmdet_boxes"
    if axes == [4] * 6 and all(shape[1] == 4 for shape in outputs[3:]):
        return "rtmdet_heads"
    return None


def letterboxed(
    bgr: UInt8[np.ndarray, "height width 3"], input_size: tuple[int, int]
) -> tuple[Float32[np.ndarray, "rows columns 3"], float]:
    """The picture in the input's upper left corner on grey, as large as it fits, and its scale."""
    wide, high = input_size
    scale = min(wide / bgr.shape[1], high / bgr.shape[0])
    size = (max(1, min(wide, int(bgr.shape[1] * scale))), max(1, min(high, int(bgr.shape[0] * scale))))
    filled = np.full((high, wide, 3), PADDING, np.float32)
    filled[: size[1], : size[0]] = cv2.resize(bgr, size, interpolation=cv2.INTER_LINEAR)
    return filled, scale


def cells(input_size: tuple[int, int]) -> tuple[Float[np.ndarray, "cells 2"], Float[np.ndarray, " cells"]]:
    """Column and row of every cell of the three grids, the finest first, row by row; and each one's stride, pixels."""
    places, strides = [], []
    for stride in STRIDES:
        rows, columns = np.indices((input_size[1] // stride, input_size[0] // stride))
        places.append(np.stack([columns.ravel(), rows.ravel()], axis=1).astype(float))
        strides.append(np.full(rows.size, float(stride)))
    return np.concatenate(places), np.concatenate(strides)


def decode_yolox(answers: list[np.ndarray], input_size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Boxes (N, 4) in input pixels and scores of people. Source: Ge et al., YOLOX (arXiv 2107.08430), section 2.

    Raises:
        ValueError: If there is not one row for each cell, or the boxes are decoded already.
    """
    rows = answers[0][0].astype(float)
    place, stride = cells(input_size)
    if len(rows) != len(place):
        raise ValueError(
            f"people detector: expected a row for each of {len(place)} cells of {input_size[0]}x{input_size[1]} at "
            f"strides {STRIDES}, got {len(rows)}"
        )
    largest = float(rows[:, 2:4].max(initial=0.0))
    if not largest < LARGEST_LOG_SIZE:
        raise ValueError(
            f"people detector: expected logarithms of the boxes' sizes, under {LARGEST_LOG_SIZE:g}, got {largest:g}: "
            "export the network without decoding"
        )
    middle = (rows[:, :2] + place) * stride[:, None]
    half = 0.5 * np.exp(rows[:, 2:4]) * stride[:, None]
    return np.concatenate([middle - half, middle + half], axis=1), rows[:, 4] * rows[:, 5 + PERSON]


def _decode_rtmdet(answers: list[np.ndarray], input_size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    rows, labels = answers[0][0].astype(float), answers[1][0]
    people = np.asarray(labels == PERSON)
    return rows[people, :4], rows[people, 4]


def _decode_rtmdet_boxes(answers: list[np.ndarray], input_size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    return answers[0][0].astype(float), answers[1][0, :, PERSON].astype(float)


def _decode_rtmdet_heads(answers: list[np.ndarray], input_size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Source: Lyu et al., RTMDet (arXiv 2212.07784); a cell's point is its upper left corner."""
    place, stride = cells(input_size)
    logits = np.concatenate([a[0, PERSON].ravel() for a in answers[:3]]).astype(float)
    reach = np.concatenate([a[0].reshape(4, -1).T for a in answers[3:]]).astype(float)
    if len(logits) != len(place) or len(reach) != len(place):
        raise ValueError(
            f"people detector: expected maps of {len(place)} cells at strides {STRIDES}, the finest first, got "
            f"{[a.shape for a in answers]}"
        )
    point = place * stride[:, None]
    boxes = np.concatenate([point - reach[:, :2], point + reach[:, 2:]], axis=1)
    return boxes, 1 / (1 + np.exp(-np.clip(logits, -60, 60)))


_DECODERS = {
    "yolox": decode_yolox,
    "rtmdet": _decode_rtmdet,
    "rtmdet_boxes": _decode_rtmdet_boxes,
    "rtmdet_heads": _decode_rtmdet_heads,
}
