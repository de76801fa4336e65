# mypy: disable-error-code="no-untyped-def"
"""The loops over pixels and photographs behind photometry/images.py, compiled on first use.

Photographs stay integers and are decoded by a table, pixel by pixel.  Rows are shared among the
cores and every sum is kept per row, so that results do not depend on the split.

The active pixels of a row are processed in strips: the last index of an array is a pixel's index
in its strip, and the innermost loops, over it, are vectorised.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from rakelight import jit
from rakelight.photometry.specular import EXPONENTS

# Reordered sums are within one strip, which no core shares: results stay reproducible.
kernel = partial(jit.kernel, any_order=True)
helper = partial(jit.helper, any_order=True)
# Inlined, so that the compiler knows how the arrays of a strip lie and vectorises the loops.
inlined = partial(jit.helper, any_order=True, inline=True)

# Pixels of a strip, whose arrays are to fit the cache; columns of the matrix that is multiplied by
# its transpose at once.
STRIP, WIDE = 64, 384
# Rows of `frame`: the normal n, dn/dg_u, dn/dg_v with g the gradient of log depth, the point X, the
# unit vector to the camera, three each; last, one row, what a light's beam multiplies it by.
NORMAL, BY_U, BY_V, POINT, VIEW, BEAM = range(0, 18, 3)
FRAME = BEAM + 1
# Rows of `light`: s . n and the derivatives of max(0, s . n) with g_u, g_v and (three rows) s.  Of
# `shine`: a highlight and its derivatives, after LIGHT of them those with each coefficient k_e.
DOT, SU, SV, BY_S, LIGHT = 0, 1, 2, 3, 6
# Rows of `derivatives`: those with a light's vector (three rows), inverse distance and beam (three
# rows); the ambient light's are 1.
BY_DISTANCE, BY_BEAM, BY_LIGHT = 3, 4, 7
# Rows of `own`, three each, one per channel: albedo; sums over the photographs of w a^2, w a I,
# w a su and w a sv, with weights w and shading a; 1 / sum of w a^2.
ALBEDO, SQUARES, PRODUCTS, ALONG_U, ALONG_V, INV_SQUARES, OWN = range(0, 21, 3)
# Rows of `pixel`, sums over photographs and channels: M, b, squared and absolute residuals, their
# number, their losses as a logarithm and a factor whose logarithm is not taken yet; 1 / scale^2 of
# the loss.  Of one photograph: MIXED second derivative with shading and albedo (or scratch of
# `fit_albedo`), INFORMATION and GRADIENT, the second and first derivative with the shading.
(
    UU, UV, VV, BU, BV, SQUARED, ABS_RESIDUAL, COUNT, LOSS, FACTOR, INV_SCALE2, MIXED, INFORMATION,
    GRADIENT, PIXEL,
) = range(15)  # fmt: skip

# Iterations of reweighted least squares for the albedo of a pixel.
ALBEDO_ROUNDS = 2
# Bins of the histogram of absolute residuals, and its upper end; white is 1.
BINS = 1024
WIDEST = 0.5
# Marks a value that is not usable.  Not -1: a usable one less its highlight may be below 0.
UNUSABLE = -1e3
# Least albedo where a value is usable: the derivatives of a highlight are divided by it.
LEAST_ALBEDO = 1e-6
# Exponents of the highlights' lobes, each four times the one before.
WIDE_LOBE, MIDDLE_LOBE, NARROW_LOBE = map(float, EXPONENTS)
# Factor beyond which its logarithm is taken: losses are summed as the logarithm of a product.
LARGEST = 1e150


@helper
def next_strip(active, row, column, here):
    """Fill here with the active columns from `column` on; returns how many, and where to go on."""
    size = 0
    while column < active.shape[1] and size < STRIP:
        if active[row, column]:
            here[size] = column
            size += 1
        column += 1
    return size, column


@helper
def clear(row, active, albedo, jtwj, rhs):
    """Set the results of pixels without a normal to 0."""
    for column in range(active.shape[1]):
        if not active[row, column]:
            for k in range(3):
                albedo[row, column, k] = 0.0
                jtwj[row, column, k] = 0.0
            rhs[row, column, 0] = 0.0
            rhs[row, column, 1] = 0.0


@inlined
def load_geometry(here, size, row, gradient, points, camera, lagged, frame):
    """Fill frame: normals, their derivatives, with |m| lagged or not, points and views."""
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
    for j in range(size):
        right, below = (here[j] - cx) / fx, y / fy
        over = -1.0 / np.sqrt(right * right + below * below + 1.0)
        frame[VIEW, j], frame[VIEW + 1, j], frame[VIEW + 2, j] = right * over, below * over, over


@inlined
def falloff_of(falloffs, light_c, i):
    """A light's fall-off: |q| k, for `vector_at`, and b_x, b_y and w of its beam."""
    light = falloffs[light_c]
    return light[0, i], light[1, i], light[2, i], light[3, i]


@inlined
def ambient_of(ambients, light_c, i):
    """Ambient light of a photograph: phi, and phi d, d being its direction."""
    light = ambients[light_c]
    phi = light[0, i]
    return phi, phi * light[1, i], phi * light[2, i], phi * light[3, i]


@inlined
def load_beam(q0, q1, q2, falloff, size, frame):
    """Fill frame's BEAM: g = exp(b_x X_x + b_y X_y + w (u . X)^2) of a light, u = q/|q|.

    Apart from the loops that use it: with an exponential in them they would not be vectorised.
    """
    _, beam_x, beam_y, width = falloff
    if beam_x == 0.0 and beam_y == 0.0 and width == 0.0:
        for j in range(size):
            frame[BEAM, j] = 1.0
    else:
        along = width / (q0 * q0 + q1 * q1 + q2 * q2 + 1e-300)
        for j in range(size):
            p0, p1, p2 = frame[POINT, j], frame[POINT + 1, j], frame[POINT + 2, j]
            toward = q0 * p0 + q1 * p1 + q2 * p2
            frame[BEAM, j] = np.exp(beam_x * p0 + beam_y * p1 + along * toward * toward)


