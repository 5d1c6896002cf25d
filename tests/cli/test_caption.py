"""`pgm caption` on a work folder: what it generates, reads, keeps and refuses."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from pgm_cli.main import run

from pgm_data.caption.measures import facts_of_play, play_of_clip
from pgm_data.dataset.check import check_paths
from pgm_data.dataset.clip_ball import read_clip_ball
from pgm_data.dataset.clip_players import read_clip_players
from pgm_data.dataset.tables import read_table
from pgm_data.scene import load_scene


@pytest.fixture(scope="module")
def played(tmp_path_factory) -> Path:
    """A work folder of simulated play with all its truth, captions included."""
    out = tmp_path_factory.mktemp("played")
    argv = [
        "simulate",
        "--out",
        str(out / "sim"),
        "--pictures",
        "none",
        "--no-dataset",
        "--no-closeups",
        "--seed",
        "12",
    ]
    assert run([*argv, "--matches", "1", "--minutes", "0.7", "--jobs", "1"]) == 0
    return out / "sim" / "work"


@pytest.fixture
def work(played: Path, tmp_path: Path) -> Path:
    """The same without captions, to be written into."""
    shutil.copytree(played, tmp_path / "work")
    for path in (tmp_path / "work").glob("*/captions.parquet"):
        path.unlink()
    return tmp_path / "work"


def clips(work: Path) -> list[Path]:
    return sorted(path.parent for path in work.glob("*/clip.json"))


def test_captions_are_generated_checked_and_resumed(work, capsys):
    assert run(["caption", str(work), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert [clip["state"] for clip in said["clips"]] == ["ok"] * len(clips(work))
    captions = pd.concat([pd.read_parquet(folder / "captions.parquet") for folder in clips(work)])
    main = captions[captions["alternative"] == 0]
    assert set(captions["source"]) == {"generated"}
    assert main["text"].str.split().str.len().mean() == pytest.approx(14, abs=3)
    assert (main["end_s"] - main["start_s"]).mean() == pytest.approx(1.3, abs=0.3)
    assert json.loads((work / "run_caption.json").read_text())["command"].startswith("pgm caption")
    assert [v for v in check_paths([work]) if "captions" in str(v)] == []
    assert run(["caption", str(work)]) == 2
    assert "--resume goes on" in capsys.readouterr().err
    before = {folder: (folder / "captions.parquet").stat().st_mtime_ns for folder in clips(work)}
    assert run(["caption", str(work), "--resume", "--json"]) == 0
    assert all(clip["resumed"] for clip in json.loads(capsys.readouterr().out)["clips"])
    assert {folder: (folder / "captions.parquet").stat().st_mtime_ns for folder in clips(work)} == before


def test_the_facts_agree_with_what_the_simulator_says(played):
    """By keywords of its sentences, on its own spans: strokes' sides and left and right may never differ."""
    scene = load_scene("tennis")
    checked = {"side": 0, "zone": 0, "way": 0}
    for folder in clips(played):
        times = read_table(folder / "camera.parquet")["frame.capture_time"]
        said = pd.read_parquet(folder / "captions.parquet")
        play = play_of_clip(read_clip_players(folder, scene), read_clip_ball(folder, times), times, scene)
        for (player, start, end), group in said.groupby(["player", "start_s", "end_s"]):
            texts = list(group["text"])
            for k in np.flatnonzero((play.hits.player == player) & (play.hits.time >= start) & (play.hits.time < end)):
                sides = {side for side in ("forehand", "backhand") if any(side in text for text in texts)}
                if play.hits.side[k] in ("forehand", "backhand") and sides:
                    assert {play.hits.side[k]} == sides, texts
                    checked["side"] += 1
                where = {
                    s for text in texts for s in re.findall(r"(left|right) (?:service box|side of (?:the )?no m)", text)
                }
                if play.hits.zone_side[k] in ("left", "right") and where and play.hits.stroke[k] == "serve":
                    assert {play.hits.zone_side[k]} == where, texts
                    checked["zone"] += 1
        spans = said[["player", "start_frame", "end_frame"]].drop_duplicates().to_numpy(dtype=np.int64)
        facts = facts_of_play(play, spans).spans
        for k in range(len(facts)):
            row = (said["player"] == facts.player[k]) & (said["start_frame"] == facts.start_frame[k])
            text = said[row & (said["alternative"] == 0)]["text"].iloc[0]
            told = re.findall(r"(?:to|towards) (?:the|its) (left|right)(?: side)?(?! (?:side|part|end|service))", text)
            mine = [word for word in facts.way[k].split() if word in ("left", "right")]
            simple = not re.search("then|before|again|back|baseline|ball|serve", text)
            if facts.motion[k] == "moves" and facts.hit[k] < 0 and mine and len(told) == 1 and simple:
                assert told == mine, text
                checked["way"] += 1
    assert min(checked.values()) >= 1 and sum(checked.values()) >= 12, checked


