"""Where the next lights should be: those that would lower the normals' uncertainty most.

At a pixel with normal n and albedo rho photograph i shows s_i . b, b = rho n, where the light s_i
reaches it (s_i . n > 0).  With noise of variance v in every photograph b is determined with

    cov(b) = v M^-1,    M = sum_i s_i s_i^T + L

L being the information of the depth, and only the part across n turns the normal:

    (expected squared angle) = v / rho^2  tr(P M^-1),    P = 1 - n n^T

A further light s changes M to M + s s^T where it reaches the pixel, and by Sherman & Morrison

    tr(P (M + s s^T)^-1) = tr(P M^-1) - |P M^-1 s|^2 / (1 + s^T M^-1 s)

so the best next direction is the one with the largest mean of the last term over the object's
normals (A-optimal design), among those that a hand reaches.  Noise and albedo drop out of the
comparison.  That lights have to be found as well, and cast shadows, are left aside.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, degrees

import numpy as np

from rakelight.model import Array, Finding, Floats

# Angles off the camera's axis, degrees, at which a hand holds a lamp: nearer the lamp or the hand
# is in the picture, farther relief casts shadows over itself.
NEAREST_DEG, FARTHEST_DEG = 15.0, 60.0
# Steps of the directions that are compared, degrees.
STEP_DEG = 5.0
# L, the information of the depth, over that of a photograph (the square of a light's intensity):
# its slopes are taken for three times as uncertain.  Keeps M regular: 4 times more or
# less moves the best direction of the median draw by 0 degrees (ablation.md).
PRIOR_INFORMATION = 0.1
# Normals of the object that are looked at.
SAMPLE = 300
# Normals of a surface that is not known: those of half a sphere that faces the camera.
SPHERE_DEG = 60.0
# Cosine of the angle, 30 degrees, that directions named together are apart: the hand is not exact.
NEARBY = 0.866
# Relative lowering of the normals' error by the best next light, from which on the light is named.
# Photographs of random draws for which 8 % or more was predicted lower it by 19 % (median of 4, of
# which one made it worse), those of less by 1 % (median of 15, ablation.md).
LEAST_GAIN = 0.08
# Angle off the axis, degrees, from which on a light has a side.
SIDED_DEG = 8.0
# Share of the object that is turned away from the lamp, in the median photograph, from which on the
# lights are low.  Normals of five rendered objects are then 1.5 to 3 times as far off as under
# lights at 40 degrees; where it is less, as on a coin under lights at 80 degrees, 1.2 times.  Of 60
# random captures, whose lights are at 58 degrees at the most, it is more on two.
LOW_SHARE = 0.25
# Largest gap between the azimuths of lights, degrees, from which on they are on one side.
ONE_SIDE_DEG = 185.0


@dataclass(frozen=True, slots=True)
class NextLight:
    """A direction for a further light.

    direction : (3,) unit vector towards the lamp, camera frame (x right, y down, z forward)
    words : for people, as the camera sees the object
    gain : by how much, 0 to 1, it lowers the expected error of the normals, after those before it
    """

    direction: Floats
    words: str
    gain: float


def next_lights(lights: Floats, normals: Floats, count: int = 3) -> tuple[NextLight, ...]:
    """The `count` best further lights, each with those before it taken.

    lights : (N, 3) light vectors of the photographs, camera frame, N may be 0
    normals : (P, 3) of the object's surface, facing the camera

    >>> from_the_left = np.array([[-0.6, 0.0, -0.8], [-0.5, 0.2, -0.8], [-0.5, -0.2, -0.8]])
    >>> facing = np.array([[0.0, 0.0, -1.0]])
    >>> next_lights(from_the_left, facing, 1)[0].direction.round(2)[0] > 0.5
    np.True_
    """
    normals = normals[:: max(len(normals) // SAMPLE, 1)]
    intensity = float(np.median(np.linalg.norm(lights, axis=1))) if len(lights) else 1.0
    directions = reachable()
    M = information(lights / max(intensity, np.finfo(float).tiny), normals)
    before = np.trace(across(normals) @ np.linalg.inv(M), axis1=1, axis2=2).mean()
    found: list[NextLight] = []
    for _ in range(count):
        lowered = gains(M, normals, directions)
        for each in found:
            lowered[directions @ each.direction > NEARBY] = 0.0
        best = directions[int(np.argmax(lowered))]
        after = before - float(lowered.max())
        found.append(NextLight(best, in_words(best), float(1 - np.sqrt(after / before))))
        reached = (normals @ best > 0)[:, None, None]
        M, before = M + reached * np.outer(best, best), after
    return tuple(found)


def information(lights: Floats, normals: Floats) -> Floats:
    """(P, 3, 3) M of every normal (P, 3) under lights (N, 3), in units of the noise."""
    reached = (normals @ lights.T > 0).astype(float)
    each = np.einsum("ni,nj->nij", lights, lights)
    return np.asarray(np.tensordot(reached, each, axes=1) + PRIOR_INFORMATION * np.eye(3))


def across(normals: Floats) -> Floats:
    """(P, 3, 3) projections P on the planes across the normals (P, 3)."""
    return np.asarray(np.eye(3) - np.einsum("pi,pj->pij", normals, normals))


def gains(M: Floats, normals: Floats, directions: Floats) -> Floats:
    """(D,) mean over the normals of what a light of unit intensity takes off tr(P M^-1)."""
    inverse = np.linalg.inv(M)
    moved = np.einsum("pij,dj->dpi", inverse, directions)
    turning = moved - np.einsum("dpi,pi->dp", moved, normals)[..., None] * normals
    size = 1 + np.einsum("dpi,di->dp", moved, directions)
    reached = directions @ normals.T > 0
    return np.asarray((reached * (turning**2).sum(axis=-1) / size).mean(axis=1))


def reachable() -> Floats:
    """(D, 3) directions that a hand reaches, evenly spaced, the one from above first."""
    found = []
    for tilt in np.radians(np.arange(NEAREST_DEG, FARTHEST_DEG + 0.1, STEP_DEG)):
        around = max(round(360 / STEP_DEG * np.sin(tilt)), 8)
        for azimuth in 2 * np.pi * np.arange(around) / around:
            x, y = np.sin(azimuth), -np.cos(azimuth)
            found.append([np.sin(tilt) * x, np.sin(tilt) * y, -np.cos(tilt)])
    return np.array(found)


def sphere_normals() -> Floats:
    """(P, 3) normals within 60 degrees of the camera's axis, for a surface that is not known."""
    turns = np.arange(SAMPLE) * np.pi * (3 - np.sqrt(5))  # golden angle
    z = 1 - (1 - np.cos(np.radians(SPHERE_DEG))) * (np.arange(SAMPLE) + 0.5) / SAMPLE
    radius = np.sqrt(1 - z**2)
    return np.stack([radius * np.cos(turns), radius * np.sin(turns), -z], axis=-1)


