"""Boxes of a MOTChallenge text file as players, and back: `frame,id,left,top,width,height,conf[,x,y,z]` a row.

Frames count from 1, as the format says, unless a frame 0 shows that they do not; they are frames of the video, not of
the clip. Pixels: left and top are measured from the picture's top-left corner, which is 0 as trackers write it (or 1,
as in MOTChallenge's own annotations: `corner_px`). A file has no names, so ids are given to player objects by where
their feet stand (`foreign_people`). In annotations of nine columns the seventh says whether the row counts, and the
eighth, the class, must be 1, a pedestrian; other rows are passed over.

Lost on the way out: points, poses, the object's name (its id is its place in the scene, from 1), times, and whether a
box was measured or filled.

Source: motchallenge.net, instructions.
"""

import csv
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from pgm_data.convert.coco_frames import in_clip
from pgm_data.convert.foreign_people import (
    LONGEST_PX,
    ForeignPeople,
    PeopleOptions,
    boxes_with_centre_origin,
    boxes_with_corner_origin,
    chosen_rows,
    player_boxes,
)
from pgm_data.convert.loose_csv import DELIMITERS, LARGEST_FILE
from pgm_data.convert.track_csv import LAST_FRAME
from pgm_data.dataset.clip_camera import ClipCamera
from pgm_data.dataset.clip_players import ClipPlayers
from pgm_data.dataset.files import whole_file
from pgm_data.people import PlayerBoxes
from pgm_data.scene import SceneObject

COLUMNS = ("frame", "id", "left", "top", "width", "height", "conf")
ANNOTATION_COLUMNS = 9
"""Of MOTChallenge's annotations: the seven, class and visibility."""
PEDESTRIAN = 1
NOT_GIVEN = -1.0
"""What stands where a value is not known."""


def read_mot_boxes(
    path: Path, clip: ClipCamera, players: tuple[SceneObject, ...], options: PeopleOptions | None = None
) -> PlayerBoxes:
    """The players' boxes in the clip's frames; rows of other frames are passed over.

    A confidence that is not within 0 to 1 throughout is none, and the box's is 1.

    Raises:
        ValueError: If the file cannot be read, a value is not what it must be, an id is twice in a frame, or no row is
            of the clip. The message names file, line, field, what was expected and found.
    """
    options = options or PeopleOptions()
    values, lines = _values(path)
    first = options.first_number if options.first_number is not None else int(not (values[:, 0] == 0).any())
    if (values[:, 0] < first).any():
        row = int(np.flatnonzero(values[:, 0] < first)[0])
        raise ValueError(f"{path}: line {lines[row]}: frame: expected {first} or more, got {values[row, 0]:g}")
    tracked = np.flatnonzero(values[:, 1] >= 0)
    _, at, counts = np.unique(values[tracked, :2], axis=0, return_index=True, return_counts=True)
    if (counts > 1).any():
        row = int(tracked[at[counts > 1][0]])
        got = f"{values[row, 1]:g} {counts.max()} times"
        raise ValueError(f"{path}: line {lines[row]}: id: expected each id once in a frame, got {got}")
    if values.shape[1] == ANNOTATION_COLUMNS:
        counted = (values[:, 6] != 0) & (values[:, 7] == PEDESTRIAN)
        if not counted.any():
            got = ", ".join(f"{number:g}" for number in np.unique(values[:, 7])[:5])
            expected = f"rows that count (conf not 0) of class {PEDESTRIAN}, a pedestrian"
            raise ValueError(f"{path}: class: expected {expected}, got none, of classes {got}")
        values = values[counted]
    frame = in_clip(values[:, 0].astype(np.int64) - first, clip)
    own = frame >= 0
    if not own.any():
        span = f"{clip.video_frame[0]} to {clip.video_frame[-1]}"
        raise ValueError(f"{path}: frame: expected frames of the clip, {span} of the video, got none of them")
    conf = values[:, 6] if values.shape[1] > 6 else np.full(len(values), NOT_GIVEN)
    is_probability = ((conf >= 0) & (conf <= 1)).all()
    corners = values[:, 2:4] - options.corner_px
    boxes = boxes_with_centre_origin(np.concatenate([corners, corners + values[:, 4:6]], axis=1))[own]
    people = ForeignPeople(
        path=path,
        frame=frame[own],
        boxes_px=boxes,
        feet_px=np.stack([(boxes[:, 0] + boxes[:, 2]) / 2, boxes[:, 3]], axis=1),
        score=conf[own] if is_probability else np.ones(int(own.sum())),
        player=np.full(int(own.sum()), -1),
        # An id of -1 is a detection that no tracker has seen.
        track=np.array([f"{value:.0f}" if value >= 0 else "" for value in values[own, 1]], dtype=object),
    )
    return player_boxes(people, chosen_rows(people, clip, players), clip, players)


