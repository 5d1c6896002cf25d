"""Draws textured rectangles exactly: which of them each sample sees, then the colour of every pixel.

Pixel coordinates as everywhere, centres at integers; with S x S samples a pixel's samples lie at (i + 0.5) / S - 0.5.
Of a rectangle, 1/z, u/z and v/z are linear in the pixel, so nothing is interpolated over triangles.
"""

import numba
import numpy as np

from pgm_data.simulate.blocks.light import free_way
from pgm_data.simulate.blocks.sky import sky_colour

FOOTPRINT = 0.85
"""Width of the box that a texel is averaged over, of a pixel's step in texels."""
PLAYER_REACH_M = 1.45
"""Beyond this from the middle of the figure there is nothing of it."""


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _texel_at(forms, q, px, py):
    w = forms[q, 0, 0] * px + forms[q, 0, 1] * py + forms[q, 0, 2]
    u = (forms[q, 1, 0] * px + forms[q, 1, 1] * py + forms[q, 1, 2]) / w
    v = (forms[q, 2, 0] * px + forms[q, 2, 1] * py + forms[q, 2, 2]) / w
    return u, v


@numba.njit(cache=True, nogil=True, error_model="numpy")
def see(order, outline, forms, counts, offsets, holes, cover, samples, nearest, seen):
    """Fill `nearest` (1/z) and `seen` (rectangle, -1 for none) with what each sample sees."""
    nearest[:] = 0.0
    seen[:] = -1
    rows, columns = seen.shape
    for n in range(len(order)):
        q = order[n]
        top, bottom = 1e30, -1e30
        for c in range(4):
            top = min(top, outline[q, c, 1])
            bottom = max(bottom, outline[q, c, 1])
        first = max(int(np.ceil((top + 0.5) * samples - 0.5)), 0)
        last = min(int(np.floor((bottom + 0.5) * samples - 0.5)), rows - 1)
        a, b, c0 = forms[q, 0, 0], forms[q, 0, 1], forms[q, 0, 2]
        for row in range(first, last + 1):
            py = (row + 0.5) / samples - 0.5
            left, right = 1e30, -1e30
            for c in range(4):
                x0, y0 = outline[q, c, 0], outline[q, c, 1]
                x1, y1 = outline[q, (c + 1) % 4, 0], outline[q, (c + 1) % 4, 1]
                if (y0 <= py < y1) or (y1 <= py < y0):
                    x = x0 + (py - y0) * (x1 - x0) / (y1 - y0)
                    left, right = min(left, x), max(right, x)
            if right < left:
                continue
            start = max(int(np.ceil((left + 0.5) * samples - 0.5 - 1e-7)), 0)
            stop = min(int(np.floor((right + 0.5) * samples - 0.5 + 1e-7)), columns - 1)
            base = b * py + c0 + a * (0.5 / samples - 0.5)
            step = a / samples
            if holes[q]:
                for column in range(start, stop + 1):
                    w = base + step * column
                    if w > nearest[row, column]:
                        u, v = _texel_at(forms, q, (column + 0.5) / samples - 0.5, py)
                        i = min(max(int(u), 0), counts[q, 0] - 1)
                        j = min(max(int(v), 0), counts[q, 1] - 1)
                        if cover[offsets[q] + j * counts[q, 0] + i]:
                            nearest[row, column] = w
                            seen[row, column] = q
            else:
                for column in range(start, stop + 1):
                    w = np.float32(base + step * column)
                    if w > nearest[row, column]:
                        nearest[row, column] = w
                        seen[row, column] = q


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _fetch(forms, counts, offsets, colours, q, px, py, out):
    """Mean over a pixel's box of a rectangle's texels: colour (BGR) and share of sunlight in it."""
    w = forms[q, 0, 0] * px + forms[q, 0, 1] * py + forms[q, 0, 2]
    u = (forms[q, 1, 0] * px + forms[q, 1, 1] * py + forms[q, 1, 2]) / w
    v = (forms[q, 2, 0] * px + forms[q, 2, 1] * py + forms[q, 2, 2]) / w
    ux, uy = (forms[q, 1, 0] - u * forms[q, 0, 0]) / w, (forms[q, 1, 1] - u * forms[q, 0, 1]) / w
    vx, vy = (forms[q, 2, 0] - v * forms[q, 0, 0]) / w, (forms[q, 2, 1] - v * forms[q, 0, 1]) / w
    wide = min(max(FOOTPRINT * np.sqrt(ux * ux + uy * uy), 1e-3), 6.0)
    tall = min(max(FOOTPRINT * np.sqrt(vx * vx + vy * vy), 1e-3), 6.0)
    i0, i1 = int(np.floor(u - 0.5 * wide)), int(np.floor(u + 0.5 * wide))
    j0, j1 = int(np.floor(v - 0.5 * tall)), int(np.floor(v + 0.5 * tall))
    nu, nv = counts[q, 0], counts[q, 1]
    out[:] = 0.0
    for j in range(j0, j1 + 1):
        part_v = min(v + 0.5 * tall, j + 1.0) - max(v - 0.5 * tall, float(j))
        row = offsets[q] + min(max(j, 0), nv - 1) * nu
        for i in range(i0, i1 + 1):
            part = part_v * (min(u + 0.5 * wide, i + 1.0) - max(u - 0.5 * wide, float(i)))
            at = row + min(max(i, 0), nu - 1)
            for c in range(4):
                out[c] += part * colours[at, c]
    for c in range(4):
        out[c] /= wide * tall


