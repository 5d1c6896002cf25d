"""The words of tennis captions; see `phrases` for how they are written down.

Slots that captions fill. Words: `side` and `side2` of moves, `at` of places, `ts` of targets (each left or right), `fb`
forehand or backhand, `dc` deuce or ad, `nth` first or second. Symbols by another name: `m` a motion, `h` a hit, `w` a
wait, `r` and `o` what else happens, and the parts of these.
"""

from pgm_data.simulate.tennis.phrases import Grammar, parse_grammar

_WAYS = """
way_side: 8* to the {side} | 2* {side} | to its {side} | towards the {side} | 2* to the {side} side
  | to its {side} side
way_forward: 3* forward | 2* towards the net | forward towards the net | in the direction of the net
  | closer to the net | forwards
way_back: 2* back | 2* backwards | away from the net | back from the net | backward
way_side_forward: 2* diagonally to the {side} and forward | diagonally forward to the {side}
  | forward and to the {side} | to the {side} and forward | diagonally to the {side} towards the net
  | forward and {side} | diagonally {side} and forward
way_side_back: 2* diagonally to the {side} and back | diagonally backwards to the {side} | backwards and to the {side}
  | to the {side} and backwards | diagonally to the {side} away from the net | backwards and {side}
  | diagonally {side} and back
"""

_MOVES = """
sprint: [charge] at full speed | 4* [sprint] | [dash] | [dart] | [run] at full speed | [race] | [bolt] | 2* [run] fast
run: 6* [run] | [rush] | [hurry] | 3* [move] | [go] | [race] | [speed] | [charge]
jog: 2* [jog] | [trot] | 2* [move] | [go] | [head]
walk: 5* [walk] | [stroll] | [amble] | [wander] | [pace] | [go] | [move]
sidestep: 4* [sidestep] | [take] side steps | [take] quick sidesteps | 2* [shuffle] | 2* [take] sidesteps
  | [make] side steps | [move] with side steps | [shift] | [move]
backpedal: 2* [backpedal] | 2* [retreat] | 2* [move]
retreat: [fall] back | 2* [backpedal] | [retreat] | 2* [back] up | [move] backwards
way_retreat: 4* | away from the net
step: [take] a short step | [make] a little step | 3* [step] | 2* [take] a step | [take] a small step | [make] a step
  | [move] a little | [shift]
go: [proceed] | [travel] | 5* [move] | 2* [go] | [head] | [shift] | [make] its way
fast: quickly | swiftly | rapidly | in a hurry
slow: slowly | at a slow pace | without hurry
move: 4* {gait} {pace} {way} {goal} {purpose} | {gait} {way} {pace} {goal} {purpose}
move_halt: {move} {halt}
halt: and [come] to a halt | 4* and [stop] | and then [stop] | and [come] to a stop | and [halt] | , then [stop]
  | and [stand] still
start: 3* [start] to {gait+inf} {way} | [begin] to {gait+inf} {way} | 2* [start] {gait+ing} {way}
  | [begin] {gait+ing} {way} | [set] off {way}
turn: 2* {gait} {way} and then {again} | {gait} {way} , then {again} | first {gait} {way} and then {again}
  | {gait} {way} before {again+ing} | {gait} {way} , [turn] around and {again}
again_side: 2* [move] back to the {side2} | [return] to the {side2} | [come] back to the {side2}
  | [go] back to the {side2} | [change] direction to the {side2}
again_forward: [move] forward again | [come] forward | [move] towards the net again
again_back: [move] backwards | [go] backwards again | [retreat]
still: [stay] on the spot | [remain] motionless | [be] motionless | [wait] without moving | 3* [stay] in place
  | 2* [remain] in place | 3* [stand] still | [stay] still | [hold] the position | [keep] the position
  | [remain] in the same spot
still_at: [remain] motionless {spot} | [wait] without moving {spot} | 3* [stay] {spot} | 2* [remain] {spot}
  | 3* [stand] {spot} | [stand] still {spot} | [stay] in place {spot} | [hold] the position {spot}
shifts: [move] on the spot | [correct] the position | 2* [adjust] the position | [take] small steps
  | [adjust] the position with small steps | [make] small adjusting steps | [take] a few short steps
  | [stay] in place with small steps | [shift] the weight and [take] small steps
shifts_at: [adjust] the position {spot} | [take] small steps {spot} | [make] small steps {spot}
  | [take] a few short steps {spot} | [adjust] the position with small steps {spot}
split: 4* [make] a split step | [perform] a split step | [do] a split step | [land] from a split step
  | [hop] into a split step | [split-step]
then_split: 2* and [make] a split step | , [make] a split step | with a split step | and then [split-step]
  | and [perform] a split step
stretch: 2* [stretch] for the ball | [lunge] for the ball | [reach] for the ball | [stretch] to reach the ball
  | [lunge] to reach the ball | [extend] the arm for the ball
recover: 3* [return] {recover_goal} | 2* [recover] {recover_goal} | [move] back {recover_goal}
  | [come] back {recover_goal} | [get] back {recover_goal} | [go] back {recover_goal} | {gait} back {recover_goal}
recover_goal: 2* to the middle | 2* to the center | to the middle of the court | to the center of the court
  | towards the center | to a central position
purpose_reach: 3* to reach the ball | 2* to get to the ball | to hit the ball | to catch up with the ball
  | after the ball | chasing the ball
along: along the baseline | across the baseline | along the baseline
moved: {first} {motion} {effort} {then}
first_split: 3* [make] a split step and then | [make] a split step and | [split-step] and
  | [perform] a split step and then
"""

