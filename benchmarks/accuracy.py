"""Where the errors of a method lie, on the paper's bust: the tables of docs/results/accuracy.md.

    python benchmarks/accuracy.py photographs          against the number of photographs
    python benchmarks/accuracy.py causes               with one difficulty at a time taken away
    python benchmarks/accuracy.py limits               what a depth map of that size can hold
    python benchmarks/accuracy.py slant                against the surface's slant to the camera
    python benchmarks/accuracy.py maps -o out/maps     pictures of the errors
    python benchmarks/accuracy.py scans                laser scans, white depth noise
    python benchmarks/accuracy.py hard                 shadows, highlights, near lights together
    python benchmarks/accuracy.py flat                 near lights over low relief, several draws
    python benchmarks/accuracy.py scales               a depth sensor 1, 2 and 4 times coarser
    python benchmarks/accuracy.py noise                the paper's sensor, from its input's errors
    python benchmarks/accuracy.py confidence           how it ranks the normals' errors

`off the jumps` leaves out 4 pixels around the depth jumps, which are neighbouring pixels whose
true depths differ by more than 5 mm.  `smooth` is the rms of the depth error under a Gaussian of
10 pixels: what is wrong with the shape as a whole.  `lights` is the mean angle between the
estimated and the true directions.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import binary_dilation, gaussian_filter
from scipy.stats import spearmanr

from rakelight.capture.images import encode_png
from rakelight.geometry.camera import pixel_rays
from rakelight.geometry.normals import surface_normals
from rakelight.methods.levels import finest_level
from rakelight.methods.multi_light.bas_relief import nearest_bas_relief
from rakelight.methods.multi_light.noise import estimate_equal_intensity_weight
from rakelight.metrics import (
    depth_error_map_mm,
    evaluate_depth,
    evaluate_maps,
    normal_error_map_deg,
)
from rakelight.model import Array, Camera, Capture, Floats, Lights, Mask, Result, Truth
from rakelight.paper.scenes import PAPER_OPTIONS, paper_object
from rakelight.photometry.images import LightParameters
from rakelight.pictures.colors import color_errors
from rakelight.pictures.montage import side_by_side
from rakelight.pictures.shown import object_window
from rakelight.pipeline import refine
from rakelight.prepare import prepare
from rakelight.solve import assemble, solve
from rakelight.synthetic import (
    DEMO_OPTIONS,
    DepthNoise,
    SceneOptions,
    Shape,
    calibrate_noise,
    make_albedo,
    make_shape,
    render_scene,
    shape_from_file,
)
from rakelight.synthetic.noise import PAPER_NOISE, add_depth_noise

JUMP_M = 0.005
AROUND_PX = 4
SMOOTH_PX = 10
DEPTH_RANGE_MM, NORMAL_RANGE_DEG = 5.0, 30.0
DRAWS = 8

HARD_NOISE = DepthNoise(rms_mm=3.3, correlation_length_px=14.0)
DIFFICULTIES: dict[str, Any] = {"cast_shadows": True, "specular": 0.15, "lamp_distance_m": 0.6}

Scene = tuple[Capture, Truth]


def near_jumps(depth_m: Array) -> Mask:
    """(H, W) within `AROUND_PX` of two neighbours whose depths differ by more than `JUMP_M`."""
    jump = np.zeros(depth_m.shape, bool)
    for axis in (0, 1):
        with np.errstate(invalid="ignore"):
            steep = np.abs(np.diff(depth_m, axis=axis)) > JUMP_M
        jump |= np.insert(steep, 0, False, axis) | np.insert(steep, steep.shape[axis], False, axis)
    return np.asarray(binary_dilation(jump, iterations=AROUND_PX))


def smooth_rms_mm(depth_m: Array, truth: Truth) -> float:
    """RMS over the object of the depth error's local mean."""
    mask = truth.mask
    error = np.where(mask, np.nan_to_num(depth_m - truth.depth), 0.0)
    weight = gaussian_filter(mask.astype(float), SMOOTH_PX)
    mean = gaussian_filter(error, SMOOTH_PX)[mask] / weight[mask]
    return float(1000 * np.sqrt(np.mean(mean**2)))


