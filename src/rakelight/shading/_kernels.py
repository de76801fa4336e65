# mypy: disable-error-code="no-untyped-def"
"""The loops over pixels and photographs behind shading/photographs.py, compiled on first use.

Photographs stay integers and are decoded by a table, pixel by pixel; rows are shared
among the cores and every sum is kept per row, so that results do not depend on the split.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numba import prange

from rakelight import jit

# Sums over photographs are within a pixel, whose row is never split.
kernel = partial(jit.kernel, any_order=True)
helper = partial(jit.helper, any_order=True)
# Part of the kernel that calls it: its loops over photographs run in wide instructions, each of
# which fills one array, and the processor works ahead from one to the next.
inlined = partial(jit.helper, any_order=True, inline=True)

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


@inlined
def shade(vectors, nearness, n, point, near, s, dot, gain):
    """Fill s (3, N) with one channel's lights at the point, dot (N) with s . n, gain (N): 1/r^3.

    The light vector that a lamp sends to X, metres from the object's middle: with q the vector at
    the middle, u = q/|q| and k = closeness, 1/metre, the lamp stands at u/k and
    s = |q| (u - k X) / r^3, r = |u - k X|, which is q itself for k = 0.
    vectors (3, N) : q; nearness (N) : |q| k
    """
    n0, n1, n2 = n[0], n[1], n[2]
    p0, p1, p2 = point[0], point[1], point[2]
    for i in range(dot.size):
        gain[i] = 1.0
    if near:
        for i in range(dot.size):
            q0, q1, q2 = vectors[0, i], vectors[1, i], vectors[2, i]
            size2 = q0 * q0 + q1 * q1 + q2 * q2
            q0 -= nearness[i] * p0
            q1 -= nearness[i] * p1
            q2 -= nearness[i] * p2
            by_r2 = size2 / (q0 * q0 + q1 * q1 + q2 * q2 + 1e-300)
            gain[i] = by_r2 * np.sqrt(by_r2)
    for k in range(3):
        at = point[k]
        for i in range(dot.size):
            s[k, i] = gain[i] * (vectors[k, i] - nearness[i] * at)
    for i in range(dot.size):
        dot[i] = s[0, i] * n0 + s[1, i] * n1 + s[2, i] * n2


@inlined
def turn(vectors, n, point, s, dot, gain, pull, work, out):
    """Add to out (5, N) what changes of lights' vectors and closeness do where s (3, N) arrive.

    pull (N) : what the shading's change counts; work (5, N) : scratch.  With e = s/|s| and
    Df = 1/r^3 (I - 3 e e^T), both as in `shade`:
        d/dq = Df n + u (s . n / |q| - u . Df n),  d/dk = -|q| X . Df n
    """
    p0, p1, p2 = point[0], point[1], point[2]
    for i in range(pull.size):
        there2 = s[0, i] * s[0, i] + s[1, i] * s[1, i] + s[2, i] * s[2, i]
        work[3, i] = 3.0 * dot[i] / (there2 + 1e-300)
    for k in range(3):
        facing = n[k]
        for i in range(pull.size):
            work[k, i] = pull[i] * gain[i] * (facing - work[3, i] * s[k, i])
    for i in range(pull.size):
        q0, q1, q2 = vectors[0, i], vectors[1, i], vectors[2, i]
        size2 = q0 * q0 + q1 * q1 + q2 * q2 + 1e-24
        along = q0 * work[0, i] + q1 * work[1, i] + q2 * work[2, i]
        work[4, i] = (pull[i] * dot[i] - along) / size2
    for k in range(3):
        for i in range(pull.size):
            out[k, i] += work[k, i] + work[4, i] * vectors[k, i]
    for i in range(pull.size):
        q0, q1, q2 = vectors[0, i], vectors[1, i], vectors[2, i]
        size = np.sqrt(q0 * q0 + q1 * q1 + q2 * q2)
        out[3, i] -= size * (p0 * work[0, i] + p1 * work[1, i] + p2 * work[2, i])


@inlined
def decode(photos, table, row, column, value, good):
    """Fill value (3, N) with a pixel's linear values, good (3, N) with 1 where usable, else 0."""
    for c in range(3):
        for i in range(value.shape[1]):
            value[c, i] = table[photos[i, row, column, c]]
        for i in range(value.shape[1]):
            good[c, i] = 1.0 if value[c, i] >= 0.0 else 0.0


