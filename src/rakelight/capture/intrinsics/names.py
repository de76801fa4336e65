"""What names say: of a file, whether intrinsics or a lens are in it; of a camera, which it is."""

from __future__ import annotations

import re
from pathlib import Path

LENS_BYTES = 128 + 14 * 8
"""Of a .npy with as many float64 as a lens has at most, its head included."""

TEXT_SUFFIXES = (".yaml", ".yml", ".xml", ".json", ".txt", ".csv")
"""Of texts that may state a camera."""

DEPTH, COLOR = "depth|infra(?:red)?1?", "colou?r|rgb"
"""Words in the names of what is of the depth camera, and of the photographs', as expressions."""


def named_intrinsics(stem: str) -> bool:
    """Whether a file's name, without ending, says that it holds intrinsics.

    Where a camera stood is no intrinsics of it.

    >>> [named_intrinsics(stem) for stem in ("K", "color_intrinsics", "calib-2", "camera_poses")]
    [True, True, True, False]
    """
    name = stem.lower()
    if name == "k" or "intrinsic" in name:
        return True
    return re.search("calib|camera", name) is not None and not re.search("pose|trajector", name)


def names_depth(stem: str) -> bool:
    """Whether a file's name, without ending, says that it is of the depth camera alone.

    >>> [names_depth(stem) for stem in ("depth_intrinsics", "calib_ir", "color_and_depth", "pair")]
    [True, True, False, False]
    """
    name = stem.lower()
    of_depth = re.search(f"{DEPTH}|(?<![a-z])ir(?![a-z])", name)
    return of_depth is not None and not re.search(COLOR, name.replace("rgbd", ""))


def names_lens(stem: str) -> bool:
    """Whether a file's name, without ending, says that it holds the distortion of a lens.

    >>> [names_lens(stem) for stem in ("dist", "calib_dist", "cameraDistortion", "dist_coeffs")]
    [True, True, True, True]
    >>> [names_lens(stem) for stem in ("distances", "undistorted", "lens")]
    [False, False, False]
    """
    return surely_lens(stem) or re.search(r"(?<![a-z])dist(?![a-z])", stem.lower()) is not None


def surely_lens(stem: str) -> bool:
    """Whether a name that `names_lens` is not one of distances as well: dist.

    >>> surely_lens("dist_coeffs"), surely_lens("dist")
    (True, False)
    """
    return re.search(r"(?<!un)distor[ts]ion|dist[-_ ]?coef", stem.lower()) is not None


def may_state(path: Path) -> bool:
    """Whether a camera is looked for in a file of this name: a text, or an array of that name.

    >>> [may_state(Path(name)) for name in ("poses.txt", "K.npy", "depth.npy")]
    [True, True, False]
    """
    suffix = path.suffix.lower()
    if suffix != ".npy":
        return suffix in TEXT_SUFFIXES
    if named_intrinsics(path.stem) or surely_lens(path.stem):
        return True
    # A map of distances may be called dist, too; it is larger.
    return names_lens(path.stem) and path.is_file() and path.stat().st_size <= LENS_BYTES
