"""`--set NAME=VALUE` on `rakelight refine`."""

import json
from dataclasses import MISSING, fields
from typing import Literal, get_type_hints

import pytest

from rakelight.cli.settings import options_with, read_value
from rakelight.errors import InputError
from rakelight.methods import METHODS, load_method


def saved_options(folder):
    return json.loads((folder / "result.json").read_text())["options"]


def test_settings_reach_the_method(run, capture, tmp_path):
    settings = ("depth_weight=2.5", "max_iterations=2", "min_photographs=3")
    set_all = [word for each in settings for word in ("--set", each)]
    ran = run(
        "refine", capture, "-o", tmp_path / "out", "--method", "multi-light-alternating", *set_all
    )
    assert ran.code == 0, ran.err
    options = saved_options(tmp_path / "out")
    assert (options["depth_weight"], options["max_iterations"]) == (2.5, 2)
    assert (options["min_photographs"], options["tolerance"]) == (3, 1e-2)


def test_settings_under_auto_are_of_the_method_that_is_chosen(run, capture, tmp_path):
    ran = run(
        *("refine", capture, "-o", tmp_path / "out", "--json"),
        *("--set", "lights=white", "--set", "depth_weight=none", "--set", "max_iterations=3"),
    )
    assert ran.code == 0, ran.err
    assert json.loads(ran.out)["method"] == "multi-light"
    options = saved_options(tmp_path / "out")
    assert (options["lights"], options["depth_weight"]) == ("white", None)
    # The same name is of another method for one photograph.
    ran = run(
        *("refine", capture, "-o", tmp_path / "one", "--photographs", "0"),
        *("--set", "smooth=false", "--set", "max_iterations=1"),
    )
    assert ran.code == 0, ran.err
    assert saved_options(tmp_path / "one")["smooth"] is False


@pytest.mark.parametrize("method", ["auto", "multi-light"])
@pytest.mark.parametrize(
    ("setting", "about", "words"),
    [
        ("depth_wieght=3", "--set depth_wieght", ("multi-light has no such option", "needed one of "
         "depth_weight, lights, distance", "Fix: did you mean depth_weight?")),
        ("depth-weight=3", "--set depth-weight", ("did you mean depth_weight?",)),
        ("smooth=true", "--set smooth", ("multi-light has no such option",)),
        ("depth_weight=much", "--set depth_weight", ("seen much, needed a number or none",)),
        ("depth_weight=nan", "--set depth_weight", ("seen nan, needed a number or none",)),
        ("depth_weight=-1", "--set", ("option depth_weight (seen -1.0, needed above 0",)),
        ("max_iterations=2.5", "--set max_iterations", ("seen 2.5, needed a whole number",)),
        ("max_iterations=none", "--set max_iterations", ("needed a whole number",)),
        ("tolerance=none", "--set tolerance", ("seen none, needed a number)",)),
        ("lights=green", "--set lights", ("seen green, needed auto or white or coloured",)),
        ("depth_weight", "--set depth_weight", ("not a setting", "needed NAME=VALUE")),
        ("=3", "--set =3", ("not a setting",)),
        ("lights=", "--set lights=", ("not a setting",)),
    ],
)  # fmt: skip
def test_settings_that_cannot_be(refused, capture, tmp_path, method, setting, about, words):
    command = ("refine", capture, "-o", tmp_path / "out", "--method", method, "--set", setting)
    refused(*command, about=about, words=words)


def test_a_method_that_is_none_is_seen_before_the_capture_is_read(run, tmp_path):
    ran = run("refine", tmp_path / "missing", "-o", tmp_path / "out", "--method", "typo")
    assert ran.code == 2
    assert "typo" in ran.err
    assert "missing" not in ran.err


def test_a_setting_twice(refused, capture, tmp_path):
    command = ("refine", capture, "-o", tmp_path / "out", "--set", "lights=auto", "--set")
    refused(*command, "lights=white", about="--set lights", words=("seen auto and white",))


def test_a_wrong_setting_is_seen_before_the_capture_is_read(refused, tmp_path):
    command = ("refine", tmp_path / "none", "-o", tmp_path / "out", "--method", "ldr-ps")
    refused(*command, "--set", "shade=1", about="--set shade", words=("did you mean shadow?",))


@pytest.mark.parametrize(
    ("text", "kind", "value"),
    [
        ("1e-3", float, 0.001),
        ("3", float, 3.0),
        ("3", int, 3),
        ("True", bool, True),
        ("false", bool, False),
        ("None", float | None, None),
        ("0", int | None, 0),
        ("near", Literal["near", "far"], "near"),
    ],
)
def test_values_of_every_type(text, kind, value):
    found = read_value(text, kind, "--set x")
    assert (type(found), found) == (type(value), value)


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("1", bool),
        ("yes", bool),
        ("inf", float),
        ("9" * 400, int),
        ("", float),
        ("Near", Literal["near"]),
    ],
)
def test_values_of_no_type(text, kind):
    with pytest.raises(InputError, match="not a value of this option"):
        read_value(text, kind, "--set x")


@pytest.mark.parametrize("name", METHODS)
def test_every_option_of_every_method_can_be_set(name):
    method = load_method(name)
    kinds = get_type_hints(method.options)
    for field in fields(method.options):
        assert field.default is not MISSING
        text = str(field.default).lower()
        assert options_with(method, {field.name: text}) == method.options()
        assert read_value(text, kinds[field.name], "") == field.default
