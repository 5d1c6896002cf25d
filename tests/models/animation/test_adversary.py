import pytest
import torch
from torch import nn

from pgm_models.animation.adversary import SequenceDiscriminator, adversarial_loss
from pgm_models.animation.network import NetworkShape
from pgm_models.animation.presets import NetworkOptions

SHAPE = NetworkShape(widths=(2, 3), actions=1, constants=0, text_width=4)
OPTIONS = NetworkOptions(width=16, layers=2, heads=2)


@pytest.fixture
def discriminator():
    torch.manual_seed(0)
    return SequenceDiscriminator(SHAPE, OPTIONS)


def told(batch=4, frames=6):
    return torch.randn(batch, frames, 1, 4), torch.ones(batch, frames, 5, dtype=torch.bool)


def fooled(discriminator, fake, text, valid):
    """The generator's own loss, the plain way."""
    return -discriminator(fake, text, valid).mean()


def test_each_side_gets_the_gradient_of_its_own_loss_alone(discriminator):
    discriminator.eval()  # its estimate of the spectral norm stands still
    text, valid = told()
    real, fake = torch.randn(4, 6, 5), torch.randn(4, 6, 5, requires_grad=True)
    loss, _ = adversarial_loss(discriminator, real, fake, text, valid, scale=0.3)
    found = torch.autograd.grad(loss, [fake, *discriminator.parameters()])
    scores = discriminator(real, text, valid), discriminator(fake.detach(), text, valid)
    hinge = torch.relu(1 - scores[0]).mean() + torch.relu(1 + scores[1]).mean()
    torch.testing.assert_close(found[0], 0.3 * torch.autograd.grad(fooled(discriminator, fake, text, valid), fake)[0])
    for one, other in zip(found[1:], torch.autograd.grad(hinge, list(discriminator.parameters())), strict=True):
        torch.testing.assert_close(one, other)


def test_the_generator_still_learns_where_the_discriminator_is_sure(discriminator):
    with torch.no_grad():
        discriminator.leave.bias.fill_(-5.0)  # all is false: the hinge of made sequences is shut
    text, valid = told()
    fake = torch.randn(4, 6, 5, requires_grad=True)
    loss, terms = adversarial_loss(discriminator, torch.randn(4, 6, 5), fake, text, valid)
    loss.backward()
    assert float(terms["adversary_fake"]) < -1 and float(fake.grad.abs().max()) > 1e-5


def test_what_is_not_valid_is_not_looked_at(discriminator):
    text, valid = told()
    valid[:, 2:, 2:] = False
    state = torch.randn(4, 6, 5)
    other = torch.where(valid, state, torch.nan)
    discriminator.eval()
    torch.testing.assert_close(discriminator(other, text, valid), discriminator(state, text, valid))


def test_it_reads_the_text_and_which_values_are_valid(discriminator):
    discriminator.eval()
    text, valid = told()
    state = torch.zeros(4, 6, 5)
    none = torch.zeros_like(valid)
    scores = discriminator(state, text, valid)
    assert not torch.allclose(scores, discriminator(state, text + 1, valid))
    assert not torch.allclose(scores, discriminator(state, text, none))


@pytest.mark.parametrize("frames", [1, 64])
def test_every_frame_gets_a_score(discriminator, frames):
    text, valid = told(2, frames)
    assert discriminator(torch.randn(2, frames, 5), text, valid).shape == (2, frames)


def test_the_text_gets_no_gradient(discriminator):
    text, valid = told()
    text.requires_grad_()
    loss, _ = adversarial_loss(discriminator, torch.randn(4, 6, 5), torch.randn(4, 6, 5), text, valid)
    loss.backward()
    assert text.grad is None


def test_made_sequences_move_to_the_real_ones():
    torch.manual_seed(0)
    shape = NetworkShape(widths=(2,), actions=0, constants=0, text_width=4)
    discriminator = SequenceDiscriminator(shape, OPTIONS)
    mean, wanted = nn.Parameter(torch.zeros(2)), torch.tensor([1.0, -0.5])
    optimiser = torch.optim.Adam([*discriminator.parameters(), mean], lr=1e-2, betas=(0.5, 0.99))
    text, valid = torch.zeros(32, 4, 0, 4), torch.ones(32, 4, 2, dtype=torch.bool)
    for _ in range(150):
        real, fake = torch.randn(32, 4, 2) + wanted, torch.randn(32, 4, 2) + mean
        loss, _ = adversarial_loss(discriminator, real, fake, text, valid)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    assert float((mean.detach() - wanted).norm()) < 0.5 * float(wanted.norm())


def test_it_learns_to_tell_order_in_time(discriminator):
    """Real sequences rise, made ones fall: frame by frame they are alike."""
    generator = torch.Generator().manual_seed(0)
    optimiser = torch.optim.Adam(discriminator.parameters(), lr=1e-2)
    text, valid = torch.zeros(32, 6, 1, 4), torch.ones(32, 6, 5, dtype=torch.bool)
    rise = torch.linspace(-1, 1, 6)[:, None].expand(6, 5)
    terms = {}
    for _ in range(60):
        shift = torch.randn(32, 1, 5, generator=generator)
        loss, terms = adversarial_loss(discriminator, shift + rise, shift - rise, text, valid)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    assert float(terms["adversary_real"]) > 0.5 > -0.5 > float(terms["adversary_fake"])
