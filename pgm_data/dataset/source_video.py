"""Where the video of a clip lies: the one way in which everything that needs it looks for it."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

PLACES_NAMED = 3
"""Places that an error names, of those that were looked at."""


class VideoNotFound(ValueError):
    """A clip's video that is not where it could be: which field of the clip, what was expected, what was found."""

    def __init__(self, field: str, expected: str, found: str) -> None:
        """Compose the one line that a person reads."""
        super().__init__(f"{field}: expected {expected}, got {found}")
        self.field, self.expected, self.found = field, expected, found


def find_source_video(work: Path, document: Mapping[str, Any], videos: Path | None) -> Path:
    """The video of a clip: below `videos` where given, else as its path says beside or below the work folder.

    Last it is looked for where the run that made the work folder read it. Whether it is the file that the clip was
    made from is for the caller to compare.

    Args:
        work: The work folder.
        document: The clip's `clip.json`.
        videos: Folder of the videos, where they are no longer where they were.

    Raises:
        VideoNotFound: If it is at none of these places.
    """
    source = Path(document["source_path"])
    below = Path(*(part for part in source.parts if part != ".."))
    places = [videos / below, videos / source.name] if videos is not None else [work / source, work.parent / below]
    if videos is None:
        places += [folder / part for folder in _read_folders(work) for part in (below, Path(source.name))]
    path = next((place for place in places if place.is_file()), None)
    if path is None:
        looked = " or ".join(dict.fromkeys(str(place) for place in places[:PLACES_NAMED]))
        raise VideoNotFound("source_path", f"its video at {looked}", "nothing there")
    return path


def _read_folders(work: Path) -> list[Path]:
    """Folders of the videos that the work folder's run was given; none where it does not say."""
    try:
        given = json.loads((work / "run.json").read_text(encoding="utf-8"))["options"]["videos"]
        paths = [Path(name) for name in given]
    except (OSError, ValueError, LookupError, TypeError):
        return []
    return list(dict.fromkeys(path if path.is_dir() else path.parent for path in paths))
