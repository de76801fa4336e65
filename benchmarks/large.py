"""Seconds and peak memory of refining large photographs, and how far off the result is.

    python benchmarks/large.py                               1, 4, 12, 24 megapixels, 8 and 20
    python benchmarks/large.py --megapixels 1 4 --photographs 8
    python benchmarks/large.py --memory 2GB
    python benchmarks/large.py --baseline ../other/src       beside the source of another commit
    python benchmarks/large.py --megapixels 1 --stages       seconds and peak of each stage

The object fills the image; its detail has the same size in pixels at every resolution, and the
depth sensor has 600 x 400 pixels.  Each run is a process of its own, from files to files, after one
that compiles.  peak_mb is the largest resident set, mapped files included; anonymous_mb that
without them, which is what a machine has to have.  A run that a source cannot do is a row with its
message.  The captures are kept in --folder, where one is named.
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
from threading import Event, Thread
from typing import Any

import numpy as np

SENSOR = (400, 600)  # rows, columns
# Megapixels -> pixels per sensor pixel, along each side.
FACTORS = {1: 2, 4: 4, 12: 7, 24: 10}
ROWS = 200  # of a strip
DISTANCE_M, NOISE_M = 0.8, 0.001
SOURCE = Path(__file__).resolve().parent.parent / "src"


def camera_of(factor: int) -> Any:
    """The colour camera whose image has `factor` pixels per sensor pixel."""
    from rakelight.model import Camera

    height, width = (factor * side for side in SENSOR)
    return Camera(width, height, 1.2 * width, 1.2 * width, (width - 1) / 2, (height - 1) / 2)


def depth_of(factor: int, rows: slice) -> Any:
    """(rows, W) the true depth, metres: a dome with waves, and detail of 12 to 200 pixels."""
    height, width = (factor * side for side in SENSOR)
    v, u = np.mgrid[rows, :width].astype(float)
    x, y = u / width - 0.5, v / width - 0.5 * height / width
    shape = 0.12 * (x**2 + y**2) + 0.006 * np.sin(11 * x + 2) * np.cos(9 * y)
    pixel_m = DISTANCE_M / (1.2 * width)
    detail = 1.4 * np.sin(u / 7) * np.cos(v / 9) * np.sin((u + 2 * v) / 61)
    detail += 4 * np.sin(u / 31 + 1.5 * np.sin(v / 47)) + 9 * np.cos(v / 83) * np.sin(u / 101)
    return DISTANCE_M + shape + pixel_m * detail


def write_capture(folder: Path, factor: int, photographs: int) -> None:
    """A capture folder whose photographs are rendered and kept a strip at a time."""
    from rakelight.capture.images import encode_png, encode_tiff
    from rakelight.geometry.normals import normals_from_depth
    from rakelight.photometry.forward import shading

    camera, random = camera_of(factor), np.random.default_rng(0)
    height, width = camera.shape
    turn = np.arange(photographs) * 2.4
    tilt = np.radians(15 + 25 * (np.arange(photographs) + 0.5) / photographs)
    toward = [np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), -np.cos(tilt)]
    lights = 0.8 * np.stack(toward, axis=-1)
    images = [np.empty((height, width, 3), np.uint8) for _ in range(photographs)]
    for top in range(0, height, ROWS):
        first, last = max(top - 1, 0), min(top + ROWS + 1, height)
        depth = depth_of(factor, slice(first, last))
        strip = camera.cropped(slice(first, last), slice(0, width))
        normals = normals_from_depth(depth, np.ones(depth.shape, bool), strip)
        v, u = np.mgrid[first:last, :width].astype(float)
        paint = [np.sin(u / 19) * np.cos(v / 77), np.cos(v / 17), np.sin((u + v) / 111)]
        paint = 0.5 + 0.3 * np.stack(paint, axis=-1)
        own = slice(top - first, min(top + ROWS, height) - first)
        for i, image in enumerate(images):
            light = (paint * shading(normals, lights[i], 0.06)[..., None])[own]
            light += random.normal(scale=0.005, size=light.shape)
            image[top : top + ROWS] = np.clip(np.rint(255 * light), 0, 255)
    for name in ("rgb", "depth"):
        (folder / name).mkdir(parents=True)
    for i in range(photographs):
        (folder / "rgb" / f"{i:03d}.png").write_bytes(encode_png(images[i]))
        images[i] = images[i][:0]
    rows = (depth_of(factor, slice(row, row + factor)) for row in range(0, height, factor))
    sensor = np.stack([each.reshape(factor, -1, factor).mean(axis=(0, 2)) for each in rows])
    sensor += random.normal(scale=NOISE_M, size=SENSOR)
    (folder / "depth" / "000.tiff").write_bytes(encode_tiff(sensor.astype(np.float32)))
    white = np.full((height, width), 255, np.uint8)
    (folder / "mask.png").write_bytes(encode_png(white))
    facts = {name: getattr(camera, name) for name in ("width", "height", "fx", "fy", "cx", "cy")}
    lines = ['encoding = "linear"', "[intrinsics]", *(f"{k} = {v}" for k, v in facts.items())]
    (folder / "capture.toml").write_text("\n".join(lines) + "\n")


def errors_of(result: Any, factor: int) -> dict[str, float]:
    """Of a result: root mean square error of the depth, mm, and mean one of normals, degrees."""
    from rakelight.geometry.normals import normals_from_depth

    camera = camera_of(factor)
    height, width = camera.shape
    squares, angles = [], []
    for top in range(0, height, ROWS):
        first, last = max(top - 1, 0), min(top + ROWS + 1, height)
        depth = depth_of(factor, slice(first, last))
        strip = camera.cropped(slice(first, last), slice(0, width))
        true = normals_from_depth(depth, np.ones(depth.shape, bool), strip)
        found = result.normals[first:last]
        cosine = np.einsum("hwk,hwk->hw", true, found)[1:-1]
        angles.append(np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean())
        squares.append(((result.depth[first:last] - depth) ** 2)[1:-1].mean())
    rmse_mm = 1000 * float(np.sqrt(np.mean(squares)))
    return {"rmse_mm": round(rmse_mm, 4), "mae_deg": round(float(np.mean(angles)), 3)}


# ---- the measured process


class Watch:
    """The stage that runs, its seconds, and the most memory that was resident in it."""

    def __init__(self) -> None:
        """Begin, with reading."""
        self.stage, self.since, self.end = "read", time.perf_counter(), Event()
        self.seconds: dict[str, float] = {}
        self.peak_mb: dict[str, float] = {}
        self.anonymous_mb = 0.0
        Thread(target=self._look, daemon=True).start()

    def _look(self) -> None:
        while not self.end.wait(0.02):
            lines = Path("/proc/self/status").read_text().splitlines()
            table = dict(line.split()[:2] for line in lines if line.startswith(("VmRSS", "Rss")))
            resident, anonymous = (int(table[name]) / 1000 for name in ("VmRSS:", "RssAnon:"))
            self.anonymous_mb = max(self.anonymous_mb, anonymous)
            self.peak_mb[self.stage] = max(self.peak_mb.get(self.stage, 0), resident)

    def begin(self, stage: str) -> None:
        """The next stage begins, or the same goes on."""
        now = time.perf_counter()
        self.seconds[self.stage] = self.seconds.get(self.stage, 0) + now - self.since
        self.stage, self.since = stage, now


def child(capture: Path, output: Path, memory: str) -> None:
    """Refine a capture folder and print, as JSON, what it took."""
    import rakelight

    watch, began = Watch(), time.perf_counter()
    given = {"memory": 1e9 * float(memory.removesuffix("GB"))} if memory else {}
    loaded = rakelight.load_capture(capture, **given)
    result = rakelight.refine(loaded, progress=lambda p: watch.begin(p.stage), **given)
    watch.begin("write")
    del loaded
    rakelight.save_result(result, output, overwrite=True)
    watch.begin("end")
    watch.end.set()
    print(
        json.dumps(
            {
                "wall_s": time.perf_counter() - began,
                "anonymous_mb": watch.anonymous_mb,
                "pixels": int(result.mask.sum()),
                "stages": {
                    name: [round(seconds, 2), round(watch.peak_mb.get(name, 0))]
                    for name, seconds in watch.seconds.items()
                },
                "report_mb": (output / "report.html").stat().st_size / 1e6,
            }
        )
    )


def measured(command: list[str], source: Path = SOURCE) -> dict[str, Any]:
    """Run a Python process with the package in `source`: what it prints as JSON, and what it took.

    cpu_s and peak_mb, the largest resident set, are the system's.  Where it fails: the last line.
    """
    process = subprocess.Popen(
        [sys.executable, *command],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(source)},
    )
    assert process.stdout is not None
    assert process.stderr is not None
    text, errors = process.stdout.read(), process.stderr.read()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if status:
        last = errors.strip().splitlines()[-1:] or [f"ended by signal {-process.returncode}"]
        return {"failed": last[0]}
    cpu_s = usage.ru_utime + usage.ru_stime
    return {**json.loads(text), "cpu_s": cpu_s, "peak_mb": usage.ru_maxrss / 1024 * 1.048576}


def measure(capture: Path, output: Path, source: Path, memory: str) -> dict[str, Any]:
    """Refine a capture with the package in `source`; its figures, or why it failed."""
    command = [__file__, "--child", str(capture), str(output), "--memory", memory]
    return measured(command, source)


def row_of(
    folder: Path, megapixels: int, photographs: int, source: Path, memory: str
) -> dict[str, Any]:
    """One row of the table; the capture is made where it is missing."""
    import rakelight

    factor = FACTORS[megapixels]
    capture, output = folder / f"{megapixels}mp-{photographs}", folder / "out"
    if not capture.exists():
        write_capture(capture, factor, photographs)
    found = measure(capture, output, source, memory)
    facts: dict[str, Any] = {"megapixels": megapixels, "photographs": photographs}
    if "failed" in found:
        return facts | found
    pixels = found["pixels"]
    return {
        **facts,
        "seconds": round(found["wall_s"], 1),
        "seconds_per_megapixel": round(1e6 * found["wall_s"] / pixels, 2),
        "cpu_s_per_megapixel": round(1e6 * found["cpu_s"] / pixels, 2),
        "peak_mb": round(found["peak_mb"]),
        "anonymous_mb": round(found["anonymous_mb"]),
        "bytes_per_pixel": round(1e6 * found["anonymous_mb"] / pixels),
        "report_mb": round(found["report_mb"], 1),
        **errors_of(rakelight.load_result(output), factor),
        "stages": found["stages"],
    }


def table(rows: list[dict[str, Any]], as_json: bool = False) -> None:
    """Print the rows as a table, but for their stages; or as JSON."""
    if as_json:
        print(json.dumps(rows))
        return
    names = [name for name in max(rows, key=len) if name != "stages"]
    print("| " + " | ".join(names) + " |")
    print("|" + " --- |" * len(names))
    for row in rows:
        print("| " + " | ".join(str(row.get(name, "")) for name in names) + " |")
        if "failed" in row:
            print(f"  {row['failed']}")


def shown(rows: list[dict[str, Any]], stages: bool, as_json: bool) -> None:
    """Print the rows as a table, the stages below it; or all as JSON."""
    table(rows, as_json)
    for row in rows if stages and not as_json else ():
        print(f"\n{row['megapixels']} megapixels, {row['photographs']} photographs: s, MB")
        for name, (seconds, peak) in row.get("stages", {}).items():
            print(f"  {name:34} {seconds:8.2f} {peak:8}")


def main() -> None:
    """Measure what the arguments ask for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--megapixels", nargs="+", type=int, default=[*FACTORS], choices=[*FACTORS])
    parser.add_argument("--photographs", nargs="+", type=int, default=[8, 20])
    parser.add_argument("--memory", default="", help="the limit, as 4GB")
    parser.add_argument("--baseline", type=Path, help="a source folder to compare with")
    parser.add_argument("--folder", type=Path, help="where captures are kept")
    parser.add_argument("--stages", action="store_true", help="print every stage, too")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--child", nargs=2, type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.child:
        child(*given.child, given.memory)
        return
    with tempfile.TemporaryDirectory() as scratch:
        folder, rows = given.folder or Path(scratch), []
        sources = {"this": SOURCE, **({"baseline": given.baseline} if given.baseline else {})}
        for name, source in sources.items():  # compiles
            row_of(folder, 1, 3, source, given.memory if name == "this" else "")
        for megapixels in given.megapixels:
            for photographs in given.photographs:
                for name, source in sources.items():
                    memory = given.memory if name == "this" else ""
                    found = row_of(folder, megapixels, photographs, source, memory)
                    rows.append({"source": name, **found})
    shown(rows, given.stages, given.json)


if __name__ == "__main__":
    main()