@inlined
def fit_albedo(a, value, good, sharp, albedo, row, column, w, total):
    """Each channel's albedo by least squares, or with Cauchy weights w (3, N).

    albedo (h, w, 3) : where the reweighting starts, negative for nowhere, and where it leads
    a (C, N) : shading; value, good (3, N) : as decoded; sharp : 1 / scale^2, 0 for least squares
    total (3) : gets  sum w a^2
    """
    rounds = ALBEDO_ROUNDS if sharp > 0.0 else 1
    for _round in range(rounds):
        # The channels side by side: no one waits for another's division.
        for c in range(3):
            light_c = min(c, a.shape[0] - 1)
            rho = albedo[row, column, c]
            bend = sharp if rho >= 0.0 else 0.0
            squares, products = 0.0, 0.0
            for i in range(value.shape[1]):
                off = rho * a[light_c, i] - value[c, i]
                weight = good[c, i] / (1.0 + bend * off * off)
                w[c, i] = weight
                squares += weight * a[light_c, i] * a[light_c, i]
                products += weight * a[light_c, i] * value[c, i]
            albedo[row, column, c] = products / squares if squares > 1e-12 else 0.0
            total[c] = squares


@helper
def loss(away, sharp):
    """sum of log(1 + sharp away^2) over away (N): logarithms of products."""
    total, product = 0.0, 1.0
    for start in range(0, away.size, LOGARITHM):
        few, some = 1.0, away[start : start + LOGARITHM]
        for i in range(some.size):
            few *= 1.0 + sharp * some[i] * some[i]
        if few > 1e150:
            total += np.log(few)
            few = 1.0
        product *= few
        if product > 1e150:
            total += np.log(product)
            product = 1.0
    return total + np.log(product)


@helper
def explain_row(
    row, photos, table, active, gradient, points, camera, vectors, ambients, nearness,
    scales, lagged, project, albedo, tensor, vector, sums, histogram, misfit, turning, slope,
):  # fmt: skip
    """One row of `explain`."""
    width = active.shape[1]
    channels, _, count = vectors.shape
    fx, fy, cx, cy = camera
    near = nearness.max() > 0.0
    n, du, dv, point = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    s, dot = np.empty((channels, 3, count)), np.empty((channels, count))
    gain, a = np.empty((channels, count)), np.empty((channels, count))
    value, good = np.empty((3, count)), np.empty((3, count))
    w, total = np.empty((3, count)), np.empty(3)
    away, pull, work = np.empty((3, count)), np.zeros(count), np.empty((5, count))
    energy, squared, counted = 0.0, 0.0, 0.0
    for k in range(BINS):
        histogram[row, k] = 0
    for column in range(width):
        if not active[row, column]:
            for k in range(3):
                albedo[row, column, k] = 0.0
                tensor[row, column, k] = 0.0
            vector[row, column, 0] = 0.0
            vector[row, column, 1] = 0.0
            continue
        x, y = column - cx, row - cy
        geometry(
            gradient[row, column, 0], gradient[row, column, 1], x, y, fx, fy, n, du, dv, lagged
        )
        for k in range(3):
            point[k] = points[row, column, k]
        for c in range(channels):
            shade(vectors[c], nearness[c], n, point, near, s[c], dot[c], gain[c])
            for i in range(count):
                a[c, i] = max(dot[c, i], 0.0) + ambients[c, i]
        decode(photos, table, row, column, value, good)
        scale, off, seen = scales[row, column], 0.0, 0.0
        sharp = 1.0 / (scale * scale) if scale > 0.0 else 0.0
        fit_albedo(a, value, good, sharp, albedo, row, column, w, total)
        uu, uv, vv, bu, bv = 0.0, 0.0, 0.0, 0.0, 0.0
        for c in range(3):
            light_c, rho, tu, tv = min(c, channels - 1), albedo[row, column, c], 0.0, 0.0
            for i in range(count):
                r = good[c, i] * (rho * a[light_c, i] - value[c, i])
                away[c, i] = r
                squared += r * r
                off += abs(r)
                seen += good[c, i]
                lit = rho * w[c, i] if dot[light_c, i] > 0.0 else 0.0
                s0, s1, s2 = s[light_c, 0, i], s[light_c, 1, i], s[light_c, 2, i]
                su = s0 * du[0] + s1 * du[1] + s2 * du[2]
                sv = s0 * dv[0] + s1 * dv[1] + s2 * dv[2]
                uu += lit * rho * su * su
                uv += lit * rho * su * sv
                vv += lit * rho * sv * sv
                bu -= lit * su * r
                bv -= lit * sv * r
                tu += lit * su * a[light_c, i]
                tv += lit * sv * a[light_c, i]
            if project and total[c] > 1e-12:
                uu -= tu * tu / total[c]
                uv -= tu * tv / total[c]
                vv -= tv * tv / total[c]
            if 2 * c == (row + column) % 6:
                for i in range(count):
                    if good[c, i] > 0.0:
                        bin_ = min(int(abs(away[c, i]) * (BINS / WIDEST)), BINS - 1)
                        histogram[row, bin_] += 1
            if scale == 0.0:
                for i in range(count):
                    energy += away[c, i] * away[c, i]
            if turning:
                for i in range(count):
                    force = rho * away[c, i] / (1.0 + sharp * away[c, i] * away[c, i])
                    slope[row, light_c, 4, i] += force
                    pull[i] += force if dot[light_c, i] > 0.0 else 0.0
                if channels == 3 or c == 2:
                    turn(
                        vectors[light_c], n, point, s[light_c], dot[light_c], gain[light_c],
                        pull, work, slope[row, light_c],
                    )  # fmt: skip
                    for i in range(count):
                        pull[i] = 0.0
        if scale > 0.0:
            energy += scale * scale * loss(away.ravel(), sharp)
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


