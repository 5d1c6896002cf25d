"""A first guess of a whole rally by linear least squares.

Between two contacts the ball's height is a parabola under gravity and its ground track a straight line, run along with
a drag that is known in advance: then every position is linear in the contacts' positions, and so is the distance of a
position from a pixel's ray. One linear system has the rally; a few turns of it settle weights and path lengths.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from pgm_data.geometry.camera import Camera, rays
from pgm_data.lift.ball.rally_plays import Play, RallyFrames
from pgm_data.lift.ball.world import GRAVITY

TURNS = 8
"""Turns of reweighting."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ContactPriors:
    """What is known of where contacts happen, besides the pictures."""

    mean: Float[np.ndarray, "contacts 3"]
    """World metres."""
    precision: Float[np.ndarray, "contacts 3"]
    """1/m^2; 0 where nothing is known."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Course:
    """A rally as contacts joined by arcs."""

    times: Float[np.ndarray, " contacts"]
    contacts: Float[np.ndarray, "contacts 3"]
    """World metres."""
    drag_per_m: float

    def at(self, times: Float[np.ndarray, " times"], flight: Int[np.ndarray, " times"]) -> Float[np.ndarray, "times 6"]:
        """Position and velocity at times of the given flights."""
        share, speed, height, climb = self._shares(times, flight)
        start, end = self.contacts[flight], self.contacts[flight + 1]
        duration = (self.times[flight + 1] - self.times[flight])[:, None]
        flat = (1 - share)[:, None] * start[:, :2] + share[:, None] * end[:, :2]
        rise = (times - self.times[flight])[:, None] / duration
        z = (1 - rise) * start[:, 2:] + rise * end[:, 2:] + height[:, None]
        ground = speed[:, None] * (end - start)[:, :2]
        return np.concatenate([flat, z, ground, (end - start)[:, 2:] / duration + climb[:, None]], axis=1)

    def _shares(self, times: np.ndarray, flight: np.ndarray) -> tuple[np.ndarray, ...]:
        """Share of the ground track gone and its rate, height over the chord and its rate."""
        start, end = self.contacts[flight], self.contacts[flight + 1]
        T = self.times[flight + 1] - self.times[flight]
        t = times - self.times[flight]
        flat = np.linalg.norm((end - start)[:, :2], axis=1)
        # Drag acts along the whole path, of which the ground track is the shadow: a lob loses more of its speed.
        slope = (np.abs(end - start)[:, 2] + GRAVITY * T**2 / 4) / np.maximum(flat, 0.1)
        fall = np.minimum(self.drag_per_m * flat * np.hypot(1, np.minimum(slope, 5)), 4.0)
        u = np.expm1(fall)
        small = fall < 1e-9
        with np.errstate(invalid="ignore", divide="ignore"):
            share = np.where(small, t / T, np.log1p(np.maximum(u * t / T, -0.9)) / np.where(small, 1, fall))
            rate = np.where(small, 1 / T, u / T / (1 + np.maximum(u * t / T, -0.9)) / np.where(small, 1, fall))
        return share, rate, GRAVITY / 2 * t * (T - t), GRAVITY / 2 * (T - 2 * t)


def flight_of(
    times: Float[np.ndarray, " times"], contacts: Float[np.ndarray, " contacts"]
) -> Int[np.ndarray, " times"]:
    """The flight of each time; -1 before the first contact, and as many as there are flights after the last."""
    flight = np.searchsorted(contacts, times, side="right") - 1
    return np.where(times == contacts[-1], len(contacts) - 2, flight)


def first_course(
    frames: RallyFrames, play: Play, camera: Camera, priors: ContactPriors, drag_per_m: float
) -> Course | None:
    """The course that the pictures and the contacts' priors make likeliest; None where nothing was measured.

    Args:
        frames: Pictures.
        play: Contacts at their given times.
        camera: One camera a frame of the track.
        priors: Of the contacts' positions.
        drag_per_m: Drag constant to run along with.
    """
    flight = flight_of(frames.times, play.times)
    rows = np.flatnonzero(frames.measured & (flight >= 0) & (flight < len(play) - 1))
    if len(rows) < 2:
        return None
    own = camera[frames.index[rows]]
    directions = rays(own, frames.pixels[rows][:, None])[:, 0]
    good = np.isfinite(directions).all(axis=1)
    rows, directions, own = rows[good], directions[good], own[good]
    if len(rows) < 2:
        return None
    centres, focal = own.position_world, own.K[:, 0, 0]
    flight = flight[rows]
    away = np.abs(directions @ np.array([0.0, 0.0, 1.0])) > 0.9
    helper = np.where(away[:, None], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    across = np.cross(directions, helper)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    normals = np.stack([across, np.cross(directions, across)], axis=1)
    mark_normals, mark_centres, mark_weight = _marks(frames, play, camera)
    count = len(play)
    middle = np.where(priors.precision > 0, priors.mean, 0.0)
    course = Course(times=play.times, contacts=middle, drag_per_m=0.0)
    depth = np.maximum(np.linalg.norm(centres - course.at(frames.times[rows], flight)[:, :3], axis=1), 1.0)
    weight = np.ones(len(rows))
    for turn in range(TURNS):
        share, _, height, _ = course._shares(frames.times[rows], flight)
        rise = (frames.times[rows] - play.times[flight]) / (play.times[flight + 1] - play.times[flight])
        shares = np.stack([share, share, rise], axis=1)
        row = normals * (focal / depth * np.sqrt(frames.precision[rows] * weight))[:, None, None]
        A = np.zeros((len(rows), 2, count, 3))
        here = np.arange(len(rows))
        A[here, :, flight] = row * (1 - shares)[:, None]
        A[here, :, flight + 1] = row * shares[:, None]
        lifted = centres - height[:, None] * np.array([0.0, 0.0, 1.0])
        b = np.einsum("fnk,fk->fn", row, lifted)
        A, b = A.reshape(-1, 3 * count), b.ravel()
        M = A.T @ A + np.diag(priors.precision.ravel() + 1e-6)
        h = A.T @ b + (priors.precision * priors.mean).ravel()
        for k in np.flatnonzero(mark_weight > 0):
            N = mark_normals[k] * mark_weight[k]
            flat = np.zeros((2, 3 * count))
            flat[:, 3 * k : 3 * k + 2] = N[:, :2]
            M += flat.T @ flat
            h += flat.T @ (N @ mark_centres[k])
        contacts = np.linalg.solve(M, h).reshape(count, 3)
        # The path's length feeds the drag: changed gently, a poor first turn does not run away.
        step = np.clip(contacts, -200, 200)
        course = Course(times=play.times, contacts=step, drag_per_m=drag_per_m * min(1.0, (turn + 1) / 3))
        at = course.at(frames.times[rows], flight)[:, :3]
        depth = np.maximum(np.einsum("fk,fk->f", at - centres, directions), 1.0)
        off = np.linalg.norm(np.einsum("fnk,fk->fn", normals, at - centres), axis=1)
        distance = off * focal / depth * np.sqrt(frames.precision[rows])
        # The chord model is off by a few pixels itself: only what sticks out of the residuals counts less.
        usual = max(3.0, 2.5 * float(np.median(distance)))
        weight = 1 / (1 + (distance / usual) ** 2)
    return course


def _marks(frames: RallyFrames, play: Play, camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two planes through each ground mark's ray, the camera's centre, and their weight, 0 where there is no mark."""
    count = len(play)
    normals, centres, weight = np.zeros((count, 2, 3)), np.zeros((count, 3)), np.zeros(count)
    for k in np.flatnonzero(np.isfinite(play.ground_px).all(axis=1)):
        own = camera[frames.index[np.abs(frames.times - play.times[k]).argmin()]]
        ray = rays(own, play.ground_px[k][None])[0]
        if not np.isfinite(ray).all() or abs(ray[2]) < 1e-3:
            continue
        across = np.cross(ray, [0.0, 0.0, 1.0])
        across /= np.linalg.norm(across)
        normals[k] = across, np.cross(ray, across)
        centres[k] = own.position_world
        depth = abs(own.position_world[2] / ray[2])
        weight[k] = own.K[0, 0] / depth / 3.0
    return normals, centres, weight