@inlined
def vector_at(q0, q1, q2, nearness, frame, j):
    """t (3) and f, f g t being the light vector s of a light at a pixel's point X; g its BEAM.

    X in metres from the object's middle.  With q the light vector there, u = q/|q| and k the
    inverse distance, 1/metre, the light is at u/k and s = g |q| (u - k X) / r^3, r = |u - k X|,
    which is g q for k = 0.  nearness : |q| k;  t = q - |q| k X, f = 1/r^3
    """
    t0 = q0 - nearness * frame[POINT, j]
    t1 = q1 - nearness * frame[POINT + 1, j]
    t2 = q2 - nearness * frame[POINT + 2, j]
    by_r2 = (q0 * q0 + q1 * q1 + q2 * q2) / (t0 * t0 + t1 * t1 + t2 * t2 + 1e-300)
    return t0, t1, t2, by_r2 * np.sqrt(by_r2)


@inlined
def evaluate_light(q0, q1, q2, falloff, ambient, size, frame, light):
    """Fill light: s . n of a light, as in `vector_at`, and the shading's derivatives.

    Those with the normal hold the ambient light's part, too.
    """
    nearness, (_, d0, d1, d2) = falloff[0], ambient
    for j in range(size):
        t0, t1, t2, gain = q0, q1, q2, 1.0
        if nearness > 0.0:
            t0, t1, t2, gain = vector_at(q0, q1, q2, nearness, frame, j)
        gain *= frame[BEAM, j]
        n0, n1, n2 = frame[NORMAL, j], frame[NORMAL + 1, j], frame[NORMAL + 2, j]
        u0, u1, u2 = frame[BY_U, j], frame[BY_U + 1, j], frame[BY_U + 2, j]
        v0, v1, v2 = frame[BY_V, j], frame[BY_V + 1, j], frame[BY_V + 2, j]
        dot = gain * (t0 * n0 + t1 * n1 + t2 * n2)
        lit = 1.0 if dot > 0.0 else 0.0
        light[DOT, j] = dot
        light[SU, j] = lit * gain * (t0 * u0 + t1 * u1 + t2 * u2)
        light[SV, j] = lit * gain * (t0 * v0 + t1 * v1 + t2 * v2)
        light[BY_S, j], light[BY_S + 1, j], light[BY_S + 2, j] = lit * n0, lit * n1, lit * n2
    if d0 != 0.0 or d1 != 0.0 or d2 != 0.0:
        for j in range(size):
            u0, u1, u2 = frame[BY_U, j], frame[BY_U + 1, j], frame[BY_U + 2, j]
            v0, v1, v2 = frame[BY_V, j], frame[BY_V + 1, j], frame[BY_V + 2, j]
            light[SU, j] += d0 * u0 + d1 * u1 + d2 * u2
            light[SV, j] += d0 * v0 + d1 * v1 + d2 * v2


@inlined
def evaluate_highlight(q0, q1, q2, falloff, gloss, size, frame, shine):
    """Fill shine: a light's highlight |s| sum_e k_e c^e, and its derivatives; s as in `vector_at`.

    With l = s/|s|, h = l + the view and c = n . h/|h|:
        dc/dl = (n - c h/|h|) / |h|,  dl/ds = (I - l l^T) / |s|
    gloss (E,) : the k_e; E is 3
    """
    nearness = falloff[0]
    for j in range(size):
        t0, t1, t2, gain = q0, q1, q2, 1.0
        if nearness > 0.0:
            t0, t1, t2, gain = vector_at(q0, q1, q2, nearness, frame, j)
        gain *= frame[BEAM, j]
        length = np.sqrt(t0 * t0 + t1 * t1 + t2 * t2) + 1e-300
        l0, l1, l2, strength = t0 / length, t1 / length, t2 / length, gain * length
        n0, n1, n2 = frame[NORMAL, j], frame[NORMAL + 1, j], frame[NORMAL + 2, j]
        h0, h1, h2 = l0 + frame[VIEW, j], l1 + frame[VIEW + 1, j], l2 + frame[VIEW + 2, j]
        over = 1.0 / (np.sqrt(h0 * h0 + h1 * h1 + h2 * h2) + 1e-12)
        h0, h1, h2 = over * h0, over * h1, over * h2
        cosine = max(n0 * h0 + n1 * h1 + n2 * h2, 0.0) if n0 * l0 + n1 * l1 + n2 * l2 > 0.0 else 0.0
        # Not a loop over the exponents, in which the pixels would be taken one by one.
        fourth = cosine * cosine * cosine * cosine
        wide = fourth * fourth
        middle = wide * wide * wide * wide
        narrow = middle * middle * middle * middle
        shine[LIGHT, j], shine[LIGHT + 1, j] = strength * wide, strength * middle
        shine[LIGHT + 2, j] = strength * narrow
        wide, middle, narrow = gloss[0] * wide, gloss[1] * middle, gloss[2] * narrow
        total_power = wide + middle + narrow
        by_cosine = WIDE_LOBE * wide + MIDDLE_LOBE * middle + NARROW_LOBE * narrow
        by_cosine /= cosine + 1e-300
        u0, u1, u2 = frame[BY_U, j], frame[BY_U + 1, j], frame[BY_U + 2, j]
        v0, v1, v2 = frame[BY_V, j], frame[BY_V + 1, j], frame[BY_V + 2, j]
        shine[DOT, j] = strength * total_power
        shine[SU, j] = strength * by_cosine * (h0 * u0 + h1 * u1 + h2 * u2)
        shine[SV, j] = strength * by_cosine * (h0 * v0 + h1 * v1 + h2 * v2)
        c0, c1, c2 = over * (n0 - cosine * h0), over * (n1 - cosine * h1), over * (n2 - cosine * h2)
        along = c0 * l0 + c1 * l1 + c2 * l2
        shine[BY_S, j] = total_power * l0 + by_cosine * (c0 - along * l0)
        shine[BY_S + 1, j] = total_power * l1 + by_cosine * (c1 - along * l1)
        shine[BY_S + 2, j] = total_power * l2 + by_cosine * (c2 - along * l2)


