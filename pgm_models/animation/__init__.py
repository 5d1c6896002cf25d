"""The animation model: masked diffusion over the states of a scene, told by words and by wanted values.

Vocabulary, the same in all modules of this package:

- A *property* is one column of the contract that the model generates (`player0.root_position`, `ball.velocity`).
- *channels* are the numbers of a state vector: of each property those that vary, standardised; C of them.
- `state` (B, T, C): B windows of T frames. `known` (B, T, P): True where a property is given and not generated.
- `valid` (B, T, P): whether the data say anything there; what is not valid is neither shown to the model nor scored.
- *actions* are texts, one a player (A of them) and frame. `text_known` (B, T, A): True where one is given.
- *constants* are numbers that do not change within a clip (bones); always given to the model, never generated.
- `rate` (B,): frames a second of the window. `log_snr` is ln(alpha^2 / sigma^2) of the noise, variance preserving:
  alpha^2 = sigmoid(log_snr), sigma^2 = sigmoid(-log_snr). A solver's lambda is half of it.
"""
