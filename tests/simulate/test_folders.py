"""What `pgm simulate` leaves on disk keeps the contract, and bad options end with exit code 2."""

import hashlib
from pathlib import Path

import av
import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml
from pgm_cli.main import run

from pgm_data.dataset.check import check_paths
from pgm_data.dataset.documents import read_document
from pgm_data.dataset.tables import read_table
from pgm_data.geometry.camera import Camera, project
from pgm_data.scene import load_scene, scene_text
from pgm_data.simulate.clip import simulate_clip, simulate_shots
from pgm_data.simulate.clip_options import ClipOptions
from pgm_data.simulate.folders import match_seed, world_seed
from pgm_data.simulate.mask_files import DEPTH_UNIT_M
from pgm_data.video import open_video

NAMES = ("none", "draft", "full")
SMALL = ["--resolution", "160x90", "--jobs", "1"]


def test_a_match_has_its_video_and_the_truth_of_every_frame(tmp_path: Path) -> None:
    out = tmp_path / "out"
    argv = [
        "simulate",
        "--out",
        str(out),
        "--matches",
        "1",
        "--minutes",
        "0.008",
        "--no-dataset",
        "--duplicates",
        "--seed",
        "3",
        *SMALL,
    ]
    assert run(argv) == 0
    assert check_paths([out / "work"]) == []
    camera = read_table(out / "work" / "tennis_3_000" / "camera.parquet")
    with open_video(out / "videos" / "tennis_3_000.mp4") as video:
        times = [frame.timestamp for frame in video]
    assert len(times) == 12
    np.testing.assert_allclose(camera["timestamp"], times, atol=1e-6)
    assert set(camera["camera.status"]) == {"measured"}
    options = ClipOptions(frames=12, width=160, height=90, duplicates=True)
    truth = simulate_clip(load_scene("tennis"), options, match_seed(3, 0))
    np.testing.assert_array_equal(camera["camera.K"].reshape(-1, 3, 3), truth.track.K)
    np.testing.assert_array_equal(camera["frame.is_duplicate"], truth.is_duplicate)
    assert not camera["camera.reprojection_px"].any()
    assert read_document(out / "work" / "run.json", "run")["options"]["seed"] == 3
    clip = read_document(out / "work" / "tennis_3_000" / "clip.json", "clip")
    assert clip["quality"] == "truth" and (out / "work" / clip["source_path"]).exists()


def test_tables_are_the_same_whatever_is_drawn_and_shots_are_cut_at_closeups(tmp_path: Path) -> None:
    argv = ["--matches", "1", "--minutes", "0.5", "--fps", "1", "--seed", "3", "--resolution", "128x72", "--jobs", "1"]
    for name, more in (("none", ["--pictures", "none"]), ("draft", ["--pictures", "draft", "--masks"]), ("full", [])):
        assert run(["simulate", "--out", str(tmp_path / name), *argv, *more]) == 0
    tables = [{k: v for k, v in _contents(tmp_path / n / "work").items() if k.endswith(".parquet")} for n in NAMES]
    assert tables[0] == tables[1] == tables[2] and len(tables[0]) > 6
    assert not (tmp_path / "none" / "videos").exists()
    shots = read_table(tmp_path / "none" / "work" / "shots.parquet")
    assert len(shots["video_frame"]) == 30
    assert (shots["verdict"] == "other").any()
    assert ((shots["verdict"] == "clip") == (shots["clip_id"] != "")).all()


