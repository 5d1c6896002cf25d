"""Captions read from and written to files of other programs, by what the files are."""

from collections.abc import Mapping
from pathlib import Path

from pgm_data.convert.captions_csv import captions_csv, read_captions_csv
from pgm_data.convert.captions_json import captions_json, read_captions_json
from pgm_data.convert.captions_label_studio import is_label_studio, read_captions_label_studio
from pgm_data.convert.captions_match import ImportedCaptions, ReadOptions, matched
from pgm_data.convert.captions_rows import CaptionClip, CaptionFile, CaptionFinding
from pgm_data.convert.captions_vtt import captions_vtt, read_captions_vtt
from pgm_data.dataset.clip_captions import CaptionRows
from pgm_data.dataset.documents import parse_document
from pgm_data.dataset.files import whole_file

READ_SUFFIXES = (".csv", ".tsv", ".json", ".vtt")
WRITTEN_SUFFIXES = (".csv", ".json", ".vtt")


def read_captions(path: Path, clips: Mapping[str, CaptionClip], options: ReadOptions | None = None) -> ImportedCaptions:
    """The captions of a CSV, JSON, WebVTT or Label Studio file, or of all such files of a folder.

    A file that cannot be read at all is a finding, as a row is; the others go on.

    Args:
        path: The file or the folder.
        clips: The clips that captions may be about, by their names.
        options: What the files do not say.

    Raises:
        ValueError: If a folder holds no such file, or a single file cannot be read.
    """
    if not path.is_dir():
        return matched([_read(path)], clips, options or ReadOptions())
    paths = sorted(p for p in path.iterdir() if p.suffix.lower() in READ_SUFFIXES and p.is_file())
    if not paths:
        raise ValueError(f"{path}: expected files of {', '.join(READ_SUFFIXES)}, got none")
    files = []
    for one in paths:
        try:
            files.append(_read(one))
        except ValueError as error:
            lost = CaptionFile(path=one)
            said = str(error).removeprefix(f"{one}: ")
            lost.findings.append(
                CaptionFinding(file=str(one), place="", field="", expected="a file of captions", found=said)
            )
            files.append(lost)
    return matched(files, clips, options or ReadOptions())


def _read(path: Path) -> CaptionFile:
    suffix = path.suffix.lower()
    if not path.is_file():
        got = "no regular file" if path.exists() else "nothing there"
        raise ValueError(f"{path}: expected a file or a folder, got {got}")
    if suffix in (".csv", ".tsv"):
        return read_captions_csv(path)
    if suffix == ".vtt":
        return read_captions_vtt(path)
    if suffix == ".json":
        document = parse_document(path)
        reader = read_captions_label_studio if is_label_studio(document) else read_captions_json
        return reader(path, document)
    raise ValueError(f"{path}: expected a file that ends in {', '.join(READ_SUFFIXES)}, got {path.name}")


def write_captions(path: Path, captions: Mapping[str, CaptionRows], players: tuple[str, ...]) -> None:
    """Write the captions of clips as CSV, JSON or (of one clip) WebVTT, by the file's ending, whole or not at all.

    Args:
        path: The file.
        captions: Captions by clip.
        players: Player objects of the scene.

    Raises:
        ValueError: If the ending is none of these, or a WebVTT would hold several clips.
    """
    suffix = path.suffix.lower()
    if suffix == ".csv":
        text = captions_csv(captions, players)
    elif suffix == ".json":
        text = captions_json(captions, players)
    elif suffix == ".vtt":
        if len(captions) != 1:
            raise ValueError(f"{path}: expected one clip, as WebVTT holds one video, got {len(captions)}")
        ((clip_id, rows),) = captions.items()
        text = captions_vtt(clip_id, rows, players)
    else:
        raise ValueError(f"{path}: expected a file that ends in {', '.join(WRITTEN_SUFFIXES)}, got {path.name}")
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="")
