"""Flat engraved objects, drawn at random, refined: seen obliquely, lit from near and from far.

    python benchmarks/flat_objects.py --seeds 0:50 [--jobs 2] [-o out/flat.json]
    python benchmarks/flat_objects.py --compare before.json after.json

A plate that fills the view, slanted by 0 to 50 degrees, with engraved patches a fraction of a pixel
deep; 8 to 16 lamps around its normal, at 1 to 15 of its widths.  Such an object tells little of its
lights.  Printed per plate: the normals' mean angle, prepared, refined and expected (the median of
`normal_sigma`), degrees; the depth's root mean square, mm; how far the lights are off, degrees.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from rakelight import Capture, Truth, refine
from rakelight.geometry.camera import back_project
from rakelight.geometry.grid import area_mean
from rakelight.geometry.normals import surface_normals
from rakelight.metrics import evaluate_maps
from rakelight.model import Camera, Floats
from rakelight.synthetic import DepthNoise, add_depth_noise
from rakelight.synthetic.appearance import LightSources, Materials, photographed
from rakelight.synthetic.implicit import Solid, trace
from random_captures import lights_deg, processes, seeds

WIDTH, HEIGHT = 160, 120
RAYS = 2  # samples per pixel along each side


def plate(seed: int) -> tuple[Capture, Truth, str]:
    """A capture, its truth and what it is."""
    rng = np.random.default_rng(seed)
    pixel_m = np.exp(rng.uniform(np.log(3e-4), np.log(5e-3)))  # of a pixel on the plate's middle
    focal = 1.3 * WIDTH
    distance_m = focal * pixel_m
    camera = Camera(WIDTH, HEIGHT, focal, focal, (WIDTH - 1) / 2, (HEIGHT - 1) / 2)
    slant, toward = np.radians(rng.uniform(0, 50)), rng.uniform(0, 2 * np.pi)
    across = np.sin(slant) * np.array([np.cos(toward), np.sin(toward)])
    normal = np.array([-across[0], across[1], -np.cos(slant)])  # camera frame
    deep_m = rng.uniform(0.2, 1.0) * pixel_m
    turns, phases = rng.uniform(0, np.pi, 5), rng.uniform(0, 2 * np.pi, 5)
    lengths_m = rng.uniform(10, 40, 5) * pixel_m

    def field(x: Floats, y: Floats, z: Floats) -> Floats:
        """0 on the surface, of points in metres."""
        waves = sum(
            np.sin(2 * np.pi * (x * np.cos(turn) + y * np.sin(turn)) / length_m + phase)
            for turn, length_m, phase in zip(turns, lengths_m, phases, strict=True)
        )
        plane = (across[0] * x + across[1] * y) / np.cos(slant)
        return np.asarray(z - plane - deep_m / 2 * np.tanh(4 * waves))

    solid = Solid(field, distance_m, radius_m=0.95 * distance_m, steepness=6.0)
    surface = trace(solid, camera.scaled(RAYS))
    depth, normals = area_mean(surface.depth, RAYS), area_mean(surface.normals, RAYS)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    mask = area_mean(surface.mask, RAYS) == 1  # what is too far away is not seen
    middle_m = back_project(depth, camera)[mask].mean(axis=0)

    lamps = int(rng.integers(8, 17))
    ring, widths = rng.uniform() < 0.4, np.exp(rng.uniform(0, np.log(15)))
    tilt = np.radians(np.full(lamps, 40.0) if ring else rng.uniform(25, 55, lamps))
    turn = 2 * np.pi * (np.arange(lamps) + rng.uniform(-0.3, 0.3, lamps) * (not ring)) / lamps
    one = np.cross(normal, [0.0, 1.0, 0.0])
    one /= np.linalg.norm(one)
    sides = np.cos(turn)[:, None] * one + np.sin(turn)[:, None] * np.cross(normal, one)
    directions = np.cos(tilt)[:, None] * normal + np.sin(tilt)[:, None] * sides
    lights = LightSources(
        toward=directions[:, None],
        gain=np.ones((lamps, 3)),
        ambient=np.full((lamps, 3), rng.uniform(0.02, 0.2)),
        middle_m=middle_m,
        distance_m=np.full((lamps, 1), widths * WIDTH * pixel_m),
    )
    matte = np.zeros(np.count_nonzero(surface.mask), np.float32)
    materials = Materials(np.full((matte.size, 3), 0.6, np.float32), matte, matte, 1.0)
    light = photographed(
        surface, camera.scaled(RAYS), RAYS, surface.mask, materials, lights,
        cast_shadows=True, bounce=False,
    )  # fmt: skip
    level = 0.8 / float(np.quantile(light[:, mask], 0.995))
    values = level * light + rng.uniform(0.003, 0.01) * rng.normal(size=light.shape)
    factor = int(rng.choice([2, 4]))
    noise = DepthNoise(
        rms_mm=1000 * pixel_m * rng.uniform(0.2, 1.0),
        correlation_length_px=float(rng.uniform(0, 4)),
    )
    capture = Capture(
        photographs=np.rint(65535 * np.clip(values, 0, 1)).astype(np.uint16),
        depth_m=add_depth_noise(area_mean(depth, factor), noise, seed)[None],
        mask=mask,
        camera=camera,
    )
    shown = (np.where(mask[..., None], each, np.nan) for each in (depth[..., None], normals))
    depth, normals = (each.squeeze() for each in shown)
    truth = Truth(depth, normals, np.full((*depth.shape, 3), 0.6), lights.as_lights(level))
    kind = "ring" if ring else "all round"
    what = f"{np.degrees(slant):2.0f} deg, lamps at {widths:4.1f} widths, {kind}"
    return capture, truth, what


def scores(seed: int) -> dict[str, Any]:
    """What one plate is, and its errors."""
    capture, truth, what = plate(seed)
    result = refine(capture)

    def errors(depth: Floats, normals: Floats) -> list[float]:
        """Degrees, mm."""
        found = evaluate_maps(depth, normals, truth)
        return [found.normals.mae_deg, found.depth.rmse_mm]

    before, sigma = result.prepared_depth, result.normal_sigma
    return {
        "seed": seed,
        "what": what,
        "prepared": errors(before, surface_normals(before, np.isfinite(before), capture.camera)),
        "refined": errors(result.depth, result.normals),
        "expected": np.nan if sigma is None else float(np.nanmedian(sigma)),
        "lights": lights_deg(result.lights, truth.lights) or np.nan,
        "warnings": [each.code for each in result.findings if each.severity == "warning"],
    }


def summary(records: list[dict[str, Any]]) -> str:
    """Medians and tails of all plates."""
    prepared, refined = (
        np.array([each[name] for each in records]) for name in ("prepared", "refined")
    )
    lost = refined[:, 0] > prepared[:, 0] / 2
    silent = [not each["warnings"] for each in records]
    return (
        f"{len(records)} plates: angle {np.median(refined[:, 0]):.2f} (median), "
        f"{np.quantile(refined[:, 0], 0.9):.2f} (90 %), prepared {np.median(prepared[:, 0]):.2f}; "
        f"more than half of the prepared angle {np.count_nonzero(lost)}, of them without a "
        f"warning {np.count_nonzero(lost & silent)}; depth worse than prepared by 2 % "
        f"{np.count_nonzero(refined[:, 1] > 1.02 * prepared[:, 1])}"
    )


def main() -> None:
    """Print a line for each plate, and a summary."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=seeds, default=range(50), help="FIRST:END")
    parser.add_argument("--jobs", type=int, default=1, help="processes of one thread each")
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--compare", nargs=2, type=Path, metavar="JSON")
    arguments = parser.parse_args()
    if arguments.compare:
        runs = [json.loads(path.read_text()) for path in arguments.compare]
        ratios = np.log([[b / a for a, b in zip(x["refined"], y["refined"], strict=True)]
                         for x, y in zip(*runs, strict=True)])  # fmt: skip
        angle, depth = np.exp(ratios.mean(axis=0))
        better, worse = (np.count_nonzero(s * ratios[:, 0] > np.log(1.05)) for s in (-1, 1))
        print(*map(summary, runs), sep="\n")
        print(f"angle {angle:.3f}, depth {depth:.3f}; better by 5 %: {better}, worse: {worse}")
        return
    records = []
    with processes(arguments.jobs) as pool:
        for found in pool.imap(scores, arguments.seeds):
            records.append(found)
            (before, _), (after, _) = found["prepared"], found["refined"]
            depths = f"{found['prepared'][1]:7.3f} to {found['refined'][1]:7.3f} mm"
            print(
                f"{found['seed']:4d} {found['what']:42s} | {before:5.2f} to {after:5.2f}, expected "
                f"{found['expected']:5.2f} | {depths} | lights {found['lights']:5.1f}",
                " ".join(found["warnings"]), flush=True,
            )  # fmt: skip
    print(summary(records))
    if arguments.output:
        arguments.output.write_text(json.dumps(records))


if __name__ == "__main__":
    main()
