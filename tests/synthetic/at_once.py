"""Scenes rendered at once, whole images at every step: the plain form of rendering in strips."""

import numpy as np

from rakelight.geometry.camera import back_project
from rakelight.geometry.grid import area_mean
from rakelight.photometry.cast_shadows import in_sight
from rakelight.prepare.linear import srgb
from rakelight.synthetic import add_depth_noise
from rakelight.synthetic.implicit import seen_from, trace
from rakelight.synthetic.scene_lights import DEPTH_STREAM, IMAGE_STREAM, scene_lights


def render_at_once(shape, albedo, options):
    """The arrays of the capture and the truth that `render_scene` makes, by name."""
    camera, rays = options.camera, options.supersampling
    fine_camera = camera.scaled(rays)
    surface = shape.render(camera)
    fine = shape.render(fine_camera) if rays > 1 else surface
    mask = surface.mask & (area_mean(fine.mask, rays) == 1)
    paint = albedo.paint(fine_camera)
    lights = scene_lights(options, back_project(surface.depth, camera)[mask].mean(axis=0))
    light = np.stack(
        [
            area_mean(_photograph(i, fine, fine_camera, paint, lights, options), rays)
            for i in range(len(lights.toward))
        ]
    ).astype(np.float32)
    level = options.exposure or options.peak / float(
        np.quantile(light[:, mask], options.peak_quantile)
    )
    known, inside = lights.as_lights(level), mask[..., None]
    return {
        "photographs": _developed(light * np.float32(level), options),
        "depth_m": _sensed(shape, surface, camera, options),
        "mask": mask,
        "depth": np.where(mask, surface.depth, np.nan).astype(np.float32),
        "normals": np.where(inside, surface.normals, np.nan).astype(np.float32),
        "albedo": np.where(inside, area_mean(paint, rays), 0).astype(np.float32),
        "vector": known.vector,
        "ambient": known.ambient,
        "position_m": known.position_m,
    }


def _photograph(i, fine, camera, paint, lights, options):
    """(H rays, W rays, 3) linear light of photograph i."""
    hit = np.flatnonzero(fine.mask)
    points = back_project(fine.depth, camera).reshape(-1, 3)[hit]
    normals, rho = fine.normals.reshape(-1, 3)[hit], paint.reshape(-1, 3)[hit]
    shading, specular = np.empty_like(rho), np.zeros_like(rho)
    channels = lights.toward.shape[1]
    for c in range(channels):
        s = lights.at(points, i, c)
        lit = np.maximum((normals * s).sum(axis=1), 0)
        if options.cast_shadows:
            lit *= in_sight(fine.depth, camera, points, lights.way(points, i, c))
        seen_by = slice(None) if channels == 1 else slice(c, c + 1)
        shading[:, seen_by] = lit[:, None]
        if options.specular:
            strength = np.linalg.norm(s, axis=-1)
            halfway = s / strength[:, None]
            halfway = halfway - points / np.linalg.norm(points, axis=1, keepdims=True)
            halfway /= np.linalg.norm(halfway, axis=1, keepdims=True)
            cosine = np.maximum((normals * halfway).sum(axis=1), 0) ** options.specular_exponent
            specular[:, seen_by] = (options.specular * strength * cosine * (lit > 0))[:, None]
    light = np.zeros((camera.height * camera.width, 3), np.float32)
    light[hit] = rho * (shading + lights.gain[i] * lights.ambient) + specular
    return light.reshape(*camera.shape, 3)


def _developed(light, options):
    rng = np.random.default_rng([options.seed, IMAGE_STREAM])
    noise = np.stack([rng.standard_normal(image.shape, dtype=np.float32) for image in light])
    exposed = np.clip(light + options.image_noise * noise, 0, 1)
    code = srgb(exposed) if options.encoding == "srgb" else exposed
    return np.rint((2**options.bits - 1) * code).astype(np.uint8 if options.bits == 8 else "u2")


def _sensed(shape, surface, camera, options):
    """(K, h, w) depth maps of a sensor in the colour camera's view, or of its own."""
    factor, pose = options.depth_factor, options.depth_to_color
    if pose is None and camera.width % factor == camera.height % factor == factor % 1 == 0:
        depth = area_mean(surface.depth, int(factor))
    else:
        width, rays = max(round(camera.width / factor), 1), max(round(factor), 2)
        own = camera.resized(width, max(round(camera.height * width / camera.width), 1))
        fine = own.scaled(rays)
        seen = shape.render(fine) if pose is None else trace(seen_from(shape.solid, pose), fine)
        depth = area_mean(seen.depth, rays)
    seeds = ([options.seed, DEPTH_STREAM, frame] for frame in range(options.depth_frames))
    return np.stack([add_depth_noise(depth, options.depth_noise, seed) for seed in seeds])
