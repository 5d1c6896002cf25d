"""What a run of `pgm-calibrate` is to do: the videos it takes, what their clips are called, and who marked points."""

import hashlib
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from pgm_data.convert.keypoints_csv import KeypointMarks, read_keypoints
from pgm_data.dataset.document_schemas import SOURCE_PATH
from pgm_data.inputs import clip_stems, find_inputs
from pgm_data.scene import load_scene
from pgm_data.stages.calibrate import CalibrateOptions, names_video
from pgm_data.stages.work_folder import RESERVED, STATE

OWN_OUTPUT = "lies in the output of an earlier run"


@dataclass(frozen=True, eq=False, kw_only=True)
class Choice:
    """Which videos of those at the paths, and what they are called."""

    clip_prefix: str = ""
    """Put before every clip name; `{parent}` stands for the name of the video's folder."""
    match_id: str = ""
    """The match of all videos; each is one of its own when empty."""
    only: str = ""
    """Pattern that the file name or its path must match; empty for all."""
    limit: int = 0
    """Most videos; 0 for all."""


@dataclass(frozen=True, eq=False, kw_only=True)
class VideoTask:
    """One video to be calibrated."""

    video: Path
    """Absolute."""
    stem: str
    """What its clips are called."""
    source_path: str
    """The video as its clips name it."""
    match_id: str
    marks: str
    """Digest of a person's marks in it; empty where there are none."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Plan:
    """What a run is to do."""

    tasks: tuple[VideoTask, ...]
    ignored: tuple[tuple[str, str], ...]
    """Files that are left out, each with the reason."""


def plan_run(paths: Sequence[Path], *, work: Path, options: CalibrateOptions, choice: Choice) -> Plan:
    """The videos at the paths, named so that no two clips can have one name; nothing is written.

    Raises:
        FileNotFoundError: If a path does not exist.
        ValueError: If the scene has no court, names collide, or KEYPOINTS.csv does not fit.
    """
    scene = load_scene(options.scene)
    if scene.court is None:
        raise ValueError(f"--scene: expected a scene with a court to calibrate by, got {options.scene}, which has none")
    inputs = find_inputs(paths)
    outside = _common_folder(paths)
    ignored = [(_named(file, work, outside), reason) for file, reason in inputs.ignored if not _is_output(file, paths)]
    found: dict[Path, str] = {}
    for video in inputs.videos:
        name = _named(video, work, outside)
        if _is_output(video, paths):
            ignored.append((name, OWN_OUTPUT))
        elif not re.match(SOURCE_PATH, name) or not name.isprintable():
            ignored.append((name, "its path holds a backslash, a drive letter or characters that are no text"))
        else:
            found[video] = name
    marks = read_keypoints(Path(options.keypoints), scene.court) if options.keypoints else None
    digests = _marks_by_video(marks, list(found), options.keypoints) if marks else {}
    chosen = [v for v in found if not choice.only or _matches(v, found[v], choice.only)]
    chosen = chosen[: choice.limit or None]
    stems = clip_stems(chosen, choice.clip_prefix)
    _refuse_clashes(dict(zip(stems, chosen, strict=True)))
    tasks = [
        VideoTask(
            video=Path(os.path.abspath(video)),
            stem=stem,
            source_path=found[video],
            match_id=choice.match_id or stem,
            marks=digests.get(video, ""),
        )
        for video, stem in zip(chosen, stems, strict=True)
    ]
    return Plan(tasks=tuple(tasks), ignored=tuple(ignored))


def _refuse_clashes(video_of: Mapping[str, Path]) -> None:
    """Raise ValueError where one video's name is that of another's clip, or of a file of ours."""
    folded = {stem.casefold(): stem for stem in video_of}
    for stem, video in video_of.items():
        if stem.casefold() in RESERVED:
            raise ValueError(
                f"clip_id: {stem!r} of {video} is the name of a file of every work folder; give a --clip-prefix"
            )
        base = re.sub(r"\.\d\d+$", "", stem.casefold())
        if base != stem.casefold() and base in folded:
            raise ValueError(
                f"clip_id: {video} is called like a clip of {video_of[folded[base]]}; rename one of them, "
                "or calibrate them into two folders"
            )


def _marks_by_video(marks: KeypointMarks, videos: Sequence[Path], place: str) -> dict[Path, str]:
    """Digest of the marks of each video that the file names.

    Raises:
        ValueError: If it names a video that is none of them, or two of them at once; all such names are listed.
    """
    faults: list[str] = []
    rows: dict[Path, list[str]] = {}
    of_name: dict[str, Path] = {}
    for name in dict.fromkeys(marks.video):
        named = [video for video in videos if names_video(name, Path(os.path.abspath(video)))]
        if len(named) == 1:
            of_name[name] = named[0]
        elif named:
            faults.append(f"video: expected one video, got {name!r}, which {' and '.join(map(str, named[:2]))} are")
        else:
            faults.append(f"video: expected one of the {len(videos)} inputs, got {name!r}")
    if faults:
        more = f" (and {len(faults) - 5} more)" if len(faults) > 5 else ""
        raise ValueError(f"{place}: {'; '.join(faults[:5])}{more}")
    for name, frame, index, pixel in zip(marks.video, marks.frame, marks.name_index, marks.pixels, strict=True):
        rows.setdefault(of_name[name], []).append(f"{frame} {index} {pixel[0]!r} {pixel[1]!r}")
    return {video: hashlib.sha256("\n".join(sorted(found)).encode()).hexdigest() for video, found in rows.items()}


def _named(file: Path, work: Path, outside: Path) -> str:
    """A file as the work folder names it.

    From the work folder's parent where it lies under it, so that both can be moved together; else from the folder that
    holds all inputs, which is what a later `--videos` must name.
    """
    real = file.parent.resolve() / file.name
    beside = Path(os.path.abspath(work)).resolve().parent
    if beside in real.parents and beside != Path(beside.anchor):
        name = f"../{real.relative_to(beside).as_posix()}"
    else:
        name = Path(os.path.abspath(file)).relative_to(outside).as_posix()
    # A name may hold bytes that are no text.
    return name.encode("utf-8", "backslashreplace").decode("utf-8")


def _common_folder(paths: Sequence[Path]) -> Path:
    """The folder that holds all inputs."""
    folders = [os.path.abspath(path if path.is_dir() else path.parent) for path in paths]
    return Path(os.path.commonpath(folders))


def _matches(video: Path, name: str, pattern: str) -> bool:
    return any(fnmatchcase(text, pattern) for text in (video.name, video.as_posix(), name))


def _is_output(file: Path, paths: Sequence[Path]) -> bool:
    """Whether a file found in a folder lies in a work folder below it, such as an overlay."""
    if file in paths:
        return False
    roots = {Path(os.path.abspath(path)) for path in paths}
    for folder in Path(os.path.abspath(file)).parents:
        if (folder / STATE).is_dir() and (folder / "run.json").is_file() or (folder / STATE / "lock.json").is_file():
            return True
        if folder in roots:
            return False
    return False
