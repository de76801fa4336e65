# mypy: disable-error-code="no-untyped-def"
"""The loops of the solver.  Private: every array is checked by the callers.

A stencil is (5, h, w): centre, east, south, south-east, south-west, with a border of zeros one
pixel wide, so that no loop asks where the grid ends.  Pixels that are no unknowns have zeros in
all five.  Kernels do what their outer loop does from `first` up to `last`, most often rows of that
array; these parts are independent, and sums are kept per row: the result does not depend on the
number of threads.

Coarse point (i, j) sits on fine point (2i - 1, 2j - 1), borders counted.
"""

from __future__ import annotations

import numpy as np

from rakelight.jit import helper, kernel

# Sum of couplings, over the diagonal, below which there is no direction to interpolate from.
NO_COUPLING = np.float32(1e-6)
# Least pivot, over the diagonal, in single precision.
SMALLEST_PIVOT = np.float32(1e-6)
# Least pivot, over the diagonal of a coarse matrix, in double precision.
SMALLEST_COARSE = 1e-14
# Factor that exceeds the rounding error of single precision.
ROUND_UP = 1 + float(np.finfo(np.float32).eps)


# --- assembly ------------------------------------------------------------------------------


@kernel
def lowest(first, last, mask, values, rows):
    """rows (H) = the smallest of values (H, W, C) inside mask; NaN where one is not finite."""
    _, width, channels = values.shape
    for r in range(first, last):
        least = np.inf
        for c in range(width):
            if mask[r, c]:
                for k in range(channels):
                    value = values[r, c, k]
                    least = min(least, value) if np.isfinite(value) else np.nan
                    if np.isnan(least):
                        break
            if np.isnan(least):
                break
        rows[r] = least


@kernel
def assemble(first, last, phase, mask, tensor, vector, pairs, A, rhs):
    """Add the gradient energy of rows phase + 3 k to the stencil A and to rhs (with a border).

    `pairs` is (H, W, 4) or (0, 0, 4) for none.  A pixel writes to its own row and the two
    beside it, so every third row is done at once.
    """
    for k in range(first, last):
        r = phase + 3 * k
        for c in range(mask.shape[1]):
            if mask[r, c]:
                _assemble_pixel(r, c, mask, tensor, vector, pairs, A, rhs)


@helper
def _assemble_pixel(r, c, mask, tensor, vector, pairs, A, rhs):
    height, width = mask.shape
    east = c + 1 < width and mask[r, c + 1]
    west = c > 0 and mask[r, c - 1]
    south = r + 1 < height and mask[r + 1, c]
    north = r > 0 and mask[r - 1, c]
    count = (int(east) + int(west)) * (int(south) + int(north))
    if count == 0:
        return
    se = 1.0 / count if south and east else 0.0
    ne = 1.0 / count if north and east else 0.0
    sw = 1.0 / count if south and west else 0.0
    nw = 1.0 / count if north and west else 0.0
    if len(pairs) > 0:
        se *= pairs[r, c, 0]
        ne *= pairs[r, c, 1]
        sw *= pairs[r, c, 2]
        nw *= pairs[r, c, 3]
    muu, muv, mvv = tensor[r, c, 0], tensor[r, c, 1], tensor[r, c, 2]
    bu, bv = vector[r, c, 0], vector[r, c, 1]
    e, w, s, n = se + ne, sw + nw, se + sw, ne + nw
    r += 1  # from here on with the border
    c += 1
    A[0, r, c] += muu * (e + w) + mvv * (s + n) + 2 * muv * (se - ne - sw + nw)
    A[0, r, c + 1] += muu * e
    A[0, r, c - 1] += muu * w
    A[0, r + 1, c] += mvv * s
    A[0, r - 1, c] += mvv * n
    A[1, r, c] -= muu * e + muv * (se - ne)
    A[1, r, c - 1] -= muu * w + muv * (nw - sw)
    A[2, r, c] -= mvv * s + muv * (se - sw)
    A[2, r - 1, c] -= mvv * n + muv * (nw - ne)
    A[4, r, c + 1] += muv * se
    A[3, r - 1, c] -= muv * ne
    A[3, r, c - 1] -= muv * sw
    A[4, r - 1, c] += muv * nw
    rhs[r, c] -= bu * (e - w) + bv * (s - n)
    rhs[r, c + 1] += bu * e
    rhs[r, c - 1] -= bu * w
    rhs[r + 1, c] += bv * s
    rhs[r - 1, c] -= bv * n


