"""Images that are smooth but for edges: the albedo step of the methods for one photograph.

    minimise  sum_p d (a - t)^2  +  strength sum_links w (a_p - a_q)^2

over the links between neighbouring pixels p, q: one symmetric 5-point system.
"""

from __future__ import annotations

import numpy as np

from rakelight.geometry.grid import Links, pair_slices
from rakelight.model import Floats, Mask
from rakelight.solve import DepthSystem, solve

EdgeWeights = tuple[Floats, Floats]

WEAKEST = 1e-6


def edge_weights(
    color: Floats, depth_m: Floats, mask: Mask, *, sigma_c: float, sigma_d: float,
    tau: float = np.inf,
) -> EdgeWeights:  # fmt: skip
    """How alike two neighbours are, 0..1: of each pixel and its right, its lower one, (h, w) each.

    color : (h, w, C) linear light; depth_m : (h, w) metres
    sigma_c : of a colour difference (root sum of squares over channels), linear light
    sigma_d : of a depth difference, metres
    tau : a larger colour difference separates altogether (Or-El et al. 2015)

    >>> color = np.array([[[0.2], [0.2], [0.9]]])
    >>> right, _ = edge_weights(color, np.ones((1, 3)), np.ones((1, 3), bool),
    ...                         sigma_c=0.1, sigma_d=1.0, tau=0.5)
    >>> right.tolist()
    [[1.0, 0.0, 0.0]]
    """
    links, weights = Links.of(mask), []
    for axis, linked in ((1, links.right), (0, links.down)):
        here, there = pair_slices(axis)
        apart = np.sqrt(((color[there] - color[here]) ** 2).sum(axis=-1))
        deep = depth_m[there] - depth_m[here]
        alike = np.exp(-((apart / sigma_c) ** 2 + (deep / sigma_d) ** 2) / 2)
        weight = np.zeros(mask.shape)
        # Less is no link: the solver's coarse levels have single precision.
        close = linked[here] & (apart <= tau) & (alike > WEAKEST)
        weight[here] = np.where(close, alike, 0.0)
        weights.append(weight)
    return weights[0], weights[1]


def piecewise_smooth(
    target: Floats,
    data_weight: Floats,
    edges: EdgeWeights,
    strength: float,
    mask: Mask,
    *,
    tolerance: float = 1e-4,
) -> Floats:
    """The image (h, w) that is near `target` (h, w) and smooth where `edges` are not.

    data_weight : (h, w) d >= 0, 0 where the target says nothing
    strength : lambda of the smoothness, relative to d

    >>> mask, edges = np.ones((1, 3), bool), (np.array([[1.0, 0.0, 0.0]]), np.zeros((1, 3)))
    >>> target = np.array([[0.0, 1.0, 5.0]])
    >>> piecewise_smooth(target, np.ones((1, 3)), edges, 1e3, mask).round(2).tolist()
    [[0.5, 0.5, 5.0]]
    """
    height, width = mask.shape
    weight = np.where(mask, data_weight, 0.0)
    stencil = np.zeros((5, height + 2, width + 2))
    centre = stencil[0, 1:-1, 1:-1]
    centre += weight
    for axis, entry, edge in ((1, 1, edges[0]), (0, 2, edges[1])):
        pull = strength * edge
        here, there = pair_slices(axis)
        stencil[entry, 1:-1, 1:-1] = -pull
        centre[here] += pull[here]
        centre[there] += pull[here]
    # What nothing determines stays at its target, and so do areas that no data reaches; a trace
    # of a millionth is what the single precision of the solver's coarse levels still sees.
    lonely = mask & (centre <= 0)
    trace = 1e-6 * float(centre[mask].mean())
    hold = np.where(lonely, 1.0, np.where(mask & (weight < trace), trace, 0.0))
    centre += hold
    rhs = np.where(mask, (weight + hold) * target, 0.0)
    system = DepthSystem(stencil, rhs, np.where(mask, target, 0.0), mask, lonely)
    return solve(system, tolerance=tolerance).value
