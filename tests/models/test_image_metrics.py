"""PSNR, SSIM, MS-SSIM and steadiness against slow references, known pictures and the laws of means over frames."""

import numpy as np
import pytest
from scipy import ndimage

from pgm_models.image_metrics import (
    SCALE_WEIGHTS,
    check_colours,
    masked_psnr,
    masked_ssim,
    most_scales,
    ms_ssim,
    psnr,
    psnr_of_error,
    squared_errors,
    ssim,
    ssim_map,
    steadiness,
)


def pictures(frames: int, height: int, width: int, seed: int = 0) -> np.ndarray:
    """Smooth random pictures with some noise, float32."""
    rng = np.random.default_rng(seed)
    smooth = ndimage.gaussian_filter(rng.random((frames, 3, height, width)), (0, 0, 3, 3))
    smooth = (smooth - smooth.min()) / np.ptp(smooth)
    return np.clip(smooth + rng.normal(0, 0.02, smooth.shape), 0, 1).astype(np.float32)


def worse(real: np.ndarray, seed: int = 1) -> np.ndarray:
    """Blurred and noisy."""
    rng = np.random.default_rng(seed)
    blurred = ndimage.gaussian_filter(real, (0, 0, 1, 1))
    return np.clip(blurred + rng.normal(0, 0.03, real.shape), 0, 1).astype(np.float32)


def slow_terms(a: np.ndarray, b: np.ndarray) -> tuple[float, float]:
    """SSIM and its contrast and structure alone, of one colour, window by window."""
    offsets = np.arange(11) - 5
    weight = np.exp(-(offsets[:, None] ** 2 + offsets[None] ** 2) / (2 * 1.5**2))
    weight /= weight.sum()
    whole, structure = [], []
    for row in range(5, a.shape[0] - 5):
        for column in range(5, a.shape[1] - 5):
            x = a[row - 5 : row + 6, column - 5 : column + 6]
            y = b[row - 5 : row + 6, column - 5 : column + 6]
            mx, my = (weight * x).sum(), (weight * y).sum()
            vx, vy = (weight * (x - mx) ** 2).sum(), (weight * (y - my) ** 2).sum()
            cov = (weight * (x - mx) * (y - my)).sum()
            structure.append((2 * cov + 0.0009) / (vx + vy + 0.0009))
            whole.append(structure[-1] * (2 * mx * my + 0.0001) / (mx**2 + my**2 + 0.0001))
    return float(np.mean(whole)), float(np.mean(structure))


def halved(picture: np.ndarray) -> np.ndarray:
    """The mean of each two by two pixels, a last odd row or column left out."""
    high, wide = picture.shape[0] // 2, picture.shape[1] // 2
    return np.array([[picture[2 * y : 2 * y + 2, 2 * x : 2 * x + 2].mean() for x in range(wide)] for y in range(high)])


def test_psnr_of_a_constant_error_is_known():
    real = np.full((2, 3, 4, 5), 0.5, np.float32)
    made = real + np.array([0.1, 0.01], np.float32)[:, None, None, None]
    np.testing.assert_allclose(psnr(made, real), [20.0, 40.0], atol=1e-4)


def test_equal_pictures_have_endless_psnr_and_ssim_one():
    real = pictures(1, 20, 24)
    assert np.isinf(psnr(real, real)).all()
    np.testing.assert_allclose(ssim(real, real), 1.0, atol=1e-12)


def test_psnr_of_a_clip_is_that_of_its_mean_error():
    real, made = pictures(3, 16, 16), worse(pictures(3, 16, 16))
    whole = psnr_of_error(np.array([squared_errors(made, real).mean()]))
    stacked = psnr(made.transpose(1, 0, 2, 3).reshape(1, 3, -1, 16), real.transpose(1, 0, 2, 3).reshape(1, 3, -1, 16))
    np.testing.assert_allclose(whole, stacked)


def test_a_mask_leaves_out_what_lies_outside():
    real = pictures(2, 12, 12)
    made = real.copy()
    made[:, :, :, 6:] = 1 - made[:, :, :, 6:]
    mask = np.zeros((2, 12, 12), bool)
    mask[0, :, :6] = True
    figures = masked_psnr(made, real, mask)
    assert np.isinf(figures[0])
    assert np.isnan(figures[1]), "an empty mask has no figure"
    assert masked_psnr(made, real, ~mask)[1] == pytest.approx(psnr(made, real)[1])


def test_ssim_agrees_with_its_windows_one_by_one():
    real = pictures(1, 17, 19)
    made = worse(real)
    slow = np.mean([slow_terms(a, b)[0] for a, b in zip(made[0].astype(float), real[0].astype(float), strict=True)])
    assert ssim(made, real)[0] == pytest.approx(slow, abs=1e-10)