def lights_deg(estimated: Lights, true: Lights | None) -> float:
    """Mean angle between directions."""
    if true is None:
        return float("nan")
    cosine = np.sum(estimated.direction * true.direction, axis=-1)
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean())


def line(name: str, method: str, scene: Scene) -> str:
    """Refine a scene; a line of the table."""
    capture, truth = scene
    result = refine(capture, method)
    kept = truth.mask & ~near_jumps(truth.depth)
    whole = evaluate_maps(result.depth, result.normals, truth)
    off = evaluate_maps(result.depth, result.normals, truth, kept)
    numbers = [
        f"{errors.depth.rmse_mm:.2f} | {errors.normals.mae_deg:.2f}" for errors in (whole, off)
    ]
    numbers.append(f"{smooth_rms_mm(result.depth, truth):.2f}")
    numbers.append(f"{lights_deg(result.lights, truth.lights):.2f}")
    return f"| {name} | " + " | ".join(numbers) + " |"


def photographs(arguments: argparse.Namespace) -> Iterator[str]:
    """A line for each number of photographs."""
    yield from header("photographs")
    bust = paper_object()
    for count in arguments.counts:
        scene = make(arguments, bust, photographs=count)
        yield line(str(count), arguments.method, scene)


def causes(arguments: argparse.Namespace) -> Iterator[str]:
    """A line for each difficulty taken away."""
    yield from header("what is changed")
    bust = paper_object()
    yield line("nothing", arguments.method, make(arguments, bust))
    yield line(
        "no noise in the photographs", arguments.method, make(arguments, bust, image_noise=0)
    )
    yield line(
        "a perfect depth map", arguments.method, make(arguments, bust, depth_noise=DepthNoise())
    )
    for name in ("vase", "coin"):
        scene = make(arguments, make_shape(name))
        yield line(f"the {name} for the bust", arguments.method, scene)


def limits(arguments: argparse.Namespace) -> Iterator[str]:
    """What is lost without any photograph: by taking differences, and by fitting one surface."""
    capture, truth = make(arguments, paper_object())
    mask, camera = truth.mask, capture.camera
    kept = mask & ~near_jumps(truth.depth)
    true = truth.depth.astype(float)
    yield from header("depth map")
    for name, depth in (
        ("the true depth", true),
        ("fitted to the true normals", fitted_to_normals(truth, camera, mask)),
        ("the same, those near jumps left out", fitted_to_normals(truth, camera, kept)),
        ("the true one, bas-relief from the sensor", true_but_relief(capture, truth, steady=False)),
        ("the same, and from the lights' brightness", true_but_relief(capture, truth, steady=True)),
    ):
        normals = surface_normals(depth, mask, camera)
        whole, off = (evaluate_maps(depth, normals, truth, where) for where in (mask, kept))
        numbers = [f"{e.depth.rmse_mm:.2f} | {e.normals.mae_deg:.2f}" for e in (whole, off)]
        yield (
            f"| {name} | "
            + " | ".join([*numbers, f"{smooth_rms_mm(depth, truth):.2f}", "-"])
            + " |"
        )
    share = 1 - np.count_nonzero(kept) / np.count_nonzero(mask)
    yield f"\nnear the jumps: {share:.1%} of the object"


def true_but_relief(capture: Capture, truth: Truth, *, steady: bool) -> Array:
    """The true depth (H, W), but for the four numbers that photographs leave to the sensor.

    A distant lamp's photographs are the same for all surfaces that a bas-relief transform relates.
    steady : whether the true lights' brightness has its say
    """
    assert truth.lights is not None
    prepared = prepare(capture)
    level = finest_level(prepared, unbiased=True)
    true = np.where(prepared.mask, truth.depth[prepared.rows, prepared.columns], prepared.depth_m)
    lights = LightParameters.distant(truth.lights.direction, truth.lights.ambient)
    weight = estimate_equal_intensity_weight(level, np.log(true), prepared) if steady else 0.0
    log_depth, _ = nearest_bas_relief(level, np.log(true), lights, weight)
    return prepared.embed(np.exp(log_depth), np.nan)