@inlined
def shade(q0, q1, q2, falloff, ambient, size, frame, shading):
    """Fill shading (STRIP): max(0, s . n) of a light, as in `vector_at`, plus ambient light."""
    nearness, (phi, d0, d1, d2) = falloff[0], ambient
    for j in range(size):
        t0, t1, t2, gain = q0, q1, q2, 1.0
        if nearness > 0.0:
            t0, t1, t2, gain = vector_at(q0, q1, q2, nearness, frame, j)
        gain *= frame[BEAM, j]
        n0, n1, n2 = frame[NORMAL, j], frame[NORMAL + 1, j], frame[NORMAL + 2, j]
        shading[j] = max(gain * (t0 * n0 + t1 * n1 + t2 * n2), 0.0) + phi
    if d0 != 0.0 or d1 != 0.0 or d2 != 0.0:
        for j in range(size):
            n0, n1, n2 = frame[NORMAL, j], frame[NORMAL + 1, j], frame[NORMAL + 2, j]
            shading[j] += d0 * n0 + d1 * n1 + d2 * n2


@inlined
def differentiate(q0, q1, q2, falloff, size, frame, light, derivatives):
    """Fill derivatives (BY_LIGHT, STRIP) with a light's numbers, from those of `light` with s.

    With d the derivatives with s, f, g, t as in `vector_at`, e = t/|t|, Df = f g (I - 3 e e^T):
        d/dq = Df d + u (s . d / |q| - u . Df d) + 2 w L (u . X) (X - u (u . X)) / |q|
        d/dk = -|q| X . Df d,   d/db = L (X_x, X_y),   d/dw = L (u . X)^2
    L being what `light` is of, at least 0: proportional to |s|.
    """
    nearness, width = falloff[0], falloff[3]
    size2 = q0 * q0 + q1 * q1 + q2 * q2 + 1e-24
    length = np.sqrt(size2)
    for j in range(size):
        t0, t1, t2, gain = q0, q1, q2, 1.0
        if nearness > 0.0:
            t0, t1, t2, gain = vector_at(q0, q1, q2, nearness, frame, j)
        gain *= frame[BEAM, j]
        w0, w1, w2 = gain * light[BY_S, j], gain * light[BY_S + 1, j], gain * light[BY_S + 2, j]
        along_s = t0 * w0 + t1 * w1 + t2 * w2
        bent = 3.0 * along_s / (t0 * t0 + t1 * t1 + t2 * t2 + 1e-300)
        f0, f1, f2 = w0 - bent * t0, w1 - bent * t1, w2 - bent * t2
        along = (along_s - (q0 * f0 + q1 * f1 + q2 * f2)) / size2
        p0, p1, p2 = frame[POINT, j], frame[POINT + 1, j], frame[POINT + 2, j]
        arriving, toward = max(light[DOT, j], 0.0), (q0 * p0 + q1 * p1 + q2 * p2) / size2
        turned = 2.0 * width * arriving * toward
        along -= turned * toward
        derivatives[0, j], derivatives[1, j], derivatives[2, j] = (
            f0 + along * q0 + turned * p0,
            f1 + along * q1 + turned * p1,
            f2 + along * q2 + turned * p2,
        )
        derivatives[BY_DISTANCE, j] = -length * (p0 * f0 + p1 * f1 + p2 * f2)
        derivatives[BY_BEAM, j], derivatives[BY_BEAM + 1, j] = arriving * p0, arriving * p1
        derivatives[BY_BEAM + 2, j] = arriving * toward * toward * size2


@inlined
def decode(here, size, row, photos, table, value):
    """Fill value (3, N, STRIP) with linear light, `UNUSABLE` where it is not usable."""
    for i in range(value.shape[1]):
        for c in range(3):
            for j in range(size):
                light = table[photos[i, row, here[j], c]]
                value[c, i, j] = light if light >= 0.0 else UNUSABLE


@inlined
def subtract_highlight(first, last, i, size, shine, value):
    """Subtract photograph i's highlight from its usable values in the channels it lights."""
    for c in range(first, last):
        for j in range(size):
            value[c, i, j] -= shine[DOT, j] if value[c, i, j] > UNUSABLE else 0.0


@inlined
def add_highlight(rho, size, light, shine, both):
    """Fill both's SU and SV: light's and, over the albedo rho (STRIP), the highlight's."""
    for j in range(size):
        over = 1.0 / max(rho[j], LEAST_ALBEDO)
        both[SU, j] = light[SU, j] + over * shine[SU, j]
        both[SV, j] = light[SV, j] + over * shine[SV, j]


@inlined
def load_scales(here, size, row, scales, pixel):
    """Fill pixel's INV_SCALE2: 1 / scale^2 of the loss, 0 for least squares."""
    for j in range(size):
        scale = scales[row, here[j]]
        pixel[INV_SCALE2, j] = 1.0 / (scale * scale) if scale > 0.0 else 0.0


