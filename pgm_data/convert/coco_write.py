"""The players of a clip as a COCO keypoints dataset.

Boxes are areas from the picture's corner (half a pixel more than ours), keypoints are numbers of pixels, as ours. v is
0 where a keypoint was not found, 1 below `SEEN` and 2 from there on. Besides COCO's keys an image has `clip_id`,
`frame_index`, `video_frame` and `timestamp`, an annotation `player`, `track_id`, `identity` and `keypoint_scores`, so
that `coco_people` reads back the same boxes, points and scores.

Lost: everything in metres (root, joints, rotations, their doubt, contacts), a box's status, frames without a picture,
and identities of frames without a box.
"""

from typing import Any

import numpy as np

from pgm_data.convert.coco_people import COCO_POINTS
from pgm_data.convert.foreign_people import boxes_with_corner_origin
from pgm_data.dataset.clip_players import ClipPlayers, PlayerTrack
from pgm_data.scene import Scene, SceneObject
from pgm_data.skeleton import Skeleton

SEEN = 0.5
"""Score from which a keypoint is called visible."""
DECIMALS = 4
"""Of pixels and scores."""
COCO_EDGES = (
    *((16, 14), (14, 12), (17, 15), (15, 13), (12, 13), (6, 12), (7, 13), (6, 7), (6, 8), (7, 9), (8, 10), (9, 11)),
    *((2, 3), (1, 2), (1, 3), (2, 4), (3, 5), (4, 6), (5, 7)),
)
"""COCO's own, from 1."""


def coco_document(
    players: ClipPlayers, scene: Scene, frames: np.ndarray, names: tuple[str, ...], size: tuple[int, int]
) -> dict[str, Any]:
    """The JSON value of the chosen frames of a clip.

    Args:
        players: The clip's players.
        scene: The scene that declares them.
        frames: Frames of the clip, rising.
        names: File name of each of their pictures.
        size: Width and height of the pictures, px.
    """
    categories = _categories(scene.players)
    images = [
        {
            "id": row + 1,
            "file_name": name,
            "width": size[0],
            "height": size[1],
            "clip_id": players.clip_id,
            "frame_index": int(frame),
            "video_frame": int(players.video_frame[frame]),
            "timestamp": float(players.timestamp[frame]),
        }
        for row, (frame, name) in enumerate(zip(frames.tolist(), names, strict=True))
    ]
    annotations: list[dict[str, Any]] = []
    for number, (track, player) in enumerate(zip(players.players, scene.players, strict=True), 1):
        assert player.skeleton is not None
        category = next(c["id"] for c in categories if c["keypoints"] == list(player.skeleton.keypoint_names))
        for image_id, frame in enumerate(frames.tolist(), 1):
            if np.isfinite(track.box_px[frame]).all():
                own = {"id": len(annotations) + 1, "image_id": image_id, "category_id": category, "track_id": number}
                annotations.append(own | _annotation(track, frame))
    info = {
        "description": f"players of {players.clip_id}",
        "pixels": "boxes: (0, 0) is the corner of the top-left pixel; keypoints: its centre",
    }
    return {"info": info, "images": images, "annotations": annotations, "categories": categories}


def _annotation(track: PlayerTrack, frame: int) -> dict[str, Any]:
    x0, y0, x1, y1 = boxes_with_corner_origin(track.box_px[frame]).tolist()
    points, score = track.keypoints_px[frame], track.keypoint_score[frame]
    found = np.isfinite(points).all(axis=1)
    level = np.where(found, np.where(np.nan_to_num(score) >= SEEN, 2, 1), 0)
    plain = np.where(found[:, None], points, 0.0).round(DECIMALS)
    keypoints = [value for (x, y), v in zip(plain.tolist(), level.tolist(), strict=True) for value in (x, y, int(v))]
    return {
        "player": track.name,
        "identity": str(track.identity[frame]),
        "bbox": [round(value, DECIMALS) for value in (x0, y0, x1 - x0, y1 - y0)],
        "area": round((x1 - x0) * (y1 - y0), DECIMALS),
        "iscrowd": 0,
        "num_keypoints": int(found.sum()),
        "keypoints": keypoints,
        "keypoint_scores": np.where(found, np.nan_to_num(score), 0.0).round(DECIMALS).tolist(),
    }


def _categories(players: tuple[SceneObject, ...]) -> list[dict[str, Any]]:
    """One for each set of keypoints that players have."""
    found: list[dict[str, Any]] = []
    for player in players:
        assert player.skeleton is not None
        names = list(player.skeleton.keypoint_names)
        if all(category["keypoints"] != names for category in found):
            name = "person" if not found else f"person {len(found) + 1}"
            own = {"id": len(found) + 1, "name": name, "supercategory": "person", "keypoints": names}
            found.append(own | {"skeleton": [list(edge) for edge in keypoint_edges(player.skeleton)]})
    return found


def keypoint_edges(skeleton: Skeleton) -> tuple[tuple[int, int], ...]:
    """Pairs of keypoints to draw a line between, from 1: COCO's for its own set, else along the kinematic tree."""
    if skeleton.keypoint_names == COCO_POINTS:
        return COCO_EDGES
    joint_of = skeleton.point_joints[skeleton.keypoints].tolist()
    edges = []
    for number, joint in enumerate(joint_of, 1):
        parent = int(skeleton.parents[joint])
        while parent >= 0 and parent not in joint_of:
            parent = int(skeleton.parents[parent])
        if parent >= 0:
            edges.append((joint_of.index(parent) + 1, number))
    return tuple(edges)
