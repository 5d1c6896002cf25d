"""The words of captions; see `phrases` for how they are written down.

Slots that a caption fills: `side`, `side2` of ways, `at` of places, `ts` of targets (left, right or middle), `fb`
forehand or backhand, `way`, `gait`, `np` a stroke, `to` a target, `m` a movement, `h` a hit, `w` a wait, `o` what the
other player does, `r` a reason.
"""

from pgm_data.caption.phrases import Grammar, grammar_of

_WAYS = """
way_side = 6* to the {side} | 2* to its {side} | 2* {side} | towards the {side} | 2* to the {side} side
way_forward = 3* forward | 3* towards the net | forward towards the net | closer to the net | up the court
way_back = 3* backwards | 2* back | away from the net | back from the net
way_side_forward = 3* diagonally to the {side} and forward | forward and to the {side} | to the {side} and forward
  | diagonally forward to the {side} | diagonally to the {side} towards the net
way_side_back = 3* diagonally to the {side} and back | backwards and to the {side} | to the {side} and backwards
  | diagonally backwards to the {side} | diagonally to the {side} away from the net
way_compass = 4* {compass} | to the {compass} | towards the {compass}
sprint = <charge> | <bolt> | <dart> | 4* <sprint> | 2* <dash> | <run at full speed> | <race> | 2* <run fast> | <rush>
run = <run quickly> | <hasten> | 6* <run> | 2* <move quickly> | <hurry>
jog = 3* <jog> | 2* <trot> | 2* <move> | <go>
walk = <amble> | <wander> | 5* <walk> | <stroll> | <go slowly> | <move slowly>
sidestep = 5* <sidestep> | 3* <take sidesteps> | 2* <shuffle> | <move with sidesteps> | <take side steps>
backpedal = 3* <backpedal> | <move with backward steps> | <retreat>
step = 3* <take a step> | 2* <step> | <make a short step> | <take a small step> | <make a step>
move = <advance> | <shift> | <proceed> | <make its way> | 9* <move> | 2* <go> | <head> | <travel>
moves = 5* {gait} {way} {goal} {after_motion} | {gait} {way} {after_motion}
stops = and <stop> | and then <stop> | , then <stop> | and <come to a halt> | and <come to a stop>
starts = 4* <start> to {gait:to} {way} | 2* <begin> to {gait:to} {way} | <set> off {way}
turns = 3* {gait} {way} and then {again} | {gait} {way} , then {again} | first {gait} {way} and then {again}
  | {gait} {way} before {again:ing}
again_side = 3* <move back to the {side2}> | <return to the {side2}> | <change direction to the {side2}>
  | <come back to the {side2}>
again_forward = <come forward> | <move towards the net again> | <move forward again>
again_back = <move backwards> | <step back again> | <retreat>
again_compass = <go back> {compass2} | <turn> {compass2} | <move> {compass2}
still = <remain motionless> | <stay still> | <keep the position> | <remain in the same spot> | 3* <stand still>
  | 2* <stay in place> | 2* <remain in place> | <hold the position> | <stay on the spot>
still_at = 6* {still} | 3* <stand {spot}> | 2* <stay {spot}> | 2* <remain {spot}> | <hold the position {spot}>
  | <wait {spot}>
shifts = 3* <adjust the position> | 2* <take small steps> | <take a few short steps> | <make small adjusting steps>
shifts_at = 2* <adjust the position {spot}> | <take small steps {spot}> | <make small steps {spot}>
split = 3* <make a split step> | <perform a split step> | <do a split step> | <hop into a split step>
split_before = 3* {split} and then {inner} | {split} and {inner} | 2* {inner}
then_split = 2* and <make a split step> | and <perform a split step> | with a split step | , then <make a split step>
centre = 3* <return to the middle> | 2* <recover to the middle> | <move back to the center>
  | 2* <come back to the center>
  | <recover towards the center of the court> | <return to the center of the court> | <get back to the middle>
unclear = 3* <move about> | <move around> | <move>
unclear_at = 3* <move about {spot}> | <move around {spot}>
jump = <jump> | 2* <jump> | <leap> | <make a jump>
rise = <get higher> | <climb up> | <move up> | <go up>
fall = <come down> | <go down> | <descend> | <fall to lower ground>
rotate = 3* <rotate> {sense} | <turn> {sense} | <spin> {sense}
"""