def test_ssim_agrees_with_scikit_image():
    metrics = pytest.importorskip("skimage.metrics")
    real = pictures(1, 40, 50)[0].astype(float)
    made = worse(real[None])[0].astype(float)
    value, maps = metrics.structural_similarity(
        made,
        real,
        channel_axis=0,
        data_range=1.0,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        full=True,
    )
    assert ssim(made[None], real[None])[0] == pytest.approx(value, abs=1e-10)
    np.testing.assert_allclose(ssim_map(made[None], real[None])[0], maps.mean(axis=0), atol=1e-10)


def test_masked_ssim_of_the_inner_picture_is_ssim():
    real = pictures(2, 20, 22)
    made = worse(real)
    inner = np.zeros((2, 20, 22), bool)
    inner[:, 5:-5, 5:-5] = True
    np.testing.assert_allclose(masked_ssim(made, real, inner), ssim(made, real))


def test_ms_ssim_agrees_with_a_slow_one():
    real = pictures(1, 46, 45)[0].astype(float)
    made = worse(real[None])[0].astype(float)
    weights = np.array(SCALE_WEIGHTS[:3]) / sum(SCALE_WEIGHTS[:3])
    values = []
    for colour in range(3):
        a, b, product = made[colour], real[colour], 1.0
        for scale, weight in enumerate(weights):
            whole, structure = slow_terms(a, b)
            product *= (whole if scale == 2 else structure) ** weight
            a, b = halved(a), halved(b)
        values.append(product)
    assert ms_ssim(made[None], real[None], scales=3)[0] == pytest.approx(np.mean(values), abs=1e-10)


def test_ms_ssim_says_how_large_pictures_must_be():
    small = pictures(1, 44, 60)
    assert most_scales(44, 60) == 3
    assert most_scales(176, 400) == 5
    assert most_scales(10, 400) == 0
    assert ms_ssim(small, small, scales=3)[0] == pytest.approx(1.0)
    with pytest.raises(ValueError, match="88 px high and wide, got 60x44"):
        ms_ssim(small, small, scales=4)
    with pytest.raises(ValueError, match="scales: expected 1 to 5"):
        ms_ssim(small, small, scales=0)


def test_frames_do_not_know_of_each_other():
    real = pictures(7, 22, 24)
    made = worse(real)
    for metric in (psnr, ssim, lambda a, b: ms_ssim(a, b, scales=2)):
        whole = metric(made, real)
        parts = np.concatenate([metric(made[:3], real[:3]), metric(made[3:], real[3:])])
        np.testing.assert_array_equal(whole, parts)


def test_no_frames_give_no_figures():
    none = np.zeros((0, 3, 16, 16), np.float32)
    assert psnr(none, none).shape == ssim(none, none).shape == (0,)


@pytest.mark.parametrize("wrong", [(-1.0, 1.0), (0.0, 255.0), (0.0, np.nan)])
def test_colours_of_another_range_are_refused(wrong):
    real = pictures(1, 12, 12)
    made = real.copy()
    made[0, 0, 0, :2] = wrong
    with pytest.raises(ValueError, match="made pictures: expected colours from 0 to 1"):
        psnr(made, real)
    with pytest.raises(ValueError, match="real pictures"):
        ssim(real, made)


def test_rounding_over_one_is_let_pass():
    check_colours(np.full((3, 2, 2), 1.0 + 1e-6, np.float32), "picture")


def test_pictures_of_wrong_sizes_are_refused():
    # Annotations are executed in tests, and see it first.
    with pytest.raises((ValueError, TypeError), match="real"):
        psnr(pictures(1, 12, 12), pictures(1, 12, 13))
    with pytest.raises(ValueError, match="SSIM: pictures: expected at least 11 px"):
        ssim(pictures(1, 12, 10), pictures(1, 12, 10))


def test_a_still_video_does_not_flicker():
    still = np.repeat(pictures(1, 16, 16), 4, axis=0)
    result = steadiness(still, still)
    np.testing.assert_array_equal(result.flicker, 0.0)
    np.testing.assert_array_equal(result.still_share, 1.0)
    assert np.isinf(result.change_psnr).all()
    assert result.flicker.shape == (3,)


def test_flicker_is_what_comes_and_goes_where_nothing_moves():
    real = np.full((3, 3, 10, 10), 0.5, np.float32)
    real[1, :, :5] = 0.9  # What really moves is not held against the made ones.
    made = real + np.array([0.0, 0.02, 0.0], np.float32)[:, None, None, None]
    result = steadiness(made, real)
    np.testing.assert_allclose(result.flicker, 0.02, atol=1e-6)
    np.testing.assert_allclose(result.still_share, 0.5)
    np.testing.assert_allclose(result.change_psnr, psnr_of_error(np.array([0.02**2] * 2)), atol=1e-3)
    np.testing.assert_array_equal(result.real_flicker, 0.0)


def test_where_all_moves_there_is_no_flicker_to_tell():
    real = np.stack([np.zeros((3, 4, 4)), np.ones((3, 4, 4))]).astype(np.float32)
    assert np.isnan(steadiness(real, real).flicker).all()
