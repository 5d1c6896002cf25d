"""Captions written and read back: what each format keeps, and what a reader makes of foreign files."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_data.convert.captions_files import read_captions, write_captions
from pgm_data.convert.captions_match import ReadOptions
from pgm_data.convert.captions_rows import CaptionClip
from pgm_data.dataset.clip_captions import CaptionRows

FRAMES, FPS, BEGIN = 200, 25.0, 4.0
PLAYERS = ("player0", "player1")


def clip(name: str = "match_1", **more) -> CaptionClip:
    given = {
        "clip_id": name,
        "video": f"{name}.mp4",
        "first_video_frame": 100,
        "capture_time": BEGIN + np.arange(FRAMES) / FPS,
        "players": PLAYERS,
        "identities": ("Ann", "Bea"),
    }
    return CaptionClip(**given | more)


CLIPS = {"match_1": clip(), "match_2": clip("match_2")}


def rows(*spans: tuple[int, int, int, str], source: str = "human", alternatives: int = 1) -> CaptionRows:
    """Player, first frame, frame after the last and text of spans, each as often as there are alternatives."""
    each = [(*span[:3], span[3] + " again" * k, k) for span in spans for k in range(alternatives)]
    start, end = np.array([row[1] for row in each], dtype=np.int64), np.array([row[2] for row in each], dtype=np.int64)
    return CaptionRows(
        player=np.array([row[0] for row in each], dtype=np.int64),
        start_frame=start,
        end_frame=end,
        start_s=BEGIN + start / FPS,
        end_s=BEGIN + end / FPS,
        text=np.array([row[3] for row in each], dtype=object),
        source=np.full(len(each), source, dtype=object),
        alternative=np.array([row[4] for row in each], dtype=np.int64),
    )


def same(one: CaptionRows, two: CaptionRows, *, seconds: float = 0.0) -> None:
    for name in CaptionRows.__dataclass_fields__:
        a, b = getattr(one, name), getattr(two, name)
        if name in ("start_s", "end_s"):
            assert a == pytest.approx(b, abs=seconds)
        else:
            assert list(a) == list(b), name


TEXT = st.text(
    st.characters(codec="utf-8", exclude_categories=("Cc", "Cs", "Zl", "Zp")), min_size=1, max_size=60
).filter(lambda text: text.strip() == text and text.split() == text.split(" "))


@pytest.mark.parametrize(("suffix", "seconds"), [(".csv", 0.0), (".json", 0.0), (".vtt", 5e-4)])
@settings(max_examples=15)
@given(texts=st.lists(TEXT, min_size=1, max_size=4), source=st.sampled_from(["human", "generated", "imported"]))
def test_what_is_written_is_read_back(tmp_path_factory, suffix, seconds, texts, source):
    """WebVTT keeps times to the millisecond; nothing else is lost in any of the three."""
    path = tmp_path_factory.mktemp("captions") / f"out{suffix}"
    spans = ((k % 2, 20 * (k // 2) + 3, 20 * (k // 2) + 17, text) for k, text in enumerate(texts))
    made = rows(*spans, source=source, alternatives=2)
    order = np.lexsort((made.alternative, made.start_frame, made.player))
    made = CaptionRows(**{name: getattr(made, name)[order] for name in CaptionRows.__dataclass_fields__})
    write_captions(path, {"match_1": made}, PLAYERS)
    read = read_captions(path, CLIPS)
    assert [finding for finding in read.findings if finding.level == "error"] == []
    same(read.clips["match_1"], made, seconds=seconds)


def test_several_clips_go_into_one_csv_and_json_but_not_into_one_webvtt(tmp_path):
    both = {"match_1": rows((0, 0, 20, "one")), "match_2": rows((1, 5, 40, "two"))}
    for suffix in (".csv", ".json"):
        path = tmp_path / f"all{suffix}"
        write_captions(path, both, PLAYERS)
        read = read_captions(path, CLIPS)
        for name, table in both.items():
            same(read.clips[name], table)
    with pytest.raises(ValueError, match="expected one clip, as WebVTT holds one video, got 2"):
        write_captions(tmp_path / "all.vtt", both, PLAYERS)
    with pytest.raises(ValueError, match="ends in .csv, .json, .vtt"):
        write_captions(tmp_path / "all.txt", both, PLAYERS)


def test_a_first_picture_taken_before_time_0_is_kept_in_webvtt(tmp_path):
    early = clip(capture_time=-0.02 + np.arange(FRAMES) / FPS)
    made = rows((0, 0, 30, "he runs"), (0, 30, 200, "he stands"))
    shift = -0.02 - BEGIN
    made = replace(made, start_s=made.start_s + shift, end_s=made.end_s + shift)
    write_captions(tmp_path / "match_1.vtt", {"match_1": made}, PLAYERS)
    read = read_captions(tmp_path / "match_1.vtt", {"match_1": early}).clips["match_1"]
    assert list(read.start_frame) == [0, 30] and list(read.end_frame) == [30, 200]


def test_a_table_without_rows_is_written_and_read(tmp_path):
    write_captions(tmp_path / "none.csv", {"match_1": rows()}, PLAYERS)
    assert read_captions(tmp_path / "none.csv", CLIPS).clips == {}


@pytest.mark.parametrize(
    "content",
    [
        "clip;player;start;end;caption\nmatch_1;0;4,4;5,2;he runs\n",
        "Video,Speaker,Start Time,End Time,Text\nmatch_1.mp4,near,00:04.400,0:05.2,he runs\n",
        "clip_id,player,start_frame,end_frame,text\nmatch_1,Ann,10,30,he runs\n",
        "clip_id,player,start_video_frame,end_video_frame,text\nfolder/match_1.mp4,player0,110,130,he runs\n",
        "end,start,TEXT,object,sequence\n5.2,4.4,he runs,p0,match_1\n",
    ],
)
def test_loose_tables_mean_the_same(tmp_path, content):
    (tmp_path / "x.csv").write_text(content)
    read = read_captions(tmp_path / "x.csv", CLIPS)
    assert read.errors == ()
    same(read.clips["match_1"], rows((0, 10, 30, "he runs"), source="imported"), seconds=1e-9)


def test_the_source_and_the_player_may_be_given(tmp_path):
    (tmp_path / "match_2.csv").write_text("start,end,text,source\n4.4,5.2,he runs,generated\n")
    read = read_captions(tmp_path / "match_2.csv", CLIPS, ReadOptions(source="human", player="player1"))
    assert (read.clips["match_2"].source[0], read.clips["match_2"].player[0]) == ("human", 1)


def test_texts_of_ten_thousand_words_and_line_breaks_are_taken(tmp_path):
    long = " ".join(["the player runs"] * 3334)
    (tmp_path / "match_1.csv").write_text(f'player,start,end,text\n0,4,6,"{long}"\n0,6,7,"two\nlines"\n')
    read = read_captions(tmp_path / "match_1.csv", CLIPS)
    assert [len(text.split()) for text in read.clips["match_1"].text] == [10002, 2]
    assert [finding.field for finding in read.findings if finding.found == "'two\\nlines'"] == ["text"]


VTT = """\ufeffWEBVTT made by a person

