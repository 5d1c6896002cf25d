"""JSON Schemas (2020-12) of the contract's documents: the one source of `schemas/*.json`."""

from pgm_data.dataset.camera_path_schema import CAMERA_PATH
from pgm_data.dataset.json_schema import (
    DIALECT,
    Schema,
    array,
    integer,
    mapping,
    nullable,
    number,
    numbers,
    record,
    text,
)

END = r"(?![\s\S])"
"""The very end of a text: Python's `$` would let a trailing line break through."""

_PART = r"(?!\.{1,2}(?:/|(?![\s\S])))[^/\\\u0000-\u001f]+"

RELATIVE_PATH = rf"^(?![A-Za-z]:){_PART}(?:/{_PART})*{END}"
"""A path below a folder: forward slashes, no drive, no `.` or `..` part."""

SOURCE_PATH = rf"^(?![A-Za-z]:)(?:\.\./)?{_PART}(?:/{_PART})*{END}"
"""As `RELATIVE_PATH`, with one leading `..` as the way to a video folder beside the work folder."""

FOLDER_NAME = rf"^[^./\\\u0000-\u001f][^/\\\u0000-\u001f]*{END}"
OBJECT_NAME = rf"^[a-z][a-z0-9_]*{END}"
POINT_NAME = rf"^[A-Za-z][A-Za-z0-9_]*{END}"
SHA256 = rf"^[0-9a-f]{{64}}{END}"
COMMIT = rf"^(?:[0-9a-f]{{7,64}}(?:\+changes)?)?{END}"
RATIO = rf"^[1-9][0-9]*/[1-9][0-9]*{END}"
MOMENT = rf"^\d{{4}}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d+)?(Z|[+-]\d\d:\d\d){END}"
SPAN = rf"^\d+:\d+{END}"
VERSION = rf"^\d+\.\d+{END}"

PATTERN_WORDS = {
    RELATIVE_PATH: "a relative path with forward slashes and no . or .. in it",
    SOURCE_PATH: "a relative path with forward slashes and at most one leading ..",
    FOLDER_NAME: "a folder's name: no slash, no leading dot",
    OBJECT_NAME: "a name of small letters, digits and _",
    POINT_NAME: "a name of letters, digits and _",
    SHA256: "64 hexadecimal digits",
    COMMIT: "the hexadecimal digits of a commit, +changes after them where files differ from it, or nothing",
    RATIO: "a ratio such as 1/90000",
    MOMENT: "a moment with its zone, such as 2026-01-31T12:00:00+00:00",
    SPAN: "a span such as 0:100",
    VERSION: "a version such as 1.0",
}
"""What the patterns ask for, in words."""


def _point(meaning: str) -> Schema:
    return numbers(meaning, 3)


def _prior(meaning: str) -> Schema:
    return record(meaning, {"mean": number("mean"), "std": number("standard deviation", above=0)})


def _area(meaning: str) -> Schema:
    return array(meaning, numbers("x, y of the lower, then of the upper corner, m", 2), 2)


COURT = record(
    "the painted court; absent where a scene has none",
    {
        "stores": text("what the points are", one_of=["line_centres"]),
        "points": mapping("crossings of line centres, world metres", _point("x, y, z in m"), POINT_NAME, 4),
        "lines": mapping(
            "painted lines",
            record(
                "one line",
                {
                    "ends": array("names of its two end points", {"type": "string"}, 2),
                    "width_m": number("painted width, m", above=0, high=1),
                },
            ),
            POINT_NAME,
            1,
        ),
        "surface_half_size_m": numbers("half width and half length of the playing surface with its run-off, m", 2),
    },
    {
        "out_of_plane": mapping("known points above the ground, world metres", _point("x, y, z in m"), POINT_NAME),
        "net": record(
            "the net",
            {
                "top": array("names of the points its top edge runs through", {"type": "string"}, least=2),
                "tape_width_m": number("height of the white band along its top, m", low=0, high=1),
            },
        ),
        "network": text("file of the network that finds this court", pattern=RELATIVE_PATH),
        "in_play": _area("where a ball in play may land, both halves, to the outer edges of the lines"),
        "in_serve": array(
            "where serves may land: that of the other half and the other side", _area("one of them"), least=1
        ),
    },
)

