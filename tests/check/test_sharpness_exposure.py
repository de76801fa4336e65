from dataclasses import replace

import cv2
import numpy as np
import pytest

from rakelight.check.exposure import exposure, exposure_findings
from rakelight.check.measured import Measured
from rakelight.check.sharpness import (
    OUT_OF_FOCUS_PX,
    added_blur,
    edge_width,
    edge_widths,
    outline_widths,
    sharpness_findings,
)
from tests.check.tiled_scene import ball, cloth, mask_shape, tiled_scene
from tests.check.wrong_captures import sound, with_photograph


@pytest.mark.parametrize("sigma", [1.0, 2.0, 4.0])
@pytest.mark.parametrize("height", [30, 200])
def test_the_width_of_an_edge_is_its_blur_whatever_its_height(sigma, height):
    step = np.zeros((80, 80, 3), np.uint16)
    step[:, 40:] = 256 * height
    blurred = cv2.GaussianBlur(step, (0, 0), sigma)
    assert edge_width(blurred, np.ones((80, 80), bool)) == pytest.approx(sigma, abs=0.3)


def test_nothing_to_see_has_no_width():
    assert np.isnan(edge_width(np.full((50, 50, 3), 9, np.uint8), np.ones((50, 50), bool)))
    assert np.isnan(edge_width(np.zeros((5, 5, 3), np.uint8), np.ones((5, 5), bool)))


def softened(capture, sigmas_px):
    """The capture with its first photographs blurred by so many pixels."""
    photographs = capture.photographs.copy()
    for i, sigma in enumerate(sigmas_px):
        photographs[i] = cv2.GaussianBlur(photographs[i], (0, 0), sigma)
    return replace(capture, photographs=photographs)


def test_soft_photographs_are_not_compared():
    vase = sound("vase")[0]
    assert not added_blur(softened(vase, (6, 6, 8, 6, 6, 6, 6, 6)))[1].any()
    assert not added_blur(softened(vase.select([0, 1]), (0.4, 3.0)))[1].any()


@pytest.mark.parametrize(("relief", "count"), [(cloth, 6), (cloth, 12), (ball, 12)])
def test_edges_of_shading_that_the_light_makes_soft_are_not_out_of_focus(relief, count):
    assert sharpness_findings(Measured(tiled_scene(relief, count=count))) == ()


@pytest.mark.parametrize("which", [1, 3])
def test_a_blurred_photograph_of_shading_is_told_with_its_blur(which):
    capture = tiled_scene(cloth, count=8)
    soft = cv2.GaussianBlur(capture.photographs[which], (0, 0), 2)
    blur_px, blurred = added_blur(with_photograph(capture, which, lambda _: soft))
    assert np.flatnonzero(blurred).tolist() == [which]
    assert blur_px[which] == pytest.approx(2, abs=0.6)


def dark_and_glossy(seed, side=240, count=12):
    """A dark, finely uneven dome of which hardly more than its highlights is seen."""
    rng = np.random.default_rng(seed)
    y, x = (np.mgrid[:side, :side] - side / 2) / (0.45 * side)
    mask = np.hypot(x, y) < 1
    down, right = np.gradient(cv2.GaussianBlur(rng.standard_normal((side, side)), (0, 0), 1.5))
    uneven = 0.03 / np.hypot(right, down).std()
    normals = np.stack([0.5 * x + uneven * right, 0.5 * y + uneven * down, -np.ones_like(x)], -1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    turn = rng.uniform(0, 2 * np.pi, count)
    tilt = np.radians(rng.uniform(20, 60, count))
    lamps = np.stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), -np.cos(tilt)], -1)
    images = []
    for lamp in lamps:
        half = lamp - np.array([0, 0, 1])
        shine = np.maximum(normals @ half / np.linalg.norm(half), 0) ** 300
        lit = 0.02 * np.maximum(normals @ lamp, 0) + shine
        images.append(cv2.GaussianBlur(lit * mask, (0, 0), 0.7))
    light = np.stack(images) * 0.9 / np.quantile(np.stack(images)[:, mask], 0.99)
    light += 0.002 * rng.standard_normal(light.shape)
    photographs = np.rint(65535 * np.clip(light, 0, 1)).astype(np.uint16)[..., None].repeat(3, -1)
    return replace(sound("vase")[0], photographs=photographs, mask=mask)


@pytest.mark.parametrize("seed", [1, 3, 5])
def test_highlights_that_are_elsewhere_in_the_others_are_no_blur(seed):
    assert not added_blur(dark_and_glossy(seed))[1].any()


