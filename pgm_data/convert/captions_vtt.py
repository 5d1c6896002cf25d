"""Captions as WebVTT: one cue a text, the player as its voice; times are the video's, to milliseconds.

A cue's player is its voice (`<v player0>`), else `player:player0` among its settings, else the last comment
`NOTE player: player0` before it. `NOTE clip: NAME` names the clip. Classes of the voice say more:
`<v.alternative1.human player0>`. Positions, styles and other tags are passed over.
"""

import html
import re
from pathlib import Path

from pgm_data.convert.captions_rows import CaptionFile
from pgm_data.dataset.clip_captions import SOURCES, CaptionRows

LARGEST_FILE = 64 * 2**20
TIMES = re.compile(r"^\s*((?:\d+:)?\d\d:\d\d\.\d{3})\s+-->\s+((?:\d+:)?\d\d:\d\d\.\d{3})(.*)$")
VOICE = re.compile(r"<v((?:\.[^\s.>]+)*)[ \t]+([^>]+)>")
TAG = re.compile(r"<[^>]*>")
NOTE = re.compile(r"^NOTE\s+(player|clip)\s*[:=]\s*(.+)$", re.IGNORECASE)
ALTERNATIVE = re.compile(r"alternative(\d{1,6})$")


def read_captions_vtt(path: Path) -> CaptionFile:
    """The cues of a file.

    Raises:
        ValueError: If it is no WebVTT in UTF-8.
    """
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise OSError(f"{path.stat().st_size} bytes, more than {LARGEST_FILE}")
        lines = re.split(r"\r\n|\n|\r", path.read_text(encoding="utf-8-sig"))
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: expected a WebVTT file in UTF-8, got: {error}") from error
    if not re.match(r"WEBVTT(\s|$)", lines[0]):
        raise ValueError(f"{path}: line 1: expected WEBVTT, got {lines[0][:60]!r}")
    found = CaptionFile(path=path)
    said = {"player": "", "clip": ""}
    at = 1
    while at < len(lines):
        block = []
        first = at
        while at < len(lines) and lines[at].strip():
            block.append(lines[at])
            at += 1
        at += 1
        if not block:
            continue
        note = NOTE.match(block[0].strip())
        if note:
            said[note[1].lower()] = note[2].strip()
        elif not re.match(r"(NOTE|STYLE|REGION)(\s|$)", block[0]):
            _cue(found, block, first, said)
    return found


def _cue(found: CaptionFile, block: list[str], first: int, said: dict[str, str]) -> None:
    """Take in one block of lines, the first of which is the file's line `first` (from 0)."""
    timed = next((k for k, line in enumerate(block[:2]) if "-->" in line), None)
    place = f"line {first + (timed or 0) + 1}"
    match = TIMES.match(block[timed]) if timed is not None else None
    if timed is None or match is None:
        found.refuse(place, "times", "a line such as 00:01.000 --> 00:02.500", block[timed or 0])
        return
    settings = dict(part.split(":", 1) for part in match[3].split() if ":" in part)
    text = " ".join(line.strip() for line in block[timed + 1 :])
    voice = VOICE.search(text)
    classes = voice[1].split(".") if voice else []
    player = html.unescape(voice[2]).strip() if voice else settings.get("player", said["player"])
    numbers = [number[1] for name in classes if (number := ALTERNATIVE.match(name))]
    found.add(
        place,
        {
            "clip": said["clip"],
            "player": player,
            "start_s": match[1],
            "end_s": match[2],
            "text": html.unescape(TAG.sub("", text)).strip(),
            "source": next((name for name in classes if name in SOURCES), ""),
            "alternative": numbers[0] if numbers else "",
        },
    )


def captions_vtt(clip_id: str, rows: CaptionRows, players: tuple[str, ...]) -> str:
    """The text of a file of one clip's captions. Lost: times beyond the millisecond and before 0, runs of blanks."""
    parts = [f"WEBVTT\n\nNOTE clip: {clip_id}\n"]
    for k in range(len(rows)):
        times = f"{_clock(float(rows.start_s[k]))} --> {_clock(float(rows.end_s[k]))}"
        text = html.escape(" ".join(str(rows.text[k]).split()), quote=False)
        classes = f".alternative{int(rows.alternative[k])}.{rows.source[k]}"
        parts.append(f"{k + 1}\n{times}\n<v{classes} {html.escape(players[int(rows.player[k])])}>{text}</v>\n")
    return "\n".join(parts)


def _clock(seconds: float) -> str:
    """HH:MM:SS.mmm; the first picture may have been taken before the video's time 0, which WebVTT begins with."""
    total = max(round(seconds * 1000), 0)
    return f"{total // 3600000:02d}:{total // 60000 % 60:02d}:{total // 1000 % 60:02d}.{total % 1000:03d}"
