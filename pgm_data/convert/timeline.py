"""The time line of exported clips: which frames they have and when, which foreign formats cannot hold.

It travels beside a COLMAP model (`pgm.json`) or inside a transforms.json (key `pgm`), so that cameras which come back
find their frames again.
"""

import math
from dataclasses import asdict, dataclass
from functools import cache
from typing import Any

import jsonschema
import numpy as np
from jaxtyping import Bool, Float, Int

from pgm_data.dataset.clip_camera import STATUSES
from pgm_data.dataset.columns import SCHEMA_VERSION
from pgm_data.dataset.document_schemas import CLIP, FOLDER_NAME, array, integer, mapping, nullable, number, record, text

VERDICTS = ("clip", "transition", "other")
TIMELINE_FILE = "pgm.json"
"""The time line beside a COLMAP model."""
TIMELINE_KEY = "pgm"
"""The time line inside a transforms.json."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ClipTimeline:
    """The frames of one clip."""

    document: dict[str, Any]
    """Its `clip.json`."""
    video_frame: Int[np.ndarray, " frames"]
    timestamp: Float[np.ndarray, " frames"]
    """Presentation time, s."""
    capture_time: Float[np.ndarray, " frames"]
    """When the picture was taken, s."""
    is_duplicate: Bool[np.ndarray, " frames"]
    status: tuple[str, ...]
    """Of the camera that was exported, or left out."""
    reason: tuple[str, ...]
    """Why the status is not `measured`; else empty."""


@dataclass(frozen=True, kw_only=True)
class FrameOf:
    """A frame of a clip."""

    clip_id: str
    frame_index: int


@dataclass(frozen=True, kw_only=True)
class LeftOut:
    """A chosen frame that has no camera."""

    clip_id: str
    frame_index: int
    reason: str


@dataclass(frozen=True, kw_only=True)
class ShotRun:
    """Frames in a row of which `shots.parquet` says the same."""

    frames: int
    verdict: str
    reason: str
    clip_id: str


@dataclass(frozen=True, eq=False, kw_only=True)
class VideoShots:
    """All frames of one video."""

    timestamp: Float[np.ndarray, " frames"]
    """Presentation time, s."""
    runs: tuple[ShotRun, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class Timeline:
    """The frames of all clips, and which of them each picture shows."""

    clips: dict[str, ClipTimeline]
    pictures: dict[str, FrameOf]
    """By the picture's name."""
    left_out: tuple[LeftOut, ...]
    shots: dict[str, VideoShots]
    """By the video's path; empty where the work folder had no shots.parquet."""


_FRAME = {"clip_id": text("the clip", pattern=FOLDER_NAME), "frame_index": integer("frame of the clip", low=0)}
_TIME = nullable(number("s"))
_RUN = record(
    "frames of which the same is said",
    {
        "frames": integer("how many", low=1),
        "verdict": text("as in shots.parquet", one_of=VERDICTS),
        "reason": text("why it is not clip"),
        "clip_id": text("the clip, or empty"),
    },
)
SCHEMA = record(
    "which frames exported pictures show, and the time line of their clips",
    {
        "schema_version": text("of the tables"),
        "clips": mapping(
            "clips by name",
            record(
                "the frames of one clip",
                {
                    "clip": CLIP,
                    "video_frame": array("frame of the source video", integer("from 0", low=0)),
                    "timestamp": array("presentation times", _TIME),
                    "capture_time": array("when the pictures were taken", _TIME),
                    "is_duplicate": array("whether a picture repeats an earlier one", {"type": "boolean"}),
                    "status": array("of the camera", text("status", one_of=STATUSES)),
                    "reason": array("why it is not measured", text("reason")),
                },
            ),
            FOLDER_NAME,
        ),
        "pictures": {
            "type": "object",
            "description": "the frame that each picture shows",
            "additionalProperties": record("a frame", _FRAME),
        },
        "left_out": array("chosen frames without a camera", record("a frame", _FRAME | {"reason": text("why")})),
        "shots": {
            "type": "object",
            "description": "the frames of each video",
            "additionalProperties": record(
                "the frames of one video",
                {"timestamp": array("presentation times", number("s")), "runs": array("frames in a row", _RUN)},
            ),
        },
    },
)


