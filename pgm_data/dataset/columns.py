"""The columns of every table of the work folder: the one source of the Arrow schemas and of `schemas/tables`.

Which columns a table has follows the scene: a scene without a ball has no `ball.*` column and no
table of events. Missing values are NaN beside a status that says why. Covariances are stored as
xx, xy, xz, yy, yz, zz; matrices row-major.
"""

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from pgm_data.scene import Scene, SceneObject

if TYPE_CHECKING:
    import pyarrow

SCHEMA_VERSION = "1.0"
"""Written into every table; the major part changes when a reader of the old tables would go wrong."""

ColumnType = Literal["string", "bool", "int32", "int64", "float", "double"]
Declaration = Literal["", "players", "ball"]

PLAYER = "player"
"""Stands for the name of each player object of the scene in the names of the templates."""


@dataclass(frozen=True, kw_only=True)
class Column:
    """One column of one table."""

    name: str
    type: ColumnType
    size: int = 0
    """Values per row: 0 for a scalar, else the length of its fixed_size_list."""
    unit: str = ""
    """SI unit, `px`, `rad`, or empty where it has none."""
    frame: str = ""
    """Coordinate frame of the values: world, camera, image, parent, or empty where it has none."""
    meaning: str
    when: str = "always"
    """When the column exists."""
    allowed: tuple[str, ...] = ()
    """The strings it may hold; any where empty."""
    optional: bool = False
    """Whether a table may leave it out."""
    per: Literal["", "keypoints", "joints"] = ""
    """Of a template: what of the skeleton the size counts per, before a scene fixes it."""


@dataclass(frozen=True, kw_only=True)
class Table:
    """One table's columns, before a scene fixes players and sizes."""

    name: str
    row: str
    """What one row is."""
    needs: Declaration
    """What a scene must declare for the table to exist; empty for every scene."""
    frame_aligned: bool
    """Whether it holds one row per decoded frame of the clip, in order."""
    columns: tuple[Column, ...]


def _column(name: str, type: ColumnType, meaning: str, unit: str = "", frame: str = "", size: int = 0) -> Column:
    return Column(name=name, type=type, size=size, unit=unit, frame=frame, meaning=meaning)


def _words(name: str, meaning: str, *allowed: str) -> Column:
    return Column(name=name, type="string", meaning=meaning, allowed=allowed)


CLIP_ID = _column("clip_id", "string", "the clip, the name of its folder")
KEYS = (
    CLIP_ID,
    _column("frame_index", "int64", "frame of the clip, from 0, without gaps"),
    _column("video_frame", "int64", "frame of the source video in a sequential decode, from 0"),
    _column("timestamp", "double", "the video's own presentation time", "s"),
)
"""What every frame-aligned table starts with; joining on them packs the tables."""

SHOTS = Table(
    name="shots",
    row="one decoded frame of one video; every frame of every video once",
    needs="",
    frame_aligned=False,
    columns=(
        _column("video", "string", "path of the video, relative, with forward slashes"),
        _column("video_frame", "int64", "frame of the video in a sequential decode, from 0"),
        _column("timestamp", "double", "the video's own presentation time", "s"),
        _words(
            "verdict",
            "clip: belongs to a clip; transition: a cut or a cross-fade; other: its shot does not show the scene",
            *("clip", "transition", "other"),
        ),
        _column("reason", "string", "why, where the verdict is not `clip`; else empty"),
        _column("clip_id", "string", "the clip, or empty where the verdict is not `clip`"),
    ),
)

CAMERA = Table(
    name="camera",
    row="one frame",
    needs="",
    frame_aligned=True,
    columns=(
        *KEYS,
        _column("frame.is_duplicate", "bool", "whether the picture repeats an earlier one"),
        _column(
            "frame.capture_time", "double", "estimated moment the picture was taken; a repeat has its source's", "s"
        ),
        _column("camera.K", "double", "intrinsics; the centre of the top-left pixel is (0, 0)", "px", "image", 9),
        _column("camera.distortion", "double", "OpenCV's k1, k2, p1, p2", "", "image", 4),
        _column("camera.R_cam_from_world", "double", "rotation; x right, y down, z forward", "", "camera", 9),
        _column("camera.t_cam_from_world", "double", "the world's origin in the camera frame", "m", "camera", 3),
        _words(
            "camera.status",
            "measured: this frame's own pixels support it; interpolated: bridged from its neighbours; none: no camera",
            *("measured", "interpolated", "none"),
        ),
        _column("camera.reason", "string", "why the status is not `measured`; else empty"),
        _column("camera.inliers", "int32", "observations that support the camera"),
        _column("camera.reprojection_px", "double", "rms of 2D distances of the inliers", "px", "image"),
        _column("camera.position_cov", "double", "covariance of the camera's position", "m^2", "world", 6),
        _column("camera.focal_std_px", "double", "standard deviation of the focal length", "px", "image"),
    ),
)