OBJECT = record(
    "one thing that a renderer draws",
    {
        "kind": text("what it is", one_of=["player", "ball", "plane", "static", "skybox"]),
        "box_m": array("size of its box along x, y, z, m", number("m", low=0), 3),
        "radiance": record(
            "how its radiance is stored",
            {
                "representation": text("the store", one_of=["voxels", "planes", "sphere", "directions"]),
                "grid": array("cells along each axis", integer("cells", low=1)),
                "features": integer("features per cell", low=1),
            },
            {
                "opacity": text(
                    "whether a plane hides all that is behind it, or how much it does is learned; solid unless said",
                    one_of=["solid", "learned"],
                ),
            },
        ),
        "samples_per_ray": integer("samples a ray takes inside its box", low=1),
    },
    {
        "skeleton": text("skeleton file; of players", pattern=OBJECT_NAME),
        "region_m": array("lower and upper corner of where it may be, world m", _point("x, y, z in m"), 2),
    },
) | {
    "if": {"properties": {"kind": {"const": "player"}}, "required": ["kind"]},
    "then": {"required": ["skeleton"]},
    "else": {"properties": {"skeleton": False}},
    "allOf": [
        {
            "if": {"properties": {"kind": {"const": "plane"}}, "required": ["kind"]},
            "else": {"properties": {"radiance": {"properties": {"opacity": {"const": "solid"}}}}},
        }
    ],
}

BALL = record(
    "constants of the ball; absent where a scene has none",
    {
        "radius_m": number("radius, m", above=0),
        "mass_kg": number("mass, kg", above=0),
        "drag_per_m": _prior("C = rho Cd A / (2 m), 1/m"),
        "lift": text("whether spin bends the flight", one_of=["none", "spin"]),
    },
    {
        "restitution": _prior("vertical speed kept at a bounce; absent where it does not bounce in play"),
        "friction": _prior("sliding friction at a bounce"),
        "spin_std_rad_s": number("standard deviation of the spin after a hit about each axis, rad/s", above=0),
    },
) | {
    "if": {"properties": {"lift": {"const": "spin"}}, "required": ["lift"]},
    "then": {"required": ["spin_std_rad_s"]},
    "else": {"properties": {"spin_std_rad_s": False}},
}

SCENE = record(
    "what a scene declares; nothing else is detected, solved, written or trained",
    {
        "name": text("name of the scene", pattern=OBJECT_NAME),
        "camera": record(
            "the camera",
            {
                "position": text("whether a clip's camera turns about one fixed centre", one_of=["fixed", "moving"]),
                "person_height_m": number("height of a person, m", above=0, high=10),
            },
        ),
        "objects": mapping("things that a renderer draws", OBJECT, OBJECT_NAME, 1),
    },
    {"court": COURT, "ball": BALL},
)

SKELETON = record(
    "joints, parents, rest pose and keypoint set of a skeleton",
    {
        "name": text("name of the skeleton", pattern=OBJECT_NAME),
        "joints": mapping(
            "joints, the root first, parents before children",
            record(
                "one joint",
                {
                    "parent": nullable(text("its parent; null of the root")),
                    "rest_m": numbers("position in the parent's frame in the rest pose, m", 3),
                },
                {
                    "limits_deg": array(
                        "lowest and highest x, y, z of the axis-angle vector of parent_from_joint, degrees",
                        numbers("x, y, z in degrees", 3),
                        2,
                    ),
                },
            ),
            POINT_NAME,
            1,
        ),
        "points": mapping(
            "points of the body that detectors name",
            record(
                "one point",
                {
                    "joint": text("the joint that it hangs on"),
                    "at_m": numbers("position in the joint's frame, m at the size of the rest pose", 3),
                },
            ),
            POINT_NAME,
            1,
        ),
        "soles": record(
            "points of the soles, which touch the ground in the rest pose",
            {side: array(f"points of the {side} one", {"type": "string"}, least=1) for side in ("left", "right")},
        ),
        "keypoints": array("points that are the 2D keypoint set of the tables", {"type": "string"}, least=1)
        | {"uniqueItems": True},
    },
)