@cache
def _validator() -> jsonschema.Draft202012Validator:
    return jsonschema.Draft202012Validator(SCHEMA)


def json_from_timeline(timeline: Timeline) -> dict[str, Any]:
    """The time line as JSON values."""
    return {
        "schema_version": SCHEMA_VERSION,
        "clips": {
            clip_id: {
                "clip": clip.document,
                "video_frame": clip.video_frame.tolist(),
                "timestamp": [value if math.isfinite(value) else None for value in clip.timestamp.tolist()],
                "capture_time": [value if math.isfinite(value) else None for value in clip.capture_time.tolist()],
                "is_duplicate": clip.is_duplicate.tolist(),
                "status": list(clip.status),
                "reason": list(clip.reason),
            }
            for clip_id, clip in timeline.clips.items()
        },
        "pictures": {name: asdict(frame) for name, frame in timeline.pictures.items()},
        "left_out": [asdict(frame) for frame in timeline.left_out],
        "shots": {
            video: {"timestamp": shots.timestamp.tolist(), "runs": [asdict(run) for run in shots.runs]}
            for video, shots in timeline.shots.items()
        },
    }


def timeline_from_json(place: str, value: Any) -> Timeline:
    """The time line of JSON values, checked.

    Raises:
        ValueError: If it misses its schema, its columns differ in length, or a picture shows no frame of a clip.
    """
    error = next(iter(_validator().iter_errors(value)), None)
    if error is not None:
        field = ".".join(str(part) for part in error.absolute_path) or "time line"
        raise ValueError(f"{place}: {field}: expected a time line as pgm export writes it, got: {error.message[:200]}")
    clips = {clip_id: _clip(f"{place}: clips.{clip_id}", clip_id, clip) for clip_id, clip in value["clips"].items()}
    pictures = {name: FrameOf(**frame) for name, frame in value["pictures"].items()}
    shown: set[tuple[str, int]] = set()
    for name, frame in pictures.items():
        frames = len(clips[frame.clip_id].status) if frame.clip_id in clips else 0
        key = (frame.clip_id, frame.frame_index)
        if not frame.frame_index < frames or key in shown:
            expected = "a frame of a clip in it, each shown once"
            raise ValueError(f"{place}: pictures.{name}: expected {expected}, got {frame.clip_id} {frame.frame_index}")
        shown.add(key)
    return Timeline(
        clips=clips,
        pictures=pictures,
        left_out=tuple(LeftOut(**frame) for frame in value["left_out"]),
        shots={video: _shots(f"{place}: shots.{video}", shots) for video, shots in value["shots"].items()},
    )


def _shots(place: str, value: dict[str, Any]) -> VideoShots:
    runs = tuple(ShotRun(**run) for run in value["runs"])
    frames = sum(run.frames for run in runs)
    if frames != len(value["timestamp"]):
        raise ValueError(f"{place}.runs: expected {len(value['timestamp'])} frames, as it has times, got {frames}")
    return VideoShots(timestamp=np.array(value["timestamp"], dtype=np.float64), runs=runs)


def _clip(place: str, clip_id: str, value: dict[str, Any]) -> ClipTimeline:
    frames = value["clip"]["n_frames"]
    if value["clip"]["clip_id"] != clip_id:
        raise ValueError(f"{place}.clip.clip_id: expected {clip_id!r}, got {value['clip']['clip_id']!r}")
    for name in ("video_frame", "timestamp", "capture_time", "is_duplicate", "status", "reason"):
        if len(value[name]) != frames:
            raise ValueError(f"{place}.{name}: expected {frames} values, one a frame, got {len(value[name])}")

    def times(name: str) -> np.ndarray:
        return np.array([math.nan if time is None else time for time in value[name]], dtype=np.float64)

    return ClipTimeline(
        document=value["clip"],
        video_frame=np.array(value["video_frame"], dtype=np.int64),
        timestamp=times("timestamp"),
        capture_time=times("capture_time"),
        is_duplicate=np.array(value["is_duplicate"], dtype=bool),
        status=tuple(value["status"]),
        reason=tuple(value["reason"]),
    )