PLAYERS = Table(
    name="players",
    row="one frame",
    needs="players",
    frame_aligned=True,
    columns=(
        *KEYS,
        _column("player.identity", "string", "the person, constant in a match; empty where unknown"),
        _column("player.box_px", "float", "x0, y0, x1, y1 of the person's box", "px", "image", 4),
        Column(
            name="player.keypoints_px",
            type="float",
            size=2,
            per="keypoints",
            unit="px",
            frame="image",
            meaning="x, y of each keypoint of the skeleton's set",
        ),
        Column(
            name="player.keypoint_score", type="float", size=1, per="keypoints", meaning="confidence of each keypoint"
        ),
        _column("player.root_position", "float", "position of the root joint", "m", "world", 3),
        _column("player.root_rotation", "float", "axis-angle of world_from_root", "rad", "world", 3),
        Column(
            name="player.joints",
            type="float",
            size=3,
            per="joints",
            unit="m",
            frame="world",
            meaning="position of each joint",
        ),
        Column(
            name="player.joint_rotations",
            type="float",
            size=3,
            per="joints",
            unit="rad",
            frame="parent",
            meaning="axis-angle of parent_from_joint; entry 0 repeats the root",
        ),
        Column(
            name="player.joint_translations",
            type="float",
            size=3,
            per="joints",
            unit="m",
            frame="parent",
            meaning="translation of parent_from_joint; entry 0 repeats the root",
        ),
        Column(
            name="player.betas",
            type="float",
            size=10,
            meaning="SMPL shape coefficients",
            when="only where a source gives them",
            optional=True,
        ),
        _column("player.root_cov", "float", "covariance of the root position", "m^2", "world", 6),
        _column("player.contact", "float", "probability that the left, the right foot is on the ground", size=2),
        _column("player.reprojection_px", "float", "rms of 2D distances of the keypoints", "px", "image"),
        _words(
            "player.status",
            "measured: this frame's own pixels support it; filled: bridged from its neighbours; none: no player",
            *("measured", "filled", "none"),
        ),
    ),
)

BALL = Table(
    name="ball",
    row="one frame",
    needs="ball",
    frame_aligned=True,
    columns=(
        *KEYS,
        _column("ball.pixel", "float", "detected centre of the ball", "px", "image", 2),
        _column("ball.score", "float", "confidence of the detection"),
        _column("ball.position", "double", "centre of the ball", "m", "world", 3),
        _column("ball.velocity", "double", "velocity; at a contact, the one after it", "m/s", "world", 3),
        _column("ball.position_cov", "double", "covariance of the position", "m^2", "world", 6),
        _words(
            "ball.status",
            "measured: this frame's own pixels support it; filled: from the flight around it; none: no ball",
            *("measured", "filled", "none"),
        ),
        _words(
            "ball.event",
            "the event this frame is nearest to, else none",
            *("hit", "bounce", "net", "first", "last", "none"),
        ),
    ),
)

EVENTS = Table(
    name="events",
    row="one event",
    needs="ball",
    frame_aligned=False,
    columns=(
        CLIP_ID,
        _column("time", "double", "capture time, not rounded to a frame", "s"),
        _column("frame_index", "int64", "frame of the clip nearest to it"),
        _words("kind", "what happened", "hit", "bounce", "net", "first", "last"),
        _column("player", "string", "player object that hit, such as player0; empty where no player did"),
        _column("probability", "double", "probability that it happened"),
        _words("source", "who says so", "human", "detected", "simulated"),
        _column("position", "double", "centre of the ball", "m", "world", 3),
    ),
)

BALL_SHOTS = Table(
    name="ball_shots",
    row="one flight of the ball between two contacts",
    needs="ball",
    frame_aligned=False,
    columns=(
        CLIP_ID,
        _column("start_event", "int64", "row of the events table, among the rows of this clip, that starts it"),
        _column("end_event", "int64", "row of the events table, among the rows of this clip, that ends it"),
        _column("start_time", "double", "capture time of its start", "s"),
        _column("end_time", "double", "capture time of its end", "s"),
        _column("player", "string", "player object that hit it, such as player0; empty where no player did"),
        _column("start_speed", "double", "speed after the start event", "m/s", "world"),
        _column("spin", "double", "angular velocity", "rad/s", "world", 3),
        _column("spin_std", "double", "its standard deviation", "rad/s", "world", 3),
        _column("drag_per_m", "double", "C = rho Cd A / (2 m)", "1/m"),
        _column("drag_std_per_m", "double", "its standard deviation", "1/m"),
        _column("landing_position", "double", "where the ball first meets the ground", "m", "world", 3),
        _column("in_probability", "double", "probability that it lands in"),
        _column("free_parameters", "string", "parameters that were free in the fit, separated by spaces"),
        _column("residual_px", "double", "rms of 2D distances of the fit", "px", "image"),
        _column("status", "string", "what the solver said"),
    ),
)

