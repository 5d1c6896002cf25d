"""Captions as files state them, matched with the clips that they are about, and checked.

A row with an error is left out and said; all others go on.
"""

import re
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePath

import numpy as np

from pgm_data.convert.captions_rows import CaptionClip, CaptionFile, CaptionFinding, CaptionRow, shown
from pgm_data.convert.captions_terms import misspelt
from pgm_data.dataset.clip_captions import SOURCES, CaptionRows

ROUNDED_S = 0.001
"""Times are rounded to this."""
SLACK_FRAMES = 1
"""By so much a span may overlap the one before, or reach beyond its clip: it is cut there, and said."""
GAP_S = 1.0
"""Longer times without a main caption between two are said."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ImportedCaptions:
    """Captions by clip, and what is to be said about them."""

    clips: dict[str, CaptionRows]
    """Of each clip that a row is about; rows by player, start and alternative."""
    findings: tuple[CaptionFinding, ...]

    @property
    def errors(self) -> tuple[CaptionFinding, ...]:
        """Rows that were left out."""
        return tuple(finding for finding in self.findings if finding.level == "error")


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """What files do not say."""

    source: str = ""
    """Of all texts; empty for what the file says of each, else imported."""
    player: str = ""
    """Of rows that name none."""
    clip: str = ""
    """The same for clips."""


@dataclass(frozen=True, kw_only=True)
class _Placed:
    """One text at its place in a clip."""

    file: str
    place: str
    clip_id: str
    player: int
    start: int
    end: int
    start_s: float
    end_s: float
    text: str
    source: str
    alternative: int

    @property
    def span(self) -> tuple[str, int, int, int]:
        return self.clip_id, self.player, self.start, self.end


def matched(files: Sequence[CaptionFile], clips: Mapping[str, CaptionClip], options: ReadOptions) -> ImportedCaptions:
    """The rows of files as captions of the clips.

    Args:
        files: What was read.
        clips: The clips by their names.
        options: What the files do not say.
    """
    findings: list[CaptionFinding] = []
    placed: list[_Placed] = []
    for file in files:
        findings += file.findings
        for row in file.rows:
            found = _placed(file, row, clips, options, findings)
            if found is not None:
                placed.append(found)
    placed = _numbered(placed, findings)
    placed = _apart(placed, clips, findings)
    placed = _with_main(placed, findings)
    findings += _gaps(placed, clips)
    by_clip: dict[str, list[_Placed]] = {}
    for row in sorted(placed, key=lambda row: (row.clip_id, row.player, row.start, row.alternative)):
        by_clip.setdefault(row.clip_id, []).append(row)
    return ImportedCaptions(clips={name: _table(rows) for name, rows in by_clip.items()}, findings=tuple(findings))


def _table(rows: list[_Placed]) -> CaptionRows:
    return CaptionRows(
        player=np.array([row.player for row in rows], dtype=np.int64),
        start_frame=np.array([row.start for row in rows], dtype=np.int64),
        end_frame=np.array([row.end for row in rows], dtype=np.int64),
        start_s=np.array([row.start_s for row in rows], dtype=np.float64),
        end_s=np.array([row.end_s for row in rows], dtype=np.float64),
        text=np.array([row.text for row in rows], dtype=object),
        source=np.array([row.source for row in rows], dtype=object),
        alternative=np.array([row.alternative for row in rows], dtype=np.int64),
    )


def _placed(
    file: CaptionFile,
    row: CaptionRow,
    clips: Mapping[str, CaptionClip],
    options: ReadOptions,
    findings: list[CaptionFinding],
) -> _Placed | None:
    """The row in its clip; None where it has an error, which is noted."""
    path = str(file.path)

    def refuse(name: str, expected: str, found: object) -> None:
        findings.append(CaptionFinding(file=path, place=row.place, field=name, expected=expected, found=shown(found)))

    def warn(name: str, expected: str, found: object) -> None:
        findings.append(
            CaptionFinding(
                file=path, place=row.place, field=name, expected=expected, found=shown(found), level="warning"
            )
        )

    clip = _clip_of(row, file, clips, options)
    if isinstance(clip, str):
        refuse("clip", clip, row.clip or "none")
        return None
    player = player_of(row.player or options.player, clip)
    if player is None:
        known = ", ".join(clip.players) + "".join(f", {name}" for name in clip.identities if name)
        refuse("player", f"one of {known}", row.player or "none")
        return None
    source = options.source or row.source or "imported"
    if source not in SOURCES:
        refuse("source", f"one of {', '.join(SOURCES)}", source)
        return None
    hidden = sorted({f"U+{ord(c):04X}" for c in row.text if unicodedata.category(c) == "Cc" and c not in "\t\n\r"})
    if hidden:
        refuse("text", "no control characters", ", ".join(hidden))
        return None
    text = row.text
    if re.search(r"[\t\n\r]", text):
        text = re.sub(r"\s*[\t\n\r]\s*", " ", text)
        warn("text", "one line (line breaks were made blanks)", row.text)
    if not text.strip():
        refuse("text", "words", row.text)
        return None
    span = _frames_of(row, clip)
    if isinstance(span, str):
        refuse("start, end", span, f"{row.start:g} to {row.end:g} {row.unit}")
        return None
    for word, term in misspelt(text).items():
        warn("text", f"{term}, as it seems", word)
    return _Placed(
        file=path, place=row.place, clip_id=clip.clip_id, player=player, start=span[0], end=span[1], start_s=span[2],
        end_s=span[3], text=text.strip(), source=source, alternative=row.alternative,
    )  # fmt: skip


def _clip_of(
    row: CaptionRow, file: CaptionFile, clips: Mapping[str, CaptionClip], options: ReadOptions
) -> CaptionClip | str:
    """The clip that a row is about, or what was expected: by its name, its video's, or the file's own name."""
    names = [row.clip] if row.clip else [options.clip] if options.clip else [file.path.stem, file.path.name]
    known = ", ".join(sorted(clips)[:8]) + (" and others" if len(clips) > 8 else "")
    for name in names:
        if name in clips:
            return clips[name]
        plain = {name, PurePath(name.replace("\\", "/")).name}
        plain |= {PurePath(word).stem for word in plain}
        of_video = [clip for clip in clips.values() if {clip.video, PurePath(clip.video).stem} & plain]
        of_video += [clips[word] for word in sorted(plain) if word in clips and clips[word] not in of_video]
        if len(of_video) == 1:
            return of_video[0]
        if of_video:
            return _clip_at(row, of_video)
    if not row.clip and not options.clip and len(clips) == 1:
        return next(iter(clips.values()))
    return f"a clip or its video ({known})"


def _clip_at(row: CaptionRow, clips: list[CaptionClip]) -> CaptionClip | str:
    """Of several clips of a video, the one that is shown at the row's start."""
    names = ", ".join(clip.clip_id for clip in clips[:8])
    if row.unit == "frames":
        return f"a clip of the video ({names}), as frames count from a clip's first"
    for clip in clips:
        first, last = (
            (clip.capture_time[0] - ROUNDED_S, clip.end_s)
            if row.unit == "seconds"
            else (clip.first_video_frame, clip.first_video_frame + len(clip.capture_time))
        )
        if first <= row.start < last:
            return clip
    return f"a time within a clip of the video ({names})"


