"""What a dataset says of itself: info, episodes, tasks, statistics and card."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from pgm_data.dataset.columns import SCHEMA_VERSION, Column
from pgm_data.dataset.dataset_columns import (
    DATA_PATH,
    EPISODES_PATH,
    FILES_PER_CHUNK,
    LAYOUT_VERSION,
    SPLITS,
    SUMS_PATH,
    VIDEO_KEY,
    VIDEO_PATH,
)
from pgm_data.dataset.documents import write_document
from pgm_data.dataset.pack_plan import PlannedClip
from pgm_data.dataset.pack_rate import Rate
from pgm_data.dataset.pack_shards import Shard
from pgm_data.dataset.pack_videos import PlacedVideo, VideoPicture
from pgm_data.dataset.stats import DatasetStats, dataset_stats
from pgm_data.dataset.stats_histograms import histograms_of
from pgm_data.dataset.stats_table import stats_table, write_stats
from pgm_data.dataset.tables import ROW_GROUP, storage
from pgm_data.scene import Scene

VIDEO_FILE_MB = 200
SUMMARY_FOLDER = "meta/summary"
"""Numbers and pictures of what the dataset holds, for its card."""
LEROBOT_TYPES = {"float": "float32", "double": "float64"}
"""LeRobot's words for types where they are not ours."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Episode:
    """One packed clip."""

    clip: PlannedClip
    document: Mapping[str, Any]
    """Its `clip.json`."""
    length: int
    """Frames."""
    first_index: int
    """Row of the dataset at which it starts."""
    shard: Shard
    """Data file that it is in."""
    start_s: float
    """Presentation time of its first frame."""
    end_s: float
    """Presentation time after its last frame."""
    video: PlacedVideo | None


@dataclass(frozen=True, eq=False, kw_only=True)
class Contents:
    """All that a dataset holds, once it is written."""

    scene: Scene
    columns: tuple[Column, ...]
    """Of `data`."""
    episodes: tuple[Episode, ...]
    rate: Rate
    shards: Mapping[str, tuple[Shard, ...]]
    """Files of `data` and of each configuration of its own."""
    file_mb: int

    @property
    def frames(self) -> int:
        """Rows of `data`."""
        return sum(episode.length for episode in self.episodes)

    @property
    def splits(self) -> dict[str, tuple[int, int]]:
        """First episode and the one after the last of every split."""
        names = [episode.clip.split for episode in self.episodes]
        return {name: (names.index(name), names.index(name) + names.count(name)) for name in SPLITS if name in names}

    @property
    def task(self) -> str:
        """The one task, in LeRobot's sense."""
        return self.scene.name

    @property
    def picture(self) -> VideoPicture | None:
        """What all videos are like; None where a clip has none that LeRobot's reader would find, or they differ."""
        videos = [episode.video for episode in self.episodes]
        if not all(video is not None and video.path.endswith(".mp4") for video in videos):
            return None
        pictures = {video.picture for video in videos if video is not None}
        return pictures.pop() if len(pictures) == 1 else None


