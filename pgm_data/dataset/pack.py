"""Work folders packed into one dataset in LeRobot's layout, clip by clip."""

import os
import shutil
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pgm_data.dataset.clip_check import CheckedClip, check_clip
from pgm_data.dataset.columns import schema_of
from pgm_data.dataset.dataset_columns import NO_VIDEO, data_columns, row_columns, row_tables
from pgm_data.dataset.findings import Findings
from pgm_data.dataset.pack_meta import Contents, Episode, write_meta
from pgm_data.dataset.pack_plan import STATE_FOLDER, PackOptions, PackPlan, PackProblem, PlannedClip, plan_pack
from pgm_data.dataset.pack_rate import Rate, RateCount, common_rate
from pgm_data.dataset.pack_rows import configuration_rows, data_rows, own_keys
from pgm_data.dataset.pack_shards import ShardWriter
from pgm_data.dataset.pack_stats import RunningStats
from pgm_data.dataset.pack_sums import write_sums
from pgm_data.dataset.pack_videos import Encode, PlacedVideo, VideoShelf
from pgm_data.scene import Scene

STAGING = "packing"
MB = 10**6
RATE_MISS = 0.01
"""Share by which a clip's rate may differ from the one that all are encoded at."""
READERS = 2
"""Clips that are read and checked at once while another is written."""
Said = Callable[[PlannedClip, PackProblem | None], None]


@dataclass(frozen=True, kw_only=True)
class PackOutcome:
    """What became of a dataset."""

    clips: dict[str, int]
    """Packed clips of every split; empty where nothing was written."""
    frames: int
    rate: Rate
    videos: int
    """Videos that it holds or leads to."""
    problems: tuple[PackProblem, ...]
    """Clips that were left out, and clips whose videos were."""


def pack_work_folders(
    works: Sequence[Path],
    out: Path,
    options: PackOptions | None = None,
    *,
    scene: Scene | None = None,
    encode: Encode | None = None,
    said: Said | None = None,
) -> PackOutcome:
    """Pack every clip of the work folders into the folder `out`; what is wrong with a clip leaves that clip out.

    Args:
        works: Work folders, folders that hold one as `work`, and clip folders.
        out: Folder that gets the dataset, all of it or nothing; it may not hold one.
        options: How it is packed.
        scene: Taken in place of the one that the clips name, for a scene that does not ship with the package.
        encode: Writes videos anew; needed where the options say so.
        said: Called after each clip, with what was wrong with it.

    Raises:
        ValueError: If there are no clips at all, two of one name, clips of several scenes, or `out` holds a dataset.
    """
    options = options or PackOptions()
    return write_dataset(plan_pack(works, options, scene=scene), out, options, encode=encode, said=said)


def write_dataset(
    plan: PackPlan, out: Path, options: PackOptions, *, encode: Encode | None = None, said: Said | None = None
) -> PackOutcome:
    """Pack what is planned; arguments and errors as of `pack_work_folders`."""
    if (out / "meta").exists() or (out / "data").exists():
        raise ValueError(f"{out}: expected a folder without a dataset, got one that holds meta or data")
    staging = out / STATE_FOLDER / STAGING
    fresh = not (out / STATE_FOLDER).exists()
    shutil.rmtree(staging, ignore_errors=True)
    staging.mkdir(parents=True)
    try:
        packing = _Packing(plan, staging, options, VideoShelf(staging, out, options, encode))
        with packing.writers:
            for clip, checked, problem in _sound_clips(plan):
                problem = packing.add(clip, checked, problem)
                if said is not None:
                    said(clip, problem)
        outcome = packing.finish()
        # The table of contents last: without it, nobody takes the rest for a dataset.
        for name in sorted((path.name for path in staging.iterdir()), key=lambda name: (name == "meta", name)):
            os.replace(staging / name, out / name)
        return outcome
    finally:
        shutil.rmtree(staging, ignore_errors=True)
        if fresh:
            (out / STATE_FOLDER).rmdir()


