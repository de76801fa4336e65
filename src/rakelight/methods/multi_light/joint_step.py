"""One Gauss-Newton step of lights and depth together, along the bas-relief valley.

A surface that is flattened, and lights that are moved to match, explain photographs nearly as well:
steps of one alone are short there.  On large images the depth moves in cells, linearly between
their centres.  There, under near lights, whose fall-off determines the scale of the relief, that
scale is one more unknown beside the lights.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.sparse import csr_array, diags_array

from rakelight.geometry.cells import Cells, cell_sums
from rakelight.geometry.derivatives import gradient_image
from rakelight.geometry.grid import Links
from rakelight.methods.base import scatter
from rakelight.methods.levels import Level
from rakelight.methods.multi_light.bas_relief import relief_scaling
from rakelight.methods.multi_light.energy import (
    Fit,
    depth_negative_gradient,
    evaluated,
    light_system,
)
from rakelight.model import Floats, Mask
from rakelight.photometry.images import applied
from rakelight.solve import assemble
from rakelight.solve.gauss_newton import bordered_step
from rakelight.solve.levenberg_marquardt import lowered

# Share of one-sided differences, the rest being mean ones, in the matrix of a joint step of pixels
# (ablation.md: halved 0.99, doubled 0.95).  Cells have one-sided differences alone.
STIFFNESS = 0.03
# Least damping of joint steps: any damping shortens them along the bas-relief valley.
LEAST_DAMPING = 1e-6


def joint_step(level: Level, fit: Fit, most_cells: int) -> Fit:
    """One Gauss-Newton step of lights and depth together; if refused, the next has more damping.

    It is not repeated at once: to set it up costs as much as all other steps.
    """

    def after(damping: float) -> Fit:
        system = joint_system(level, fit, most_cells, damping)
        step = bordered_step(
            system.matrix, system.right, system.columns, system.hessian, system.slope, damping
        )
        if step is None:  # singular
            return fit  # refused, as it is no lower
        field, numbers = step
        depth = system.cells.interpolate(scatter(field, system.cells.inside))
        if system.relief is not None:
            depth, numbers = depth + numbers[-1] * system.relief, numbers[:-1]
        lights = fit.model.moved(fit.lights, numbers)
        return evaluated(level, fit, level.placed(fit.log_depth + depth), lights)

    lower, damping = lowered(fit, fit.joint_damping, after, LEAST_DAMPING)
    return replace(lower, joint_damping=damping)


@dataclass(frozen=True)
class JointSystem:
    """The normal equations of one step of lights and depth: the parts that `bordered_step` takes.

    matrix : sparse (P, P) of the log depth of P pixels or cells; right : (P,) minus half the
        energy's derivatives with it
    columns : (P, F) mixed second derivatives of half the energy; hessian, slope : (F, F) and (F,)
        derivatives of half the energy with the lights' free numbers and, last, with the relief's
        scale, if that is one of the unknowns
    cells : between whose centres the depth moves linearly; one pixel each where pixels move
    relief : (h, w) the change of log depth with the relief's scale, or None
    """

    matrix: Any
    right: Floats
    columns: Floats
    hessian: Floats
    slope: Floats
    cells: Cells
    relief: Floats | None


def joint_system(level: Level, fit: Fit, most_cells: int, damping: float) -> JointSystem:
    """The normal equations of a joint step, damped where photographs leave normals open.

    Above `most_cells` pixels the depth moves in cells, whose long wavelengths are those of the
    bas-relief valley; the depth step that follows moves the detail.

    Along the valley the second derivatives nearly cancel, those of some pixels only with those of
    the same pixels: under near lights all come from one sample.  Under distant ones
    `project_bas_relief` sets the transform, and the depth's derivatives, of all pixels, keep this
    step from drifting where errors of the model lead.
    """
    cell = max(1, int(np.ceil(np.sqrt(np.count_nonzero(level.mask) / most_cells))))
    cells, most = Cells.on(level.mask, cell), 2 * most_cells
    sample = level.photographs.subsample(most) if fit.model.near else None
    tensor = damped_tensor(level, fit, damping, sample)
    weight = fit.noise**2 * level.prior_weight * level.mask
    negative_gradient = depth_negative_gradient(level, fit)
    hessian, slope, mixed = light_system(level, fit, most, mixed=True)

    # The gradient of a correction is, per pixel, 1/cell of its difference between cells.
    grid = Links.of(level.grid if cell == 1 else cells.inside)
    uphill = (grid.gradient / cell).T
    subsampling = level.photographs.subsampling(most)
    free = fit.model.jacobian(fit.lights)
    columns = uphill @ _subsampled_sums(mixed, subsampling, cell, cells.inside) @ free
    relief = relief_scaling(level, fit.log_depth) if fit.model.near and cell > 1 else None
    if relief is not None:
        gradient = gradient_image(relief, level.grid)
        along, weighted_relief = applied(tensor, gradient), weight * relief
        own = uphill @ cell_sums(along, cell)[cells.inside].ravel()
        columns = np.column_stack([columns, own + cells.gather(weighted_relief)[cells.inside]])
        lights = np.tensordot(gradient[::subsampling, ::subsampling], mixed, 3) @ free
        information = np.vdot(gradient, along) + np.vdot(relief, weighted_relief)
        hessian = np.block([[hessian, lights[:, None]], [lights, information]])
        slope = np.append(slope, -np.vdot(negative_gradient, relief))

    matrix = field_matrix(
        grid, cell_sums(tensor, cell) / cell**2,
        cell_sums(weight, cell), level.links.pairs if cell == 1 else None,
        STIFFNESS if cell == 1 else 1.0,
    )  # fmt: skip
    right = cells.gather(negative_gradient)[cells.inside]
    return JointSystem(matrix, right, columns, hessian, slope, cells, relief)


def field_matrix(
    grid: Links, tensor: Floats, weight: Floats, pairs: Floats | None, stiffness: float
) -> Any:
    """Sparse (P, P): tensor terms of the mean gradient, and `stiffness` of one-sided differences'.

    One-sided differences alone would be stiffer than the energy, and steps along the valley short.
    """
    uu, uv, vv = (1 - stiffness) * tensor[grid.mask].T
    across = np.stack([uv, np.zeros_like(uv)], axis=-1).ravel()[:-1]
    along = np.stack([uu, vv], axis=-1).ravel()
    both = diags_array((along, across, across), offsets=(0, 1, -1)).tocsr()
    zeros = np.zeros((*grid.mask.shape, 2))
    system = assemble(grid.mask, stiffness * tensor, zeros, weight, zeros[..., 0], pairs)
    return grid.gradient.T @ (both @ grid.gradient) + system.to_sparse()


def _subsampled_sums(mixed: Floats, subsampling: int, cell: int, inside: Mask) -> Floats:
    """(2 C, K) sums over the C cells inside, of (h, w, 2, K) at subsampled pixels."""
    if cell == 1:  # and every pixel is used
        return mixed[inside].reshape(-1, mixed.shape[-1])
    rows, columns = (np.arange(size) * subsampling // cell for size in mixed.shape[:2])
    target_cell = (rows[:, None] * inside.shape[1] + columns).ravel()
    ones, pixels = np.ones(target_cell.size), np.arange(target_cell.size)
    gather = csr_array((ones, (target_cell, pixels)), shape=(inside.size, target_cell.size))
    total = gather @ mixed.reshape(target_cell.size, -1)
    return np.asarray(total[inside.ravel()]).reshape(-1, mixed.shape[-1])


def damped_tensor(level: Level, fit: Fit, damping: float, sample: Mask | None = None) -> Floats:
    """M plus a damping that limits the step of normals that the photographs leave open.

    Relative to the median, over the pixels that have any, of the information on the normal.
    sample : (h, w) the pixels whose M, scaled up, stands for all of them; None for every pixel
    """
    tensor, active = fit.linearization.jtwj.copy(), level.photographs.active
    dn_dg2 = level.squared_normal_derivative(fit.surface)
    damping_term = damping * fit.linearization.typical_information(dn_dg2) * dn_dg2 * active
    if sample is not None:
        tensor *= (np.count_nonzero(active) / np.count_nonzero(sample) * sample)[..., None]
    tensor[..., 0] += damping_term
    tensor[..., 2] += damping_term
    return tensor
