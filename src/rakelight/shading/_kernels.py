# mypy: disable-error-code="no-untyped-def"
"""The loops over pixels and photographs behind shading/photographs.py, compiled on first use.

Photographs stay as they were read and are decoded by a table, pixel by pixel; rows are shared
among the cores and every sum is kept per row, so that results do not depend on the split.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from rakelight.jit import helper, kernel

# Rounds of reweighting for a pixel's own albedo.
ALBEDO_ROUNDS = 2
BINS = 1024
# Residuals are counted in bins up to this value; white is 1.
WIDEST = 0.5


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
def light_at(vector, closeness, point, s, slopes):
    """The light vector s (3) that a lamp sends to `point` (3), metres from the object's middle.

    With q the vector at the middle, u = q/|q| and k = closeness, 1/metre, the lamp stands at u/k:
    s = |q| (u - k X) / |u - k X|^3, which is q itself for k = 0.  slopes (3, 4): ds/dq, ds/dk.
    """
    size = np.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2) + 1e-12
    for i in range(3):
        s[i] = vector[i]
        for j in range(4):
            slopes[i, j] = 1.0 if i == j else 0.0
    v0 = vector[0] / size - closeness * point[0]
    v1 = vector[1] / size - closeness * point[1]
    v2 = vector[2] / size - closeness * point[2]
    r2 = v0 * v0 + v1 * v1 + v2 * v2
    r3 = r2 * np.sqrt(r2)
    v = (v0, v1, v2)
    toward = v0 * point[0] + v1 * point[1] + v2 * point[2]
    for i in range(3):
        slopes[i, 3] = size * (-point[i] + 3.0 * v[i] * toward / r2) / r3
        if closeness != 0.0:
            s[i] = size * v[i] / r3
    if closeness != 0.0:
        vu = (v0 * vector[0] + v1 * vector[1] + v2 * vector[2]) / size
        for i in range(3):
            # d/dq = (f u^T + |q| Df (I - u u^T)/|q|),  Df = I/r^3 - 3 v v^T/r^5
            df_u = vector[i] / size / r3 - 3.0 * v[i] * vu / (r2 * r3)
            for j in range(3):
                df = (1.0 if i == j else 0.0) / r3 - 3.0 * v[i] * v[j] / (r2 * r3)
                slopes[i, j] = (s[i] / size - df_u) * vector[j] / size + df


@helper
def shade(vectors, ambients, closeness, c, n, point, a, s):
    """Fill a (N) with the shading of channel c and s (N, 3) with the lights at the point."""
    for i in range(a.size):
        if closeness[i] == 0.0:
            for k in range(3):
                s[i, k] = vectors[i, c, k]
        else:  # as in `light_at`, without the slopes
            size2 = vectors[i, c, 0] ** 2 + vectors[i, c, 1] ** 2 + vectors[i, c, 2] ** 2
            away = closeness[i] * (np.sqrt(size2) + 1e-12)
            v0 = vectors[i, c, 0] - away * point[0]
            v1 = vectors[i, c, 1] - away * point[1]
            v2 = vectors[i, c, 2] - away * point[2]
            r2 = v0 * v0 + v1 * v1 + v2 * v2 + 1e-300
            gain = size2 / r2
            gain *= np.sqrt(gain)
            s[i, 0], s[i, 1], s[i, 2] = gain * v0, gain * v1, gain * v2
        dot = s[i, 0] * n[0] + s[i, 1] * n[1] + s[i, 2] * n[2]
        a[i] = max(dot, 0.0) + ambients[i, c]


@helper
def turn(vector, n, point, s, pull, out):
    """Add to out (5) what a change of a light's vector and closeness does where s (3) arrives.

    pull : what the shading's change counts.  With e = s/|s| and Df = 1/r^3 (I - 3 e e^T), both
    as in `light_at`:  d/dq = Df n + u (s . n / |q| - u . Df n),  d/dk = -|q| X . Df n
    """
    size = np.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2) + 1e-12
    there = np.sqrt(s[0] ** 2 + s[1] ** 2 + s[2] ** 2) + 1e-300
    dot = s[0] * n[0] + s[1] * n[1] + s[2] * n[2]
    by_r2 = there / size
    by_r3 = by_r2 * np.sqrt(by_r2)
    steep = 3.0 * dot / (there * there)
    h0 = by_r3 * (n[0] - steep * s[0])
    h1 = by_r3 * (n[1] - steep * s[1])
    h2 = by_r3 * (n[2] - steep * s[2])
    uh = (vector[0] * h0 + vector[1] * h1 + vector[2] * h2) / size
    along = (dot / size - uh) / size
    out[0] += pull * (h0 + along * vector[0])
    out[1] += pull * (h1 + along * vector[1])
    out[2] += pull * (h2 + along * vector[2])
    out[3] -= pull * size * (point[0] * h0 + point[1] * h1 + point[2] * h2)


@helper
def fit_albedo(a, value, good, scale, rho, w):
    """The albedo that a (N) gives `value` (N), by least squares or with Cauchy weights w (N).

    Returns the albedo and sum w a^2; `rho` is where the reweighting starts, negative for nowhere.
    """
    rounds = ALBEDO_ROUNDS if scale > 0.0 else 1
    sharp = 1.0 / (scale * scale) if scale > 0.0 else 0.0
    for _round in range(rounds):
        squares, products = 0.0, 0.0
        for i in range(a.size):
            w[i] = 0.0
            if good[i]:
                w[i] = 1.0
                if scale > 0.0 and rho >= 0.0:
                    off = rho * a[i] - value[i]
                    w[i] = 1.0 / (1.0 + sharp * off * off)
                squares += w[i] * a[i] * a[i]
                products += w[i] * a[i] * value[i]
        rho = products / squares if squares > 1e-12 else 0.0
    return rho, squares


@kernel
def explain(
    photos, table, low, high, active, gradient, points, camera, vectors, ambients, closeness,
    scales, lagged, project, albedo, tensor, vector, sums, histogram, misfit, turning, slope,
):  # fmt: skip
    """Albedo, depth terms, energy and residuals of every active pixel; see `Photographs.explain`.

    sums (h, 3): energy, squared residuals, count; histogram (h, BINS) of absolute residuals;
    misfit (h, w): each pixel's mean absolute residual.  When `turning`, slope (h, N, C, 5) gets
    the first derivatives of half the energy with each light's vector, closeness, ambient.
    """
    height, width = active.shape
    count, channels = photos.shape[0], vectors.shape[1]
    fx, fy, cx, cy = camera
    for row in prange(height):
        n, du, dv, point = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
        a, w, value = np.empty(count), np.empty(count), np.empty(count)
        good = np.empty(count, np.bool_)
        s, pull = np.empty((count, 3)), np.zeros(count)
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
            for c in range(3):
                if c < channels:
                    shade(vectors, ambients, closeness, c, n, point, a, s)
                for i in range(count):
                    code = photos[i, row, column, c]
                    good[i] = low <= code <= high
                    value[i] = table[code]
                rho, total = fit_albedo(a, value, good, scale, albedo[row, column, c], w)
                albedo[row, column, c] = rho
                tu, tv, product = 0.0, 0.0, 1.0
                ambient_c = min(c, channels - 1)
                for i in range(count):
                    if not good[i]:
                        continue
                    r = rho * a[i] - value[i]
                    squared += r * r
                    off += abs(r)
                    seen += 1.0
                    histogram[row, min(int(abs(r) * (BINS / WIDEST)), BINS - 1)] += 1
                    if scale > 0.0:  # one logarithm for many residuals
                        product *= 1.0 + sharp * r * r
                        if product > 1e200:
                            energy += scale * scale * np.log(product)
                            product = 1.0
                    else:
                        energy += r * r
                    if a[i] - ambients[i, ambient_c] > 0.0:
                        ju = rho * (s[i, 0] * du[0] + s[i, 1] * du[1] + s[i, 2] * du[2])
                        jv = rho * (s[i, 0] * dv[0] + s[i, 1] * dv[1] + s[i, 2] * dv[2])
                        uu += w[i] * ju * ju
                        uv += w[i] * ju * jv
                        vv += w[i] * jv * jv
                        bu -= w[i] * ju * r
                        bv -= w[i] * jv * r
                        tu += w[i] * ju * a[i]
                        tv += w[i] * jv * a[i]
                    if turning:
                        force = rho * r / (1.0 + sharp * r * r)
                        slope[row, i, ambient_c, 4] += force
                        if a[i] - ambients[i, ambient_c] > 0.0:
                            pull[i] += force
                if turning and (channels == 3 or c == 2):
                    for i in range(count):
                        if pull[i] != 0.0:
                            turn(
                                vectors[i, ambient_c], n, point, s[i], pull[i],
                                slope[row, i, ambient_c],
                            )  # fmt: skip
                            pull[i] = 0.0
                if scale > 0.0:
                    energy += scale * scale * np.log(product)
                if project and total > 1e-12:
                    uu -= tu * tu / total
                    uv -= tu * tv / total
                    vv -= tv * tv / total
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
def take_product(hessian, block, channel, u, total):
    """The upper triangle of hessian[block, channel] -= u u^T / total."""
    for k in range(u.size):
        factor = u[k] / total
        for m in range(k, u.size):
            hessian[block, channel, k, m] -= factor * u[m]


@helper
def take_scaled(cross, i, j, channel, u, along_u, along_v):
    """cross[i, j, :, channel] -= (along_u, along_v) u^T."""
    for k in range(u.size):
        cross[i, j, 0, channel, k] -= along_u * u[k]
    for k in range(u.size):
        cross[i, j, 1, channel, k] -= along_v * u[k]


@kernel
def light_terms(
    photos, table, low, high, active, gradient, points, camera, vectors, ambients, closeness,
    scales, albedo, parameters, project, hessian, slope, cross, cell,
):  # fmt: skip
    """Second and first derivatives of half the energy with respect to the lights.

    Each light has `parameters` numbers: its vector, [closeness,] ambient; a channel's lights, C of
    1 or 3 channels, have Q of them and nothing to do with another's.  The albedo is eliminated when
    `project`.  hessian (blocks, C, Q, Q), its upper triangle, and slope (blocks, C, Q) are sums per
    block of rows; cross (h/cell, w/cell, 2, C, Q) the mixed derivatives with the gradient of log
    depth, summed over cells of `cell` x `cell` pixels; left alone when cell is 0.
    """
    height, width = active.shape
    count, channels = photos.shape[0], vectors.shape[1]
    fx, fy, cx, cy = camera
    near = parameters == 5
    blocks = hessian.shape[0]
    for block in prange(blocks):
        n, du, dv, point = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
        a, w, value = np.empty(count), np.empty(count), np.empty(count)
        good = np.empty(count, np.bool_)
        s, slopes, light = np.empty((count, 3)), np.empty((3, 4)), np.empty(3)
        beta, turn = np.empty((count, parameters)), np.empty((count, parameters))
        u = np.zeros(count * parameters)
        # Whole rows of cells to each block, so that no two blocks write to one cell.
        step = max(cell, 1)
        rows_of_cells = (height + step - 1) // step
        first = (block * rows_of_cells // blocks) * step
        last = min(((block + 1) * rows_of_cells // blocks) * step, height)
        for row in range(first, last):
            for column in range(width):
                if not active[row, column]:
                    continue
                x, y = column - cx, row - cy
                geometry(
                    gradient[row, column, 0],
                    gradient[row, column, 1],
                    x,
                    y,
                    fx,
                    fy,
                    n,
                    du,
                    dv,
                    False,
                )
                for k in range(3):
                    point[k] = points[row, column, k]
                scale = scales[row, column]
                for c in range(3):
                    light_c = min(c, channels - 1)
                    if c < channels:
                        shade(vectors, ambients, closeness, c, n, point, a, s)
                    for i in range(count):
                        code = photos[i, row, column, c]
                        good[i] = low <= code <= high
                        value[i] = table[code]
                    rho = albedo[row, column, c]
                    total, tu, tv = 0.0, 0.0, 0.0
                    for i in range(count):
                        r = rho * a[i] - value[i]
                        w[i] = 0.0
                        if good[i]:
                            w[i] = 1.0 / (1.0 + (r / scale) ** 2) if scale > 0.0 else 1.0
                        total += w[i] * a[i] * a[i]
                        lit = a[i] - ambients[i, light_c] > 0.0
                        if c < channels:
                            for k in range(parameters):
                                turn[i, k] = 0.0
                            turn[i, parameters - 1] = 1.0
                            if lit and (near or closeness[i] != 0.0):
                                light_at(vectors[i, c], closeness[i], point, light, slopes)
                                for k in range(parameters - 1):
                                    turn[i, k] = (
                                        slopes[0, k] * n[0]
                                        + slopes[1, k] * n[1]
                                        + slopes[2, k] * n[2]
                                    )
                            elif lit:
                                for k in range(3):
                                    turn[i, k] = n[k]
                        for k in range(parameters):
                            beta[i, k] = rho * turn[i, k]
                        start = i * parameters
                        for k in range(parameters):
                            weighted = w[i] * beta[i, k]
                            u[start + k] = a[i] * weighted
                            slope[block, light_c, start + k] += weighted * r
                            for m in range(k, parameters):
                                hessian[block, light_c, start + k, start + m] += (
                                    weighted * beta[i, m]
                                )
                        if lit:
                            ju = rho * (s[i, 0] * du[0] + s[i, 1] * du[1] + s[i, 2] * du[2])
                            jv = rho * (s[i, 0] * dv[0] + s[i, 1] * dv[1] + s[i, 2] * dv[2])
                            tu += w[i] * ju * a[i]
                            tv += w[i] * jv * a[i]
                            if cell:
                                for k in range(parameters):
                                    cross[row // cell, column // cell, 0, light_c, start + k] += (
                                        w[i] * ju * beta[i, k]
                                    )
                                    cross[row // cell, column // cell, 1, light_c, start + k] += (
                                        w[i] * jv * beta[i, k]
                                    )
                    if not project or total <= 1e-12:
                        continue
                    take_product(hessian, block, light_c, u, total)
                    if cell:
                        take_scaled(
                            cross, row // cell, column // cell, light_c, u, tu / total, tv / total
                        )


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