@inlined
def residual(rho, shading, value):
    """Model minus value, 0 for a value that is not usable."""
    return rho * shading - value if value > UNUSABLE else 0.0


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

    own : its albedo is where the reweighting starts, negative for least squares, and the result
    a (C, N, STRIP) : shading; value (3, N, STRIP) : as decoded
    """
    for _round in range(rounds):
        for c in range(3):
            light_c = min(c, a.shape[0] - 1)
            for j in range(size):
                pixel[MIXED, j] = pixel[INV_SCALE2, j] if own[ALBEDO + c, j] >= 0.0 else 0.0
                own[SQUARES + c, j] = 0.0
                own[PRODUCTS + c, j] = 0.0
            for i in range(a.shape[1]):
                for j in range(size):
                    v, shading = value[c, i, j], a[light_c, i, j]
                    off = own[ALBEDO + c, j] * shading - v
                    good = 1.0 if v > UNUSABLE else 0.0
                    weight = good / (1.0 + pixel[MIXED, j] * off * off)
                    w[c, i, j] = weight
                    own[SQUARES + c, j] += weight * shading * shading
                    own[PRODUCTS + c, j] += weight * shading * v
            for j in range(size):
                squares, products = own[SQUARES + c, j], own[PRODUCTS + c, j]
                rho = max(products / squares, LEAST_ALBEDO) if squares > 1e-12 else 0.0
                own[ALBEDO + c, j] = rho


@inlined
def reset_sums(here, size, row, albedo, own, pixel):
    """Load the albedo to start from, and set every sum of a strip to 0."""
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
def accumulate_residuals(c, i, size, a, value, w, light, own, pixel):
    """Add the residuals of photograph i, channel c, under the shading a (N, STRIP), to sums."""
    for j in range(size):
        shading, su, sv, inv_scale2 = a[i, j], light[SU, j], light[SV, j], pixel[INV_SCALE2, j]
        rho, weight = own[ALBEDO + c, j], w[c, i, j]
        r = residual(rho, shading, value[c, i, j])
        information, gradient = rho * rho * weight, rho * weight * r
        pixel[SQUARED, j] += r * r
        pixel[ABS_RESIDUAL, j] += abs(r)
        pixel[COUNT, j] += 1.0 if value[c, i, j] > UNUSABLE else 0.0
        pixel[FACTOR, j] *= 1.0 + inv_scale2 * r * r
        pixel[UU, j] += information * su * su
        pixel[UV, j] += information * su * sv
        pixel[VV, j] += information * sv * sv
        pixel[BU, j] -= gradient * su
        pixel[BV, j] -= gradient * sv
        own[ALONG_U + c, j] += weight * shading * su
        own[ALONG_V + c, j] += weight * shading * sv


@inlined
def accumulate_residuals_all(i, size, a, value, w, light, own, pixel):
    """As `accumulate_residuals`, of all three channels at once, which share a light: faster."""
    for j in range(size):
        shading, su, sv, inv_scale2 = a[i, j], light[SU, j], light[SV, j], pixel[INV_SCALE2, j]
        rho0, rho1, rho2 = own[ALBEDO, j], own[ALBEDO + 1, j], own[ALBEDO + 2, j]
        w0, w1, w2 = w[0, i, j], w[1, i, j], w[2, i, j]
        r0 = residual(rho0, shading, value[0, i, j])
        r1 = residual(rho1, shading, value[1, i, j])
        r2 = residual(rho2, shading, value[2, i, j])
        information = rho0 * rho0 * w0 + rho1 * rho1 * w1 + rho2 * rho2 * w2
        gradient = rho0 * w0 * r0 + rho1 * w1 * r1 + rho2 * w2 * r2
        pixel[SQUARED, j] += r0 * r0 + r1 * r1 + r2 * r2
        pixel[ABS_RESIDUAL, j] += abs(r0) + abs(r1) + abs(r2)
        pixel[FACTOR, j] *= (
            (1.0 + inv_scale2 * r0 * r0)
            * (1.0 + inv_scale2 * r1 * r1)
            * (1.0 + inv_scale2 * r2 * r2)
        )
        pixel[UU, j] += information * su * su
        pixel[UV, j] += information * su * sv
        pixel[VV, j] += information * sv * sv
        pixel[BU, j] -= gradient * su
        pixel[BV, j] -= gradient * sv
        own[ALONG_U, j] += w0 * shading * su
        own[ALONG_V, j] += w0 * shading * sv
        own[ALONG_U + 1, j] += w1 * shading * su
        own[ALONG_V + 1, j] += w1 * shading * sv
        own[ALONG_U + 2, j] += w2 * shading * su
        own[ALONG_V + 2, j] += w2 * shading * sv
    for j in range(size):
        seen0 = 1.0 if value[0, i, j] > UNUSABLE else 0.0
        seen1 = 1.0 if value[1, i, j] > UNUSABLE else 0.0
        seen2 = 1.0 if value[2, i, j] > UNUSABLE else 0.0
        pixel[COUNT, j] += seen0 + seen1 + seen2


@inlined
def take_logarithm(size, pixel):
    """Keep the product of losses from growing too large."""
    if total(pixel[FACTOR], size) > LARGEST:
        for j in range(size):
            pixel[LOSS, j] += np.log(pixel[FACTOR, j])
            pixel[FACTOR, j] = 1.0


@inlined
def add_slope(i, size, pixel, derivatives, slope):
    """Add derivatives times pixel's GRADIENT to slope (BY_LIGHT + 1, N); spoils derivatives."""
    for k in range(BY_LIGHT):
        for j in range(size):
            derivatives[k, j] *= pixel[GRADIENT, j]
        slope[k, i] += total(derivatives[k], size)


@inlined
def accumulate_light_slope(first, last, i, size, a, value, own, pixel, frame, derivatives, slope):
    """Add photograph i's part of half the energy's gradient to slope; spoils derivatives."""
    for j in range(size):
        pixel[GRADIENT, j] = 0.0
    for c in range(first, last):
        for j in range(size):
            rho = own[ALBEDO + c, j]
            r = residual(rho, a[i, j], value[c, i, j])
            pixel[GRADIENT, j] += rho * r / (1.0 + pixel[INV_SCALE2, j] * r * r)
    slope[BY_LIGHT, i] += total(pixel[GRADIENT], size)
    for k in range(slope.shape[0] - BY_LIGHT - 1):
        along = 0.0
        for j in range(size):
            along += pixel[GRADIENT, j] * frame[NORMAL + k, j]
        slope[BY_LIGHT + 1 + k, i] += along
    add_slope(i, size, pixel, derivatives, slope)