@helper
def mark_connected(A, floor, reached, stack):
    """Spread `reached` over couplings larger than `floor` times the smaller diagonal.

    stack : (unknowns, 2) room for the reached points whose neighbours are still to be seen.
    """
    _, h, w = A.shape
    depth = 0
    for r in range(1, h - 1):
        for c in range(1, w - 1):
            if reached[r, c]:
                stack[depth, 0], stack[depth, 1] = r, c
                depth += 1
    while depth > 0:
        depth -= 1
        r, c = stack[depth, 0], stack[depth, 1]
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                i, j = r + dr, c + dc
                if reached[i, j] or A[0, i, j] == 0:
                    continue
                coupling = abs(_entry(A, r, c, dr, dc))
                if coupling > floor * min(A[0, r, c], A[0, i, j]):
                    reached[i, j] = True
                    stack[depth, 0], stack[depth, 1] = i, j
                    depth += 1


@helper
def _entry(A, r, c, dr, dc):
    """The matrix entry between (r, c) and (r + dr, c + dc)."""
    if dr < 0 or (dr == 0 and dc < 0):
        r, c, dr, dc = r + dr, c + dc, -dr, -dc
    if dr == 0:
        return A[dc, r, c]
    if dc == 0:
        return A[2, r, c]
    return A[3, r, c] if dc > 0 else A[4, r, c]


# --- conjugate gradients -------------------------------------------------------------------


@kernel
def apply(first, last, A, top, left, x, out):
    """out = A x; x and out are the window of A that begins at [top, left], border included."""
    w = x.shape[1]
    for r in range(first, last):
        k, right = top + r, left + w
        centre, east = A[0, k, left:right], A[1, k, left:right]
        south, north = A[2, k, left:right], A[2, k - 1, left:right]
        south_east, north_west = A[3, k, left:right], A[3, k - 1, left:right]
        south_west, north_east = A[4, k, left:right], A[4, k - 1, left:right]
        above, own, below = x[r - 1], x[r], x[r + 1]
        for c in range(1, w - 1):
            out[r, c] = (
                centre[c] * own[c]
                + (east[c] * own[c + 1] + east[c - 1] * own[c - 1])
                + (south[c] * below[c] + north[c] * above[c])
                + (south_east[c] * below[c + 1] + north_west[c - 1] * above[c - 1])
                + (south_west[c] * below[c - 1] + north_east[c + 1] * above[c + 1])
            )


@kernel
def dot(first, last, x, y, rows):
    """rows (h) = the sum of x * y over each row."""
    for r in range(first, last):
        total = 0.0
        for c in range(x.shape[1]):
            total += x[r, c] * y[r, c]
        rows[r] = total


@kernel
def step(first, last, alpha, direction, image, x, residual, rows):
    """x += alpha direction, residual -= alpha image; rows (h) = its new sum of squares by row."""
    for r in range(first, last):
        total = 0.0
        for c in range(x.shape[1]):
            x[r, c] += alpha * direction[r, c]
            left = residual[r, c] - alpha * image[r, c]
            residual[r, c] = left
            total += left * left
        rows[r] = total


@kernel
def update_direction(first, last, beta, z, direction):
    """direction = z + beta direction."""
    for r in range(first, last):
        for c in range(z.shape[1]):
            direction[r, c] = z[r, c] + beta * direction[r, c]