_PLACES = """
base = 3* the {at} side of the baseline | the {at} part of the baseline | the {at} end of the baseline
base_middle = the middle of the baseline | the center of the baseline
goal_baseline = to the baseline | towards the baseline
goal_baseline_side = to {base} | towards {base}
goal_baseline_middle = to {base_middle} | towards {base_middle}
goal_behind = behind the baseline | to a position behind the baseline
goal_behind_side = behind {base} | behind the baseline on the {at} side
goal_behind_middle = behind {base_middle}
goal_far = far behind the baseline | deep behind the baseline
goal_far_side = far behind {base} | deep behind the baseline on the {at} side
goal_far_middle = far behind {base_middle}
goal_land = 2* into no man's land | to no man's land | inside the baseline
goal_land_side = 2* to the {at} side of no man's land | into the {at} side of no man's land
goal_land_middle = to the middle of no man's land | into the center of no man's land
goal_line = to the service line | up to the service line
goal_line_side = to the {at} side of the service line
goal_line_middle = to the middle of the service line | to the center of the service line
goal_box = into the service box | into the service boxes
goal_box_side = into the {at} service box | to the {at} service box
goal_box_middle = to the middle of the service boxes
goal_net = to the net | up to the net | close to the net
goal_net_side = to the {at} side of the net | close to the net on the {at} side
goal_net_middle = to the middle of the net | close to the middle of the net
goal_back = to the back of the court | into the back of the court
goal_back_side = to the {at} side of the back of the court | to the back of the court on the {at} side
goal_back_middle = to the middle of the back of the court
spot_baseline = at the baseline | near the baseline | close to the baseline
spot_baseline_side = at {base} | near {base} | at the baseline on the {at} side
spot_baseline_middle = at {base_middle} | near {base_middle}
spot_behind = behind the baseline | a little behind the baseline
spot_behind_side = behind {base} | behind the baseline on the {at} side
spot_behind_middle = behind {base_middle}
spot_far = far behind the baseline | well behind the baseline
spot_far_side = far behind {base} | well behind the baseline on the {at} side
spot_far_middle = far behind {base_middle} | well behind {base_middle}
spot_land = in no man's land | inside the baseline
spot_land_side = in the {at} side of no man's land | inside the baseline on the {at} side
spot_land_middle = in the middle of no man's land | inside the baseline in the middle
spot_line = at the service line | near the service line
spot_line_side = at the {at} side of the service line
spot_line_middle = at the middle of the service line | near the center of the service line
spot_box = in the service box | inside the service boxes
spot_box_side = in the {at} service box | inside the {at} service box
spot_box_middle = in the middle of the service boxes
spot_net = at the net | close to the net | near the net
spot_net_side = at the net on the {at} side | close to the net on the {at} side
spot_net_middle = at the middle of the net | close to the middle of the net
spot_back = at the back of the court
spot_back_side = at the back of the court on the {at} side
spot_back_middle = at the back of the court in the middle
"""

