"""What a caption says of waiting, of the opponent and of how the play ends, held against the play."""
# ruff: noqa: E501 (patterns stay whole)

import re

from tests.simulate.tennis.caption_said import Said, World
from tests.simulate.tennis.caption_words import GO, NOUNS, OPPONENT, PREPARE, READY, TAKE, WAIT, verb


def read_waits(said: Said, world: World) -> None:
    play, serve, last = said.play, world.serve, world.last
    over = said.start >= world.decided()
    number = "first" if play.serve_number == 1 else "second"
    winner = play.winner == said.player
    for m in said.all(
        rf"{WAIT} for the serve to be repeated|{READY} for the repeated serve|{PREPARE} for the next serve"
    ):
        said.must(over and play.outcome == "let", m.group())
    for m in said.all(rf"(?:{WAIT}|{READY}|{PREPARE}) for the second serve"):
        waits = over and play.outcome == "fault"
        said.must(waits or (play.server == said.player and number == "second" and said.start < serve.time), m.group())
    for m in said.all(
        rf"(?:{PREPARE}|{READY}|is about) to serve|(?:{READY}|{PREPARE}) for the (first|second) serve|{PREPARE} to hit the (first|second) serve"
        rf"|(?:{verb('concentrat-e')} before|{TAKE} time before|{verb('focus')} on) the (first|second) serve|{verb('gather')} concentration for the (first|second) serve|{verb('collect')} the thoughts before the (first|second) serve|{verb('settl-e')} before the (first|second) serve|{WAIT} before serving"
        rf"|(?:be|being) about to serve|{verb('hold')} the ball and(?= )"
    ):
        nth = next((g for g in m.groups() if g), number)
        said.must(play.server == said.player and said.start < serve.time and nth == number, m.group())
    for m in said.all(
        r"with the point won|after winning the point|having won the point|as the point is won|after the opponent has lost the point"
    ):
        said.must(over and winner, m.group())
    for m in said.all(
        r"with the point lost|after losing the point|having lost the point|as the point is lost(?! by)|after the opponent has won the point"
    ):
        said.must(over and play.winner == 1 - said.player, m.group())
    for m in said.all(
        r"at the end of the point|with the point over|now that the point is over|after the point|after the end of the point|(?:when|since) the point is over|after the rally|as the rally has ended|once the point has ended"
    ):
        said.must(over and play.winner >= 0, m.group())
    for m in said.all(
        r"after the fault|because the serve was a fault|since the (first|second) serve was a fault|after the missed serve|before the second serve"
    ):
        said.must(over and play.outcome == "fault" and m.group(1) in (None, number), m.group())
    for m in said.all(r"after the let|because the serve was a let|before the serve is (?:repeated|played again)"):
        said.must(over and play.outcome == "let", m.group())
    for m in said.all(
        rf"(?:{WAIT} for|{READY} for|{PREPARE} for) the next point|{TAKE} a short rest|catch(?:es|ing)? the breath|{verb('think')} about the next point|{verb('recover')} for the next point|{verb('look')} forward to the next point|relax(?:es|ing)?"
    ):
        said.must(over and play.winner >= 0, m.group())
    for m in said.all(
        rf"{WAIT} for the serve|{WAIT} for the opponent to serve|{WAIT} for the opponent's serve|{READY} to return the serve"
        rf"|{READY} for the serve of the opponent|{READY} for the serve|{PREPARE} to (?:receive|return) the serve|{verb('await')} the serve"
        rf"|{verb('concentrat-e')} before the serve|{verb('bend')} the knees"
    ):
        said.must(play.server != said.player and said.start < serve.time, m.group())
    for m in said.all(
        rf"{WAIT} for the (?:return|ball|opponent's shot|opponent's return|opponent to hit the ball)|(?:{READY}|{verb('stay')} ready) for the (?:next shot|next ball|return)"
        rf"|{PREPARE} for the (?:next ball|opponent's next shot)|{verb('anticipat-e')} the return|{verb('expect')} the opponent's response"
        rf"|{verb('await')} the opponent's answer"
    ):
        before = world.previous(said.start)
        said.must(before is not None and before.player == said.player and not over, m.group())
    for m in said.all(
        rf"{verb('look')} at the (?:ball|opponent)|{verb('observ-e')} the opponent|{verb('follow')} the ball with the eyes|{verb('watch')} (?:the opponent|the ball)|{verb('watch')}"
    ):
        said.must(said.end > serve.time, m.group())
    for m in said.all(
        rf"(?:{PREPARE}|{READY}) to hit the ball but {verb('stop')}|(?:{verb('want', 'intend')}) to hit the ball but {verb('stop')}"
        rf"|{GO} for the ball but {verb('stop')} halfway"
    ):
        speed = world.speed[world.piece(said.start, said.end)]
        said.must(last.player != said.player and speed[-1] < 0.6 < speed.max(), m.group())
    for m in said.all(
        rf"(?:(?:{PREPARE}|{READY}) to hit|{PREPARE}|set(?:s|ting)? up for|(?:get|gets|getting) in position for|{TAKE} the racket back for)"
        r" an? (forehand|backhand)"
    ):
        upcoming = next((s for s in play.strokes if s.player == said.player and s.time >= said.end), None)
        said.must(upcoming is not None and upcoming.side == m.group(1), m.group())
    for m in said.all(rf"(?:{PREPARE}|{READY}) to hit the ball|{PREPARE} for the shot|{TAKE} the racket back"):
        said.must(any(s.player == said.player and s.time >= said.end for s in play.strokes), m.group())


