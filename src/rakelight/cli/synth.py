"""`rakelight synth OUT`: a capture folder with its truth."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from rakelight.cli.options import (
    F,
    NamedPath,
    output_options,
    print_findings,
    refuse_input_as_output,
)
from rakelight.cli.progress import shown_progress
from rakelight.errors import InputError, counted, printable


def scene_options(command: F) -> F:
    """The options that become fields of SceneOptions and DepthNoise, by the field's name."""
    for names, kind, default, text in reversed(_SCENE):
        command = click.option(
            *names, type=kind, default=default, show_default=default is not None, help=text
        )(command)
    return click.option(
        "--cast-shadows", is_flag=True, help="Let parts of the object shade others."
    )(command)


# Option (and field, where it differs), type, default, help.  None: the scene chooses.
_SCENE: tuple[tuple[tuple[str, ...], Any, Any, str], ...] = (
    (("--lights", "photographs"), int, 12, "Photographs under the moving lamp."),
    (("--lighting",), str, "moving-lamp", "moving-lamp, rgb-leds or ambient."),
    (("--cone", "tilt_deg"), (float, float), (12.0, 40.0), "Least and largest angle of the lamp "
     "to the camera's axis, degrees."),
    (("--lamp-distance", "lamp_distance_m"), float, None, "Metres from the object; distant if "
     "left away."),
    (("--ambient",), float, None, "Light from everywhere, as a fraction of the lamp's."),
    (("--specular",), float, 0.0, "Height of the highlight over white paint."),
    (("--specular-exponent",), float, 40.0, "The larger, the smaller the highlight."),
    (("--exposure-spread",), float, 0.0, "Standard deviation of the log exposures."),
    (("--exposure",), float, None, "Value of white paint that faces a lamp; white is 1."),
    (("--supersampling",), int, 2, "Rays per pixel, along each side."),
    (("--image-noise",), float, 0.01, "Standard deviation, as a fraction of white."),
    (("--bits",), int, 16, "8 or 16."),
    (("--encoding",), str, "linear", "linear or srgb."),
    (("--depth-factor",), float, 2, "Colour pixels per depth pixel, along each side; 7.5, say."),
    (("--baseline", "depth_to_color"), float, None, "Metres from the colour camera to a depth "
     "camera of its own, on its right."),
    (("--depth-frames",), int, 1, "How many depth maps."),
    (("--depth-noise", "rms_mm"), float, 2.5, "Depth noise, rms in millimetres."),
    (("--depth-correlation", "correlation_length_px"), float, 6.0, "Its correlation length, in "
     "depth pixels."),
    (("--depth-step", "step_mm"), float, 0.0, "Quantisation of the depth, millimetres."),
    (("--holes", "hole_fraction"), float, 0.0, "Share of the depth that is missing, 0..1."),
    (("--seed",), int, 0, "Of everything random."),
)  # fmt: skip
_OF_THE_MOVING_LAMP = {"photographs": "--lights", "tilt_deg": "--cone"}
SHAPE, ALBEDO = "vase", "pattern"
_OPTION_OF = {
    **{names[-1].lstrip("-").replace("-", "_"): names[0] for names, *_ in _SCENE},
    "shape": "--shape",
    "albedo": "--albedo",
}


def _beside(baseline_m: float | None) -> Any:
    """The place of a depth camera so far to the right of the colour camera, turned as it is."""
    if baseline_m is None:
        return None
    import numpy as np

    from rakelight.model import RigidTransform

    if not abs(baseline_m) <= 1:
        raise InputError(
            "not a baseline",
            source="--baseline",
            seen=f"{baseline_m:g}",
            needed="metres, at most 1",
        )
    return RigidTransform(np.eye(3), np.array([baseline_m, 0.0, 0.0]))


def _one_of(name: str, value: object, file_option: str, file: Path | None) -> None:
    """Raise InputError where a built-in one and a file are both named."""
    if value is not None and file is not None:
        raise InputError(
            "only one of them can be used",
            source=f"{name} and {file_option}",
            seen=f"{value} and {file}",
            needed=f"{name} or {file_option}",
        )


