"""What a caption claims by its words, in the words of `facts`: so that what a state shows can be held against it.

A sentence is cut into clauses, and each is somebody's: the captioned player's, the opponent's, or a thing's. Of the
player's own clauses those whose verb strikes the ball tell stroke and target, those whose verb moves tell the way; what
the player only waits for, prepares or intends is no claim, nor is anything that the opponent does. LEFT and RIGHT are
the player's own, facing the net. What is not said is empty.
"""

import re
from dataclasses import dataclass
from functools import lru_cache

from pgm_data.caption.facts import ACROSS, DEPTHS, DIRECTIONS, MOTIONS, OUTCOMES, OWN_WAYS, SIDES, SPINS, STROKES, ZONES


@dataclass(frozen=True, kw_only=True)
class Claims:
    """What one text says of the player that it is about; empty where it says nothing.

    Raises:
        ValueError: If a word is not one of its field's.
    """

    hits: bool
    """Whether the player hits the ball; a swing that misses it does not."""
    stroke: str
    """Of `STROKES`: a forehand or backhand of no other name is a groundstroke."""
    side: str
    """Of `SIDES`: serves and smashes are overhead."""
    spin: str
    """Of `SPINS`."""
    direction: str
    """Of `DIRECTIONS`; of serves none."""
    zone: str
    """Of `ZONES`: where the ball lands."""
    zone_side: str
    """Of `ACROSS`: on which side it lands, or is aimed at. Of balls to a service box left or right."""
    depth: str
    """Of `DEPTHS`."""
    outcome: str
    """Of `OUTCOMES`; empty as well where a ball is not said to be in."""
    motion: str
    """Of `MOTIONS`: what the feet do first."""
    way: str
    """Of `OWN_WAYS`: where they go first."""

    def __post_init__(self) -> None:
        """Check the words."""
        for name, known in WORDS.items():
            if getattr(self, name) not in known:
                raise ValueError(f"{name}: expected one of {', '.join(known)}, got {getattr(self, name)!r}")


WORDS = {
    "stroke": STROKES,
    "side": SIDES,
    "spin": SPINS,
    "direction": DIRECTIONS,
    "zone": ZONES,
    "zone_side": ACROSS,
    "depth": DEPTHS,
    "outcome": OUTCOMES,
    "motion": MOTIONS,
    "way": ("", *OWN_WAYS),
}

_BORDER = re.compile(
    r"\s*,?\s*\b(and then|and|then|but|before|after(?! the ball\b)|while|as|when|because|since|until|although|now that"
    r"|once)\b\s*|\s*,\s*"
)
_OTHER = re.compile(r"(the )?(opponent|rival|other player)\b")
_OWN = re.compile(r"(?:the )?player(?:'s)?\b\s*")
_PASSIVE = re.compile(r"the ball is (sent|hit|struck)\b|an? [\w\s-]*of the player sends the ball\b")
_MOMENT = re.compile(
    r"the (first |second |next |missed )?(serve|fault|let|point|rally)( is (over|repeated|played again))?"
)
_THING = re.compile(r"(the|it|a(?! little)|an|opponent's|(losing|winning|having (lost|won)) the point(?! with))\b")
_AUXILIARY = re.compile(r"(?:is|is about to)\s+")


def _one_of(words: str, *, ends: bool = False) -> re.Pattern[str]:
    """Any of the patterns, which blanks divide and `_` holds together; at the end of a word where asked for."""
    return re.compile(f"(?:{'|'.join(words.split())})".replace("_", r"\s") + (r"\b" if ends else ""))


