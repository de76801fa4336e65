"""Images that are smooth but for edges: the albedo step of the methods for one photograph.

    minimise  sum_p d (a - t)^2  +  strength sum_links w (a_p - a_q)^2

over the links between neighbouring pixels p, q: one symmetric 5-point system.
"""

from __future__ import annotations

import numpy as np

from rakelight.geometry.grid import Links, pair_slices
from rakelight.model import Floats, Mask
from rakelight.solve import DepthSystem, build_hierarchy, solve

EdgeWeights = tuple[Floats, Floats]

WEAKEST = 1e-3


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
        # Less is no link: the solver's coarse levels, in single precision, would suffer.
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
    """The image that is near `target` and smooth where `edges` are not, (h, w) or (h, w, C).

    data_weight : d >= 0, as `target`; 0 where the target says nothing
    strength : lambda of the smoothness, relative to d

    Raises InputError where the solver does not find it.

    >>> mask, edges = np.ones((1, 3), bool), (np.array([[1.0, 0.0, 0.0]]), np.zeros((1, 3)))
    >>> target = np.array([[0.0, 1.0, 5.0]])
    >>> piecewise_smooth(target, np.ones((1, 3)), edges, 1e3, mask).round(2).tolist()
    [[0.5, 0.5, 5.0]]
    """
    if target.ndim == 2:
        return piecewise_smooth(
            target[..., None], data_weight[..., None], edges, strength, mask,
            tolerance=tolerance,
        )[..., 0]  # fmt: skip
    links = _links(edges, strength)
    systems = [
        _system(target[..., c], data_weight[..., c], links, mask) for c in range(target.shape[2])
    ]
    # The channels have the links in common, and about the same data: one hierarchy does for all.
    hierarchy = None
    if len(systems) > 1:
        hierarchy = build_hierarchy(_system(target[..., 0], data_weight.mean(axis=-1), links, mask))
    smooth = [solve(each, tolerance=tolerance, hierarchy=hierarchy) for each in systems]
    return np.stack([each.required("the smooth image between edges") for each in smooth], axis=-1)


def _links(edges: EdgeWeights, strength: float) -> Floats:
    """The stencil (5, h+2, w+2) of the links alone."""
    height, width = edges[0].shape
    stencil = np.zeros((5, height + 2, width + 2))
    centre = stencil[0, 1:-1, 1:-1]
    for axis, entry, edge in ((1, 1, edges[0]), (0, 2, edges[1])):
        weight = strength * edge
        here, there = pair_slices(axis)
        stencil[entry, 1:-1, 1:-1] = -weight
        centre[here] += weight[here]
        centre[there] += weight[here]
    return stencil


def _system(target: Floats, data_weight: Floats, links: Floats, mask: Mask) -> DepthSystem:
    """The normal equations of one channel."""
    weight = np.where(mask, data_weight, 0.0)
    stencil = links.copy()
    centre = stencil[0, 1:-1, 1:-1]
    centre += weight
    # What nothing determines stays at its target, and so do areas that no data reaches; a trace
    # of a millionth is what the single precision of the solver's coarse levels still sees.
    lonely = mask & (centre <= 0)
    trace = 1e-6 * float(centre[mask].mean())
    damping = np.where(lonely, 1.0, np.where(mask & (weight < trace), trace, 0.0))
    centre += damping
    target = np.where(mask, target, 0.0)
    return DepthSystem(stencil, (weight + damping) * target, target, mask, lonely)
