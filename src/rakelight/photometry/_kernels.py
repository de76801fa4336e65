# mypy: disable-error-code="no-untyped-def"
"""The loops over pixels and photographs behind photometry/images.py, compiled on first use.

Photographs stay integers and are decoded by a table, pixel by pixel; rows are shared
among the cores and every sum is kept per row, so that results do not depend on the split.

Active pixels of a row are taken in strips, side by side: the last index of an array is a pixel's
place in its strip, and loops over it, the innermost, run in wide instructions.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from rakelight import jit

# Sums are within a strip of a row, which is never split.
kernel = partial(jit.kernel, any_order=True)
helper = partial(jit.helper, any_order=True)
# Part of the kernel that calls it: its loops know where the arrays of a strip lie.
inlined = partial(jit.helper, any_order=True, inline=True)

# Pixels of a strip: as many as the fast memory holds; columns of a product, which likes more.
STRIP, WIDE = 64, 384
# Rows of `frame`: the normal n, dn/dg_u, dn/dg_v with g the gradient of log depth, the place.
NORMAL, BY_U, BY_V, POINT, FRAME = 0, 3, 6, 9, 12
# Rows of `light`: s . n and the derivatives of max(0, s . n) with g_u and g_v.
DOT, SU, SV, LIGHT = range(4)
# Rows of `own`, three each, one a channel: albedo, sums of w a^2, w a I, w a su and w a sv; the
# inverse of the first sum.
ALBEDO, SQUARES, PRODUCTS, ALONG_U, ALONG_V, FREED, OWN = range(0, 21, 3)
# Rows of `pixel`: sums over photographs and channels, with the loss as a logarithm and a factor;
# 1 / scale^2 of the loss; sums over the channels of one lamp.
UU, UV, VV, BU, BV, SQUARED, OFF, SEEN, LOSS, FACTOR, SHARP, BEND, KNOWN, FORCE, PIXEL = range(15)

# Rounds of reweighting for a pixel's own albedo.
ALBEDO_ROUNDS = 2
BINS = 1024
# Residuals are counted in bins up to this value; white is 1.
WIDEST = 0.5
# The logarithm of a product is the sum of losses; it is taken when a factor grows beyond this.
LARGEST = 1e150


@helper
def next_strip(active, row, column, here):
    """Fill here with the active columns from `column` on; how many, and the next one to look at."""
    size = 0
    while column < active.shape[1] and size < STRIP:
        if active[row, column]:
            here[size] = column
            size += 1
        column += 1
    return size, column


@helper
def clear(row, active, albedo, tensor, vector):
    """What is found of pixels without a normal: nothing."""
    for column in range(active.shape[1]):
        if not active[row, column]:
            for k in range(3):
                albedo[row, column, k] = 0.0
                tensor[row, column, k] = 0.0
            vector[row, column, 0] = 0.0
            vector[row, column, 1] = 0.0


@inlined
def stand(here, size, row, gradient, points, camera, lagged, frame):
    """Fill frame: normals, their derivatives, with |m| lagged or not, and places."""
    fx, fy, cx, cy = camera
    y, free = row - cy, 0.0 if lagged else 1.0
    for j in range(size):
        frame[BY_U, j], frame[BY_V, j] = gradient[row, here[j], 0], gradient[row, here[j], 1]
        for k in range(3):
            frame[POINT + k, j] = points[row, here[j], k]
    for j in range(size):
        gu, gv, x = frame[BY_U, j], frame[BY_V, j], here[j] - cx
        m0, m1, m2 = fx * gu, fy * gv, -(1.0 + x * gu + y * gv)
        over = 1.0 / np.sqrt(m0 * m0 + m1 * m1 + m2 * m2)
        n0, n1, n2 = m0 * over, m1 * over, m2 * over
        along_u, along_v = free * over * (n0 * fx - n2 * x), free * over * (n1 * fy - n2 * y)
        frame[NORMAL, j], frame[NORMAL + 1, j], frame[NORMAL + 2, j] = n0, n1, n2
        frame[BY_U, j] = over * fx - along_u * n0
        frame[BY_U + 1, j] = -along_u * n1
        frame[BY_U + 2, j] = -over * x - along_u * n2
        frame[BY_V, j] = -along_v * n0
        frame[BY_V + 1, j] = over * fy - along_v * n1
        frame[BY_V + 2, j] = -over * y - along_v * n2


@inlined
def toward(q0, q1, q2, nearness, frame, j):
    """t (3) and f with f t the light vector s that a lamp sends to a pixel's place X.

    X in metres from the object's middle: with q the vector there, u = q/|q| and k = closeness,
    1/metre, the lamp stands at u/k and s = |q| (u - k X) / r^3, r = |u - k X|, which is q itself
    for k = 0.  nearness : |q| k;  t = q - |q| k X, f = 1/r^3
    """
    t0 = q0 - nearness * frame[POINT, j]
    t1 = q1 - nearness * frame[POINT + 1, j]
    t2 = q2 - nearness * frame[POINT + 2, j]
    by_r2 = (q0 * q0 + q1 * q1 + q2 * q2) / (t0 * t0 + t1 * t1 + t2 * t2 + 1e-300)
    return t0, t1, t2, by_r2 * np.sqrt(by_r2)


@inlined
def arrive(q0, q1, q2, nearness, size, frame, light):
    """Fill light: what a lamp, as in `toward`, does at each pixel."""
    for j in range(size):
        t0, t1, t2, gain = q0, q1, q2, 1.0
        if nearness > 0.0:
            t0, t1, t2, gain = toward(q0, q1, q2, nearness, frame, j)
        n0, n1, n2 = frame[NORMAL, j], frame[NORMAL + 1, j], frame[NORMAL + 2, j]
        u0, u1, u2 = frame[BY_U, j], frame[BY_U + 1, j], frame[BY_U + 2, j]
        v0, v1, v2 = frame[BY_V, j], frame[BY_V + 1, j], frame[BY_V + 2, j]
        dot = gain * (t0 * n0 + t1 * n1 + t2 * n2)
        lit = gain if dot > 0.0 else 0.0
        light[DOT, j] = dot
        light[SU, j] = lit * (t0 * u0 + t1 * u1 + t2 * u2)
        light[SV, j] = lit * (t0 * v0 + t1 * v1 + t2 * v2)


@inlined
def shade(q0, q1, q2, nearness, ambient, size, frame, shading):
    """Fill shading (STRIP): what a lamp, as in `toward`, and its ambient light do at each pixel."""
    for j in range(size):
        t0, t1, t2, gain = q0, q1, q2, 1.0
        if nearness > 0.0:
            t0, t1, t2, gain = toward(q0, q1, q2, nearness, frame, j)
        n0, n1, n2 = frame[NORMAL, j], frame[NORMAL + 1, j], frame[NORMAL + 2, j]
        shading[j] = max(gain * (t0 * n0 + t1 * n1 + t2 * n2), 0.0) + ambient


@inlined
def turn(q0, q1, q2, nearness, size, frame, light, turns):
    """Fill turns (4, STRIP): derivatives of max(0, s . n) with a lamp's vector and closeness.

    With f, t as in `toward`, e = t/|t| and Df = f (I - 3 e e^T):
        d/dq = Df n + u (s . n / |q| - u . Df n),  d/dk = -|q| X . Df n
    """
    size2 = q0 * q0 + q1 * q1 + q2 * q2 + 1e-24
    length = np.sqrt(size2)
    for j in range(size):
        t0, t1, t2, gain = q0, q1, q2, 1.0
        if nearness > 0.0:
            t0, t1, t2, gain = toward(q0, q1, q2, nearness, frame, j)
        n0, n1, n2 = frame[NORMAL, j], frame[NORMAL + 1, j], frame[NORMAL + 2, j]
        lit = gain if light[DOT, j] > 0.0 else 0.0
        bent = 3.0 * (t0 * n0 + t1 * n1 + t2 * n2) / (t0 * t0 + t1 * t1 + t2 * t2 + 1e-300)
        f0, f1, f2 = lit * (n0 - bent * t0), lit * (n1 - bent * t1), lit * (n2 - bent * t2)
        along = (max(light[DOT, j], 0.0) - (q0 * f0 + q1 * f1 + q2 * f2)) / size2
        turns[0, j], turns[1, j], turns[2, j] = f0 + along * q0, f1 + along * q1, f2 + along * q2
        p0, p1, p2 = frame[POINT, j], frame[POINT + 1, j], frame[POINT + 2, j]
        turns[3, j] = -length * (p0 * f0 + p1 * f1 + p2 * f2)


@inlined
def decode(here, size, row, photos, table, value):
    """Fill value (3, N, STRIP) with linear light, negative where it is not usable."""
    for i in range(value.shape[1]):
        for c in range(3):
            for j in range(size):
                value[c, i, j] = table[photos[i, row, here[j], c]]


@inlined
def sharpen(here, size, row, scales, pixel):
    """Fill pixel's SHARP: 1 / scale^2 of the loss, 0 for least squares."""
    for j in range(size):
        scale = scales[row, here[j]]
        pixel[SHARP, j] = 1.0 / (scale * scale) if scale > 0.0 else 0.0


