"""JSON Schema of a camera path: where a camera that nobody held stands and looks, at a few times."""

from pgm_data.dataset.json_schema import Schema, array, integer, number, numbers, record

MATRICES = ("K", "distortion", "R_cam_from_world", "t_cam_from_world")
"""Of a key that gives its camera as `camera.json` does."""

KEY: Schema = record(
    "a camera at a time: position and look_at, or all matrices",
    {"time": number("seconds from the clip's first frame, above those of the keys before")},
    {
        "position": numbers("where the camera stands: x, y, z in m", 3),
        "look_at": numbers("what is in the middle of the picture: x, y, z in m", 3),
        "fov_deg": number("angle that the picture is wide, degrees; 40 unless given", above=0)
        | {"exclusiveMaximum": 180},
        "roll_deg": number("turn about the camera's axis, clockwise as seen from behind it, degrees"),
        "K": numbers("intrinsics, row-major, px", 9),
        "distortion": numbers("OpenCV's k1, k2, p1, p2", 4),
        "R_cam_from_world": numbers("rotation, row-major; camera axes x right, y down, z forward", 9),
        "t_cam_from_world": numbers("the world's origin in the camera frame, m", 3),
    },
) | {
    "oneOf": [{"required": ["position"]}, {"required": ["K"]}],
    "dependentRequired": {
        "position": ["look_at"],
        **{name: ["position"] for name in ("look_at", "fov_deg", "roll_deg")},
        **{name: [other for other in MATRICES if other != name] for name in MATRICES},
    },
}

CAMERA_PATH: Schema = record(
    "a camera that moves from key to key; the centre of the top-left pixel is (0, 0)",
    {
        "width": integer("width of the pictures, px", low=1, high=65536),
        "height": integer("height of the pictures, px", low=1, high=65536),
        "keys": array("cameras at rising times", KEY, least=1),
    },
)
