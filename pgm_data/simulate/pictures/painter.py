"""Paints flat polygons of the world into a picture with exact area coverage.

A polygon is clipped in front of the camera, its edges are cut into short pieces, bent by the lens and summed as
signed areas: a pixel's weight is the share of its square (centre at the integer) that the polygon covers. Nothing is
resampled, so the middle of a painted line lies where the camera puts it, up to the pieces' length.
"""

import math

import numba
import numpy as np

NEAR_M = 0.2
PIECE_PX = 14.0
MAX_CORNERS = 96
FINE = 3
SOFTER = 0.4
"""How many halvings a texture seen from afar is taken smaller than its pixels need: fine patterns do not flicker."""


_kernel = numba.njit(cache=True, nogil=True, error_model="numpy")


@_kernel
def _add_edge(cover, x0, y0, x1, y1):
    sign = 1.0
    if y0 > y1:
        x0, y0, x1, y1 = x1, y1, x0, y0
        sign = -1.0
    rows = cover.shape[0]
    width = float(cover.shape[1] - 2)
    if y1 <= 0.0 or y0 >= rows or y1 - y0 < 1e-12:
        return
    slope = (x1 - x0) / (y1 - y0)
    first = max(0, int(math.floor(y0)))
    last = min(rows, int(math.ceil(y1)))
    for row in range(first, last):
        top = max(y0, float(row))
        bottom = min(y1, row + 1.0)
        if bottom <= top:
            continue
        xa = x0 + slope * (top - y0)
        xb = x0 + slope * (bottom - y0)
        if xa > xb:
            xa, xb = xb, xa
        weight = sign * (bottom - top)
        if xb <= 0.0:
            cover[row, 0] += weight
            continue
        if xa >= width:
            continue
        if xa < 0.0:  # the part left of the picture acts on its first column in full
            outside = xa / (xa - xb)
            cover[row, 0] += weight * outside
            weight *= 1.0 - outside
            xa = 0.0
        if xb > width:
            weight *= (width - xa) / (xb - xa)
            xb = width
        column = int(xa)
        stop = int(math.ceil(xb))
        span = xb - xa
        # Area to the right of the edge, column by column: differences of the mean of max(column - x, 0) over x.
        before = 0.0
        area_before = 0.0
        while column < stop:
            right = column + 1.0
            if right >= xb:
                after = right - 0.5 * (xa + xb)
            elif right > xa:
                after = (right - xa) * (right - xa) / (2.0 * span)
            else:
                after = 0.0
            area = after - before
            cover[row, column] += weight * (area - area_before)
            area_before = area
            before = after
            column += 1
        cover[row, column] += weight * (1.0 - area_before)


@_kernel
def _clip(points, count, a, b, c, d, out):
    kept = 0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        side = a * points[i, 0] + b * points[i, 1] + c * points[i, 2] + d
        other = a * points[j, 0] + b * points[j, 1] + c * points[j, 2] + d
        if side >= 0.0 and kept < out.shape[0]:
            out[kept] = points[i]
            kept += 1
        if (side >= 0.0) != (other >= 0.0) and kept < out.shape[0]:
            share = side / (side - other)
            for k in range(3):
                out[kept, k] = points[i, k] + share * (points[j, k] - points[i, k])
            kept += 1
    return kept


