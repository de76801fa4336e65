"""Connected surfaces of a depth map."""

import numpy as np

from rakelight.model import Camera
from rakelight.prepare.surfaces import surfaces

CAMERA = Camera(12, 9, fx=100.0, fy=100.0, cx=5.5, cy=4.0)


def test_surfaces_end_at_jumps_and_holes():
    depth = np.full(CAMERA.shape, 1.0)
    depth[:, 4:] = 1.5
    depth[5, 4:] = np.nan
    depth[7, 9] = 1.0
    parts, count = surfaces(depth, CAMERA)
    assert count == 4
    assert (parts == -1).sum() == 8
    for part, size in ((np.s_[:, :4], 36), (np.s_[:5, 4:], 40), (np.s_[7:8, 9:10], 1)):
        assert (parts == parts[part].flat[0]).sum() == size
    assert surfaces(np.full((3, 4), np.nan), CAMERA)[1] == 0