def read_opponent(said: Said, world: World) -> None:
    """Clauses whose subject is the opponent or the opponent's ball."""
    shots = world.strokes(1 - said.player, said.start, said.end)
    opponents = rf"(?:the opponent's(?: (?:first|second))? (?:shot|ball|serve)|the ball of the opponent|{OPPONENT})"
    for m in said.all(rf"{opponents} ([^,_]*?)(?=$|,| while the player|_)"):
        what = m.group(1)
        nth = re.search(r"first|second", m.group())
        number = "first" if said.play.serve_number == 1 else "second"
        said.must(nth is None or nth.group() == number, m.group())
        ended = said.start <= world.decided() < said.end
        theirs = world.last.player != said.player
        last = said.play.strokes[world.last.stroke]
        if re.search(r"double fault", what):
            said.must(ended and theirs and said.play.outcome == "double_fault", m.group())
        elif (
            re.search(r"fault|serves into the net|serves out", what)
            or "serve" in m.group()
            and re.search("net|out", what)
        ):
            said.must(ended and theirs and last.kind == "serve" and world.last.result in ("net", "out"), m.group())
            said.must("net" not in what or world.last.result == "net", m.group())
            said.must(re.search(r"\bout\b", what) is None or world.last.result == "out", m.group())
        elif re.search(r"\blet\b", what):
            said.must(ended and theirs and world.last.result == "let", m.group())
        elif re.search(r"\bnets?\b", what):
            said.must(ended and theirs and world.last.result == "net", m.group())
        elif re.search(r"\bout(?:side)?\b", what):
            said.must(ended and theirs and world.last.result == "out", m.group())
        elif re.search(r"\bace\b", what):
            said.must(ended and theirs and said.play.outcome == "ace", m.group())
        elif re.search(r"winner|(?:wins|scores) the point|too good", what):
            said.must(ended and theirs and world.last.result == "in" and said.play.winner != said.player, m.group())
        elif re.search(r"not reach|fails to return", what):
            said.must(ended and not theirs and world.last.result == "in" and said.play.winner == said.player, m.group())
        elif re.search(r"\bserves?\b", what):
            said.must(any(s.kind == "serve" for s, _ in shots), m.group())
        else:
            said.must(bool(shots), m.group())
            side = re.search(r"forehand|backhand", what)
            said.must(side is None or any(s.side == side.group() for s, _ in shots), m.group())
            kind = next((k for k, p in NOUNS.items() if re.search(rf"\b(?:{p})\b", what)), None)
            said.must(
                kind is None or any(s.kind == kind or (kind == "smash" and s.side == "overhead") for s, _ in shots),
                m.group(),
            )
            understood = r"(?:hits|returns|strikes|plays|answers|sends|the|ball|back|with|an?|forehand|backhand|shot|slice|half volley|volley|smash|lob|drop)"
            said.must(re.fullmatch(rf"(?:{understood} ?)+", what) is not None, f"not understood: {m.group()}")


def read_end(said: Said, world: World) -> None:
    """Clauses on how the ball ends that name no opponent."""
    ended = said.start <= world.decided() < said.end
    last, play = world.last, said.play
    mine = last.player == said.player
    stroke = play.strokes[last.stroke]
    served = stroke.kind == "serve"
    number = "first" if play.serve_number == 1 else "second"
    subject = r"(?<!but )(?:the ball|the (?:(?:first|second) )?serve|the shot of the player|it|the point)"
    ends = {
        "net": r"(?:hits|ends in|lands in) the net",
        "out": r"(?:goes out of bounds|flies out of bounds|lands outside of the court|goes out|lands out|flies out|is out)(?! of reach)",
        "past": r"is out of reach|is too far away|is too late to reach the ball|goes past the player|is impossible to reach|is too good",
        "double": r"is a double fault|is lost by a double fault",
        "fault": r"is a fault",
        "let": r"is a let|touches the net, let|touches the net , let|clips the net|has to be repeated",
    }
    theirs = rf"{subject} (?:is out of reach for the opponent|is too far for the opponent)|the shot of the player is too good"
    for m in said.all(theirs):
        said.must(ended and mine and last.result == "in" and play.winner == said.player, m.group())
    for name, pattern in ends.items():
        for m in said.all(rf"{subject} (?:{pattern})"):
            holds = {
                "net": last.result == "net", "out": last.result == "out", "let": last.result == "let",
                "past": last.result == "in" and not mine and play.winner != said.player,
                "double": play.outcome == "double_fault", "fault": served and last.result in ("net", "out"),
            }[name]  # fmt: skip
            said.must(ended and holds, m.group())
            said.must("serve" not in m.group() or served, m.group())
            nth = re.search(r"first|second", m.group())
            said.must(nth is None or nth.group() == number, m.group())
            said.must("of the player" not in m.group() or mine, m.group())
    for m in said.all(r"the player (wins|loses) the point(?! with)"):
        said.must(ended and play.winner == (said.player if m.group(1) == "wins" else 1 - said.player), m.group())
    late = rf"{verb('fail')} to reach the ball|(?:is|being) too late(?: to reach the ball)?|{verb('arriv-e')} too late for the ball"
    for m in said.all(rf"{late}|let(?:s|ting)? the ball pass"):
        said.must(ended and not mine and last.result == "in" and play.winner != said.player, m.group())