def _one_photograph(lighting: str) -> None:
    """Raise InputError where there is no moving lamp and something was said about it."""
    context = click.get_current_context()
    for name, option in _OF_THE_MOVING_LAMP.items():
        given = context.get_parameter_source(name) is ParameterSource.COMMANDLINE
        if given and lighting in ("rgb-leds", "ambient"):
            raise InputError(
                "only a moving lamp has that",
                source=option,
                seen=f"--lighting {lighting}, which is one photograph",
                needed="--lighting moving-lamp",
                remedy=f"leave {option} away, or the lighting",
            )


@contextmanager
def _options_named() -> Iterator[None]:
    """Errors about a field of the scene name the option that sets it."""
    try:
        yield
    except InputError as error:
        error.source = _OPTION_OF.get(error.source, error.source)
        raise


@click.command("synth")
@click.argument("output", type=NamedPath(), metavar="OUT")
@click.option("--shape", help=f"head, vase, cloth, coin, sphere; {SHAPE} if left away.")
@click.option(
    "--shape-file",
    type=NamedPath(),
    help="A depth map instead: .npz with depth_mm and mask, or a TIFF in metres.",
)
@click.option("--albedo", help=f"simple, pattern, complicated, white, grey; {ALBEDO} if left away.")
@click.option("--texture", type=NamedPath(), help="A photograph as the albedo instead.")
@click.option(
    "--size",
    type=float,
    default=1.0,
    show_default=True,
    help="Scale of the camera's image, 480 x 360 for the built-in shapes.",
)
@click.option("--overwrite", is_flag=True, help="Replace an older synthetic capture at OUT.")
@scene_options
@output_options
def command(
    output: Path,
    shape: str | None,
    shape_file: Path | None,
    albedo: str | None,
    texture: Path | None,
    size: float,
    overwrite: bool,
    as_json: bool,
    quiet: bool,
    debug: bool,
    **settings: Any,
) -> None:
    """Make a capture with known truth: an object, its paint, lights and sensors."""
    from rakelight.capture import SYNTHETIC
    from rakelight.folders import require_free
    from rakelight.synthetic import (
        DepthNoise,
        SceneOptions,
        make_albedo,
        make_shape,
        shape_from_file,
        texture_from_file,
        write_scene,
    )

    _one_of("--shape", shape, "--shape-file", shape_file)
    _one_of("--albedo", albedo, "--texture", texture)
    _one_photograph(settings["lighting"])
    if not 0 < size <= 16:
        raise InputError("not a size", source="--size", seen=str(size), needed="above 0, up to 16")
    settings["depth_to_color"] = _beside(settings["depth_to_color"])
    noise = {f.name: settings.pop(f.name) for f in fields(DepthNoise) if f.name in settings}
    for file, what in ((shape_file, "shape file"), (texture, "texture")):
        if file is not None:
            refuse_input_as_output(file, output, what)
    require_free(output, manifest=SYNTHETIC, overwrite=overwrite)  # never a real capture
    with _options_named(), shown_progress(quiet or as_json) as progress:
        solid = make_shape(shape or SHAPE) if shape_file is None else shape_from_file(shape_file)
        if texture is None:
            paint = make_albedo(albedo or ALBEDO, settings["seed"])
        else:
            paint = texture_from_file(texture)
        options = SceneOptions(
            camera=solid.camera.scaled(size), depth_noise=DepthNoise(**noise), **settings
        )
        capture, kept = write_scene(
            solid, paint, options, output, overwrite=overwrite, progress=progress
        )
    if not quiet:
        print_findings(kept)
    if as_json:
        click.echo(
            json.dumps(
                {
                    "output": printable(str(output)),
                    "photographs": options.count,
                    "size": [capture.camera.width, capture.camera.height],
                    "pixels": int(capture.mask.sum()),
                }
            )
        )
    elif not quiet:
        click.echo(f"capture: {printable(str(output))}  ({counted(options.count, 'photograph')})")