@helper
def accumulate_highlight_slope(
    first, last, i, size, a, value, own, pixel, shine, derivatives, slope, gloss_slope
):
    """Add the part of photograph i's highlight to slope and gloss_slope (E,).

    Spoils derivatives.
    """
    for j in range(size):
        pixel[GRADIENT, j] = 0.0
    for c in range(first, last):
        for j in range(size):
            r = residual(own[ALBEDO + c, j], a[i, j], value[c, i, j])
            pixel[GRADIENT, j] += r / (1.0 + pixel[INV_SCALE2, j] * r * r)
    for e in range(gloss_slope.size):
        along = 0.0
        for j in range(size):
            along += pixel[GRADIENT, j] * shine[LIGHT + e, j]
        gloss_slope[e] += along
    add_slope(i, size, pixel, derivatives, slope)


@inlined
def eliminate_albedo(project, size, own, pixel):
    """Subtract from M what the albedo makes up for (variable projection)."""
    for c in range(3):
        for j in range(size):
            rho, squares = own[ALBEDO + c, j], own[SQUARES + c, j]
            share = rho * rho / squares if project and squares > 1e-12 else 0.0
            tu, tv = own[ALONG_U + c, j], own[ALONG_V + c, j]
            pixel[UU, j] -= share * tu * tu
            pixel[UV, j] -= share * tu * tv
            pixel[VV, j] -= share * tv * tv


@inlined
def store(here, size, row, own, pixel, albedo, jtwj, rhs, mean_abs_residual):
    """Store a strip's results in the images."""
    for j in range(size):
        at, usable = here[j], pixel[COUNT, j]
        for c in range(3):
            albedo[row, at, c] = own[ALBEDO + c, j]
        # Rounding must not make a matrix of rank one indefinite.
        uu, vv = max(pixel[UU, j], 0.0), max(pixel[VV, j], 0.0)
        limit = np.sqrt(uu * vv)
        jtwj[row, at, 0] = uu
        jtwj[row, at, 1] = min(max(pixel[UV, j], -limit), limit)
        jtwj[row, at, 2] = vv
        rhs[row, at, 0] = pixel[BU, j]
        rhs[row, at, 1] = pixel[BV, j]
        mean_abs_residual[row, at] = pixel[ABS_RESIDUAL, j] / usable if usable > 0.0 else 0.0


@inlined
def count_residuals(here, size, row, a, value, own, histogram):
    """Add the residuals of one channel of every other pixel to histogram (BINS)."""
    for j in range(size):
        turn_of = (row + here[j]) % 6
        if turn_of % 2 == 0:
            c = turn_of // 2
            for i in range(value.shape[1]):
                if value[c, i, j] > UNUSABLE:
                    shading = a[min(c, a.shape[0] - 1), i, j]
                    r = residual(own[ALBEDO + c, j], shading, value[c, i, j])
                    histogram[max(min(int(abs(r) * (BINS / WIDEST)), BINS - 1), 0)] += 1


@kernel
def linearize(*given):
    """Albedo, M, b, energy and residuals of matte pixels; given as to `linearize_rows`."""
    linearize_rows(None, None, *given)


@kernel
def linearize_glossy(gloss, gloss_slope, *given):
    """As `linearize`, with highlights.  Apart, since most captures need not compile it."""
    linearize_rows(gloss, gloss_slope, *given)


@helper
def linearize_rows(
    gloss, gloss_slope, first_row, last_row, photos, table, active, gradient, points, camera,
    vectors, ambients, falloffs, scales, lagged, project, albedo, jtwj, rhs, sums, histogram,
    mean_abs_residual, with_light_slope, slope,
):  # fmt: skip
    """Albedo, M, b, energy and residuals of the active pixels; see `Photographs.linearize`.

    In rows from first_row up to last_row, which is not among them.
    table : linear light of a value, negative where it is not usable
    gloss (E,) of the surface, or None where it is matte; vectors (C, 3, N), ambients (C, 4, N),
    falloffs (C, 4, N) of the lights: `LightParameters.arrays`
    sums (h, 3): energy, squared residuals, count; histogram (h, BINS) of absolute residuals in one
    channel of every other pixel; mean_abs_residual (h, w): of each pixel.  With `with_light_slope`,
    slope (h, C, 8 or 11, N) gets the first derivatives of half the energy with each light's vector,
    inverse distance, beam, ambient light phi [and phi d], gloss_slope (h, E) with the gloss.
    """
    channels, _, count = vectors.shape
    here = np.empty(STRIP, np.int64)
    frame, derivatives = np.empty((FRAME, STRIP)), np.empty((BY_LIGHT, STRIP))
    light, both = np.empty((LIGHT, STRIP)), np.empty((LIGHT, STRIP))
    if gloss is not None:
        shines = np.empty((channels, count, LIGHT + gloss.size, STRIP))
    own, pixel = np.empty((OWN, STRIP)), np.empty((PIXEL, STRIP))
    value = np.empty((3, count, STRIP), np.float32)
    a, w = np.empty((channels, count, STRIP)), np.empty((3, count, STRIP))
    for row in range(first_row, last_row):
        energy, squared, counted = 0.0, 0.0, 0.0
        clear(row, active, albedo, jtwj, rhs)
        for k in range(BINS):
            histogram[row, k] = 0
        size, column = next_strip(active, row, 0, here)
        while size > 0:
            load_geometry(here, size, row, gradient, points, camera, lagged, frame)
            decode(here, size, row, photos, table, value)
            load_scales(here, size, row, scales, pixel)
            reset_sums(here, size, row, albedo, own, pixel)
            for light_c in range(channels):
                first, last = (0, 3) if channels == 1 else (light_c, light_c + 1)
                for i in range(count):
                    q0, q1, q2 = (
                        vectors[light_c, 0, i],
                        vectors[light_c, 1, i],
                        vectors[light_c, 2, i],
                    )
                    falloff = falloff_of(falloffs, light_c, i)
                    ambient = ambient_of(ambients, light_c, i)
                    load_beam(q0, q1, q2, falloff, size, frame)
                    shade(q0, q1, q2, falloff, ambient, size, frame, a[light_c, i])
                    if gloss is not None:
                        shine = shines[light_c, i]
                        evaluate_highlight(q0, q1, q2, falloff, gloss, size, frame, shine)
                        subtract_highlight(first, last, i, size, shine, value)
            rounds = ALBEDO_ROUNDS if total(pixel[INV_SCALE2], size) > 0.0 else 1
            fit_albedo(rounds, size, a, value, w, own, pixel)
            for light_c in range(channels):
                first, last = (0, 3) if channels == 1 else (light_c, light_c + 1)
                for i in range(count):
                    q0, q1, q2 = (
                        vectors[light_c, 0, i],
                        vectors[light_c, 1, i],
                        vectors[light_c, 2, i],
                    )
                    falloff = falloff_of(falloffs, light_c, i)
                    ambient = ambient_of(ambients, light_c, i)
                    load_beam(q0, q1, q2, falloff, size, frame)
                    evaluate_light(q0, q1, q2, falloff, ambient, size, frame, light)
                    if gloss is not None:
                        for c in range(first, last):
                            add_highlight(own[ALBEDO + c], size, light, shines[light_c, i], both)
                            accumulate_residuals(c, i, size, a[light_c], value, w, both, own, pixel)
                    elif channels == 1:
                        accumulate_residuals_all(i, size, a[light_c], value, w, light, own, pixel)
                    else:
                        accumulate_residuals(
                            light_c, i, size, a[light_c], value, w, light, own, pixel
                        )
                    take_logarithm(size, pixel)
                    if with_light_slope:
                        differentiate(q0, q1, q2, falloff, size, frame, light, derivatives)
                        accumulate_light_slope(
                            first, last, i, size, a[light_c], value, own, pixel, frame,
                            derivatives, slope[row, light_c],
                        )  # fmt: skip
                        if gloss is not None:
                            shine = shines[light_c, i]
                            differentiate(q0, q1, q2, falloff, size, frame, shine, derivatives)
                            accumulate_highlight_slope(
                                first, last, i, size, a[light_c], value, own, pixel, shine,
                                derivatives, slope[row, light_c], gloss_slope[row],
                            )  # fmt: skip
            eliminate_albedo(project, size, own, pixel)
            store(here, size, row, own, pixel, albedo, jtwj, rhs, mean_abs_residual)
            count_residuals(here, size, row, a, value, own, histogram[row])
            squared += total(pixel[SQUARED], size)
            counted += total(pixel[COUNT], size)
            for j in range(size):
                loss, inv_scale2 = pixel[LOSS, j] + np.log(pixel[FACTOR, j]), pixel[INV_SCALE2, j]
                energy += loss / inv_scale2 if inv_scale2 > 0.0 else pixel[SQUARED, j]
            size, column = next_strip(active, row, column, here)
        sums[row, 0], sums[row, 1], sums[row, 2] = energy, squared, counted