STYLE
::cue { color: red }

NOTE player: Bea

first
00:04.400 --> 00:05.200 position:10%
<v Ann>Runs &amp; <i>hits</i>
the ball</v>

00:00:06.000 --> 00:00:07.000 player:player1
goes back

00:07.000 --> 00:08.000
serves
"""


def test_webvtt_takes_players_from_voices_settings_and_notes(tmp_path):
    (tmp_path / "match_1.vtt").write_text(VTT, encoding="utf-8")
    read = read_captions(tmp_path / "match_1.vtt", CLIPS)
    assert read.errors == ()
    found = read.clips["match_1"]
    assert list(zip(found.player, found.text, strict=True)) == [
        (0, "Runs & hits the ball"), (1, "goes back"), (1, "serves"),
    ]  # fmt: skip
    assert (found.start_frame[0], found.end_frame[0]) == (10, 30)


def test_broken_cues_are_named_by_their_line_and_the_others_go_on(tmp_path):
    (tmp_path / "match_1.vtt").write_text("WEBVTT\n\n4 --> 5\nbad\n\n00:04.000 --> 00:05.000\n<v Ann>good</v>\n")
    read = read_captions(tmp_path / "match_1.vtt", CLIPS)
    assert [(finding.place, finding.field) for finding in read.errors] == [("line 3", "times")]
    assert list(read.clips["match_1"].text) == ["good"]
    (tmp_path / "no.vtt").write_text("1\n00:04.000 --> 00:05.000\nx\n")
    with pytest.raises(ValueError, match="line 1: expected WEBVTT"):
        read_captions(tmp_path / "no.vtt", CLIPS)


def test_json_takes_lists_of_texts_as_alternatives(tmp_path):
    document = [{"Clip": "match_1", "player": 1, "start": 4.4, "end": 5.2, "captions": ["he runs", "he goes"]}, 7]
    (tmp_path / "x.json").write_text(json.dumps(document))
    read = read_captions(tmp_path / "x.json", CLIPS)
    assert list(zip(read.clips["match_1"].alternative, read.clips["match_1"].text, strict=True)) == [
        (0, "he runs"), (1, "he goes"),
    ]  # fmt: skip
    assert [(finding.place, finding.expected) for finding in read.errors] == [("[1]", "an object")]


def label_studio() -> list:
    span = {"ranges": [{"start": 111, "end": 130}]}
    return [
        {
            "data": {
                "video": "/data/upload/7/0a1b2c3d-match_1.mp4",
                "talk": [{"start": 6.0, "end": 7.0, "author": "Bea", "text": "?"}],
            },
            "annotations": [
                {"was_cancelled": True, "result": [{"id": "z", "type": "textarea", "value": span | {"text": ["no"]}}]},
                {
                    "result": [
                        {"id": "a", "type": "timelinelabels", "value": span | {"timelinelabels": ["player0"]}},
                        {"id": "a", "type": "textarea", "value": span | {"text": ["he runs", "he goes"]}},
                        {"id": "b", "type": "labels", "value": {"start": 4.4, "end": 5.2, "labels": ["far"]}},
                        {"id": "b", "type": "textarea", "value": {"start": 4.4, "end": 5.2, "text": "she waits"}},
                        {"id": "c", "type": "paragraphlabels", "value": {"start": "0", "end": "0"}},
                        {"id": "c", "type": "textarea", "value": {"start": "0", "end": "0", "text": ["she serves"]}},
                        {"id": "d", "type": "textarea", "value": {"text": ["about nothing"]}},
                        {"type": "relation"},
                    ]
                },
            ],
        }
    ]  # fmt: skip


def test_label_studio_regions_of_all_three_kinds(tmp_path):
    (tmp_path / "export.json").write_text(json.dumps(label_studio()))
    read = read_captions(tmp_path / "export.json", CLIPS, ReadOptions(source="human"))
    found = read.clips["match_1"]
    assert list(zip(found.player, found.start_frame, found.end_frame, found.alternative, found.text, strict=True)) == [
        (0, 10, 30, 0, "he runs"), (0, 10, 30, 1, "he goes"), (1, 10, 30, 0, "she waits"), (1, 50, 75, 0, "she serves"),
    ]  # fmt: skip
    assert [finding.field for finding in read.errors] == ["start, end"]
    assert set(found.source) == {"human"}


def test_folders_are_read_whole_and_one_bad_file_does_not_stop_the_others(tmp_path):
    (tmp_path / "match_1.csv").write_text("player,start,end,text\n0,4,5,runs\n")
    (tmp_path / "match_2.vtt").write_text("WEBVTT\n\n00:04.000 --> 00:05.000\n<v player1>runs</v>\n")
    (tmp_path / "bad.json").write_text("{")
    read = read_captions(tmp_path, CLIPS)
    assert set(read.clips) == {"match_1", "match_2"}
    assert [finding.file.rpartition("/")[2] for finding in read.errors] == ["bad.json"]
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(ValueError, match="expected files of .csv, .tsv, .json, .vtt, got none"):
        read_captions(empty, CLIPS)
    with pytest.raises(ValueError, match="nothing there"):
        read_captions(tmp_path / "gone.csv", CLIPS)