@kernel
def scaled(first, last, factor, x, out):
    """out = factor x, in the precision of out."""
    for r in range(first, last):
        for c in range(x.shape[1]):
            out[r, c] = factor * x[r, c]


@kernel
def second_differences(first, last, along_u, along_v, weight, top, left, x, out):
    """out = weight (x_uu + x_vv), each axis where its flag is set; a window as in `apply`."""
    w = x.shape[1]
    for r in range(first, last):
        for c in range(1, w - 1):
            i, j = top + r, left + c
            value = 0.0
            if along_u[i, j]:
                value += x[r, c + 1] - 2 * x[r, c] + x[r, c - 1]
            if along_v[i, j]:
                value += x[r + 1, c] - 2 * x[r, c] + x[r - 1, c]
            out[r, c] = weight[i, j] * value


@kernel
def second_differences_transposed(first, last, along_u, along_v, top, left, y, out):
    """out += the transpose of `second_differences` with weight 1, applied to y."""
    w = y.shape[1]
    for r in range(first, last):
        for c in range(1, w - 1):
            i, j = top + r, left + c
            value = -2.0 * y[r, c] * (int(along_u[i, j]) + int(along_v[i, j]))
            if along_u[i, j - 1]:
                value += y[r, c - 1]
            if along_u[i, j + 1]:
                value += y[r, c + 1]
            if along_v[i - 1, j]:
                value += y[r - 1, c]
            if along_v[i + 1, j]:
                value += y[r + 1, c]
            out[r, c] += value


# --- single precision ----------------------------------------------------------------------


@kernel
def rounded_up(first, last, A, out):
    """out = A in single precision and never below it: out - A is positive semidefinite.

    The couplings are rounded to the nearest; by as much as they move, both their ends gain.
    """
    w = A.shape[2]
    for r in range(first, last):
        for c in range(1, w - 1):
            if A[0, r, c] > 0:
                lost = _rounding(A[1, r, c - 1]) + _rounding(A[2, r - 1, c])
                lost += _rounding(A[3, r - 1, c - 1]) + _rounding(A[4, r - 1, c + 1])
                for k in range(1, 5):
                    out[k, r, c] = A[k, r, c]
                    lost += _rounding(A[k, r, c])
                out[0, r, c] = ROUND_UP * (A[0, r, c] + lost)


@helper
def _rounding(value):
    return abs(value - np.float32(value))


# --- relaxation by lines -------------------------------------------------------------------


@kernel
def factor_rows(first, last, A, pivots):
    """pivots (h, w) = reciprocal pivots of the tridiagonal matrix of every row."""
    for r in range(first, last):
        for c in range(1, A.shape[2] - 1):
            if A[0, r, c] > 0:
                pivots[r, c] = _pivot(A[0, r, c], A[1, r, c - 1], pivots[r, c - 1])


@kernel
def factor_columns(first, last, A, pivots):
    """pivots (h, w) = reciprocal pivots of the tridiagonal matrix of columns first to last."""
    for r in range(1, A.shape[1] - 1):
        for c in range(first, last):
            if A[0, r, c] > 0:
                pivots[r, c] = _pivot(A[0, r, c], A[2, r - 1, c], pivots[r - 1, c])


@helper
def _pivot(diagonal, side, before):
    """1 / (diagonal - side² before), positive whatever the rounding."""
    return 1 / max(diagonal - side * side * before, SMALLEST_PIVOT * diagonal)