_NO_HIT = _one_of(
    r"""wait prepar get(s|ting)?_(ready|set|in_position) is_ready be(ing)?_ready stay(s|ing)?_ready ready
    (being_)?about_to set(s|ting)?_up tak(es?|ing)_(the_racket_back|time|a_short_rest) gather collect settl concentrat
    focus hold(s|ing)?_the_ball watch look observ follow anticipat expect await keep think recover catch relax want
    intend go(es|ing)?_for\b fail(s|ing)?_to_(reach|return|touch) toss throw(s|ing)?_the_ball can_not stop"""
)
"""Begins a clause in which the player does not hit the ball, though it may name a stroke."""
_MISSES = re.compile(
    r"\b(swing(s|ing)? (at|with|and)|swing(s|ing)?$|miss(es|ing)? the ball|attempt(s|ing)?|(try|tries|trying) to hit)\b"
    r"|\bbut miss"
)
_SERVES = re.compile(r"serv(e|es|ing)\b")
_HITS = _one_of(
    r"""hit send return play strik mak direct guid steer produc plac execut perform meet us(e|es|ing)\b respond knock
    driv answer aim put deliver tak complet touch push handl counter repl receiv punch block smash lift lob
    throw(s|ing)?_up drop dink carv float slic chip bur(y|ies) net(s|ting)?\b fail(s|ing)?_to_get win finish scor launch
    fir(e|es|ing)\b open commit los(e|es|ing)\b"""
)
"""Begins a clause in which the player hits the ball, if it names a ball or a stroke."""
_BALL = re.compile(
    _one_of(
        r"""ball it serve forehand backhand half.volley volley smash overhead lob drop_?shot shot stroke drive
        groundstroke slice winner ace let point the_net double_fault \w+_return""",
        ends=True,
    ).pattern.join((r"\b", ""))
)
_NO_STROKE = re.compile(
    r"(return|com|mov|go|get)\w* (back )?(to|towards) (the|a)|(tak|mak|perform)\w+ ([\w\s]*steps?|its way)\b"
    r"|(win|los)\w* the point(?! with)"
)
"""Clauses that seem to hit the ball and do not."""
_GOES = _one_of(
    r"""charg sprint dash dart run rac bolt rush hurr mov go speed jog trot head walk stroll ambl wander pac sidestep
    side.step shuffl shift tak mak backpedal retreat back fall step proceed travel advanc hasten start begin
    set(s|ting)?_off com return get first chang"""
)
_STAYS = _one_of(
    r"""stay\w*(?!_ready|\w) remain stand hold(s|ing)?_the_position keep(s|ing)?_the_position (being_)?motionless
    wait\w*_without_moving"""
)
_RECOVERS = re.compile(r"recover\w* (to|towards)\b")
_SHIFTS = _one_of(
    r"""mov\w+_on_the_spot correct adjust (tak|mak)\w+_(small|a_few|little)_(adjusting_)?(short_)?steps
    (tak|mak)\w+_small shift\w*_the_weight stay\w*_in_place_with_small"""
)
_SIDES = re.compile(r"\b(left|right|middle|center|central|deuce|ad)\b")
_NAMES = {"center": "middle", "central": "middle", "deuce": "left", "ad": "right"}
_COURSES = (
    ("cross", re.compile(r"\bcross[ -]?court\b|\bacross the court\b")),
    ("line", re.compile(r"\b(?:down the (?:(left|right) )?line|along the (left|right) sideline)\b")),
    ("middle", re.compile(r"\b(?:down|through) the middle\b|\balong the center line\b|\bdown the t\b")),
)
_OUT = re.compile(
    r"\bout\b(?! of reach)|\b(outside of the court|long|too deep|too wide|tramlines|alley|fault)\b|\bwide of\b"
    r"|\bwide to the (left|right)(?! side of the service| service)\b"
    r"|\b(past|beyond|over|behind) the ((left|right) )?(side of the )?(baseline|sideline|service line)"
)
_NET = re.compile(
    r"\binto the net\b|\bin the net\b|\b(hits?|hitting) the net\b|^net(s|ting)?\b|\bnet stops\b|\bover the net$"
    r"|\bhits the net\b"
)
_AREA = (
    r"(?:no man's land|baseline|service line|net|court|field|service box(?:es)?|sideline|center line|t\b"
    r"|(?:deuce|ad) (?:side|court))"
)
_PLACE = re.compile(
    r"\b(?:up to|close to|close|to|towards|into|in|inside|at|near|on|along|across"
    r"|(?:far |deep |well |a little )?behind)"
    r" (?:a position )?(?:behind )?(?:(?:the|no) )?(?:(?:left|right|middle|center|central|back|deuce|ad) )?"
    rf"(?:(?:side|part|end|half|middle|center|back) of )*(?:the )*{_AREA}(?: of the court)?"
    r"(?: on the (?:left|right) side| in the middle| on the (?:deuce|ad) side)?"
)
_FORWARD = re.compile(r"\b(?:towards the net|in the direction of the net|closer to the net|up the court|forwards?)\b")
_BACK = re.compile(
    r"\b(?:away from the net|back from the net|backwards?)\b|\bback(?=$| and\b| up\b| again\b)|^back\b(?! to (the|a)\b)"
    r"|^back\w* up\b"
)
_CENTRES = re.compile(r"\b(?:back )?(?:to|towards) (?:the|a) (?:middle|center|central position)(?: of the court)?\b")


