"""One small sound file of every kind that rakelight reads, and how it is read."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import tifffile
from PIL import Image

from rakelight.capture import load_capture, load_truth, write_capture
from rakelight.export import load_result, write_result
from rakelight.model import Camera, Capture, Lights, Result, Truth
from rakelight.synthetic.depth_file import shape_from_file
from tests.faults.sound_recordings import recording_kinds
from tests.faults.sound_sources import source_kinds

WIDTH, HEIGHT = 32, 24
CAMERA = Camera(WIDTH, HEIGHT, 40.0, 40.5, 15.25, 11.75)
RANDOM = np.random.default_rng(7)
ROWS, COLUMNS = np.mgrid[:HEIGHT, :WIDTH]
MASK = (ROWS - 11.5) ** 2 + (COLUMNS - 15.5) ** 2 < 9**2
DEPTH_M = np.where(MASK, 0.6 + 0.001 * COLUMNS, np.nan).astype(np.float32)
NORMALS = np.where(MASK[..., None], [0.0, 0.0, -1.0], np.nan).astype(np.float32)
WAVES = 0.5 + 0.2 * np.sin(np.add.outer(np.arange(4), ROWS + 0.5 * COLUMNS))
PHOTOGRAPHS = (255 * (WAVES[..., None] + RANDOM.uniform(0, 0.2, (4, HEIGHT, WIDTH, 3)))).astype(
    np.uint8
)


@dataclass(frozen=True)
class Kind:
    """A file to damage, and what reads the folder or file that it belongs to."""

    name: str
    path: Path
    read: Callable[[], object]


def pillow(kind: str, **options: object) -> Callable[[np.ndarray], bytes]:
    """An encoder: pixels to a file, by Pillow."""

    def encode(pixels: np.ndarray) -> bytes:
        file = io.BytesIO()
        colours = Image.fromarray(pixels)
        if kind == "PNG" and options.get("palette"):
            colours = colours.quantize(16)
        colours.save(file, kind, **{key: v for key, v in options.items() if key != "palette"})
        return file.getvalue()

    return encode


def libtiff(compression: int, predictor: int = 1) -> Callable[[np.ndarray], bytes]:
    """The same by libtiff, in OpenCV, in strips of 7 rows."""
    options = [cv2.IMWRITE_TIFF_COMPRESSION, compression, cv2.IMWRITE_TIFF_PREDICTOR, predictor]
    options += [cv2.IMWRITE_TIFF_ROWSPERSTRIP, 7]

    def encode(pixels: np.ndarray) -> bytes:
        turned = pixels[..., ::-1] if pixels.ndim == 3 else pixels
        return cv2.imencode(".tiff", np.ascontiguousarray(turned), options)[1].tobytes()

    return encode


def tiles(**options: object) -> Callable[[np.ndarray], bytes]:
    """The same by tifffile, in tiles of 16 x 16."""

    def encode(pixels: np.ndarray) -> bytes:
        file = io.BytesIO()
        tifffile.imwrite(file, pixels, tile=(16, 16), **options)
        return file.getvalue()

    return encode


def grey_png(pixels: np.ndarray) -> bytes:
    """Grey with 16 bits."""
    return cv2.imencode(".png", pixels[..., 0].astype(np.uint16) * 257)[1].tobytes()


def colour_png_16(pixels: np.ndarray) -> bytes:
    """Colour with 16 bits."""
    return cv2.imencode(".png", pixels.astype(np.uint16) * 257)[1].tobytes()


def plain(encode: Callable[[np.ndarray], bytes]) -> Callable[[np.ndarray], bytes]:
    """16 bits of what an encoder would write in 8."""
    return lambda pixels: encode(pixels.astype(np.uint16) * 257)


PHOTOGRAPH_KINDS: dict[str, Callable[[np.ndarray], bytes]] = {
    "png": pillow("PNG"),
    "png-16": colour_png_16,
    "png-grey-16": grey_png,
    "png-palette": pillow("PNG", palette=True),
    "jpeg": pillow("JPEG", quality=95),
    "jpeg-420": pillow("JPEG", quality=80, subsampling=2, restart_marker_blocks=2),
    "jpeg-progressive": pillow("JPEG", quality=90, progressive=True),
    "tiff-plain": libtiff(1),
    "tiff-lzw": libtiff(5),
    "tiff-lzw-16": plain(libtiff(5, 2)),
    "tiff-packbits": libtiff(32773),
    "tiff-deflate-16": plain(libtiff(8, 2)),
    "tiff-tiles": tiles(photometric="rgb"),
    "tiff-tiles-deflate": tiles(photometric="rgb", compression="zlib", byteorder=">"),
}


RESULT_FILES = (
    *("result.json", "lights.json", "albedo.png", "depth.tiff", "confidence.png"),
    "depth_sigma.tiff",
)


def make_kinds(folder: Path) -> list[Kind]:
    """Write them all below the new `folder`; the same bytes each time."""
    folder.mkdir()
    truth = Truth(DEPTH_M, NORMALS, np.ones((HEIGHT, WIDTH, 3), np.float32), _lights())
    capture = Capture(
        photographs=PHOTOGRAPHS,
        depth_m=np.full((2, HEIGHT // 2, WIDTH // 2), 0.6, np.float32),
        mask=MASK,
        camera=CAMERA,
    )
    kinds = []
    for name, encode in PHOTOGRAPH_KINDS.items():
        place = folder / name
        write_capture(capture, place, depth_scale=1000.0)
        for path, pixels in zip(sorted((place / "rgb").iterdir()), PHOTOGRAPHS, strict=True):
            path.write_bytes(encode(pixels))
        kinds.append(Kind(name, place / "rgb" / "001.png", lambda place=place: load_capture(place)))

    place = folder / "capture"
    write_capture(capture, place, truth=truth, depth_scale=1000.0)
    for name in ("capture.toml", "mask.png", "depth/001.png"):
        kinds.append(Kind(name, place / name, lambda: load_capture(place)))
    for name in ("lights.json", "depth.tiff", "normals.tiff"):
        kinds.append(Kind(f"truth/{name}", place / "truth" / name, lambda: load_truth(place)))

    floats = folder / "floats"
    write_capture(capture, floats)
    (floats / "depth" / "001.tiff").write_bytes(libtiff(5, 3)(capture.depth_m[1]))
    kinds.append(Kind("depth.tiff", floats / "depth" / "000.tiff", lambda: load_capture(floats)))
    kinds.append(Kind("depth-lzw", floats / "depth" / "001.tiff", lambda: load_capture(floats)))

    write_result(_result(), folder / "result", mesh="none")
    for name in RESULT_FILES:
        path = folder / "result" / name
        kinds.append(Kind(f"result/{name}", path, lambda: load_result(folder / "result")))

    np.savez(folder / "stored.npz", depth_mm=1000 * DEPTH_M, mask=MASK)
    np.savez_compressed(folder / "deflated.npz", depth_mm=np.asfortranarray(1000 * DEPTH_M))
    (folder / "shape.tiff").write_bytes(libtiff(5, 3)(DEPTH_M))
    for name in ("stored.npz", "deflated.npz", "shape.tiff"):
        kinds.append(Kind(name, folder / name, lambda path=folder / name: shape_from_file(path)))
    kinds += [Kind(*kind) for kind in recording_kinds(folder / "recordings")]
    kinds += [Kind(*kind) for kind in source_kinds(folder / "sources")]
    return kinds


def _lights() -> Lights:
    vector = np.linspace(-1, 1, 36).reshape(4, 3, 3)
    return Lights(vector, vector[..., 0], position_m=vector, middle_m=np.array([0.0, 0.0, 0.6]))


def _result() -> Result:
    return Result(
        depth=DEPTH_M,
        normals=NORMALS,
        albedo=np.where(MASK[..., None], 1, 0).astype(np.float32) * np.ones(3, np.float32),
        confidence=MASK.astype(np.float32),
        lights=_lights(),
        camera=CAMERA,
        prepared_depth=DEPTH_M,
        depth_sigma=DEPTH_M / 500,
        method="multi-light",
        energy=(3.0, 2.0),
        timings_s={"solve": 1.0},
    )