def write_mot_boxes(path: Path, players: ClipPlayers) -> int:
    """Write the players' boxes with frames from 1 and corner pixels; how many rows there are."""
    rows: list[str] = []
    for number, player in enumerate(players.players, 1):
        there = np.flatnonzero(np.isfinite(player.box_px).all(axis=1))
        box = boxes_with_corner_origin(player.box_px[there])
        sides = np.concatenate([box[:, :2], box[:, 2:] - box[:, :2]], axis=1)
        frames = players.video_frame[there] + 1
        rows += [
            f"{frame},{number},{x:.4f},{y:.4f},{w:.4f},{h:.4f},1,-1,-1,-1"
            for frame, (x, y, w, h) in zip(frames.tolist(), sides.tolist(), strict=True)
        ]
    rows.sort(key=lambda row: [int(cell) for cell in row.split(",")[:2]])
    with whole_file(path) as temporary:
        temporary.write_text("".join(f"{row}\n" for row in rows), encoding="utf-8")
    return len(rows)


def _values(path: Path) -> tuple[Float[np.ndarray, "rows columns"], Int[np.ndarray, " rows"]]:
    """The file's numbers, and the line of each row."""
    expected = f"a text of rows {','.join(COLUMNS)}"
    try:
        if not path.is_file():  # opening a pipe would wait for ever
            raise OSError("a folder" if path.is_dir() else "no regular file" if path.exists() else "nothing there")
        if path.stat().st_size > LARGEST_FILE:
            raise OSError(f"{path.stat().st_size} bytes, more than {LARGEST_FILE}")
        with path.open(encoding="utf-8-sig", newline="") as file:
            start = file.readline()
            delimiter = max((*DELIMITERS, " "), key=start.count)
            file.seek(0)
            reader = csv.reader(file, delimiter=delimiter, skipinitialspace=delimiter == " ")
            found = [(reader.line_num, [cell.strip() for cell in cells]) for cells in reader if "".join(cells).strip()]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"{path}: expected {expected}, got: {error}") from error
    if found and not any(_is_number(cell) for cell in found[0][1]):
        titles = [title.lower() for title in found[0][1]]
        if titles[:2] != list(COLUMNS[:2]):
            raise ValueError(f"{path}: line {found[0][0]}: expected {expected}, got {','.join(titles)[:100]}")
        found = found[1:]
    if not found:
        raise ValueError(f"{path}: expected {expected}, got none")
    width = len(found[0][1])
    if not 6 <= width <= 20:
        raise ValueError(f"{path}: line {found[0][0]}: expected 6 to 10 values, got {width}")
    for line, cells in found:
        if len(cells) != width:
            raise ValueError(f"{path}: line {line}: expected {width} values as in the first row, got {len(cells)}")
        wrong = next((i for i, cell in enumerate(cells) if not _is_number(cell)), None)
        if wrong is not None:
            name = COLUMNS[wrong] if wrong < len(COLUMNS) else f"value {wrong + 1}"
            raise ValueError(f"{path}: line {line}: {name}: expected a number, got {cells[wrong][:60]!r}")
    values = np.array([[float(cell) for cell in cells] for _, cells in found])
    lines = np.array([line for line, _ in found])
    _refuse(path, values, lines)
    return values, lines


def _refuse(path: Path, values: Float[np.ndarray, "rows columns"], lines: Int[np.ndarray, " rows"]) -> None:
    frame, track = values[:, 0], values[:, 1]
    for name, bad, expected, column in (
        ("frame", ~((frame >= 0) & (frame <= LAST_FRAME) & (frame == np.floor(frame))), f"0 to {LAST_FRAME}", 0),
        ("id", ~((track >= -1) & (track <= 1e9) & (track == np.floor(track))), "a whole number, or -1", 1),
        ("left", ~(np.abs(values[:, 2]) <= LONGEST_PX), f"at most {LONGEST_PX:g} px", 2),
        ("top", ~(np.abs(values[:, 3]) <= LONGEST_PX), f"at most {LONGEST_PX:g} px", 3),
        ("width", ~((values[:, 4] > 0) & (values[:, 4] <= LONGEST_PX)), f"above 0, at most {LONGEST_PX:g} px", 4),
        ("height", ~((values[:, 5] > 0) & (values[:, 5] <= LONGEST_PX)), f"above 0, at most {LONGEST_PX:g} px", 5),
    ):
        if bad.any():
            row = int(np.flatnonzero(bad)[0])
            raise ValueError(f"{path}: line {lines[row]}: {name}: expected {expected}, got {values[row, column]:g}")


def _is_number(text: str) -> bool:
    """Whether it is a finite number, as Python alone would read 1_000 and nan too."""
    try:
        return "_" not in text and bool(np.isfinite(float(text)))
    except ValueError:
        return False