@inlined
def miss(rho, shading, value):
    """What the model is off a value, 0 for one that is not usable."""
    return rho * shading - value if value >= 0.0 else 0.0


@inlined
def total(values, size):
    """Sum of the first `size` values."""
    found = 0.0
    for j in range(size):
        found += values[j]
    return found


@inlined
def fit_albedo(rounds, size, a, value, w, own, pixel):
    """Each channel's albedo by least squares, or with Cauchy weights w (3, N, STRIP).

    own : its albedo is where the reweighting starts, negative for nowhere, and where it leads
    a (C, N, STRIP) : shading; value (3, N, STRIP) : as decoded
    """
    for _round in range(rounds):
        for c in range(3):
            light_c = min(c, a.shape[0] - 1)
            for j in range(size):
                pixel[BEND, j] = pixel[SHARP, j] if own[ALBEDO + c, j] >= 0.0 else 0.0
                own[SQUARES + c, j] = 0.0
                own[PRODUCTS + c, j] = 0.0
            for i in range(a.shape[1]):
                for j in range(size):
                    v, shading = value[c, i, j], a[light_c, i, j]
                    off = own[ALBEDO + c, j] * shading - v
                    good = 1.0 if v >= 0.0 else 0.0
                    weight = good / (1.0 + pixel[BEND, j] * off * off)
                    w[c, i, j] = weight
                    own[SQUARES + c, j] += weight * shading * shading
                    own[PRODUCTS + c, j] += weight * shading * v
            for j in range(size):
                squares, products = own[SQUARES + c, j], own[PRODUCTS + c, j]
                own[ALBEDO + c, j] = products / squares if squares > 1e-12 else 0.0