@kernel
def relax_rows(first, last, A, pivots, b, x, parity, alone):
    """Solve rows 1 + parity + 2 k exactly for their own unknowns.

    `alone`: the other rows count as zero and are not read.
    """
    w = A.shape[2]
    for k in range(first, last):
        r = 1 + parity + 2 * k
        own = x[r]
        line = b[r].copy()
        if not alone:
            above, below = x[r - 1], x[r + 1]
            south, north = A[2, r], A[2, r - 1]
            south_east, north_west = A[3, r], A[3, r - 1]
            south_west, north_east = A[4, r], A[4, r - 1]
            for c in range(1, w - 1):
                line[c] -= (
                    (south[c] * below[c] + north[c] * above[c])
                    + (south_east[c] * below[c + 1] + north_west[c - 1] * above[c - 1])
                    + (south_west[c] * below[c - 1] + north_east[c + 1] * above[c + 1])
                )
        pivot = pivots[r]
        ratio = A[1, r] * pivot
        before = line[0]
        for c in range(1, w - 1):
            before = line[c] - ratio[c - 1] * before
            own[c] = before * pivot[c]
        before = own[w - 1]
        for c in range(w - 2, 0, -1):
            before = own[c] - ratio[c] * before
            own[c] = before


@kernel
def relax_columns(first, last, A, pivots, b, x, parity):
    """Solve columns 1 + parity, 3 + parity, ... exactly, those from first up to last.

    Row by row all these columns are computed and every other one is kept: contiguous arithmetic
    is faster than half of it with gaps.
    """
    h = A.shape[1]
    n = last - first
    left, right = first - 1, first + n + 1
    lines = np.empty((h, n), x.dtype)
    lines[0] = 0
    for r in range(1, h - 1):
        y, y_above = lines[r], lines[r - 1]
        above, own, below = x[r - 1, left:right], x[r, left:right], x[r + 1, left:right]
        east, north = A[1, r, left:right], A[2, r - 1, left:right]
        south_east, north_west = A[3, r, left:right], A[3, r - 1, left:right]
        south_west, north_east = A[4, r, left:right], A[4, r - 1, left:right]
        pivot, rhs = pivots[r - 1, left:right], b[r, left:right]
        # Short loops: the compiler vectorises them only while few arrays may overlap.
        for c in range(n):
            y[c] = rhs[c + 1] - (east[c + 1] * own[c + 2] + east[c] * own[c])
        for c in range(n):
            y[c] -= south_east[c + 1] * below[c + 2] + north_west[c] * above[c]
        for c in range(n):
            y[c] -= south_west[c + 1] * below[c] + north_east[c + 2] * above[c + 2]
        for c in range(n):
            y[c] -= north[c + 1] * pivot[c + 1] * y_above[c]
    after = np.zeros(n, x.dtype)
    start = (first + 1 + parity) % 2
    for r in range(h - 2, 0, -1):
        y, own = lines[r], x[r, first : first + n]
        south, pivot = A[2, r, first : first + n], pivots[r, first : first + n]
        for c in range(n):
            after[c] = pivot[c] * (y[c] - south[c] * after[c])
        for c in range(start, n, 2):
            own[c] = after[c]


# --- between the levels --------------------------------------------------------------------


@kernel
def interpolation(first, last, A, P):
    """Weights of the coarse points for the fine points beside and between two, after Dendy (1982).

    P : (h, w, 4) fine (r, c) from its own coarse point, the one to the east, south, south-east.
    Between two coarse points the stencil is summed across the line that joins them; for points
    amid four see `interpolation_amid_four`.  The weights add up to 1 and stay of that size; where
    nothing couples a point to them it takes the value of its own coarse point.
    """
    w = A.shape[2]
    for r in range(first, last):
        for c in range(1, w - 1):
            if A[0, r, c] == 0:
                continue
            P[r, c, 0] = 1
            if r % 2 == 1 and c % 2 == 0:
                west = A[1, r, c - 1] + A[3, r - 1, c - 1] + A[4, r, c]
                east = A[1, r, c] + A[3, r, c] + A[4, r - 1, c + 1]
                _share(P[r, c], 1, A[0, r, c], west, A[0, r, c - 1], east, A[0, r, c + 1])
            if r % 2 == 0 and c % 2 == 1:
                north = A[2, r - 1, c] + A[3, r - 1, c - 1] + A[4, r - 1, c + 1]
                south = A[2, r, c] + A[3, r, c] + A[4, r, c]
                _share(P[r, c], 2, A[0, r, c], north, A[0, r - 1, c], south, A[0, r + 1, c])