_TARGETS = """
to_box = 3* to the {ts} service box | 2* into the {ts} service box | to the service box on the {ts}
  | into the service box on the {ts} side
to_box_plain = into the service box | to the service boxes | inside the service line
to_short_box = short into the {ts} service box | to the front of the {ts} service box
  | just over the net on the {ts} side
to_short = just over the net | short behind the net
to_land_side = 4* to the {ts} side of no man's land | 3* to the {ts} side of the no man's land
  | into no man's land on the {ts} side | to the {ts} part of no man's land
to_land_middle = 2* to the middle of no man's land | to the center of no man's land
  | into the middle of the no man's land
to_land = 2* to no man's land | into no man's land | between the service line and the baseline
to_deep_side = deep to the {ts} side of the baseline | close to the baseline on the {ts} side
  | deep into the {ts} side
  | to the {ts} side of the baseline
to_deep_middle = deep to the middle of the baseline | close to the middle of the baseline | deep to the center
to_deep = deep to the baseline | close to the baseline | deep into the court
to_corner = to the {ts} corner | deep into the {ts} corner | to the {ts} back corner | to the {ts} corner of the court
to_sideline = close to the {ts} sideline | near the {ts} sideline | next to the {ts} sideline | to the {ts} sideline
to_far = to the back of the court | deep into the court
to_far_side = deep to the {ts} side | to the {ts} side of the back of the court
to_far_middle = deep to the middle | to the middle of the back of the court
to_side = to the {ts} side of the court | to the {ts} half of the court | towards the {ts} side of the court
to_middle = to the middle of the court | to the center of the court | towards the middle of the court
to_court = into the court | back into the court | over the net
course_cross = 2* cross-court | crosscourt | across the court
course_line = 4* down the line | down the {ts} line | along the {ts} sideline
course_middle = down the middle | through the middle
out_plain = 2* out | out of bounds | out of the court | out of the field
out_long = 2* long | behind the baseline | beyond the baseline | over the baseline | too long
out_wide = wide to the {ts} | past the {ts} sideline | wide of the {ts} sideline | out on the {ts} side
out_serve_long = 2* long | behind the service line | past the service line | too long
"""