@inlined
def begin(here, size, row, albedo, own, pixel):
    """The albedo to start from, and every sum of a strip at nought."""
    for c in range(3):
        for j in range(size):
            own[ALBEDO + c, j] = albedo[row, here[j], c]
            own[ALONG_U + c, j] = 0.0
            own[ALONG_V + c, j] = 0.0
    for k in range(FACTOR):
        for j in range(size):
            pixel[k, j] = 0.0
    for j in range(size):
        pixel[FACTOR, j] = 1.0


@inlined
def compare(c, i, size, a, value, w, light, own, pixel):
    """Add what photograph i says in channel c, whose lamp has the shading a (N, STRIP)."""
    for j in range(size):
        shading, su, sv, sharp = a[i, j], light[SU, j], light[SV, j], pixel[SHARP, j]
        rho, weight = own[ALBEDO + c, j], w[c, i, j]
        r = miss(rho, shading, value[c, i, j])
        known, force = rho * rho * weight, rho * weight * r
        pixel[SQUARED, j] += r * r
        pixel[OFF, j] += abs(r)
        pixel[SEEN, j] += 1.0 if value[c, i, j] >= 0.0 else 0.0
        pixel[FACTOR, j] *= 1.0 + sharp * r * r
        pixel[UU, j] += known * su * su
        pixel[UV, j] += known * su * sv
        pixel[VV, j] += known * sv * sv
        pixel[BU, j] -= force * su
        pixel[BV, j] -= force * sv
        own[ALONG_U + c, j] += weight * shading * su
        own[ALONG_V + c, j] += weight * shading * sv