@kernel
def interpolation_amid_four(first, last, A, P):
    """The weights in rows 2 k + 2 of points amid four coarse ones: their own equation is solved."""
    for k in range(first, last):
        r = 2 * k + 2
        for c in range(2, A.shape[2] - 1, 2):
            if A[0, r, c] > 0:
                _amid_four(A, r, c, P)


@helper
def _share(weights, second, diagonal, near, near_exists, far, far_exists):
    """weights[0] and weights[second] in proportion to the (negative) couplings."""
    a = max(-near, 0) if near_exists > 0 else 0
    b = max(-far, 0) if far_exists > 0 else 0
    if a + b > NO_COUPLING * diagonal:
        weights[0] = a / (a + b)
        weights[second] = b / (a + b)


@helper
def _amid_four(A, r, c, P):
    north, south, west, east = A[2, r - 1, c], A[2, r, c], A[1, r, c - 1], A[1, r, c]
    nw = -A[3, r - 1, c - 1] - north * P[r - 1, c, 0] - west * P[r, c - 1, 0]
    ne = -A[4, r - 1, c + 1] - north * P[r - 1, c, 1] - east * P[r, c + 1, 0]
    sw = -A[4, r, c] - south * P[r + 1, c, 0] - west * P[r, c - 1, 2]
    se = -A[3, r, c] - south * P[r + 1, c, 1] - east * P[r, c + 1, 2]
    total = nw + ne + sw + se
    if min(nw, ne, sw, se) < -total:
        # Couplings of both signs that nearly cancel: their ratios would be large without bound.
        nw, ne, sw, se = max(nw, 0), max(ne, 0), max(sw, 0), max(se, 0)
        total = nw + ne + sw + se
    if total > NO_COUPLING * A[0, r, c]:
        P[r, c, 0], P[r, c, 1] = nw / total, ne / total
        P[r, c, 2], P[r, c, 3] = sw / total, se / total


@kernel
def galerkin(first, last, A, P, coarse):
    """coarse = Pᵀ A P; it is a 9-point stencil again."""
    _, h, w = A.shape
    coarse_w = coarse.shape[2]
    for i in range(first, last):
        image = np.empty((5, 5))  # A times the basis function of (i, j), around (2i-1, 2j-1)
        for j in range(1, coarse_w - 1):
            image[:] = 0
            trace = 0.0
            for dr in range(-1, 2):
                for dc in range(-1, 2):
                    r, c = 2 * i - 1 + dr, 2 * j - 1 + dc
                    if 0 < r < h - 1 and 0 < c < w - 1:
                        p = P[r, c, (2 if dr < 0 else 0) + (1 if dc < 0 else 0)]
                        if p != 0:
                            _spread(A, r, c, p, image[dr + 1 : dr + 4, dc + 1 : dc + 4])
                            trace += p * p * A[0, r, c]
            _collect(image, P, i, j, coarse)
            coarse[0, i, j] = max(coarse[0, i, j], SMALLEST_COARSE * trace)


@helper
def _spread(A, r, c, p, image):
    """image (3, 3) += p times row (r, c) of A."""
    image[1, 1] += p * A[0, r, c]
    image[1, 2] += p * A[1, r, c]
    image[1, 0] += p * A[1, r, c - 1]
    image[2, 1] += p * A[2, r, c]
    image[0, 1] += p * A[2, r - 1, c]
    image[2, 2] += p * A[3, r, c]
    image[0, 0] += p * A[3, r - 1, c - 1]
    image[2, 0] += p * A[4, r, c]
    image[0, 2] += p * A[4, r - 1, c + 1]


