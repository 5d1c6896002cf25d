"""Fills triangles into sample buffers with a z test: the inner loops of the rasteriser.

A buffer holds S x S samples per pixel; sample (i, j) of a box that starts at pixel (x0, y0) lies at
x0 + (j + 0.5) / S - 0.5, y0 + (i + 0.5) / S - 0.5, pixel centres being at integers. Attributes are perspective
correct. One thread, no fast mathematics: the same bytes everywhere.
"""

import math

import numba
import numpy as np

NEAR_M = 0.05
"""Triangles are cut where they come closer to the camera's plane than this."""

_kernel = numba.njit(cache=True, nogil=True, error_model="numpy")


@_kernel
def look(vertices, view, cam, px):
    """Fills camera coordinates (V, 3) and pixels (V, 2); NaN pixels for what is not in front of the near plane.

    `view`: fx, fy, cx, cy, k1, R_cam_from_world by rows, t_cam_from_world.
    """
    for i in range(vertices.shape[0]):
        for k in range(3):
            cam[i, k] = (
                view[5 + 3 * k] * vertices[i, 0]
                + view[6 + 3 * k] * vertices[i, 1]
                + view[7 + 3 * k] * vertices[i, 2]
                + view[14 + k]
            )
        if cam[i, 2] >= NEAR_M:
            px[i, 0], px[i, 1] = _pixel(view, cam[i, 0], cam[i, 1], cam[i, 2])
        else:
            px[i, 0] = px[i, 1] = np.nan


@_kernel
def _pixel(view, x, y, z):
    u, v = x / z, y / z
    k1 = view[4]
    radius2 = u * u + v * v
    # A lens with k1 < 0 folds back what lies further out than this: held there, outside of every picture.
    if k1 < 0.0 and radius2 > -1.0 / (3.0 * k1):
        out = math.sqrt(-1.0 / (3.0 * k1) / radius2)
        u, v, radius2 = u * out, v * out, radius2 * out * out
    bend = 1.0 + k1 * radius2
    return view[0] * u * bend + view[2], view[1] * v * bend + view[3]


@_kernel
def box_of(cam, px, triangles, view, width, height, box):
    """Pixel box (x0, y0, x1, y1, ends excluded) of all triangles, inside the picture. False if it is empty."""
    low_x, low_y, high_x, high_y = 1e30, 1e30, -1e30, -1e30
    for t in range(triangles.shape[0]):
        near = False
        front = False
        for k in range(3):
            v = triangles[t, k]
            if cam[v, 2] >= NEAR_M:
                front = True
                low_x, high_x = min(low_x, px[v, 0]), max(high_x, px[v, 0])
                low_y, high_y = min(low_y, px[v, 1]), max(high_y, px[v, 1])
            else:
                near = True
        if near and front:
            for k in range(3):
                a, b = triangles[t, k], triangles[t, (k + 1) % 3]
                if (cam[a, 2] >= NEAR_M) != (cam[b, 2] >= NEAR_M):
                    s = (NEAR_M - cam[a, 2]) / (cam[b, 2] - cam[a, 2])
                    x, y = cam[a, 0] + s * (cam[b, 0] - cam[a, 0]), cam[a, 1] + s * (cam[b, 1] - cam[a, 1])
                    u, v2 = _pixel(view, x, y, NEAR_M)
                    low_x, high_x = min(low_x, u), max(high_x, u)
                    low_y, high_y = min(low_y, v2), max(high_y, v2)
    if not (high_x >= -0.5 and high_y >= -0.5 and low_x <= width - 0.5 and low_y <= height - 0.5):
        return False
    box[0] = int(math.floor(max(low_x, 0.0) + 0.5))
    box[1] = int(math.floor(max(low_y, 0.0) + 0.5))
    box[2] = int(math.floor(min(high_x, width - 1.0) + 0.5)) + 1
    box[3] = int(math.floor(min(high_y, height - 1.0) + 0.5)) + 1
    return box[2] > box[0] and box[3] > box[1]