@kernel
def explain(
    photos, table, active, gradient, points, camera, vectors, ambients, nearness,
    scales, lagged, project, albedo, tensor, vector, sums, histogram, misfit, turning, slope,
):  # fmt: skip
    """Albedo, depth terms, energy and residuals of every active pixel; see `Photographs.explain`.

    table : linear light of a value, negative where it is not usable
    vectors (C, 3, N), ambients (C, N), nearness (C, N) of the lights: as in `Lamps.arrays`
    sums (h, 3): energy, squared residuals, count; histogram (h, BINS) of absolute residuals in one
    channel of every other pixel; misfit (h, w): each pixel's mean absolute residual.  When
    `turning`, slope (h, C, 5, N) gets the first derivatives of half the energy with each light's
    vector, closeness, ambient.
    """
    for row in prange(len(active)):
        # One kind of integer, or numba compiles it twice.
        explain_row(
            np.int64(row), photos, table, active, gradient, points, camera, vectors, ambients,
            nearness, scales, lagged, project, albedo, tensor, vector, sums, histogram, misfit,
            turning, slope,
        )  # fmt: skip


@helper
def respond(
    vectors, nearness, ambient, n, point, near, parameters, s, dot, gain, a, lit, work, turns
):
    """Fill a, lit (N) and turns (5, N): shading, 1 where it is, its derivatives with the light."""
    shade(vectors, nearness, n, point, near, s, dot, gain)
    for i in range(dot.size):
        a[i] = max(dot[i], 0.0) + ambient[i]
    for i in range(dot.size):
        lit[i] = 1.0 if dot[i] > 0.0 else 0.0
    for k in range(5):
        for i in range(dot.size):
            turns[k, i] = 0.0
    turn(vectors, n, point, s, dot, gain, lit, work, turns)
    # The ambient's; without the closeness it follows the vector's.
    for i in range(dot.size):
        turns[parameters - 1, i] = 1.0


@helper
def take_products(hessian, rows):
    """hessian (Q, Q) -= U^T U of rows U (M, Q)."""
    hessian -= np.dot(rows.T, rows)