@inlined
def compare_all(i, size, a, value, w, light, own, pixel):
    """As `compare`, in all three channels at once, which share a lamp: sums are fetched once."""
    for j in range(size):
        shading, su, sv, sharp = a[i, j], light[SU, j], light[SV, j], pixel[SHARP, j]
        rho0, rho1, rho2 = own[ALBEDO, j], own[ALBEDO + 1, j], own[ALBEDO + 2, j]
        w0, w1, w2 = w[0, i, j], w[1, i, j], w[2, i, j]
        r0 = miss(rho0, shading, value[0, i, j])
        r1 = miss(rho1, shading, value[1, i, j])
        r2 = miss(rho2, shading, value[2, i, j])
        known = rho0 * rho0 * w0 + rho1 * rho1 * w1 + rho2 * rho2 * w2
        force = rho0 * w0 * r0 + rho1 * w1 * r1 + rho2 * w2 * r2
        pixel[SQUARED, j] += r0 * r0 + r1 * r1 + r2 * r2
        pixel[OFF, j] += abs(r0) + abs(r1) + abs(r2)
        pixel[FACTOR, j] *= (
            (1.0 + sharp * r0 * r0) * (1.0 + sharp * r1 * r1) * (1.0 + sharp * r2 * r2)
        )
        pixel[UU, j] += known * su * su
        pixel[UV, j] += known * su * sv
        pixel[VV, j] += known * sv * sv
        pixel[BU, j] -= force * su
        pixel[BV, j] -= force * sv
        own[ALONG_U, j] += w0 * shading * su
        own[ALONG_V, j] += w0 * shading * sv
        own[ALONG_U + 1, j] += w1 * shading * su
        own[ALONG_V + 1, j] += w1 * shading * sv
        own[ALONG_U + 2, j] += w2 * shading * su
        own[ALONG_V + 2, j] += w2 * shading * sv
    for j in range(size):
        seen0 = 1.0 if value[0, i, j] >= 0.0 else 0.0
        seen1 = 1.0 if value[1, i, j] >= 0.0 else 0.0
        seen2 = 1.0 if value[2, i, j] >= 0.0 else 0.0
        pixel[SEEN, j] += seen0 + seen1 + seen2


@inlined
def take_logarithm(size, pixel):
    """Keep the product of losses from growing too large."""
    if total(pixel[FACTOR], size) > LARGEST:
        for j in range(size):
            pixel[LOSS, j] += np.log(pixel[FACTOR, j])
            pixel[FACTOR, j] = 1.0


@inlined
def pull(first, last, i, size, a, value, own, pixel, turns, slope):
    """Add to slope (5, N) what the residuals of photograph i say of its lamp; spoils turns."""
    for j in range(size):
        pixel[FORCE, j] = 0.0
    for c in range(first, last):
        for j in range(size):
            rho = own[ALBEDO + c, j]
            r = miss(rho, a[i, j], value[c, i, j])
            pixel[FORCE, j] += rho * r / (1.0 + pixel[SHARP, j] * r * r)
    slope[4, i] += total(pixel[FORCE], size)
    for k in range(4):
        for j in range(size):
            turns[k, j] *= pixel[FORCE, j]
        slope[k, i] += total(turns[k], size)


@inlined
def follow(project, size, own, pixel):
    """Take from the tensor what an albedo that follows the depth takes up (variable projection)."""
    for c in range(3):
        for j in range(size):
            rho, squares = own[ALBEDO + c, j], own[SQUARES + c, j]
            share = rho * rho / squares if project and squares > 1e-12 else 0.0
            tu, tv = own[ALONG_U + c, j], own[ALONG_V + c, j]
            pixel[UU, j] -= share * tu * tu
            pixel[UV, j] -= share * tu * tv
            pixel[VV, j] -= share * tv * tv


@inlined
def put(here, size, row, own, pixel, albedo, tensor, vector, misfit):
    """Write a strip's results to the images."""
    for j in range(size):
        at, seen = here[j], pixel[SEEN, j]
        for c in range(3):
            albedo[row, at, c] = own[ALBEDO + c, j]
        # Rounding must not make a tensor of rank one indefinite.
        uu, vv = max(pixel[UU, j], 0.0), max(pixel[VV, j], 0.0)
        limit = np.sqrt(uu * vv)
        tensor[row, at, 0] = uu
        tensor[row, at, 1] = min(max(pixel[UV, j], -limit), limit)
        tensor[row, at, 2] = vv
        vector[row, at, 0] = pixel[BU, j]
        vector[row, at, 1] = pixel[BV, j]
        misfit[row, at] = pixel[OFF, j] / seen if seen > 0.0 else 0.0


