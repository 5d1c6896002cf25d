"""English and tennis as the reader of captions knows them: patterns of verbs, nouns and places."""
# ruff: noqa: E501 (patterns stay whole)

OPPONENT = r"(?:the opponent|opponent|the other player|the rival)"
NEUTRAL = set(
    """a an the player and then but it , with of by after before while that which is being to as when because since although
    for its from through are ball in on up until halfway playing again""".split()
)


def verb(*stems: str) -> str:
    """A pattern of a verb's forms, from stems such as `run`, `mak-e`."""
    forms = []
    for stem in stems:
        if stem.endswith("-e"):
            forms.append(f"{stem[:-2]}(?:e|es|ing|ed)")
        elif stem.endswith("-y"):
            forms.append(f"{stem[:-2]}(?:y|ies|ying)")
        else:
            forms.append(f"{stem}(?:s|es|{stem[-1]}?ing|ed)?")
    return "(?:" + "|".join(forms) + ")"


TAKE, MAKE, MOVE, GO, STAND = verb("tak-e"), verb("mak-e"), verb("mov-e"), verb("go"), verb("stand")
GAITS = {
    "sprint": rf"{verb('sprint', 'dash', 'dart', 'bolt')}|{verb('run')} (?:at full speed|fast)|{verb('charg-e')} at full speed",
    "run": verb("run", "rush", "hurr-y", "rac-e", "charg-e", "speed"),
    "jog": verb("jog", "trot"),
    "walk": verb("walk", "stroll", "pac-e", "wander", "ambl-e"),
    "sidestep": rf"{verb('sidestep', 'shuffl-e')}|{TAKE} (?:quick )?sidesteps|{TAKE} side steps|{MAKE} side steps|{MOVE} with side steps",
    "retreat": rf"{verb('backpedal', 'retreat')}|back(?:s|ing)? up|{verb('drop', 'fall')} back",
    "step": rf"(?:{TAKE}|{MAKE}) a (?:small |short |little )?step|{MOVE} a little|{verb('step')}",
    "recover": rf"{verb('recover')}(?= back| to)|(?<!hand ){verb('return')}(?= to| towards)|{verb('get')}(?= _)"
    rf"|(?:{MOVE}|{verb('com-e')}|{GO})(?= _)",
    "go": rf"{MAKE} its way|{verb('proceed', 'travel')}|{verb('chang-e')} direction|{verb('head', 'shift', 'com-e')}|set(?:s|ting)? off|{MOVE}|{GO}",
}
STAY = rf"{verb('stay', 'remain')} in (?:place|the same spot)|{verb('stay')} on the spot|{verb('remain')} motionless|(?:is|being|be) motionless|{verb('wait')} without moving|{verb('stay')} still|{STAND} still|{verb('hold', 'keep')} the position"
STAY += rf"|{verb('stay', 'remain')}|{STAND}|positioned"
SHIFT = rf"{verb('adjust', 'correct')} the position(?: with small steps)?|{MOVE} on the spot|(?:{TAKE}|{MAKE}) (?:small(?: adjusting)?|a few short) steps"
SHIFT += rf"|{verb('stay')} in place with small steps|{verb('shift')} the weight and {TAKE} small steps"
SPLIT = (
    rf"{verb('split-step')}|(?:{MAKE}|{verb('perform', 'do')}|{verb('land')} from|{verb('hop')} into|with) a split step"
)
STRETCH = rf"{verb('stretch', 'lung-e')} (?:for|to reach) the ball|{verb('reach')} for the ball|{verb('extend')} the arm for the ball"
HALT = rf"{verb('stop', 'halt')}|{verb('com-e')} to a (?:stop|halt)|(?<=and ){STAND} still"
HIT = verb(
    "hit", "send", "play", "return", "strik-e", "mak-e", "direct", "execut-e", "perform", "meet", "plac-e", "us-e", "respond",
    "knock", "driv-e", "answer", "aim", "put", "deliver", "tak-e", "complet-e", "touch", "push", "repl-y", "receiv-e", "punch",
    "block", "smash", "lift", "lob", "throw", "drop", "dink", "slic-e", "chip", "win", "finish", "scor-e", "serv-e", "open",
    "fir-e", "launch", "fail", "commit", "los-e", "brush", "clip", "toss", "swing", "miss", "guid-e", "steer", "produc-e", "carv-e", "float", "bur-y", "handl-e", "counter", "tr-y", "attempt",
)  # fmt: skip
HIT += rf"|sent|struck|{verb('net')}(?= an? )"
NOUNS = {
    "half_volley": r"half[ -]volley",
    "volley": rf"volley(?: shot)?|{verb('punch', 'block')}",
    "smash": rf"(?:overhead )?{verb('smash')}|overhead(?: shot)?",
    "lob": rf"{verb('lob')}(?: shot)?|{verb('throw')} up(?= an? )|{verb('lift')}",
    "drop": rf"drop shot|dropshot|{verb('drop')}|{verb('dink')}",
    "slice": rf"slice shot|sliced|{verb('slic-e')}|backspin|{verb('chip')}",
    "passing": r"passing(?: shot)?",
}
HARD, SOFT = r"powerful|hard|strong|fierce|heavy", r"soft|gentle|light|delicate|slow"
AREA = r"(?:the )?(?P<area>no man's land|service boxes|service box|service line|baseline|court|field|net)"
SIDE = r"(?P<side>left|right|middle|center|central|ad|deuce)"
NEAR = (
    r"(?:(?P<how>in the direction of|far behind|well behind|deep behind|a little behind|behind|beyond|past|short behind|just over|deep into|deep to|short into"
    r"|short to|short|close to|next to|near|inside|into|in|at|on|(?<!back )(?<!backs )(?<!backing )up to|towards|to|along|across|through|between|long on|out behind|out past)) "
)
PLACES = (
    rf"{NEAR}the (?:front of the )?{SIDE} (?:(?:side|part|end|half) )?of {AREA}",
    rf"{NEAR}{AREA} on the {SIDE}(?: side)?",
    rf"{NEAR}{AREA} in the (?P<side>middle)",
    rf"{NEAR}the (?:front of the )?{SIDE} (?P<area>service box|sideline|back corner|corner|box|doubles alley|tramlines|alley)(?: of the court)?",
    rf"{NEAR}the (?P<area>doubles alley|alley) on the {SIDE}",
    rf"{NEAR}(?P<area>the t)",
    rf"{NEAR}the service line and the (?P<area>baseline)",
    r"at the back of the (?P<area>court)",
    r"to a position (?P<how>behind) the (?P<area>baseline)",
    rf"{NEAR}{AREA}",
    rf"{NEAR}the {SIDE} side (?P<area>of the court)",
    r"on the (?P<side>deuce|ad) (?P<area>side)|in the (?P<side_>deuce|ad) (?P<area_>court)",
)


PREPARE, WAIT = verb("prepar-e"), verb("wait")
READY = r"(?:get|gets|getting|is|being|be) ready"


RESULTS = {
    "let": r"clips the net, let|touches the net, let|brushes the net for a let|a let(?: off the net cord)?",
    "clip": r"off the net cord|over the net cord|clips the net(?!, let)|touches the net(?!, let)",
    "net": rf"into the net|in the net|(?:hit|hits|hitting) the net|the net stops it|(?<!just )over the net(?= |$)|{verb('net')}(?= an? )",
    "double_fault": r"double fault",
    "fault": r"fault",
    "out": r"out of bounds|out of the field|out of the court|outside of the court",
    "ace": r"aces?",
    "winner": rf"for a winner|a winner|(?:{verb('win', 'finish')}) the point|{verb('scor-e')}",
}
NET_WAYS = {
    "forward": r"forwards? towards the net|towards the net|in the direction of the net|closer to the net",
    "back": r"back from the net|away from the net",
}


RECOVER = rf"(?:back|{verb('recover')}|(?<!hand ){verb('return')}) (?:(?:to|towards) (?:the middle|the center)(?: of the court)?(?! of)|to a central position)"
