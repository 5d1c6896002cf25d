import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from pgm_models.animation.prior import (
    KNOWN_VARIANCE,
    LEAST_DOUBT,
    LEAST_OF_NOISE,
    SCALES_S,
    Preconditioner,
    TemporalPrior,
    fit_prior,
    prior_from_json,
    prior_to_json,
)
from tests.models.animation.toy_models import toy_layout, toy_windows


def drawn_prior(seed: int) -> TemporalPrior:
    """Of a channel alone, a position and its velocity."""
    rng = np.random.default_rng(seed)
    shares = rng.dirichlet(np.full(2 * len(SCALES_S) + 1, 0.3), size=3)
    return TemporalPrior(
        smooth=shares[:, : len(SCALES_S)],
        rough=shares[:, len(SCALES_S) : -1],
        white=shares[:, -1] + 1e-6,
        position=np.array([1]),
        velocity=np.array([2]),
        ratio=np.array([rng.uniform(0.01, 0.5)]),
    )


def covariance(prior: TemporalPrior, times: np.ndarray) -> np.ndarray:
    """Of all channels at all times with each other, (channels, times, channels, times), kernel by kernel."""
    s = np.asarray(SCALES_S)
    count, n = len(prior.white), len(times)
    K = np.zeros((count, n, count, n))
    lag = (times[:, None] - times)[..., None]
    r = np.sqrt(3) * np.abs(lag) / s
    for c in range(count):
        K[c, :, c] = ((1 + r) * np.exp(-r)) @ prior.smooth[c] + np.exp(-np.abs(lag) / s) @ prior.rough[c]
        K[c, :, c] += prior.white[c] * np.eye(n)
    for p, v, ratio in zip(prior.position, prior.velocity, prior.ratio, strict=True):
        K[v, :, v] += ratio**2 * ((3 / s**2 * (1 - r) * np.exp(-r)) @ prior.smooth[p])
        across = ratio * ((3 * lag / s**2 * np.exp(-r)) @ prior.smooth[p])
        K[p, :, v] += across
        K[v, :, p] += across.T
    return K


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 12), st.floats(1.0, 50.0), st.floats(-10.0, 10.0))
def test_it_is_the_gaussian_posterior_of_what_is_seen(seed, frames, rate, log_snr):
    rng = np.random.default_rng(seed)
    prior = drawn_prior(seed)
    kinds = rng.integers(0, 3, (frames, 3))  # known, noisy, nothing
    alpha, sigma = np.sqrt(1 / (1 + np.exp(-log_snr))), np.sqrt(1 / (1 + np.exp(log_snr)))
    x = rng.normal(size=(frames, 3))
    mean, doubt = Preconditioner(prior)(
        torch.as_tensor(x)[None],
        torch.as_tensor(kinds == 0)[None],
        torch.as_tensor(kinds < 2)[None],
        torch.tensor([rate]),
        torch.tensor([log_snr], dtype=torch.float64),
    )
    K = covariance(prior, np.arange(frames) / float(np.float32(rate))).reshape(3 * frames, 3 * frames)
    kind, value = kinds.T.ravel(), x.T.ravel()
    seen = np.flatnonzero(kind < 2)
    gain = np.where(kind == 0, 1.0, alpha)[seen]
    noise = np.where(kind == 0, KNOWN_VARIANCE, max(sigma**2, KNOWN_VARIANCE))[seen]
    total = gain[:, None] * K[np.ix_(seen, seen)] * gain + np.diag(noise)
    across = K[:, seen] * gain
    want = (across @ np.linalg.solve(total, value[seen])).reshape(3, frames).T
    variance = (np.diag(K) - np.einsum("is,si->i", across, np.linalg.solve(total, across.T))).reshape(3, frames).T
    np.testing.assert_allclose(mean[0], want, atol=1e-4 * max(1, np.abs(want).max()))
    seen_through = np.full(3 * frames, np.inf)
    seen_through[seen] = np.sqrt(noise) / gain
    least = 1 / (1 / LEAST_DOUBT**2 + 1 / (LEAST_OF_NOISE * seen_through) ** 2)
    np.testing.assert_allclose(doubt[0] ** 2, np.maximum(variance, 0) + least.reshape(3, frames).T, atol=1e-4)


@pytest.mark.parametrize("seed", range(20))
def test_its_covariances_are_possible_at_any_rate(seed):
    prior = drawn_prior(seed)
    for rate in (0.5, 4.0, 25.0, 50.0, 200.0):
        alone, pairs = Preconditioner(prior).covariance(16, torch.tensor([rate]))
        for part in (alone, pairs):
            assert float(torch.linalg.eigvalsh(part).min()) > -1e-9


def test_a_ball_goes_on_as_fast_as_it_flies():
    """Place and velocity are known at one moment: the place expected a little later is where that velocity leads."""
    smooth = np.zeros((2, len(SCALES_S)))
    smooth[0, SCALES_S.index(1.0)] = 1.0
    prior = TemporalPrior(
        smooth=smooth,
        rough=np.zeros_like(smooth),
        white=np.full(2, 1e-6),
        position=np.array([0]),
        velocity=np.array([1]),
        ratio=np.array([0.5]),
    )
    x = torch.zeros(1, 3, 2)
    x[0, 0] = torch.tensor([0.2, 1.0])
    given = torch.zeros(1, 3, 2, dtype=torch.bool)
    given[0, 0] = True
    mean, _ = Preconditioner(prior)(x, given, torch.ones_like(given) & given, torch.tensor([25.0]), torch.zeros(1))
    speed = 1.0 / 0.5  # standardised places a second
    np.testing.assert_allclose(mean[0, :, 0], 0.2 + speed * np.arange(3) / 25, atol=0.03)