def azimuth_deg(direction: Array) -> float:
    """Clockwise from the top of the picture, 0 to 360."""
    return degrees(atan2(direction[0], -direction[1])) % 360


def tilt_deg(direction: Array) -> float:
    """Off the camera's axis, 0 to 180."""
    return degrees(float(np.arccos(np.clip(-direction[2], -1, 1))))


def in_words(direction: Array) -> str:
    """A direction (3,) for people.

    >>> in_words(np.array([-0.5, -0.5, -0.7071]))
    'from the upper left, about 45 degrees off the camera axis'
    """
    sides = (
        "above", "the upper right", "the right", "the lower right",
        "below", "the lower left", "the left", "the upper left",
    )  # fmt: skip
    side = sides[round(azimuth_deg(direction) / 45) % 8]
    return f"from {side}, about {5 * round(tilt_deg(direction) / 5)} degrees off the camera axis"


def one_side(directions: Floats) -> float | None:
    """The azimuth, degrees, of the middle of the lights' side, where all are on one side.

    directions : (N, 3) unit vectors.  None where lights are on several sides, or have none.

    >>> one_side(np.array([[0.6, 0.0, -0.8], [0.5, 0.3, -0.8], [0.5, -0.3, -0.8]]))
    90.0
    """
    sided = [azimuth_deg(each) for each in directions if tilt_deg(each) >= SIDED_DEG]
    if len(sided) < max(3, 0.8 * len(directions)):
        return None
    around = np.sort(sided)
    gaps = np.diff(np.append(around, around[0] + 360))
    widest = int(np.argmax(gaps))
    if gaps[widest] < ONE_SIDE_DEG:
        return None
    return float((around[widest] + gaps[widest] / 2 + 180) % 360)


def low_light_findings(directions: Floats, normals: Floats) -> tuple[Finding, ...]:
    """A warning where much of the object is turned away from the lamp.

    directions : (N, 3) unit vectors of the photographs' lights; normals : (P, 3) of the object

    >>> facing, sideways = np.array([0.0, 0.0, -1.0]), np.array([0.6, 0.0, -0.8])
    >>> low = np.array([[-0.9, 0.0, -0.436], [0.0, 0.9, -0.436], [-0.8, 0.5, -0.332]])
    >>> [each.code for each in low_light_findings(low, np.array([facing, sideways]))]
    ['lights-low']
    """
    away = np.mean(normals @ directions.T <= 0, axis=0)
    share = float(np.median(away))
    if share < LOW_SHARE:
        return ()
    message = f"the lights are low: {share:.0%} of the object is turned away from a lamp (median)"
    remedy = f"hold the lamp {NEAREST_DEG:.0f} to {FARTHEST_DEG:.0f} degrees off the camera axis"
    return (Finding("warning", "lights-low", message, remedy),)


def next_light_findings(directions: Floats, coming: tuple[NextLight, ...]) -> tuple[Finding, ...]:
    """A warning where all lights are on one side, a note where the next ones should be.

    directions : (N, 3) unit vectors of the photographs' lights
    """
    findings = []
    where = "; ".join(each.words for each in coming)
    middle = one_side(directions)
    if middle is not None:
        turn = np.radians(middle)
        side = in_words(np.array([np.sin(turn), -np.cos(turn), 0.0])).split(",")[0]
        message = f"all lights come {side}: what is turned away from there is in shadow"
        findings.append(Finding("warning", "lights-on-one-side", message, f"light it {where}"))
    elif coming and coming[0].gain >= LEAST_GAIN:
        message = (
            f"a light {coming[0].words} would lower the normals' error by {coming[0].gain:.0%}"
        )
        findings.append(Finding("note", "next-light", message, f"take the next {where}"))
    return tuple(findings)
