"""A .mat file of "Depth Super-Resolution Meets Uncalibrated Photometric Stereo" (Peng et al. 2017).

I (H, W, 3, N) photographs, z0 (h, w[, K]) depth, mask (H, W), K (3, 3) with the principal point of
MATLAB, whose first pixel is 1.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from rakelight.capture.from_arrays import capture_from_arrays
from rakelight.capture.listing import check_numbers
from rakelight.capture.matfile import is_mat, read_mat, refuse_hdf5
from rakelight.capture.readers.base import Reader, Reading, Wanted
from rakelight.errors import CaptureError, named_in
from rakelight.files import clear_errors, read_bytes
from rakelight.model import Array, Camera, Finding, Floats

VARIABLES = ("I", "z0", "mask", "K")
# Median depth, metres, from which on values count as millimetres: no such camera sees so far.
FARTHEST_M = 20.0
# Bytes of a file: 20 photographs of 1.2 megapixels in double precision take 590 MB.
MAX_BYTES = 2_000_000_000


def sniff(path: Path) -> bool:
    """Whether the file starts as MATLAB writes it."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return is_mat(file.read(32))


def read(path: Path, wanted: Wanted) -> Reading:
    """The capture of the file."""
    source = str(path)
    with clear_errors(source, "cannot be read"), path.open("rb") as file:
        refuse_hdf5(file.read(32), source)  # before gigabytes of it are read
    data = read_bytes(path, source=source, max_bytes=MAX_BYTES)
    variables = read_mat(data, VARIABLES, source)
    for name, axes in (("I", (3, 4)), ("z0", (2, 3)), ("K", (2,))):
        if name not in variables or variables[name].ndim not in axes:
            shape = variables[name].shape if name in variables else "nothing"
            raise CaptureError(
                f"no variable {name} as it has to be",
                source=source,
                seen=str(shape),
                needed="I (H, W, 3, N), z0 (h, w), K (3, 3) and, where there is one, mask (H, W)",
                remedy="save them under these names, with -v7",
            )
    depth_m, assumed = _depth(variables["z0"], source)
    with named_in(str(path)):
        photographs = _photographs(variables["I"], wanted.photographs)
        matrix = variables["K"].astype(np.float64)
        if matrix.shape == (3, 3):
            if matrix[:, 2].tolist() == [0, 0, 1]:  # as MATLAB's IntrinsicMatrix has it
                matrix = matrix.T
            matrix[:2, 2] -= 1.0
        capture = capture_from_arrays(
            photographs, depth_m, Camera.from_matrix(matrix, photographs.shape[1:3]),
            mask=variables.get("mask"), lighting="moving-lamp",
        )  # fmt: skip
    return Reading(replace(capture, findings=(*assumed, *capture.findings), source=source))


def _photographs(images: Array, chosen: tuple[int, ...] | None) -> Array:
    """(N, H, W, 3) of I (H, W, 3[, N]); uint8 where they are whole numbers up to 255."""
    if images.shape[2] != 3:
        raise CaptureError(
            "no photographs in colour",
            source="I",
            seen=str(images.shape),
            needed="(H, W, 3, N)",
            remedy="permute(I, ...) in MATLAB: rows, columns, red green blue, photographs",
        )
    stack = np.moveaxis(images if images.ndim == 4 else images[..., None], -1, 0)
    if chosen is not None:
        check_numbers(chosen, len(stack), "I")
        stack = stack[list(chosen)]
    if stack.dtype.kind == "f" and stack.min() >= 0 and 1 < stack.max() <= 255:
        whole = stack.astype(np.uint8)
        return whole if np.array_equal(whole, stack) else stack
    return stack


def _depth(z0: Array, source: str) -> tuple[Floats, tuple[Finding, ...]]:
    """(K, h, w) float32 metres of z0, which is metres or millimetres, and which it is taken for."""
    with np.errstate(over="ignore", invalid="ignore"):
        depth = np.moveaxis(z0 if z0.ndim == 3 else z0[..., None], -1, 0).astype(np.float32)
    measured = depth[np.isfinite(depth) & (depth > 0)]
    if not measured.size:
        raise CaptureError(
            "no depth at all",
            source=source,
            seen="z0 without positive values",
            remedy="save the depth, in metres or millimetres, as z0",
        )
    nearer = measured[measured < measured.max()]  # the largest may stand for "too far"
    middle, unit = float(np.median(nearer if nearer.size else measured)), "metres"
    if middle > FARTHEST_M:
        depth, middle, unit = depth / np.float32(1000), middle / 1000, "millimetres"
    message = f"z0 counts as {unit}: median depth {middle:.3g} m"
    return depth, (Finding("note", "depth-unit-assumed", message),)


READER = Reader("srmeetsps", "a .mat file with I, z0, mask and K (version 5 to 7)", sniff, read)
