"""A whole run of `pgm caption` on a work folder: captions generated from tracks, or read from files, clip by clip.

What people wrote stays: generated captions are put beside it, where no main text of theirs is, unless it is asked for
that they begin anew.
"""

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool

import pgm_data
from pgm_data.caption.measures import facts_of_clip
from pgm_data.caption.words import words_of_facts
from pgm_data.convert.captions_match import ImportedCaptions
from pgm_data.convert.captions_rows import CaptionClip, CaptionFinding
from pgm_data.dataset.clip_ball import BALL_TABLES, read_clip_ball
from pgm_data.dataset.clip_camera import read_clip_camera
from pgm_data.dataset.clip_captions import CaptionRows, read_clip_captions, write_clip_captions
from pgm_data.dataset.clip_players import read_clip_players
from pgm_data.dataset.documents import read_document, write_document
from pgm_data.dataset.files import sha256_of
from pgm_data.provenance import run_document
from pgm_data.scene import Scene, load_scene
from pgm_data.stages.work_folder import STATE

RUN_DOCUMENT = "run_caption.json"
"""Beside the `run.json` of the command that made the work folder."""
CAPTIONS = "captions.parquet"
READ_FROM = ("camera.parquet", "players.parquet", *(f"{name}.parquet" for name in BALL_TABLES))
GENERATED = "generated"


@dataclass(frozen=True, eq=False, kw_only=True)
class CaptionOutcome:
    """What became of one clip."""

    clip_id: str
    state: Literal["ok", "no captions", "failed"]
    reason: str = ""
    generated: int = 0
    """Main captions made from tracks that are now in its table."""
    human: int = 0
    """The same that people wrote."""
    imported: int = 0
    """The same of other programs."""
    words: float | None = None
    """Words of an average main caption."""
    span_s: float | None = None
    """Seconds of an average span."""
    covered: float | None = None
    """Share of the players' frames that have a main caption."""
    resumed: bool = False
    """Whether an earlier run did it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class CaptionManner:
    """How a run treats what is there."""

    resume: bool = False
    """Clips whose tables have not changed since an earlier run stay as they are."""
    overwrite: bool = False
    """What is there is replaced, whoever wrote it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ClipWords:
    """A clip of a work folder that may be captioned."""

    folder: Path
    scene: Scene
    clip: CaptionClip
    handedness: tuple[str, ...]
    """Of each player: left, right, or empty where unknown."""


@dataclass(kw_only=True)
class CaptionRun:
    """What a run did."""

    outcomes: list[CaptionOutcome] = field(default_factory=list)
    findings: list[CaptionFinding] = field(default_factory=list)


def clip_names(work: Path) -> tuple[str, ...]:
    """Clips of a work folder, by name."""
    return tuple(sorted(path.name for path in work.iterdir() if (path / "clip.json").is_file()))


_scene = cache(load_scene)


def read_clip(folder: Path) -> ClipWords:
    """What captions need to know of the clip in a folder.

    Raises:
        ValueError: If its document, scene or cameras cannot be read.
    """
    document = read_document(folder / "clip.json", "clip")
    scene = _scene(document["scene"])
    camera = read_clip_camera(folder)
    said: Mapping[str, Any] = document.get("players") or {}
    own = [said.get(player.name) or {} for player in scene.players]
    clip = CaptionClip(
        clip_id=document["clip_id"],
        video=Path(document["source_path"]).name,
        first_video_frame=int(document["first_video_frame"]),
        capture_time=camera.capture_time,
        players=tuple(player.name for player in scene.players),
        identities=tuple(entry.get("identity") or "" for entry in own),
    )
    return ClipWords(
        folder=folder, scene=scene, clip=clip, handedness=tuple(entry.get("handedness") or "" for entry in own)
    )


def has_generated(work: Path, clip_id: str) -> bool:
    """Whether the clip has captions that were generated."""
    path = work / clip_id / CAPTIONS
    return path.exists() and bool((read_clip_captions(path.parent).source == GENERATED).any())