def player_of(name: str, clip: CaptionClip) -> int | None:
    """Index of the player that a name or number means; of a scene of one player, without a name, that one."""
    plain = re.sub(r"[\s_-]", "", name.lower())
    if not plain:
        return 0 if len(clip.players) == 1 else None
    objects = [re.sub(r"[\s_-]", "", word.lower()) for word in clip.players]
    if plain in objects:
        return objects.index(plain)
    people = [word.lower() for word in clip.identities]
    if name.lower() in people and people.count(name.lower()) == 1:
        return people.index(name.lower())
    if re.fullmatch(r"p?\d{1,3}", plain):
        number = int(plain.removeprefix("p"))
        return number if number < len(objects) else None
    ends = ("near", "far")
    word = plain.removesuffix("player").removesuffix("end")
    return ends.index(word) if word in ends and len(objects) == 2 else None


def _frames_of(row: CaptionRow, clip: CaptionClip) -> tuple[int, int, float, float] | str:
    """First frame, frame after the last, and both as capture times; or what was expected."""
    times, count = clip.capture_time, len(clip.capture_time)
    if not row.end > row.start:
        return "an end after the start"
    if row.unit == "seconds":
        low, high = float(times[0]), clip.end_s
        step = (high - low) / max(count, 1)
        if row.start < low - SLACK_FRAMES * step - ROUNDED_S or row.end > high + SLACK_FRAMES * step + ROUNDED_S:
            return f"a span within the clip, {low:.3f} to {high:.3f} s"
        start_s, end_s = max(row.start, low), min(row.end, high)
        start, end = (int(k) for k in np.searchsorted(times, [start_s - ROUNDED_S, end_s - ROUNDED_S]))
        start = 0 if start_s <= max(low, 0.0) + ROUNDED_S else start
        end = count if row.end >= high - ROUNDED_S else end
        return (start, end, start_s, end_s) if end > start else "a span with a frame in it"
    shift = clip.first_video_frame if row.unit == "video frames" else 0
    start, end = int(row.start) - shift, int(row.end) - shift
    if start < 0 or end > count:
        return f"frames within the clip, {shift} to {count + shift}"
    return start, end, float(times[start]), float(times[end]) if end < count else clip.end_s