def test_what_people_wrote_stays_and_generated_captions_stand_beside_it(work, tmp_path, capsys):
    folder = clips(work)[0]
    start = float(read_table(folder / "camera.parquet")["frame.capture_time"][10])
    (tmp_path / "mine.csv").write_text(
        f"clip,player,start,end,text\n{folder.name},player1,{start:.3f},{start + 1:.3f},my own words\n"
    )
    assert run(["caption", str(work), "--from", str(tmp_path / "mine.csv"), "--source", "human", "--quiet"]) == 0
    assert run(["caption", str(work), "--quiet"]) == 0
    rows = pd.read_parquet(folder / "captions.parquet")
    human = rows[rows["source"] == "human"]
    assert list(human["text"]) == ["my own words"]
    beside = rows[(rows["source"] == "generated") & (rows["player"] == 1)]
    first, last = human["start_frame"].iloc[0], human["end_frame"].iloc[0]
    assert len(beside) and not ((beside["start_frame"] < last) & (beside["end_frame"] > first)).any()
    assert [v for v in check_paths([folder]) if "captions" in str(v)] == []
    # The same span again is refused, unless it is asked for.
    again = ["caption", str(work), "--from", str(tmp_path / "mine.csv"), "--quiet"]
    assert run(again) == 3
    assert "no human or imported caption yet" in capsys.readouterr().err
    assert run([*again, "--overwrite"]) == 0
    assert list(pd.read_parquet(folder / "captions.parquet")["source"]) == ["imported"]


def test_an_export_read_back_is_the_same_table(work, tmp_path):
    assert run(["caption", str(work), "--quiet", "--export", str(tmp_path / "all.json")]) == 0
    before = {folder: read_table(folder / "captions.parquet") for folder in clips(work)}
    argv = ["caption", str(work), "--from", str(tmp_path / "all.json"), "--overwrite", "--quiet"]
    assert run(argv) == 0
    for folder, table in before.items():
        after = read_table(folder / "captions.parquet")
        assert all((after[name] == table[name]).all() for name in table)


def test_bad_rows_are_refused_by_name_and_the_others_go_on(work, tmp_path, capsys):
    folder = clips(work)[0]
    path = tmp_path / "x.csv"
    path.write_text(f"clip,player,start_frame,end_frame,text\n{folder.name},0,0,20,runs\n{folder.name},9,0,20,x\n")
    assert run(["caption", str(work), "--from", str(path)]) == 3
    said = capsys.readouterr()
    assert f"{path}: line 3: player: expected one of player0, player1" in said.err
    assert "warning" in said.out and "gaps" in said.out
    assert list(pd.read_parquet(folder / "captions.parquet")["text"]) == ["runs"]


def test_one_bad_clip_does_not_stop_the_others(work, capsys):
    first, second, *_ = clips(work)
    (first / "players.parquet").unlink()
    (second / "ball.parquet").unlink()
    assert run(["caption", str(work)]) == 3
    assert "run pgm players first" in capsys.readouterr().err
    assert not (first / "captions.parquet").exists()
    words = " ".join(pd.read_parquet(second / "captions.parquet")["text"])
    assert not re.search("forehand|backhand|serve", words), "without a ball, movement alone is told"
    for folder in clips(work):
        (folder / "players.parquet").unlink(missing_ok=True)
    assert run(["caption", str(work), "--overwrite"]) == 4


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["--resume", "--overwrite"], "expected one of them, got both"),
        (["--from", "nowhere.csv"], "expected a file or a folder, got nowhere.csv"),
        (["--source", "human"], "--source: is for captions that are read with --from"),
        (["--clip", "no_such"], "--clip: expected clips of"),
    ],
)
def test_what_cannot_be_meant_is_a_usage_error(played, argv, said, capsys):
    assert run(["caption", str(played), *argv]) == 2
    assert said in capsys.readouterr().err
    assert run(["caption", str(played / "nowhere")]) == 2