_PLACES = """
base_side: the {at} side of the baseline | the {at} part of the baseline | the {at} end of the baseline
base_middle: the middle of the baseline | the center of the baseline | the central part of the baseline
land_np_side: the {at} side of no man's land | the {at} side of the no man's land | the {at} part of no man's land
land_np_middle: the middle of no man's land | the center of no man's land
goal_baseline_side: to {base_side} | towards {base_side}
goal_baseline_middle: to {base_middle} | towards {base_middle}
goal_baseline: to the baseline | towards the baseline
goal_behind_side: behind {base_side} | behind the baseline on the {at} side
goal_behind_middle: behind {base_middle} | behind the baseline in the middle
goal_behind: behind the baseline | to a position behind the baseline
goal_far_back_side: far behind {base_side} | deep behind the baseline on the {at} side
goal_far_back_middle: far behind {base_middle}
goal_far_back: far behind the baseline | well behind the baseline
goal_land_side: to {land_np_side} | into {land_np_side}
goal_land_middle: to {land_np_middle} | into {land_np_middle}
goal_land: to no man's land | into no man's land | inside the court
goal_service_line_side: to the {at} side of the service line
goal_service_line_middle: to the middle of the service line | to the t
goal_service_line: to the service line
goal_box_side: into the {at} service box | to the {at} service box
goal_box_middle: to the middle of the service boxes
goal_box: into the service box
goal_net_side: to the {at} side of the net | close to the net on the {at} side
goal_net_middle: to the middle of the net | close to the net in the middle
goal_net: to the net | up to the net | close to the net
spot_baseline_side: at {base_side} | near {base_side} | on {base_side} | at the baseline on the {at} side
spot_baseline_middle: at {base_middle} | near {base_middle} | in the middle of the baseline
spot_baseline: at the baseline | near the baseline | close to the baseline | on the baseline
spot_behind_side: behind {base_side} | behind the baseline on the {at} side
spot_behind_middle: behind {base_middle} | behind the baseline in the middle
spot_behind: behind the baseline | at the back of the court | a little behind the baseline
spot_far_back_side: far behind {base_side} | deep behind the baseline on the {at} side
spot_far_back_middle: far behind {base_middle} | well behind the center of the baseline
spot_far_back: far behind the baseline | well behind the baseline | deep behind the baseline
spot_land_side: in {land_np_side} | inside the court on the {at} side
spot_land_middle: in {land_np_middle} | inside the court in the middle
spot_land: in no man's land | inside the court | in the no man's land
spot_service_line_side: at the {at} side of the service line | near the {at} side of the service line
spot_service_line_middle: at the t | at the middle of the service line
spot_service_line: at the service line | near the service line
spot_box_side: in the {at} service box | inside the {at} service box
spot_box_middle: in the middle of the service boxes
spot_box: in the service box | inside the service box
spot_net_side: at the net on the {at} side | close to the net on the {at} side
spot_net_middle: at the middle of the net | close to the net in the middle
spot_net: at the net | close to the net | near the net
spot_dc: 2* on the {dc} side | on the {dc} side of the court | in the {dc} court
"""