@inlined
def count_residuals(here, size, row, a, value, own, histogram):
    """Add the residuals of one channel of every other pixel to histogram (BINS)."""
    for j in range(size):
        turn_of = (row + here[j]) % 6
        if turn_of % 2 == 0:
            c = turn_of // 2
            for i in range(value.shape[1]):
                if value[c, i, j] >= 0.0:
                    shading = a[min(c, a.shape[0] - 1), i, j]
                    r = miss(own[ALBEDO + c, j], shading, value[c, i, j])
                    histogram[max(min(int(abs(r) * (BINS / WIDEST)), BINS - 1), 0)] += 1


@kernel
def explain(
    first_row, last_row, photos, table, active, gradient, points, camera, vectors, ambients,
    nearness, scales, lagged, project, albedo, tensor, vector, sums, histogram, misfit, turning,
    slope,
):  # fmt: skip
    """Albedo, depth terms, energy and residuals of a block's pixels; see `Photographs.explain`.

    Of the active pixels in rows from first_row up to last_row, which is not among them.
    table : linear light of a value, negative where it is not usable
    vectors (C, 3, N), ambients (C, N), nearness (C, N) of the lights: as in `Lamps.arrays`
    sums (h, 3): energy, squared residuals, count; histogram (h, BINS) of absolute residuals in one
    channel of every other pixel; misfit (h, w): each pixel's mean absolute residual.  When
    `turning`, slope (h, C, 5, N) gets the first derivatives of half the energy with each light's
    vector, closeness, ambient.
    """
    channels, _, count = vectors.shape
    here = np.empty(STRIP, np.int64)
    frame, light, turns = np.empty((FRAME, STRIP)), np.empty((LIGHT, STRIP)), np.empty((4, STRIP))
    own, pixel = np.empty((OWN, STRIP)), np.empty((PIXEL, STRIP))
    value = np.empty((3, count, STRIP), np.float32)
    a, w = np.empty((channels, count, STRIP)), np.empty((3, count, STRIP))
    for row in range(first_row, last_row):
        energy, squared, counted = 0.0, 0.0, 0.0
        clear(row, active, albedo, tensor, vector)
        for k in range(BINS):
            histogram[row, k] = 0
        size, column = next_strip(active, row, 0, here)
        while size > 0:
            stand(here, size, row, gradient, points, camera, lagged, frame)
            decode(here, size, row, photos, table, value)
            sharpen(here, size, row, scales, pixel)
            begin(here, size, row, albedo, own, pixel)
            for lamp in range(channels):
                for i in range(count):
                    q0, q1, q2 = vectors[lamp, 0, i], vectors[lamp, 1, i], vectors[lamp, 2, i]
                    ambient = ambients[lamp, i]
                    shade(q0, q1, q2, nearness[lamp, i], ambient, size, frame, a[lamp, i])
            rounds = ALBEDO_ROUNDS if total(pixel[SHARP], size) > 0.0 else 1
            fit_albedo(rounds, size, a, value, w, own, pixel)
            for lamp in range(channels):
                first, last = (0, 3) if channels == 1 else (lamp, lamp + 1)
                for i in range(count):
                    q0, q1, q2 = vectors[lamp, 0, i], vectors[lamp, 1, i], vectors[lamp, 2, i]
                    arrive(q0, q1, q2, nearness[lamp, i], size, frame, light)
                    if channels == 1:
                        compare_all(i, size, a[lamp], value, w, light, own, pixel)
                    else:
                        compare(lamp, i, size, a[lamp], value, w, light, own, pixel)
                    take_logarithm(size, pixel)
                    if turning:
                        turn(q0, q1, q2, nearness[lamp, i], size, frame, light, turns)
                        pull(
                            first,
                            last,
                            i,
                            size,
                            a[lamp],
                            value,
                            own,
                            pixel,
                            turns,
                            slope[row, lamp],
                        )
            follow(project, size, own, pixel)
            put(here, size, row, own, pixel, albedo, tensor, vector, misfit)
            count_residuals(here, size, row, a, value, own, histogram[row])
            squared += total(pixel[SQUARED], size)
            counted += total(pixel[SEEN], size)
            for j in range(size):
                loss, sharp = pixel[LOSS, j] + np.log(pixel[FACTOR, j]), pixel[SHARP, j]
                energy += loss / sharp if sharp > 0.0 else pixel[SQUARED, j]
            size, column = next_strip(active, row, column, here)
        sums[row, 0], sums[row, 1], sums[row, 2] = energy, squared, counted


