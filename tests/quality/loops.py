"""A knitted monkey's loops in one photograph, part by part (docs/results/single-photograph.md).

    python tests/quality/loops.py

Period is that of the brightness' strongest wave.  Contrast is its root mean square at the loops'
size, between averages over 0.8 and 2.5 pixels, relative; noise is how much of it white noise would
make that explains all of the finest differences.  Height is what fusion-like adds to the prepared
depth at the same size, and follows is its correlation with the brightness.  Clipped pixels and
those within 3 of a border are left out.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.ndimage import binary_erosion

from rakelight.capture import load_capture
from rakelight.geometry.blur import blurred
from rakelight.methods import load_method
from rakelight.methods.single_image.depth_energy import View
from rakelight.model import MAD_TO_SIGMA, silent
from rakelight.prepare import prepare

MONKEY = Path(__file__).resolve().parents[3] / "shared" / "captures" / "monkey"
# Rows and columns of the photograph.
PARTS = {
    "left ear": (332, 375, 558, 595),
    "right ear": (360, 398, 697, 737),
    "face": (330, 440, 605, 680),
    "chin": (400, 423, 601, 660),
    "chest": (438, 473, 601, 654),
    "belly": (476, 514, 601, 651),
    "left arm": (470, 525, 539, 565),
    "right arm": (485, 535, 689, 718),
    "left hand": (558, 600, 517, 549),
    "right hand": (555, 588, 710, 737),
    "left leg": (560, 645, 573, 603),
    "right leg": (560, 645, 646, 675),
    "left foot": (675, 712, 567, 605),
    "right foot": (663, 700, 638, 676),
}
SMALL_PX, LARGE_PX, BORDER = 0.8, 2.5, 3


class Loops(NamedTuple):
    """Of one part: the clipped share, relative contrasts, height in mm, a correlation."""

    clipped: float
    period_px: float
    contrast: float
    noise: float
    height_mm: float
    follows: float


def loops(capture):
    """What shows of each part."""
    prepared = prepare(capture)
    method, view = load_method("fusion-like"), View.of(prepared)
    after = method.run(prepared, method.options(), silent).log_depth
    inner = binary_erosion(prepared.mask, iterations=BORDER)
    told = view.level.usable.any(axis=-1)
    bright = view.intensity / np.maximum(blurred(view.intensity, LARGE_PX, prepared.mask), 1e-3)
    photograph = band(bright, prepared.mask & told)
    height_mm = 1e3 * prepared.depth_m * band(view.level.prior - after, prepared.mask)
    rows, columns = np.indices(prepared.mask.shape)
    rows, columns = rows + prepared.rows.start, columns + prepared.columns.start
    found = {}
    for name, (top, bottom, left, right) in PARTS.items():
        box = (rows >= top) & (rows < bottom) & (columns >= left) & (columns < right) & inner
        part = box & told
        found[name] = Loops(
            1 - np.count_nonzero(part) / np.count_nonzero(box),
            period_px(photograph * part),
            float(photograph[part].std()),
            finest(bright, part) * passed(),
            float(height_mm[part].std()),
            float(np.corrcoef(photograph[part], height_mm[part])[0, 1]),
        )
    return found


def band(image, mask):
    """What of an image (h, w) is of the loops' size."""
    return blurred(image, SMALL_PX, mask) - blurred(image, LARGE_PX, mask)


def period_px(image):
    """Of the strongest wave between 3 and 15 pixels long."""
    power = np.abs(np.fft.fft2(image)) ** 2
    frequency = np.hypot(*np.meshgrid(*(np.fft.fftfreq(n) for n in image.shape), indexing="ij"))
    power[(frequency < 1 / 15) | (frequency > 1 / 3)] = 0
    return float(1 / frequency.flat[power.argmax()])


def finest(image, part):
    """The deviation of the white noise that makes all mixed second differences in a part."""
    mixed = np.diff(np.diff(np.where(part, image, np.nan), axis=0), axis=1) / 2
    return MAD_TO_SIGMA * float(np.nanmedian(np.abs(mixed)))


def passed():
    """The part of white noise's deviation that is in the band."""
    point = np.zeros((41, 41))
    point[20, 20] = 1.0
    return float(np.sqrt((band(point, np.ones(point.shape, bool)) ** 2).sum()))


def main():
    """Print the table."""
    found = loops(load_capture(MONKEY))
    print("| part | clipped | period, px | contrast | noise | height, mm | follows |")  # noqa: T201
    print("| --- | --- | --- | --- | --- | --- | --- |")  # noqa: T201
    for name, of in found.items():
        light = f"{of.clipped:.0%} | {of.period_px:.1f} | {of.contrast:.3f} | {of.noise:.3f}"
        print(f"| {name} | {light} | {of.height_mm:.2f} | {of.follows:.2f} |")  # noqa: T201


if __name__ == "__main__":
    main()
