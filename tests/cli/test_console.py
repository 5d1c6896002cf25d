"""Progress is a bar on a terminal and lines elsewhere; tables line up."""

import io

import pytest
from pgm_cli.console import Progress, table_text


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_tables_put_numbers_right_words_left_and_a_dash_for_what_is_missing() -> None:
    rows = [("rome.00", 0.41237, 12345), ("x", float("nan"), None)]
    assert table_text(("clip", "rms px", "frames"), rows).split("\n") == [
        "clip     rms px  frames",
        "-------  ------  ------",
        "rome.00   0.412  12345",
        "x             -  -",
    ]


def test_a_table_without_rows_is_its_header() -> None:
    assert table_text(("clip", "px"), []) == "clip  px\n----  --"


def test_a_row_of_another_length_raises() -> None:
    with pytest.raises(ValueError, match="expected 2 cells, got 1"):
        table_text(("a", "b"), [("x",)])


def test_elsewhere_than_on_a_terminal_progress_is_whole_lines_and_no_control_characters() -> None:
    stream = io.StringIO()
    progress = Progress(total=2, stream=stream, interval_s=0.0)
    progress.update("a.mp4", 0.5)
    progress.finish("a.mp4", "a.mp4: ok")
    progress.finish("b.mp4")
    progress.close()
    assert stream.getvalue().split("\n") == [
        " 25%  0 of 2 videos, at a.mp4",
        "a.mp4: ok",
        " 50%  1 of 2 videos, at a.mp4",
        "100%  2 of 2 videos, at b.mp4",
        "",
    ]


def test_plain_lines_come_no_more_often_than_their_interval_but_the_last_always() -> None:
    stream = io.StringIO()
    progress = Progress(total=2, stream=stream, interval_s=1e6)
    for share in (0.1, 0.2, 0.3):
        progress.update("a", share)
    progress.finish("a")
    progress.finish("b")
    assert [line[:4] for line in stream.getvalue().splitlines()] == ["  5%", "100%"]


def test_on_a_terminal_a_message_stays_and_the_bar_goes() -> None:
    stream = Terminal()
    progress = Progress(total=1, stream=stream)
    progress.update("a", 0.5)
    progress.say("a: degraded")
    progress.finish("a")
    progress.close()
    clear = "\r\x1b[K"
    lines = stream.getvalue().split(clear)
    assert "a: degraded\n" in lines
    assert lines[-1] == ""
    assert "#" in lines[1]


def test_a_share_that_the_stage_does_not_know_counts_as_nothing() -> None:
    stream = io.StringIO()
    Progress(total=1, stream=stream, interval_s=0.0).update("a", float("nan"))
    assert stream.getvalue().startswith("  0%  0 of 1 video, at a")


def test_quiet_says_nothing() -> None:
    stream = Terminal()
    progress = Progress(total=1, stream=stream, quiet=True)
    progress.update("a", 0.5)
    progress.finish("a", "a: ok")
    progress.close()
    assert stream.getvalue() == ""
