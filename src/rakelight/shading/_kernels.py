# mypy: disable-error-code="no-untyped-def"
"""The loops over pixels and photographs behind shading/photographs.py, compiled on first use.

Photographs stay as they were read and are decoded by a table, pixel by pixel; rows are shared
among the cores and every sum is kept per row, so that results do not depend on the split.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numba import prange

from rakelight import jit

# Sums over photographs are within a pixel, whose row is never split.
helper, kernel = partial(jit.helper, any_order=True), partial(jit.kernel, any_order=True)

# Rounds of reweighting for a pixel's own albedo.
ALBEDO_ROUNDS = 2
BINS = 1024
# Residuals are counted in bins up to this value; white is 1.
WIDEST = 0.5
# The logarithm of a product is the sum of losses; so many are finite below 5e4 scales each.
LOGARITHM = 32
# Rows of a matrix product that are gathered first.
STACK = 128


@helper
def geometry(gu, gv, x, y, fx, fy, n, du, dv, lagged):
    """Fill n (3) and the derivatives du, dv (3) of n, |m| lagged or not, at one pixel."""
    m0, m1, m2 = fx * gu, fy * gv, -(1.0 + x * gu + y * gv)
    length = np.sqrt(m0 * m0 + m1 * m1 + m2 * m2)
    n[0], n[1], n[2] = m0 / length, m1 / length, m2 / length
    du[0], du[1], du[2] = fx / length, 0.0, -x / length
    dv[0], dv[1], dv[2] = 0.0, fy / length, -y / length
    if not lagged:
        along_u = n[0] * du[0] + n[2] * du[2]
        along_v = n[1] * dv[1] + n[2] * dv[2]
        for k in range(3):
            du[k] -= along_u * n[k]
            dv[k] -= along_v * n[k]


@helper
def shade(vectors, nearness, n, point, near, dot, s):
    """Fill s (3, N) with one channel's lights at the point and dot (N) with s . n.

    The light vector that a lamp sends to X, metres from the object's middle: with q the vector at
    the middle, u = q/|q| and k = closeness, 1/metre, the lamp stands at u/k and
    s = |q| (u - k X) / |u - k X|^3, which is q itself for k = 0.
    vectors (3, N) : q; nearness (N) : |q| k
    """
    for i in range(dot.size):
        v0, v1, v2 = vectors[0, i], vectors[1, i], vectors[2, i]
        gain = 1.0
        if near:
            size2 = v0 * v0 + v1 * v1 + v2 * v2
            v0 -= nearness[i] * point[0]
            v1 -= nearness[i] * point[1]
            v2 -= nearness[i] * point[2]
            gain = size2 / (v0 * v0 + v1 * v1 + v2 * v2 + 1e-300)
            gain *= np.sqrt(gain)
        s[0, i], s[1, i], s[2, i] = gain * v0, gain * v1, gain * v2
        dot[i] = gain * (v0 * n[0] + v1 * n[1] + v2 * n[2])


@helper
def turn(vectors, n, point, s, dot, pull, out):
    """Add to out (5, N) what changes of lights' vectors and closeness do where s (3, N) arrive.

    pull (N) : what the shading's change counts.  With e = s/|s| and Df = 1/r^3 (I - 3 e e^T), both
    as in `shade`:  d/dq = Df n + u (s . n / |q| - u . Df n),  d/dk = -|q| X . Df n
    """
    for i in range(pull.size):
        q0, q1, q2 = vectors[0, i], vectors[1, i], vectors[2, i]
        s0, s1, s2 = s[0, i], s[1, i], s[2, i]
        size = np.sqrt(q0 * q0 + q1 * q1 + q2 * q2) + 1e-12
        there = np.sqrt(s0 * s0 + s1 * s1 + s2 * s2)
        by_r2 = there / size
        by_r3 = by_r2 * np.sqrt(by_r2)
        steep = 3.0 * dot[i] / (there * there + 1e-300)
        h0 = by_r3 * (n[0] - steep * s0)
        h1 = by_r3 * (n[1] - steep * s1)
        h2 = by_r3 * (n[2] - steep * s2)
        along = (dot[i] - (q0 * h0 + q1 * h1 + q2 * h2)) / (size * size)
        out[0, i] += pull[i] * (h0 + along * q0)
        out[1, i] += pull[i] * (h1 + along * q1)
        out[2, i] += pull[i] * (h2 + along * q2)
        out[3, i] -= pull[i] * size * (point[0] * h0 + point[1] * h1 + point[2] * h2)


@helper
def fit_albedo(a, value, good, sharp, rho, w):
    """The albedo that a (N) gives `value` (N), by least squares or with Cauchy weights w (N).

    Returns the albedo and sum w a^2; `rho` is where the reweighting starts, negative for nowhere.
    good (N) : 1 where a value is usable, else 0; sharp : 1 / scale^2, 0 for least squares
    """
    rounds = ALBEDO_ROUNDS if sharp > 0.0 else 1
    for _round in range(rounds):
        bend = sharp if rho >= 0.0 else 0.0
        squares, products = 0.0, 0.0
        for i in range(a.size):
            off = rho * a[i] - value[i]
            w[i] = good[i] / (1.0 + bend * off * off)
            squares += w[i] * a[i] * a[i]
            products += w[i] * a[i] * value[i]
        rho = products / squares if squares > 1e-12 else 0.0
    return rho, squares


@kernel
def explain(
    photos, table, low, high, active, gradient, points, camera, vectors, ambients, nearness,
    scales, lagged, project, albedo, tensor, vector, sums, histogram, misfit, turning, slope,
):  # fmt: skip
    """Albedo, depth terms, energy and residuals of every active pixel; see `Photographs.explain`.

    vectors (C, 3, N), ambients (C, N), nearness (C, N) of the lights: as in `Lamps.arrays`
    sums (h, 3): energy, squared residuals, count; histogram (h, BINS) of absolute residuals in one
    channel of every other pixel; misfit (h, w): each pixel's mean absolute residual.  When
    `turning`, slope (h, C, 5, N) gets the first derivatives of half the energy with each light's
    vector, closeness, ambient.
    """
    height, width = active.shape
    channels, _, count = vectors.shape
    fx, fy, cx, cy = camera
    near = nearness.max() > 0.0
    for row in prange(height):
        n, du, dv, point = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
        a, w, value, good = np.empty(count), np.empty(count), np.empty(count), np.empty(count)
        s, dot, away, pull = np.empty((3, count)), np.empty(count), np.empty(count), np.zeros(count)
        energy, squared, counted = 0.0, 0.0, 0.0
        for k in range(BINS):
            histogram[row, k] = 0
        for column in range(width):
            for k in range(3):
                tensor[row, column, k] = 0.0
            vector[row, column, 0] = 0.0
            vector[row, column, 1] = 0.0
            if not active[row, column]:
                continue
            x, y = column - cx, row - cy
            geometry(
                gradient[row, column, 0], gradient[row, column, 1], x, y, fx, fy, n, du, dv, lagged
            )
            for k in range(3):
                point[k] = points[row, column, k]
            scale, off, seen = scales[row, column], 0.0, 0.0
            sharp = 1.0 / (scale * scale) if scale > 0.0 else 0.0
            uu, uv, vv, bu, bv = 0.0, 0.0, 0.0, 0.0, 0.0
            product = 1.0
            for c in range(3):
                light_c = min(c, channels - 1)
                if c < channels:
                    shade(vectors[c], nearness[c], n, point, near, dot, s)
                    for i in range(count):
                        a[i] = max(dot[i], 0.0) + ambients[c, i]
                for i in range(count):
                    code = photos[i, row, column, c]
                    good[i] = 1.0 if low <= code <= high else 0.0
                    value[i] = table[code]
                rho, total = fit_albedo(a, value, good, sharp, albedo[row, column, c], w)
                albedo[row, column, c] = rho
                tu, tv = 0.0, 0.0
                for i in range(count):
                    r = good[i] * (rho * a[i] - value[i])
                    away[i] = r
                    squared += r * r
                    off += abs(r)
                    seen += good[i]
                    lit = rho * w[i] if dot[i] > 0.0 else 0.0
                    su = s[0, i] * du[0] + s[1, i] * du[1] + s[2, i] * du[2]
                    sv = s[0, i] * dv[0] + s[1, i] * dv[1] + s[2, i] * dv[2]
                    uu += lit * rho * su * su
                    uv += lit * rho * su * sv
                    vv += lit * rho * sv * sv
                    bu -= lit * su * r
                    bv -= lit * sv * r
                    tu += lit * su * a[i]
                    tv += lit * sv * a[i]
                if 2 * c == (row + column) % 6:
                    for i in range(count):
                        if good[i] > 0.0:
                            histogram[row, min(int(abs(away[i]) * (BINS / WIDEST)), BINS - 1)] += 1
                if scale > 0.0:
                    for start in range(0, count, LOGARITHM):
                        few = 1.0
                        for i in range(start, min(start + LOGARITHM, count)):
                            few *= 1.0 + sharp * away[i] * away[i]
                        if few > 1e150:
                            energy += scale * scale * np.log(few)
                            few = 1.0
                        product *= few
                        if product > 1e150:
                            energy += scale * scale * np.log(product)
                            product = 1.0
                else:
                    for i in range(count):
                        energy += away[i] * away[i]
                if turning:
                    for i in range(count):
                        force = rho * away[i] / (1.0 + sharp * away[i] * away[i])
                        slope[row, light_c, 4, i] += force
                        pull[i] += force if dot[i] > 0.0 else 0.0
                    if channels == 3 or c == 2:
                        turn(vectors[light_c], n, point, s, dot, pull, slope[row, light_c])
                        for i in range(count):
                            pull[i] = 0.0
                if project and total > 1e-12:
                    uu -= tu * tu / total
                    uv -= tu * tv / total
                    vv -= tv * tv / total
            if scale > 0.0:
                energy += scale * scale * np.log(product)
            counted += seen
            misfit[row, column] = off / seen if seen > 0.0 else 0.0
            # Rounding must not make a tensor of rank one indefinite.
            uu, vv = max(uu, 0.0), max(vv, 0.0)
            limit = np.sqrt(uu * vv)
            uv = min(max(uv, -limit), limit)
            tensor[row, column, 0] = uu
            tensor[row, column, 1] = uv
            tensor[row, column, 2] = vv
            vector[row, column, 0] = bu
            vector[row, column, 1] = bv
        sums[row, 0], sums[row, 1], sums[row, 2] = energy, squared, counted


@helper
def take_products(hessian, rows):
    """hessian (Q, Q) -= U^T U of rows U (M, Q)."""
    hessian -= np.dot(rows.T, rows)


@kernel
def light_terms(
    photos, table, low, high, active, gradient, points, camera, vectors, ambients, nearness,
    scales, albedo, parameters, project, hessian, slope, cross, cell,
):  # fmt: skip
    """Second and first derivatives of half the energy with respect to the lights.

    Each light has `parameters` numbers: its vector, [closeness,] ambient; a channel's lights, C of
    1 or 3 channels, have Q of them, those of one kind side by side, and nothing to do with another
    channel's.  The albedo is eliminated when `project`.  hessian (blocks, C, Q, Q), its upper
    triangle, and slope (blocks, C, Q) are sums per block of rows; cross (h/cell, w/cell, C, 2, Q)
    the mixed derivatives with the gradient of log depth, summed over cells of `cell` x `cell`
    pixels; left alone when cell is 0.
    """
    height, width = active.shape
    channels, _, count = vectors.shape
    fx, fy, cx, cy = camera
    near = nearness.max() > 0.0
    blocks = hessian.shape[0]
    for block in prange(blocks):
        n, du, dv, point = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
        a, value, good = np.empty(count), np.empty(count), np.empty(count)
        s, dot, lit = np.empty((3, count)), np.empty(count), np.empty(count)
        w, wa, wr = np.empty(count), np.empty(count), np.empty(count)
        ju, jv, turns = np.empty(count), np.empty(count), np.empty((5, count))
        u, own = np.empty(parameters * count), np.zeros((channels, parameters, parameters, count))
        stack, stacked = np.empty((channels, STACK, u.size)), np.zeros(channels, np.int64)
        # Whole rows of cells to each block, so that no two blocks write to one cell.
        step = max(cell, 1)
        rows_of_cells = (height + step - 1) // step
        first = (block * rows_of_cells // blocks) * step
        last = min(((block + 1) * rows_of_cells // blocks) * step, height)
        for row in range(first, last):
            for column in range(width):
                if not active[row, column]:
                    continue
                gu, gv = gradient[row, column, 0], gradient[row, column, 1]
                geometry(gu, gv, column - cx, row - cy, fx, fy, n, du, dv, False)
                for k in range(3):
                    point[k] = points[row, column, k]
                scale = scales[row, column]
                sharp = 1.0 / (scale * scale) if scale > 0.0 else 0.0
                for c in range(3):
                    light_c = min(c, channels - 1)
                    if c < channels:
                        shade(vectors[c], nearness[c], n, point, near, dot, s)
                        for i in range(count):
                            a[i] = max(dot[i], 0.0) + ambients[c, i]
                            lit[i] = 1.0 if dot[i] > 0.0 else 0.0
                        turns[:] = 0.0
                        turn(vectors[c], n, point, s, dot, lit, turns)
                        turns[parameters - 1] = 1.0
                    for i in range(count):
                        code = photos[i, row, column, c]
                        good[i] = 1.0 if low <= code <= high else 0.0
                        value[i] = table[code]
                    rho = albedo[row, column, c]
                    total, tu, tv = 0.0, 0.0, 0.0
                    for i in range(count):
                        r = rho * a[i] - value[i]
                        w[i] = good[i] / (1.0 + sharp * r * r)
                        wa[i], wr[i] = w[i] * a[i], w[i] * r
                        total += wa[i] * a[i]
                        seen = rho * w[i] * lit[i]
                        ju[i] = seen * (s[0, i] * du[0] + s[1, i] * du[1] + s[2, i] * du[2])
                        jv[i] = seen * (s[0, i] * dv[0] + s[1, i] * dv[1] + s[2, i] * dv[2])
                        tu += ju[i] * a[i]
                        tv += jv[i] * a[i]
                    for k in range(parameters):
                        start = k * count
                        for i in range(count):
                            u[start + i] = rho * wa[i] * turns[k, i]
                            slope[block, light_c, start + i] += rho * wr[i] * turns[k, i]
                        for m in range(k, parameters):
                            for i in range(count):
                                own[light_c, k, m, i] += (
                                    rho * rho * w[i] * turns[k, i] * turns[m, i]
                                )
                    free = project and total > 1e-12
                    if free:
                        for k in range(u.size):
                            stack[light_c, stacked[light_c], k] = u[k] / np.sqrt(total)
                        stacked[light_c] += 1
                        if stacked[light_c] == STACK:
                            take_products(hessian[block, light_c], stack[light_c])
                            stacked[light_c] = 0
                    if cell:
                        mixed = cross[row // cell, column // cell, light_c]
                        along_u, along_v = (tu / total, tv / total) if free else (0.0, 0.0)
                        for k in range(parameters):
                            start = k * count
                            for i in range(count):
                                beta = rho * turns[k, i]
                                mixed[0, start + i] += ju[i] * beta - along_u * u[start + i]
                                mixed[1, start + i] += jv[i] * beta - along_v * u[start + i]
        for c in range(channels):
            take_products(hessian[block, c], stack[c, : stacked[c]])
            for k in range(parameters):
                for m in range(k, parameters):
                    for i in range(count):
                        hessian[block, c, k * count + i, m * count + i] += own[c, k, m, i]


@kernel
def halve(photos, table, low, high, out):
    """Means of 2 x 2 blocks in linear light as 16-bit values; 0 where one value is not usable."""
    count, height, width, _ = out.shape
    for row in prange(height):
        for i in range(count):
            for column in range(width):
                for c in range(3):
                    total, usable = 0.0, True
                    for dr in range(2):
                        for dc in range(2):
                            r, q = 2 * row + dr, 2 * column + dc
                            if r >= photos.shape[1] or q >= photos.shape[2]:
                                usable = False
                            else:
                                code = photos[i, r, q, c]
                                usable = usable and low <= code <= high
                                total += table[code]
                    if usable:
                        out[i, row, column, c] = min(max(round(total / 4 * 65535), 1), 65534)
                    else:
                        out[i, row, column, c] = 0