@inlined
def illuminate(lamp, size, vectors, ambients, nearness, frame, light, by_light, shaded, turns):
    """Fill shaded and turns (parameters, N, STRIP) with what each photograph's lamp does.

    The last of the turns, the ambient's, stays 1.
    """
    for i in range(vectors.shape[2]):
        q0, q1, q2 = vectors[lamp, 0, i], vectors[lamp, 1, i], vectors[lamp, 2, i]
        arrive(q0, q1, q2, nearness[lamp, i], size, frame, light)
        turn(q0, q1, q2, nearness[lamp, i], size, frame, light, by_light)
        ambient = ambients[lamp, i]
        for j in range(size):
            shaded[DOT, i, j] = max(light[DOT, j], 0.0) + ambient
            shaded[SU, i, j] = light[SU, j]
            shaded[SV, i, j] = light[SV, j]
        for k in range(turns.shape[0] - 1):
            for j in range(size):
                turns[k, i, j] = by_light[k, j]


@inlined
def weigh(c, here, size, row, albedo, project, shaded, value, w, own, pixel):
    """Fill w with the weights of all photographs in channel c, and own with the albedo's sums.

    shaded (LIGHT, N, STRIP) : as `light`, of all photographs, but its DOT is the shading
    FREED is the inverse of the sum of w a^2, 0 where the albedo is held.
    """
    for j in range(size):
        own[ALBEDO, j] = albedo[row, here[j], c]
        own[SQUARES, j] = 0.0
        own[ALONG_U, j] = 0.0
        own[ALONG_V, j] = 0.0
    for i in range(value.shape[1]):
        for j in range(size):
            v, a = value[c, i, j], shaded[DOT, i, j]
            r = miss(own[ALBEDO, j], a, v)
            good = 1.0 if v >= 0.0 else 0.0
            weight = good / (1.0 + pixel[SHARP, j] * r * r)
            w[i, j] = weight
            own[SQUARES, j] += weight * a * a
            own[ALONG_U, j] += weight * a * shaded[SU, i, j]
            own[ALONG_V, j] += weight * a * shaded[SV, i, j]
    for j in range(size):
        squares = own[SQUARES, j]
        own[FREED, j] = 1.0 / squares if project and squares > 1e-12 else 0.0


@inlined
def respond(c, i, size, shaded, value, w, own, pixel):
    """What photograph i says in channel c of its lamp, for each number of which a turn follows.

    KNOWN of two such numbers, FORCE of one, BEND of one and the albedo, BU and BV of one and the
    depth.
    """
    for j in range(size):
        rho, a, weight, freed = own[ALBEDO, j], shaded[DOT, i, j], w[i, j], own[FREED, j]
        pixel[KNOWN, j] = rho * rho * weight
        pixel[FORCE, j] = rho * weight * miss(rho, a, value[c, i, j])
        pixel[BEND, j] = rho * weight * a * np.sqrt(freed)
        pixel[BU, j] = rho * rho * weight * (shaded[SU, i, j] - a * freed * own[ALONG_U, j])
        pixel[BV, j] = rho * rho * weight * (shaded[SV, i, j] - a * freed * own[ALONG_V, j])


@inlined
def add_lamp(i, size, turns, pixel, hessian, slope, taken, full):
    """Add to hessian (Q, Q) and slope (parameters, N) of a channel what photograph i says.

    taken (Q, WIDE) : what the albedo takes up of each of the lamp's numbers is put there, beyond
        the first `full` columns
    """
    parameters, count = turns.shape[0], turns.shape[1]
    for k in range(parameters):
        at, along = k * count + i, 0.0
        for j in range(size):
            along += pixel[FORCE, j] * turns[k, i, j]
        slope[k, i] += along
        for j in range(size):
            taken[at, full + j] = pixel[BEND, j] * turns[k, i, j]
        for m in range(k, parameters):
            both = 0.0
            for j in range(size):
                both += pixel[KNOWN, j] * turns[k, i, j] * turns[m, i, j]
            hessian[at, m * count + i] += both


