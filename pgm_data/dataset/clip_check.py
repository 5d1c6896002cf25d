"""A clip's folder against the contract: its document and its tables, which agree frame by frame."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pgm_data.dataset.clip_laws import (
    ball_event_faults,
    caption_time_faults,
    event_frame_faults,
    flight_event_faults,
    misaligned_faults,
    net_faults,
    player_speed_faults,
    unsolved_faults,
)
from pgm_data.dataset.columns import TABLES
from pgm_data.dataset.findings import Findings
from pgm_data.dataset.laws import Context, declared_keys
from pgm_data.dataset.table_check import checked_table
from pgm_data.scene import Scene, load_scene


@dataclass(frozen=True, eq=False, kw_only=True)
class CheckedClip:
    """What a clip's folder holds."""

    document: dict[str, Any] | None
    """`clip.json`, where it holds to its schema."""
    scene: Scene | None
    """None where nobody knows the one it names."""
    tables: dict[str, dict[str, np.ndarray]]
    """By table, the columns that are what they must be; tables that are not there are absent."""
    contents: dict[str, pa.Table]
    """The same as they are stored."""

    @property
    def keys(self) -> dict[str, np.ndarray]:
        """Columns of its camera table; empty where its keys could not be read."""
        camera = self.tables.get("camera", {})
        return camera if declared_keys(camera) else {}


@cache
def shipped_scene(name: str) -> Scene | None:
    """The scene of that name, if it ships with the package."""
    try:
        # A path would be a file of the reader's machine, chosen by whoever wrote the document.
        return load_scene(name) if name.isidentifier() else None
    except ValueError:
        return None


def check_clip(folder: Path, findings: Findings) -> CheckedClip:
    """A clip's folder: its document and its tables, which agree frame by frame."""
    document = None
    if findings.expect(folder / "clip.json"):
        document = findings.document(folder / "clip.json", "clip")
    context = _context(folder, document, findings)
    findings.expect(folder / "camera.parquet")
    tables: dict[str, dict[str, np.ndarray]] = {}
    contents: dict[str, pa.Table] = {}
    for table in TABLES:
        path = folder / f"{table}.parquet"
        if not path.exists():
            continue
        if table == "shots":
            findings.say(path, "", "no such file here: it belongs into the work folder", table)
            continue
        findings.files.append(path)
        if context.scene is None and TABLES[table].needs:
            continue  # clip.json has been reported, and without its scene nobody can say which columns there are
        checked = checked_table(path, table, context)
        findings.add(path, checked.faults)
        tables[table] = checked.columns
        if checked.content is not None:
            contents[table] = checked.content
    clip = CheckedClip(document=document, scene=context.scene, tables=tables, contents=contents)
    _check_agreement(folder, clip, findings)
    return clip


def _check_agreement(folder: Path, clip: CheckedClip, findings: Findings) -> None:
    """What the clip's files say of each other."""
    tables = clip.tables
    for table, columns in tables.items():
        if TABLES[table].frame_aligned and table != "camera" and clip.keys and declared_keys(columns):
            findings.add(folder / f"{table}.parquet", misaligned_faults(columns, clip.keys))
    document = clip.document
    if document is not None and "solved_share" in document and "camera.status" in tables.get("camera", {}):
        findings.add(folder / "clip.json", unsolved_faults(document["solved_share"], tables["camera"]["camera.status"]))
    if "events" in tables and "ball_shots" in tables:
        findings.add(folder / "ball_shots.parquet", flight_event_faults(tables["ball_shots"], tables["events"]))
    if "players" in tables and clip.keys:
        findings.add(folder / "players.parquet", player_speed_faults(tables["players"], clip.keys, clip.scene))
    if "events" in tables and clip.keys:
        findings.add(folder / "events.parquet", event_frame_faults(tables["events"], clip.keys))
    if "captions" in tables and clip.keys:
        findings.add(folder / "captions.parquet", caption_time_faults(tables["captions"], clip.keys))
    if "events" in tables and "ball" in tables and clip.keys:
        findings.add(folder / "ball.parquet", net_faults(tables["ball"], tables["events"], clip.keys, clip.scene))
    if "events" in tables and "ball" in tables:
        findings.add(folder / "ball.parquet", ball_event_faults(tables["ball"], tables["events"]))


def _context(folder: Path, document: dict[str, Any] | None, findings: Findings) -> Context:
    if document is None:
        return Context(scene=findings.scene, clip_id=folder.resolve().name)
    scene = findings.scene or shipped_scene(document["scene"])
    name = folder.resolve().name
    if document["clip_id"] != name:
        findings.say(folder / "clip.json", "clip_id", f"{name!r}, the folder's name", repr(document["clip_id"]))
    if scene is not None:
        stray = sorted(set(document["players"]) - {player.name for player in scene.players})
        for player in stray:
            expected = f"a player object of scene {scene.name}"
            findings.say(folder / "clip.json", f"players.{player}", expected, repr(player))
    return Context(
        scene=scene,
        clip_id=name,
        n_frames=int(document["n_frames"]),
        first_video_frame=int(document["first_video_frame"]),
        size=(int(document["width"]), int(document["height"])),
        quality=document["quality"],
    )