@inlined
def illuminate(
    light_c, size, vectors, ambients, falloffs, frame, light, by_light, shaded, derivatives
):
    """Fill shaded and derivatives (parameters, N, STRIP) for each photograph's light.

    The last of the derivatives is the ambient light's.
    shaded (BY_S + D, N, STRIP) : after SU and SV the derivatives with d, D being 3, or 0 for none
    """
    last = derivatives.shape[0] - 1
    for i in range(vectors.shape[2]):
        q0, q1, q2 = vectors[light_c, 0, i], vectors[light_c, 1, i], vectors[light_c, 2, i]
        falloff = falloff_of(falloffs, light_c, i)
        load_beam(q0, q1, q2, falloff, size, frame)
        ambient = ambient_of(ambients, light_c, i)
        evaluate_light(q0, q1, q2, falloff, ambient, size, frame, light)
        differentiate(q0, q1, q2, falloff, size, frame, light, by_light)
        phi = ambient[0]
        d0, d1, d2 = ambients[light_c, 1, i], ambients[light_c, 2, i], ambients[light_c, 3, i]
        for j in range(size):
            n0, n1, n2 = frame[NORMAL, j], frame[NORMAL + 1, j], frame[NORMAL + 2, j]
            by_ambient = 1.0 + d0 * n0 + d1 * n1 + d2 * n2
            shaded[DOT, i, j] = max(light[DOT, j], 0.0) + phi * by_ambient
            shaded[SU, i, j] = light[SU, j]
            shaded[SV, i, j] = light[SV, j]
            derivatives[last, i, j] = by_ambient
        for k in range(last):
            for j in range(size):
                derivatives[k, i, j] = by_light[k, j]
        for k in range(shaded.shape[0] - BY_S):
            for j in range(size):
                shaded[BY_S + k, i, j] = phi * frame[NORMAL + k, j]


@helper
def reflect(
    light_c, first, last, size, vectors, falloffs, gloss, frame, shine, by_light, value, shone,
    derivatives,
):  # fmt: skip
    """As `illuminate`, for each photograph's highlight, which is subtracted from its values.

    shone (BY_S + E, N, STRIP) : after SU and SV the derivatives with the gloss
    """
    for i in range(vectors.shape[2]):
        q0, q1, q2 = vectors[light_c, 0, i], vectors[light_c, 1, i], vectors[light_c, 2, i]
        falloff = falloff_of(falloffs, light_c, i)
        load_beam(q0, q1, q2, falloff, size, frame)
        evaluate_highlight(q0, q1, q2, falloff, gloss, size, frame, shine)
        differentiate(q0, q1, q2, falloff, size, frame, shine, by_light)
        subtract_highlight(first, last, i, size, shine, value)
        for j in range(size):
            shone[SU, i, j] = shine[SU, j]
            shone[SV, i, j] = shine[SV, j]
            for e in range(gloss.size):
                shone[BY_S + e, i, j] = shine[LIGHT + e, j]
        for k in range(derivatives.shape[0] - 1):
            for j in range(size):
                derivatives[k, i, j] = by_light[k, j]