_TARGETS = """
to_tee: to the t | near the t | close to the t | on the t
to_box: 3* to the {ts} service box | 2* into the {ts} service box | into the service box on the {ts}
  | to the service box on the {ts} side | to the {ts} side of the service boxes
to_boxes: to the middle of the service boxes | into the middle of the service boxes
  | to the center of the service boxes
to_deuce_box: to the {dc} service box | into the {dc} service box | into the {dc} box | to the {dc} box
to_short_box: short into the {ts} service box | to the front of the {ts} service box | short to the {ts} service box
to_front_side: just over the net on the {ts} side | short behind the net on the {ts}
  | close to the net on the {ts} side
to_front_middle: just over the middle of the net | short behind the middle of the net
to_front: just over the net | short behind the net | close to the net
to_land_side: 4* to the {ts} side of no man's land | 3* to the {ts} side of the no man's land
  | into no man's land on the {ts} side | to the {ts} part of no man's land | into the {ts} side of no man's land
to_land_middle: 2* to the middle of no man's land | to the center of no man's land
  | into the middle of the no man's land | to the central part of no man's land
to_land: 2* to no man's land | into no man's land | to the no man's land | between the service line and the baseline
to_corner_side: to the {ts} corner | deep into the {ts} corner | to the {ts} corner of the court
  | into the {ts} back corner
to_baseline_side: 2* to the {ts} side of the baseline | close to the baseline on the {ts} side
  | near the {ts} side of the baseline | deep to the {ts} side of the baseline
to_baseline_middle: to the middle of the baseline | near the center of the baseline
  | deep to the middle of the baseline | close to the middle of the baseline
to_baseline: deep to the baseline | near the baseline | close to the baseline
to_service_line_side: to the {ts} side of the service line | near the service line on the {ts} side
  | close to the {ts} side of the service line
to_service_line_middle: to the middle of the service line | near the center of the service line
to_service_line: to the service line | near the service line | close to the service line
to_sideline_side: to the {ts} sideline | close to the {ts} sideline | near the {ts} sideline
  | next to the {ts} sideline
to_half_side: 2* to the {ts} side of the court | to the {ts} half of the court | into the {ts} half of the court
  | to the {ts} side of the field | to the {ts}
to_half_middle: to the middle of the court | to the center of the court | into the middle of the court
  | to the middle of the field | to the middle
course_cross: 2* cross court | crosscourt | across the court
course_line: 3* down the line | down the {ts} line
course_middle: down the middle | through the middle
serve_tee: down the t | down the middle | along the center line
serve_body: at the body of the opponent | into the body of the opponent | at the opponent's body
serve_wide: 2* wide | with a wide angle
out_plain: out | out of bounds | out of the field | out of the court | outside of the court
out_long: 2* long | out past the baseline | behind the baseline | over the baseline and out | beyond the baseline
  | too long | too deep
out_long_side: past the {ts} side of the baseline | long on the {ts} side | out behind the {ts} side of the baseline
out_wide: out past the {ts} sideline | wide of the {ts} sideline | out to the {ts} | too wide to the {ts}
  | beyond the {ts} sideline
out_alley: into the {ts} doubles alley | into the {ts} tramlines | out into the {ts} alley
  | out into the alley on the {ts}
out_service_long: long | past the service line | behind the service line | beyond the service line | too long
out_box_wide: out to the {ts} | out past the {ts} sideline | too wide to the {ts}
"""