def generate_captions(
    work: Path, names: Sequence[str], manner: CaptionManner, tell: Callable[[str], None] = lambda _: None
) -> CaptionRun:
    """Captions from the tracks of the clips, written beside them; what became of each.

    Args:
        work: The work folder, which the caller holds.
        names: Its clips.
        manner: What becomes of what is there.
        tell: Told each clip that has ended.
    """
    run = CaptionRun()
    done = _Done.of(work)
    for name in names:
        try:
            run.outcomes.append(_generate(work / name, manner, done))
        except ValueError as error:
            run.outcomes.append(CaptionOutcome(clip_id=name, state="failed", reason=str(error)))
        tell(name)
    return run


def _generate(folder: Path, manner: CaptionManner, done: "_Done") -> CaptionOutcome:
    clip = read_clip(folder)
    if not clip.scene.players:
        raise ValueError(f"{folder.name}: scene {clip.scene.name}: expected one with players, got none")
    if not (folder / "players.parquet").is_file():
        raise ValueError(f"{folder.name}: players.parquet: expected the players, got none: run pgm players first")
    digest = _digest(folder)
    there = read_clip_captions(folder) if (folder / CAPTIONS).is_file() else None
    if manner.resume and there is not None and done.digests.get(folder.name) == [digest, sha256_of(folder / CAPTIONS)]:
        return _outcome(clip, there, resumed=True)
    players = read_clip_players(folder, clip.scene)
    ball = None
    if clip.scene.ball is not None and all((folder / f"{name}.parquet").is_file() for name in BALL_TABLES):
        ball = read_clip_ball(folder, clip.clip.capture_time)
    captions = words_of_facts(facts_of_clip(players, ball, clip.clip.capture_time, clip.scene, clip.handedness))
    if there is not None and not manner.overwrite:
        kept = taken(there, there.source != GENERATED)
        captions = together(kept, taken(captions, ~_covered(captions, kept)))
    write_clip_captions(folder, folder.name, captions, scene=clip.scene)
    done.note(folder.name, [digest, sha256_of(folder / CAPTIONS)])
    return _outcome(clip, captions)


def import_captions(
    work: Path,
    clips: Mapping[str, ClipWords],
    imported: ImportedCaptions,
    manner: CaptionManner,
    tell: Callable[[str], None] = lambda _: None,
) -> CaptionRun:
    """Captions of files put into the clips' tables; generated ones give way, others only where that is asked for.

    Args:
        work: The work folder, which the caller holds.
        clips: Its clips by name.
        imported: The captions, by clip.
        manner: Whether what people wrote may be replaced.
        tell: Told each clip that has ended.
    """
    run = CaptionRun(findings=list(imported.findings))
    for name, rows in imported.clips.items():
        try:
            run.outcomes.append(_import(clips[name], rows, manner, run.findings))
        except ValueError as error:
            run.outcomes.append(CaptionOutcome(clip_id=name, state="failed", reason=str(error)))
        tell(name)
    return run


def _import(
    clip: ClipWords, rows: CaptionRows, manner: CaptionManner, findings: list[CaptionFinding]
) -> CaptionOutcome:
    folder = clip.folder
    there = read_clip_captions(folder) if (folder / CAPTIONS).is_file() else None
    if there is not None and len(there):
        if manner.overwrite:
            there = taken(there, np.zeros(len(there), dtype=bool))
        written = taken(there, there.source != GENERATED)
        clash = _covered(rows, written)
        for k in np.flatnonzero(clash & (rows.alternative == 0)):
            said = f"frames {rows.start_frame[k]} to {rows.end_frame[k]} of {clip.clip.players[int(rows.player[k])]}"
            expected = "a span that has no human or imported caption yet (--overwrite replaces a clip's)"
            findings.append(
                CaptionFinding(
                    file=folder.name, place=said, field="start, end", expected=expected, found="one that has"
                )
            )
        rows = taken(rows, ~clash)
        there = taken(there, ~_covered(there, rows))
        rows = together(there, rows)
    write_clip_captions(folder, folder.name, rows, scene=clip.scene)
    return _outcome(clip, rows)


