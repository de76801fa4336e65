"""Multi-light, solved jointly: Gauss-Newton on log depth and all lights, albedo eliminated.

    I_ic = rho_c (max(0, s_i . n) + phi_i)                                       equation (3)

The albedo is linear given the shading and is eliminated per pixel and channel (variable
projection).  The lights are few and are eliminated by a Schur complement.  Alternation (3.4)
creeps along the bas-relief valley, in which lights and depth have to move together; the joint
step does not.  Coarse to fine; Cauchy weights per photograph, pixel and channel; cast shadows and
highlights left out where they are to be expected.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rakelight.methods.estimate import (
    Estimate,
    brightest,
    lamp_findings,
    require_photographs,
)
from rakelight.methods.levels import Level, finest_level, pyramid
from rakelight.methods.multi_light.bas_relief_variance import bas_relief_variance, sensor_moment
from rakelight.methods.multi_light.confidence import (
    confidence,
    depth_sigma,
    missed_bend,
    photometric_variance,
    shared_noise,
)
from rakelight.methods.multi_light.energy import Fit, begun_anew
from rakelight.methods.multi_light.model_selection import first_look
from rakelight.methods.multi_light.noise import deserved_steadiness, deserved_trust
from rakelight.methods.multi_light.normals import fine_normals
from rakelight.methods.multi_light.options import Options
from rakelight.methods.multi_light.outliers import dimmed, matte
from rakelight.methods.multi_light.steps import Descent, descend
from rakelight.model import Finding, Floats, ProgressCallback
from rakelight.prepare import Prepared

# The depth's weight, in white noise's, until its errors are known; the more the fewer pixels the
# sensor has for what the photographs, together, get wrong.
FIRST_TRUST = 10.0
# A coarse level explains averaged photographs, and only roughly: the depth holds it the more.
COARSER = 2.0
# Steps at a level that is not the last; its end is not worth waiting for.
ON_THE_WAY = 3


def multi_light(prepared: Prepared, options: Options, progress: ProgressCallback) -> Estimate:
    """Refine the prepared depth by all photographs at once.

    Raises MethodError for fewer than 3 photographs.
    """
    require_photographs(prepared, "multi-light", 3)
    trust = options.depth_weight or FIRST_TRUST * prepared.factor**2
    finest = finest_level(prepared, cut=True, unbiased=True)
    levels = [
        level.trusting(trust * COARSER**k)
        for k, level in enumerate(pyramid(finest, options.coarse_pixels))
    ]

    # The coarsest level: how much the depth is to be trusted, and what lamps there are.
    coarsest = len(levels) - 1
    share, descent = first_look(levels[-1], options, progress, stage(coarsest))
    trust *= share
    levels = [level.trusting(share) for level in levels]
    level, fit, shine = matted(levels[-1], descent.fit)
    if shine.any():
        level, fit, _ = matted(levels[-1], past_highlights(levels[-1], fit, options, progress))
    if fit is not descent.fit:
        descent = descend(level, fit, options, progress, stage(coarsest))

    # Coarse to fine: the depth's detail, then lights and depth together, until both rest.
    for index in reversed(range(coarsest)):
        log_depth = levels[index].carried(levels[index + 1], descent.fit.log_depth)
        level, _ = matte(levels[index], log_depth, descent.fit.lamps)
        fit = begun_anew(level, descent.fit, log_depth)
        # The finest level's detail first: its lights and depth move together when they are weighed.
        together = index > 0
        descent = descend(level, fit, briefly(options), progress, stage(index), together=together)

    # What is left of the sensor's depth says how its errors hang together, and what they count.
    first_trust = trust
    if options.depth_weight is None:
        trust = deserved_trust(descent.fit, prepared)
    # Highlights and shadows are where the detail puts them; jumps that the sensor blurred, or its
    # noise hid, are steep by now.
    level, fit, shine = matted(levels[0], descent.fit)
    level = level.trusting(trust / first_trust).cut(fit.log_depth)
    fit = replace(fit, steadiness=deserved_steadiness(level, fit.log_depth, prepared))
    again = descend(level, fit, options, progress, "refine, weighed", noisiest=1.0, thorough=True)
    descent = replace(again, steps=descent.steps + again.steps)
    return finished(prepared, level, descent, trust, shine)


def matted(level: Level, fit: Fit) -> tuple[Level, Fit, Floats]:
    """`matte` where the fit is, and the fit to photographs that this changed: its loss anew."""
    clear, shine = matte(level, fit.log_depth, fit.lamps)
    if clear is not level:
        fit = begun_anew(clear, fit)
    return clear, fit, shine


def past_highlights(level: Level, fit: Fit, options: Options, progress: ProgressCallback) -> Fit:
    """The fit to all values after steps without each pixel's brightest.

    Where highlights bent the surface it says little of where they are.
    """
    dim = dimmed(level)
    found = descend(dim, begun_anew(dim, fit), options, progress, "try without the brightest")
    return begun_anew(level, found.fit)


def briefly(options: Options) -> Options:
    """The options with no more steps than a level on the way takes."""
    return replace(options, max_iterations=min(options.max_iterations, ON_THE_WAY))


def stage(index: int) -> str:
    """What the progress says of a level."""
    return f"refine 1/{2**index}" if index else "refine"


def finished(
    prepared: Prepared, level: Level, descent: Descent, trust: float, shine: Floats
) -> Estimate:
    """The estimate of the finest level, the albedo's 99th percentile set to 1.

    trust : of the depth; shine : (E,) heights of the highlights, for the notes
    """
    fit, active = descent.fit, level.photographs.active
    normals, explanation = fine_normals(level, fit)
    albedo = explanation.albedo
    gain = brightest(albedo[active])
    lights = fit.lamps.brighter(gain).as_lights(level.middle_m)
    notes = [Finding("note", "depth-weight", f"depth weight {trust:.3g} times white noise's")]
    if shine.any():
        height = f"{shine.sum() / gain:.2f} of white paint's brightness"
        notes.append(Finding("note", "highlights", f"highlights up to {height}, left out"))
    moment = sensor_moment(level, fit.log_depth)
    relief = bas_relief_variance(level, fit.log_depth, fit.lamps, moment)
    bend, noise = missed_bend(normals, level.grid), shared_noise(level, fit)
    local = photometric_variance(level, fit, noise) + bend
    return Estimate(
        log_depth=fit.log_depth,
        albedo=albedo / gain,
        confidence=np.where(active, confidence(level, fit, noise, bend + relief), 0.0),
        lights=lights,
        normals=normals,
        energy=tuple(each.energy for each in descent.fits),
        steps=descent.steps,
        converged=descent.converged,
        findings=(*lamp_findings(lights, prepared.names), *notes),
        depth_sigma=depth_sigma(level, fit, prepared, local, moment),
        normal_sigma=np.degrees(np.sqrt(local + relief)),
    )


__all__ = ["Options", "multi_light"]