@_kernel
def _clip_near(corners, count, out):
    """Cuts a polygon of corners (camera x, y, z, then attributes) at the near plane; returns how many are left."""
    kept = 0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        inside, other = corners[i, 2] >= NEAR_M, corners[j, 2] >= NEAR_M
        if inside:
            out[kept] = corners[i]
            kept += 1
        if inside != other:
            # From the far corner to the near one in either order, so that neighbours cut their edge alike.
            a, b = (i, j) if inside else (j, i)
            s = (corners[a, 2] - NEAR_M) / (corners[a, 2] - corners[b, 2])
            for k in range(corners.shape[1]):
                out[kept, k] = corners[a, k] + s * (corners[b, k] - corners[a, k])
            out[kept, 2] = NEAR_M
            kept += 1
    return kept


@_kernel
def _texel(texture, layer, u, v, smooth, out):
    """Reads BGR (and opacity, 255 where there is none) at u, v, which count repeats of the texture."""
    tall, wide, channels = texture.shape[1], texture.shape[2], texture.shape[3]
    out[3] = 255.0
    if smooth:
        x, y = u * wide - 0.5, v * tall - 0.5
        ix, iy = math.floor(x), math.floor(y)
        dx, dy = x - ix, y - iy
        x0, y0 = int(ix) % wide, int(iy) % tall
        x1 = x0 + 1 if x0 + 1 < wide else 0
        y1 = y0 + 1 if y0 + 1 < tall else 0
        for k in range(channels):
            upper = (1.0 - dx) * texture[layer, y0, x0, k] + dx * texture[layer, y0, x1, k]
            lower = (1.0 - dx) * texture[layer, y1, x0, k] + dx * texture[layer, y1, x1, k]
            out[k] = (1.0 - dy) * upper + dy * lower
    else:
        x0 = min(int((u - math.floor(u)) * wide), wide - 1)
        y0 = min(int((v - math.floor(v)) * tall), tall - 1)
        for k in range(channels):
            out[k] = texture[layer, y0, x0, k]


