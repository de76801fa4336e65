"""The pictures and figures of docs/how-to/capture.md: good captures and what spoils them.

    python benchmarks/capture_pictures.py docs/pictures --seeds 0:1

Every row is a rendered head (cast shadows, highlights, a noisy depth map of half the resolution)
that was photographed in one way: what `rakelight check` says first, and the errors of the result
against the truth, medians over the seeds.  The pictures are of the first seed: check's plot of the
lights, a photograph, and the refined surface as clay.  Needs Debian's Chromium for the plots.
"""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np

from rakelight import check_capture, evaluate, refine
from rakelight.capture.images import encode_jpeg
from rakelight.errors import RakelightError
from rakelight.geometry.normals import surface_normals
from rakelight.metrics import evaluate_maps
from rakelight.model import Array, Capture, Floats, Truth
from rakelight.pictures.clay import shaded
from rakelight.pictures.shown import object_window
from rakelight.prepare import prepare
from rakelight.prepare.linear import srgb, to_linear
from rakelight.report.check_page import check_html
from rakelight.synthetic import DepthNoise, SceneOptions, make_albedo, make_shape, render_scene

SHAPE, PAINT, SCALE = "head", "complicated", 0.5
USUAL = SceneOptions(
    tilt_deg=(30.0, 50.0), cast_shadows=True, specular=0.15, specular_exponent=20.0,
    ambient=0.15, image_noise=0.004, depth_factor=2,
    depth_noise=DepthNoise(rms_mm=2.5, correlation_length_px=6.0, step_mm=1.0),
)  # fmt: skip
TILE_PX, GAP_PX = 232, 6  # sides of a tile, and between tiles
DARK = 32


@dataclass(frozen=True)
class Case:
    """One way of taking a capture; `take` renders it by a seed.  `tile`: its caption, if drawn."""

    topic: str
    name: str
    take: Callable[[int], tuple[Capture, Truth]]
    tile: str = ""


@cache
def rendered(options: SceneOptions) -> tuple[Capture, Truth]:
    """The head under those options."""
    shape = make_shape(SHAPE)
    options = replace(options, camera=shape.camera.scaled(SCALE))
    return render_scene(shape, make_albedo(PAINT), options)


def taken(**changes: object) -> Callable[[int], tuple[Capture, Truth]]:
    """Rendered with some options changed."""
    return lambda seed: rendered(replace(USUAL, seed=seed, **changes))


def changed(change: Callable[[Capture, int], Capture]) -> Callable[[int], tuple[Capture, Truth]]:
    """The usual capture, changed afterwards."""

    def take(seed: int) -> tuple[Capture, Truth]:
        capture, truth = rendered(replace(USUAL, seed=seed))
        return change(capture, seed), truth

    return take


def from_the_right(seed: int) -> tuple[Capture, Truth]:
    """12 lights of the usual tilts within 60 degrees of the right."""
    capture, truth = rendered(replace(USUAL, seed=seed, photographs=40))
    toward = truth.lights.direction[:, 0]
    right = np.flatnonzero(np.abs(toward[:, 1]) < np.sqrt(3) * toward[:, 0])[:12]
    return capture.select(right), truth


def each_photograph(change: Callable[[Array, int], Array]) -> Callable[[Capture, int], Capture]:
    """A change of every photograph by its number."""

    def apply(capture: Capture, seed: int) -> Capture:
        changed = [change(photograph, i) for i, photograph in enumerate(capture.photographs)]
        return replace(capture, photographs=np.stack(changed))

    return apply


def moved(photograph: Array, right_px: float) -> Array:
    """Moved to the right."""
    matrix = np.array([[1.0, 0.0, right_px], [0.0, 1.0, 0.0]])
    size = photograph.shape[1::-1]
    return np.asarray(cv2.warpAffine(photograph, matrix, size, borderMode=cv2.BORDER_REPLICATE))


def window(capture: Capture, seed: int) -> Floats:
    """(H, W, 3) linear light that a window at the upper left adds to every photograph."""
    shape = make_shape(SHAPE)
    options = replace(
        USUAL, lighting="ambient", ambient=0.1, image_noise=0.0, exposure=0.4,
        camera=shape.camera.scaled(SCALE),
    )  # fmt: skip
    lit, _ = render_scene(shape, make_albedo(PAINT), options)
    return lit.photographs[0] / lit.white