@_kernel
def _cover(cover, box, polygon, view, limits, first, second):
    """Adds a polygon's signed areas; `box` becomes its pixel box (x0, y0, x1, y1, ends excluded). False if unseen."""
    fx, fy, cx, cy, k1 = view[0], view[1], view[2], view[3], view[4]
    count = min(polygon.shape[0], MAX_CORNERS)
    for i in range(count):
        for k in range(3):
            first[i, k] = (
                view[5 + 3 * k] * polygon[i, 0]
                + view[6 + 3 * k] * polygon[i, 1]
                + view[7 + 3 * k] * polygon[i, 2]
                + view[14 + k]
            )
    count = _clip(first, count, 0.0, 0.0, 1.0, -NEAR_M, second)
    count = _clip(second, count, 1.0, 0.0, -limits[0], 0.0, first)
    count = _clip(first, count, -1.0, 0.0, limits[1], 0.0, second)
    count = _clip(second, count, 0.0, 1.0, -limits[2], 0.0, first)
    count = _clip(first, count, 0.0, -1.0, limits[3], 0.0, second)
    if count < 3:
        return False
    rows, columns = cover.shape[0], cover.shape[1] - 2
    low_x, low_y, high_x, high_y = 1e9, 1e9, -1e9, -1e9
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        xa, ya = second[i, 0] / second[i, 2], second[i, 1] / second[i, 2]
        xb, yb = second[j, 0] / second[j, 2], second[j, 1] / second[j, 2]
        pieces = int(math.ceil(math.hypot((xb - xa) * fx, (yb - ya) * fy) / PIECE_PX)) if k1 != 0.0 else 1
        pieces = max(pieces, 1)
        bend = 1.0 + k1 * (xa * xa + ya * ya)
        px, py = fx * xa * bend + cx + 0.5, fy * ya * bend + cy + 0.5
        for piece in range(1, pieces + 1):
            share = piece / pieces
            x, y = xa + share * (xb - xa), ya + share * (yb - ya)
            bend = 1.0 + k1 * (x * x + y * y)
            qx, qy = fx * x * bend + cx + 0.5, fy * y * bend + cy + 0.5
            _add_edge(cover, px, py, qx, qy)
            low_x, high_x = min(low_x, qx), max(high_x, qx)
            low_y, high_y = min(low_y, qy), max(high_y, qy)
            px, py = qx, qy
    box[0] = min(max(int(math.floor(low_x)), 0), columns)
    box[1] = min(max(int(math.floor(low_y)), 0), rows)
    box[2] = min(max(int(math.ceil(high_x)) + 1, 0), columns)
    box[3] = min(max(int(math.ceil(high_y)) + 1, 0), rows)
    return True


@_kernel
def _clear(cover, box):
    for row in range(box[1], box[3]):
        for column in range(box[0], box[2] + 2):
            cover[row, column] = 0.0


@_kernel
def paint_flat(image, cover, polygons, starts, colours, alphas, view, limits, keep):
    """Paints polygons in order: image (H, W, 3) float32 changes in place.

    `polygons` holds all corners (N, 3) in world metres, `starts` (P + 1) where each begins; `keep` (H, W) multiplies
    every weight, or is empty; `cover` (H, W + 2) float32 is zero before and after.
    """
    first = np.empty((MAX_CORNERS + 12, 3))
    second = np.empty((MAX_CORNERS + 12, 3))
    box = np.zeros(4, dtype=np.int64)
    worn = keep.shape[0] > 0
    for p in range(starts.shape[0] - 1):
        if not _cover(cover, box, polygons[starts[p] : starts[p + 1]], view, limits, first, second):
            continue
        c0, c1, c2, alpha = colours[p, 0], colours[p, 1], colours[p, 2], alphas[p]
        for row in range(box[1], box[3]):
            total = np.float32(0.0)
            for column in range(box[0], box[2]):
                total += cover[row, column]
                weight = min(abs(total), np.float32(1.0))
                if weight > 1e-3:
                    weight *= alpha
                    if worn:
                        weight *= keep[row, column]
                    image[row, column, 0] += weight * (c0 - image[row, column, 0])
                    image[row, column, 1] += weight * (c1 - image[row, column, 1])
                    image[row, column, 2] += weight * (c2 - image[row, column, 2])
        _clear(cover, box)


