"""The viewer in a real browser: what it draws, measures, asks for, and how it is worked."""

import base64
import re
from dataclasses import replace

import numpy as np
import pytest

from rakelight.capture.images import decode_image
from rakelight.geometry.camera import back_project
from rakelight.geometry.normals import surface_normals
from rakelight.pipeline import refine
from rakelight.synthetic import DepthNoise, SceneOptions, make_albedo, make_shape, render_scene
from tests.report.report_scenes import CONTRAST, HOSTILE, enlarged, hostile_result, vase_result


@pytest.fixture(scope="module")
def vase():
    return vase_result()[0]


@pytest.fixture(scope="module")
def opened(browser, open_in, vase):
    opened = open_in(browser, vase)
    yield opened
    opened.page.context.close()


@pytest.fixture
def report(opened):
    """The vase's report, as it was when it was opened."""
    yield opened
    opened.page.keyboard.press("Escape")
    for name in ("moves the light", "Clay"):
        opened.page.get_by_label(name, exact=True).check()
    opened.page.get_by_role("button", name="Reset").click()
    opened.complaints.clear()


def srgb8(linear):
    """8-bit sRGB code values, written apart from the code under test."""
    linear = np.clip(linear, 0, 1)
    return 255 * np.where(linear < 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def set_range(report, key, value):
    report.page.locator(f"#{key}").fill(str(value))


def smooth_pixels(result, count=40):
    """Pixels whose surroundings have nearly the same normal."""
    n = np.nan_to_num(result.normals)
    change = sum(
        np.abs(n - np.roll(n, shift, axis)).max(axis=-1) for shift in (-2, 2) for axis in (0, 1)
    )
    found = np.argwhere(result.mask & (change < np.quantile(change[result.mask], 0.15)))
    return found[:: max(1, len(found) // count)]


def seen_and_expected(report, result, normals, lamp, intensity, ambient, specular=0, sharpness=1):
    """sRGB values of the clay at smooth pixels, what the shading model says, and their x."""
    halfway = lamp + np.array([0, 0, -1])
    halfway /= np.linalg.norm(halfway)
    picture, pairs = report.picture(), []
    for row, column in smooth_pixels(result):
        x, y = report.pixel_of(result, row, column)
        around = picture[int(y) - 1 : int(y) + 2, int(x) - 1 : int(x) + 2, 0]
        lit = max(0, normals[row, column] @ lamp)
        value = 0.8 * (1 - 0.6 * specular) * (intensity * lit + ambient)
        if lit > 0:
            shine = max(0, normals[row, column] @ halfway) ** sharpness
            value += specular * intensity * shine
        pairs.append((around.mean(), srgb8(value), x))
    return np.array(pairs)


def lamp_at(azimuth, elevation):
    a, e = np.radians([azimuth, elevation])
    return np.array([np.sin(a) * np.cos(e), -np.cos(a) * np.cos(e), -np.sin(e)])


# ---- it shows the surface


def test_it_is_ready_and_asked_for_nothing(report):
    assert report.state == "ready"
    assert [request.url for request in report.requests] == [report.address]
    assert report.complaints == []
    assert report.page.evaluate("violations") == []
    assert not report.page.is_visible("#fallback")


@pytest.mark.parametrize(("azimuth", "elevation"), [(315, 30), (90, 45), (180, 70)])
def test_relighting_follows_the_shading_model(report, vase, azimuth, elevation):
    for key, value in (
        ("azimuth", azimuth), ("elevation", elevation), ("intensity", 0.9), ("ambient", 0.15)
    ):  # fmt: skip
        set_range(report, key, value)
    seen, expected, _ = seen_and_expected(
        report, vase, vase.normals, lamp_at(azimuth, elevation), 0.9, 0.15
    ).T
    assert np.ptp(expected) > 40
    assert np.abs(seen - expected).max() < 6
    assert abs(np.mean(seen - expected)) < 0.7


def test_dragging_moves_the_lamp_there(report, vase):
    before = report.picture().astype(int)
    box = report.box
    report.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    report.page.mouse.down()
    reach = 0.47 * min(box["width"], box["height"]) * np.cos(np.radians(30))
    report.page.mouse.move(box["x"] + box["width"] / 2 + reach, box["y"] + box["height"] / 2)
    report.page.mouse.up()
    assert report.page.input_value("#azimuth") == "90"
    assert float(report.page.input_value("#elevation")) == pytest.approx(30, abs=1)
    after = report.picture().astype(int)
    height = vase.depth.shape[0]
    column = np.nonzero(vase.mask[height // 2])[0]
    for end, brighter in ((column[3], False), (column[-4], True)):
        x, y = (int(k) for k in report.pixel_of(vase, height // 2, end))
        assert (after[y, x, 0] > before[y, x, 0]) == brighter


def test_the_wipe_shows_the_surface_before_on_its_left(report, vase):
    for key, value in (("azimuth", 0), ("elevation", 40), ("ambient", 0.1), ("wipe", 0.5)):
        set_range(report, key, value)
    prepared = surface_normals(vase.prepared_depth, vase.mask, vase.camera)
    lamp, middle = lamp_at(0, 40), report.box["width"] / 2
    old = seen_and_expected(report, vase, prepared, lamp, 1, 0.1)
    new = seen_and_expected(report, vase, vase.normals, lamp, 1, 0.1)
    left, right = old[:, 2] < middle - 3, old[:, 2] > middle + 3
    assert np.abs(old[left, 0] - old[left, 1]).mean() < 3
    assert np.abs(new[right, 0] - new[right, 1]).mean() < 3
    assert np.abs(new[left, 0] - new[left, 1]).mean() > 10


def test_every_surface_looks_different(report):
    pictures = []
    for name in ("Clay", "Albedo", "Normals", "Confidence"):
        report.page.get_by_label(name, exact=True).check()
        pictures.append(report.picture().astype(int))
    for i, picture in enumerate(pictures):
        for other in pictures[i + 1 :]:
            assert np.abs(picture - other).mean() > 2


def test_normals_and_confidence_have_their_colours(report, vase):
    row, column = smooth_pixels(vase)[11]
    x, y = (int(k) for k in report.pixel_of(vase, row, column))
    report.page.get_by_label("Normals", exact=True).check()
    expected = 127.5 * (vase.normals[row, column] * [1, -1, -1] + 1)
    assert np.abs(report.picture()[y, x] - expected).max() < 6
    confident = open_picture_at(report, "Confidence", x, y)
    share = 4 * float(vase.confidence[row, column])
    stops = np.array([(0, 34, 78), (66, 78, 108), (125, 124, 120), (187, 174, 109), (254, 232, 56)])
    below = min(int(share), 3)
    ramp = stops[below] + (share - below) * (stops[below + 1] - stops[below])
    assert np.abs(confident - ramp).max() < 8


def open_picture_at(report, name, x, y):
    report.page.get_by_label(name, exact=True).check()
    return report.picture()[y, x].astype(float)


def test_specular_enhance_adds_a_highlight(report, vase):
    for key, value in (
        ("azimuth", 300), ("elevation", 50), ("intensity", 0.7), ("ambient", 0.1),
        ("specular", 0.5), ("shininess", 8),
    ):  # fmt: skip
        set_range(report, key, value)
    lamp = lamp_at(300, 50)
    seen, shining, _ = seen_and_expected(report, vase, vase.normals, lamp, 0.7, 0.1, 0.5, 8).T
    _, plain, _ = seen_and_expected(report, vase, vase.normals, lamp, 0.7, 0.1).T
    assert np.abs(seen - shining).max() < 8
    assert np.abs(seen - plain).max() > 20


def test_the_geometry_is_decimated(open_report, vase):
    big = enlarged(vase, 4)
    assert 2 * big.mask.sum() > 200_000
    report = open_report(big)
    triangles = int(report.page.get_attribute("#canvas", "data-triangles"))
    assert 30_000 < triangles <= 150_000


def test_nothing_is_drawn_without_an_input(report):
    report.settle()
    report.settle()
    drawn = report.page.evaluate("drawn")
    for _ in range(10):
        report.settle()
    assert report.page.evaluate("drawn") == drawn
    set_range(report, "ambient", 0.3)
    report.settle()
    assert report.page.evaluate("drawn") == drawn + 1


def test_a_lost_context_comes_back(open_report, vase):
    report = open_report(vase)
    before = report.picture()
    report.page.evaluate(
        """async () => {
          const canvas = document.getElementById("canvas");
          const lose = canvas.getContext("webgl2").getExtension("WEBGL_lose_context");
          const told = (what) => new Promise((go) => canvas.addEventListener(what, go));
          const lost = told("webglcontextlost"), restored = told("webglcontextrestored");
          lose.loseContext();
          await lost;
          setTimeout(() => lose.restoreContext());
          await restored;
        }"""
    )
    report.settle()
    np.testing.assert_array_equal(report.picture(), before)


# ---- it measures


def measured_mm(report):
    return float(re.search(r"Distance ([\d.]+) mm", report.page.inner_text("#measured"))[1])


def distance_mm(depth_m, camera, *ends):
    points = back_project(depth_m, camera)
    return 1000 * np.linalg.norm(points[ends[0]] - points[ends[1]])


def test_a_width_of_a_synthetic_capture_is_right_to_one_percent(open_report):
    vase = make_shape("vase")
    scene = SceneOptions(
        camera=vase.camera.scaled(0.3), photographs=6, depth_factor=2,
        depth_noise=DepthNoise(rms_mm=2.0),
    )  # fmt: skip
    capture, truth = render_scene(vase, make_albedo("pattern"), scene)
    result = refine(capture)
    report = open_report(result)
    report.page.get_by_label("measures").check()
    row = truth.mask.shape[0] // 2
    columns = np.nonzero(truth.mask[row])[0]
    ends = (row, columns[4]), (row, columns[-5])
    for end in ends:
        report.click(*report.pixel_of(result, *end))
    width = distance_mm(truth.depth, scene.camera, *ends)
    assert measured_mm(report) == pytest.approx(width, rel=0.01)
    # and the unit and focal length are in it: a tenth more would be seen
    assert measured_mm(report) != pytest.approx(1.02 * width, rel=0.01)


def test_distances_stay_when_the_object_is_turned(report, vase):
    row = vase.mask.shape[0] // 2 - 20
    columns = np.nonzero(vase.mask[row])[0]
    ends = (row, columns[len(columns) // 4]), (row + 45, columns[len(columns) // 2])
    report.page.locator("#canvas").press("t")
    for _ in range(5):
        report.page.locator("#canvas").press("ArrowRight")
    report.page.get_by_label("measures").check()
    points = back_project(vase.depth, vase.camera)
    for end in ends:
        report.click(*turned_pixel(report, vase, points[end], yaw=25))
    assert measured_mm(report) == pytest.approx(
        distance_mm(vase.depth, vase.camera, *ends), rel=0.01
    )


def turned_pixel(report, result, point, yaw):
    """Where a point in metres is seen after a turn about the vertical through the middle."""
    from rakelight.pictures.shown import object_window

    camera = result.camera.cropped(*object_window(result.mask))
    z = np.sort(result.depth[result.mask])[result.mask.sum() // 2]
    middle = np.array([(camera.width - 1) / 2, (camera.height - 1) / 2])
    pivot = np.append((middle - [camera.cx, camera.cy]) / camera.fx * z, z)
    a = np.radians(yaw)
    turn = np.array([[np.cos(a), 0, -np.sin(a)], [0, 1, 0], [np.sin(a), 0, np.cos(a)]])
    q = turn @ (point - pivot) + pivot
    fit = 0.94 * min(report.box["width"] / camera.width, report.box["height"] / camera.height)
    seen = camera.fx * (q[:2] / q[2] - pivot[:2] / pivot[2])
    return np.array([report.box["width"], report.box["height"]]) / 2 + fit * seen


def test_the_profile_shows_before_and_after(report, vase):
    report.page.get_by_label("measures").check()
    row = vase.mask.shape[0] // 2
    columns = np.nonzero(vase.mask[row])[0]
    assert not report.page.is_visible("#profile")
    for column in (columns[10], columns[-10]):
        report.click(*report.pixel_of(vase, row, column))
    assert report.page.is_visible("#profile")
    curves = {
        name: np.array(
            re.findall(
                r"[ML]([\d.]+) ([\d.]+)",
                report.page.get_attribute(f"#profile-chart .curve.{name}", "d"),
            ),
            float,
        )
        for name in ("before", "after")
    }
    # The vase bulges towards the viewer: up in the chart, where y is small.
    after = curves["after"][:, 1]
    assert after[len(after) // 2] < min(after[0], after[-1]) - 40
    # The depth before waves about the other.
    assert np.abs(curves["before"][:, 1] - after).max() > 3
    report.page.get_by_label("Level the ends").check()
    report.page.keyboard.press("Tab")
    report.page.get_by_role("button", name="Clear").click()
    assert not report.page.is_visible("#profile")


def test_a_click_beside_the_object_says_so(report):
    report.page.get_by_label("measures").check()
    report.click(60, 4)
    assert report.page.inner_text("#measured") == "There is no surface here."


# ---- it is worked by keys, and read by everybody


def test_keys(report):
    canvas = report.page.locator("#canvas")
    canvas.focus()
    for key, field, value in (
        ("ArrowRight", "azimuth", 313),
        ("ArrowUp", "elevation", 29),
        ("]", "wipe", 0.05),
    ):
        canvas.press(key)
        assert float(report.page.input_value(f"#{field}")) == pytest.approx(value)
    canvas.press("2")
    assert report.page.get_by_label("Albedo", exact=True).is_checked()
    still = report.picture().astype(int)
    canvas.press("+")
    assert np.abs(report.picture().astype(int) - still).mean() > 1
    canvas.press("0")
    assert float(report.page.input_value("#azimuth")) == 308
    canvas.press("m")
    canvas.press("Enter")
    for _ in range(4):
        canvas.press("ArrowDown")
    canvas.press("Enter")
    assert measured_mm(report) > 10
    canvas.press("Escape")
    assert report.page.inner_text("#measured") == "Choose two points on the surface."


TOUCH = """(fingers) => {
  const canvas = document.getElementById("canvas"), box = canvas.getBoundingClientRect();
  canvas.setPointerCapture = () => {};
  for (const [type, id, x, y] of fingers) {
    canvas.dispatchEvent(new PointerEvent(type, {
      pointerId: id, pointerType: "touch", bubbles: true, button: 0,
      clientX: box.left + x, clientY: box.top + y,
    }));
  }
}"""


def test_two_fingers_zoom_and_the_wheel_does_once_the_picture_was_clicked(open_report, vase):
    report = open_report(vase)

    def wide():
        seen = report.picture()[2:-2, 2:-2, 0] > 60
        return np.ptp(np.nonzero(seen.any(axis=0))[0])

    report.page.get_by_label("turns").check()
    x, y = report.size[0] / 2, report.size[1] / 2
    before = wide()
    report.page.evaluate(
        TOUCH,
        [
            ("pointerdown", 1, x - 50, y),
            ("pointerdown", 2, x + 50, y),
            ("pointermove", 2, x + 75, y),
            ("pointermove", 1, x - 75, y),
            ("pointerup", 1, x - 75, y),
            ("pointerup", 2, x + 75, y),
        ],
    )
    assert wide() == pytest.approx(1.5 * before, rel=0.03)
    report.page.get_by_role("button", name="Reset").click()
    box = report.box
    report.page.mouse.move(box["x"] + x, box["y"] + y)
    report.page.mouse.wheel(0, -200)
    assert wide() == before
    report.page.locator("#canvas").focus()
    report.page.mouse.move(box["x"] + x, report.box["y"] + y)
    report.page.mouse.wheel(0, -200)
    report.settle()
    assert wide() > 1.2 * before


def pinch(x, y):
    return [
        ("pointerdown", 1, x - 50, y),
        ("pointerdown", 2, x + 50, y),
        ("pointermove", 2, x + 75, y),
        ("pointerup", 1, x - 50, y),
        ("pointerup", 2, x + 75, y),
    ]


def ends_on(report, result, share=0.5):
    """Measure across the vase's middle row."""
    report.page.get_by_label("measures").check()
    row = result.mask.shape[0] // 2
    columns = np.nonzero(result.mask[row])[0]
    for column in (columns[len(columns) // 4], columns[int(share * len(columns))]):
        report.click(*report.pixel_of(result, row, column))


def test_a_second_finger_takes_back_what_the_first_did(report, vase):
    ends_on(report, vase)
    before = measured_mm(report)
    middle = report.size[0] / 2, report.size[1] / 2
    report.page.evaluate(TOUCH, pinch(*middle))
    assert measured_mm(report) == before
    report.page.get_by_label("moves the light").check()
    report.page.select_option("#photograph", index=1)
    lamp = report.page.input_value("#azimuth"), report.page.input_value("#elevation")
    report.page.evaluate(TOUCH, pinch(*middle))
    assert (report.page.input_value("#azimuth"), report.page.input_value("#elevation")) == lamp
    assert report.page.input_value("#photograph") != ""


def test_a_click_beside_the_object_leaves_what_is_measured(report, vase):
    ends_on(report, vase)
    before = measured_mm(report)
    report.click(60, 4)
    assert measured_mm(report) == before


END = "(({ e, f }) => [e, f])(document.getElementById('end-b').transform.baseVal[0].matrix)"


def test_what_is_in_the_middle_stays_there_in_another_window(open_report, vase):
    report = open_report(vase)
    ends_on(report, vase)
    canvas = report.page.locator("#canvas")
    for key in ["t", *["+"] * 4, *["Shift+ArrowRight"] * 4, "Shift+ArrowDown"]:
        canvas.press(key)

    def off_middle():
        report.settle()
        return np.array(report.page.evaluate(END)) - [
            report.box["width"] / 2,
            report.box["height"] / 2,
        ]

    before, height = off_middle(), report.box["height"]
    assert np.linalg.norm(before) > 60
    report.page.set_viewport_size({"width": 900, "height": 420})
    report.settle()
    smaller = report.box["height"] / height
    assert smaller < 0.8
    np.testing.assert_allclose(off_middle(), smaller * before, atol=1.5)


def test_every_control_has_a_name_and_can_be_reached(report):
    unnamed = report.page.evaluate(
        """[...document.querySelectorAll("input, select, button, [tabindex]")].filter((one) =>
          one.tabIndex < 0 || !(one.getAttribute("aria-label") || one.textContent.trim()
                                || one.labels?.length))
          .map((one) => one.outerHTML)"""
    )
    assert unnamed == []
    assert report.page.evaluate("[...document.images].every((one) => one.alt)")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_stands_out_from_its_ground(open_report, scheme):
    report = open_report(hostile_result(), color_scheme=scheme)
    ratio, where = report.page.evaluate(CONTRAST)
    assert ratio >= 4.5, where


def test_a_narrow_screen_shows_everything(open_report, vase):
    long = tuple(f"PXL_20240312_174523123_exposure_stack_export_{i}.png" for i in range(4))
    result, truth = replace(vase, photograph_names=long), vase_result()[1]
    report = open_report(result, truth, viewport={"width": 360, "height": 800}, has_touch=True)
    assert report.page.evaluate("document.documentElement.scrollWidth") == 360
    assert report.box["width"] > 320
    before = report.page.locator("tbody th", has_text="before").bounding_box()
    assert before["height"] < 40  # on one line


def test_a_lamp_behind_the_object_is_not_on_the_dial(open_report, vase):
    vector = vase.lights.vector.copy()
    vector[0, 0, 2] *= -1
    report = open_report(replace(vase, lights=replace(vase.lights, vector=vector)))
    assert report.page.locator("#dial .dot").count() == 3
    vector[..., 2] = np.abs(vector[..., 2])
    report = open_report(replace(vase, lights=replace(vase.lights, vector=vector)))
    assert not report.page.is_visible("#photograph")
    report.page.locator("#canvas").press("ArrowRight")
    assert report.complaints == []


def test_a_page_that_one_goes_back_to_names_no_photograph(open_report, vase):
    report = open_report(vase)
    report.page.select_option("#photograph", index=1)
    report.page.goto("about:blank")
    report.page.go_back()
    report.page.wait_for_selector("html[data-state=ready]")
    assert report.page.input_value("#azimuth") == "308"
    assert report.page.input_value("#photograph") == ""


def test_paper_gets_the_view_and_the_pictures(open_report, vase):
    report = open_report(vase)
    report.page.emulate_media(media="print")
    report.page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert report.page.get_attribute("#still", "src").startswith("data:image/jpeg;base64,")
    assert report.page.is_visible("#still")
    assert not report.page.is_visible("#measuring")
    assert "lamp at the upper left (308°), 24°" in report.page.inner_text("#still-caption")
    assert not report.page.is_visible(".panel")
    assert report.page.locator(".pictures img >> visible=true").count() == 5
    assert report.page.get_by_text("depth weight", exact=True).is_visible()
    report.page.evaluate("dispatchEvent(new Event('afterprint'))")
    assert not report.page.get_by_text("depth weight", exact=True).is_visible()
    assert report.complaints == []


def test_paper_gets_the_measured_line(open_report, vase):
    report = open_report(vase)

    def lamp_coloured():
        report.page.evaluate("dispatchEvent(new Event('beforeprint'))")
        data = report.page.get_attribute("#still", "src").partition(",")[2]
        red, green, blue = np.moveaxis(decode_image(base64.b64decode(data)).astype(int), -1, 0)
        return np.count_nonzero((red > 230) & (blue < 170) & (green > 190))

    assert lamp_coloured() == 0
    ends_on(report, vase)
    report.page.emulate_media(media="print")
    assert lamp_coloured() > 100
    assert report.page.is_visible("#measured")
    assert report.complaints == []


# ---- it is safe, and does without WebGL


def test_hostile_names_are_text(open_report):
    report = open_report(hostile_result())
    assert report.state == "ready"
    assert report.dialogs == []
    assert report.complaints == []
    shown = report.page.inner_text("body")
    assert shown.count("<script>alert(1)</script>") >= 4
    assert "{{7*7}}" in shown
    assert "\u202e" not in report.page.content()
    assert report.page.locator("img:not([src^='data:image/jpeg'])[src]").count() == 0
    option = report.page.locator("#photograph option").nth(1)
    assert option.text_content() == HOSTILE.replace("\u202e", "\\u202e")


def test_the_policy_forbids_every_request(open_report, vase):
    report = open_report(vase)
    report.page.evaluate(
        """async () => {
          new Image().src = "http://127.0.0.1:9/x.png";
          await fetch("http://127.0.0.1:9/").catch(() => 0);
          document.head.append(Object.assign(document.createElement("script"),
                                             { textContent: "window.ran = true" }));
          document.body.insertAdjacentHTML("beforeend", "<b style='color: red'>x</b>");
        }"""
    )
    report.settle()
    assert report.page.evaluate("window.ran") is None
    assert {name.split("-")[0] for name in report.page.evaluate("violations")} == {
        "img", "connect", "script", "style"
    }  # fmt: skip
    assert [request.failure for request in report.requests[1:]] == ["csp"]


def test_without_webgl_there_are_pictures_and_a_word(launch, open_in):
    with launch("--disable-gpu", "--disable-3d-apis") as browser:
        report = open_in(browser, vase_result(0.1)[0])
        assert report.state == "nowebgl"
        assert "no WebGL" in report.page.inner_text("#fallback")
        assert not report.page.is_visible("#viewer")
        pictures = report.page.locator(".pictures img")
        assert [pictures.nth(k).get_attribute("alt").split(":")[0] for k in range(5)] == [
            "Before", "After", "Albedo", "Normals", "Confidence"
        ]  # fmt: skip
        assert report.page.evaluate("[...document.images].every(i => !i.src || i.naturalWidth)")
        assert report.complaints == []


def test_a_damaged_page_says_so_and_shows_its_pictures(open_report, vase, monkeypatch):
    monkeypatch.setattr("rakelight.report.encoded_maps.encode", lambda values: "bm8gcGxhbmU=")
    report = open_report(vase)
    assert report.state == "failed"
    assert "could not start" in report.page.inner_text("#fallback")


def test_a_browser_that_cannot_unpack_the_maps_shows_pictures_and_a_word(open_report):
    report = open_report(vase_result(0.1)[0])
    assert report.state == "ready"
    report.page.add_init_script("delete window.DecompressionStream")
    report.page.goto(report.address)
    report.page.wait_for_selector("html:not([data-state=loading])", timeout=30_000)
    assert report.state == "failed"
    assert "cannot unpack the maps" in report.page.inner_text("#fallback")
    assert report.page.is_visible(".pictures img >> nth=0")
