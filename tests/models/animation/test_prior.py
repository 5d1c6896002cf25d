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
    SCALES_S,
    Preconditioner,
    TemporalPrior,
    fit_prior,
    prior_from_json,
    prior_to_json,
)
from tests.models.animation.toy_models import toy_layout, toy_windows


def drawn_prior(seed: int, channels: int = 2) -> TemporalPrior:
    rng = np.random.default_rng(seed)
    shares = rng.dirichlet(np.full(2 * len(SCALES_S) + 1, 0.3), size=channels)
    return TemporalPrior(
        smooth=shares[:, : len(SCALES_S)], rough=shares[:, len(SCALES_S) : -1], white=shares[:, -1] + 1e-6
    )


def covariance(prior: TemporalPrior, times: np.ndarray) -> np.ndarray:
    lag = np.abs(times[:, None] - times)[..., None]
    reach = np.sqrt(3) * lag / np.asarray(SCALES_S)
    smooth = ((1 + reach) * np.exp(-reach)) @ prior.smooth.T
    rough = np.exp(-lag / np.asarray(SCALES_S)) @ prior.rough.T
    return np.moveaxis(smooth + rough, -1, 0) + prior.white[:, None, None] * np.eye(len(times))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 12), st.floats(1.0, 50.0), st.floats(-10.0, 10.0))
def test_it_is_the_gaussian_posterior_of_what_is_seen(seed, frames, rate, log_snr):
    rng = np.random.default_rng(seed)
    prior = drawn_prior(seed)
    kinds = rng.integers(0, 3, (frames, 2))  # known, noisy, nothing
    alpha, sigma = np.sqrt(1 / (1 + np.exp(-log_snr))), np.sqrt(1 / (1 + np.exp(log_snr)))
    x = rng.normal(size=(frames, 2))
    mean, doubt = Preconditioner(prior)(
        torch.as_tensor(x)[None],
        torch.as_tensor(kinds == 0)[None],
        torch.as_tensor(kinds < 2)[None],
        torch.tensor([rate]),
        torch.tensor([log_snr], dtype=torch.float64),
    )
    all_K = covariance(prior, np.arange(frames) / float(np.float32(rate)))
    for channel in range(2):
        K, kind = all_K[channel], kinds[:, channel]
        seen = np.flatnonzero(kind < 2)
        gain = np.where(kind == 0, 1.0, alpha)[seen]
        noise = np.where(kind == 0, KNOWN_VARIANCE, max(sigma**2, KNOWN_VARIANCE))[seen]
        total = gain[:, None] * K[np.ix_(seen, seen)] * gain + np.diag(noise)
        across = K[:, seen] * gain
        want = across @ np.linalg.solve(total, x[seen, channel])
        variance = np.diag(K) - np.einsum("is,st,it->i", across, np.linalg.inv(total), across)
        np.testing.assert_allclose(mean[0, :, channel], want, atol=1e-5)
        np.testing.assert_allclose(doubt[0, :, channel] ** 2, np.maximum(variance, 0) + LEAST_DOUBT**2, atol=1e-5)


def test_known_values_are_told_without_doubt_and_nothing_seen_is_the_average():
    prior = drawn_prior(1)
    x = torch.randn(2, 6, 2, generator=torch.Generator().manual_seed(0))
    everything = torch.ones(2, 6, 2, dtype=torch.bool)
    preconditioner, rate, level = Preconditioner(prior), torch.full((2,), 25.0), torch.zeros(2)
    mean, doubt = preconditioner(x, everything, everything, rate, level)
    torch.testing.assert_close(mean, x, atol=1e-2, rtol=0)
    torch.testing.assert_close(doubt, torch.full_like(doubt, LEAST_DOUBT), atol=1e-3, rtol=0)
    mean, doubt = preconditioner(x, ~everything, ~everything, rate, level)
    assert bool((mean == 0).all())
    power = torch.as_tensor(prior.smooth.sum(1) + prior.rough.sum(1) + prior.white).float()
    torch.testing.assert_close(doubt, (power + LEAST_DOUBT**2).sqrt().expand_as(doubt), atol=1e-5, rtol=0)


def test_the_fit_finds_the_memory_of_a_process():
    layout = toy_layout(players=0)
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
    prior = fit_prior(batches, layout.property_of_channel)
    times = np.arange(0, 2, 0.04)
    np.testing.assert_allclose(covariance(prior, times)[:, 0], np.exp(-times / 0.5)[None].repeat(6, 0), atol=0.06)


def test_what_is_not_valid_does_not_count_in_the_fit():
    layout = toy_layout(players=0)
    toy = toy_windows(layout, count=200, frames=8, texts=0)
    valid = toy.valid.clone()
    valid[:, :, 0] = False
    state = toy.state * valid[..., torch.as_tensor(layout.property_of_channel.copy())]
    prior = fit_prior([replace(toy, state=state, valid=valid)], layout.property_of_channel)
    power = prior.smooth.sum(1) + prior.rough.sum(1) + prior.white
    assert (power[:3] <= 1e-3 + 1e-12).all() and (np.abs(power[3:] - 1) < 0.2).all()


def test_it_is_json_and_back_and_refuses_negative_shares():
    prior = drawn_prior(2)
    again = prior_from_json(json.loads(json.dumps(prior_to_json(prior))))
    for name in ("smooth", "rough", "white"):
        np.testing.assert_array_equal(getattr(again, name), getattr(prior, name))
    with pytest.raises(ValueError, match="shares of 0 or more"):
        replace(prior, white=-prior.white)


def test_it_stays_in_double_precision_when_a_model_is_halved():
    preconditioner = Preconditioner(drawn_prior(3)).half()
    assert preconditioner.smooth.dtype == torch.float64