def test_what_is_saturated_says_nothing_of_focus():
    burnt = tiled_scene(mask_shape, exposure=4.0)
    assert not [f for f in sharpness_findings(Measured(burnt)) if f.code == "blurred"]


@pytest.mark.parametrize("sigma_px", [3, 6])
def test_all_out_of_focus_is_said(sigma_px):
    capture = sound("vase")[0]
    soft = np.stack([cv2.GaussianBlur(each, (0, 0), sigma_px) for each in capture.photographs])
    (found,) = sharpness_findings(Measured(replace(capture, photographs=soft)))
    assert (found.severity, found.code) == ("warning", "out-of-focus")


def test_soft_shading_with_a_sharp_outline_is_in_focus():
    capture = sound("vase")[0]
    inside = cv2.erode(capture.mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    photographs = capture.photographs.copy()
    for each in photographs:
        soft = cv2.GaussianBlur(each, (0, 0), 8)
        each[inside] = soft[inside]
    smooth = replace(capture, photographs=photographs)
    assert np.median(edge_widths(smooth)) > OUT_OF_FOCUS_PX
    assert np.median(outline_widths(smooth)) < 1
    assert not sharpness_findings(Measured(smooth))


def disc(radius, mask_radius):
    """Photographs of a disc with soft shading, sharp at its rim, and a mask of another radius."""
    side = 2 * (radius + 40)
    y, x = np.mgrid[:side, :side] - side / 2
    far = np.hypot(x, y)
    lit = np.stack([9000 * np.exp(-((x - u) ** 2 + y**2) / radius**2) for u in (-radius, radius)])
    photographs = np.where(far < radius, lit, 0)[..., None].repeat(3, axis=-1).astype(np.uint16)
    return replace(sound("vase")[0], photographs=photographs, mask=far < mask_radius)


@pytest.mark.parametrize(("radius", "mask_radius"), [(60, 60), (60, 48), (300, 300), (300, 288)])
def test_the_outline_tells_focus_whatever_the_size_and_the_mask(radius, mask_radius):
    capture = disc(radius, mask_radius)
    assert np.median(edge_widths(capture)) > OUT_OF_FOCUS_PX
    assert not sharpness_findings(Measured(capture))
    soft = np.stack([cv2.GaussianBlur(each, (0, 0), 4) for each in capture.photographs])
    (found,) = sharpness_findings(Measured(replace(capture, photographs=soft)))
    assert found.code == "out-of-focus"


def test_without_an_outline_soft_shading_says_nothing_of_focus():
    capture = disc(60, 60)
    middle = np.s_[60:140, 60:140]
    filled = replace(
        capture, photographs=capture.photographs[:, *middle], mask=np.ones((80, 80), bool)
    )
    assert np.median(edge_widths(filled)) > OUT_OF_FOCUS_PX
    assert not sharpness_findings(Measured(filled))


def test_the_blurred_one_of_a_capture():
    capture = with_photograph(sound("vase")[0], 5, lambda p: cv2.GaussianBlur(p, (0, 0), 3))
    assert np.flatnonzero(added_blur(capture)[1]).tolist() == [5]


def test_shares_of_a_capture():
    capture = sound("vase")[0]
    half = capture.photographs[2].copy()
    rows = np.nonzero(capture.mask)[0]
    half[: int(np.median(rows))] = 65535
    measured = Measured(with_photograph(capture, 2, lambda _: half))
    found = measured(exposure)
    assert found.saturated[2] == pytest.approx(0.5, abs=0.03)
    assert found.saturated[[0, 1, 3]].max() < 0.01
    assert np.flatnonzero(found.over).tolist() == [2]
    assert not found.under.any()
    assert capture.names[2] in exposure_findings(measured)[0].message


@pytest.mark.parametrize(("black", "under"), [(0.4, True), (0.2, False)])
def test_a_photograph_whose_object_is_largely_black_is_under_exposed(black, under):
    capture = sound("vase")[0]
    dark = capture.photographs[1].copy()
    dark[: int(np.quantile(np.nonzero(capture.mask)[0], black))] = 0
    measured = Measured(with_photograph(capture, 1, lambda _: dark))
    found = measured(exposure)
    assert found.black[1] == pytest.approx(black, abs=0.03)
    assert np.flatnonzero(found.under).tolist() == ([1] if under else [])
    assert [each.code for each in exposure_findings(measured)] == ["underexposed"] * under
    if under:  # its brighter part is bright
        assert exposure_findings(measured)[0].message.endswith(
            f"up to {found.black[1]:.0%} of the object black"
        )