def beside_a_window(subtracted: bool) -> Callable[[Capture, int], Capture]:
    """Half as much light from a window as from the lamp; with or without the picture of it."""

    def apply(capture: Capture, seed: int) -> Capture:
        room = window(capture, seed)
        rng = np.random.default_rng(seed)
        noisy = room + USUAL.image_noise * rng.standard_normal(room.shape)
        photographs = [
            light / capture.white * 0.6 + room - (noisy if subtracted else 0)
            for light in capture.photographs
        ]
        values = np.rint(capture.white * np.clip(photographs, 0, 1)).astype(np.uint16)
        return replace(capture, photographs=values)

    return apply


def as_jpeg(capture: Capture, seed: int) -> Capture:
    """The photographs as 8-bit sRGB JPEGs of quality 80."""
    coded = [
        cv2.imdecode(
            cv2.imencode(".jpg", np.rint(255 * srgb(light / capture.white)).astype(np.uint8),
                         [cv2.IMWRITE_JPEG_QUALITY, 80])[1],
            cv2.IMREAD_COLOR,
        )
        for light in capture.photographs
    ]  # fmt: skip
    return replace(capture, photographs=np.stack(coded), encoding="srgb")


def blurred(photograph: Array, sigma_px: float) -> Array:
    """Out of focus."""
    return np.asarray(cv2.GaussianBlur(photograph, (0, 0), sigma_px))


CASES = (
    Case("lights", "a ring, 30 to 50 degrees", taken(), "a ring, 30-50 deg"),
    Case("lights", "a ring, 15 degrees", taken(tilt_deg=(12.0, 18.0))),
    Case("lights", "close to the camera, 3 to 8 degrees", taken(tilt_deg=(3.0, 8.0)),
         "close to the camera"),
    Case("lights", "a ring, 60 to 70 degrees", taken(tilt_deg=(60.0, 70.0))),
    Case("lights", "very low, 75 to 85 degrees", taken(tilt_deg=(75.0, 85.0)), "very low"),
    Case("lights", "from the right alone, 30 to 50 degrees", from_the_right, "one side alone"),
    *(Case("number", f"{count} photographs", taken(photographs=count),
           f"{count} photographs" if count in (3, 6, 12) else "")
      for count in (3, 4, 6, 8, 12, 16, 24)),
    Case("exposure", "the brightest tenth clipped", taken(peak=1.0, peak_quantile=0.9)),
    Case("exposure", "half of it clipped", taken(peak=1.0, peak_quantile=0.5), "half clipped"),
    Case("exposure", "20 times too dark, 8 bits", taken(peak=0.045, bits=8), "20 times too dark"),
    Case("exposure", "8-bit sRGB JPEG of quality 80", changed(as_jpeg), "JPEG of quality 80"),
    Case("exposure", "well exposed, 16 bits", taken(), "well exposed"),
    Case("room", "room light from everywhere, as bright as the lamp", taken(ambient=1.0)),
    Case("room", "a window, half as bright as the lamp", changed(beside_a_window(False))),
    Case("room", "the same, `ambient` subtracted", changed(beside_a_window(True))),
    Case("camera", "one photograph moved by 4 pixels",
         changed(each_photograph(lambda p, i: moved(p, 4.0 * (i == 3)))), "one moved by 4 px"),
    Case("camera", "a hand-held camera: moved by up to 4 pixels",
         changed(each_photograph(lambda p, i: moved(p, 4 * np.sin(2.4 * i)))), "all moved"),
    Case("camera", "out of focus by 3 pixels",
         changed(each_photograph(lambda p, i: blurred(p, 3.0))), "out of focus"),
    Case("camera", "a tripod, in focus", taken(), "a tripod, in focus"),
)  # fmt: skip


@dataclass(frozen=True)
class Score:
    """Errors before and after, (depth mm, normals degrees), and what the check said first.

    normals, rough : (H, W, 3) of the refined and of the prepared surface
    """

    before: tuple[float, float]
    after: tuple[float, float]
    said: str
    normals: Floats
    rough: Floats


def scored(capture: Capture, truth: Truth) -> Score:
    """One capture, checked and refined; NaN where it is refused."""
    report = check_capture(capture)
    warned = [each for each in report.findings if each.severity == "warning"]
    said = warned[0].code if warned else report.verdict
    prepared = prepare(capture)
    depth_m = prepared.embed(prepared.depth_m, np.nan)
    rough = surface_normals(depth_m, truth.mask & np.isfinite(depth_m), capture.camera)
    start = evaluate_maps(depth_m, np.asarray(rough), truth)
    before = start.depth.rmse_mm, start.normals.mae_deg
    try:
        result = refine(capture)
    except RakelightError as error:
        rough = np.asarray(rough)
        return Score(before, (np.nan, np.nan), f"refused: {error.what}", rough, rough)
    end = evaluate(result, truth)
    after = end.depth.rmse_mm, end.normals.mae_deg
    return Score(before, after, said, result.normals, np.asarray(rough))