def fitted_to_normals(truth: Truth, camera: Camera, known: Mask) -> Array:
    """The depth step of all methods, were the photographs to tell the `known` normals exactly.

    The true depth has a millionth of the gradients' weight; it only holds the whole in place.
    """
    mask, n = truth.mask, np.where(truth.mask[..., None], truth.normals, [0.0, 0.0, -1.0])
    x, y = pixel_rays(camera)
    u, v = n[..., 0] / camera.fx, n[..., 1] / camera.fy
    length = -1 / (n[..., 2] + x * u + y * v)
    weight = np.where(known, length**-2, 0.0)
    gradient = np.stack([length * u, length * v], axis=-1)
    tensor = np.stack([weight, 0 * weight, weight], axis=-1)
    log_depth = np.where(mask, np.log(np.where(mask, truth.depth, 1.0)), 0.0)
    system = assemble(
        mask, tensor, weight[..., None] * gradient, 1e-6 * weight[known].mean() * mask, log_depth
    )
    return np.where(mask, np.exp(solve(system, start=log_depth).value), np.nan)


def slant(arguments: argparse.Namespace) -> Iterator[str]:
    """A line for each range of angles between the true normal and the optical axis."""
    _, truth, result = refined(arguments)
    depth = depth_error_map_mm(result.depth, truth.depth, truth.mask)
    normal = normal_error_map_deg(result.normals, truth.normals, truth.mask)
    angle = np.degrees(np.arccos(np.clip(-truth.normals[..., 2], -1, 1)))
    yield "| slant, degrees | share of the object | RMSE, mm | MAE, deg |"
    yield "| --- | --- | --- | --- |"
    for low, high in ((0, 30), (30, 50), (50, 60), (60, 70), (70, 90)):
        here = truth.mask & (angle >= low) & (angle < high)
        share = np.count_nonzero(here) / np.count_nonzero(truth.mask)
        rmse = np.sqrt(np.mean(depth[here] ** 2))
        yield f"| {low} to {high} | {share:.0%} | {rmse:.2f} | {normal[here].mean():.2f} |"


def maps(arguments: argparse.Namespace) -> Iterator[str]:
    """One picture: depth errors above, normal errors below; before left, after right."""
    capture, truth, result = refined(arguments)
    window = object_window(truth.mask)
    before = surface_normals(result.prepared_depth, truth.mask, capture.camera)
    rows = []
    for errors, largest in (
        ([depth_error_map_mm(d, truth.depth, truth.mask)
          for d in (result.prepared_depth, result.depth)], DEPTH_RANGE_MM),
        ([normal_error_map_deg(n, truth.normals, truth.mask)
          for n in (before, result.normals)], NORMAL_RANGE_DEG),
    ):  # fmt: skip
        rows.append(side_by_side(*(color_errors(error[window], largest) for error in errors)))
    arguments.output.mkdir(parents=True, exist_ok=True)
    file = arguments.output / f"{arguments.scenario}.png"
    file.write_bytes(encode_png(np.concatenate(rows)))
    yield str(file)


def scans(arguments: argparse.Namespace) -> Iterator[str]:
    """Laser scans under white depth noise of 3.3 mm, 12 distant lights, three paints."""
    yield from _scans(arguments, {"photographs": 12, "depth_noise": DepthNoise(rms_mm=3.3)})


def hard(arguments: argparse.Namespace) -> Iterator[str]:
    """Near lights, cast shadows and highlights together, correlated depth noise of 3.3 mm."""
    conditions = {"photographs": 16, "depth_noise": HARD_NOISE, **DIFFICULTIES}
    yield from _scans(arguments, conditions)


def flat(arguments: argparse.Namespace) -> Iterator[str]:
    """Low relief, of which near lights show fall-off above all; 16 photographs, draws of it all."""
    yield "| shape | draw | near lights: RMSE, mm | MAE, deg | and the rest: RMSE, mm | MAE, deg |"
    yield "|" + " --- |" * 6
    for name in ("coin", "cloth"):
        for seed in range(4):
            numbers = []
            for conditions in ({"lamp_distance_m": 0.6}, DIFFICULTIES):
                options = SceneOptions(
                    photographs=16, depth_noise=HARD_NOISE, seed=seed, **conditions
                )
                capture, truth = render_scene(
                    make_shape(name), make_albedo(arguments.scenario), options
                )
                result = refine(capture, arguments.method)
                errors = evaluate_maps(result.depth, result.normals, truth)
                numbers += [f"{errors.depth.rmse_mm:.2f}", f"{errors.normals.mae_deg:.2f}"]
            yield f"| {name} | {seed} | " + " | ".join(numbers) + " |"


