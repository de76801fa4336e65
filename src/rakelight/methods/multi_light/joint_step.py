"""One Gauss-Newton step of lights and depth together, down the bas-relief valley.

A surface that is flattened, and lamps that are moved to match, explain photographs nearly as well.
Steps of one alone creep there.  On large images the depth moves in cells, linearly between their
centres; under near lamps, whose fall-off tells the relief, its whole detail becomes deeper or
flatter as well: one more number beside the lights'.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.sparse import csr_array, diags_array

from rakelight.geometry.cells import Cells, cell_sums
from rakelight.geometry.derivatives import gradient_image
from rakelight.geometry.grid import Links
from rakelight.geometry.normals import normal_lengths, squared_turn
from rakelight.methods.levels import Level
from rakelight.methods.multi_light.bas_relief import relief_scaling
from rakelight.methods.multi_light.energy import (
    Fit,
    depth_negative_gradient,
    evaluated,
    lamps_after,
    light_curvature,
    light_slope,
)
from rakelight.model import Floats, Mask
from rakelight.photometry.images import applied
from rakelight.solve import assemble
from rakelight.solve.gauss_newton import border
from rakelight.solve.levenberg_marquardt import lowered

# Weight of one-sided differences over mean ones in a joint step's matrix, of pixels or of cells.
STIFFNESS = 0.03
CELL_STIFFNESS = 0.5


def joint_step(level: Level, fit: Fit, most_cells: int) -> Fit:
    """One Gauss-Newton step of lights and depth together; refused, it makes the next one shorter.

    A refused one is not tried again: setting it up costs as much as all the rest.
    """
    lower, damping = lowered(
        fit, fit.joint_damping, lambda damping: after_joint_step(level, fit, most_cells, damping), 1
    )
    return replace(lower, joint_damping=damping)


def after_joint_step(level: Level, fit: Fit, most_cells: int, damping: float) -> Fit:
    """The fit after one Gauss-Newton step of lights and depth together, whatever its energy.

    Above `most_cells` pixels the depth moves in cells, which is where the bas-relief valley lies;
    the depth step that follows sees to the detail.

    Along the valley the second derivatives nearly cancel, those of some pixels only with those of
    the same.  Under near lamps they have to.  Under distant ones `project_bas_relief` sets the
    relief, and the depth's, of all pixels, keep this step from sliding where errors of the
    photographs lead.
    """
    cell = cell_size(level, most_cells)
    cells, most = Cells.on(level.mask, cell), 2 * most_cells
    some = level.photographs.some(most) if fit.near else None
    tensor = damped_tensor(level, fit, damping, some)
    weight = fit.noise**2 * level.prior_weight * level.mask
    force = depth_negative_gradient(level, fit)
    hessian, mixed = light_curvature(level, fit, most, mixed=True)
    slope = light_slope(level, fit)

    # The gradient of a correction is, per pixel, 1/cell of its difference between cells.
    grid = Links.of(level.grid if cell == 1 else cells.inside)
    uphill = (grid.gradient / cell).T
    stride = level.photographs.stride(most)
    columns = uphill @ _sums_of_some(mixed, stride, cell, cells.inside)
    whole = fit.near and cell > 1
    if whole:
        relief = relief_scaling(level, fit.log_depth)
        gradient = gradient_image(relief, level.grid)
        along, held = applied(tensor, gradient), weight * relief
        own = uphill @ cell_sums(along, cell)[cells.inside].ravel()
        columns = np.column_stack([columns, own + cells.gather(held)[cells.inside]])
        lights = np.tensordot(gradient[::stride, ::stride], mixed, 3)
        knowledge = np.vdot(gradient, along) + np.vdot(relief, held)
        hessian = np.block([[hessian, lights[:, None]], [lights, knowledge]])
        slope = np.append(slope, -np.vdot(force, relief))

    matrix = field_matrix(
        grid, cell_sums(tensor, cell) / cell**2,
        cell_sums(weight, cell), level.pairs if cell == 1 else None,
        STIFFNESS if cell == 1 else CELL_STIFFNESS,
    )  # fmt: skip
    joint = border(matrix, cells.gather(force)[cells.inside], columns, hessian, slope)
    correction, numbers = joint.step(damping)
    field = np.zeros(cells.inside.shape)
    field[cells.inside] = correction
    step = cells.spread(field)
    if whole:
        numbers, deeper = numbers[:-1], numbers[-1]
        step += deeper * relief
    return evaluated(level, fit, level.placed(fit.log_depth + step), lamps_after(fit, numbers))


def cell_size(level: Level, most_cells: int) -> int:
    """Pixels along each side of the cells in which a joint step moves the depth."""
    return max(1, int(np.ceil(np.sqrt(np.count_nonzero(level.mask) / most_cells))))


def field_matrix(
    grid: Links, tensor: Floats, weight: Floats, pairs: Floats | None, stiffness: float
) -> Any:
    """Sparse (P, P): the mean gradient's tensor terms, `stiffness` of the one-sided differences'.

    Those alone would be stiffer than the energy is, and the steps along the valley short.
    """
    uu, uv, vv = (1 - stiffness) * tensor[grid.mask].T
    across = np.stack([uv, np.zeros_like(uv)], axis=-1).ravel()[:-1]
    along = np.stack([uu, vv], axis=-1).ravel()
    both = diags_array((along, across, across), offsets=(0, 1, -1)).tocsr()
    still = np.zeros((*grid.mask.shape, 2))
    system = assemble(grid.mask, stiffness * tensor, still, weight, still[..., 0], pairs)
    return grid.gradient.T @ (both @ grid.gradient) + system.to_sparse()


def _sums_of_some(mixed: Floats, stride: int, cell: int, inside: Mask) -> Floats:
    """(2 C, K) sums over the C cells inside of (h, w, 2, K), which is of every stride-th pixel."""
    if stride == cell == 1:
        return mixed[inside].reshape(-1, mixed.shape[-1])
    rows, columns = (np.arange(size) * stride // cell for size in mixed.shape[:2])
    place = (rows[:, None] * inside.shape[1] + columns).ravel()
    ones, pixels = np.ones(place.size), np.arange(place.size)
    gather = csr_array((ones, (place, pixels)), shape=(inside.size, place.size))
    total = gather @ mixed.reshape(place.size, -1)
    return np.asarray(total[inside.ravel()]).reshape(-1, mixed.shape[-1])


def damped_tensor(level: Level, fit: Fit, damping: float, some: Mask | None = None) -> Floats:
    """The tensor with what keeps a normal that the photographs leave open from turning far.

    The typical pixel's knowledge of its normal sets the measure.
    some : (h, w) the pixels whose tensor stands for all, if not every pixel's does
    """
    camera = level.photographs.camera
    gradient, tensor = fit.surface.gradient, fit.explanation.tensor.copy()
    length = normal_lengths(gradient[..., 0], gradient[..., 1], camera)
    turn = squared_turn(length, camera)
    active = level.photographs.active
    knowledge = np.median((tensor[..., 0] + tensor[..., 2])[active] / turn[active])
    hold = damping * knowledge * turn * active
    if some is not None:
        tensor *= (np.count_nonzero(active) / np.count_nonzero(some) * some)[..., None]
    tensor[..., 0] += hold
    tensor[..., 2] += hold
    return tensor