@helper
def light_terms_of_block(
    block, photos, table, active, gradient, points, camera, vectors, ambients, nearness,
    scales, albedo, parameters, project, hessian, slope, cross, cell,
):  # fmt: skip
    """One block of `light_terms`."""
    height, width = active.shape
    channels, _, count = vectors.shape
    fx, fy, cx, cy = camera
    near = nearness.max() > 0.0
    blocks = hessian.shape[0]
    n, du, dv, point = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    s, dot, gain = np.empty((3, count)), np.empty(count), np.empty(count)
    a, lit, w = np.empty(count), np.empty(count), np.empty(count)
    value, good = np.empty((3, count)), np.empty((3, count))
    ju, jv, turns = np.empty(count), np.empty(count), np.empty((5, count))
    u, work = np.empty((parameters, count)), np.empty((5, count))
    own = np.zeros((channels, parameters, parameters, count))
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
            decode(photos, table, row, column, value, good)
            for c in range(3):
                light_c = min(c, channels - 1)
                if c < channels:
                    respond(
                        vectors[c], nearness[c], ambients[c], n, point, near, parameters,
                        s, dot, gain, a, lit, work, turns,
                    )  # fmt: skip
                rho = albedo[row, column, c]
                for i in range(count):
                    r = rho * a[i] - value[c, i]
                    w[i] = good[c, i] / (1.0 + sharp * r * r)
                for i in range(count):
                    along = s[0, i] * du[0] + s[1, i] * du[1] + s[2, i] * du[2]
                    ju[i] = rho * w[i] * lit[i] * along
                for i in range(count):
                    along = s[0, i] * dv[0] + s[1, i] * dv[1] + s[2, i] * dv[2]
                    jv[i] = rho * w[i] * lit[i] * along
                total, tu, tv = 0.0, 0.0, 0.0
                for i in range(count):
                    total += w[i] * a[i] * a[i]
                    tu += ju[i] * a[i]
                    tv += jv[i] * a[i]
                for k in range(parameters):
                    for i in range(count):
                        u[k, i] = rho * w[i] * a[i] * turns[k, i]
                    for i in range(count):
                        r = rho * a[i] - value[c, i]
                        slope[block, light_c, k, i] += rho * w[i] * r * turns[k, i]
                    for m in range(k, parameters):
                        for i in range(count):
                            own[light_c, k, m, i] += rho * rho * w[i] * turns[k, i] * turns[m, i]
                free = project and total > 1e-12
                if free:
                    share = 1.0 / np.sqrt(total)
                    for k in range(parameters):
                        for i in range(count):
                            stack[light_c, stacked[light_c], k * count + i] = share * u[k, i]
                    stacked[light_c] += 1
                    if stacked[light_c] == STACK:
                        take_products(hessian[block, light_c], stack[light_c])
                        stacked[light_c] = 0
                if cell:
                    mixed = cross[row // cell, column // cell, light_c]
                    along_u, along_v = (tu / total, tv / total) if free else (0.0, 0.0)
                    for k in range(parameters):
                        for i in range(count):
                            mixed[0, k, i] += ju[i] * rho * turns[k, i] - along_u * u[k, i]
                        for i in range(count):
                            mixed[1, k, i] += jv[i] * rho * turns[k, i] - along_v * u[k, i]
    for c in range(channels):
        take_products(hessian[block, c], stack[c, : stacked[c]])
        for k in range(parameters):
            for m in range(k, parameters):
                for i in range(count):
                    hessian[block, c, k * count + i, m * count + i] += own[c, k, m, i]


@kernel
def light_terms(
    photos, table, active, gradient, points, camera, vectors, ambients, nearness,
    scales, albedo, parameters, project, hessian, slope, cross, cell,
):  # fmt: skip
    """Second and first derivatives of half the energy with respect to the lights.

    Each light has `parameters` numbers: its vector, [closeness,] ambient; a channel's lights, C of
    1 or 3 channels, have Q of them, those of one kind side by side, and nothing to do with another
    channel's.  The albedo is eliminated when `project`.  hessian (blocks, C, Q, Q), its upper
    triangle, and slope (blocks, C, parameters, N) are sums per block of rows; cross
    (h/cell, w/cell, C, 2, parameters, N) the mixed derivatives with the gradient of log depth,
    summed over cells of `cell` x `cell` pixels; left alone when cell is 0.
    """
    for block in prange(len(hessian)):
        light_terms_of_block(
            np.int64(block), photos, table, active, gradient, points, camera, vectors, ambients,
            nearness, scales, albedo, parameters, project, hessian, slope, cross, cell,
        )  # fmt: skip


@kernel
def halve(photos, table, out):
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
                                value = table[photos[i, r, q, c]]
                                usable = usable and value >= 0.0
                                total += value
                    if usable:
                        out[i, row, column, c] = min(max(round(total / 4 * 65535), 1), 65534)
                    else:
                        out[i, row, column, c] = 0
