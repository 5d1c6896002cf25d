"""Words of English whose part of speech the tagger of captions knows, without a model and without a network.

Closed classes are whole; open ones hold what people say of players, balls, courts and worlds of blocks. The parts
are those of the universal tag set, which the paper's table has too: every `to` is a particle there.
"""

DETERMINERS = frozenset(
    "the a an this that these those each every any some no all both another either neither its his her their my your "
    "our what which whose".split()
)
PRONOUNS = frozenset(
    "he she it they we i you him them us me himself herself itself themselves who whom something nothing anything "
    "everything someone nobody one's he's she's it's".split()
)
PREPOSITIONS = frozenset(
    "of in on at by with from into onto for over under behind beyond between through across along near inside outside "
    "towards toward around about after before during until till past above below against among beside within without "
    "off upon via like as while when because since if although though that's than".split()
)
CONJUNCTIONS = frozenset("and or but nor yet plus".split())
PARTICLES = frozenset(["to", "'s"])
PHRASAL = frozenset("up out down off over away back".split())
"""Particles where they follow a verb and no noun comes after them; else adverbs or prepositions."""
NUMERALS = frozenset("one two three four five six seven eight nine ten eleven twelve hundred thousand".split())
ADVERBS = frozenset(
    "again almost already also always away backward backwards forward forwards sideways sideway then there here now "
    "never not still soon too very well just only once twice together apart ahead aside upward upwards downward "
    "downwards halfway far fast hard instead rather quite next before later deep wide high low straight long "
    "north south east west northeast northwest southeast southwest clockwise counterclockwise anticlockwise "
    "crosscourt diagonally even how where why up out down abroad so maybe perhaps inwards outwards".split()
)
ADJECTIVES = frozenset(
    "other own same different left right near far central main middle big small large little short long high low wide "
    "deep close open ready good bad better best powerful strong heavy light soft hard flat slow fast quick gentle "
    "fierce delicate sharp slight full half single double two-handed one-handed handed impossible possible still "
    "motionless opposite intermediate wooden red green blue white black grey brown yellow purple orange stone birch "
    "decorated first second third last final next previous upper lower top bottom outer inner professional former "
    "neutral awkward dramatic continuous inaccurate soft entire several few many much more most less such unforced "
    "defensive aggressive cross-court level steep narrow broad tall diagonal sufficient able unable due out".split()
)
NOUNS = frozenset(
    "player opponent rival ball court net side line lines baseline racket forehand backhand topspin backspin spin "
    "sidespin service alley tramlines tramline centre center corner field man land man's body arm arms hand hands foot "
    "feet leg legs knee knees head air time point points game set match winner error fault mistake ace direction way "
    "pace speed weight position place spot part end middle area zone box edge space ground floor map platform pillar "
    "stairs ladder block blocks wall tower step steps sidestep sidesteps groundstroke stroke strokes shot shots angle "
    "cord deuce ad advantage partner umpire crowd wrist body reaction inertia anticipation preparation deflection "
    "concentration thoughts breath eyes night bounce bounces response rally jump rotation counters court's t thing "
    "bounds smash dropshot half-volley sprint dirt grass roof bridge".split()
)
VERBS = frozenset(
    """be is are was were been being am has have had having do does did doing done can could will would may might must
    shall should let lets get gets got getting go goes went going gone come comes came coming make makes made making
    take takes took taking taken keep keeps kept keeping put puts putting begin begins began beginning send sends sent
    sending hit hits hitting win wins won winning lose loses lost losing fall falls fell falling fallen run runs ran
    running stand stands stood standing catch catches caught catching throw throws threw throwing strike strikes
    struck striking meet meets met meeting find finds found finding hold holds held holding leave leaves leaving fly
    flies flew flying stretch stretches stretching reach reaches reaching serve serves served serving return returns
    returned returning play plays played playing move moves moved moving stop stops stopped stopping start starts
    started starting walk walks walked walking jog jogs jogged jogging trot trots trotted trotting dart darts darted
    darting dash dashes dashed dashing sprint sprints sprinted sprinting rush rushes rushed rushing race races raced
    racing hurry hurries hurried hurrying shuffle shuffles shuffled shuffling sidestep sidesteps sidestepped
    sidestepping backpedal backpedals backpedaled backpedaling step steps stepped stepping slide slides slid sliding
    jump jumps jumped jumping climb climbs climbed climbing rotate rotates rotated rotating turn turns turned turning
    wait waits waited waiting await awaits awaited awaiting prepare prepares prepared preparing follow follows
    followed following watch watches watched watching look looks looked looking stay stays stayed staying remain
    remains remained remaining rest rests rested resting approach approaches approached approaching retreat retreats
    retreated retreating advance advances advanced advancing charge charges charged charging lunge lunges lunged
    lunging swing swings swung swinging miss misses missed missing try tries tried trying attempt attempts attempted
    attempting fail fails failed failing direct directs directed directing aim aims aimed aiming place places placed
    placing drive drives drove driving driven drop drops dropped dropping lob lobs lobbed lobbing lobing smash smashes
    smashed smashing slice slices sliced slicing chip chips chipped chipping block blocks blocked blocking volley
    volleys volleyed volleying punch punches punched punching push pushes pushed pushing knock knocks knocked knocking
    bounce bounces bounced bouncing land lands landed landing touch touches touched touching clip clips clipped
    clipping brush brushes brushed brushing net nets netted netting toss tosses tossed tossing answer answers answered
    answering reply replies replied replying respond responds responded responding handle handles handled handling
    receive receives received receiving execute executes executed executing perform performs performed performing
    produce produces produced producing use uses used using launch launches launched launching deliver delivers
    delivered delivering counter counters countered countering end ends ended ending finish finishes finished
    finishing complete completes completed completing wander wanders wandered wandering stroll strolls strolled
    strolling amble ambles ambled ambling pace paces paced pacing shift shifts shifted shifting settle settles settled
    settling adjust adjusts adjusted adjusting correct corrects corrected correcting change changes changed changing
    score scores scored scoring concentrate concentrates concentrated concentrating focus focuses focused focusing
    gather gathers gathered gathering observe observes observed observing expect expects expected expecting anticipate
    anticipates anticipated anticipating think thinks thought thinking want wants wanted wanting intend intends
    intended intending realize realizes realized realizing understand understands understood understanding head heads
    headed heading face faces faced facing lead leads led leading pass passes passed passing cross crosses crossed
    crossing extend extends extended extending bend bends bent bending squat squats duck ducks ducked ducking wipe
    wipes wiped wiping celebrate celebrates celebrated celebrating scratch scratches scratching bind touch bolt bolts
    bolted bolting circle circles circled circling enter enters entered entering repeat repeats repeated repeating
    react reacts reacted reacting become becomes became becoming manage manages managed managing delay delays delayed
    delaying guess guesses say says said saying succeed succeeds ricochet ricochets deflect deflects deflected travel
    travels traveled traveling float floats floated floating fire fires fired firing speed speeds speeded speeding
    bury buries buried burying bring brings brought recover recovers recovered recovering scramble scrambles halt
    halts halted halting carve carves carved carving punch dink dinks guide guides guided guiding steer steers steered
    steering collect collects collected collecting commit commits committed committing open opens opened opening close
    closes closed closing clear clears cleared spin spins spun spinning relax relaxes relaxed relaxing fix fixes
    proceed proceeds proceeded proceeding exchange exchanges draw draws force forces forced forcing split splits
    crouch crouches raise raises raised raising lift lifts lifted lifting lower lowers lowered lowering shape shapes
    track tracks tracked tracking chase chases chased chasing dive dives dived diving leap leaps leaped leaping hop
    hops hopped hopping pull pulls pulled pulling whip whips whipped stand""".split()
)
AUXILIARIES = frozenset(
    "is are was were be been being am has have had does do did can could will would may might must shall should".split()
)
ADJECTIVE_ENDINGS = ("ous", "ful", "ible", "able", "less", "ish", "ive", "ic", "al")
NOUN_ENDINGS = ("tion", "sion", "ment", "ness", "ity", "ance", "ence", "er", "or", "ship", "ism")