@numba.njit(cache=True, nogil=True, error_model="numpy")
def figure_hides(parts_R, parts_t, boxes, x, y, z, sx, sy, sz, skip):
    """Whether the figure (but one of its parts) lies between a point and the sun."""
    for p in range(len(parts_R)):
        if p == skip:
            continue
        ax, ay, az = x - parts_t[p, 0], y - parts_t[p, 1], z - parts_t[p, 2]
        near, far = 1e-4, 1e30
        for c in range(3):
            o = parts_R[p, 0, c] * ax + parts_R[p, 1, c] * ay + parts_R[p, 2, c] * az
            d = parts_R[p, 0, c] * sx + parts_R[p, 1, c] * sy + parts_R[p, 2, c] * sz
            if abs(d) < 1e-12:
                if o < boxes[p, 0, c] or o > boxes[p, 1, c]:
                    far = -1.0
                continue
            t0, t1 = (boxes[p, 0, c] - o) / d, (boxes[p, 1, c] - o) / d
            near, far = max(near, min(t0, t1)), min(far, max(t0, t1))
        if near < far:
            return True
    return False


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _place(rays, centre, px, py, z, out):
    """World place of a pixel at a depth."""
    for c in range(3):
        out[c] = centre[c] + z * (rays[c, 0] * px + rays[c, 1] * py + rays[c, 2])


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _shade(
    q,
    px,
    py,
    forms,
    counts,
    offsets,
    colours,
    normals,
    first_player,
    rays,
    centre,
    sun,
    light,
    opaque,
    parts,
    soft,
    texel,
    place,
    out,
):
    """Colour of a rectangle at a pixel; `texel` and `place` are room to work in."""
    parts_R, parts_t, boxes, middle = parts
    if soft > 1:
        _fetch(forms, counts, offsets, colours, q, px, py, texel)
    else:
        u, v = _texel_at(forms, q, px, py)
        i = min(max(int(np.floor(u)), 0), counts[q, 0] - 1)
        j = min(max(int(np.floor(v)), 0), counts[q, 1] - 1)
        for c in range(4):
            texel[c] = colours[offsets[q] + j * counts[q, 0] + i, c]
    w = forms[q, 0, 0] * px + forms[q, 0, 1] * py + forms[q, 0, 2]
    z = 1.0 / w
    if q >= first_player:
        _place(rays, centre, px, py, z, place)
        nx, ny, nz = normals[q]
        slope = nx * sun[0] + ny * sun[1] + nz * sun[2]
        lit = 0.0
        if slope > 0:
            x, y, zz = place[0] + 0.01 * nx, place[1] + 0.01 * ny, place[2] + 0.01 * nz
            if free_way(opaque, x, y, zz, sun[0], sun[1], sun[2], 60.0) >= 60.0:
                part = (q - first_player) // 6
                if not figure_hides(parts_R, parts_t, boxes, x, y, zz, sun[0], sun[1], sun[2], part):
                    lit = slope
        around = 0.80 + 0.20 * nz
        for c in range(3):
            out[c] = texel[c] * (light[0, c] * around + light[1, c] * lit)
    else:
        share = 1.0
        if texel[3] > 2.0:
            _place(rays, centre, px, py, z, place)
            dx, dy, dz = middle[0] - place[0], middle[1] - place[1], middle[2] - place[2]
            along = dx * sun[0] + dy * sun[1] + dz * sun[2]
            aside = dx * dx + dy * dy + dz * dz - along * along
            if along > -PLAYER_REACH_M and aside < PLAYER_REACH_M * PLAYER_REACH_M:
                hidden = 0.0
                for n in range(soft * soft):
                    sx = px + (n % soft + 0.5) / soft - 0.5
                    sy = py + (n // soft + 0.5) / soft - 0.5
                    ws = forms[q, 0, 0] * sx + forms[q, 0, 1] * sy + forms[q, 0, 2]
                    _place(rays, centre, sx, sy, 1.0 / ws, place)
                    if figure_hides(parts_R, parts_t, boxes, place[0], place[1], place[2], sun[0], sun[1], sun[2], -1):
                        hidden += 1.0
                share = 1.0 - hidden / (soft * soft) * texel[3] / 255.0
        for c in range(3):
            out[c] = texel[c] * share
    haze = z / (z + light[3, 0])
    for c in range(3):
        out[c] += haze * (light[2, c] - out[c])


@numba.njit(cache=True, nogil=True, error_model="numpy")
def paint(
    seen,
    samples,
    forms,
    counts,
    offsets,
    colours,
    normals,
    first_player,
    rays,
    centre,
    sun,
    light,
    opaque,
    parts,
    sky,
    soft,
    picture,
):
    """Colour every pixel: each rectangle that it sees once, where its samples lie, by their share."""
    rows, columns = picture.shape[:2]
    colour = np.empty(3)
    total = np.empty(3)
    direction = np.empty(3)
    texel = np.empty(4)
    place = np.empty(3)
    for row in range(rows):
        for column in range(columns):
            first = seen[row * samples, column * samples]
            same = True
            for n in range(1, samples * samples):
                if seen[row * samples + n // samples, column * samples + n % samples] != first:
                    same = False
                    break
            total[:] = 0.0
            done = 0
            for n in range(samples * samples):
                q = seen[row * samples + n // samples, column * samples + n % samples]
                count, px, py = samples * samples, float(column), float(row)
                if not same:
                    count, sx, sy = 0, 0.0, 0.0
                    again = False
                    for m in range(samples * samples):
                        if seen[row * samples + m // samples, column * samples + m % samples] == q:
                            if m < n:
                                again = True
                                break
                            count += 1
                            sx += (m % samples + 0.5) / samples - 0.5
                            sy += (m // samples + 0.5) / samples - 0.5
                    if again:
                        continue
                    px, py = column + sx / count, row + sy / count
                if q < 0:
                    for c in range(3):
                        direction[c] = rays[c, 0] * px + rays[c, 1] * py + rays[c, 2]
                    sky_colour(direction, sun, sky, light, colour)
                else:
                    _shade(
                        q,
                        px,
                        py,
                        forms,
                        counts,
                        offsets,
                        colours,
                        normals,
                        first_player,
                        rays,
                        centre,
                        sun,
                        light,
                        opaque,
                        parts,
                        soft,
                        texel,
                        place,
                        colour,
                    )
                for c in range(3):
                    total[c] += count * colour[c]
                done += count
                if same:
                    break
            for c in range(3):
                picture[row, column, c] = np.uint8(min(max(total[c] / done + 0.5, 0.0), 255.0))