LENS_MODEL = record(
    "the lens model that was chosen",
    {"model": text("the model", least=1), "reason": text("why it was chosen", least=1)},
)

CLIP_CAMERA = record(
    "summary of the clip's camera",
    {},
    {
        "position_world": nullable(numbers("its centre, world m", 3)),
        "position_std": nullable(numbers("standard deviation of the centre, m", 3)),
        "jitter_px": nullable(number("measured jitter of a fixed camera, px", low=0)),
        "focal_px_range": nullable(numbers("shortest and longest focal length, px", 2)),
        "principal_point": nullable(numbers("principal point, px", 2)),
        "evidence": {"description": "what the choices of the lens and of the principal point rest on"},
    },
)

CLIP = record(
    "one clip: an uninterrupted shot that shows the scene",
    {
        "clip_id": text("the clip, the name of its folder", pattern=FOLDER_NAME),
        "match_id": text("the match; splits never divide one", least=1),
        "source_path": text(
            "the video, from the folder given as --videos, else from the work folder; one leading .. leads beside it",
            SOURCE_PATH,
        ),
        "sha256": text("of the video file", pattern=SHA256),
        "bytes": integer("size of the video file", low=0),
        "width": integer("width as displayed, px", low=1, high=65536),
        "height": integer("height as displayed, px", low=1, high=65536),
        "time_base": text("unit of the video's time stamps, s", pattern=RATIO),
        "first_video_frame": integer("video frame of the clip's first", low=0),
        "n_frames": integer("decoded frames of the clip", low=1),
        "scene": text("the scene", least=1),
        "quality": text(
            "preset; truth: exact, from a simulator; imported: from somebody else's files; generated: by a model",
            one_of=["draft", "standard", "best", "truth", "imported", "generated"],
        ),
        "lens_model": nullable(LENS_MODEL),
        "shutter_s": nullable(number("exposure, estimated or known, s", low=0, high=1)),
        "ui_boxes_px": array("x0, y0, x1, y1 of graphics over the picture, px", numbers("box", 4)),
        "players": mapping(
            "who plays, by player object",
            record(
                "one person",
                {},
                {
                    "identity": nullable(text("the person, constant in a match", least=1)),
                    "handedness": nullable(text("the hand of the racket", one_of=["left", "right"])),
                },
            ),
            OBJECT_NAME,
        ),
    },
    {"camera": CLIP_CAMERA, "solved_share": number("share of frames with a camera", low=0, high=1)},
)
# An enum must name null as well for a nullable text.
CLIP["properties"]["players"]["additionalProperties"]["properties"]["handedness"]["enum"].append(None)

RUN = record(
    "what a command did",
    {
        "command": text("the command", least=1),
        "options": {"type": "object", "description": "options as resolved"},
        "versions": {
            "type": "object",
            "description": "versions of the packages in use",
            "additionalProperties": {"type": "string"},
        },
        "commit": text("commit of the project; empty outside a checkout", pattern=COMMIT),
        "started": text(
            "when it began, ISO 8601 with its zone",
            pattern=MOMENT,
        ),
        "seconds": nullable(number("how long it took, s; null while it runs", low=0)),
        "machine": {
            "type": "object",
            "description": "what it ran on",
            "additionalProperties": {"type": ["string", "number", "boolean", "null"]},
        },
        "inputs": array(
            "its inputs",
            record(
                "one input",
                {
                    "path": text("as found", least=1),
                    "state": text("what became of it", least=1),
                    "reason": text("why, where something is to be said"),
                    "clips": array("clips it gave", text("a clip", pattern=FOLDER_NAME)),
                    "seconds": nullable(number("how long it took, s", low=0)),
                },
            ),
        ),
    },
)

