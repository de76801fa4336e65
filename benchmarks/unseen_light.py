"""How a relief predicts photographs under lights that it was not refined from.

    python benchmarks/unseen_light.py CAPTURE DEPTH.tiff [--order 1] [--rounds 6] [--unseen 15 ...]

With the depth's normals n held, albedo and lights are fitted to the other photographs, each channel
by itself, in `--rounds` of turns; then the lights of the unseen ones alone.  A light is

    rho (max(0, s(x, y) . n) + phi(x, y)),    s, phi polynomials of `--order` in the pixel

since lights near an object differ over it.  Printed is the median residual of an unseen
photograph's usable values over their median, the mean over these photographs.

With order 1 and 6 rounds the tool that the issue of the joint method names; how much of its figure
is the lights' model, and how much its rounds, the other settings tell.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from scipy.ndimage import binary_erosion

from rakelight import load_capture
from rakelight.capture.images import decode_image
from rakelight.geometry.normals import surface_normals
from rakelight.model import MAD_TO_SIGMA, Floats, Mask
from rakelight.prepare.linear import to_linear

# Pixels this far from the outline count, and values between these, if all channels' do.
BORDER_PX, DARKEST, BRIGHTEST = 4, 0.01, 0.98
# Scale of the albedo's Cauchy weights; that of a light's is three deviations of its residuals.
ALBEDO_SCALE, LIGHT_ROUNDS = 0.05, 4


class Lights:
    """Lights of one channel of N photographs, linear in numbers (N, K) but for attached shadows."""

    def __init__(self, normals: Floats, place: Floats, order: int, count: int) -> None:
        x, y = place.T
        powers = [(i, j) for i in range(order + 1) for j in range(order + 1 - i)]
        fields = np.stack([x**i * y**j for i, j in powers], axis=1)
        self.facing = (fields[:, :, None] * normals[:, None]).reshape(len(place), -1)
        self.ambient = fields
        self.numbers = np.zeros((count, self.facing.shape[1] + fields.shape[1]))
        self.numbers[:, 2] = -1.0

    def shading(self, i: int) -> Floats:
        """(P,) of photograph i."""
        vector, ambient = np.split(self.numbers[i], [self.facing.shape[1]])
        return np.maximum(self.facing @ vector, 0) + self.ambient @ ambient

    def fit(self, i: int, values: Floats, good: Mask, albedo: Floats) -> None:
        """By reweighted least squares of the values (P,), the albedo (P,) held."""
        for _ in range(LIGHT_ROUNDS):
            lit = self.facing @ self.numbers[i, : self.facing.shape[1]] > 0
            rows = albedo[:, None] * np.hstack([self.facing * lit[:, None], self.ambient])
            off = rows @ self.numbers[i] - values
            scale = 3 * MAD_TO_SIGMA * np.median(np.abs(off)) + 1e-6
            weighed = rows * (good / (1 + (off / scale) ** 2))[:, None]
            matrix = weighed.T @ rows + 1e-6 * np.eye(rows.shape[1])
            self.numbers[i] = np.linalg.solve(matrix, weighed.T @ values)


def unseen_error(
    values: Floats,
    good: Mask,
    normals: Floats,
    place: Floats,
    unseen: list[int],
    order: int,
    rounds: int,
) -> float:
    """Relative error of the unseen photographs; values (N, P, 3), good (N, P)."""
    seen = [i for i in range(len(values)) if i not in unseen]
    residuals = []
    for c in range(3):
        image, lights = values[..., c], Lights(normals, place, order, len(values))
        albedo = np.median(image[seen], axis=0)
        for _ in range(rounds):
            for i in seen:
                lights.fit(i, image[i], good[i], albedo)
            a = np.stack([lights.shading(i) for i in seen])
            weight = good[seen] / (1 + ((albedo * a - image[seen]) / ALBEDO_SCALE) ** 2)
            squares = np.maximum((weight * a * a).sum(axis=0), 1e-9)
            albedo = (weight * a * image[seen]).sum(axis=0) / squares
        for i in unseen:
            lights.fit(i, image[i], good[i], albedo)
        residuals.append([albedo * lights.shading(i) - image[i] for i in unseen])
    off = np.abs(np.stack(residuals, axis=-1))
    each = [
        np.median(off[k][good[i]]) / np.median(values[i][good[i]]) for k, i in enumerate(unseen)
    ]
    return float(np.mean(each))


def main() -> None:
    """Print the error in per cent."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("capture", type=Path)
    parser.add_argument("depth", type=Path, help="a result's depth.tiff")
    parser.add_argument("--order", type=int, default=1)
    parser.add_argument("--rounds", type=int, default=6)
    parser.add_argument("--unseen", type=int, nargs="+", default=[15, 16, 17, 18, 19])
    given = parser.parse_args()
    capture, depth_m = load_capture(given.capture), decode_image(given.depth.read_bytes())
    mask = capture.mask & np.isfinite(depth_m)
    inner = binary_erosion(mask, np.ones((2 * BORDER_PX + 1,) * 2))
    normals = surface_normals(np.where(mask, depth_m, 1.0), mask, capture.camera)[inner]
    values = to_linear(capture.photographs[:, inner], capture.encoding).astype(np.float64)
    good = ((values > DARKEST) & (values < BRIGHTEST)).all(axis=-1)
    place = np.argwhere(inner)[:, ::-1].astype(float)
    place = (place - place.mean(axis=0)) / place.std(axis=0)
    error = unseen_error(values, good, normals, place, given.unseen, given.order, given.rounds)
    print(f"{100 * error:.2f} % of the light of {len(given.unseen)} unseen photographs")


if __name__ == "__main__":
    main()