@helper
def add_highlights(rho, size, shaded, shone, by_light, by_highlight, both, by_both):
    """Fill both and by_both (parameters, N, STRIP): light's and, over the albedo, highlights'.

    both : after SU and SV the derivatives with the gloss, then those with d
    """
    last = by_light.shape[0] - 1
    for i in range(shaded.shape[1]):
        for j in range(size):
            over = 1.0 / max(rho[j], LEAST_ALBEDO)
            both[DOT, i, j] = shaded[DOT, i, j]
            both[SU, i, j] = shaded[SU, i, j] + over * shone[SU, i, j]
            both[SV, i, j] = shaded[SV, i, j] + over * shone[SV, i, j]
            for e in range(BY_S, shone.shape[0]):
                both[e, i, j] = over * shone[e, i, j]
            for k in range(shaded.shape[0] - BY_S):
                both[shone.shape[0] + k, i, j] = shaded[BY_S + k, i, j]
            for k in range(last):
                by_both[k, i, j] = by_light[k, i, j] + over * by_highlight[k, i, j]
            by_both[last, i, j] = by_light[last, i, j]


@inlined
def load_albedo(c, here, size, row, albedo, own):
    """Fill own's first row with the albedo of channel c."""
    for j in range(size):
        own[ALBEDO, j] = albedo[row, here[j], c]


@inlined
def weigh(c, size, project, shaded, value, w, own, pixel):
    """Fill w with the weights of all photographs in channel c, and own with the albedo's sums.

    shaded (BY_S, N, STRIP) : as `light`, of all photographs, but its DOT is the shading
    INV_SQUARES is 1 / sum of w a^2, or 0 to keep the albedo fixed.
    """
    for j in range(size):
        own[SQUARES, j] = 0.0
        own[ALONG_U, j] = 0.0
        own[ALONG_V, j] = 0.0
    for i in range(value.shape[1]):
        for j in range(size):
            v, a = value[c, i, j], shaded[DOT, i, j]
            r = residual(own[ALBEDO, j], a, v)
            good = 1.0 if v > UNUSABLE else 0.0
            weight = good / (1.0 + pixel[INV_SCALE2, j] * r * r)
            w[i, j] = weight
            own[SQUARES, j] += weight * a * a
            own[ALONG_U, j] += weight * a * shaded[SU, i, j]
            own[ALONG_V, j] += weight * a * shaded[SV, i, j]
    for j in range(size):
        squares = own[SQUARES, j]
        own[INV_SQUARES, j] = 1.0 / squares if project and squares > 1e-12 else 0.0


@inlined
def linearize_light(c, i, size, shaded, value, w, own, pixel):
    """Fill pixel with derivatives of half the energy of photograph i in channel c.

    They are with the shading; times the shading's own they are with the light's numbers:
    INFORMATION of two such numbers, GRADIENT of one, MIXED of one and the albedo, BU and BV of one
    and the depth.
    """
    for j in range(size):
        rho, a, weight, inv_squares = (
            own[ALBEDO, j],
            shaded[DOT, i, j],
            w[i, j],
            own[INV_SQUARES, j],
        )
        pixel[INFORMATION, j] = rho * rho * weight
        pixel[GRADIENT, j] = rho * weight * residual(rho, a, value[c, i, j])
        pixel[MIXED, j] = rho * weight * a * np.sqrt(inv_squares)
        pixel[BU, j] = rho * rho * weight * (shaded[SU, i, j] - a * inv_squares * own[ALONG_U, j])
        pixel[BV, j] = rho * rho * weight * (shaded[SV, i, j] - a * inv_squares * own[ALONG_V, j])


@inlined
def accumulate_light(i, size, derivatives, pixel, hessian, slope, eliminated, full):
    """Add photograph i's part to hessian (Q, Q) and slope (parameters, N) of a channel.

    eliminated (Q, WIDE) : gets the mixed derivatives with the albedo, for `subtract_eliminated`,
        beyond the first `full` columns
    """
    parameters, count = derivatives.shape[0], derivatives.shape[1]
    for k in range(parameters):
        at, along = k * count + i, 0.0
        for j in range(size):
            along += pixel[GRADIENT, j] * derivatives[k, i, j]
        slope[k, i] += along
        for j in range(size):
            eliminated[at, full + j] = pixel[MIXED, j] * derivatives[k, i, j]
        for m in range(k, parameters):
            both = 0.0
            for j in range(size):
                both += pixel[INFORMATION, j] * derivatives[k, i, j] * derivatives[m, i, j]
            hessian[at, m * count + i] += both


@helper
def accumulate_shared(
    i, row, here, size, both, derivatives, pixel, hessian, slope, cross, eliminated, full
):
    """Add photograph i's part to the rows of hessian (Q + S, Q + S), slope (S,) of shared numbers.

    Of the gloss and of d, which all photographs share.
    both (BY_S + S, N, STRIP) : after SU and SV the derivatives with these
    cross (h, w, 2, S) : mixed derivatives with the depth, or empty
    eliminated (Q + S, WIDE) : as in `accumulate_light`, but summed over photographs
    """
    parameters, count = derivatives.shape[0], derivatives.shape[1]
    for e in range(both.shape[0] - BY_S):
        at, along = parameters * count + e, 0.0
        for j in range(size):
            along += pixel[GRADIENT, j] * both[BY_S + e, i, j]
            eliminated[at, full + j] += pixel[MIXED, j] * both[BY_S + e, i, j]
        slope[e] += along
        for k in range(parameters):
            mixed = 0.0
            for j in range(size):
                mixed += pixel[INFORMATION, j] * derivatives[k, i, j] * both[BY_S + e, i, j]
            hessian[k * count + i, at] += mixed
        for f in range(e, both.shape[0] - BY_S):
            second = 0.0
            for j in range(size):
                second += pixel[INFORMATION, j] * both[BY_S + e, i, j] * both[BY_S + f, i, j]
            hessian[at, parameters * count + f] += second
        if cross.shape[0] > 0:
            for j in range(size):
                cross[row, here[j], 0, e] += pixel[BU, j] * both[BY_S + e, i, j]
                cross[row, here[j], 1, e] += pixel[BV, j] * both[BY_S + e, i, j]


