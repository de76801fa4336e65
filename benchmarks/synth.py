"""Seconds and peak memory of `rakelight synth` for large photographs.

    python benchmarks/synth.py                              1, 4, 12, 24 megapixels, 20 photographs
    python benchmarks/synth.py --megapixels 4 --photographs 5 20
    python benchmarks/synth.py --supersampling 2 --options "--cast-shadows --specular 0.3"
    python benchmarks/synth.py --baseline ../other/src      beside the source of another commit
    python benchmarks/synth.py --packing                    what compressing the files costs

Each run is a process of its own, after one that compiles; one ray per pixel.  peak_mb is the
largest resident set.
"""

from __future__ import annotations

import argparse
import shlex
import shutil
import sys
import tempfile
import time
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from large import SOURCE, measured, table

VIEW = (360, 480)  # rows, columns at --size 1
MEGAPIXELS = [1, 4, 12, 24]


def row_of(
    megapixels: float, photographs: int, options: list[str], source: Path, folder: Path
) -> dict[str, Any]:
    """One row of the table: a capture made and deleted again."""
    scale = np.sqrt(1e6 * megapixels / np.prod(VIEW))
    output = folder / "capture"
    command = ["-m", "rakelight", "synth", str(output), "--size", f"{scale:.2f}", "--json"]
    began = time.perf_counter()
    found = measured([*command, "--lights", str(photographs), *options], source)
    wall_s = time.perf_counter() - began
    row: dict[str, Any] = {"megapixels": megapixels, "photographs": photographs}
    if "failed" not in found:
        files = [path.stat().st_size for path in output.rglob("*") if path.is_file()]
        width, height = found["size"]
        row |= {
            "pixels": f"{width} x {height}",
            "seconds": round(wall_s, 1),
            "cpu_s": round(found["cpu_s"], 1),
            "cpu_s_per_megapixel": round(1e6 * found["cpu_s"] / (width * height), 2),
            "peak_mb": round(found["peak_mb"]),
            "files_mb": round(sum(files) / 1e6),
        }
    shutil.rmtree(output, ignore_errors=True)
    return row | {key: found[key] for key in ("failed",) if key in found}


def packing() -> list[dict[str, Any]]:
    """Megabytes a second, and the share of the bytes that remains, of a photograph and of truth."""
    from rakelight.capture.images import encode_png, encode_tiff
    from rakelight.capture.rows import pack_png_rows, pack_tiff_rows
    from rakelight.synthetic import SceneOptions, make_albedo, make_shape, render_scene

    vase, rows = make_shape("vase"), []
    for bits in (8, 16):
        options = SceneOptions(
            camera=vase.camera.scaled(3), photographs=1, bits=bits, supersampling=1
        )
        capture, truth = render_scene(vase, make_albedo("pattern"), options)
        photograph = capture.photographs[0]
        plain = np.ascontiguousarray(photograph, photograph.dtype.newbyteorder(">")).tobytes()
        ways: dict[str, Any] = {
            "in rows": lambda image=photograph: pack_png_rows(image).data,
            "zlib level 1": lambda data=plain: zlib.compress(data, 1),
            "zlib level 6": lambda data=plain: zlib.compress(data, 6),
            "OpenCV": lambda image=photograph: encode_png(image),
        }
        rows += [_packed(f"photograph, {bits} bit", photograph, *way) for way in ways.items()]
    normals = truth.normals
    ways = {
        "in rows": lambda: pack_tiff_rows(normals),
        "zlib level 6": lambda: zlib.compress(normals.tobytes(), 6),
        "OpenCV": lambda: encode_tiff(normals),
    }
    return rows + [_packed("normals", normals, *way) for way in ways.items()]


def _packed(what: str, values: Any, name: str, pack: Any) -> dict[str, Any]:
    began = time.process_time()
    share = len(pack()) / values.nbytes
    speed = values.nbytes / 1e6 / (time.process_time() - began)
    return {"what": what, "packed": name, "MB/s": round(speed), "of the bytes": round(share, 3)}


def main() -> None:
    """Measure what the arguments ask for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--megapixels", nargs="+", type=float, default=MEGAPIXELS)
    parser.add_argument("--photographs", nargs="+", type=int, default=[20])
    parser.add_argument("--supersampling", type=int, default=1, help="rays per pixel and side")
    parser.add_argument("--options", default="", help="more options of synth, in quotes")
    parser.add_argument("--baseline", type=Path, help="a source folder to compare with")
    parser.add_argument("--packing", action="store_true")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    if given.packing:
        sys.path.insert(0, str(SOURCE))
        table(packing())
        return
    rows = []
    sources = {"this": SOURCE, **({"baseline": given.baseline} if given.baseline else {})}
    with tempfile.TemporaryDirectory() as scratch:
        for name, source in sources.items():
            options = shlex.split(given.options)
            if "supersampling" in (source / "rakelight" / "cli" / "synth.py").read_text():
                options += ["--supersampling", str(given.supersampling)]
            row_of(0.1, 3, options, source, Path(scratch))  # compiles
            for megapixels in given.megapixels:
                for photographs in given.photographs:
                    row = row_of(megapixels, photographs, options, source, Path(scratch))
                    rows.append({"source": name, **row})
    table(rows, given.json)


if __name__ == "__main__":
    main()