@lru_cache(maxsize=65536)
def claims_of_text(text: str) -> Claims:
    """What the text says of the player that it is about.

    Sentences of the kinds that captions have, in any case; of words that it does not know nothing is claimed.
    """
    own, results = _clauses(text.lower())
    strikes = [clause for clause in own if _is_hit(clause)]
    missed = any(_MISSES.search(clause) for clause in own)
    hits = bool(strikes) and not missed
    hit = " . ".join(strikes) if hits else ""
    results += [clause for clause in own if clause == "let"]
    outcome = _outcome(hit, " . ".join(results)) if hits else ""
    stroke, side, spin = _stroke(hit)
    zone, zone_side, depth, direction = _target(hit, stroke) if outcome in ("", "in") else ("", "", "", "")
    motion, way = _movement([clause for clause in own if not _is_hit(clause)])
    return Claims(
        hits=hits,
        stroke=stroke,
        side=side,
        spin=spin,
        direction=direction,
        zone=zone,
        zone_side=zone_side,
        depth=depth,
        outcome=outcome,
        motion=motion,
        way=way,
    )


def _clauses(text: str) -> tuple[list[str], list[str]]:
    """The player's own clauses, begun by their verbs, and what is said after the first hit of what becomes of it."""
    own: list[str] = []
    results: list[str] = []
    mine = True
    text = text.strip().rstrip(".")
    at = 0
    waits = False
    for border in [*_BORDER.finditer(text), None]:
        clause = text[at : border.start()] if border is not None else text[at:]
        at = border.end() if border is not None else len(text)
        clause = clause.strip()
        if not clause:
            continue
        if _MOMENT.fullmatch(clause):
            continue
        if _PASSIVE.match(clause):
            mine = True
        elif _OTHER.match(clause):
            mine = False
        elif _OWN.match(clause):
            mine = True
            clause = _OWN.sub("", clause, count=1)
        elif _THING.match(clause):
            mine = False
        if not mine:
            if any(_is_hit(clause) for clause in own):
                results.append(clause)
            continue
        clause = _AUXILIARY.sub("", clause, count=1) if _AUXILIARY.match(clause) else clause
        if clause == "serving" and waits:
            continue
        waits = bool(re.match(r"wait(s|ing)?$", clause))
        if clause:
            own.append(clause)
    return own, results


def _is_hit(clause: str) -> bool:
    """Whether the clause's verb strikes the ball."""
    if _PASSIVE.match(clause):
        return True
    if _NO_HIT.match(clause) or _MISSES.search(clause):
        return False
    if _SERVES.match(clause):
        return True
    return bool(_HITS.match(clause) and _BALL.search(clause) and not _NO_STROKE.match(clause))


def _stroke(hit: str) -> tuple[str, str, str]:
    """Stroke, side and spin of a hit; all empty of none."""
    returns = re.search(
        r"(return|answer|counter|handl|receiv)\w* the serve|send\w* the serve back|repl\w+ to the serve", hit
    )
    side = "forehand" if "forehand" in hit else "backhand" if "backhand" in hit else ""
    spin = ""
    if re.search(r"\bslic|backspin|\bcarv|\bchip|\bfloat", hit):
        spin = "slice"
    elif re.search(r"topspin|\bspinning\b", hit):
        spin = "topspin"
    elif re.search(r"\bflat\b", hit):
        spin = "flat"
    if not returns and re.search(r"\bserv(e|es|ing)\b|\bace\b", hit):
        return "serve", "overhead", ""
    if re.search(r"half.volley", hit):
        return "half volley", side, ""
    if "volley" in hit:
        return "volley", side, ""
    if re.search(r"\bsmash", hit):
        return "smash", "overhead", ""
    if re.search(r"\blobs?\b|\blobbing\b", hit):
        return "lob", side, ""
    if re.search(r"drop ?shot|\bdink|\bdrop(s|ping)? ", hit):
        return "drop shot", side, ""
    if "overhead" in hit:
        return "", "overhead", ""
    return ("groundstroke" if side else ""), side, spin


