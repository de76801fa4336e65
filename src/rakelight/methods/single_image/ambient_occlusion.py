"""The ambient-occlusion cue: fine relief from the darkening of ambient light in its valleys.

Light from one side makes slopes bright or dark.  Ambient light, phi of the first-order harmonics,
hardly depends on the slope, but the valleys of a relief see less of it than its ridges do.  How
much less was found by integrating the visible sky over sinusoids and random reliefs of slope 0.5 to
1.5 (tests/methods/single_image/test_ambient_occlusion.py): the relative change a of phi is,
whatever the size of the relief, about

    a = c |k| h,        c = 1/6

for the part of the height h that has the wave number k.  (Langer and Zucker 1994 call it shape from
shading on a cloudy day.)  Where light (l, phi) of both kinds is on the object, l_t being the
component of l along the surface, a change s of the intensity relative to its surroundings is

    s (l . n + phi) = (i l_t . k + phi c |k|) h

The two terms are a quarter of a period apart, so that in least squares phi gets the share

    (c phi)^2 / ((c phi)^2 + |l_t|^2 / 2)

of s, on average over the directions of k, and the directional light the rest.
"""

from __future__ import annotations

import numpy as np

from rakelight.geometry.blur import blurred
from rakelight.methods.single_image.texture import AFAR_PX
from rakelight.model import Floats, Mask

# c, the relative change of ambient light per unit slope; measured as above.
SKY = 1 / 6
# Scales of fine relief, standard deviations in pixels; below the first is the camera's noise.
STEP_PX = 0.5
SCALES_PX = np.arange(STEP_PX, AFAR_PX + STEP_PX / 2, STEP_PX)
# Least phi, over the mean shading, for which the cue is used.
LEAST_AMBIENT = 0.02


def occlusion_height(
    contrast: Floats, light: Floats, normals: Floats, mask: Mask
) -> tuple[Floats, Floats]:
    """The height (h, w) from ambient occlusion, and the fraction of `contrast` that it explains.

    contrast : (h, w) of the intensity with its surroundings, relative; 0 without information
    light : (4,) l_x, l_y, l_z, phi; normals : (h, w, 3), camera frame

    The height is towards the camera, in pixel footprints, relative to the surroundings.

    >>> from_all_sides, row = np.array([0.0, 0.0, 0.0, 1.0]), np.arange(60)
    >>> dark = -0.1 * np.cos(row[:, None] * 2 * np.pi / 10).repeat(60, axis=1)
    >>> facing = np.tile([0.0, 0.0, -1.0], (60, 60, 1))
    >>> height, explained = occlusion_height(dark, from_all_sides, facing, np.ones((60, 60), bool))
    >>> bool(height[30].max() < -0.5), bool(np.allclose(explained, dark))
    (True, True)
    """
    ambient = float(light[3])
    toward = normals @ light[:3]
    shade = toward + ambient
    along = np.maximum(light[:3] @ light[:3] - toward**2, 0.0)
    if ambient <= LEAST_AMBIENT * float(np.abs(shade[mask]).mean()) or not contrast[mask].any():
        return np.zeros(mask.shape), np.zeros(mask.shape)
    share = (SKY * ambient) ** 2 / ((SKY * ambient) ** 2 + along / 2)
    explained = share * contrast
    # Divided by |k|, over the scales: the integral of exp(-(k s)^2 / 2) over s is (pi/2)^(1/2)/|k|.
    change = explained * np.maximum(shade, 0.0) / ambient
    height = sum(blurred(change, px, mask) for px in SCALES_PX)
    return np.sqrt(2 / np.pi) * STEP_PX / SKY * height, explained