def write_meta(folder: Path, contents: Contents, stats: Mapping[str, Any]) -> None:
    """Write `meta` and `README.md` into the folder, which holds all else but the videos' checksums."""
    (folder / "meta").mkdir(parents=True)
    write_document(folder / "meta" / "info.json", "dataset_info", info_document(contents))
    (folder / "meta" / "stats.json").write_text(json.dumps(stats, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    _write_tasks(folder / "meta" / "tasks.parquet", [contents.task])
    _write_episodes(folder / EPISODES_PATH.format(chunk_index=0, file_index=0), contents)
    counted = dataset_stats(folder)
    write_stats(folder / SUMMARY_FOLDER, counted)
    (folder / "README.md").write_text(card_text(contents, counted), encoding="utf-8")


def info_document(contents: Contents) -> dict[str, Any]:
    """`meta/info.json`."""
    rate = contents.rate.frames_per_second
    features: dict[str, Any] = {column.name: feature_of(column) for column in contents.columns}
    picture = contents.picture
    if contents.rate.constant and picture is not None:
        features[VIDEO_KEY] = {
            "dtype": "video",
            "shape": [picture.height, picture.width, 3],
            "names": ["height", "width", "channels"],
            "info": {
                "video.height": picture.height,
                "video.width": picture.width,
                "video.codec": picture.codec,
                "video.pix_fmt": picture.pixel_format,
                "video.is_depth_map": False,
                "video.fps": _plain(rate),
                "video.channels": 3,
                "has_audio": False,
            },
        }
    return {
        "codebase_version": LAYOUT_VERSION,
        "robot_type": None,
        "total_episodes": len(contents.episodes),
        "total_frames": contents.frames,
        "total_tasks": 1,
        "chunks_size": FILES_PER_CHUNK,
        "data_files_size_in_mb": contents.file_mb,
        "video_files_size_in_mb": VIDEO_FILE_MB,
        "fps": _plain(rate),
        "splits": {name: f"{first}:{end}" for name, (first, end) in contents.splits.items()},
        "data_path": DATA_PATH,
        "video_path": VIDEO_PATH if any(episode.video for episode in contents.episodes) else None,
        "features": features,
        "pgm": {
            "schema_version": SCHEMA_VERSION,
            "scene": contents.scene.name,
            "units": {column.name: column.unit for column in contents.columns if column.unit},
            "constant_rate": contents.rate.constant,
        },
    }


def feature_of(column: Column) -> dict[str, Any]:
    """What LeRobot wants to know of a column."""
    return {"dtype": LEROBOT_TYPES.get(column.type, column.type), "shape": [max(column.size, 1)], "names": None}


def _plain(rate: float) -> float | int:
    return int(rate) if rate.is_integer() else rate


def episode_schema(scene: Scene, *, videos: bool) -> pa.Schema:
    """Arrow schema of `meta/episodes`: LeRobot's columns, then what `clip.json` says of the clip."""
    whole, number, text = pa.int64(), pa.float64(), pa.string()
    fields = [
        ("episode_index", whole),
        ("tasks", pa.list_(text)),
        ("length", whole),
        ("dataset_from_index", whole),
        ("dataset_to_index", whole),
        ("data/chunk_index", whole),
        ("data/file_index", whole),
        ("meta/episodes/chunk_index", whole),
        ("meta/episodes/file_index", whole),
    ]
    if videos:
        of_video = {"chunk_index": whole, "file_index": whole, "from_timestamp": number, "to_timestamp": number}
        fields += [(f"videos/{VIDEO_KEY}/{name}", kind) for name, kind in of_video.items()]
        fields += [("video_path", text)]
    fields += [
        ("clip_id", text),
        ("match_id", text),
        ("split", text),
        ("quality", text),
        ("source_path", text),
        ("sha256", text),
        ("first_video_frame", whole),
        ("width", whole),
        ("height", whole),
        ("shutter_s", number),
        ("ui_boxes_px", pa.list_(pa.list_(number, 4))),
    ]
    for player in scene.players:
        fields += [(f"{player.name}.identity", text), (f"{player.name}.handedness", text)]
    metadata = {"pgm.schema_version": SCHEMA_VERSION, "pgm.table": "episodes", "pgm.scene": scene.name}
    return pa.schema(fields, metadata=metadata)


def _write_episodes(path: Path, contents: Contents) -> None:
    videos = any(episode.video is not None for episode in contents.episodes)
    schema = episode_schema(contents.scene, videos=videos)
    rows = [_episode_row(number, episode, contents) for number, episode in enumerate(contents.episodes)]
    columns = {name: [row.get(name) for row in rows] for name in schema.names}
    path.parent.mkdir(parents=True)
    pq.write_table(pa.table(columns, schema=schema), path, row_group_size=ROW_GROUP, **storage(schema))


def _episode_row(number: int, episode: Episode, contents: Contents) -> dict[str, Any]:
    """Of its columns those that are known; the rest is null."""
    document = episode.document
    row = {
        "episode_index": number,
        "tasks": [contents.task],
        "length": episode.length,
        "dataset_from_index": episode.first_index,
        "dataset_to_index": episode.first_index + episode.length,
        "data/chunk_index": episode.shard.chunk_index,
        "data/file_index": episode.shard.file_index,
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 0,
        "split": episode.clip.split,
    }
    if episode.video is not None:
        place = f"videos/{VIDEO_KEY}"
        row |= {
            f"{place}/chunk_index": episode.video.chunk_index,
            f"{place}/file_index": episode.video.file_index,
            f"{place}/from_timestamp": episode.start_s,
            f"{place}/to_timestamp": episode.end_s,
            "video_path": episode.video.path,
        }
    plain = ("clip_id", "match_id", "quality", "source_path", "sha256", "first_video_frame", "width", "height")
    row |= {name: document[name] for name in (*plain, "shutter_s", "ui_boxes_px")}
    for player in contents.scene.players:
        person = document["players"].get(player.name, {})
        row |= {f"{player.name}.{name}": person.get(name) for name in ("identity", "handedness")}
    return row


def _write_tasks(path: Path, tasks: Sequence[str]) -> None:
    """The tasks, with what pandas wants to know to take `task` for the index; importing it would cost a second."""
    kinds = {"task_index": "int64", "task": "unicode"}
    pandas = {
        "index_columns": ["task"],
        "column_indexes": [{"name": None, "field_name": None, "pandas_type": "unicode", "numpy_type": "str"}],
        "columns": [{"name": n, "field_name": n, "pandas_type": k, "numpy_type": k} for n, k in kinds.items()],
    }
    pandas["columns"][1]["numpy_type"] = "str"
    content = pa.table({"task_index": pa.array(range(len(tasks)), pa.int64()), "task": pa.array(tasks, pa.string())})
    pq.write_table(content.replace_schema_metadata({"pandas": json.dumps(pandas)}), path, compression="zstd")


def card_text(contents: Contents, counted: DatasetStats) -> str:
    """The dataset card: how to load it, what a reader must know, and what it holds."""
    lines = ["---", "license: unknown", f"tags: [LeRobot, pgm, {contents.scene.name}]", "configs:"]
    for name, shards in contents.shards.items():
        lines += [f"  - config_name: {'default' if name == 'data' else name}", "    data_files:"]
        for split in SPLITS:
            files = [f"{name}/{shard.name}.parquet" for shard in shards if shard.split == split]
            if files:
                lines += [f"      - split: {split}", "        path:", *(f"          - {file}" for file in files)]
    lines += ["---", "", f"# {contents.scene.name}: scenes in metres, frame by frame", ""]
    lines += _card_summary(contents)
    lines += ["", "## What it holds", "", stats_table(counted), ""]
    lines += ["Captions are all texts of all spans; the average span counts each span once. Annotated frames have a"]
    lines += ["camera and every player. Parts of speech are told by a lexicon and by rules: every `to` is a particle,"]
    lines += ["as in the universal tag set, and all determiners are articles.", ""]
    lines += [
        f"![{histogram.title}]({SUMMARY_FOLDER}/{histogram.name}.svg)" for histogram in histograms_of(counted.whole)
    ]
    lines += [
        "",
        "## Columns of `data`",
        "",
        "One row a frame. Missing values are NaN beside a status that says why.",
        "",
    ]
    lines += ["| column | type | unit | frame | meaning |", "| --- | --- | --- | --- | --- |"]
    for column in contents.columns:
        kind = f"{column.type}[{column.size}]" if column.size else column.type
        lines.append(f"| `{column.name}` | {kind} | {column.unit} | {column.frame} | {column.meaning} |")
    return "\n".join(lines) + "\n"


def _card_summary(contents: Contents) -> list[str]:
    rate = contents.rate
    matches = {episode.clip.match_id: episode.clip.split for episode in contents.episodes}
    clips, of_split = Counter(e.clip.split for e in contents.episodes), Counter(matches.values())
    frames = {s: sum(e.length for e in contents.episodes if e.clip.split == s) for s in contents.splits}
    quality = Counter(episode.document["quality"] for episode in contents.episodes)
    lines = ["| split | matches | clips | frames |", "| --- | --- | --- | --- |"]
    lines += [f"| {split} | {of_split[split]} | {clips[split]} | {frames[split]} |" for split in contents.splits]
    lines += ["", "No match is divided between splits. One episode is one clip: an uninterrupted shot.", ""]
    lines += ["Quality of the clips: " + ", ".join(f"{name} {n}" for name, n in sorted(quality.items())) + ".", ""]
    if rate.constant:
        lines += [f"All frames are on a grid of {rate.frames_per_second:g} per second."]
    else:
        lines += [
            f"The rate of {rate.frames_per_second:g} frames per second is NOMINAL: times of frames are in "
            "`source_timestamp` and `frame.capture_time`."
        ]
    video = VIDEO_KEY in info_document(contents)["features"]
    lines += ["Pictures can be read through LeRobot." if video else "Pictures cannot be read through LeRobot."]
    lines += ["", "LeRobot reads numbers as float32: exact cameras and times are in the parquet files.", ""]
    own = [name for name in contents.shards if name != "data"]
    if own:
        lines += [f"Tables of their own, joined to `data` by `episode_index`: {', '.join(f'`{n}`' for n in own)}.", ""]
    lines += ["World: metres, right-handed, z up. Camera: OpenCV axes. The centre of the top-left pixel is (0, 0)."]
    lines += ["Pixels are those of `width` x `height` in `meta/episodes`; scale a video of another size to them."]
    lines += ["", f"`sha256sum --check {SUMS_PATH}` says whether every file is as it was packed."]
    return lines