_STROKES = """
hard: powerful | hard | strong | fierce | heavy
soft: soft | gentle | light | delicate | slow
topspin: topspin | topspin | spinning
heavy_topspin: heavy topspin | topspin
flat: flat
two_handed: two-handed | double-handed | two-hand
one_handed: one-handed | single-handed | one-hand
np_drive: 6* A {adj} {hands} {fb} | A {adj} {hands} {fb} shot | A {adj} {hands} {fb} drive
  | A {adj} {hands} {fb} stroke | A {adj} {hands} {fb} groundstroke
np_slice: 3* A {adj} {hands} {fb} slice | A {adj} sliced {hands} {fb} | A {adj} {fb} slice shot | A {fb} with slice
  | A {hands} {fb} with backspin
np_volley: 3* A {adj} {hands} {fb} volley | A {adj} {fb} volley shot
np_half_volley: 2* A {adj} {hands} {fb} half volley | A {fb} half-volley
np_smash: 3* A {adj} smash | 2* A {adj} overhead smash | A {adj} overhead | A {adj} overhead shot
np_lob: 3* A {hands} {fb} lob | A lob with the {fb} | A {fb} lob shot
np_lob_plain: A lob | A lob shot
np_drop: 3* A {hands} {fb} drop shot | A drop shot with the {fb} | A {fb} dropshot
np_passing: A {adj} {hands} {fb} passing shot | A passing shot with the {fb} | A passing {fb}
np_return: 2* A {adj} {hands} {fb} return | A return with the {fb} | 2* {np}
np_serve: 4* A {adj} {nth} serve | A {nth} {adj} serve | A {adj} serve
serve_flat: flat
serve_kick: kick | topspin
serve_slice: slice | sliced
hit_in: [guide] the ball {to} with {np} | [steer] the ball {to} with {np} | [produce] {np} {to}
  | [place] the ball {to} with {np} | 6* [hit] the ball {to} with {np} | 6* [send] the ball {to} with {np}
  | 5* [hit] {np} {to} | 3* [play] {np} {to} | 2* [return] the ball {to} with {np} | [strike] the ball {to} with {np}
  | [make] {np} that sends the ball {to} | 2* [hit] {np} that sends the ball {to}
  | 2* [hit] the ball with {np} that sends the ball {to} | [direct] the ball {to} with {np} | [execute] {np} {to}
  | [perform] {np} {to} | [meet] the ball with {np} and [send] it {to} | [place] {np} {to}
  | [use] {np} to send the ball {to} | [respond] with {np} {to} | [knock] the ball {to} with {np}
  | [drive] the ball {to} with {np} | [answer] with {np} {to} | [aim] {np} {to} | [put] the ball {to} with {np}
  | [deliver] {np} {to} | [take] the ball with {np} and [direct] it {to} | [complete] {np} {to}
  | [touch] the ball with {np} and [push] it {to}
hit_return: [handle] the serve with {np} and [send] the ball {to} | [counter] the serve with {np} {to}
  | 3* [return] the serve {to} with {np} | 2* [return] the serve with {np} {to} | [answer] the serve with {np} {to}
  | [send] the serve back {to} with {np} | [hit] {np_return} {to} | [reply] to the serve with {np} {to}
  | [receive] the serve with {np} and [send] the ball {to} | 3* {hit_in}
hit_aim: 2* [hit] {np} towards {aim} | [aim] {np} at {aim} | [send] the ball towards {aim} with {np}
  | [hit] the ball in the direction of {aim} with {np} | [play] {np} towards {aim} | [direct] {np} towards {aim}
aim_side: the {ts} side of the court | the {ts} half of the court | the {ts} side
aim_middle: the middle of the court | the center of the court
hit_clips: [hit] {np} {to} off the net cord | [send] the ball over the net cord {to} with {np}
  | [hit] {np} that touches the net and falls {to}
hit_volley: [punch] {np} {to} | [block] the ball {to} with {np} | 4* {hit_in}
hit_smash: [smash] the ball {to} | 2* [hit] {np} {to} | 2* {hit_in}
hit_lob: [lift] {np} {to} | [lob] the ball {to} with the {fb} | [throw] up {np} {to} | 3* {hit_in}
hit_lob_plain: [lift] {np} {to} | [lob] the ball {to} | 2* {hit_in}
hit_drop: [drop] the ball {to} with {np} | [dink] {np} {to} | 3* {hit_in}
hit_slice: [carve] {np} {to} | [float] {np} {to} | [slice] the ball {to} with the {fb} | [slice] A {fb} {to}
  | [chip] {np} {to} | 5* {hit_in}
hit_net: [make] a mistake with {np} and [hit] the net | [bury] {np} in the net | 3* [hit] {np} into the net
  | 3* [send] the ball into the net with {np} | [hit] the ball into the net with {np} | 2* [hit] the net with {np}
  | [hit] {np} but the ball ends in the net | [net] {np} | [make] {np} that hits the net
  | [fail] to get {np} over the net | [hit] the ball with {np} but the net stops it
  | [play] {np} that lands in the net | [put] {np} into the net | [make] an error with {np} and [hit] the net
hit_out: [make] a mistake with {np} and [send] the ball {out} | 3* [hit] {np} {out}
  | 3* [send] the ball {out} with {np} | 2* [hit] the ball {out} with {np} | [hit] {np} but [send] the ball {out}
  | [hit] {np} that lands {out} | [make] {np} but the ball goes {out}
  | [make] an error with {np} and [send] the ball {out} | [put] {np} {out} | [play] {np} that flies {out}
  | [hit] {np} which goes {out}
hit_winner: [hit] {np} {to} for a winner | [win] the point with {np} {to} | [hit] a winner {to} with {np}
  | [send] the ball {to} with {np} and [win] the point | [finish] the point with {np} {to} | [score] with {np} {to}
hit_ace: 2* [serve] an ace {to} | 2* [hit] an ace {to} | [win] the point with an ace {to}
  | [score] an ace {to} with {np} | [hit] {np} {to} for an ace
hit_serve: 2* [serve] {to} | 4* [hit] {np} {to} | 2* [send] {np} {to} | 2* [serve] the ball {to} | 2* [make] {np} {to}
  | [deliver] {np} {to} | 2* [send] the ball {to} with {np} | [strike] {np} {to} | [put] {np} {to} | [place] {np} {to}
  | [open] the point with {np} {to} | [perform] {np} {to} | [hit] {np} that sends the ball {to} | [direct] {np} {to}
  | [execute] {np} {to} | [fire] {np} {to} | [aim] {np} {to} | [launch] {np} {to}
hit_serve_net: 2* [serve] into the net {fault} | 2* [hit] {np} into the net {fault} | [send] {np} into the net {fault}
  | [serve] the ball into the net {fault} | [hit] the net with {np} {fault} | [make] {np} that hits the net {fault}
  | [net] {np} {fault}
hit_serve_out: 2* [serve] {out} {fault} | 2* [hit] {np} {out} {fault} | [send] {np} {out} {fault}
  | [make] {np} but the ball lands {out} {fault} | [serve] but the ball goes {out} {fault}
  | [hit] {np} that lands {out} {fault}
hit_serve_let: [serve] but the ball touches the net , let | [hit] {np} that clips the net , let
  | [serve] a let off the net cord | [hit] {np} but the ball brushes the net for a let
  | [make] {np} that touches the net , let
fault_said: 2* | , fault | for a fault
double_fault: 2* , double fault | for a double fault | and [commit] a double fault
  | and [lose] the point with a double fault
miss: 2* [swing] and [miss] the ball | [swing] with the {fb} but [miss] the ball
  | [try] to hit A {fb} but [miss] the ball | [attempt] A {fb} but [miss] | [swing] at the ball but [fail] to touch it
  | [miss] the ball with A {fb}
toss: [toss] the ball and | [throw] the ball up and | [toss] the ball up and | [throw] the ball in the air and
passive_verb: the ball is sent {to} with {np} | the ball is hit {to} with {np} | the ball is struck {to} with {np}
passive_in: 3* {passive_verb} | {np} of the player sends the ball {to}
hit_bare: 2* [hit] {np} | [play] {np} | [return] the ball with {np} | [hit] the ball with {np}
tossed: {toss} {h}
miss_plain: 2* [swing] and [miss] the ball | [swing] at the ball but [fail] to touch it | [miss] the ball
  | [swing] but [miss]
"""

