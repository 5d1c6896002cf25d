"""Work folders packed into one dataset in LeRobot's layout, clip by clip."""

import os
import shutil
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pgm_data.dataset.clip_check import CheckedClip, check_clip
from pgm_data.dataset.columns import schema_of
from pgm_data.dataset.dataset_columns import data_columns, row_columns, row_tables
from pgm_data.dataset.findings import Findings
from pgm_data.dataset.pack_meta import Contents, Episode, write_meta
from pgm_data.dataset.pack_plan import STATE_FOLDER, PackOptions, PackPlan, PackProblem, PlannedClip, plan_pack
from pgm_data.dataset.pack_rate import Rate, RateCount
from pgm_data.dataset.pack_rows import configuration_rows, data_rows
from pgm_data.dataset.pack_shards import ShardWriter
from pgm_data.dataset.pack_stats import RunningStats
from pgm_data.dataset.pack_videos import PlacedVideo, VideoShelf
from pgm_data.dataset.tables import arrow_table
from pgm_data.scene import Scene

STAGING = "packing"
MB = 10**6
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
    said: Said | None = None,
) -> PackOutcome:
    """Pack every clip of the work folders into the folder `out`; what is wrong with a clip leaves that clip out.

    Args:
        works: Work folders, folders that hold one as `work`, and clip folders.
        out: Folder that gets the dataset, all of it or nothing; it may not hold one.
        options: How it is packed.
        scene: Taken in place of the one that the clips name, for a scene that does not ship with the package.
        said: Called after each clip, with what was wrong with it.

    Raises:
        ValueError: If there are no clips at all, two of one name, clips of several scenes, or `out` holds a dataset.
    """
    options = options or PackOptions()
    return write_dataset(plan_pack(works, options, scene=scene), out, options, said=said)


def write_dataset(plan: PackPlan, out: Path, options: PackOptions, *, said: Said | None = None) -> PackOutcome:
    """Pack what is planned; arguments and errors as of `pack_work_folders`."""
    if (out / "meta").exists() or (out / "data").exists():
        raise ValueError(f"{out}: expected a folder without a dataset, got one that holds meta or data")
    staging = out / STATE_FOLDER / STAGING
    fresh = not (out / STATE_FOLDER).exists()
    shutil.rmtree(staging, ignore_errors=True)
    staging.mkdir(parents=True)
    try:
        packing = _Packing(plan, staging, out, options)
        with packing.writers:
            for clip in plan.clips:
                problem = packing.add(clip)
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

    def __init__(self, plan: PackPlan, staging: Path, out: Path, options: PackOptions) -> None:
        self._plan, self._staging, self._options = plan, staging, options
        self._columns = data_columns(plan.scene, optional=plan.optional)
        self._schema = schema_of(self._columns, table="data", scene=plan.scene)
        self.writers = ExitStack()
        bound = options.file_mb * MB
        self._data = self.writers.enter_context(ShardWriter(staging / "data", self._schema, bound_bytes=bound))
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
        self._stats = RunningStats(self._columns)
        self._rates = RateCount()
        self._videos = VideoShelf(staging, out, options)
        self._episodes: list[Episode] = []
        self._frames = 0
        self._problems = list(plan.problems)

    def add(self, clip: PlannedClip) -> PackProblem | None:
        """Write one clip's rows; what is wrong with it or with its video."""
        checked, problem = _sound_clip(clip, self._plan.scene)
        if checked is None or checked.document is None:
            return self._note(problem)
        video, problem = self._video(clip, checked)
        self._write(clip, checked, video)
        return self._note(problem)

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
        number, place = len(self._episodes), str(clip.folder)
        rows = data_rows(
            checked.tables, self._plan.scene, self._columns, episode_index=number, first_index=self._frames
        )
        shard = self._data.add(arrow_table(rows, self._columns, self._schema, place=place), clip.split)
        self._stats.update(rows)
        for table, writer in self._rows.items():
            own = configuration_rows(checked.tables, table, self._plan.scene, episode_index=number)
            if own is not None:
                columns = row_columns(table, self._plan.scene)
                writer.add(arrow_table(own, columns, writer.schema, place=place), clip.split)
        time = np.asarray(rows["source_timestamp"])
        rate = self._rates.add(time)
        self._episodes.append(
            Episode(
                clip=clip,
                document=checked.document or {},
                length=len(time),
                first_index=self._frames,
                shard=shard,
                start_s=float(time[0]),
                end_s=float(time[-1]) + (1.0 / rate if rate == rate else 0.0),
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
        return PackOutcome(
            clips=dict(Counter(episode.clip.split for episode in self._episodes)),
            frames=self._frames,
            rate=self._rates.rate(),
            videos=len(self._videos.placed),
            problems=tuple(self._problems),
        )


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