def _outcome(hit: str, results: str) -> str:
    """What is said to become of the hit."""
    told = f"{hit} . {results}"
    if re.search(r"\blet\b", told):
        return "let"
    if (
        _NET.search(hit)
        and not re.search(r"\b(just|ball|short) over the net\b|net cord", hit)
        or re.search(r"\bthe (ball ends in the net|net stops)", results)
    ):
        return "net"
    if re.search(r"\bmisses the court\b", told) or _OUT.search(told):
        return "out"
    return "in" if re.search(r"\b(ace|winner|win\w* the point|finish\w* the point|scor\w+)\b", told) else ""


def _target(hit: str, stroke: str) -> tuple[str, str, str, str]:
    """Zone, its side, depth and direction of a hit."""
    direction, beside = "", ""
    for name, course in _COURSES:
        found = course.search(hit)
        if found:
            direction = name
            beside = str(next((word for word in found.groups() if word), beside))
            hit = course.sub(" ", hit)
    zone, depth = "", ""
    if re.search(r"\b(service box(es)?|(deuce|ad) (service )?box|inside the service line)\b", hit):
        zone = "box"
        depth = "short" if re.search(r"\bshort (in)?to\b|\bfront of\b", hit) else ""
    elif re.search(r"\b(just over|short behind|close to) the (middle of the )?net\b", hit) or (
        stroke != "serve" and "falls just over" in hit
    ):
        zone, depth = "box", "short"
    elif re.search(r"no man's land|between the service line and the baseline", hit):
        zone = "land"
    elif re.search(r"\bcorner\b|\bbaseline\b|\bdeep (to|into)\b", hit):
        zone, depth = "land", "deep"
    elif re.search(r"\bback of the court\b", hit):
        depth = "deep"
    sides = [_NAMES.get(word, word) for word in map(str, _SIDES.findall(hit))]
    side = sides[0] if sides else beside
    # A box is left or right of the middle line, however near to it the ball lands.
    side = "" if zone == "box" and side == "middle" else side
    return zone, side, depth, "" if stroke == "serve" else direction


def _movement(clauses: list[str]) -> tuple[str, str]:
    """What the feet do first, and the way that they go."""
    for number, clause in enumerate(clauses):
        if _SHIFTS.match(clause):
            return "shifts", ""
        if _STAYS.match(clause):
            return "still", ""
        if _RECOVERS.match(clause):
            return "moves", ""
        if not _moves(clause):
            continue
        words = _way(clause)
        for later in clauses[number + 1 :]:
            further = _way(later)
            if re.match(r"turn\w* around", later):
                continue
            if not further:
                break
            if _moves(later):
                return ("turns" if further != words else "moves"), _word(words)
            # "to the left" and "forward" are two clauses of one way.
            words |= further
        return "moves", _word(words)
    return "", ""


def _moves(clause: str) -> bool:
    """Whether the clause's verb is one of going somewhere."""
    return (
        bool(_GOES.match(clause)) and not _NO_HIT.match(clause) and not re.match(r"back(wards?)?\b|\w+ a split", clause)
    )


def _way(clause: str) -> set[str]:
    """Left, right, forward, back: what a clause says of the way, its places left out."""
    said = set()
    clause = _CENTRES.sub(" ", clause)
    if _FORWARD.search(clause):
        said.add("forward")
    if _BACK.search(clause) or re.match(r"(retreat|backpedal|fall\w* back|back\w* up)", clause):
        said.add("back")
    rest = _PLACE.sub(" ", _BACK.sub(" ", _FORWARD.sub(" ", clause)))
    found = re.search(r"\b(left|right)\b", rest)
    if found:
        said.add(found[1])
    return said


def _word(words: set[str]) -> str:
    """The way of `OWN_WAYS` that the words make; empty where they contradict each other."""
    across, along = words & {"left", "right"}, words & {"forward", "back"}
    if len(across) > 1 or len(along) > 1:
        return ""
    return " ".join([*across, *along])
