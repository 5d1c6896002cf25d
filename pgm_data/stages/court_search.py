"""Finding a court's camera in one picture: first guesses, then measured lines from coarse to fine, then the verdict."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Int

from pgm_data.court import Court
from pgm_data.detect.lines import LineLook, RidgeOptions, look_of_lines, measure_ridges, merged
from pgm_data.lift.court_camera import PARAMETERS, CourtCamera
from pgm_data.lift.court_samples import LineSamples, moved_samples, sample_lines
from pgm_data.lift.line_consensus import on_course
from pgm_data.lift.line_fit import FREE_LENS, Fit, Sightings, fit_track
from pgm_data.lift.plausible import TrustOptions, camera_trust, fit_support, frame_trust, line_counts

SIGMA_FLOOR_PX = 0.05
"""No line is measured better than this, pixels."""
TWO_TONE_BIAS = (0.06, 0.3)
"""Shared error of a line between two court colours, pixels per unit of two-tone: for lines wide enough that the
place where the colour changes was fitted, and for narrower ones."""
SPILL_WIDTH_PX = 1.5
"""Least width at which that place is fitted."""
SURE_SHARE = 0.75
"""Share of samples that agree at which a camera is taken without looking for a better one."""
FAINT_SHARE, FAINT_SEARCH = 0.6, 0.005
"""Lines of which less is found are measured again as faint ones, once they are sought this near (in picture widths)."""
TYPICAL_RADIAL = (0.02, 0.025)
"""Mean and standard deviation of the radial term of broadcast lenses."""


@dataclass(frozen=True, kw_only=True)
class SearchOptions:
    """How much is measured in a picture."""

    samples: int = 200
    """Most line samples in a picture."""
    spacing_px: float = 6.0
    """Least distance between samples along a line, pixels."""
    searches: tuple[float, ...] = (0.0085, 0.0045, 0.0025, 0.0021)
    """Search ranges from coarse to fine, as shares of the picture's width (never under 2.5 px)."""
    follow: float = 0.004
    """Search range from one frame to the next, as a share of the picture's width."""
    crooked: float = 0.00016
    """Standard deviation of lines' own shifts, as a share of the picture's width."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Observation:
    """What was measured in one picture under one predicted camera."""

    samples: LineSamples
    sightings: Sightings
    """Measurements that lie on their line's course."""
    readable: Int[np.ndarray, " lines"]
    """Samples of each line that lay inside the picture."""
    look: LineLook
    """What the lines were taken to look like."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Sight:
    """A camera found in one picture."""

    camera: CourtCamera
    fit: Fit
    observation: Observation
    share: float
    """Share of the readable samples that agree."""
    reason: str
    """Why it is not believed; empty when it is."""


def observe(
    luma: np.ndarray,
    camera: CourtCamera,
    court: Court,
    *,
    search_px: float,
    options: SearchOptions,
    samples: LineSamples | None = None,
    look: LineLook | None = None,
) -> Observation:
    """The painted lines of a picture measured where a camera expects them.

    Args:
        luma: Grey picture (height, width), uint8.
        camera: One camera.
        court: The court.
        search_px: Furthest a line may lie from where it is expected.
        options: How much is measured.
        samples: Court points to measure again; spread anew when None.
        look: What the lines look like; estimated when None.
    """
    size = (luma.shape[1], luma.shape[0])
    if samples is None:
        samples = sample_lines(camera, court, size=size, spacing_px=options.spacing_px, most=options.samples)
    else:
        samples = moved_samples(camera, court, samples, size=size)
    lines = len(court.line_names)
    expected = (luma, samples.pixels, samples.normals, samples.widths_px)
    if look is None:
        look = look_of_lines(*expected, samples.line, lines, RidgeOptions(search_px=search_px))
    ridges = measure_ridges(
        *expected, RidgeOptions(search_px=search_px, blur_px=look.blur_px), look.spill[samples.line]
    )
    tolerance = max(1.0, 0.12 * search_px)
    good = on_course(samples.line, samples.along, ridges.offset_px, tolerance_px=tolerance)
    readable = line_counts(samples.line, lines, ridges.readable)
    # Faint lines show in profiles averaged over longer stretches.
    faint = line_counts(samples.line, lines, good) < FAINT_SHARE * readable
    rows = np.flatnonzero(faint[samples.line])
    if len(rows) and search_px <= max(FAINT_SEARCH * luma.shape[1], 3.0):
        longer = RidgeOptions(search_px=search_px, blur_px=look.blur_px, averaged=21, least_contrast=1.5)
        again = measure_ridges(
            luma,
            samples.pixels[rows],
            samples.normals[rows],
            samples.widths_px[rows],
            longer,
            look.spill[samples.line[rows]],
        )
        found = on_course(samples.line[rows], samples.along[rows], again.offset_px, tolerance_px=tolerance)
        gained = line_counts(samples.line[rows], lines, found) > line_counts(samples.line[rows], lines, good[rows])
        more = gained[samples.line[rows]]
        good[rows[more]] = found[more]
        ridges = merged(ridges, again, rows, more)
    sightings = Sightings(
        points_world=samples.points_world[good],
        measured_px=(samples.pixels + samples.normals * ridges.offset_px[:, None])[good],
        normals=samples.normals[good],
        sigma_px=np.hypot(ridges.sigma_px[good], SIGMA_FLOOR_PX),
        line=samples.line[good],
        along=samples.along[good],
        bias_px=(ridges.two_tone * np.where(samples.widths_px > SPILL_WIDTH_PX, *TWO_TONE_BIAS))[good],
    )
    return Observation(samples=samples, sightings=sightings, readable=readable, look=look)


def settle(
    luma: np.ndarray,
    first: CourtCamera,
    court: Court,
    *,
    options: SearchOptions,
    trust: TrustOptions,
    keep_lens: bool = False,
) -> Sight | None:
    """The camera that the picture's lines lead to from a first one; None where they lead nowhere.

    Args:
        luma: Grey picture.
        first: Where to start.
        court: The court.
        options: How much is measured.
        trust: Limits of what is believed.
        keep_lens: Whether the first camera's radial term is a solved one, rather than unknown.
    """
    width = luma.shape[1]
    if camera_trust(first, court, width=width, options=trust):
        return None
    camera = first if keep_lens else replace(first, radial=np.array(TYPICAL_RADIAL[0]))
    std, off = np.full(PARAMETERS, 1e6), np.zeros(PARAMETERS)
    std[7] = TYPICAL_RADIAL[1]
    result = None
    for share in options.searches:
        observation = observe(luma, camera, court, search_px=max(share * width, 2.5), options=options)
        if len(observation.sightings.line) < 12 or len(np.unique(observation.sightings.line)) < 4:
            return None
        off[7] = float(camera.radial) - TYPICAL_RADIAL[0]
        fit = fit_track(
            camera,
            observation.sightings,
            free=FREE_LENS,
            crooked_px=options.crooked * width + 0.05,
            lines=len(court.line_names),
            prior=(std, off),
        )
        camera = fit.camera
        if camera_trust(camera, court, width=width, options=trust):
            return None
        result = fit, observation
    assert result is not None
    return judged(*result, court=court, width=width, trust=trust)


def judged(fit: Fit, observation: Observation, *, court: Court, width: int, trust: TrustOptions) -> Sight:
    """The verdict on one picture's fit."""
    support = fit_support(fit, observation.sightings, len(court.line_names))
    reason = frame_trust(
        support=support,
        readable=observation.readable,
        rms_px=float(fit.rms_px),
        width=width,
        court=court,
        options=trust,
    ) or camera_trust(fit.camera, court, width=width, options=trust)
    share = float(support.sum() / max(observation.readable.sum(), 1))
    return Sight(camera=fit.camera, fit=fit, observation=observation, share=share, reason=reason)


def best_sight(
    luma: np.ndarray, firsts: Iterable[CourtCamera], court: Court, *, options: SearchOptions, trust: TrustOptions
) -> Sight | None:
    """The best-supported camera that any first camera leads to, believed or not; None where none leads anywhere.

    A believed camera that most samples agree with ends the search; a doubtful one is weighed against what the other
    first cameras lead to.
    """
    best: Sight | None = None
    for first in firsts:
        sight = settle(luma, first, court, options=options, trust=trust)
        if sight is None:
            continue
        if best is None or (not sight.reason, sight.share) > (not best.reason, best.share):
            best = sight
        if not best.reason and best.share > SURE_SHARE:
            break
    return best