@_kernel
def _fill(colour, nearest, label, corners, pixels, order, mark, solid, ranks, texture, layer, smooth, texel, S):
    """One triangle: `corners` hold camera z at [2], BGR at [3:6] and u, v at [6:8]; `pixels` in samples of the box."""
    i0, i1, i2 = order[0], order[1], order[2]
    ax, ay, bx, by, cx, cy = (
        pixels[i0, 0],
        pixels[i0, 1],
        pixels[i1, 0],
        pixels[i1, 1],
        pixels[i2, 0],
        pixels[i2, 1],
    )
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    if not (abs(area) > 1e-12):
        return
    if not (max(abs(ax), abs(ay), abs(bx), abs(by), abs(cx), abs(cy)) < 1e15):
        return
    if area < 0.0:
        i1, i2 = i2, i1
        bx, by, cx, cy = cx, cy, bx, by
        area = -area
    rows, columns = nearest.shape[0], nearest.shape[1]
    top, bottom = min(ay, by, cy), max(ay, by, cy)
    left, right = min(ax, bx, cx), max(ax, bx, cx)
    if bottom < 0.0 or right < 0.0 or top > rows - 1.0 or left > columns - 1.0:
        return
    first_row, last_row = int(math.ceil(max(top, 0.0))), int(math.floor(min(bottom, rows - 1.0)))
    first, last = int(math.ceil(max(left, 0.0))), int(math.floor(min(right, columns - 1.0)))
    if first > last:
        return
    inverse = 1.0 / area
    wa, wb, wc = 1.0 / corners[i0, 2], 1.0 / corners[i1, 2], 1.0 / corners[i2, 2]
    textured = texture.shape[0] > 0
    stippled = solid < ranks.shape[0]
    # Twice the area opposite to each corner, as it changes from column to column.
    step_a, step_b, step_c = by - cy, cy - ay, ay - by
    for row in range(first_row, last_row + 1):
        y = float(row)
        base_a = (cx - bx) * (y - by) - (cy - by) * (0.0 - bx)
        base_b = (ax - cx) * (y - cy) - (ay - cy) * (0.0 - cx)
        base_c = (bx - ax) * (y - ay) - (by - ay) * (0.0 - ax)
        start, stop = first, last
        if last - first > 8:
            low, high = float(first), float(last)
            for edge in range(3):
                base = base_a if edge == 0 else (base_b if edge == 1 else base_c)
                step = step_a if edge == 0 else (step_b if edge == 1 else step_c)
                if step > 0.0:
                    low = max(low, -base / step - 1.0)
                elif step < 0.0:
                    high = min(high, -base / step + 1.0)
            if low > high:
                continue
            start, stop = int(math.ceil(low)), int(math.floor(high))
        for column in range(start, stop + 1):
            ea, eb, ec = base_a + step_a * column, base_b + step_b * column, base_c + step_c * column
            if ea < 0.0 or eb < 0.0 or ec < 0.0:
                continue
            ea *= inverse * wa
            eb *= inverse * wb
            ec *= inverse * wc
            depth_inverse = ea + eb + ec
            closeness = np.float32(depth_inverse)
            if not closeness > nearest[row, column]:
                continue
            if stippled and ranks[(row % S) * S + column % S] >= solid:
                continue
            z = 1.0 / depth_inverse
            ea *= z
            eb *= z
            ec *= z
            b = ea * corners[i0, 3] + eb * corners[i1, 3] + ec * corners[i2, 3]
            g = ea * corners[i0, 4] + eb * corners[i1, 4] + ec * corners[i2, 4]
            r = ea * corners[i0, 5] + eb * corners[i1, 5] + ec * corners[i2, 5]
            if textured:
                u = ea * corners[i0, 6] + eb * corners[i1, 6] + ec * corners[i2, 6]
                v = ea * corners[i0, 7] + eb * corners[i1, 7] + ec * corners[i2, 7]
                _texel(texture, layer, u, v, smooth, texel)
                if texel[3] < 127.5:
                    continue
                b *= texel[0]
                g *= texel[1]
                r *= texel[2]
            nearest[row, column] = closeness
            label[row, column] = mark
            colour[row, column, 0] = b
            colour[row, column, 1] = g
            colour[row, column, 2] = r


