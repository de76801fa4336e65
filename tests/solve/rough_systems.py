"""Random depth systems that are hard in the ways real ones are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rakelight.solve import DepthSystem, assemble


@dataclass
class Rough:
    """Tensors of random direction, 1:10, over two decades; weak data."""

    mask: np.ndarray
    tensor: np.ndarray
    vector: np.ndarray
    weight: np.ndarray
    target: np.ndarray

    def system(self, **options: object) -> DepthSystem:
        return assemble(self.mask, self.tensor, self.vector, self.weight, self.target, **options)


def rough(
    height: int,
    width: int,
    seed: int = 0,
    anisotropy: float = 10,
    decades: float = 2,
    direction: float | None = None,
    mask: np.ndarray | None = None,
) -> Rough:
    rng = np.random.default_rng(seed)
    shape = (height, width)
    angle = rng.uniform(0, np.pi, shape) if direction is None else np.full(shape, direction)
    large = 10 ** rng.uniform(-decades / 2, decades / 2, shape)
    small, cos, sin = large / anisotropy, np.cos(angle), np.sin(angle)
    tensor = np.stack(
        [
            large * cos**2 + small * sin**2,
            (large - small) * cos * sin,
            large * sin**2 + small * cos**2,
        ],
        axis=-1,
    )
    return Rough(
        mask=np.ones(shape, bool) if mask is None else mask,
        tensor=tensor,
        vector=0.1 * large[..., None] * rng.normal(size=(*shape, 2)),
        weight=10 ** rng.uniform(-4, -2, shape),
        target=rng.normal(size=shape),
    )


def disc(size: int) -> np.ndarray:
    row, column = np.mgrid[:size, :size] - (size - 1) / 2
    return np.hypot(row, column) < 0.49 * size


def masks(size: int) -> dict[str, np.ndarray]:
    """Shapes on which solvers break."""
    rng = np.random.default_rng(5)
    row, column = np.mgrid[:size, :size]
    holes = rng.random((size, size)) < 0.8
    thin = ((column + 2 * row) % 16 < 3) | ((3 * column - row) % 40 < 2)
    parts = ((row // 9) % 2 == 0) & ((column // 13) % 3 > 0)
    dust = rng.random((size, size)) < 0.15
    lines = (row % 7 == 0) | (column == 3)
    return {
        "disc": disc(size), "holes": holes, "thin": thin,
        "parts": parts, "dust": dust, "lines": lines,
    }  # fmt: skip