CAPTIONS = Table(
    name="captions",
    row="one text about one span of frames",
    needs="players",
    frame_aligned=False,
    columns=(
        CLIP_ID,
        _column("player", "int32", "index of the player object among the scene's players, from 0"),
        _column("start_frame", "int64", "first frame of the span"),
        _column("end_frame", "int64", "frame after the last of the span"),
        _column("start_s", "double", "capture time of the start", "s"),
        _column("end_s", "double", "capture time of the end", "s"),
        _column("text", "string", "what the player does"),
        _words("source", "where the text is from", "human", "generated", "imported"),
        _column("alternative", "int32", "0 is the main text of the span, others say the same in other words"),
    ),
)

TABLES = {table.name: table for table in (SHOTS, CAMERA, PLAYERS, BALL, EVENTS, BALL_SHOTS, CAPTIONS)}


def table_names() -> tuple[str, ...]:
    """All tables of the contract."""
    return tuple(TABLES)


def declared(needs: Declaration, scene: Scene) -> bool:
    """Whether the scene declares what a table or column needs."""
    return {"": True, "players": bool(scene.players), "ball": scene.ball is not None}[needs]


def scene_tables(scene: Scene) -> tuple[str, ...]:
    """Tables that the scene declares."""
    return tuple(name for name, value in TABLES.items() if declared(value.needs, scene))


def table_columns(table: str, scene: Scene) -> tuple[Column, ...]:
    """Columns of the table in the given scene, in order.

    Raises:
        ValueError: If there is no such table, or the scene declares nothing that it could hold.
    """
    if table not in TABLES:
        raise ValueError(f"table: expected one of {', '.join(TABLES)}, got {table!r}")
    value = TABLES[table]
    if not declared(value.needs, scene):
        raise ValueError(f"{table}: expected a scene that declares {value.needs}, got {scene.name}, which does not")
    shared = tuple(column for column in value.columns if not column.name.startswith(f"{PLAYER}."))
    own = tuple(column for column in value.columns if column.name.startswith(f"{PLAYER}."))
    return shared + tuple(_of_player(column, player) for player in scene.players for column in own)


def _of_player(column: Column, player: SceneObject) -> Column:
    if player.skeleton is None:
        raise ValueError(f"objects.{player.name}.skeleton: expected a skeleton, since it is a player, got none")
    count = {
        "": 1,
        "keypoints": len(player.skeleton.keypoint_names),
        "joints": len(player.skeleton.joint_names),
    }[column.per]
    return replace(column, name=player.name + column.name.removeprefix(PLAYER), size=column.size * count, per="")


def arrow_schema(table: str, scene: Scene, *, without: Collection[str] = ()) -> "pyarrow.Schema":
    """Arrow schema of the table in the given scene, less the optional columns left out.

    Each field's metadata holds `unit` and `frame`; the schema's holds the schema version, table and scene.

    Raises:
        ValueError: If there is no such table in the scene, or a column left out is not optional.
    """
    declared = table_columns(table, scene)
    for column in declared:
        if column.name in without and not column.optional:
            raise ValueError(f"{table}.{column.name}: expected the column, since it is not optional, got none")
    return schema_of([column for column in declared if column.name not in without], table=table, scene=scene)


def schema_of(columns: Iterable[Column], *, table: str, scene: Scene) -> "pyarrow.Schema":
    """Arrow schema of these columns, with the metadata that every table carries."""
    import pyarrow as pa

    types = {
        "string": pa.string(),
        "bool": pa.bool_(),
        "int32": pa.int32(),
        "int64": pa.int64(),
        "float": pa.float32(),
        "double": pa.float64(),
    }
    fields = []
    for column in columns:
        scalar = types[column.type]
        arrow = pa.list_(pa.field("element", scalar, nullable=False), column.size) if column.size else scalar
        metadata = {"unit": column.unit, "frame": column.frame}
        fields.append(pa.field(column.name, arrow, nullable=False, metadata=metadata))
    metadata = {"pgm.schema_version": SCHEMA_VERSION, "pgm.table": table, "pgm.scene": scene.name}
    return pa.schema(fields, metadata=metadata)