_WAITS = """
wait_serve: 3* [wait] for the serve | 2* [wait] for the opponent to serve | [get] ready to return the serve
  | [prepare] to receive the serve | [await] the serve | [get] ready for the serve of the opponent
  | [prepare] to return the serve | [concentrate] before the serve | [wait] for the opponent's serve
  | [be] ready for the serve
wait_ball: [be] ready for the return | [stay] ready for the next ball | [observe] the opponent
  | [look] at the opponent | 3* [wait] for the return | 2* [wait] for the opponent's shot | [wait] for the ball
  | 2* [wait] for the opponent's return | [get] ready for the next shot | [prepare] for the next ball
  | [anticipate] the return | [expect] the opponent's response | [await] the opponent's answer | [watch] the opponent
  | [follow] the ball with the eyes | [get] ready for the return | [wait] for the opponent to hit the ball
  | [prepare] for the opponent's next shot
prepare_serve: [gather] concentration for the {nth} serve | [collect] the thoughts before the {nth} serve
  | [settle] before the {nth} serve | 3* [prepare] to serve | 2* [get] ready to serve
  | 2* [prepare] for the {nth} serve | [prepare] to hit the {nth} serve | [concentrate] before the {nth} serve
  | [get] ready for the {nth} serve | [take] time before the {nth} serve | [wait] before serving
  | [hold] the ball and [prepare] to serve | [focus] on the {nth} serve | [be] ready to serve | [be] about to serve
prepare_hit: 2* [prepare] to hit A {fb} | [get] ready to hit A {fb} | [prepare] A {fb} | [set] up for A {fb}
  | [get] in position for A {fb} | [take] the racket back for A {fb}
prepare_plain: 2* [prepare] to hit the ball | [get] ready to hit the ball | [prepare] for the shot
  | [take] the racket back
prepare_stop: [prepare] to hit the ball but [stop] | [get] ready to hit the ball but [stop]
  | [want] to hit the ball but [stop] | [intend] to hit the ball but [stop] | [go] for the ball but [stop] halfway
watch: 3* [watch] the ball | [look] at the ball | [follow] the ball with the eyes | [watch]
after_point: at the end of the point | with the point over | now that the point is over | 2* after the point
  | after the end of the point | when the point is over | since the point is over | after the rally
  | as the rally has ended | once the point has ended
after_won: with the point won | after winning the point | having won the point | as the point is won
  | after the opponent has lost the point
after_lost: with the point lost | after losing the point | having lost the point | as the point is lost
  | after the opponent has won the point
after_fault: after the fault | because the serve was a fault | since the {nth} serve was a fault
  | after the missed serve | before the second serve
after_let: after the let | because the serve was a let | before the serve is repeated
  | before the serve is played again
wait_next: [think] about the next point | [recover] for the next point | [look] forward to the next point
  | [wait] for the next point | [get] ready for the next point | [prepare] for the next point | [take] a short rest
  | [catch] the breath | [relax]
wait_second: [wait] for the second serve | [get] ready for the second serve | [prepare] for the second serve
wait_repeat: [wait] for the serve to be repeated | [get] ready for the repeated serve | [prepare] for the next serve
"""

