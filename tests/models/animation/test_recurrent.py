import pytest
import torch

from pgm_models.animation.network import NetworkShape
from pgm_models.animation.presets import PRESETS, NetworkOptions
from pgm_models.animation.recurrent import (
    ObjectLstms,
    SequenceLstm,
    matched_width,
    parameter_count,
    rate_features,
    transformer_parameters,
)

SHAPE = NetworkShape(widths=(3, 2, 3, 2, 4), actions=2, constants=3, text_width=5)
OBJECTS = (0, 0, 1, 1, -1)
OPTIONS = NetworkOptions(width=16, layers=4, heads=2, dropout=0.0)
MAKERS = [
    pytest.param(lambda shape=SHAPE: SequenceLstm(shape, OPTIONS), id="sequence"),
    pytest.param(lambda shape=SHAPE: ObjectLstms(shape, OPTIONS, OBJECTS[: len(shape.widths)]), id="objects"),
]


def inputs(batch=3, frames=9, shape=SHAPE, seed=0):
    generator = torch.Generator().manual_seed(seed)

    def normal(*sizes):
        return torch.randn(*sizes, generator=generator)

    known = torch.rand(batch, frames, len(shape.widths), generator=generator) < 0.5
    widths = torch.tensor(shape.widths)
    x = normal(batch, frames, sum(shape.widths)) * known.repeat_interleave(widths, dim=-1)
    return {
        "x": x,
        "known": known,
        "text": normal(batch, frames, shape.actions, shape.text_width),
        "text_known": torch.rand(batch, frames, shape.actions, generator=generator) < 0.5,
        "rate": torch.linspace(1.0, 50.0, batch),
        "log_snr": torch.zeros(batch),
        "constants": normal(batch, shape.constants),
    }


def made(make):
    torch.manual_seed(1)
    return make().eval()


@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.parametrize("frames", [1, 2, 64])
def test_any_length_comes_out_as_it_went_in(make, frames):
    given = inputs(frames=frames)
    told = made(make)(**given)
    assert told.shape == given["x"].shape and bool(torch.isfinite(told).all())


@pytest.mark.parametrize("make", MAKERS)
def test_unknown_values_texts_and_noise_levels_are_not_looked_at(make):
    network, given = made(make), inputs()
    other = dict(given)
    unknown = ~given["known"].repeat_interleave(torch.tensor(SHAPE.widths), dim=-1)
    other["x"] = torch.where(unknown, torch.nan, given["x"])
    other["text"] = torch.where(given["text_known"][..., None], given["text"], torch.nan)
    other["log_snr"] = torch.full((3,), 7.0)
    torch.testing.assert_close(network(**other), network(**given), rtol=0, atol=0)


@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.parametrize("name", ["x", "text", "rate", "constants"])
def test_what_is_given_matters(make, name):
    network, given = made(make), inputs()
    given["known"][:], given["text_known"][:] = True, True
    other = {**given, name: given[name] + 1.0}
    assert float((network(**other) - network(**given)).detach().abs().max()) > 1e-4


def reach(network, frame):
    """Frames that change when a known value of that frame does."""
    given = inputs(frames=12)
    given["known"][:, frame] = True
    other = {**given, "x": given["x"].clone()}
    other["x"][:, frame] += 1.0
    changed = (network(**other) - network(**given)).abs().amax(dim=(0, 2)) > 1e-7
    return changed.nonzero()[:, 0].tolist()


def test_the_sequence_network_reads_both_ways():
    reached = reach(made(MAKERS[0].values[0]), 6)
    assert min(reached) < 6 < max(reached)


def test_the_object_networks_never_look_ahead():
    assert min(reach(made(MAKERS[1].values[0]), 6)) == 6


def test_an_object_sees_others_of_the_frame_before_only():
    network, given = made(MAKERS[1].values[0]), inputs(frames=4)
    given["known"][:] = False
    given["known"][:, 1, 0] = True
    other = {**given, "x": given["x"].clone()}
    other["x"][:, 1, :3] += 1.0  # player 0, frame 1
    changed = (network(**other) - network(**given)).abs().amax(dim=0) > 1e-7
    assert changed[1, :5].any() and not changed[1, 5:].any()
    assert changed[2, 5:10].any() and changed[2, 10:].any()


def test_an_object_reads_the_text_of_its_own_player_alone():
    network, given = made(MAKERS[1].values[0]), inputs(frames=1)
    given["text_known"][:] = True
    for action, own in enumerate((slice(0, 5), slice(5, 10))):
        other = {**given, "text": given["text"].clone()}
        other["text"][:, :, action] += 1.0
        changed = (network(**other) - network(**given)).abs().amax(dim=(0, 1)) > 1e-7
        assert changed[own].any() and not changed[[at for at in range(14) if not own.start <= at < own.stop]].any()