def _scans(arguments: argparse.Namespace, conditions: dict[str, Any]) -> Iterator[str]:
    columns = ["shape", "paint", "input RMSE, mm", "input MAE, deg", "RMSE, mm", "MAE, deg"]
    columns += ["true depth's MAE, deg", "seconds"]
    yield "| " + " | ".join(columns) + " |"
    yield "|" + " --- |" * len(columns)
    files = sorted(arguments.shapes.glob("*.npz"))
    shapes = [shape_from_file(file) for file in files] + [make_shape("vase")]
    figures = []
    for shape in shapes:
        for paint in ("simple", "pattern", "complicated"):
            options = SceneOptions(**conditions)
            capture, truth = render_scene(shape, make_albedo(paint), options)
            began = time.perf_counter()
            result = refine(capture, arguments.method)
            seconds = time.perf_counter() - began
            before = evaluate_depth(result.prepared_depth, capture.camera, truth)
            after = evaluate_maps(result.depth, result.normals, truth)
            floor = evaluate_depth(truth.depth, capture.camera, truth)
            numbers = [
                number
                for score in (before, after)
                for number in (score.depth.rmse_mm, score.normals.mae_deg)
            ]
            numbers.append(floor.normals.mae_deg)
            figures.append(numbers)
            cells = " | ".join(f"{number:.2f}" for number in numbers)
            yield f"| {shape.name} | {paint} | {cells} | {seconds:.1f} |"
    cells = " | ".join(f"{number:.2f}" for number in np.mean(figures, axis=0))
    yield f"| mean | | {cells} | |"


def scales(arguments: argparse.Namespace) -> Iterator[str]:
    """Laser scans, depth pixels 1, 2 and 4 colour pixels wide; 16 lights, white depth noise."""
    yield "| shape | scale | RMSE, mm | MAE, deg | MAE over that at scale 1, deg |"
    yield "|" + " --- |" * 5
    for file in sorted(arguments.shapes.glob("*.npz")):
        at_one = 0.0
        for factor in (1, 2, 4):
            options = SceneOptions(
                photographs=16, depth_factor=factor, depth_noise=DepthNoise(rms_mm=3.3)
            )
            capture, truth = render_scene(
                shape_from_file(file), make_albedo(arguments.scenario), options
            )
            result = refine(capture, arguments.method)
            errors = evaluate_maps(result.depth, result.normals, truth)
            mae_deg = errors.normals.mae_deg
            at_one = mae_deg if factor == 1 else at_one
            numbers = f"{errors.depth.rmse_mm:.2f} | {mae_deg:.2f} | {mae_deg - at_one:.2f}"
            yield f"| {file.stem} | {factor} | {numbers} |"


def noise(arguments: argparse.Namespace) -> Iterator[str]:
    """The depth noise that leaves the errors of the paper's input; beside `PAPER_NOISE`."""

    def errors(tried: DepthNoise) -> tuple[float, float]:
        capture, truth = make(arguments, paper_object(), depth_noise=tried, photographs=1)
        prepared = prepare(capture)
        scores = evaluate_depth(prepared.embed(prepared.depth_m, np.nan), capture.camera, truth)
        return scores.depth.rmse_mm, scores.normals.mae_deg

    yield "| depth noise | rms, mm | correlated over, px | RMSE, mm | MAE, deg |"
    yield "| --- | --- | --- | --- | --- |"
    for name, tried in (("PAPER_NOISE", PAPER_NOISE), ("found", calibrate_noise(errors))):
        numbers = (tried.rms_mm, tried.correlation_length_px, *errors(tried))
        yield f"| {name} | " + " | ".join(f"{number:.4g}" for number in numbers) + " |"