_STROKES = """
hard = fierce | powerful | hard | strong | fast
soft = delicate | light | soft | gentle | slow
topspin = 3* topspin | spinning
flat = flat
slice = sliced | slice
two = two-handed | double-handed
one = one-handed | single-handed
np_side = 6* a(n) {quality} {hands} {fb} | a(n) {quality} {hands} {fb} shot | a(n) {quality} {fb} stroke
np_groundstroke = 6* a(n) {quality} {hands} {fb} | a(n) {quality} {hands} {fb} shot | a(n) {quality} {fb} groundstroke
np_slice = 3* a(n) {hands} {fb} slice | 2* a(n) sliced {hands} {fb} | a(n) {fb} slice shot
np_volley = 3* a(n) {quality} {hands} {fb} volley | a(n) {fb} volley shot
np_half_volley = 2* a(n) {fb} half volley | a(n) {quality} {fb} half volley
np_smash = 3* a(n) {quality} smash | 2* a(n) {quality} overhead smash | a(n) overhead
np_lob = 3* a(n) {fb} lob | a(n) lob with the {fb} | a high {fb} lob
np_drop = 3* a(n) {fb} drop shot | a drop shot with the {fb}
np_overhead = an overhead shot | an overhead | a(n) {quality} overhead shot
np_plain = a(n) {quality} shot | a(n) {quality} stroke
np_volley_plain = a(n) {quality} volley
np_half_volley_plain = a(n) half volley
np_lob_plain = a lob | a high lob
np_drop_plain = a drop shot
np_serve = 4* a(n) {quality} serve | a(n) {quality} serve
np_return = 3* {np} | a return | a(n) {quality} return
hits = <guide> the ball {to} with {np} | <steer> the ball {to} with {np} | <execute> {np} {to} | <perform> {np} {to}
  | <respond> with {np} {to} | <deliver> {np} {to} | <use> {np} to send the ball {to}
  | 6* <hit> the ball {to} with {np} | 5* <send> the ball {to} with {np} | 4* <hit> {np} {to} | 2* <play> {np} {to}
  | 2* <hit> the ball with {np} that sends the ball {to} | 2* <hit> {np} that sends the ball {to}
  | <strike> the ball {to} with {np} | <direct> the ball {to} with {np} | <place> the ball {to} with {np}
  | <make> {np} that sends the ball {to} | <meet> the ball with {np} and <send> it {to}
  | <drive> the ball {to} with {np}
hits_bare = 3* <hit> {np} | <play> {np} | <hit> the ball with {np} | <strike> the ball with {np}
returns = 3* <return> the serve {to} with {np} | 2* <return> the serve with {np} {to}
  | 2* <answer> the serve with {np} {to}
  | <send> the serve back {to} with {np} | 2* {hits}
returns_bare = 2* <return> the serve with {np} | <answer> the serve with {np} | {hits_bare}
strikes = 3* <hit> the ball {to} | 2* <send> the ball {to} | <strike> the ball {to} | <play> the ball {to}
strikes_bare = <meet> the ball | <make contact> with the ball | 3* <hit> the ball | 2* <strike> the ball
  | <play> the ball
serves = <fire> {np} {to} | <launch> {np} {to} | <execute> {np} {to} | <place> {np} {to} | 4* <serve> {to}
  | 4* <hit> {np} {to} | 2* <serve> the ball {to} | 2* <send> {np} {to} | <deliver> {np} {to}
  | <hit> {np} that sends the ball {to} | <open> the point with {np} {to}
serves_bare = 4* <serve> | 3* <hit> {np} | 2* <serve> the ball | <strike> {np}
aces = 2* <serve> an ace {to} | 2* <hit> an ace {to} | <win> the point with an ace {to}
wins = 2* <hit> {np} {to} for a winner | <hit> a winner {to} with {np} | <win> the point with {np} {to}
  | <send> the ball {to} with {np} and <win> the point
nets = 3* <hit> {np} into the net | 3* <send> the ball into the net with {np} | <hit> the net with {np}
  | <make> a mistake with {np} and <hit> the net | <hit> the ball into the net with {np}
  | <make> {np} that ends in the net
outs = 3* <hit> {np} {out} | 3* <send> the ball {out} with {np} | <make> a mistake with {np} and <send> the ball {out}
  | <hit> {np} but <send> the ball {out} | <hit> {np} that lands {out} | <make> {np} but the ball lands {out}
serve_nets = 2* <serve> into the net | 2* <hit> {np} into the net | <serve> the ball into the net
  | <hit> the net with {np}
serve_outs = 2* <serve> {out} | 2* <hit> {np} {out} | <make> {np} that lands {out} | <serve> but the ball lands {out}
lets = <serve> but the ball touches the net , let | <hit> {np} that clips the net , let
  | <serve> a let off the net cord
"""

_WAITS = """
wait_serve = <concentrate> on the serve of the opponent | <focus> on the return | <be> ready for the serve
  | 3* <wait> for the serve | 2* <get ready> to return the serve | 2* <prepare> to receive the serve
  | <wait> for the opponent to serve | <await> the serve | <prepare> to return the serve
wait_ball = <anticipate> the return | <expect> the response of the opponent | <observe> the opponent
  | <look> at the opponent | 3* <wait> for the return | 2* <wait> for the opponent's shot | <watch> the opponent
  | <wait> for the ball
  | <get ready> for the next shot | <prepare> for the opponent's next shot | <stay ready> for the return
prepare_serve = <concentrate> before the serve | <gather> concentration for the serve | 3* <prepare> to serve
  | 2* <get ready> to serve | <prepare> for the serve | <be> about to serve
prepare_hit = <get> in position for a(n) {fb} | 3* <prepare> to hit a(n) {fb} | <get ready> to hit a(n) {fb}
  | <set up> for a(n) {fb}
prepare = 2* <prepare> to hit the ball | <get ready> to hit the ball | <prepare> for the shot
watch = <observe> the ball | <keep the eyes> on the ball | 3* <watch> the ball | <look> at the ball
  | <follow> the ball with the eyes
after = once the point has ended | as the rally has ended | now that the point is over | with the point over
  | after the point | at the end of the point | when the point is over | after the rally
after_fault = after the fault | after the missed serve | because the serve was a fault
"""

