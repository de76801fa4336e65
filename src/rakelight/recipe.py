"""One capture from its source to its result folder, as a recipe says: what `refine` does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any

from rakelight.capture import has_truth, load_truth
from rakelight.capture.readers import Wanted, find_reader
from rakelight.errors import InputError
from rakelight.export.mesh_formats import DEFAULT_MESH
from rakelight.export.summary import program_version
from rakelight.methods import AUTOMATIC, Method, choose_method, load_method
from rakelight.model import Progress, ProgressCallback, Result, silent
from rakelight.pictures.colors import NormalMap
from rakelight.pipeline import refine
from rakelight.prepare import Scale
from rakelight.report import save_result


@dataclass(frozen=True)
class Recipe:
    """How captures are refined, and what is written.

    method : a name in METHODS, or "auto"
    settings : names and values of the method's options, as they were written
    options_for : makes the method's options of them; None for its defaults
    scale, photographs, mesh, normal_map : as in `refine`, `load_capture`, `save_result`
    """

    method: str = "auto"
    settings: tuple[tuple[str, str], ...] = ()
    options_for: Callable[[Method], Any] | None = None
    scale: Scale = "auto"
    photographs: tuple[int, ...] | None = None
    mesh: str = DEFAULT_MESH
    normal_map: NormalMap = "opengl"

    def check(self) -> None:
        """Raise InputError for a wrong option, where that shows before a capture is read.

        With the method "auto", for options that none of the methods that it may choose takes.
        """
        methods = AUTOMATIC if self.method == "auto" else (self.method,)
        refusals = []
        for method in map(load_method, methods):
            try:
                if self.options_for is not None:
                    self.options_for(method)
            except InputError as error:
                refusals.append(error)
        if len(refusals) == len(methods):
            raise refusals[0]

    def facts(self) -> dict[str, Any]:
        """All that the result depends on besides its input, for JSON."""
        return {
            "rakelight": program_version(),
            "method": self.method,
            "settings": dict(sorted(self.settings)),
            "scale": self.scale,
            "photographs": None if self.photographs is None else list(self.photographs),
            "mesh": self.mesh,
            "normal_map": self.normal_map,
        }


def refine_source(
    source: Path,
    output: Path,
    recipe: Recipe,
    *,
    overwrite: bool = False,
    progress: ProgressCallback = silent,
    extra_files: dict[str, bytes] | None = None,
    named: str = "",
) -> Result:
    """Read, refine and write; the result, with what is to be said of the writing.

    source : a capture folder or whatever else a reader recognises; output : the result folder
    extra_files : more files for that folder, name -> content
    named : what the result says of its source; as the reader has it when empty
    """
    began = perf_counter()
    progress(Progress("read"))
    capture = find_reader(source).read(source, Wanted(recipe.photographs, progress)).capture
    capture = replace(capture, source=named or capture.source)
    truth = load_truth(source) if has_truth(source) else None
    read_s = perf_counter() - began
    method, options = recipe.method, None
    if recipe.options_for is not None:
        method = choose_method(capture) if method == "auto" else method
        options = recipe.options_for(load_method(method))
    result = refine(capture, method, scale=recipe.scale, options=options, progress=progress)
    progress(Progress("write"))
    result = result.timed(read=read_s)
    kept = save_result(
        result,
        output,
        overwrite=overwrite,
        mesh=recipe.mesh,
        normal_map=recipe.normal_map,
        truth=truth,
        extra_files=extra_files,
    )
    return replace(result, findings=(*result.findings, *kept))
