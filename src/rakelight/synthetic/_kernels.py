# mypy: disable-error-code="no-untyped-def"
"""The loops over samples behind rendering.py and quantile.py, compiled on first use."""

from __future__ import annotations

import numpy as np

from rakelight.jit import helper


@helper
def facing(normals, toward, lit):
    """Fill lit (M,) with max(0, s . n); toward: s at every sample (M, 3), or one for all (1, 3)."""
    step = 1 if len(toward) > 1 else 0
    for m in range(len(normals)):
        s = toward[step * m]
        dot = normals[m, 0] * s[0] + normals[m, 1] * s[1] + normals[m, 2] * s[2]
        lit[m] = max(dot, 0.0)


@helper
def reflected(albedo, lit, highlight, glow, hit, samples):
    """Fill samples (., 3), at the places hit (M,), with rho (lit + glow) + highlight.

    albedo (M, 3); lit, highlight (1 or 3, M), or no highlight (0, M): of all channels, or each its
    own; glow: ambient light
    """
    shading, specular = np.zeros(1, albedo.dtype), np.zeros(1, albedo.dtype)  # rounded as albedo is
    for m in range(len(hit)):
        for c in range(3):
            shading[0] = lit[min(c, len(lit) - 1), m]
            if len(highlight):
                specular[0] = highlight[min(c, len(highlight) - 1), m]
            samples[hit[m], c] = albedo[m, c] * (np.float64(shading[0]) + glow) + specular[0]


@helper
def count_bits(bits, mask, upper, counts):
    """Add to counts (65536,) the upper halves of bits (h, W, 3) within the mask.

    With `upper` 0 or more: the lower halves of those with this upper half.
    """
    height, width, _ = bits.shape
    for v in range(height):
        for u in range(width):
            if mask[v, u]:
                for c in range(3):
                    high = bits[v, u, c] >> 16
                    if upper < 0:
                        counts[high] += 1
                    elif high == upper:
                        counts[bits[v, u, c] & 65535] += 1
