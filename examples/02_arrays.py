"""Refine numpy arrays: photographs, depth and a calibration matrix in, a mesh out.

python examples/02_arrays.py
"""

import numpy as np

import rakelight
from rakelight.synthetic import SceneOptions, make_albedo, make_shape, render_scene


def example_arrays() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What a pipeline of yours may have: 8-bit photographs, depth in millimetres, and K."""
    vase = make_shape("vase")
    options = SceneOptions(
        camera=vase.camera.scaled(0.25), photographs=8, bits=8, encoding="srgb", depth_frames=3
    )
    capture, _ = render_scene(vase, make_albedo("pattern"), options)
    depth_mm = np.rint(1000 * np.nan_to_num(capture.depth_m)).astype(np.uint16)
    return capture.photographs, depth_mm, capture.camera.matrix


photographs, depth_mm, K = example_arrays()  # (8, 90, 120, 3) uint8, (3, 45, 60) uint16, (3, 3)

# Depth in metres, 0 where there is none.  Without mask= the nearest object is cut out.
camera = rakelight.Camera.from_matrix(K, photographs.shape[1:3])
capture = rakelight.Capture.from_arrays(photographs, depth_mm / 1000, camera)
result = rakelight.refine(capture)

print("depth:", result.depth.shape, result.depth.dtype, f"{np.nanmedian(result.depth):.3f} m")
print("normals:", result.normals.shape, "albedo:", result.albedo.shape)
mesh = result.mesh()
print("mesh:", mesh.vertices_m.shape, mesh.faces.shape)
print("points:", result.point_cloud().points_m.shape)

# What does not fit is said in one line, with what to do about it.
try:
    rakelight.Capture.from_arrays(photographs, depth_mm, camera)
except rakelight.InputError as error:
    print("refused:", error)
