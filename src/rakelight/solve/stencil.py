"""From gradient tensors on a masked pixel grid to one symmetric positive definite system.

The unknown p lives on the pixels of the mask and minimises

    E(p) = sum_pixels mean_k [(D_k p)ᵀ M (D_k p) - 2 bᵀ D_k p] + sum w (p - t)²
           + sum lambda (L p - l)² + pᵀ X p - 2 xᵀ p             (this line is optional)

D_k p = (p_u, p_v), k = 0..3: the one-sided differences (+u,+v), (+u,-v), (-u,+v), (-u,-v).
Their mean has no checkerboard in its null space and no half-pixel shift.  At the border the mean
runs over the pairs that exist; a pixel without any u-neighbour or without any v-neighbour has no
gradient, so its photometry says nothing and it keeps its data term alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from rakelight.errors import InputError
from rakelight.jit import in_parts
from rakelight.model import Floats, Mask

if TYPE_CHECKING:
    from scipy.sparse import csr_array

# Weight, over its diagonal, that draws an unknown without data to its target.
PIN = 1e-6
# Weight, over its diagonal, that draws each unknown of an extra term to its target: the term may
# see sums of unknowns only, in which two components can move against each other.
TRACE = 1e-6
# Coupling or data weight, over the diagonal, below which it is no connection.
NEGLIGIBLE = 1e-8


class SymmetricOperator(Protocol):
    """A further symmetric positive semidefinite term of the matrix, of any radius."""

    def apply(self, x: Floats) -> Floats:
        """X x, (H, W), for x of shape (H, W); it neither reads nor writes outside the mask."""

    def diagonal(self) -> Floats:
        """(H, W) what the preconditioner sees of X: its diagonal or, better, its row sums."""


@dataclass(frozen=True, slots=True)
class Laplacian:
    """The term lambda (L p)²: second differences along u and along v, each where it exists.

    weight : (H+2, W+2) lambda, 0 outside the mask
    along_u, along_v : (H+2, W+2) bool, whether a pixel has both neighbours along that axis
    """

    weight: Floats
    along_u: Mask
    along_v: Mask

    @classmethod
    def on(cls, mask: Mask, weight: Floats) -> Laplacian:
        """The term on the pixels of mask (H, W) with weight (H, W)."""
        inside = np.pad(mask, 1)
        along_u, along_v = inside.copy(), inside.copy()
        along_u[:, 1:-1] &= inside[:, 2:] & inside[:, :-2]
        along_v[1:-1] &= inside[2:] & inside[:-2]
        return cls(np.pad(np.where(mask, weight, 0.0), 1), along_u, along_v)

    def add(self, x: Floats, out: Floats, top: int = 0, left: int = 0) -> None:
        """out += Lᵀ lambda L x in the window (border included) that begins at [top, left]."""
        from rakelight.solve import _kernels

        y, where = np.zeros_like(x), (self.along_u, self.along_v)
        rows = (1, len(x) - 1, x.size)
        in_parts(_kernels.second_differences, *rows, *where, self.weight, top, left, x, y)
        in_parts(_kernels.second_differences_transposed, *rows, *where, top, left, y, out)

    def of(self, image: Floats) -> Floats:
        """lambda L p, (H, W), of an image p (H, W)."""
        from rakelight.solve import _kernels

        x = np.pad(image, 1)
        y, where = np.zeros_like(x), (self.along_u, self.along_v)
        _kernels.second_differences(1, len(x) - 1, *where, self.weight, 0, 0, x, y)
        return y[1:-1, 1:-1]

    def right_side(self, target: Floats) -> Floats:
        """Lᵀ lambda l, (H, W), for the target l (H, W)."""
        from rakelight.solve import _kernels

        out = np.zeros_like(self.weight)
        y = self.weight * np.pad(target, 1)
        _kernels.second_differences_transposed(
            1, len(y) - 1, self.along_u, self.along_v, 0, 0, y, out
        )
        return out[1:-1, 1:-1]


@dataclass(frozen=True)
class DepthSystem:
    """A symmetric 9-point stencil on a masked pixel grid, its right side, and wider terms.

    stencil : (5, H+2, W+2) float64 with a border of zeros: the entries that couple a pixel with
        itself, (row, col+1), (row+1, col), (row+1, col+1) and (row+1, col-1); 0 outside the mask
    rhs : (H, W) float64, 0 outside the mask
    target : (H, W) float64, the data target, also where a solution is not defined
    mask : (H, W) bool, the unknowns
    pinned : (H, W) bool, unknowns that no data weight reaches: held at the target, by a trace
        (`PIN` of the diagonal) where they have gradients, firmly where they have none
    laplacian, extra : terms of a larger radius, applied exactly
    """

    stencil: Floats
    rhs: Floats
    target: Floats
    mask: Mask
    pinned: Mask
    laplacian: Laplacian | None = None
    extra: SymmetricOperator | None = None

    @property
    def unknowns(self) -> int:
        """Number of mask pixels."""
        return int(np.count_nonzero(self.mask))

    @property
    def centre(self) -> Floats:
        """(H, W) the diagonal."""
        return self.stencil[0, 1:-1, 1:-1]

    def apply(self, x: Floats) -> Floats:
        """A x, (H, W) float64, zero outside the mask, where x is not read."""
        padded = np.pad(np.where(self.mask, x, 0.0), 1)
        out = np.zeros_like(padded)
        self.apply_window(padded, out)
        return out[1:-1, 1:-1]

    def apply_window(self, x: Floats, out: Floats, top: int = 0, left: int = 0) -> None:
        """out = A x in the window that begins at [top, left] of the grid with its border.

        x, out : (h+2, w+2) float64, zero on their border and outside the mask; the window
        contains the whole mask.
        """
        from rakelight.solve import _kernels

        in_parts(_kernels.apply, 1, len(x) - 1, x.size, self.stencil, top, left, x, out)
        if self.laplacian is not None:
            self.laplacian.add(x, out, top, left)
        if self.extra is not None:
            rows, columns = (slice(k, k + n - 2) for k, n in zip((top, left), x.shape, strict=True))
            full = np.zeros(self.mask.shape)
            full[rows, columns] = x[1:-1, 1:-1]
            term = np.where(self.mask, self.extra.apply(full), 0.0)
            out[1:-1, 1:-1] += term[rows, columns]

    def to_sparse(self) -> csr_array[Any]:
        """A over the mask pixels, row by row.

        Raises InputError where there are wider terms, which are not in the stencil.
        """
        from rakelight.solve.sparse import stencil_matrix

        if self.laplacian is not None or self.extra is not None:
            raise InputError("only a system without wider terms has an explicit matrix")
        return stencil_matrix(self.stencil, np.pad(self.mask, 1))


def assemble(
    mask: Mask,
    tensor: Floats,
    vector: Floats,
    data_weight: Floats,
    data_target: Floats,
    pair_weights: Floats | None = None,
    laplacian_weight: float | Floats | None = None,
    *,
    laplacian_target: Floats | None = None,
    extra: SymmetricOperator | None = None,
    extra_rhs: Floats | None = None,
) -> DepthSystem:
    """The normal equations A p = rhs of the energy E(p) at the top of this file.

    mask : (H, W) bool
    tensor : (H, W, 3) M as muu, muv, mvv, symmetric positive semidefinite
    vector : (H, W, 2) b
    data_weight, data_target : (H, W) w >= 0 and t
    pair_weights : (H, W, 4) >= 0, a factor per difference pair (+u,+v), (+u,-v), (-u,+v),
        (-u,-v), on top of the mean over the pairs that exist
    laplacian_weight, laplacian_target : lambda >= 0, a number or (H, W), and l, (H, W)
    extra, extra_rhs : X and x, (H, W)

    Values outside the mask are ignored.  An unknown that no data weight reaches, or that has
    neither weight nor gradient of its own, is held at its target and marked in
    `DepthSystem.pinned`, so the matrix is never singular.

    Raises InputError for shapes that do not fit, for values inside the mask that are not finite,
    for negative weights, for tensors that are not positive semidefinite.

    A plane is found again from its own gradients:

    >>> row, column = np.mgrid[:4, :5]
    >>> plane = 0.5 * column - 0.25 * row + 1
    >>> mask = np.ones((4, 5), bool)
    >>> identity = np.broadcast_to([1.0, 0.0, 1.0], (4, 5, 3))
    >>> gradient = np.broadcast_to([0.5, -0.25], (4, 5, 2))
    >>> weight = np.zeros((4, 5))
    >>> weight[0, 0] = 1
    >>> system = assemble(mask, identity, gradient, weight, plane)
    >>> bool(np.allclose(system.apply(plane), system.rhs))
    True
    """
    mask = _checked_mask(mask)
    tensor = _checked("tensor", tensor, mask, 3)
    vector = _checked("vector", vector, mask, 2)
    weight = _checked("data_weight", data_weight, mask, lowest=0.0)
    target = _checked("data_target", data_target, mask)
    pairs: Floats = np.zeros((0, 0, 4))
    if pair_weights is not None:
        pairs = _checked("pair_weights", pair_weights, mask, 4, lowest=0.0)
    _check_semidefinite(tensor, mask)

    stencil, padded_rhs = _gradient_stencil(mask, tensor, vector, pairs)
    rhs, centre = padded_rhs[1:-1, 1:-1], stencil[0, 1:-1, 1:-1]
    weight = np.where(mask, weight, 0.0)
    anchor = weight
    if extra is not None:
        shared = np.where(mask & (centre > 0), extra.diagonal(), 0.0)
        weight = weight + TRACE * shared
        anchor = weight + shared
    pinned = mask & ~_reached(stencil, anchor > NEGLIGIBLE * centre)
    if pinned.any():
        weight += np.where(pinned, _pin_weight(centre, weight), 0.0)
    centre += weight
    rhs += weight * np.where(mask, target, 0.0)

    laplacian = None
    if laplacian_weight is not None:
        wide = np.broadcast_to(laplacian_weight, mask.shape)
        strength = _checked("laplacian_weight", wide, mask, lowest=0.0)
        laplacian = Laplacian.on(mask, strength)
        if laplacian_target is not None:
            wanted = _checked("laplacian_target", laplacian_target, mask)
            rhs += laplacian.right_side(np.where(mask, wanted, 0.0))
    if extra_rhs is not None:
        rhs += np.where(mask, _checked("extra_rhs", extra_rhs, mask), 0.0)
    return DepthSystem(stencil, rhs, target, mask, pinned, laplacian, extra)


def _gradient_stencil(
    mask: Mask, tensor: Floats, vector: Floats, pairs: Floats
) -> tuple[Floats, Floats]:
    """Stencil (5, H+2, W+2) and right side (H+2, W+2) of the gradient energy."""
    from rakelight.solve import _kernels

    height, width = mask.shape
    stencil = np.zeros((5, height + 2, width + 2))
    rhs = np.zeros((height + 2, width + 2))
    for phase in range(3):
        rows = (height - phase + 2) // 3
        given = (phase, mask, tensor, vector, pairs, stencil, rhs)
        in_parts(_kernels.assemble, 0, rows, mask.size, *given)
    return stencil, rhs


def _reached(stencil: Floats, anchors: Mask) -> Mask:
    """(H, W) unknowns that couple, over any number of steps, to an anchor."""
    from rakelight.solve import _kernels

    out = np.pad(anchors, 1)
    if not anchors.all():
        stack = np.empty((int(np.count_nonzero((stencil[0] > 0) | out)), 2), np.int32)
        _kernels.mark_connected(stencil, NEGLIGIBLE, out, stack)
    return out[1:-1, 1:-1]


def _pin_weight(centre: Floats, weight: Floats) -> Floats:
    """What holds an unknown: a trace where it has gradients, else as much as others have."""
    diagonal = centre + weight
    positive = diagonal[diagonal > 0]
    scale = float(positive.mean()) if positive.size else 1.0
    return np.where(centre > NEGLIGIBLE * scale, PIN * centre, scale)


def _checked_mask(mask: Mask) -> Mask:
    mask = np.require(mask, requirements=["C", "W"])
    if mask.ndim != 2 or mask.dtype != np.bool_:
        seen = f"{mask.shape} {mask.dtype}"
        raise InputError("not a mask", source="mask", seen=seen, needed="(H, W) bool")
    if not mask.any():
        raise InputError("the mask is empty", source="mask", needed="at least one pixel")
    return mask


def _checked(
    name: str, values: Floats, mask: Mask, channels: int = 0, lowest: float | None = None
) -> Floats:
    from rakelight.solve import _kernels

    values = np.require(values, np.float64, ["C", "W"])
    needed = mask.shape + ((channels,) if channels else ())
    if values.shape != needed:
        raise InputError("wrong shape", source=name, seen=str(values.shape), needed=str(needed))
    rows = np.empty(len(mask))
    given = (mask, values.reshape(*mask.shape, -1), rows)
    in_parts(_kernels.lowest, 0, len(mask), mask.size, *given)
    least = rows.min()
    if np.isnan(least):
        raise InputError("not finite inside the mask", source=name, needed="finite numbers")
    if lowest is not None and least < lowest:
        seen, needed_value = f"{least:.3g}", f">= {lowest:g}"
        raise InputError("negative weight", source=name, seen=seen, needed=needed_value)
    return values


def _check_semidefinite(tensor: Floats, mask: Mask) -> None:
    muu, muv, mvv = (tensor[..., k][mask] for k in range(3))
    roundoff = 1e-6 * (muu + mvv) ** 2  # of float32 products
    if (np.minimum(muu, mvv) < 0).any() or (muv**2 > muu * mvv + roundoff).any():
        raise InputError(
            "not positive semidefinite", source="tensor", needed="muu, mvv >= 0, muv² <= muu mvv"
        )