@_kernel
def paint_fine(image, layer, cover, polygons, starts, colour, alphas, view, limits, keep):
    """Paints polygons of one colour that do not overlap, in place, with a tent two pixels wide for the pixel's square.

    A square pixel moves the centroid of a line thinner than itself towards the pixel's centre, by up to 0.3 px; a tent
    does not. The tent is the square pixel averaged over FINE x FINE shifts. `cover` (FINE H + 2 FINE, FINE W + 2 FINE
    + 2) and `layer` (H, W) are zero before and after; `view` is the plain view of the picture.
    """
    first = np.empty((MAX_CORNERS + 12, 3))
    second = np.empty((MAX_CORNERS + 12, 3))
    box = np.zeros(4, dtype=np.int64)
    height, width = image.shape[0], image.shape[1]
    fine = view.copy()
    for i in range(2):
        fine[i] = FINE * view[i]
        fine[2 + i] = FINE * view[2 + i] + 0.5 * (FINE - 1) + FINE
    worn = keep.shape[0] > 0
    left, upper, right, lower = width, height, 0, 0
    for p in range(starts.shape[0] - 1):
        if not _cover(cover, box, polygons[starts[p] : starts[p + 1]], fine, limits, first, second):
            continue
        for row in range(box[1], box[3]):
            total = np.float32(0.0)
            for column in range(box[0], box[2]):
                total += cover[row, column]
                cover[row, column] = min(abs(total), np.float32(1.0))
            cover[row, box[2]] = 0.0
            cover[row, box[2] + 1] = 0.0
        r0, r1 = max(0, box[1] // FINE - 2), min(height, box[3] // FINE + 1)
        c0, c1 = max(0, box[0] // FINE - 2), min(width, box[2] // FINE + 1)
        left, upper, right, lower = min(left, c0), min(upper, r0), max(right, c1), max(lower, r1)
        for row in range(r0, r1):
            for column in range(c0, c1):
                weight = np.float32(0.0)
                for i in range(2 * FINE - 1):
                    for j in range(2 * FINE - 1):
                        part = cover[FINE * row + 2 + i, FINE * column + 2 + j]
                        if part > 0.0:
                            weight += (FINE - abs(i - FINE + 1)) * (FINE - abs(j - FINE + 1)) * part
                layer[row, column] += alphas[p] * weight / FINE**4
        _clear(cover, box)
    for row in range(upper, lower):
        for column in range(left, right):
            weight = min(layer[row, column], np.float32(1.0))
            if weight > 0.0:
                layer[row, column] = 0.0
                if worn:
                    weight *= keep[row, column]
                for k in range(3):
                    image[row, column, k] += weight * (colour[k] - image[row, column, k])


@_kernel
def _read(texture, top, rows, columns, u, v, channels, out):
    """Fills `out` from a picture that repeats, between its pixels; it fills these rows and columns from `top` on."""
    iu, iv = int(math.floor(u)), int(math.floor(v))
    du, dv = np.float32(u - iu), np.float32(v - iv)
    u0, v0, u1, v1 = (
        iu & (columns - 1),
        top + (iv & (rows - 1)),
        (iu + 1) & (columns - 1),
        top + ((iv + 1) & (rows - 1)),
    )
    w11 = du * dv
    w01, w10 = du - w11, dv - w11
    w00 = np.float32(1.0) - du - w10
    for k in range(channels):
        out[k] = (
            w00 * texture[v0, u0, k] + w01 * texture[v0, u1, k] + w10 * texture[v1, u0, k] + w11 * texture[v1, u1, k]
        )


@_kernel
def paint_texture(
    image, cover, polygon, view, limits, straight, uv_from_ray, texture, base, gain, alpha, by_mask, smaller
):
    """Paints one polygon with `base + gain * texture`, in place.

    `uv_from_ray` (3, 3) takes the pinhole ray (x, y, 1), kept per pixel in `straight` (H, W, 2), to texture pixels;
    the texture, whose sides are powers of two, repeats. With `by_mask` its first channel (0 to 255) is the weight and
    the colour is `base`. `smaller` holds the texture at a half, a quarter and so on, one below the other, for where
    it is seen from afar; none if empty.
    """
    first = np.empty((MAX_CORNERS + 12, 3))
    second = np.empty((MAX_CORNERS + 12, 3))
    box = np.zeros(4, dtype=np.int64)
    if not _cover(cover, box, polygon, view, limits, first, second):
        return
    rows, columns = texture.shape[0], texture.shape[1]
    channels = 1 if by_mask else 3
    levels, total_rows = 0, 0
    while total_rows + (rows >> (levels + 1)) <= smaller.shape[0] and (rows >> (levels + 1)) > 0:
        levels += 1
        total_rows += rows >> levels
    H = uv_from_ray
    step_x, step_y = 1.0 / (view[0] * view[0]), 1.0 / (view[1] * view[1])
    value, other = np.empty(3, np.float32), np.empty(3, np.float32)
    for row in range(box[1], box[3]):
        total = np.float32(0.0)
        level = -1.0
        for column in range(box[0], box[2]):
            total += cover[row, column]
            weight = min(abs(total), np.float32(1.0)) * alpha
            if weight <= 1e-3:
                continue
            x, y = straight[row, column, 0], straight[row, column, 1]
            w = 1.0 / (H[2, 0] * x + H[2, 1] * y + H[2, 2])
            u = (H[0, 0] * x + H[0, 1] * y + H[0, 2]) * w
            v = (H[1, 0] * x + H[1, 1] * y + H[1, 2]) * w
            if not (abs(u) < 1e7 and abs(v) < 1e7):
                continue
            if column & 7 == 0 or level < 0.0:
                # Texture pixels that one pixel of the picture covers, squared: the mean of both directions.
                ux, vx = (H[0, 0] - u * H[2, 0]) * w, (H[1, 0] - v * H[2, 0]) * w
                uy, vy = (H[0, 1] - u * H[2, 1]) * w, (H[1, 1] - v * H[2, 1]) * w
                size = 0.5 * ((ux * ux + vx * vx) * step_x + (uy * uy + vy * vy) * step_y)
                level = min(max(0.5 * math.log2(size) + SOFTER, 0.0), float(levels)) if size > 0.5 else 0.0
            low = min(int(level), levels)
            # Halfway between two sizes both are mixed, near either it is taken alone.
            part = np.float32(min(max(2.0 * (level - low) - 0.5, 0.0), 1.0))
            if low == 0:
                _read(texture, 0, rows, columns, u, v, channels, value)
            else:
                fine, top = 0.5**low, rows - (rows >> (low - 1))
                shift = 0.5 * fine - 0.5
                _read(smaller, top, rows >> low, columns >> low, u * fine + shift, v * fine + shift, channels, value)
            if part > np.float32(0.02):
                low += 1
                coarse, top = 0.5**low, rows - (rows >> (low - 1))
                shift = 0.5 * coarse - 0.5
                _read(
                    smaller, top, rows >> low, columns >> low, u * coarse + shift, v * coarse + shift, channels, other
                )
                for k in range(channels):
                    value[k] += part * (other[k] - value[k])
            if by_mask:
                weight *= value[0] / np.float32(255.0)
                for k in range(3):
                    image[row, column, k] += weight * (base[k] - image[row, column, k])
            else:
                for k in range(3):
                    image[row, column, k] += weight * (base[k] + gain[k] * value[k] - image[row, column, k])
    _clear(cover, box)


@_kernel
def straight_rays(height, width, view, out):
    """Fills `out` (H, W, 2) with each pixel's pinhole coordinates (x/z, y/z), to some 0.01 px: good for textures."""
    fx, fy, cx, cy, k1 = view[0], view[1], view[2], view[3], view[4]
    for row in range(height):
        y = (row - cy) / fy
        for column in range(width):
            x = (column - cx) / fx
            a = k1 * (x * x + y * y)
            scale = 1.0 - a
            scale -= (scale * (1.0 + a * scale * scale) - 1.0) / (1.0 + 3.0 * a * scale * scale)
            out[row, column, 0] = x * scale
            out[row, column, 1] = y * scale


@_kernel
def _noise_at(noise, x, y):
    wrap = noise.shape[0] - 1
    ix, iy = int(math.floor(x)), int(math.floor(y))
    dx, dy = np.float32(x - ix), np.float32(y - iy)
    x0, y0, x1, y1 = ix & wrap, iy & wrap, (ix + 1) & wrap, (iy + 1) & wrap
    return (noise[y0, x0] * (1 - dx) + noise[y0, x1] * dx) * (1 - dy) + (
        noise[y1, x0] * (1 - dx) + noise[y1, x1] * dx
    ) * dy


@_kernel
def texture_ground(image, straight, ground_from_ray, look, noise, keep):
    """Multiplies the painted ground by grain and stripes, in place; `keep` becomes the share of the lines' paint left.

    `look`: (grain, its cells per m, patches, their cells per m, stripes along the length and across it, their width m,
    wear of the lines).
    """
    grain, grain_scale, patch, patch_scale = look[0], look[1], look[2], look[3]
    lengthwise, crosswise, per_m, wear = look[4], look[5], 1.0 / look[6], look[7]
    H = ground_from_ray
    for row in range(image.shape[0]):
        for column in range(image.shape[1]):
            rx, ry = straight[row, column, 0], straight[row, column, 1]
            w = H[2, 0] * rx + H[2, 1] * ry + H[2, 2]
            if w <= 1e-4:
                keep[row, column] = 1.0
                continue
            w = 1.0 / w
            x = (H[0, 0] * rx + H[0, 1] * ry + H[0, 2]) * w
            y = (H[1, 0] * rx + H[1, 1] * ry + H[1, 2]) * w
            fine = _noise_at(noise, x * grain_scale, y * grain_scale)
            coarse = _noise_at(noise, y * patch_scale + 91.0, x * patch_scale)
            factor = 1.0 + grain * fine + patch * coarse
            if lengthwise > 0.0:
                factor += lengthwise if int(math.floor(x * per_m)) & 1 == 0 else -lengthwise
            if crosswise > 0.0:
                factor += crosswise if int(math.floor(y * per_m)) & 1 == 0 else -crosswise
            for k in range(3):
                image[row, column, k] *= factor
            if wear > 0.0:
                keep[row, column] = 1.0 - wear * min(max(0.5 + 1.6 * coarse + 0.8 * fine, 0.0), 1.0)
            else:
                keep[row, column] = 1.0