def taken(rows: CaptionRows, which: Bool[np.ndarray, " texts"]) -> CaptionRows:
    """Some of the rows."""
    keep = np.flatnonzero(np.asarray(which, dtype=bool))
    return CaptionRows(**{name: getattr(rows, name)[keep] for name in CaptionRows.__dataclass_fields__})


def together(one: CaptionRows, two: CaptionRows) -> CaptionRows:
    """The rows of both, by player, start and alternative."""
    both = {name: np.concatenate([getattr(one, name), getattr(two, name)]) for name in CaptionRows.__dataclass_fields__}
    order = np.lexsort((both["alternative"], both["end_frame"], both["start_frame"], both["player"]))
    return CaptionRows(**{name: values[order] for name, values in both.items()})


def _covered(rows: CaptionRows, others: CaptionRows) -> np.ndarray:
    """Which rows share a frame with a main text of the same player among the others."""
    main = others.alternative == 0
    player, start, end = others.player[main], others.start_frame[main], others.end_frame[main]
    same = rows.player[:, None] == player
    over = (rows.start_frame[:, None] < end) & (rows.end_frame[:, None] > start)
    return (same & over).any(axis=1)


def _outcome(clip: ClipWords, rows: CaptionRows, *, resumed: bool = False) -> CaptionOutcome:
    main = taken(rows, rows.alternative == 0)
    counts = {name: int((main.source == name).sum()) for name in ("generated", "human", "imported")}
    if not len(main):
        return CaptionOutcome(
            clip_id=clip.clip.clip_id, state="no captions", reason="no player is known long enough", resumed=resumed
        )
    frames = len(clip.clip.capture_time) * max(len(clip.clip.players), 1)
    return CaptionOutcome(
        clip_id=clip.clip.clip_id,
        state="ok",
        generated=counts["generated"],
        human=counts["human"],
        imported=counts["imported"],
        words=float(np.mean([len(text.split()) for text in main.text])),
        span_s=float(np.mean(main.end_s - main.start_s)),
        covered=float((main.end_frame - main.start_frame).sum() / frames),
        resumed=resumed,
    )


def _digest(folder: Path) -> str:
    """Of everything that the generated captions of a clip depend on."""
    found = hashlib.sha256(pgm_data.__version__.encode())
    for name in ("clip.json", *READ_FROM):
        path = folder / name
        found.update(f"{name} {sha256_of(path) if path.is_file() else 'none'} ".encode())
    return found.hexdigest()


@dataclass(kw_only=True)
class _Done:
    """What earlier runs made of which tables."""

    path: Path
    digests: dict[str, list[str]]

    @classmethod
    def of(cls, work: Path) -> "_Done":
        path = work / STATE / "caption.jsonl"
        digests: dict[str, list[str]] = {}
        for line in path.read_text(encoding="utf-8", errors="replace").splitlines() if path.is_file() else ():
            try:
                name, *digest = json.loads(line)
            except ValueError:
                continue  # A killed run may leave half a line; its clip is done again.
            digests[name] = digest
        return cls(path=path, digests=digests)

    def note(self, name: str, digest: list[str]) -> None:
        self.digests[name] = digest
        self.path.parent.mkdir(exist_ok=True)
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps([name, *digest]) + "\n")


def write_caption_run(work: Path, run: CaptionRun, *, command: str, options: object, started: datetime) -> None:
    """Write the run's document beside the work folder's own."""
    states = {"ok": "ok", "no captions": "degraded", "failed": "failed"}
    inputs = [
        {
            "path": outcome.clip_id,
            "state": states[outcome.state],
            "reason": outcome.reason,
            "clips": [outcome.clip_id] if outcome.state != "failed" else [],
            "seconds": None,
        }
        for outcome in run.outcomes
    ]
    document = run_document(command=command, options=options, started=started, inputs=inputs)
    write_document(work / RUN_DOCUMENT, "run", document)
