"""Which videos a command is given, and the names their clips get."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pgm_data.inputs import MAX_NAME_BYTES, clean_name, clip_stems, find_inputs


def touch(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"")
    return path


def test_folders_are_searched_to_the_bottom_in_order(tmp_path: Path) -> None:
    wanted = [touch(tmp_path / name) for name in ("a/z.MP4", "a/zz/deep.mkv", "b.mov", "c.JPG")]
    touch(tmp_path / ".hidden/x.mp4")
    touch(tmp_path / ".x.mp4")
    note = touch(tmp_path / "a/notes.txt")
    bare = touch(tmp_path / "README")
    found = find_inputs([tmp_path])
    assert list(found.videos) == wanted
    assert [path for path, _ in found.ignored] == [bare, note]
    assert all(reason for _, reason in found.ignored)


def test_an_empty_folder_holds_nothing(tmp_path: Path) -> None:
    found = find_inputs([tmp_path])
    assert found.videos == () and found.ignored == ()


def test_links_in_a_circle_end_and_nothing_counts_twice(tmp_path: Path) -> None:
    video = touch(tmp_path / "a/v.mp4")
    (tmp_path / "a/round").symlink_to(tmp_path, target_is_directory=True)
    (tmp_path / "w.mp4").symlink_to(video)
    (tmp_path / "gone.mp4").symlink_to(tmp_path / "nowhere.mp4")
    found = find_inputs([tmp_path, tmp_path / "a", video])
    assert list(found.videos) == [video]
    assert found.ignored == ((tmp_path / "gone.mp4", "link that leads nowhere"),)


def test_a_file_named_by_itself_is_never_ignored(tmp_path: Path) -> None:
    named = touch(tmp_path / "notes.txt")
    assert find_inputs([named]).videos == (named,)


def test_a_missing_path_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"gone: expected .* found nothing"):
        find_inputs([tmp_path / "gone"])


def test_two_videos_of_one_stem_are_refused_unless_a_prefix_parts_them() -> None:
    videos = [Path("m/one/rally.mp4"), Path("m/two/Rally.mkv")]
    with pytest.raises(ValueError, match=r"m/one/rally.mp4 and m/two/Rally.mkv.*--clip-prefix"):
        clip_stems(videos)
    with pytest.raises(ValueError, match="clip_id"):
        clip_stems(videos, "day1")
    assert clip_stems(videos, "{parent}") == ("one-rally", "two-Rally")


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("../../etc/passwd", "____etc_passwd"),
        ("..", "_"),
        (".", "clip"),
        ("", "clip"),
        ("--help", "help"),
        ("a b\tc", "a_b_c"),
        ("Финал 2024", "Финал_2024"),
        ("हिन्दी", "हिन्दी"),
        ("e\u0301", "\u00e9"),
        ("nul\x00byte", "nul_byte"),
        ("v1.2", "v1.2"),
        ("C:\\x", "C_x"),
    ],
)
def test_names_are_cleaned(text: str, name: str) -> None:
    assert clean_name(text) == name


@given(st.text(max_size=300))
def test_a_clean_name_is_one_safe_path_part_and_stays_as_it_is(text: str) -> None:
    name = clean_name(text)
    assert 0 < len(name.encode()) <= MAX_NAME_BYTES
    assert Path(name).parts == (name,) and name not in (".", "..")
    assert name[0] not in ".-" and not name.endswith(".")
    assert not any(character in name for character in '/\\:\x00\n *?"<>|')
    assert clean_name(name) == name