CAMERA = record(
    "one fixed camera; the centre of the top-left pixel is (0, 0)",
    {
        "width": integer("width of the picture, px", low=1, high=65536),
        "height": integer("height of the picture, px", low=1, high=65536),
        "K": numbers("intrinsics, row-major, px", 9),
        "distortion": numbers("OpenCV's k1, k2, p1, p2", 4),
        "R_cam_from_world": numbers("rotation, row-major; camera axes x right, y down, z forward", 9),
        "t_cam_from_world": numbers("the world's origin in the camera frame, m", 3),
    },
)

DATASET_INFO = record(
    "meta/info.json of a dataset: LeRobot's keys, and a block of our own",
    {
        "codebase_version": text("layout", one_of=["v3.0"]),
        "robot_type": nullable(text("unused; LeRobot asks for it")),
        "total_episodes": integer("clips", low=0),
        "total_frames": integer("rows of data", low=0),
        "total_tasks": integer("rows of meta/tasks.parquet", low=0),
        "chunks_size": integer("files per chunk folder", low=1),
        "data_files_size_in_mb": integer("size at which a data file ends, MB", low=1),
        "video_files_size_in_mb": integer("size at which a video file ends, MB", low=1),
        "fps": number("frame rate; nominal unless the dataset is constant-rate", above=0),
        "splits": mapping("episodes of each split", text("first:end", pattern=SPAN), OBJECT_NAME),
        "data_path": text("where data files are"),
        "video_path": nullable(text("where video files are; null without videos")),
        "features": {
            "type": "object",
            "description": "every column of data",
            "additionalProperties": {
                "type": "object",
                "required": ["dtype", "shape"],
                "properties": {
                    "dtype": {"type": "string"},
                    "shape": {"type": "array", "items": {"type": "integer", "minimum": 1}},
                },
            },
        },
        "pgm": record(
            "our own block",
            {
                "schema_version": text("version of the tables", pattern=VERSION),
                "scene": text("the scene", least=1),
                "units": {
                    "type": "object",
                    "description": "unit of every column that has one",
                    "additionalProperties": {"type": "string"},
                },
                "constant_rate": {"type": "boolean", "description": "whether video access through LeRobot is promised"},
            },
        ),
    },
) | {"additionalProperties": True}

PROMPT = record(
    "what a generated sequence must hold to",
    {
        "scene": text("the scene", least=1),
        "n_frames": integer("length", low=1),
        "frames_per_second": number("rate of the frames", above=0),
    },
    {
        "seed": integer("of the noise", low=0),
        "texts": array(
            "what players do, in words",
            record(
                "one text about one span",
                {
                    "player": integer("index of the player object, from 0", low=0),
                    "start_frame": integer("first frame of the span", low=0),
                    "end_frame": integer("frame after the last", low=1),
                    "text": text("what the player does", least=1),
                },
            ),
        ),
        "values": array(
            "properties that are given",
            record(
                "one property over one span",
                {
                    "column": text("column of the contract, such as ball.position", least=1),
                    "start_frame": integer("first frame of the span", low=0),
                    "end_frame": integer("frame after the last", low=1),
                    "value": {
                        "description": "one value for all its frames, or one a frame",
                        "type": ["number", "array"],
                    },
                },
            ),
        ),
    },
)

KINDS: dict[str, Schema] = {
    "scene": SCENE,
    "skeleton": SKELETON,
    "clip": CLIP,
    "run": RUN,
    "camera": CAMERA,
    "camera_path": CAMERA_PATH,
    "dataset_info": DATASET_INFO,
    "prompt": PROMPT,
}
"""Every kind of document of the contract and its schema, without `$schema` and title."""


def document_kinds() -> tuple[str, ...]:
    """All kinds of documents."""
    return tuple(KINDS)


def document_schema(kind: str) -> Schema:
    """The JSON Schema of the given kind of document.

    Raises:
        ValueError: If there is no such kind.
    """
    if kind not in KINDS:
        raise ValueError(f"kind: expected one of {', '.join(KINDS)}, got {kind!r}")
    return {"$schema": DIALECT, "title": kind} | KINDS[kind]