def _contents(folder: Path) -> dict[str, str]:
    """The hash of every file but those that tell of the run itself."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != "run.json" and ".pgm" not in path.parts
    }


@pytest.mark.parametrize(("scene", "more"), [("tennis", ["--masks", "--duplicates"]), ("blocks", [])])
def test_every_byte_is_the_same_with_workers_in_other_processes(scene: str, more: list[str], tmp_path: Path) -> None:
    argv = ["--scene", scene, "--matches", "2", "--minutes", "0.004", "--seed", "7", "--resolution", "128x72", *more]
    for jobs in ("1", "2"):
        assert run(["simulate", "--out", str(tmp_path / jobs), *argv, "--jobs", jobs]) == 0
    assert _contents(tmp_path / "1") == _contents(tmp_path / "2")


def test_matches_take_turns_in_as_many_worlds_as_asked_for(tmp_path: Path) -> None:
    out = tmp_path / "out"
    argv = ["simulate", "--out", str(out), "--scene", "blocks", "--matches", "3", "--minutes", "0.001", "--seed", "7"]
    assert run([*argv, "--worlds", "2", "--pictures", "none", "--resolution", "128x72", "--jobs", "1"]) == 0
    assert read_document(out / "work" / "run.json", "run")["options"]["worlds"] == 2
    first, second, third = (world_seed(7, match, 2) for match in range(3))
    assert first == third != second and world_seed(7, 0, 0) is None
    assert first not in {match_seed(7, match) for match in range(3)}
    for match, place in enumerate((first, second, third)):
        options = ClipOptions(frames=1, width=128, height=72, fps=20.0, world_seed=place)
        truth = simulate_clip(load_scene("blocks"), options, match_seed(7, match))
        camera = read_table(out / "work" / f"blocks_7_00{match}" / "camera.parquet")
        np.testing.assert_array_equal(camera["camera.t_cam_from_world"], truth.track.t_cam_from_world)
        root = read_table(out / "work" / f"blocks_7_00{match}" / "players.parquet")["player0.root_position"]
        (shot,) = simulate_shots(load_scene("blocks"), options, match_seed(7, match))
        assert shot.states is not None
        np.testing.assert_allclose(root, shot.states.players[0].translations[:, 0], atol=1e-5)


def test_tables_and_dataset_keep_the_contract_with_all_their_laws(tmp_path: Path) -> None:
    out = tmp_path / "out"
    argv = ["simulate", "--out", str(out), "--matches", "1", "--minutes", "0.3", "--seed", "1", "--masks"]
    assert run([*argv, "--fps", "2", *SMALL]) == 0
    assert check_paths([out / "work", out / "dataset"]) == []
    clips = sorted(p.parent.name for p in (out / "work").glob("*/clip.json"))
    for clip in clips:
        names = {p.name for p in (out / "work" / clip).iterdir()}
        tables = {f"{t}.parquet" for t in ("camera", "players", "ball", "events", "ball_shots", "captions")}
        assert names == tables | {"clip.json", "labels.mkv", "depth.mkv"}
    document = read_document(out / "work" / clips[0] / "clip.json", "clip")
    assert set(document["players"]) == {"player0", "player1"}
    # One person is called the same in every clip of a match, at whichever end.
    people = {
        p["identity"]
        for clip in clips
        if clip.startswith("tennis_1_000")
        for p in read_document(out / "work" / clip / "clip.json", "clip")["players"].values()
    }
    assert len(people) == 2


def test_masks_say_which_object_is_seen_and_how_far(tmp_path: Path) -> None:
    out = tmp_path / "out"
    argv = ["simulate", "--out", str(out), "--matches", "1", "--minutes", "0.005", "--masks", "--pictures", "none"]
    assert run([*argv, "--resolution", "640x360", "--jobs", "1"]) == 0
    folder = out / "work" / "tennis_0_000"
    with av.open(str(folder / "labels.mkv")) as video:
        labels = [frame.to_ndarray() for frame in video.decode(video=0)]
    with av.open(str(folder / "depth.mkv")) as video:
        depth = [frame.to_ndarray() * DEPTH_UNIT_M for frame in video.decode(video=0)]
    rows = read_table(folder / "players.parquet")
    assert len(labels) == len(depth) == len(rows["frame_index"])
    for player in (0, 1):
        where = np.argwhere(labels[0] == 1 + player)
        y0, x0 = where.min(axis=0)
        y1, x1 = where.max(axis=0)
        box = rows[f"player{player}.box_px"][0]
        # The mask holds the racket, which the box of the person does not.
        assert x0 - 4 < box[2] and x1 + 4 > box[0] and y0 - 4 < box[3] and y1 + 4 > box[1]
        assert abs((y0 + y1) / 2 - (box[1] + box[3]) / 2) < 0.25 * (box[3] - box[1])
    assert depth[0][labels[0] == 1].mean() < depth[0][labels[0] == 2].mean()
    # The net's tape is marked from post to post where nobody stands before it, as far away as it is.
    scene = load_scene("tennis")
    assert scene.court is not None
    camera = {name: values[0] for name, values in read_table(folder / "camera.parquet").items()}
    R, t = camera["camera.R_cam_from_world"].reshape(3, 3), camera["camera.t_cam_from_world"]
    places = scene.court.net_world[:1] + np.linspace(0.0, 1.0, 50)[1:-1, None] * np.diff(
        scene.court.net_world[:2], axis=0
    )
    places[:, 2] -= 0.5 * scene.court.tape_width
    own = Camera(
        K=camera["camera.K"].reshape(3, 3),
        distortion=camera["camera.distortion"],
        R_cam_from_world=R,
        t_cam_from_world=t,
    )
    pixels, seen = project(own, places)
    x, y = np.rint(pixels[seen]).astype(int).T
    net = labels[0][y, x] == 1 + [thing.name for thing in scene.objects].index("net")
    assert net.mean() > 0.7
    np.testing.assert_allclose(depth[0][y, x][net], (places @ R[2] + t[2])[seen][net], atol=0.05)


def test_a_court_without_people_and_ball_has_neither(tmp_path: Path) -> None:
    scene = yaml.safe_load(scene_text("tennis"))
    scene["name"] = "empty"
    scene["objects"] = {name: scene["objects"][name] for name in ("court", "backplate")}
    del scene["ball"]
    path = tmp_path / "empty.yaml"
    path.write_text(yaml.safe_dump(scene), encoding="utf-8")
    out = tmp_path / "out"
    argv = ["simulate", "--out", str(out), "--scene", str(path), "--matches", "1", "--minutes", "0.004"]
    assert run([*argv, *SMALL]) == 0
    assert sorted(p.name for p in (out / "work" / "empty_0_000").iterdir()) == ["camera.parquet", "clip.json"]
    columns = pq.read_schema(out / "dataset" / "data" / "chunk-000" / "file-000.parquet").names
    assert not [name for name in columns if name.startswith(("player", "ball"))]
    assert not (out / "dataset" / "captions").exists()


def test_a_mix_has_status_none_where_no_court_is_seen(tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert run(["simulate", "--out", str(out), "--mix", "40", "--seed", "2", *SMALL]) == 0
    assert check_paths([out / "work"]) == []
    camera = read_table(out / "work" / "mix_2_0000" / "camera.parquet")
    none = camera["camera.status"] == "none"
    assert 0 < none.sum() < 16
    assert (np.isnan(camera["camera.K"]).all(axis=1) == none).all()