@_kernel
def fill_triangles(buffers, x0, y0, S, cam, px, triangles, mesh, skin, view, two_sided):
    """Draws all triangles into buffers (colour, nearest 1/z, label) of a box that starts at pixel x0, y0.

    `mesh`: colours (V, 3), uv (V, 2) or empty, labels (T), solid samples of a pixel (T); `skin`: texture (layers, tall,
    wide, 3 or 4) or empty, its layer (T), whether to interpolate it, ranks of a pixel's samples (S * S).
    """
    colour, nearest, label = buffers
    colours, uv, labels, solids = mesh
    texture, layers, smooth, ranks = skin
    textured = texture.shape[0] > 0
    rows, columns = nearest.shape[0], nearest.shape[1]
    corners = np.zeros((4, 8))
    cut = np.zeros((4, 8))
    pixels = np.zeros((4, 2))
    order = np.zeros(3, dtype=np.int64)
    texel = np.zeros(4)
    for t in range(triangles.shape[0]):
        behind = 0
        for k in range(3):
            if not cam[triangles[t, k], 2] >= NEAR_M:
                behind += 1
        if behind == 3:
            continue
        if behind == 0:
            a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            # Front faces are anticlockwise from outside: with y down that is a negative area.
            if not two_sided and (
                (px[b, 0] - px[a, 0]) * (px[c, 1] - px[a, 1]) - (px[b, 1] - px[a, 1]) * (px[c, 0] - px[a, 0]) >= 0.0
            ):
                continue
            pixels[0, 0], pixels[0, 1] = (px[a, 0] - x0 + 0.5) * S - 0.5, (px[a, 1] - y0 + 0.5) * S - 0.5
            pixels[1, 0], pixels[1, 1] = (px[b, 0] - x0 + 0.5) * S - 0.5, (px[b, 1] - y0 + 0.5) * S - 0.5
            pixels[2, 0], pixels[2, 1] = (px[c, 0] - x0 + 0.5) * S - 0.5, (px[c, 1] - y0 + 0.5) * S - 0.5
            # Most small triangles fall between samples or outside.
            low = max(min(pixels[0, 0], pixels[1, 0], pixels[2, 0]), 0.0)
            high = min(max(pixels[0, 0], pixels[1, 0], pixels[2, 0]), columns - 1.0)
            if math.ceil(low) > high:
                continue
            low = max(min(pixels[0, 1], pixels[1, 1], pixels[2, 1]), 0.0)
            high = min(max(pixels[0, 1], pixels[1, 1], pixels[2, 1]), rows - 1.0)
            if math.ceil(low) > high:
                continue
        for k in range(3):
            v = triangles[t, k]
            corners[k, 0], corners[k, 1], corners[k, 2] = cam[v, 0], cam[v, 1], cam[v, 2]
            corners[k, 3], corners[k, 4], corners[k, 5] = colours[v, 0], colours[v, 1], colours[v, 2]
            if textured:
                corners[k, 6], corners[k, 7] = uv[v, 0], uv[v, 1]
        count = 3
        shape = corners
        if behind > 0:
            count = _clip_near(corners, 3, cut)
            shape = cut
            for k in range(count):
                u, v2 = _pixel(view, cut[k, 0], cut[k, 1], cut[k, 2])
                pixels[k, 0], pixels[k, 1] = (u - x0 + 0.5) * S - 0.5, (v2 - y0 + 0.5) * S - 0.5
        for k in range(count - 2):
            order[0], order[1], order[2] = 0, k + 1, k + 2
            _fill(
                colour,
                nearest,
                label,
                shape,
                pixels,
                order,
                labels[t],
                solids[t],
                ranks,
                texture,
                layers[t] if textured else 0,
                smooth,
                texel,
                S,
            )


@_kernel
def averaged(colour, nearest, label, S, bgr, alpha, depth, mark):
    """Pixels of samples: mean colour of the covered ones, their share, nearest z (inf for none), its label (-1)."""
    share = np.float32(1.0 / (S * S))
    for row in range(alpha.shape[0]):
        for column in range(alpha.shape[1]):
            count = 0
            b = g = r = np.float32(0.0)
            best = np.float32(0.0)
            best_mark = np.int16(-1)
            for i in range(row * S, row * S + S):
                for j in range(column * S, column * S + S):
                    closeness = nearest[i, j]
                    if closeness > 0.0:
                        count += 1
                        b += colour[i, j, 0]
                        g += colour[i, j, 1]
                        r += colour[i, j, 2]
                        if closeness > best:
                            best = closeness
                            best_mark = label[i, j]
            mark[row, column] = best_mark
            if count > 0:
                part = np.float32(1.0 / count)
                bgr[row, column, 0] = b * part
                bgr[row, column, 1] = g * part
                bgr[row, column, 2] = r * part
                alpha[row, column] = count * share
                depth[row, column] = np.float32(1.0) / best
            else:
                bgr[row, column, 0] = bgr[row, column, 1] = bgr[row, column, 2] = 0.0
                alpha[row, column] = 0.0
                depth[row, column] = np.inf


@_kernel
def blend(image, bgr, alpha, x0, y0):
    """Lays a sprite that lies within the picture over it, in place."""
    for row in range(alpha.shape[0]):
        for column in range(alpha.shape[1]):
            weight = alpha[row, column]
            if weight > 0.0:
                for k in range(3):
                    below = image[y0 + row, x0 + column, k]
                    image[y0 + row, x0 + column, k] = below + weight * (bgr[row, column, k] - below)
