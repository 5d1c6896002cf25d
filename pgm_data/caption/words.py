"""Facts as sentences: a main text of each span and others that say the same in other words.

What is said is decided first (`Content`), then worded. The same facts of the same clip always get the same words.
"""

import random
import zlib
from dataclasses import dataclass

import numpy as np

from pgm_data.caption.facts import HitFacts, PlayFacts
from pgm_data.caption.grammar import GRAMMAR
from pgm_data.caption.phrases import sentence
from pgm_data.dataset.clip_captions import CaptionRows

TEXTS = 3
"""A main text and two others."""
MOST_WORDS = 32
PREPARES_S = 1.2
"""A hit within this time after a span is one that the player prepares."""
OMITTED = {"goal": 0.6, "quality": 0.5, "hands": 0.6, "after_motion": 0.45}
"""Chance of each slot that a sentence can do without to be left out of a text."""
_TRIES = 40
PLACE_SYMBOL = {
    "far back": "far", "behind": "behind", "baseline": "baseline", "land": "land", "service line": "line", "box": "box",
    "net": "net", "back": "back",
}  # fmt: skip
GAIT_SYMBOL = {"": "{move}", "move": "{move}"}
WAY_SYMBOL = {"forward": "{way_forward}", "back": "{way_back}"}


@dataclass(frozen=True, eq=False, kw_only=True)
class Content:
    """What is said of a span, before it is worded."""

    frames: tuple[str, ...]
    """Symbols of sentences, one of which a text is drawn from."""
    slots: dict[str, str]


def words_of_facts(facts: PlayFacts) -> CaptionRows:
    """The captions of a clip's spans, in order of player and time; spans of which nothing is known get none."""
    spans = facts.spans
    rows: list[tuple[int, int, str]] = []
    for row in range(len(spans)):
        content = content_of(facts, row)
        if content is None:
            continue
        told = (facts.clip_id, int(spans.player[row]), int(spans.start_frame[row]), content.frames)
        seed = zlib.crc32(repr((told, sorted(content.slots.items()))).encode())
        texts = texts_of(content, random.Random(seed))
        rows += [(row, number, text) for number, text in enumerate(texts)]
    index = np.array([row for row, _, _ in rows], dtype=np.int64)
    return CaptionRows(
        player=spans.player[index],
        start_frame=spans.start_frame[index],
        end_frame=spans.end_frame[index],
        start_s=spans.start_s[index],
        end_s=spans.end_s[index],
        text=np.array([text for _, _, text in rows], dtype=object),
        source=np.full(len(rows), "generated", dtype=object),
        alternative=np.array([number for _, number, _ in rows], dtype=np.int64),
    )


