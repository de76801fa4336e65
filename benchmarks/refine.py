"""How long `rakelight refine` takes from files to files, and how much memory.

    python benchmarks/refine.py ../shared/captures/mitten
    python benchmarks/refine.py CAPTURE --method multi-light-alternating multi-light
    python benchmarks/refine.py --full-frame --images 20 --json
    python benchmarks/refine.py CAPTURE --first
    python benchmarks/refine.py --table

The first two run the command in a process of its own, after one run that compiles; peak_mib is an
upper bound there for captures that this script made itself.  --first begins with an empty cache of
compiled code: first_s is the run that compiles.  --table times a fixed number of rounds
in memory.  The full-frame object fills the image: as many unknowns as pixels.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

COMMAND = "from rakelight.cli import main; main()"
MEGAPIXELS = ((320, 320), (640, 480), (1280, 960), (2304, 1728))
IMAGES = (4, 8, 16, 32)
ROUNDS = 5


def full_frame(width: int, height: int, images: int) -> Any:
    """A capture whose wavy, painted object fills the image."""
    from rakelight.geometry.normals import normals_from_depth
    from rakelight.model import Camera, Capture
    from rakelight.photometry.forward import shading

    camera = Camera(width, height, 1.2 * width, 1.2 * width, (width - 1) / 2, (height - 1) / 2)
    v, u = np.mgrid[:height, :width].astype(float)
    waves = np.sin(u / 17) * np.cos(v / 23) + 3 * np.sin(u / 150 + v / 190)
    depth = 0.8 + 0.001 * waves
    mask = np.ones((height, width), dtype=bool)
    normals = normals_from_depth(depth, mask, camera)
    paint = 0.5 + 0.3 * np.stack([np.sin(u / 9), np.cos(v / 7), np.sin((u + v) / 11)], axis=-1)
    rng = np.random.default_rng(0)
    turn = np.linspace(0, 2 * np.pi, images, endpoint=False)
    vector = 0.8 * np.stack(
        [0.6 * np.cos(turn), 0.6 * np.sin(turn), np.full(images, -0.8)], axis=-1
    )
    photographs = np.empty((images, height, width, 3), dtype=np.uint8)
    for i in range(images):
        light = paint * shading(normals, vector[i], 0.08)[..., None]
        light += rng.normal(scale=0.005, size=light.shape)
        photographs[i] = np.clip(255 * light, 0, 255)
    sensor = depth[::2, ::2] + rng.normal(scale=0.002, size=depth[::2, ::2].shape)
    names = tuple(f"{i:03d}.png" for i in range(images))
    return Capture(photographs, sensor[None].astype(np.float32), mask, camera, names=names)


def growth(width: int, height: int, images: int) -> dict[str, Any]:
    """Time a fixed number of rounds on a full-frame capture in memory, everything compiled.

    The method alone: `refine` would keep the depth, which rounds cut short predict no worse.
    """
    from rakelight.methods.multi_light_alternating import METHOD, MultiLightAlternating
    from rakelight.model import silent
    from rakelight.prepare import prepare

    capture = full_frame(width, height, images)
    # No gain is small enough to stop for: every capture gets as many rounds.
    options = MultiLightAlternating(max_iterations=ROUNDS, tolerance=-np.inf)
    began = time.perf_counter()
    estimate = METHOD.run(prepare(capture), options, silent)
    seconds = time.perf_counter() - began
    assert estimate.iterations == ROUNDS
    megapixels = width * height / 1e6
    return {
        "megapixels": round(megapixels, 2),
        "photographs": images,
        "seconds": round(seconds, 2),
        "seconds per megapixel": round(seconds / megapixels, 2),
        "seconds per megapixel and photograph": round(seconds / megapixels / images, 3),
    }


def measure(capture: Path, output: Path, method: str) -> dict[str, Any]:
    """Run the command once and say what it took."""
    arguments = ["refine", str(capture), "-o", str(output), "--overwrite", "--json"]
    arguments += ["--method", method]
    began = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-c", COMMAND, *arguments], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    text = process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    wall_s = time.perf_counter() - began
    if status:
        raise SystemExit(f"refine failed on {capture}")
    said = json.loads(text)
    timings = said["timings_s"]
    return {
        "wall_s": round(wall_s, 2),
        "read_s": round(timings["read"], 2),
        "prepare_s": round(timings["prepare"], 2),
        "refine_s": round(timings["refine"], 2),
        "solve_s": round(timings["solve"], 2) if "solve" in timings else None,
        "rest_s": round(wall_s - timings["read"] - timings["prepare"] - timings["refine"], 2),
        "peak_mib": round(usage.ru_maxrss / 1024),
        "pixels": said["pixels"],
        "images": said["photographs"],
        "iterations": said["iterations"],
        "method": said["method"],
    }


def main() -> None:
    """Measure what the arguments ask for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("capture", nargs="?", type=Path)
    parser.add_argument("--full-frame", action="store_true", help="a made 1280 x 960 object")
    parser.add_argument("--images", type=int, default=20)
    parser.add_argument("--table", action="store_true", help="sizes and numbers of photographs")
    parser.add_argument("--method", nargs="+", default=["auto"], help="compared in the same run")
    parser.add_argument("--runs", type=int, default=3, help="the fastest counts")
    parser.add_argument("--first", action="store_true", help="with the run that compiles")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    if not (given.capture or given.full_frame or given.table):
        parser.error("name a capture, or --full-frame, or --table")

    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)

        def best(capture: Path, method: str) -> dict[str, Any]:
            if given.first:
                os.environ["NUMBA_CACHE_DIR"] = str(folder / f"compiled for {method}")
            first, *runs = [measure(capture, folder / "out", method) for _ in range(given.runs + 1)]
            best = min(runs, key=lambda run: run["wall_s"])
            return best | {"first_s": first["wall_s"]} if given.first else best

        cases: list[Path] = [given.capture] if given.capture else []
        if given.full_frame:
            from rakelight.capture import write_capture

            cases.append(folder / "full-frame")
            write_capture(full_frame(1280, 960, given.images), cases[-1])
        rows = [best(case, method) for case in cases for method in given.method]
    if given.table:
        growth(320, 320, 4)  # compiles
        rows += [growth(width, height, 8) for width, height in MEGAPIXELS]
        rows += [growth(640, 480, images) for images in IMAGES]
    if given.json:
        print(json.dumps(rows[0] if len(rows) == 1 else rows))
        return
    print("| " + " | ".join(rows[0]) + " |")
    print("|" + " --- |" * len(rows[0]))
    for row in rows:
        shown = ("" if value is None else str(value) for value in row.values())
        print("| " + " | ".join(shown) + " |")


if __name__ == "__main__":
    main()
