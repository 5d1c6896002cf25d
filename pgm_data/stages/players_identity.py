"""Who the players of a work folder are: what they look like is kept clip by clip and compared within each match."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pgm_data.dataset.clip_camera import ClipCamera
from pgm_data.dataset.clip_players import read_clip_players, write_clip_players
from pgm_data.dataset.documents import read_document, write_document
from pgm_data.dataset.files import whole_file
from pgm_data.detect.players.identities import ClipIdentities, ClipLooks, match_identities
from pgm_data.people import PlayerLooks
from pgm_data.scene import Scene
from pgm_data.stages.clip_run import ClipRow
from pgm_data.stages.players_detect import FoundPlayers
from pgm_data.stages.work_folder import STATE, key_of


def looks_path(work: Path, clip_id: str) -> Path:
    """Where the looks of a clip's players are kept."""
    return work / STATE / "players" / "looks" / f"{key_of(clip_id)}.npz"


def keep_looks(work: Path, clip: ClipCamera, found: FoundPlayers) -> None:
    """Keep what the players of a clip look like, for the day that the other clips of its match are known."""
    path = looks_path(work, clip.clip_id)
    path.parent.mkdir(parents=True, exist_ok=True)
    looks = found.looks
    with whole_file(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            names=np.array(looks.names),
            descriptors=looks.descriptors,
            weight=looks.weight,
            cut=found.cut,
        )


def read_looks(work: Path, clip_id: str) -> ClipLooks | None:
    """What the players of a clip look like; None where nothing was kept, or a file is damaged."""
    try:
        with np.load(looks_path(work, clip_id), allow_pickle=False) as kept:
            looks = PlayerLooks(
                names=tuple(str(name) for name in kept["names"]),
                descriptors=kept["descriptors"],
                weight=kept["weight"],
            )
            return ClipLooks(clip_id=clip_id, looks=looks, cut=kept["cut"])
    except (OSError, ValueError, KeyError, EOFError):
        return None


@dataclass(frozen=True, eq=False, kw_only=True)
class _Known:
    """A clip on its way to have its players named."""

    clip_id: str
    match_id: str
    start: tuple[str, int]
    looks: ClipLooks


def name_players(work: Path, rows: Sequence[ClipRow], scene: Scene) -> Sequence[ClipRow]:
    """Name the players of all clips, match by match, in their tables and in clip.json; the rows as they are.

    A match's clips are compared in order of their videos and frames. Clips of an earlier run take part, so that a
    person keeps the name; an identity that another program gave stays.
    """
    matches: dict[str, list[_Known]] = {}
    for path in sorted(work.glob("*/players.parquet")):
        folder = path.parent
        looks = read_looks(work, folder.name)
        if looks is None:
            continue
        document = read_document(folder / "clip.json", "clip")
        start = (str(document["source_path"]), int(document["first_video_frame"]))
        known = _Known(clip_id=folder.name, match_id=str(document["match_id"]), start=start, looks=looks)
        matches.setdefault(known.match_id, []).append(known)
    for match_id, clips in matches.items():
        clips.sort(key=lambda known: known.start)
        for named in match_identities([known.looks for known in clips], match_id):
            _write(work / named.clip_id, named, scene)
    return rows


def _write(folder: Path, named: ClipIdentities, scene: Scene) -> None:
    """Write the names of one clip's players where they are not there yet."""
    clip = read_clip_players(folder, scene)
    if any(len(track.status) != len(named.identity) for track in clip.players):
        return  # the table was replaced by one of another length since
    tracks = tuple(
        replace(track, identity=np.where(track.status == "none", "", named.identity[:, number]).astype(object))
        for number, track in enumerate(clip.players)
    )
    if any((a.identity != b.identity).any() for a, b in zip(tracks, clip.players, strict=True)):
        write_clip_players(folder, replace(clip, players=tracks), scene=scene)
    document = read_document(folder / "clip.json", "clip")
    people = dict(document["players"])
    for track in tracks:
        who: Mapping = people.get(track.name) or {}
        names = sorted({str(name) for name in track.identity if name})
        people[track.name] = {
            "identity": names[0] if len(names) == 1 else None,
            "handedness": who.get("handedness"),
        }
    if people != document["players"]:
        write_document(folder / "clip.json", "clip", document | {"players": people})