def texts_of(content: Content, draw: random.Random) -> tuple[str, ...]:
    """Up to three different sentences that say the content."""
    texts: list[str] = []
    for tries in range(_TRIES):
        # People leave things out; where a sentence gets too long, so does this.
        left_out = [name for name, share in OMITTED.items() if tries >= _TRIES // 2 or draw.random() < share]
        slots = content.slots | dict.fromkeys(left_out, "")
        text = sentence(content.frames[draw.randrange(len(content.frames))], slots, GRAMMAR, draw)
        if text not in texts and (len(text.split()) <= MOST_WORDS or (tries == _TRIES - 1 and not texts)):
            texts.append(text)
        if len(texts) == TEXTS:
            break
    return tuple(texts)


def content_of(facts: PlayFacts, row: int) -> Content | None:
    """What is said of the span; None where nothing can be."""
    spans, hits = facts.spans, facts.hits
    slots = {"goal": "", "after_motion": "", "quality": "", "hands": ""}
    if not facts.has_net:
        return _walk(facts, row, slots)
    moved = _movement(facts, row, slots)
    hit, other, ended = int(spans.hit[row]), int(spans.other_hit[row]), int(spans.ended[row])
    if hit >= 0:
        return _hitting(facts, row, slots, moved)
    if ended >= 0:
        return _ending(hits, int(spans.player[row]), ended, slots, moved, str(spans.motion[row]))
    if other >= 0:
        return _watching(facts, row, other, slots, moved)
    return _waiting(facts, row, slots, moved)


def _spot(facts: PlayFacts, row: int) -> str:
    spans = facts.spans
    place, side = str(spans.place[row]), str(spans.place_side[row])
    if not place:
        return ""
    suffix = "_middle" if side == "middle" else "_side" if side else ""
    return f"{PLACE_SYMBOL[place]}{suffix}"


def _movement(facts: PlayFacts, row: int, slots: dict[str, str]) -> bool:
    """Put the movement into slot `m`; whether there is one to tell."""
    spans = facts.spans
    motion, spot = str(spans.motion[row]), _spot(facts, row)
    slots["at"] = str(spans.place_side[row])
    if spot:
        slots["spot"] = f"{{spot_{spot}}}"
    if motion in ("still", "shifts"):
        slots["m"] = f"{{{motion}_at}}" if spot else f"{{{motion}}}"
        if spans.split_step[row]:
            slots["m"] = "{split} {spot}" if spot else "{split}"
        return True
    if motion == "":
        slots["m"] = "{split}" if spans.split_step[row] else "{unclear_at}" if spot else "{unclear}"
        return bool(spans.split_step[row])
    gait = str(spans.gait[row])
    slots["gait"] = GAIT_SYMBOL.get(gait, f"{{{gait}}}")
    slots |= _way(str(spans.way[row]), "way", "side")
    if motion == "turns":
        second = str(spans.second_way[row])
        kind = next((word for word in ("left", "right") if word in second), "")
        slots |= {"side2": kind, "again": "{again_side}" if kind else f"{{again_{second}}}", "m": "{turns}"}
        return True
    if spans.starts[row]:
        slots["m"] = "{starts}"
        return True
    if spans.centring[row] and gait in ("move", "jog", "sidestep", "walk", "run", ""):
        slots["m"] = "{centre}"
    else:
        slots["m"] = "{moves}"
    if spot and str(spans.place_before[row]) != str(spans.place[row]) and gait != "step":
        slots["goal"] = f"{{goal_{spot}}}"
    if spans.split_step[row]:
        slots["after_motion"] = "{then_split}"
        slots["m"] += " {after_motion}" if slots["m"] == "{centre}" else ""
    elif spans.stops[row]:
        slots["after_motion"] = "{stops}"
        slots["m"] += " {after_motion}" if slots["m"] == "{centre}" else ""
    return True


def _way(way: str, slot: str, side: str) -> dict[str, str]:
    if way in WAY_SYMBOL:
        return {slot: WAY_SYMBOL[way]}
    words = way.split()
    return {slot: "{way_" + "_".join(["side", *words[1:]]) + "}", side: words[0]}


def _hitting(facts: PlayFacts, row: int, slots: dict[str, str], moved: bool) -> Content:
    spans = facts.spans
    hit = int(spans.hit[row])
    slots |= hit_slots(facts.hits, hit)
    motion = str(spans.motion[row])
    before = float(facts.hits.time[hit] - spans.start_s[row])
    slots["after_motion"] = ""
    if spans.split_step[row] and motion in ("moves", "turns"):
        # The step is made as the other hits the ball, and the way to it comes afterwards.
        slots |= {"inner": slots["m"], "m": "{split_before}"}
    if facts.hits.stroke[hit] == "serve":
        if before > 1.3:
            slots["m"] = "{prepare_serve}"
            return Content(frames=("say_mh",), slots=slots)
        frames = ("say_h", "say_spot_h") if "spot" in slots else ("say_h",)
        return Content(frames=frames, slots=slots)
    tells = moved and before > 0.35 and (motion in ("moves", "turns") or bool(spans.split_step[row]))
    if tells:
        return Content(frames=("say_mh", "say_mh", "say_mh", "say_h"), slots=slots)
    return Content(frames=("say_h", "say_spot_h") if "spot" in slots else ("say_h",), slots=slots)


def hit_slots(hits: HitFacts, hit: int) -> dict[str, str]:
    """Slots that tell a hit, its clause in `h`."""
    stroke, side = str(hits.stroke[hit]), str(hits.side[hit])
    slots = {"fb": side if side in ("forehand", "backhand") else "", "np": _stroke(hits, hit)}
    spin, pace = str(hits.spin[hit]), str(hits.pace[hit])
    word = pace if pace else spin if spin in ("topspin", "flat") else ""
    slots["quality"] = f"{{{word}}}" if word else ""
    slots["hands"] = {0: "", 1: "{one}", 2: "{two}"}[int(hits.hands[hit])]
    slots |= _target(hits, hit)
    serve = stroke == "serve"
    outcome, ending = str(hits.outcome[hit]), str(hits.ending[hit])
    if outcome == "let":
        return slots | {"h": "{lets}"}
    if outcome == "net":
        return slots | {"h": "{serve_nets}" if serve else "{nets}"}
    if outcome == "out":
        miss = str(hits.miss[hit])
        slots["ts"] = "right" if hits.landing[hit, 0] > 0 else "left"
        slots["out"] = {"": "{out_plain}", "wide": "{out_wide}"}.get(
            miss, "{out_serve_long}" if serve else "{out_long}"
        )
        return slots | {"h": "{serve_outs}" if serve else "{outs}"}
    aimed = bool(slots["to"])
    if serve:
        return slots | {"h": "{aces}" if ending == "ace" and aimed else "{serves}" if aimed else "{serves_bare}"}
    if ending == "winner" and aimed and slots["np"]:
        return slots | {"h": "{wins}"}
    if not slots["np"]:
        return slots | {"h": "{strikes}" if aimed else "{strikes_bare}"}
    if hits.is_return[hit]:
        return slots | {"h": "{returns}" if aimed else "{returns_bare}"}
    return slots | {"h": "{hits}" if aimed else "{hits_bare}"}


def _stroke(hits: HitFacts, hit: int) -> str:
    """The noun of a stroke; empty where neither its name nor its side is known."""
    stroke, side = str(hits.stroke[hit]), str(hits.side[hit])
    known = side in ("forehand", "backhand")
    if stroke in ("serve", "smash"):
        return f"{{np_{stroke}}}"
    if stroke in ("volley", "half volley", "lob", "drop shot"):
        name = {"half volley": "half_volley", "drop shot": "drop"}.get(stroke, stroke)
        return f"{{np_{name}}}" if known else f"{{np_{name}_plain}}"
    if side == "overhead":
        return "{np_overhead}"
    if not known:
        return ""
    return "{np_slice}" if hits.spin[hit] == "slice" else "{np_groundstroke}" if stroke else "{np_side}"


def _target(hits: HitFacts, hit: int) -> dict[str, str]:
    """Slots of where the ball goes: the most telling name that holds."""
    zone, side, depth = str(hits.zone[hit]), str(hits.zone_side[hit]), str(hits.depth[hit])
    serve = hits.stroke[hit] == "serve"
    beside = side in ("left", "right")
    tail = "_middle" if side == "middle" else "_side" if side else ""
    if zone == "box":
        to = "to_box" if beside else "to_box_plain"
        if depth == "short" and not serve:
            to = "to_short_box" if beside else "to_short"
    elif zone == "land" and depth == "deep":
        to = "to_corner" if beside and abs(hits.landing[hit, 0]) > 2.6 else f"to_deep{tail}"
    elif zone == "land":
        to = "to_sideline" if hits.at_sideline[hit] and beside else f"to_land{tail}"
    elif zone == "court" and depth:
        to = "to_short" if depth == "short" else f"to_far{tail}"
    elif side:
        to = "to_side" if beside else "to_middle"
    else:
        to = "to_court" if hits.outcome[hit] == "in" else ""
    course = str(hits.direction[hit])
    said = f"{{{to}}}" if to else ""
    if course and course != "middle":
        # "down the line to the right sideline" says one thing twice.
        said = (
            f"{{course_{course}}} {said}"
            if to not in ("to_side", "to_sideline", "to_court", "")
            else f"{{course_{course}}}"
        )
    return {"to": said, "ts": side if beside else ""}


def _ending(hits: HitFacts, player: int, ended: int, slots: dict[str, str], moved: bool, motion: str) -> Content:
    """The span shows how the point ends."""
    own = int(hits.player[ended]) == player
    outcome, ending, serve = str(hits.outcome[ended]), str(hits.ending[ended]), hits.stroke[ended] == "serve"
    who = "own" if own else "opp"
    if ending in ("ace", "winner"):
        slots["r"] = f"{{r_opp_{ending}}}" if not own else "{r_own_winner}"
        if not own and motion == "moves":
            return Content(frames=("say_mf", "say_mr"), slots=slots)
    elif outcome == "let":
        slots["w"] = "{watch}"
        return Content(frames=("say_m",) if moved else ("say_w",), slots=slots)
    else:
        slots["r"] = f"{{r_{who}_fault_{outcome}}}" if serve else f"{{r_{who}_{outcome}}}"
    if not moved:
        slots["w"] = "{watch}"
        return Content(frames=("say_wr",), slots=slots)
    return Content(frames=("say_sr",) if motion == "still" and not own else ("say_mr",), slots=slots)


def _watching(facts: PlayFacts, row: int, other: int, slots: dict[str, str], moved: bool) -> Content:
    """Another player hits the ball."""
    hits, spans = facts.hits, facts.spans
    stroke, side = str(hits.stroke[other]), str(hits.side[other])
    known = side in ("forehand", "backhand")
    names = {"volley": "volley", "smash": "smash", "lob": "lob", "drop shot": "drop"}
    if stroke == "serve":
        slots |= {"o": "{o_serve}", "w": "{wait_serve}"}
    elif stroke in names:
        plain = "_plain" if stroke == "volley" and not known else ""
        slots |= {"o": "{o_hit}", "onp": f"{{onp_{names[stroke]}{plain}}}", "w": "{wait_ball}"}
    elif known:
        slots |= {"o": "{o_hit}", "onp": "{onp_side}", "w": "{wait_ball}"}
    else:
        slots |= {"o": "{o_plain}", "w": "{wait_ball}"}
    slots["ofb"] = side if known else ""
    late = hits.time[other] - spans.start_s[row] > 0.4 * (spans.end_s[row] - spans.start_s[row])
    if moved:
        waits = late and spans.motion[row] in ("still", "shifts") and not spans.split_step[row]
        return Content(frames=("say_mo", "say_wo") if waits else ("say_mo", "say_mo", "say_ms"), slots=slots)
    slots["w"] = slots["w"] if late else "{watch}"
    return Content(frames=("say_wo",), slots=slots)


def _waiting(facts: PlayFacts, row: int, slots: dict[str, str], moved: bool) -> Content | None:
    """Nobody hits the ball."""
    spans, hits = facts.spans, facts.hits
    upcoming = int(spans.next_hit[row])
    soon = upcoming >= 0 and hits.time[upcoming] - spans.end_s[row] < PREPARES_S
    phase = str(spans.phase[row])
    slots["w"] = ""
    if phase == "before":
        slots["w"] = "{prepare_serve}" if spans.serves[row] else "{wait_serve}"
    elif phase == "after":
        before = np.flatnonzero(np.isfinite(hits.decided_s) & (hits.decided_s < spans.start_s[row]))
        fault = len(before) > 0 and hits.ending[before[-1]] == "fault"
        slots["since"] = "{after_fault}" if fault else "{after}"
        if moved:
            return Content(frames=("say_ma", "say_ms"), slots=slots)
    elif soon and hits.stroke[upcoming] != "serve":
        side = str(hits.side[upcoming])
        slots |= {"fb": side, "w": "{prepare_hit}" if side in ("forehand", "backhand") else "{prepare}"}
    elif phase == "play":
        last = np.flatnonzero(hits.time < spans.start_s[row] + 1e-6)
        own = len(last) > 0 and hits.player[last[-1]] == spans.player[row]
        slots["w"] = "{wait_ball}" if own else "{watch}"
    if moved and slots["w"]:
        still = spans.motion[row] in ("still", "shifts")
        looks = slots["w"] == "{watch}"
        return Content(frames=("say_sw",) if still or looks else ("say_mw",), slots=slots)
    if moved:
        lasts = spans.motion[row] in ("still", "shifts")
        return Content(frames=("say_m",) if lasts else ("say_ms",), slots=slots)
    if slots["w"]:
        return Content(frames=("say_wspot", "say_w") if "spot" in slots else ("say_w",), slots=slots)
    return Content(frames=("say_m",), slots=slots) if spans.distance_m[row] > 0.3 or "spot" in slots else None


def _walk(facts: PlayFacts, row: int, slots: dict[str, str]) -> Content | None:
    """The span of a player who faces no net: compass directions, jumps, turns of the body, ups and downs."""
    spans = facts.spans
    parts = []
    motion = str(spans.motion[row])
    if motion in ("moves", "turns"):
        gait = str(spans.gait[row])
        slots |= {"gait": "{move}" if gait in ("", "move", "sidestep", "backpedal", "jog") else f"{{{gait}}}"}
        slots |= {"way": "{way_compass}", "compass": str(spans.way[row])}
        slots |= {"compass2": str(spans.second_way[row]), "again": "{again_compass}"}
        parts.append("{moves}" if motion == "moves" else "{turns}")
    rise = float(spans.rise_m[row])
    if spans.jumps[row]:
        parts.append("{jump}")
    elif rise > 0.6 or rise < -0.6:
        parts.append("{rise}" if rise > 0 else "{fall}")
    turn = float(spans.turn_deg[row])
    if np.isfinite(turn) and abs(turn) > 50:
        slots["sense"] = "counterclockwise" if turn > 0 else "clockwise"
        parts.append("{rotate}")
    if not parts:
        if motion not in ("still", "shifts"):
            return None
        parts.append("{still}")
    slots["m"] = " and ".join(parts[:2]) if len(parts) < 3 else f"{parts[0]} , {parts[1]} and {parts[2]}"
    return Content(frames=("say_ms",), slots=slots)
