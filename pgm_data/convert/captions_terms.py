"""Terms of the court, and words that look like misspelt ones."""

import difflib
import re
from functools import cache

TERMS = frozenset(
    """
    ace aces alley alleys backcourt backhand backhands backspin ball balls baseline baselines box boxes crosscourt
    court courts deuce doubles dropshot dropshots fault faults forecourt forehand forehands groundstroke
    groundstrokes lob lobs lobbed lobbing midcourt net netted netting opponent opponents overhead overheads overhit
    player players racket rackets racquet racquets rally rallies return returned returner returning returns serve
    served server serves service serving sideline sidelines sidespin sidestep sidesteps sidestepped sidestepping
    singles slice sliced slices slicing smash smashed smashes smashing spin sprint sprinted sprinting sprints stroke
    strokes topspin tramline tramlines umpire volley volleyed volleying volleys winner winners backpedal backpedals
    backpedalled backpedaled backpedaling backpedalling shuffle shuffled shuffles shuffling diagonally shuttlecock
    paddle kitchen
    """.split()
)
ALIKE = frozenset(
    """
    since stepping stepped backing backed trained training series sense slide serious stores store races raced
    racing airline player's opponent's opposite opponents' served severe services serviced service's crossed cross
    courtside deduce volleyball winner's dinner shuffler sliding slide slides slid splice spring springs stoke
    strike strikes striking striker struck strokes' sprinter printed rattle rocket rockets pocket packet overheard
    overhand underhand returnable retuned smashed smasher tramlined backhanded forehanded forehead beforehand
    baseline's sideline's diagonal slower sideways sideway sidewards played playing plays place places placed layer
    layers prayer prayers crosses overheat deliver delivers winter wonder sinner sliced slicer spine spins spinning
    spinner spun singled single signals shuffle's
    """.split()
)
"""Words of their own that are near to a term."""
SHORTEST = 5
NEAR = 0.8
WORD = re.compile(r"[^\W\d_]+(?:['\u2019][^\W\d_]+)?")


@cache
def likely_term(word: str) -> str:
    """The court term that a word, in small letters, seems to be a misspelling of; empty where it seems none."""
    if len(word) < SHORTEST or word in TERMS or word in ALIKE or "'" in word or "\u2019" in word:
        return ""
    like = sorted(term for term in TERMS if len(term) >= SHORTEST and term[0] == word[0])
    near = difflib.get_close_matches(word, like, n=1, cutoff=NEAR)
    if not near:
        return ""
    # Another ending of a term is no misspelling.
    stem = near[0].removesuffix("s")
    return "" if word.startswith(stem) else near[0]


def misspelt(text: str) -> dict[str, str]:
    """Words of the text that seem to be misspelt court terms, each with that term."""
    words = dict.fromkeys(word.lower() for word in WORD.findall(text))
    return {word: term for word in words if (term := likely_term(word))}
