"""Which feet stand on the ground."""

import numpy as np

from pgm_data.lift.players.contact import ContactLaw, contact_probability, smoothed_states


def test_states_are_those_of_all_paths_summed() -> None:
    rng = np.random.default_rng(0)
    gain, times = rng.normal(size=6), np.cumsum(rng.uniform(0.02, 0.3, size=6))
    share, stays = 0.6, 0.25
    got = smoothed_states(gain, times, stays_s=stays, share=share)
    base, total, planted = np.array([share, 1 - share]), 0.0, np.zeros(6)
    for path in np.ndindex(*([2] * 6)):
        weight = base[path[0]]
        for k in range(1, 6):
            keep = np.exp(-(times[k] - times[k - 1]) / stays)
            weight *= keep * (path[k] == path[k - 1]) + (1 - keep) * base[path[k]]
        weight *= np.exp(sum(gain[k] * (0.5 if path[k] == 0 else -0.5) for k in range(6)))
        total += weight
        planted += weight * (np.array(path) == 0)
    np.testing.assert_allclose(got, planted / total, atol=1e-12)


def test_a_foot_that_runs_is_free_and_one_that_stays_is_planted() -> None:
    times = np.arange(30) / 25
    height = np.where((times > 0.4) & (times < 0.8), 0.12, 0.0)
    velocity = np.zeros((29, 2))
    velocity[10:19] = [3.0, 0.5]
    got = contact_probability(
        ContactLaw(),
        height=height,
        height_var=np.full(30, 1e-4),
        velocity=velocity,
        velocity_cov=np.full((29, 2, 2), 0.01) * np.eye(2),
        times=times,
    )
    assert np.all(got[:10] > 0.95) and np.all(got[12:18] < 0.05) and np.all(got[21:] > 0.95)


def test_nothing_known_gives_the_share_of_the_time() -> None:
    nan = np.full(4, np.nan)
    got = contact_probability(
        ContactLaw(planted=0.7),
        height=nan,
        height_var=np.zeros(4),
        velocity=np.full((3, 2), np.nan),
        velocity_cov=np.zeros((3, 2, 2)),
        times=np.arange(4.0),
    )
    np.testing.assert_allclose(got, 0.7)
