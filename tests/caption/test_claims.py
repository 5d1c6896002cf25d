"""What captions claim is read from the words of both grammars, and nothing is read that is not the player's own."""

import random

import numpy as np
import pytest

from pgm_data.caption import grammar as ours
from pgm_data.caption import phrases as our_phrases
from pgm_data.caption.claims import Claims, claims_of_text
from pgm_data.simulate.tennis import caption_grammar as simulated
from pgm_data.simulate.tennis import phrases as simulated_phrases

NOTHING = Claims(
    hits=False,
    stroke="",
    side="",
    spin="",
    direction="",
    zone="",
    zone_side="",
    depth="",
    outcome="",
    motion="",
    way="",
)
FIELDS = tuple(name for name in NOTHING.__dataclass_fields__ if name not in ("hits", "motion", "way"))


def said(text: str) -> dict[str, object]:
    """The claims of a text that are not empty."""
    claims = claims_of_text(text)
    return {name: getattr(claims, name) for name in claims.__dataclass_fields__ if getattr(claims, name)}


@pytest.mark.parametrize(
    ("text", "claims"),
    [
        (
            "as the opponent plays a backhand slice, the player runs to the left and hits a forehand down the line",
            {
                "hits": True,
                "stroke": "groundstroke",
                "side": "forehand",
                "direction": "line",
                "motion": "moves",
                "way": "left",
            },
        ),
        (
            "after moving to the right and forward, the player punches a backhand volley into the left service box",
            {
                "hits": True,
                "stroke": "volley",
                "side": "backhand",
                "zone": "box",
                "zone_side": "left",
                "motion": "moves",
                "way": "right forward",
            },
        ),
        (
            "the player, near the left side of the baseline, serves wide to the deuce service box",
            {"hits": True, "stroke": "serve", "side": "overhead", "zone": "box", "zone_side": "left"},
        ),
        (
            "the ball is sent to the middle of no man's land with a sliced backhand by the player",
            {
                "hits": True,
                "stroke": "groundstroke",
                "side": "backhand",
                "spin": "slice",
                "zone": "land",
                "zone_side": "middle",
            },
        ),
        (
            "the player returns the serve with a two-handed backhand cross court to the right corner",
            {
                "hits": True,
                "stroke": "groundstroke",
                "side": "backhand",
                "direction": "cross",
                "zone": "land",
                "zone_side": "right",
                "depth": "deep",
            },
        ),
        (
            "the player hits a topspin forehand past the left sideline",
            {"hits": True, "stroke": "groundstroke", "side": "forehand", "spin": "topspin", "outcome": "out"},
        ),
        (
            "the player serves but the ball touches the net, let",
            {"hits": True, "stroke": "serve", "side": "overhead", "outcome": "let"},
        ),
        ("the player prepares to hit a forehand", {}),
        ("the player waits before serving", {}),
        ("the player sprints to the right to hit the ball", {"motion": "moves", "way": "right"}),
        ("the player swings with the backhand but misses the ball", {}),
        ("the player stands still until the opponent hits a smash", {"motion": "still"}),
        (
            "the player moves to the left, then comes back to the right as the rival plays a lob",
            {"motion": "turns", "way": "left"},
        ),
        ("the player turns away as the player loses the point", {}),
        ("", {}),
        ("spieler schlägt die vorhand", {}),
        ("xyzzy, and then; \u2028 !", {}),
    ],
)
def test_sentences_claim_what_a_reader_would_say(text, claims):
    assert said(text) == claims
    assert said(text.upper() + ".") == claims


def test_no_text_is_too_long():
    text = "the player moves to the left and " + "hits a forehand to the right service box and " * 250
    assert len(text.split()) > 2000
    assert said(text)["zone_side"] == "right"


def test_words_that_facts_do_not_have_are_refused():
    with pytest.raises(ValueError, match="zone: expected one of"):
        Claims(**{**vars(NOTHING), "zone": "moon"})


SIM_STROKES = {
    "np_drive": {"stroke": "groundstroke"},
    "np_slice": {"stroke": "groundstroke", "spin": "slice"},
    "np_volley": {"stroke": "volley"},
    "np_half_volley": {"stroke": "half volley"},
    "np_lob": {"stroke": "lob"},
    "np_drop": {"stroke": "drop shot"},
}
SIM_TARGETS = {
    "to_box": {"zone": "box", "zone_side": "{ts}"},
    "to_short_box": {"zone": "box", "zone_side": "{ts}", "depth": "short"},
    "to_land_side": {"zone": "land", "zone_side": "{ts}"},
    "to_land_middle": {"zone": "land", "zone_side": "middle"},
    "to_corner_side": {"zone": "land", "zone_side": "{ts}", "depth": "deep"},
    "to_half_side": {"zone_side": "{ts}"},
    "to_half_middle": {"zone_side": "middle"},
}
OUR_STROKES = {
    "np_groundstroke": {"stroke": "groundstroke"},
    "np_slice": {"stroke": "groundstroke", "spin": "slice"},
    "np_volley": {"stroke": "volley"},
    "np_half_volley": {"stroke": "half volley"},
    "np_lob": {"stroke": "lob"},
    "np_drop": {"stroke": "drop shot"},
}
OUR_TARGETS = {
    "to_box": {"zone": "box", "zone_side": "{ts}"},
    "to_land_side": {"zone": "land", "zone_side": "{ts}"},
    "to_land_middle": {"zone": "land", "zone_side": "middle"},
    "to_deep_side": {"zone": "land", "zone_side": "{ts}", "depth": "deep"},
    "to_side": {"zone_side": "{ts}"},
    "to_middle": {"zone_side": "middle"},
}
WAYS = {
    "way_side": "{side}",
    "way_forward": "forward",
    "way_back": "back",
    "way_side_forward": "{side} forward",
    "way_side_back": "{side} back",
}