def _numbered(rows: list[_Placed], findings: list[CaptionFinding]) -> list[_Placed]:
    """Alternatives without a number numbered in their order; the same number twice is an error."""
    taken: dict[tuple, set[int]] = {}
    for row in rows:
        if row.alternative >= 0:
            numbers = taken.setdefault(row.span, set())
            if row.alternative not in numbers:
                numbers.add(row.alternative)
    seen: set[tuple] = set()
    result = []
    for row in rows:
        if row.alternative < 0:
            numbers = taken.setdefault(row.span, set())
            number = next(k for k in range(len(numbers) + 1) if k not in numbers)
            numbers.add(number)
            row = replace(row, alternative=number)
        key = (*row.span, row.alternative)
        if key in seen:
            expected = "each alternative of a player's span once"
            findings.append(_about(row, "alternative", expected, f"{row.alternative} again"))
            continue
        seen.add(key)
        result.append(row)
    return result


def _apart(rows: list[_Placed], clips: Mapping[str, CaptionClip], findings: list[CaptionFinding]) -> list[_Placed]:
    """Rows without those whose main text overlaps an earlier one; by one frame, the later span begins later."""
    mains = sorted((row for row in rows if row.alternative == 0), key=_order)
    later: dict[tuple, int] = {}
    gone: set[tuple] = set()
    before: _Placed | None = None
    for row in mains:
        same = before is not None and (before.clip_id, before.player) == (row.clip_id, row.player)
        if not same or before is None or row.start >= before.end:
            before = row
            continue
        over = min(before.end, row.end) - row.start
        if over <= SLACK_FRAMES and row.end > before.end and row.end - before.end >= 1:
            later[row.span] = before.end
            findings.append(
                _about(
                    row,
                    "start",
                    f"frame {before.end}, where {before.place} ends (it is cut there)",
                    f"frame {row.start}",
                    warning=True,
                )  # fmt: skip
            )
            before = row
            continue
        gone.add(row.span)
        name = clips[row.clip_id].players[row.player]
        expected = f"no overlap with {before.place}, frames {before.start} to {before.end} of {name}"
        findings.append(_about(row, "start, end", expected, f"frames {row.start} to {row.end}"))
    kept = []
    for row in rows:
        if row.span in gone:
            continue
        if row.span in later:
            start = later[row.span]
            row = replace(row, start=start, start_s=float(clips[row.clip_id].capture_time[start]))
        kept.append(row)
    return kept


def _order(row: _Placed) -> tuple[str, int, int, int]:
    return row.clip_id, row.player, row.start, row.end


def _with_main(rows: list[_Placed], findings: list[CaptionFinding]) -> list[_Placed]:
    """Rows without alternatives whose main text is not there."""
    mains = {row.span for row in rows if row.alternative == 0}
    for row in rows:
        if row.span not in mains:
            expected = "a main text (alternative 0) of the same player and span"
            findings.append(_about(row, "alternative", expected, str(row.alternative)))
    return [row for row in rows if row.span in mains]


def _gaps(rows: list[_Placed], clips: Mapping[str, CaptionClip]) -> list[CaptionFinding]:
    """One warning for each player of a clip about the time between its captions."""
    spans: dict[tuple[str, int], list[_Placed]] = {}
    for row in rows:
        if row.alternative == 0:
            spans.setdefault((row.clip_id, row.player), []).append(row)
    findings = []
    for (clip_id, player), own in spans.items():
        own.sort(key=lambda row: row.start)
        clip = clips[clip_id]
        ends = [float(clip.capture_time[0]), *(row.end_s for row in own)]
        starts = [*(row.start_s for row in own), clip.end_s]
        gaps = [(b - a, a) for a, b in zip(ends, starts, strict=True) if b - a > GAP_S]
        if gaps:
            longest, at = max(gaps)
            expected = f"captions of {clip.players[player]} without gaps above {GAP_S:g} s"
            got = f"{len(gaps)}, the longest {longest:.1f} s from {at:.2f} s"
            findings.append(
                CaptionFinding(file=own[0].file, place=clip_id, field="", expected=expected, found=got, level="warning")
            )
    return findings


def _about(row: _Placed, name: str, expected: str, found: str, *, warning: bool = False) -> CaptionFinding:
    level = "warning" if warning else "error"
    return CaptionFinding(file=row.file, place=row.place, field=name, expected=expected, found=found, level=level)