_REASONS = """
opp: 4* the opponent | 2* opponent | the other player | the rival
r_opp_net: {opp} nets the ball | {opp} makes a mistake and hits the net | {opp} finds the net | 4* {opp} hits the net
  | 2* {opp} sends the ball into the net | the opponent's shot ends in the net
  | the opponent's ball does not get over the net | {opp} hits the ball into the net
  | the ball of the opponent is stopped by the net | {opp} makes an error into the net
r_opp_out: {opp} misses the court and the ball goes out | {opp} makes a mistake and the ball goes out
  | 4* {opp} sends the ball out | 3* {opp} sends the ball out of the field | 3* the ball goes out of bounds
  | the opponent's shot lands out | {opp} hits the ball out of the court | the ball of the opponent flies out
  | the ball lands outside of the court | {opp} makes an error and the ball goes out
r_opp_winner: 2* the ball is out of reach | the ball is too far away | {opp} hits a winner | {opp} wins the point
  | the opponent's shot is too good | it is too late to reach the ball | the ball goes past the player
  | {opp} scores the point | the ball is impossible to reach
r_opp_ace: {opp} serves an ace | the serve is out of reach | {opp} hits an ace | the serve goes past the player
  | the serve is too good | {opp} wins the point with an ace
r_fault_net: the serve hits the net | {opp} serves into the net | the opponent's {nth} serve ends in the net
  | the {nth} serve is a fault | {opp} makes a fault | the {nth} serve lands in the net
r_fault_out: the serve is out | {opp} serves out | the opponent's {nth} serve lands out | the {nth} serve is a fault
  | {opp} makes a fault | the {nth} serve goes out
r_double: {opp} makes a double fault | the serve is a double fault | {opp} commits a double fault
  | {opp} loses the point with a double fault
r_let: the serve is a let | the serve touches the net , let | {opp} serves a let | the serve clips the net
r_own_winner: 2* {opp} does not reach the ball | the ball is too far for the opponent | {opp} can not reach the ball
  | the player wins the point | {opp} fails to return the ball | the ball is out of reach for the opponent
  | the shot of the player is too good
r_own_net: 2* the ball hits the net | the ball ends in the net | the ball lands in the net
  | the shot of the player hits the net | the player loses the point
r_own_out: 2* the ball goes out | the ball lands out | the ball flies out of bounds | the shot of the player is out
  | the player loses the point
r_own_fault_net: the serve hits the net | the {nth} serve is a fault | the serve ends in the net
r_own_fault_out: the serve lands out | the {nth} serve is a fault | the serve goes out | the serve is out
r_own_double: the serve is a double fault | the point is lost by a double fault
r_own_let: the serve touches the net , let | the serve is a let | the serve has to be repeated
fail: 2* [fail] to reach the ball | [be] too late | [be] too late to reach the ball | [arrive] too late for the ball
  | [let] the ball pass
o_hit: 2* [hit] the ball | 2* [return] the ball | 3* [hit] {onp} | [play] {onp} | [strike] the ball
  | [answer] with {onp} | [send] the ball back
o_serve: 4* [serve] | [hit] the serve | 2* [hit] the {nth} serve | [serve] the ball
  | [open] the point with the {nth} serve
onp_drive: A {ofb} | A {ofb} shot
onp_slice: A {ofb} slice
onp_volley: A {ofb} volley
onp_half_volley: A {ofb} half volley
onp_smash: A smash
onp_lob: A lob
onp_drop: A drop shot
"""