@helper
def _collect(image, P, i, j, coarse):
    """Pᵀ image: coupling of (i, j) with itself and its neighbours to the east and south."""
    h, w, _ = P.shape
    centre = east = south = south_east = south_west = 0.0
    for a in range(5):
        for b in range(5):
            r, c, value = 2 * i - 3 + a, 2 * j - 3 + b, image[a, b]
            if value == 0 or not (0 < r < h - 1 and 0 < c < w - 1):
                continue
            di, dj = a // 2 - 1, b // 2 - 1  # the point's own coarse point
            for k in range(4):
                to_row, to_column, term = di + k // 2, dj + k % 2, value * P[r, c, k]
                if to_row == 0:
                    if to_column == 0:
                        centre += term
                    elif to_column == 1:
                        east += term
                elif to_row == 1:
                    if to_column == 0:
                        south += term
                    elif to_column == 1:
                        south_east += term
                    elif to_column == -1:
                        south_west += term
    coarse[0, i, j], coarse[1, i, j], coarse[2, i, j] = centre, east, south
    coarse[3, i, j], coarse[4, i, j] = south_east, south_west


@kernel
def restrict(first, last, A, b, x, north, south, coarse):
    """coarse = Pᵀ (b - A x), right after the even columns were relaxed: there it is zero.

    So only odd columns count (borders counted; parity 0), where a row between two coarse
    rows goes by `north` and `south` (h_coarse, w_coarse) to the one above and below.
    """
    _, h, w = A.shape
    coarse_w = coarse.shape[1]
    for i in range(first, last):
        line = np.empty((3, w), x.dtype)
        line[:] = 0
        for k in range(3):
            r = 2 * i - 2 + k
            if 0 < r < h - 1:
                _residual(A, b, x, r, line[k])
        for j in range(1, coarse_w - 1):
            c = 2 * j - 1
            coarse[i, j] = line[1, c] + south[i - 1, j] * line[0, c] + north[i, j] * line[2, c]


@helper
def _residual(A, b, x, r, out):
    w = len(out)
    centre, east = A[0, r], A[1, r]
    south, north = A[2, r], A[2, r - 1]
    south_east, north_west = A[3, r], A[3, r - 1]
    south_west, north_east = A[4, r], A[4, r - 1]
    above, own, below, rhs = x[r - 1], x[r], x[r + 1], b[r]
    for c in range(1, w - 1):
        out[c] = (
            (rhs[c] - centre[c] * own[c])
            - (east[c] * own[c + 1] + east[c - 1] * own[c - 1])
            - (south[c] * below[c] + north[c] * above[c])
            - (south_east[c] * below[c + 1] + north_west[c - 1] * above[c - 1])
            - (south_west[c] * below[c - 1] + north_east[c + 1] * above[c + 1])
        )


@kernel
def prolong(first, last, north, south, coarse, x):
    """x += P coarse on the odd columns; the even ones are relaxed next and need no start."""
    h = len(x)
    coarse_w = coarse.shape[1]
    for i in range(first, last):
        upper, lower = coarse[i], coarse[i + 1]
        own = x[2 * i - 1]
        for j in range(1, coarse_w - 1):
            own[2 * j - 1] += upper[j]
        if 2 * i < h - 1:
            between = x[2 * i]
            for j in range(1, coarse_w - 1):
                between[2 * j - 1] += north[i, j] * upper[j] + south[i, j] * lower[j]


# --- factors -------------------------------------------------------------------------------


@helper
def solve_lower(starts, rows, entries, columns):
    """Replace columns (P, K) by L^-1 columns; L has a diagonal of ones and is sparse by columns."""
    for j in range(len(columns)):
        solved = columns[j]
        for entry in range(starts[j], starts[j + 1]):
            if rows[entry] > j:
                below, factor = columns[rows[entry]], entries[entry]
                for k in range(solved.size):
                    below[k] -= factor * solved[k]
