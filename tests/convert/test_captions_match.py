"""What is wrong with captions is said by file, row, field, expected and found; the other rows go on."""

from dataclasses import replace

import numpy as np
import pytest

from pgm_data.convert.captions_files import read_captions
from pgm_data.convert.captions_match import player_of
from pgm_data.convert.captions_terms import misspelt
from tests.convert.test_captions_files import BEGIN, CLIPS, FRAMES, clip

HEADER = "clip,player,start_frame,end_frame,text,source,alternative\n"
GOOD = "match_1,player0,100,120,stands,human,0\n"


@pytest.mark.parametrize(
    ("row", "field", "expected", "found"),
    [
        ("match_9,player0,0,10,runs,,", "clip", "a clip or its video (match_1, match_2)", "'match_9'"),
        ("match_1,player7,0,10,runs,,", "player", "one of player0, player1, Ann, Bea", "'player7'"),
        ("match_1,,0,10,runs,,", "player", "one of player0, player1, Ann, Bea", "'none'"),
        ("match_1,player0,0,210,runs,,", "start, end", "frames within the clip, 0 to 200", "'0 to 210 frames'"),
        ("match_1,player0,10,10,runs,,", "start, end", "an end after the start", "'10 to 10 frames'"),
        ("match_1,player0,1.5,10,runs,,", "start_frame", "a whole number", "'1.5'"),
        ("match_1,player0,,10,runs,,", "start, end", "a start and an end", ""),
        ("match_1,player0,0,10, ,,", "text", "words", "''"),
        ("match_1,player0,0,10,a\x07b,,", "text", "no control characters", "'U+0007'"),
        ("match_1,player0,0,10,runs,guess,", "source", "one of human, generated, imported", "'guess'"),
        ("match_1,player0,0,10,runs,,-1", "alternative", "0 or a whole number above", "'-1'"),
        ("match_1,player0,0,10,runs,,1", "alternative", "a main text (alternative 0)", "1"),
        ("match_1,player0,110,130,runs,,", "start, end", "no overlap with line 2", "frames 110 to 130"),
        ("match_1,player0,100,120,runs,,0", "alternative", "each alternative of a player's span once", "0 again"),
    ],
)
def test_a_bad_row_is_named_and_the_good_one_is_kept(tmp_path, row, field, expected, found):
    path = tmp_path / "x.csv"
    path.write_text(HEADER + GOOD + row + "\n")
    read = read_captions(path, CLIPS)
    (finding,) = read.errors
    assert (finding.file, finding.place, finding.field) == (str(path), "line 3", field)
    assert expected in finding.expected and found in finding.found
    assert finding.text().startswith(f"{path}: line 3: {field}: expected ")
    assert list(read.clips["match_1"].text) == ["stands"]


def test_an_overlap_by_one_frame_is_cut_and_said(tmp_path):
    (tmp_path / "x.csv").write_text(HEADER + GOOD + "match_1,player0,119,140,runs,,\nmatch_1,player1,110,115,x,,\n")
    read = read_captions(tmp_path / "x.csv", CLIPS)
    assert read.errors == ()
    assert list(read.clips["match_1"].start_frame) == [100, 120, 110]
    assert read.clips["match_1"].start_s[1] == pytest.approx(BEGIN + 120 / 25)
    assert any("it is cut there" in finding.expected for finding in read.findings)


def test_gaps_are_counted_by_player(tmp_path):
    (tmp_path / "x.csv").write_text(HEADER + GOOD)
    (gap,) = read_captions(tmp_path / "x.csv", CLIPS).findings
    assert (gap.level, gap.place, gap.found) == ("warning", "match_1", "2, the longest 4.0 s from 4.00 s")


def test_seconds_may_reach_a_frame_beyond_the_clip_and_no_more(tmp_path):
    for start, ok in ((3.97, True), (3.8, False)):
        (tmp_path / "x.csv").write_text(f"clip,player,start,end,text\nmatch_1,0,{start},12.0,runs\n")
        read = read_captions(tmp_path / "x.csv", CLIPS)
        assert bool(read.clips) == ok
    assert read.errors[0].expected == "a span within the clip, 4.000 to 12.000 s"


def test_a_span_between_two_frames_has_none(tmp_path):
    (tmp_path / "x.csv").write_text("clip,player,start,end,text\nmatch_1,0,4.005,4.02,runs\n")
    assert read_captions(tmp_path / "x.csv", CLIPS).errors[0].expected == "a span with a frame in it"


def test_the_clip_of_a_video_of_several_is_the_one_shown_then(tmp_path):
    clips = {
        "m.00": clip("m.00", video="m.mp4"),
        "m.01": clip("m.01", video="m.mp4", first_video_frame=500, capture_time=20.0 + np.arange(FRAMES) / 25),
    }
    (tmp_path / "x.csv").write_text("video,player,start,end,text\nm.mp4,0,21,22,late\nm,0,5,6,early\nm.mp4,0,15,16,x\n")
    read = read_captions(tmp_path / "x.csv", clips)
    assert {name: list(table.text) for name, table in read.clips.items()} == {"m.01": ["late"], "m.00": ["early"]}
    assert [(finding.place, finding.field) for finding in read.errors] == [("line 4", "clip")]


def test_players_are_known_by_object_number_person_and_end():
    known = CLIPS["match_1"]
    for name, index in (
        ("player1", 1),
        ("Player 1", 1),
        ("1", 1),
        ("p0", 0),
        ("bea", 1),
        ("near", 0),
        ("far player", 1),
    ):
        assert player_of(name, known) == index
    for name in ("", "2", "player2", "nobody"):
        assert player_of(name, known) is None
    alone = replace(known, players=("player0",), identities=("Ann",))
    assert player_of("", alone) == 0
    assert player_of("far", alone) is None


def test_misspelt_terms_are_found_and_english_is_left_alone():
    assert misspelt("a forhand and a Backand to the basline") == {
        "forhand": "forehand", "backand": "backhand", "basline": "baseline",
    }  # fmt: skip
    assert misspelt("since the player is stepping back, both racing players served severe forehands") == {}


def test_the_spelling_is_a_warning(tmp_path):
    (tmp_path / "x.csv").write_text(HEADER + "match_1,player0,0,200,a forhand,,\nmatch_1,player1,0,200,x,,\n")
    read = read_captions(tmp_path / "x.csv", CLIPS)
    assert [(f.level, f.place, f.expected, f.found) for f in read.findings] == [
        ("warning", "line 2", "forehand, as it seems", "'forhand'")
    ]
    assert len(read.clips["match_1"]) == 2
