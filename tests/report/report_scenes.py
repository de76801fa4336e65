"""Results for reports: a vase as it is and as a noisy sensor sees it, at a size that is fast."""

from dataclasses import replace

import numpy as np

from rakelight.model import Finding, Result
from rakelight.synthetic import SceneOptions, make_albedo, make_shape, render_scene

HOSTILE = "\"'><script>alert(1)</script></script><img src=x onerror=alert(2)>{{7*7}}\u202e&amp;"
# The least contrast of a text on a page, and where it is.
CONTRAST = """() => {
  const light = (text) => text.match(/[\\d.]+/g).slice(0, 3).map((c) => {
    const v = c / 255; return v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
  }).reduce((sum, v, k) => sum + v * [0.2126, 0.7152, 0.0722][k], 0);
  const behind = (one) => {
    for (; one; one = one.parentElement) {
      const colour = getComputedStyle(one).backgroundColor;
      if (!/, 0\\)$/.test(colour)) return colour;
    }
  };
  return [...document.querySelectorAll("body *")].filter((one) =>
    one.checkVisibility() && !one.closest("svg, .stage") && [...one.childNodes].some((node) =>
      node.nodeType === 3 && node.data.trim())
  ).map((one) => {
    const [a, b] = [getComputedStyle(one).color, behind(one)].map(light).sort((p, q) => q - p);
    return [(a + 0.05) / (b + 0.05), one.outerHTML.slice(0, 80)];
  }).sort((p, q) => p[0] - q[0])[0];
}"""


def vase_result(scale=0.5, **changes):
    """A vase with exact depth, a prepared depth that lacks its relief, four lights."""
    vase = make_shape("vase")
    options = SceneOptions(camera=vase.camera.scaled(scale), photographs=4, supersampling=1)
    _, truth = render_scene(vase, make_albedo("pattern"), options)
    v, u = np.mgrid[: truth.depth.shape[0], : truth.depth.shape[1]]
    result = Result(
        depth=truth.depth,
        normals=truth.normals,
        albedo=truth.albedo,
        confidence=np.where(truth.mask, 0.5 + 0.5 * np.sin(u / 20), 0).astype(np.float32),
        lights=truth.lights,
        camera=options.camera,
        prepared_depth=(truth.depth + 0.005 * np.sin(u / 7) * np.cos(v / 9)).astype(np.float32),
        method="multi-light",
        options={"depth_weight": None, "tolerance": 0.002},
        iterations=3,
        energy=(9.0, 4.0, 3.5),
        converged=True,
        source="captures/vase",
        photograph_names=tuple(f"{i:03}.png" for i in range(4)),
        capture={
            "photographs": 4,
            "photograph_size": [options.camera.width, options.camera.height],
            "bits": 16,
            "encoding": "linear",
            "lighting": "moving-lamp",
            "depth_maps": 1,
            "depth_size": [120, 90],
        },
        prediction_errors=(0.02, 0.03, 0.08, float("nan")),
    )
    return replace(result, **changes), truth


def hostile_result():
    """Every text that comes from outside is an attack."""
    finding = Finding("warning", "attack", HOSTILE, HOSTILE)
    return vase_result(
        0.1,
        source=f"captures/{HOSTILE.replace('/', '|')}",
        photograph_names=(HOSTILE,) * 4,
        method=HOSTILE,
        options={HOSTILE: HOSTILE},
        findings=(finding, replace(finding, severity="note")),
    )[0]


def enlarged(result, factor):
    """The same with every pixel repeated: many pixels, without the time to render them."""
    maps = ("depth", "normals", "albedo", "confidence", "prepared_depth")
    larger = {
        name: getattr(result, name).repeat(factor, axis=0).repeat(factor, axis=1) for name in maps
    }
    return replace(result, camera=result.camera.scaled(factor), **larger)