@inlined
def accumulate_mixed(i, here, size, light_c, derivatives, pixel, cross):
    """Add to cross, a row of pixels, the mixed derivatives of photograph i's light and depth."""
    for j in range(size):
        both = cross[here[j]]
        for k in range(derivatives.shape[0]):
            both[0, i, light_c, k] += pixel[BU, j] * derivatives[k, i, j]
            both[1, i, light_c, k] += pixel[BV, j] * derivatives[k, i, j]


@inlined
def accumulate_channel(
    c, light_c, row, here, size, seen, slopes, value, w, own, pixel, hessian, slope, shared_slope,
    cross, shared_cross, eliminated, full,
):  # fmt: skip
    """Add all photographs' parts, in channel c, to the sums of `light_terms`."""
    for i in range(slopes.shape[1]):
        linearize_light(c, i, size, seen, value, w, own, pixel)
        accumulate_light(i, size, slopes, pixel, hessian, slope, eliminated, full)
        if cross.shape[0] > 0:
            accumulate_mixed(i, here, size, light_c, slopes, pixel, cross[row])
        if shared_slope.size > 0:
            accumulate_shared(
                i, row, here, size, seen, slopes, pixel, hessian, shared_slope, shared_cross,
                eliminated, full,
            )  # fmt: skip


@helper
def subtract_eliminated(full, eliminated, hessian):
    """Subtract the albedos' Schur complement, `full` columns of eliminated, from hessian."""
    columns = np.ascontiguousarray(eliminated[:, :full])
    hessian -= np.dot(columns, columns.T)


@kernel
def light_terms(*given):
    """Derivatives of half the energy with the lights, of matte pixels; as `light_terms_block`."""
    light_terms_block(None, *given)


@kernel
def light_terms_glossy(gloss, *given):
    """As `light_terms`, with highlights.  Apart, since most captures need not compile it."""
    light_terms_block(gloss, *given)


@helper
def light_terms_block(
    gloss, block, photos, table, active, gradient, points, camera, vectors, ambients, falloffs,
    scales, albedo, parameters, project, hessian, slope, cross, shared_slope, shared_cross,
):  # fmt: skip
    """Second and first derivatives of half the energy with the lights, of one block of rows.

    Each light has `parameters` numbers: its vector, [inverse distance, [beam,]] ambient light.  The
    lights of one of C channels, 1 or 3, have Q numbers, those of one kind side by side; second
    derivatives between channels are 0.  After these stand the S that all lights share: the E of the
    gloss, None on a matte surface, and the 3 of d, if they are free.  The albedo is eliminated when
    `project`.  hessian (blocks, C, Q + S, Q + S), its upper triangle, and slope (blocks, C,
    parameters, N), shared_slope (blocks, S) are sums per block of rows; cross (h, w, 2, N, C,
    parameters) and shared_cross (h, w, 2, S) are each pixel's mixed derivatives with the gradient
    of log depth, or (0, ...) for none.
    """
    channels, _, count = vectors.shape
    blocks, height, here = hessian.shape[0], active.shape[0], np.empty(STRIP, np.int64)
    frame, light = np.empty((FRAME, STRIP)), np.empty((LIGHT, STRIP))
    own, pixel = np.empty((OWN, STRIP)), np.empty((PIXEL, STRIP))
    by_light, value = np.empty((BY_LIGHT, STRIP)), np.empty((3, count, STRIP), np.float32)
    shared, lobes, each_number = shared_slope.shape[1], 0, (parameters, count, STRIP)
    if gloss is not None:
        lobes, shine = gloss.size, np.empty((LIGHT + gloss.size, STRIP))
        shone = np.empty((BY_S + lobes, count, STRIP))
        both = np.empty((BY_S + shared, count, STRIP))
        by_highlight, by_both = np.empty(each_number), np.empty(each_number)
    shaded = np.empty((BY_S + shared - lobes, count, STRIP))
    derivatives, w = np.empty(each_number), np.empty((count, STRIP))
    # A column for each pixel and channel; the product with the transpose is subtracted.
    eliminated, full = np.zeros((channels, hessian.shape[2], WIDE)), np.zeros(channels, np.int64)
    for row in range(block * height // blocks, (block + 1) * height // blocks):
        size, column = next_strip(active, row, 0, here)
        while size > 0:
            load_geometry(here, size, row, gradient, points, camera, False, frame)
            decode(here, size, row, photos, table, value)
            load_scales(here, size, row, scales, pixel)
            for light_c in range(channels):
                illuminate(
                    light_c, size, vectors, ambients, falloffs, frame, light, by_light, shaded,
                    derivatives,
                )  # fmt: skip
                first, last = (0, 3) if channels == 1 else (light_c, light_c + 1)
                seen, slopes, sums = shaded, derivatives, hessian[block, light_c]
                if gloss is not None:
                    seen, slopes = both, by_both
                    reflect(
                        light_c, first, last, size, vectors, falloffs, gloss, frame, shine,
                        by_light, value, shone, by_highlight,
                    )  # fmt: skip
                for c in range(first, last):
                    if full[light_c] + size > WIDE:
                        subtract_eliminated(full[light_c], eliminated[light_c], sums)
                        full[light_c] = 0
                    load_albedo(c, here, size, row, albedo, own)
                    if shared > 0:
                        eliminated[light_c, parameters * count :, full[light_c] :] = 0.0
                    if gloss is not None:
                        add_highlights(
                            own[ALBEDO], size, shaded, shone, derivatives, by_highlight, both,
                            by_both,
                        )  # fmt: skip
                    weigh(c, size, project, seen, value, w, own, pixel)
                    accumulate_channel(
                        c, light_c, row, here, size, seen, slopes, value, w, own, pixel,
                        sums, slope[block, light_c], shared_slope[block], cross, shared_cross,
                        eliminated[light_c], full[light_c],
                    )  # fmt: skip
                    full[light_c] += size if project else 0
            size, column = next_strip(active, row, column, here)
    for light_c in range(channels):
        subtract_eliminated(full[light_c], eliminated[light_c], hessian[block, light_c])


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