class _Packing:
    """A dataset in the making."""

    def __init__(self, plan: PackPlan, staging: Path, options: PackOptions, videos: VideoShelf) -> None:
        self._plan, self._staging, self._options = plan, staging, options
        self._columns = data_columns(plan.scene, optional=plan.optional)
        self._schema = schema_of(self._columns, table="data", scene=plan.scene)
        self.writers = ExitStack()
        bound = options.file_mb * MB
        self._stats = RunningStats(self._columns)
        self._data = self.writers.enter_context(
            ShardWriter(staging / "data", self._schema, bound_bytes=bound, written=self._stats.add)
        )
        self._rows = {
            table: self.writers.enter_context(
                ShardWriter(
                    staging / table,
                    schema_of(row_columns(table, plan.scene), table=table, scene=plan.scene),
                    bound_bytes=bound,
                )
            )
            for table in row_tables(plan.scene)
        }
        self._rates = RateCount()
        self._videos = videos
        self._rate = common_rate(options.rate) if options.rate else 0.0
        self._shown: dict[str, list[tuple[int, int, str]]] = {}
        self._episodes: list[Episode] = []
        self._frames = 0
        self._problems = list(plan.problems)

    def add(self, clip: PlannedClip, checked: CheckedClip | None, problem: PackProblem | None) -> PackProblem | None:
        """Write one clip's rows, where it is sound; what is wrong with it or with its video."""
        if checked is None or checked.document is None:
            return self._note(problem)
        unfit = self._shown_before(checked.document) or self._off_rate(checked)
        if unfit:
            return self._note(PackProblem(path=clip.folder, reason=unfit))
        video, problem = self._video(clip, checked)
        self._write(clip, checked, video)
        return self._note(problem)

    def _shown_before(self, document: Mapping[str, Any]) -> str:
        """Which packed clip shows the same frames of the same video; empty where none does."""
        if document["sha256"] == NO_VIDEO:
            return ""
        first, end = document["first_video_frame"], document["first_video_frame"] + document["n_frames"]
        spans = self._shown.setdefault(document["sha256"], [])
        for other_first, other_end, other in spans:
            if first < other_end and other_first < end:
                return f"sha256: expected pictures that no other clip shows, got those of clip {other}"
        spans.append((first, end, document["clip_id"]))
        return ""

    def _off_rate(self, checked: CheckedClip) -> str:
        """How far the clip's rate is from the one that all are encoded at; empty where it is that or none is."""
        time = checked.tables["camera"]["timestamp"]
        if not self._rate or len(time) < 2:
            return ""
        own = (len(time) - 1) / float(time[-1] - time[0])
        if abs(own - self._rate) <= RATE_MISS * self._rate:
            return ""
        return f"timestamp: expected {self._rate:g} frames per second within {RATE_MISS:.0%}, as rate says, got {own:g}"

    def _note(self, problem: PackProblem | None) -> PackProblem | None:
        if problem is not None:
            self._problems.append(problem)
        return problem

    def _video(self, clip: PlannedClip, checked: CheckedClip) -> tuple[PlacedVideo | None, PackProblem | None]:
        try:
            return self._videos.place(clip, checked.document or {}), None
        except (ValueError, OSError) as error:
            return None, PackProblem(path=clip.folder, reason=f"packed without its video: {error}")

    def _write(self, clip: PlannedClip, checked: CheckedClip, video: PlacedVideo | None) -> None:
        number, scene = len(self._episodes), self._plan.scene
        camera = checked.tables["camera"]
        own = own_keys(camera, episode_index=number, first_index=self._frames, rate=self._rate)
        captions = checked.tables.get("captions", {})
        columns = {column.name: column for column in self._columns}
        rows = data_rows(checked.contents, captions, scene, self._schema, columns, own)
        shard = self._data.add(rows, clip.split)
        for table, writer in self._rows.items():
            content = checked.contents.get(table)
            spans = configuration_rows(content, table, scene, writer.schema, episode_index=number)
            if spans is not None:
                writer.add(spans, clip.split)
        time = own["source_timestamp"]
        begin, end = float(time[0]), float(time[-1])
        if self._rate:
            begin, end = (float(frame) / self._rate for frame in camera["video_frame"][[0, -1]])
        rate = self._rates.add(np.arange(len(time)) / self._rate if self._rate else time)
        self._episodes.append(
            Episode(
                clip=clip,
                document=checked.document or {},
                length=len(time),
                first_index=self._frames,
                shard=shard,
                start_s=begin,
                end_s=end + (1.0 / rate if rate == rate else 0.0),
                video=video,
            )
        )
        self._frames += len(time)

    def finish(self) -> PackOutcome:
        """Write what the dataset says of itself; without a single clip, nothing at all."""
        if self._episodes:
            first = self._episodes[0].clip.split
            for writer in self._rows.values():
                if not writer.shards:  # a reader of the configuration finds its columns
                    with writer:
                        writer.add(writer.schema.empty_table(), first)
            shards = {"data": tuple(self._data.shards)}
            shards |= {table: tuple(writer.shards) for table, writer in self._rows.items()}
            contents = Contents(
                scene=self._plan.scene,
                columns=self._columns,
                episodes=tuple(self._episodes),
                rate=self._rates.rate(),
                shards=shards,
                file_mb=self._options.file_mb,
            )
            write_meta(self._staging, contents, self._stats.document())
            write_sums(self._staging)
        return PackOutcome(
            clips=dict(Counter(episode.clip.split for episode in self._episodes)),
            frames=self._frames,
            rate=self._rates.rate(),
            videos=len(self._videos.placed),
            problems=tuple(self._problems),
        )


def _sound_clips(plan: PackPlan) -> Iterator[tuple[PlannedClip, CheckedClip | None, PackProblem | None]]:
    """The content of every clip in order, or why it does not hold to the contract; a few are read ahead."""
    waiting: deque[tuple[PlannedClip, Future]] = deque()
    pool = ThreadPoolExecutor(READERS)
    try:
        for clip in plan.clips:
            waiting.append((clip, pool.submit(_sound_clip, clip, plan.scene)))
            if len(waiting) > READERS:
                first, future = waiting.popleft()
                yield first, *future.result()
        while waiting:
            first, future = waiting.popleft()
            yield first, *future.result()
    finally:
        pool.shutdown(cancel_futures=True)


def _sound_clip(clip: PlannedClip, scene: Scene) -> tuple[CheckedClip | None, PackProblem | None]:
    """The clip's content, or why it does not hold to the contract."""
    findings = Findings(scene=scene)
    checked = check_clip(clip.folder, findings)
    document = checked.document
    if document is not None and document["scene"] != scene.name:
        reason = f"clip.json: scene: expected {scene.name}, got {document['scene']}"
        return None, PackProblem(path=clip.folder, reason=reason)
    if findings.violations:
        first = findings.violations[0]
        more = f" and {len(findings.violations) - 1} more violations" if len(findings.violations) > 1 else ""
        reason = f"{first.path.name}: {first.field + ': ' if first.field else ''}expected {first.expected}"
        return None, PackProblem(path=clip.folder, reason=f"{reason}, got {first.found}{more}")
    return checked, None