def fitted(picture: Array, side: int) -> Array:
    """(side, side, 3) a picture (h, w[, 3]) uint8 made to fit, on dark."""
    if picture.ndim == 2:
        picture = np.repeat(picture[..., None], 3, axis=2)
    factor = side / max(picture.shape[:2])
    size = tuple(max(round(length * factor), 1) for length in picture.shape[1::-1])
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    tile = np.full((side, side, 3), DARK, np.uint8)
    top, left = (side - size[1]) // 2, (side - size[0]) // 2
    tile[top : top + size[1], left : left + size[0]] = small
    return tile


def titled(tile: Array, words: str) -> Array:
    """A tile below its caption."""
    band = np.full((26, tile.shape[1], 3), DARK, np.uint8)
    cv2.putText(band, words, (4, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.48, (230,) * 3, 1, cv2.LINE_AA)
    return np.concatenate([band, tile])


def light_plots(captures: list[Capture]) -> Iterator[Array]:
    """The plot of the lights on the page of `rakelight check --html`, of each capture."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as running:
        browser = running.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        page = browser.new_page(viewport={"width": 1000, "height": 800}, color_scheme="light")
        for capture in captures:
            page.set_content(check_html(check_capture(capture), capture).decode())
            shot = np.frombuffer(page.locator("svg.plot").screenshot(), np.uint8)
            yield cv2.imdecode(shot, cv2.IMREAD_COLOR)[..., ::-1]
        browser.close()


def column(case: Case, score: Score, capture: Capture, plot: Array | None) -> Array:
    """The tiles of a case, one below the other."""
    part = object_window(capture.mask)
    light = to_linear(capture.photographs[1][part], capture.encoding)
    photograph = np.rint(255 * srgb(light)).astype(np.uint8)
    clay = shaded(np.nan_to_num(score.normals[part]), capture.mask[part])
    tiles = [] if plot is None else [fitted(plot, TILE_PX)]
    tiles += [fitted(photograph, TILE_PX), fitted(clay, TILE_PX)]
    error = f"{case.tile}: {score.after[1]:.1f} deg"
    return titled(np.concatenate(tiles), error)


def picture(topic: str, cases: list[tuple[Case, Score, Capture]], folder: Path) -> None:
    """Write the picture of a topic."""
    plots: list[Array | None] = [None] * len(cases)
    if topic == "lights":
        plots = list(light_plots([capture for *_, capture in cases]))
    columns = [column(*each, plot) for each, plot in zip(cases, plots, strict=True)]
    if topic == "number":
        case, score, capture = cases[0]
        unrefined = replace(score, normals=score.rough, after=score.before)
        before = replace(case, tile="before refining")
        columns.insert(0, column(before, unrefined, capture, None))
    gap = np.full((columns[0].shape[0], GAP_PX, 3), DARK, np.uint8)
    joined = np.concatenate([part for each in columns for part in (each, gap)][:-1], axis=1)
    file = folder / f"capture-{topic}.jpg"
    file.write_bytes(encode_jpeg(np.ascontiguousarray(joined)))
    print(f"{file}: {joined.shape[1]} x {joined.shape[0]}, {file.stat().st_size // 1000} kB")


def main() -> None:
    """Print the table and write the pictures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, help="where the pictures go")
    parser.add_argument("--seeds", default="0:1", help="first:end")
    parser.add_argument("--topic", help="one topic only: " + ", ".join({c.topic for c in CASES}))
    arguments = parser.parse_args()
    if not arguments.folder.is_dir():
        parser.error(f"there is no folder {arguments.folder}")
    seeds = range(*map(int, arguments.seeds.split(":")))
    drawn: dict[str, list[tuple[Case, Score, Capture]]] = {}
    print(
        "| capture | depth, mm | normals, degrees | check says first |\n| --- | --- | --- | --- |"
    )
    for case in CASES:
        if arguments.topic not in (None, case.topic):
            continue
        scores = [scored(*case.take(seed)) for seed in seeds]
        depth, normals = np.median([score.after for score in scores], axis=0)
        said = ", ".join(dict.fromkeys(score.said for score in scores))
        print(f"| {case.name} | {depth:.2f} | {normals:.1f} | {said} |", flush=True)
        if case.tile:
            capture = case.take(seeds[0])[0]
            drawn.setdefault(case.topic, []).append((case, scores[0], capture))
    depth, normals = scores[0].before
    print(f"before: {depth:.2f} mm, {normals:.1f} degrees")
    for topic, cases in drawn.items():
        picture(topic, cases, arguments.folder)


if __name__ == "__main__":
    main()