_REASONS = """
opp = the rival | 4* the opponent | 2* opponent | the other player
o_serve = 3* <serve> | 2* <hit> the serve | <serve> the ball | <play> the serve
o_hit = 3* <hit> {onp} | <play> {onp} | <strike> the ball with {onp}
o_plain = 3* <hit> the ball | 2* <return> the ball | <send> the ball back | <play> the ball
onp_side = a(n) {ofb} | a(n) {ofb} shot
onp_volley = a(n) {ofb} volley
onp_volley_plain = a volley
onp_smash = a smash
onp_lob = a lob
onp_drop = a drop shot
r_opp_net = 3* {opp} <hit> the net | 2* {opp} <send> the ball into the net | {opp} <make> a mistake and <hit> the net
  | the shot of the opponent ends in the net | {opp} <hit> the ball into the net
r_opp_out = 3* {opp} <send> the ball out | 2* {opp} <send> the ball out of the field | 3* the ball goes out of bounds
  | the shot of the opponent lands out | the ball lands out | {opp} <make> a mistake and the ball goes out
r_opp_winner = 2* the ball is out of reach | {opp} <win> the point | {opp} <hit> a winner
  | the ball goes past the player
r_opp_ace = {opp} <serve> an ace | the serve goes past the player | {opp} <win> the point with an ace
r_opp_fault_net = the serve hits the net | {opp} <serve> into the net | the serve ends in the net
r_opp_fault_out = the serve is out | {opp} <serve> out | the serve lands out | the serve goes out
r_own_net = 2* the ball hits the net | the ball ends in the net | the ball lands in the net
r_own_out = 2* the ball goes out | the ball lands out | the ball goes out of bounds
r_own_winner = {opp} <do> not reach the ball | {opp} can not reach the ball | the player wins the point
r_own_fault_net = the serve hits the net | the serve ends in the net
r_own_fault_out = the serve is out | the serve lands out | the serve goes out
fails = 3* can not reach the ball | <fail> to reach the ball | <do> not reach the ball
"""

_FRAMES = """
you = 15* the player | player
say_m = 5* {you} {m} | {you} is {m:ing}
say_ms = {you} {m}
say_h = {you} {h}
say_mh = 8* {you} {m} and {h} | 3* {you} {m} and then {h} | 2* {you} {m} , then {h}
  | 2* after {m:ing} , the player {h}
  | 2* {you} {h} after {m:ing} | {m:ing} , the player {h} | {you} {m} before {h:ing}
say_spot_h = {spot} , the player {h} | {you} , {spot} , {h}
say_mw = 5* {you} {m} and {w} | 2* {you} {m} to {w:to} | {m:ing} , the player {w} | {you} {m} , then {w}
say_sw = 4* {you} {m} and {w} | 2* {you} {w} while {m:ing} | {you} {m} , {w:ing}
say_w = 4* {you} {w} | {you} is {w:ing}
say_wspot = 3* {you} {w} {spot} | {spot} , the player {w}
say_mo = 3* {you} {m} as {opp} {o} | 2* {you} {m} while {opp} {o} | 2* {you} {m} when {opp} {o}
  | as {opp} {o} , the player {m}
say_wo = 3* {you} {w} as {opp} {o} | as {opp} {o} , the player {w} | {you} {w} until {opp} {o}
say_mr = 3* {you} {m} as {r} | 2* {you} {m} when {r} | {you} {m} , {r} | as {r} , the player {m}
say_sr = 3* {you} {m} , because {r} | 2* {you} {m} because {r} | {you} {m} as {r}
say_mf = 3* {you} {m} but {fails} | {you} {m} , but {fails}
say_wr = 3* {you} {w} as {r} | {you} {w} when {r} | as {r} , the player {w}
say_ma = 2* {you} {m} {since} | {since} , the player {m}
"""

GRAMMAR: Grammar = grammar_of(_WAYS + _PLACES + _TARGETS + _STROKES + _WAITS + _REASONS + _FRAMES)
