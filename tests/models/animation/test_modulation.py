import math

import torch

from pgm_models.animation.modulation import WAVES, Condition, waves


def drawn(*sizes: int, seed: int = 0, dtype: torch.dtype = torch.float64) -> torch.Tensor:
    return torch.randn(*sizes, generator=torch.Generator().manual_seed(seed), dtype=dtype)


def test_waves_are_sines_and_cosines_and_distinguish_small_steps_of_noise() -> None:
    values = torch.linspace(-20, 20, 401)
    found = waves(values)
    assert found.shape == (401, 2 * WAVES)
    torch.testing.assert_close(found[:, :WAVES].square() + found[:, WAVES:].square(), torch.ones(401, WAVES))
    apart = torch.cdist(found, found) + 10 * torch.eye(401)
    assert float(apart.min()) > 0.3  # a tenth apart
    assert int(apart[0].argmin()) == 1  # the nearest is the neighbour, the far end is not
    assert waves(values.half()).dtype == torch.float32
    slowest = 2 * math.pi / 80
    torch.testing.assert_close(found[:, 0], (values * slowest).sin())


def condition() -> Condition:
    torch.manual_seed(0)
    return Condition(shares=5, width=16, inputs=(4, 6))


@torch.no_grad()
def test_scales_are_around_one_and_hear_noise_rate_and_each_share() -> None:
    known, text_known = torch.zeros(1, 4, 3, dtype=torch.bool), torch.zeros(1, 4, 2, dtype=torch.bool)
    rate, log_snr = torch.tensor([25.0]), torch.tensor([1.0])
    module = condition()
    first, second = module(known, text_known, rate, log_snr)
    assert first.shape == (1, 4) and second.shape == (1, 6)
    assert (first - 1).abs().max() < 0.5
    others = [(known, text_known, rate, log_snr + 1), (known, text_known, rate / 5, log_snr)]
    for row in range(5):
        flags = torch.zeros(1, 4, 5, dtype=torch.bool)
        flags[0, 1, row] = True
        others.append((flags[..., :3], flags[..., 3:], rate, log_snr))
    answers = [torch.cat(module(*other), dim=-1) for other in others]
    answers.append(torch.cat([first, second], dim=-1))
    apart = torch.cdist(torch.cat(answers), torch.cat(answers)) + torch.eye(len(answers))
    assert float(apart.min()) > 1e-4


@torch.no_grad()
def test_only_how_much_is_known_counts_not_when_nor_of_how_many_frames() -> None:
    flags = torch.rand(2, 6, 5, generator=torch.Generator().manual_seed(0)) < 0.5
    rest = torch.tensor([4.0, 25.0]), torch.tensor([-3.0, 3.0])
    module = condition()
    once = torch.cat(module(flags[..., :3], flags[..., 3:], *rest), dim=-1)
    turned = flags.flip(1).repeat(1, 3, 1)
    torch.testing.assert_close(torch.cat(module(turned[..., :3], turned[..., 3:], *rest), dim=-1), once)