def test_known_values_are_told_without_doubt_and_nothing_seen_is_the_average():
    prior = drawn_prior(1)
    x = torch.randn(2, 6, 3, generator=torch.Generator().manual_seed(0))
    everything = torch.ones(2, 6, 3, dtype=torch.bool)
    preconditioner, rate, level = Preconditioner(prior), torch.full((2,), 25.0), torch.zeros(2)
    mean, doubt = preconditioner(x, everything, everything, rate, level)
    torch.testing.assert_close(mean, x, atol=1e-2, rtol=0)
    assert 0 < float(doubt.min()) <= float(doubt.max()) < 0.01
    mean, doubt = preconditioner(x, ~everything, ~everything, rate, level)
    assert bool((mean == 0).all())
    power = torch.as_tensor(prior.smooth.sum(1) + prior.rough.sum(1) + prior.white).float()
    power[2] += prior.ratio[0] ** 2 * (prior.smooth[1] * 3 / np.asarray(SCALES_S) ** 2).sum()
    torch.testing.assert_close(doubt, (power + LEAST_DOUBT**2).sqrt().expand_as(doubt), atol=1e-5, rtol=0)


def test_the_fit_finds_the_memory_of_a_process():
    layout = toy_layout(players=2, ball=False)
    rng = np.random.default_rng(0)
    frames, windows = 24, 600
    batches = []
    for rate in (25.0, 4.0):
        keep = np.exp(-1 / (rate * 0.5))
        state = np.empty((windows, frames, layout.channels))
        state[:, 0] = rng.normal(size=state[:, 0].shape)
        for k in range(1, frames):
            state[:, k] = keep * state[:, k - 1] + np.sqrt(1 - keep**2) * rng.normal(size=state[:, 0].shape)
        toy = toy_windows(layout, count=windows, frames=frames, texts=0)
        batches.append(replace(toy, state=torch.as_tensor(state).float(), rate=torch.full((windows,), rate)))
    prior = fit_prior(batches, layout)
    times = np.arange(0, 2, 0.04)
    K = covariance(prior, times)
    for channel in range(6):
        np.testing.assert_allclose(K[channel, 0, channel], np.exp(-times / 0.5), atol=0.06)


def test_the_fit_ties_a_velocity_to_its_position():
    layout = toy_layout(players=0)
    windows, frames, rate, scale = 800, 24, 25.0, SCALES_S.index(0.5)
    ratio = SCALES_S[scale] / np.sqrt(3)  # at which the velocity has unit variance too
    smooth = np.zeros((6, len(SCALES_S)))
    smooth[:3, scale] = 1.0
    true = TemporalPrior(
        smooth=smooth,
        rough=np.zeros_like(smooth),
        white=np.full(6, 1e-3),
        position=np.arange(3),
        velocity=np.arange(3, 6),
        ratio=np.full(3, ratio),
    )
    times = np.arange(frames) / rate
    K = covariance(true, times)
    factor = np.linalg.cholesky(K.reshape(6 * frames, -1))
    drawn = (np.random.default_rng(0).normal(size=(windows, 6 * frames)) @ factor.T).reshape(windows, 6, frames)
    toy = toy_windows(layout, count=windows, frames=frames, texts=0)
    scaled = [
        replace(entry, std=np.full(3, ratio if entry.column == "ball.position" else 1.0)) for entry in layout.properties
    ]
    layout = replace(layout, properties=tuple(scaled))
    state = torch.as_tensor(drawn.transpose(0, 2, 1).copy()).float()
    batch = replace(toy, state=state, rate=torch.full((windows,), rate))
    prior = fit_prior([batch], layout)
    assert prior.position.tolist() == [0, 1, 2] and prior.velocity.tolist() == [3, 4, 5]
    np.testing.assert_allclose(covariance(prior, times), K, atol=0.12)


def test_what_is_not_valid_does_not_count_in_the_fit():
    layout = toy_layout(players=2, ball=False)
    toy = toy_windows(layout, count=200, frames=8, texts=0)
    valid = toy.valid.clone()
    valid[:, :, 0] = False
    state = toy.state * valid[..., torch.as_tensor(layout.property_of_channel.copy())]
    prior = fit_prior([replace(toy, state=state, valid=valid)], layout)
    power = prior.smooth.sum(1) + prior.rough.sum(1) + prior.white
    assert (power[:3] <= 1e-3 + 1e-12).all() and (np.abs(power[3:] - 1) < 0.2).all()


def test_it_is_json_and_back_and_refuses_negative_shares():
    prior = drawn_prior(2)
    again = prior_from_json(json.loads(json.dumps(prior_to_json(prior))))
    for name in prior.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(again, name), getattr(prior, name))
    with pytest.raises(ValueError, match="shares of 0 or more"):
        replace(prior, white=-prior.white)


def test_it_stays_in_double_precision_when_a_model_is_halved():
    preconditioner = Preconditioner(drawn_prior(3)).half()
    assert preconditioner.smooth.dtype == torch.float64