@inlined
def add_mixed(i, here, size, lamp, turns, pixel, cross):
    """Add to cross, a row of pixels, how photograph i's lamp and the depth hang together."""
    for j in range(size):
        both = cross[here[j]]
        for k in range(turns.shape[0]):
            both[0, i, lamp, k] += pixel[BU, j] * turns[k, i, j]
            both[1, i, lamp, k] += pixel[BV, j] * turns[k, i, j]


@helper
def take(full, taken, hessian):
    """Subtract from hessian (Q, Q) what the albedo of the `full` columns of taken takes up."""
    columns = np.ascontiguousarray(taken[:, :full])
    hessian -= np.dot(columns, columns.T)


@kernel
def light_terms(
    block, photos, table, active, gradient, points, camera, vectors, ambients, nearness,
    scales, albedo, parameters, project, hessian, slope, cross,
):  # fmt: skip
    """Second and first derivatives of half the energy with the lights, of one block of rows.

    Each light has `parameters` numbers: its vector, [closeness,] ambient; a channel's lights, C of
    1 or 3 channels, have Q of them, those of one kind side by side, and nothing to do with another
    channel's.  The albedo is eliminated when `project`.  hessian (blocks, C, Q, Q), its upper
    triangle, and slope (blocks, C, parameters, N) are sums per block of rows; cross
    (h, w, 2, N, C, parameters) each pixel's mixed derivatives with the gradient of log depth, or
    (0, ...) for none.
    """
    channels, _, count = vectors.shape
    blocks, height = hessian.shape[0], active.shape[0]
    here = np.empty(STRIP, np.int64)
    frame, light = np.empty((FRAME, STRIP)), np.empty((LIGHT, STRIP))
    own, pixel = np.empty((OWN, STRIP)), np.empty((PIXEL, STRIP))
    by_light = np.empty((4, STRIP))
    value = np.empty((3, count, STRIP), np.float32)
    shaded, w = np.empty((LIGHT, count, STRIP)), np.empty((count, STRIP))
    turns = np.ones((parameters, count, STRIP))
    # What the albedo takes up: a column for each pixel and channel, the product of which counts.
    taken = np.empty((channels, parameters * count, WIDE))
    full = np.zeros(channels, np.int64)
    for row in range(block * height // blocks, (block + 1) * height // blocks):
        size, column = next_strip(active, row, 0, here)
        while size > 0:
            stand(here, size, row, gradient, points, camera, False, frame)
            decode(here, size, row, photos, table, value)
            sharpen(here, size, row, scales, pixel)
            for lamp in range(channels):
                illuminate(
                    lamp, size, vectors, ambients, nearness, frame, light, by_light, shaded, turns
                )
                first, last = (0, 3) if channels == 1 else (lamp, lamp + 1)
                for c in range(first, last):
                    if full[lamp] + size > WIDE:
                        take(full[lamp], taken[lamp], hessian[block, lamp])
                        full[lamp] = 0
                    weigh(c, here, size, row, albedo, project, shaded, value, w, own, pixel)
                    for i in range(count):
                        respond(c, i, size, shaded, value, w, own, pixel)
                        add_lamp(
                            i, size, turns, pixel, hessian[block, lamp], slope[block, lamp],
                            taken[lamp], full[lamp],
                        )  # fmt: skip
                        if cross.shape[0] > 0:
                            add_mixed(i, here, size, lamp, turns, pixel, cross[row])
                    full[lamp] += size if project else 0
            size, column = next_strip(active, row, column, here)
    for lamp in range(channels):
        take(full[lamp], taken[lamp], hessian[block, lamp])


@kernel
def halve(first_row, last_row, photos, table, out):
    """Means of 2 x 2 blocks in linear light as 16-bit values; 0 where one value is not usable."""
    count, _, width, _ = out.shape
    for row in range(first_row, last_row):
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
