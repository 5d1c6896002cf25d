"""COCO files of a small clip, and changes to them."""

import json
from dataclasses import replace

import numpy as np

from pgm_data.convert.exchange import ExportOptions
from pgm_data.convert.exchange_tables import export_coco
from pgm_data.dataset.clip_camera import read_clip_camera
from pgm_data.dataset.clip_players import ClipPlayers, read_clip_players, write_clip_players
from pgm_data.scene import load_scene
from tests.simulate.store_worlds import write_truth_clip

TENNIS = load_scene("tennis")
FRAMES = 6


def small_clip(root):
    """A work folder of one clip in which player1 is not always found; its cameras and its players."""
    write_truth_clip(root / "work" / "rally", TENNIS, frames=FRAMES)
    clip = read_clip_players(root / "work" / "rally", TENNIS)
    near, far = clip.players
    box, points = np.array(far.box_px), np.array(near.keypoints_px)
    box[2] = np.nan
    points[:, 3] = np.nan
    score = np.linspace(0.1, 0.9, points.shape[1]) * np.ones((FRAMES, 1))
    score[:, 3] = np.nan
    players = (replace(near, keypoints_px=points, keypoint_score=score), replace(far, box_px=box))
    clip = ClipPlayers(clip_id="rally", video_frame=clip.video_frame, timestamp=clip.timestamp, players=players)
    write_clip_players(root / "work" / "rally", clip, scene=TENNIS)
    return root / "work", read_clip_camera(root / "work" / "rally"), clip


def exported_text(work, out):
    """The clip's COCO file."""
    export_coco(work, out, ExportOptions(every=1))
    return (out / "rally.json").read_text()


def changed(path, change):
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    return path


def strip(content, *, keep=()):
    """What only our own export says, taken out."""
    own = {"clip_id", "frame_index", "video_frame", "timestamp", "player", "track_id", "identity", "keypoint_scores"}
    for thing in (*content["images"], *content["annotations"]):
        for name in own - set(keep):
            thing.pop(name, None)


def without_frames(content, names):
    strip(content)
    for image, name in zip(content["images"], names, strict=True):
        image["file_name"] = name
