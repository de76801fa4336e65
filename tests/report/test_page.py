"""The page as text: its policy, its figures, what stands where."""

import re
from base64 import b64encode
from dataclasses import replace
from hashlib import sha256

import numpy as np
import pytest

from rakelight.export import read_summary
from rakelight.metrics import evaluate_maps
from rakelight.model import Finding, Lights
from rakelight.report import report_html, save_result
from tests.report.report_scenes import HOSTILE, hostile_result, vase_result


@pytest.fixture(scope="module")
def small():
    return vase_result(0.1)


def page_of(result, truth=None):
    return report_html(result, truth).decode("utf-8")


def test_the_policy_names_the_hashes_of_the_script_and_the_style(small):
    page = page_of(small[0])
    (policy,) = re.findall(r'Content-Security-Policy" content="([^"]*)"', page)
    for kind, tag in (("script", "<script>"), ("style", "<style>")):
        (text,) = re.findall(f"{tag}(.*?)</{kind}>", page, re.DOTALL)
        digest = b64encode(sha256(text.encode()).digest()).decode()
        assert f"{kind}-src &#39;sha256-{digest}&#39;" in policy
    assert policy.startswith("default-src &#39;none&#39;;")
    assert "img-src data:;" in policy


def test_the_page_names_no_other_address(small):
    page = page_of(small[0])
    linked = re.findall(r"""(?:src|href|action|data|poster)\s*=\s*["']([^"']*)""", page)
    assert linked
    assert all(address.startswith("data:") for address in linked)
    without_svg = page.replace("http://www.w3.org/2000/svg", "")
    assert not re.search(r"https?://|@import|url\(", without_svg)


def test_hostile_texts_are_escaped():
    page = page_of(hostile_result())
    assert HOSTILE[:30] not in page
    assert "<script>alert" not in page
    assert "<img src=x" not in page
    assert "&lt;script&gt;alert(1)" in page
    assert "\u202e" not in page


def test_names_that_are_not_utf8_are_escaped(small):
    page = page_of(replace(small[0], source="captures/caf\udce9"))
    assert "<h1>caf\\xe9</h1>" in page


def test_warnings_come_first_and_notes_do_not(small):
    warned = replace(
        small[0],
        findings=(
            Finding("note", "a", "a quiet note"),
            Finding("warning", "b", "a loud warning", "do this"),
        ),
    )
    page = page_of(warned)
    places = [page.index(text) for text in ("a loud warning", 'id="viewer"', "a quiet note")]
    assert places == sorted(places)
    assert "1 warning<" in page
    assert "To do: do this" in page
    assert 'class="warnings"' not in page_of(small[0])


def test_errors_are_shown_where_the_truth_is_known(small):
    result, truth = small
    page = page_of(replace(result, depth=result.depth + 0.001), truth)
    scores = evaluate_maps(result.depth + 0.001, result.normals, truth)
    row = re.findall(r'<th scope="row">after</th>(.*?)</tr>', page)[0]
    cells = re.findall(r"<td>([\d.]+)", row)
    assert cells[:2] == [f"{scores.depth.rmse_mm:.2f}", f"{scores.depth.median_mm:.2f}"]
    assert cells[0] == "1.00"
    assert "Depth error before" in page
    assert "Normal error after" in page
    assert "Against the truth" not in page_of(result)


def test_a_truth_of_another_size_is_left_out(small, tmp_path):
    result, _ = small
    save_result(result, tmp_path / "out", truth=vase_result(0.2)[1])
    assert "Against the truth" not in (tmp_path / "out" / "report.html").read_text()
    assert "report.html" in read_summary(tmp_path / "out").files


def test_the_figures_of_the_capture(small):
    text = re.sub(r"<[^>]*>", " ", page_of(small[0]))
    z = np.median(small[0].depth[small[0].mask])
    for words in (
        "4, 48 × 36 pixels, 16 bit, linear; moving lamp",
        f"{small[0].mask.sum()} pixels at a median depth of {1000 * z:.0f} mm",
        f"{1000 * z / small[0].camera.fx:.3g} mm of the object",
        "3; came to rest",
        "chosen from the data",
        "worst is 002.png with 8.0 %",
    ):
        assert words in text


def test_a_result_without_lights_energy_or_prediction_says_so(small):
    bare = replace(
        small[0],
        lights=Lights(np.zeros((1, 1, 3)), np.zeros((1, 1))),
        energy=(),
        prediction_errors=(),
        capture={},
        converged=False,
    )
    page = page_of(bare)
    assert "No lamp was found" in page
    assert "Energy per iteration" not in page
    assert "three photographs or more" in page
    assert "not converged" in page


def test_expected_errors_are_shown_where_there_are_any(small):
    assert "Expected errors" not in page_of(small[0])
    sigma = np.where(small[0].mask, 0.0025, np.nan)
    page = page_of(replace(small[0], depth_sigma=sigma, normal_sigma=1000 * sigma))
    assert "2.50 mm in depth, 2.5 degrees in normals, medians" in page


def test_a_lamp_behind_the_object_is_not_offered_to_the_viewer(small):
    lights = Lights(np.array([[[0.0, 0.0, -1.0]], [[0.0, 0.5, 0.9]]]), np.zeros((2, 1)))
    page = page_of(replace(small[0], lights=lights, photograph_names=("front", "behind")))
    assert re.findall(r'<option value="\d+">(\w+)', page) == ["front"]


def test_a_surface_without_depth_before_is_shown(small):
    page = page_of(replace(small[0], prepared_depth=np.full_like(small[0].depth, np.nan)))
    assert "Depth moved by" not in page