_FRAMES = """
you: 20* the player | player
frame_m: 6* {you} {m+s} | 2* {you} is {m+ing}
frame_ms: {you} {m+s}
frame_h: {you} {h+s}
frame_mh: 9* {you} {m+s} and {h+s} | 2* {you} {m+s} , then {h+s} | 3* {you} {m+s} and then {h+s}
  | 3* {m+ing} , the player {h+s} | 2* after {m+ing} , the player {h+s} | 2* {you} {h+s} after {m+ing}
  | {you} , {m+ing} , {h+s} | 2* {you} {m+s} before {h+ing} | {you} {m+s} , and {h+s}
frame_mp: {you} {m+s} and {passive} | after {m+ing} , {passive} | {you} {m+s} , {passive}
frame_p: {passive} | {passive_verb} by the player
frame_hm: 4* {you} {h+s} and {m+s} | 2* {you} {h+s} and then {m+s} | {you} {h+s} , then {m+s}
  | after {h+ing} , the player {m+s} | {you} {h+s} before {m+ing}
frame_mw: 5* {you} {m+s} and {w+s} | {m+ing} , the player {w+s} | 2* {you} {w+s} after {m+ing} | {you} {m+s} , {w+ing}
  | {you} {m+s} to {w+inf} | {you} {m+s} , then {w+s}
frame_sw: 4* {you} {m+s} and {w+s} | 2* {you} {m+s} , {w+ing} | 2* {you} {w+s} while {m+ing}
  | {m+ing} , the player {w+s}
frame_w: 3* {you} {w+s} | {you} is {w+ing}
frame_ws: 3* {you} {w+s} {spot} | {you} is {w+ing} {spot} | {spot} , the player {w+s} | {you} , {spot} , {w+s}
frame_mo: 3* {you} {m+s} as {opp} {o+s} | as {opp} {o+s} , the player {m+s} | 2* {you} {m+s} while {opp} {o+s}
  | 2* {you} {m+s} when {opp} {o+s} | {opp} {o+s} , the player {m+s}
frame_wo: 2* {you} {w+s} as {opp} {o+s} | as {opp} {o+s} , the player {w+s} | {you} {w+s} until {opp} {o+s}
  | {opp} {o+s} while the player {w+s}
frame_mr: 2* {you} {m+s} when {r} | {you} {m+s} as {r} | {you} {m+s} , {r} | as {r} , the player {m+s}
  | when {r} , the player {m+s} | {you} {m+s} while {r}
frame_sr: 3* {you} {m+s} because {r} | 2* {you} {m+s} , because {r} | {you} {m+s} since {r} | {you} {m+s} , {r}
  | because {r} , the player {m+s} | 2* {you} {m+s} as {r} | {you} {m+s} when {r}
frame_mf: 3* {you} {m+s} but {f+s} | {you} {m+s} , but {f+s} | although {m+ing} , the player {f+s}
frame_wr: 3* {you} {w+s} as {r} | {you} {w+s} and {r} | {you} {w+s} while {r} | as {r} , the player {w+s}
  | {r} while the player {w+s}
frame_ma: 3* {you} {m+s} {after} | {after} , the player {m+s}
frame_tossed: {you} {tossed+s}
frame_at_h: {spot} , the player {h+s} | {you} , {spot} , {h+s}
frame_stand_h: standing {spot} , the player {h+s} | positioned {spot} , the player {h+s}
  | {you} , standing {spot} , {h+s}
frame_wa: 2* {you} {w+s} | 2* {you} {w+s} {after} | {after} , the player {w+s} | {you} is {w+ing} {after}
"""

GRAMMAR: Grammar = parse_grammar(_WAYS + _MOVES + _PLACES + _TARGETS + _STROKES + _WAITS + _REASONS + _FRAMES)