def confidence(arguments: argparse.Namespace) -> Iterator[str]:
    """How confidence ranks the normals' errors, beside all that could be known of these.

    Of scenes like the demo's, each under draws of the noise: Spearman's rank correlation of the
    confidence with minus the errors, and of the rms of the other draws' errors with the errors.
    """
    columns = ["scene", "normals", "MAE, deg", "confidence", "the other draws' rms"]
    yield "| " + " | ".join(columns) + " |"
    yield "|" + " --- |" * len(columns)
    for name in ("vase", "head", "cloth", "sphere"):
        for words, conditions in (("", {}), (" with all difficulties", DIFFICULTIES)):
            options = replace(DEMO_OPTIONS, **conditions)
            exact = replace(options, image_noise=0.0, depth_noise=DepthNoise(rms_mm=0.0))
            scene = render_scene(make_shape(name), make_albedo("pattern"), exact)
            draws = [_of_a_draw(scene, options, seed, arguments) for seed in range(DRAWS)]
            known, *both = (np.stack(each) for each in zip(*draws, strict=True))
            for kind, errors in zip(("finer", "the depth map's"), both, strict=True):
                squares = errors**2
                other = np.sqrt((squares.sum(axis=0) - squares) / (DRAWS - 1))
                ranks = [
                    np.mean([spearmanr(a, b).statistic for a, b in zip(says, errors, strict=True)])
                    for says in (-known, other)
                ]
                numbers = " | ".join(f"{number:.2f}" for number in (errors.mean(), *ranks))
                yield f"| {name}{words} | {kind} | {numbers} |"


def _of_a_draw(
    scene: Scene, options: SceneOptions, seed: int, arguments: argparse.Namespace
) -> tuple[Floats, Floats, Floats]:
    """(P,) confidence, and errors of the finer and of the depth map's normals, degrees.

    scene : without noise, which is drawn anew
    """
    capture, truth = scene
    rng = np.random.default_rng(seed)
    noise = options.image_noise * rng.standard_normal(capture.photographs.shape)
    values = np.clip(np.rint(capture.photographs + capture.white * noise), 0, capture.white)
    depth_m = [add_depth_noise(depth, options.depth_noise, [seed, 1]) for depth in capture.depth_m]
    noisy = replace(
        capture, photographs=values.astype(capture.photographs.dtype), depth_m=np.stack(depth_m)
    )
    result = refine(noisy, arguments.method)
    plain = surface_normals(result.depth, result.mask, capture.camera)
    finer, coarser = (
        normal_error_map_deg(normals, truth.normals, truth.mask)[truth.mask]
        for normals in (result.normals, plain)
    )
    return result.confidence[truth.mask], finer, coarser


def refined(arguments: argparse.Namespace) -> tuple[Capture, Truth, Result]:
    """The paper's scene and its result."""
    capture, truth = make(arguments, paper_object())
    return capture, truth, refine(capture, arguments.method)


def make(arguments: argparse.Namespace, shape: Shape, **changes: Any) -> Scene:
    """The paper's scene with changes."""
    camera = PAPER_OPTIONS.camera
    assert camera is not None
    options: SceneOptions = replace(PAPER_OPTIONS, camera=camera.scaled(arguments.size), **changes)
    return render_scene(shape, make_albedo(arguments.scenario), options)


def header(first: str) -> list[str]:
    """The table's first two lines."""
    columns = [first, "RMSE, mm", "MAE, deg", "off the jumps RMSE, mm", "off the jumps MAE, deg"]
    columns += ["smooth, mm", "lights, deg"]
    return ["| " + " | ".join(columns) + " |", "|" + " --- |" * len(columns)]


def main() -> None:
    """Print the table that is asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    tables = {
        f.__name__: f
        for f in (
            photographs,
            causes,
            limits,
            slant,
            maps,
            scans,
            hard,
            flat,
            scales,
            noise,
            confidence,
        )
    }
    parser.add_argument("table", choices=tables)
    parser.add_argument("--method", default="multi-light-alternating")
    parser.add_argument("--scenario", default="pattern", help="simple, pattern, complicated")
    parser.add_argument("--size", type=float, default=1.0, help="scale of 640 x 480")
    parser.add_argument("--counts", type=int, nargs="+", default=[4, 8, 12, 20])
    parser.add_argument("--shapes", type=Path, default=Path("../shared/shapes"), help="*.npz")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/maps"))
    arguments = parser.parse_args()
    for text in tables[arguments.table](arguments):
        print(text, flush=True)


if __name__ == "__main__":
    main()
