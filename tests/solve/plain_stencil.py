"""The assembly in plain numpy: what the compiled loops are tested against."""

from __future__ import annotations

import numpy as np

from rakelight.model import Array, Floats, Mask
from rakelight.solve.sparse import DIRECTIONS

# The one-sided differences (u, v) whose mean is the gradient energy of a pixel.
PAIRS = ((1, 1), (1, -1), (-1, 1), (-1, -1))


def neighbour(padded: Array, rows: int, columns: int) -> Array:
    """The view of a 1-padded array whose [r, c] is the neighbour (r + rows, c + columns).

    >>> neighbour(np.pad([[1, 2], [3, 4]], 1), 0, 1)
    array([[2, 0],
           [4, 0]])
    """
    height, width = padded.shape
    return padded[1 + rows : height - 1 + rows, 1 + columns : width - 1 + columns]


def gradient_stencil(
    mask: Mask, tensor: Floats, vector: Floats, pair_weights: Floats | None = None
) -> tuple[Floats, Floats]:
    """Stencil (5, H+2, W+2) and right side (H+2, W+2) of the gradient energy; see `assemble`."""
    muu, muv, mvv = np.moveaxis(np.where(mask[..., None], tensor, 0.0), -1, 0)
    bu, bv = np.moveaxis(np.where(mask[..., None], vector, 0.0), -1, 0)
    centre, east, south, south_east, south_west, rhs = np.zeros((6, *np.add(mask.shape, 2)))
    for share, (su, sv) in zip(pair_shares(mask, pair_weights), PAIRS, strict=True):
        uu, cross, vv = share * muu, share * muv * su * sv, share * mvv
        # The squares: of the pixel itself, of its u-neighbour, of its v-neighbour.
        neighbour(centre, 0, 0)[...] += uu + 2 * cross + vv
        neighbour(centre, 0, su)[...] += uu
        neighbour(centre, sv, 0)[...] += vv
        # An edge is kept at its upper end, a level one at its left end.
        neighbour(east, 0, min(su, 0))[...] -= uu + cross
        neighbour(south, min(sv, 0), 0)[...] -= vv + cross
        diagonal = south_west if su == sv else south_east
        neighbour(diagonal, *((0, su) if sv > 0 else (-1, 0)))[...] += cross
        neighbour(rhs, 0, 0)[...] -= share * (su * bu + sv * bv)
        neighbour(rhs, 0, su)[...] += share * su * bu
        neighbour(rhs, sv, 0)[...] += share * sv * bv
    return np.stack([centre, east, south, south_east, south_west]), rhs


def pair_shares(mask: Mask, pair_weights: Floats | None = None) -> list[Floats]:
    """(H, W) for each pair: one over the number that exist here, times its weight."""
    padded = np.pad(mask, 1)
    exists = [mask & neighbour(padded, 0, su) & neighbour(padded, sv, 0) for su, sv in PAIRS]
    count = np.maximum(np.sum(exists, axis=0), 1)
    weights = np.ones((*mask.shape, 4)) if pair_weights is None else pair_weights
    return [np.where(there, weights[..., k], 0.0) / count for k, there in enumerate(exists)]


def reached(stencil: Floats, anchors: Mask, negligible: float) -> Mask:
    """(H+2, W+2) unknowns that couple, over any number of steps, to an anchor.

    A coupling counts above `negligible` times the smaller of the two diagonals.
    """
    from scipy import sparse
    from scipy.sparse.csgraph import connected_components

    centre, others = stencil[0], stencil[1:]
    number = np.arange(centre.size).reshape(centre.shape)
    rows, columns = [], []
    for entries, (down, right) in zip(others, DIRECTIONS, strict=True):
        r, c = np.nonzero(entries)
        floor = negligible * np.minimum(centre[r, c], centre[r + down, c + right])
        joined = np.abs(entries[r, c]) > floor
        rows.append(number[r, c][joined])
        columns.append(number[r + down, c + right][joined])
    i, j = np.concatenate(rows), np.concatenate(columns)
    graph = sparse.coo_array((np.ones(len(i), bool), (i, j)), shape=(centre.size, centre.size))
    component = connected_components(graph, directed=False)[1].reshape(centre.shape)
    return np.isin(component, component[anchors])