def of_simulator(symbol: str, slots: dict[str, str], seed: int) -> str:
    draw = simulated_phrases.Draw(np.random.default_rng(seed))
    return simulated_phrases.sentence(f"{{{symbol}}}", slots, simulated.GRAMMAR, draw)


def of_data(symbol: str, slots: dict[str, str], seed: int) -> str:
    return our_phrases.sentence(symbol, slots, ours.GRAMMAR, random.Random(seed))


SIM_EMPTY = dict.fromkeys(("adj", "hands", "pace", "goal", "purpose", "first", "then", "effort", "fault"), "")
OUR_EMPTY = dict.fromkeys(("quality", "hands", "goal", "after_motion"), "")
HITS = {"np_volley": "hit_volley", "np_slice": "hit_slice", "np_lob": "hit_lob", "np_drop": "hit_drop"}


@pytest.mark.parametrize("grammar", ["simulator", "data"])
def test_every_sentence_about_a_hit_is_read_as_it_was_meant(grammar):
    random_ = np.random.default_rng(3)
    strokes, targets = (SIM_STROKES, SIM_TARGETS) if grammar == "simulator" else (OUR_STROKES, OUR_TARGETS)
    for seed in range(500 if grammar == "simulator" else 100):
        np_, to, way = (str(random_.choice(list(options))) for options in (strokes, targets, WAYS))
        side, ts = (str(random_.choice(["left", "right"])) for _ in range(2))
        fb = str(random_.choice(["forehand", "backhand"]))
        slots = {"np": f"{{{np_}}}", "to": f"{{{to}}}", "ts": ts, "fb": fb, "side": side, "way": f"{{{way}}}"}
        if grammar == "simulator":
            gait = str(random_.choice(["sprint", "run", "jog", "walk", "go"]))
            hit = HITS.get(np_, "hit_in")
            slots |= SIM_EMPTY | {"m": "{move}", "gait": f"{{{gait}}}", "h": f"{{{hit}}}"}
            frame = str(random_.choice(["frame_h", "frame_mh", "frame_hm"]))
            text = of_simulator(frame, slots, seed)
        else:
            gait = str(random_.choice(["sprint", "run", "jog", "walk", "move"]))
            slots |= OUR_EMPTY | {"m": "{moves}", "gait": f"{{{gait}}}", "h": "{hits}"}
            frame = str(random_.choice(["say_h", "say_mh"]))
            text = of_data(frame, slots, seed)
        meant = {"side": fb, **strokes[np_]}
        meant |= {name: word.replace("{ts}", ts) for name, word in targets[to].items()}
        claims = claims_of_text(text)
        assert claims.hits, text
        assert {name: getattr(claims, name) for name in FIELDS if getattr(claims, name)} == meant, text
        if "m" in frame.removeprefix("frame_"):
            assert (claims.motion, claims.way) == ("moves", WAYS[way].replace("{side}", side)), text


@pytest.mark.parametrize("grammar", ["simulator", "data"])
def test_what_the_opponent_hits_and_what_is_prepared_is_no_claim(grammar):
    for seed in range(300 if grammar == "simulator" else 100):
        fb = ("forehand", "backhand")[seed % 2]
        stroke = ("volley", "smash", "lob", "drop")[seed % 4]
        slots = {"fb": fb, "ofb": fb, "nth": "second", "onp": f"{{onp_{stroke}}}", "o": "{o_hit}", "m": "{still}"}
        slots["w"] = ("{prepare_hit}", "{prepare_serve}", "{wait_ball}", "{wait_serve}", "{watch}")[seed % 5]
        if seed % 3 == 0:
            slots["o"] = "{o_serve}"
        if grammar == "simulator":
            frame = ("frame_mo", "frame_wo", "frame_sw", "frame_w")[seed % 4]
            text = of_simulator(frame, slots, seed)
        else:
            frame = ("say_mo", "say_wo", "say_sw", "say_w")[seed % 4]
            text = of_data(frame, slots, seed)
        claims = claims_of_text(text)
        assert not claims.hits, text
        assert all(getattr(claims, name) == "" for name in FIELDS), text