def test_the_object_networks_go_on_from_what_they_told():
    """The slow way: frame by frame, each time with all that was told before given as known."""
    torch.manual_seed(1)
    network = ObjectLstms(SHAPE, OPTIONS, OBJECTS).eval()
    with torch.no_grad():
        for layers in network.layers:
            # Told and given values then come in by one way alone, the state of the frame before.
            layers.enter.weight.zero_()
    given = inputs(frames=6)
    given["known"][:] = False
    whole = network(**given)
    again = {**given, "x": whole, "known": torch.ones_like(given["known"])}
    torch.testing.assert_close(network(**again), whole)


@pytest.mark.parametrize("make", MAKERS)
def test_a_known_value_is_gone_on_from(make):
    network = made(make)
    assert {3, 4} <= set(reach(network, 2))


@pytest.mark.parametrize("make", MAKERS)
def test_every_weight_gets_a_gradient(make):
    network, given = made(make).train(), inputs()
    given["known"][0, :, :], given["text_known"][0, :, :] = True, True
    network(**given).square().sum().backward()
    still = [name for name, p in network.named_parameters() if p.grad is None or not bool(p.grad.abs().sum() > 0)]
    assert still == []


@pytest.mark.parametrize("make", MAKERS)
def test_a_periodic_motion_is_learned_from_its_start(make):
    torch.manual_seed(0)
    shape = NetworkShape(widths=(2,), actions=0, constants=0, text_width=4)
    network = make(shape)
    optimiser = torch.optim.Adam(network.parameters(), lr=1e-2)
    start = torch.rand(16, 1) * 6.28
    phase = start + torch.arange(6) * 0.7
    state = torch.stack([torch.sin(phase), torch.cos(phase)], dim=-1)
    known = torch.zeros(16, 6, 1, dtype=torch.bool)
    known[:, 0] = True
    still = {
        "x": state * known,
        "known": known,
        "text": torch.zeros(16, 6, 0, 4),
        "text_known": torch.zeros(16, 6, 0, dtype=torch.bool),
        "rate": torch.full((16,), 4.0),
        "log_snr": torch.zeros(16),
        "constants": torch.zeros(16, 0),
    }
    for _ in range(80):
        loss = (network(**still) - state).square().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    assert float(loss.detach()) < 0.05  # of values with mean square 0.5


@pytest.mark.parametrize("preset", ["nano", "tiny", "small"])
def test_they_have_about_as_many_weights_as_the_transformer(preset):
    shape = NetworkShape(widths=(3, 3, 60, 3, 3, 60, 3, 3), actions=2, constants=40, text_width=128)
    options = PRESETS[preset].network
    wanted = transformer_parameters(shape, options)
    for network in (SequenceLstm(shape, options), ObjectLstms(shape, options, (0, 0, 0, 1, 1, 1, -1, -1))):
        assert parameter_count(network) == pytest.approx(wanted, rel=0.15)


def test_making_the_transformer_that_they_are_matched_with_draws_nothing():
    before = torch.random.get_rng_state()
    assert transformer_parameters(SHAPE, OPTIONS) > 0
    assert torch.equal(torch.random.get_rng_state(), before)


@pytest.mark.parametrize("kind", [torch.float16, torch.bfloat16])
@pytest.mark.parametrize("make", MAKERS)
def test_half_precision_is_close(make, kind):
    network, given = made(make), inputs()
    whole = network(**given)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        mixed = network(**given)
    half = network.to(kind)(**given)
    assert half.dtype == mixed.dtype == torch.float32
    for found in (half, mixed):
        assert float((found - whole).detach().abs().max()) < 0.1 * float(whole.detach().abs().max())


def test_one_object_a_property_is_asked_for():
    with pytest.raises(ValueError, match="objects: expected one for each of 5 properties, got 2"):
        ObjectLstms(SHAPE, OPTIONS, (0, 1))


def test_the_width_comes_nearest():
    def count(width):
        return 3 * width * width

    for wanted in (1, 500, 30_000, 1_000_000):
        best = min(range(8, 2000, 8), key=lambda width: abs(count(width) - wanted))
        assert matched_width(count, wanted) == best


def test_equal_ratios_of_rates_are_equal_turns():
    found = rate_features(torch.tensor([2.0, 4.0, 8.0], dtype=torch.float64))
    angles = torch.atan2(found[:, 1], found[:, 5])
    torch.testing.assert_close(angles[1] - angles[0], angles[2] - angles[1])
    assert float(found.abs().max()) <= 1
