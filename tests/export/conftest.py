"""A small analytic result: a sphere seen by a camera with unequal focal lengths, off centre."""

import numpy as np
import pytest

from rakelight.model import Camera, Finding, Lights, Result

CENTRE_M = np.array([0.01, -0.012, 0.65])
RADIUS_M = 0.04


def make_sphere() -> Result:
    camera = Camera(width=64, height=48, fx=300.0, fy=280.0, cx=29.0, cy=26.5)
    v, u = np.mgrid[:48, :64]
    ray = np.stack([(u - 29.0) / 300.0, (v - 26.5) / 280.0, np.ones(u.shape)], axis=-1)
    # |z ray - centre| = radius, the nearer solution
    a, b = np.sum(ray**2, axis=-1), ray @ CENTRE_M
    c = CENTRE_M @ CENTRE_M - RADIUS_M**2
    mask = b * b - a * c > 0
    z = (b - np.sqrt(np.where(mask, b * b - a * c, 0))) / a
    points = z[..., None] * ray
    normals = (points - CENTRE_M) / RADIUS_M
    albedo = np.stack([0.2 + u / 80, 0.1 + v / 100, np.full(u.shape, 0.05)], axis=-1)
    return Result(
        depth=np.where(mask, z, np.nan).astype(np.float32),
        normals=np.where(mask[..., None], normals, np.nan).astype(np.float32),
        albedo=np.where(mask[..., None], albedo, 0).astype(np.float32),
        confidence=np.where(mask, u / 63, 0).astype(np.float32),
        lights=Lights(
            vector=np.array([[[0.0, -0.6, -0.8]], [[1.2, 0.0, -1.6]]]),
            ambient=np.array([[0.1], [0.2]]),
        ),
        camera=camera,
        prepared_depth=np.where(mask, z + 0.001, np.nan).astype(np.float32),
        method="multi-light",
        options={"scale": 2, "robust": True},
        iterations=3,
        energy=(9.0, 4.0, 3.5),
        converged=True,
        timings_s={"prepare": 0.5, "solve": 1.25},
        findings=(Finding("note", "mask-full", "the mask is full", "give a mask"),),
        source="captures/sphere",
        photograph_names=("000.png", "001.png"),
    )


@pytest.fixture
def sphere() -> Result:
    return make_sphere()
