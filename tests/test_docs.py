"""README.md and docs/ say what the program does: commands, options, methods, files, exit codes."""

import ast
import re
import runpy
import shlex
from inspect import signature
from pathlib import Path

import click
import msgspec
import numpy as np
import pytest

import rakelight
from rakelight import errors
from rakelight.capture.config import (
    CaptureTable,
    DistortionTable,
    IntrinsicsTable,
    NoiseTable,
    TransformTable,
    parse_config,
)
from rakelight.check.findings import FINDINGS
from rakelight.cli.commands import COMMANDS
from rakelight.cli.commands import rakelight as program
from rakelight.errors import InputError, MachineError, RakelightError
from rakelight.export.mesh_formats import MESH_FORMATS, mesh_file
from rakelight.export.summary import Conventions, Summary
from rakelight.methods import METHODS, load_method
from rakelight.model import Camera, Capture, Lights, Result
from rakelight.report import save_result
from rakelight.synthetic import SceneOptions, make_albedo, make_shape, render_scene
from tests.test_layers import SOURCES

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = sorted([*ROOT.glob("*.md"), *DOCS.glob("**/*.md"), ROOT / "benchmarks/README.md"])
IDS = [str(page.relative_to(ROOT)) for page in PAGES]
FENCED = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
CALL = re.compile(r"^(?:\$ )?rakelight (.+)$")


def text_of(name):
    return (ROOT / name).read_text(encoding="utf-8")


def blocks(text, language):
    """The contents of the fenced blocks of one language."""
    return [content for name, content in FENCED.findall(text) if name == language]


def code(text):
    """Every piece of code a reader would type: inline, indented, and fenced shell blocks."""
    prose = FENCED.sub("", text)
    indented = re.findall(r"^    (\S.*)$", prose, re.MULTILINE)
    shell = [line for name in ("", "sh", "bash", "console") for line in blocks_lines(text, name)]
    return re.findall(r"`([^`\n]+)`", prose) + indented + shell


def blocks_lines(text, language):
    return [line.strip() for block in blocks(text, language) for line in block.splitlines()]


def table(text, heading):
    """The rows below the header that starts with `heading`, each a list of its cells."""
    lines = text.splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith(f"| {heading} |"))
    rows = []
    for line in lines[start + 2 :]:
        if not line.startswith("|"):
            break
        rows.append([cell.strip() for cell in line.strip("|").split("|")])
    return rows


def command(name):
    return program.get_command(click.Context(program), name)


def options_of(name):
    return {spelling for option in command(name).params for spelling in option.opts}


def calls(text):
    """Every `rakelight COMMAND …` in a text, as its words after `rakelight`."""
    for piece in code(text):
        found = CALL.match(piece.split("  #")[0].strip())
        if found:
            yield shlex.split(found[1])


def test_the_readme_names_every_command():
    named = {words[0] for words in calls(text_of("README.md"))}
    assert set(COMMANDS) <= named


@pytest.mark.parametrize("page", PAGES, ids=IDS)
def test_commands_that_are_named_exist(page):
    for words in calls(page.read_text(encoding="utf-8")):
        assert words[0] in COMMANDS or words[0].startswith("-"), words
        if len(words) > 1 and "..." not in words and "…" not in words:
            command(words[0]).make_context(words[0], words[1:])  # raises where it cannot be


@pytest.mark.parametrize("page", PAGES, ids=IDS)
def test_options_that_are_named_exist(page):
    everywhere = {"--help", "--version"}.union(*map(options_of, COMMANDS))
    for line in page.read_text(encoding="utf-8").splitlines():
        named = set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", " ".join(re.findall(r"`[^`]+`", line))))
        (*about,) = {words[0] for words in calls(line)} & set(COMMANDS)
        known = options_of(about[0]) | {"--help"} if len(about) == 1 else everywhere
        if line.startswith("`make") or "pip" in line or "ruff" in line or "mypy" in line:
            continue
        assert named <= known, line


def test_values_that_are_named_exist():
    for piece in code(text_of("README.md")):
        found = re.fullmatch(r"(--[a-z-]+) (\S+)", piece)
        if found and found[1] in options_of("refine"):
            context = ["capture", "-o", "out", *found.groups()]
            assert command("refine").make_context("refine", context)


def test_the_readme_mentions_the_options_of_refine():
    row = next(row for row in table(text_of("README.md"), "command") if "refine" in row[0])
    short = {"-o", "--output"}
    assert options_of("refine") - short - {"capture"} <= set(re.findall(r"--[a-z-]+", row[1]))


def test_the_readme_lists_the_methods():
    listed = [row[0].strip("`") for row in table(text_of("README.md"), "`--method`")]
    assert sorted(listed) == sorted(METHODS)
    assert "`auto`" in text_of("README.md")


def test_the_capture_toml_of_the_readme_is_read():
    (example,) = blocks(text_of("README.md"), "toml")
    read = parse_config(example.encode())
    assert read.depth_scale == 1000.0
    assert read.intrinsics.camera().shape == (960, 1280)


def test_the_python_of_the_readme_uses_names_that_exist():
    examples = blocks(text_of("README.md"), "python")
    assert len(examples) == 3
    known = {
        "rakelight": set(rakelight.__all__),
        "result": set(Result.__dataclass_fields__) | set(dir(Result)),
    }
    called = set()
    for node in ast.walk(ast.parse("".join(examples))):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            assert node.attr in known.get(node.value.id, {node.attr})
        if isinstance(node, ast.Call) and (options := [option.arg for option in node.keywords]):
            called.add(ast.unparse(node.func))
            assert set(options) <= set(rakelight.MultiLight.__dataclass_fields__)
    assert called == {"rakelight.MultiLight"}


def test_the_page_about_check_lists_the_codes_of_the_findings():
    rows = table(text_of("docs/reference/check.md"), "code")
    listed = re.findall(r"`([a-z0-9-]+)`", " ".join(row[0] for row in rows))
    assert sorted(listed) == sorted(code for row in FINDINGS for code in row.codes)


def codes_of_findings():
    """The codes that the sources give to a `Finding` by a word of their own."""
    for path in SOURCES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "Finding":
                stated = [*node.args[1:2], *(k.value for k in node.keywords if k.arg == "code")]
                yield from (each.value for each in stated if isinstance(each, ast.Constant))


def test_every_code_of_a_finding_is_on_a_page():
    of_check = {code for row in FINDINGS for code in row.codes}
    rows = table(text_of("docs/reference/files.md"), "code of `refine`")
    of_refine = [row[0].strip("`") for row in rows]
    assert sorted(of_refine) == sorted(set(codes_of_findings()) - of_check)


@pytest.mark.parametrize("page", ["README.md", "docs/reference/python.md"])
def test_the_arrays_of_the_pages_are_refined(page):
    vase = make_shape("vase")
    scene = SceneOptions(camera=vase.camera.scaled(0.1), photographs=4, depth_frames=2, bits=8)
    capture, _ = render_scene(vase, make_albedo("pattern"), scene)
    (example,) = (text for text in blocks(text_of(page), "python") if "from_arrays" in text)
    names = {
        "K": capture.camera.matrix,
        "photographs": capture.photographs,
        "depth": capture.depth_m,
    }
    exec(example, names)
    assert names["result"].depth.shape == capture.camera.shape
    if "mesh" in names:
        assert len(names["mesh"].faces) > 500


def test_the_page_about_arrays_lists_arguments_and_options():
    text = text_of("docs/reference/python.md")
    listed = re.findall(r"`(\w+)`", " ".join(row[0] for row in table(text, "argument")))
    assert listed == list(signature(Capture.from_arrays).parameters)
    for name, options in table(text, "method"):
        chosen = load_method(name.strip("`")).options
        assert getattr(rakelight, options.strip("`").removeprefix("rakelight.")) is chosen
    assert len(table(text, "method")) == len(METHODS)


def test_the_error_that_the_page_about_arrays_shows():
    page = text_of("docs/reference/python.md")
    shown = next(line for line in page.splitlines() if "unit looks" in line)
    photographs = np.random.default_rng(0).integers(50, 200, (3, 6, 8, 3), np.uint8)
    camera = Camera(8, 6, 10.0, 10.0, 3.5, 2.5)
    with pytest.raises(InputError) as refused:
        Capture.from_arrays(photographs, np.full((6, 8), 600.0), camera, mask=np.ones((6, 8)))
    assert str(refused.value) == shown.strip()


# --- links, pages, words ---

LINK = re.compile(r"\]\(([^)\s]+)\)")
# Words that code and docs of this project once used for the field's own (docs/glossary.md).
NOT_THE_FIELDS = (
    r"hang(s|ing)? together", r"hung together", r"steadiness", r"unlikeness", r"hollows",
    r"dark is deep", r"depth[ _-]trust", r"less[ _]trust", r"deserved[ _]trust", r"\btrust\w*",
    r"goes[ _]down", r"begun[ _]anew", r"squared[ _]turn", r"relief[ _]step", r"weakest[ _]hold",
    r"matted", r"most[ _]shine", r"freer[ _]lights", r"first[ _]look", r"lights[ _]of[ _]factors",
    r"brought[ _]near", r"fine[ _]relief\(", r"\bdimmed\b", r"\bdoubts\b",
)  # fmt: skip


def prose(text):
    """A page without code: names of constants and files are those of the commit that is quoted."""
    return re.sub(r"`[^`\n]+`|\]\([^)]*\)", " ", FENCED.sub("", text))


def anchors(text):
    """The anchors of a page's headings, as GitHub makes them."""
    found = []
    for heading in re.findall(r"^#+ (.+)$", FENCED.sub("", text), re.MULTILINE):
        anchor = re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")
        again = sum(each == anchor for each in found)
        found.append(f"{anchor}-{again}" if again else anchor)
    return set(found)


def links(page):
    """The (file, anchor) of every link to a file; anchor is empty where none is named."""
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        if "://" not in target:
            path, _, anchor = target.partition("#")
            yield ((page.parent / path).resolve() if path else page), anchor


@pytest.mark.parametrize("page", PAGES, ids=IDS)
def test_links_lead_to_files_and_headings(page):
    for path, anchor in links(page):
        assert path.exists(), path
        if anchor:
            assert anchor in anchors(path.read_text(encoding="utf-8")), (path, anchor)


def test_every_page_is_reachable_from_the_index():
    reached, ahead = set(), [DOCS / "index.md"]
    while ahead:
        page = ahead.pop()
        if page not in reached:
            reached.add(page)
            ahead += [path for path, _ in links(page) if path.suffix == ".md"]
    assert set(DOCS.glob("**/*.md")) <= reached


def test_every_picture_is_shown():
    shown = {path for page in PAGES for path, _ in links(page)}
    pictures = {path for kind in ("png", "jpg") for path in DOCS.glob(f"**/*.{kind}")}
    assert pictures <= shown


@pytest.mark.parametrize("page", PAGES, ids=IDS)
def test_words_are_the_fields(page):
    if page.name == "CHANGELOG.md":  # tells what was called otherwise
        return
    text = prose(page.read_text(encoding="utf-8"))
    for word in NOT_THE_FIELDS:
        found = re.search(word, text, re.IGNORECASE)
        assert not found, text[max(found.start() - 60, 0) : found.end() + 60]


def test_the_public_names_are_those_of_the_docstrings():
    made = runpy.run_path(str(DOCS / "api.py"))["page"]()
    assert text_of("docs/reference/api.md") == made, "make reference"
    headings = re.findall(r"^### (.*)$", made, re.MULTILINE)
    assert {name for name in rakelight.__all__ if name[0] != "_"} <= set(headings)
    assert "refine(\n    capture: Capture" in made
    assert "Result.mesh(" in made


def test_the_glossary_is_alphabetical():
    terms = [term.lower() for term, *_ in table(text_of("docs/glossary.md"), "term")]
    assert len(terms) > 20
    assert terms == sorted(terms)


@pytest.mark.parametrize("page", PAGES, ids=IDS)
def test_make_targets_exist(page):
    targets = set(re.findall(r"^([a-z]+):", text_of("Makefile"), re.MULTILINE))
    for piece in code(page.read_text(encoding="utf-8")):
        found = re.match(r"make ([a-z]+)", piece)
        assert not found or found[1] in targets, piece


def test_make_writes_where_the_docs_show():
    written = set(re.findall(r"docs/[\w/.-]+", text_of("Makefile")))
    ((*copied, folder),) = (
        words.split() for words in re.findall(r"cp -r (out/paper.*)", text_of("Makefile"))
    )
    written |= {folder + Path(each).name for each in copied}
    assert {"docs/pictures/mitten.png", "docs/results/paper", "docs/results/paper.md"} <= written
    for path in written:
        assert (ROOT / path).exists(), path


def test_functions_of_multi_light_are_where_the_page_says():
    rows = table(text_of("docs/explanation/multi-light.md"), "what")
    assert len(rows) > 10
    for _, where in rows:
        for path, names in re.findall(r"\]\(([^)]+)\): ([^\[]+)", where):
            file = (DOCS / "explanation" / path).resolve()
            defined = set(
                re.findall(r"^(?:def|class) (\w+)", file.read_text("utf-8"), re.MULTILINE)
            )
            assert set(re.findall(r"`(\w+)`", names)) <= defined, path


@pytest.mark.parametrize("page", PAGES, ids=IDS)
def test_capture_toml_is_read(page):
    (whole,) = blocks(text_of("README.md"), "toml")
    for example in blocks(page.read_text(encoding="utf-8"), "toml"):
        text = example if "depth_scale" in example else f"{example}\n"
        if "depth_scale" not in example:
            text = whole + text if text.lstrip().startswith("[") else text + whole
        assert parse_config(text.encode()).depth_scale == 1000.0


def test_the_tutorial_about_arrays_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {}
    for example in blocks(text_of("docs/tutorials/arrays.md"), "python"):
        exec(example, names)
    assert names["photographs"].shape == (8, 90, 120, 3)
    assert names["depth"].shape == (1, 45, 60)
    assert names["result"].depth.shape == names["again"].depth.shape == (90, 120)
    assert names["scores"].normals.mae_deg < 10


# --- docs/reference/ ---


def files():
    return text_of("docs/reference/files.md")


def classes_below(root):
    return [root, *(each for child in root.__subclasses__() for each in classes_below(child))]


def test_exit_codes():
    meaning = {
        int(code): what for code, what in table(text_of("docs/reference/commands.md"), "code")
    }
    assert set(meaning) == {0, 1, 2, 3, 4, 130}
    assert RakelightError.exit_code == 1
    for error in (InputError, MachineError):
        assert meaning[error.exit_code] == error.__doc__[0].lower() + error.__doc__[1:].rstrip(".")
    for error in classes_below(RakelightError):
        assert error.exit_code in meaning
    drawn = dict(re.findall(r"(\w+Error) .*exit code (\d)", errors.__doc__))
    assert drawn == {"InputError": "2", "MachineError": "3"}


def test_keys_of_capture_toml():
    listed = " ".join(row[0] for row in table(files(), "key of `capture.toml`"))
    keys = {key.strip("[]") for key in re.findall(r"`([^`]+)`", listed)}
    assert keys == {field.name for field in msgspec.structs.fields(CaptureTable)}
    section = files().split("key of `capture.toml`")[1].split("\n\n")[0]
    for struct in (DistortionTable, IntrinsicsTable, NoiseTable, TransformTable):
        for field in msgspec.structs.fields(struct):
            assert f"`{field.name}`" in section


def test_keys_of_result_json():
    section = files().split("### result.json")[1]
    for heading, struct in (("key", Summary), ("key of `conventions`", Conventions)):
        first_cells = " ".join(row[0] for row in table(section, heading))
        listed = set(re.findall(r"`([a-z_]+)`", first_cells))
        assert listed == {field.name for field in msgspec.structs.fields(struct)}


@pytest.mark.parametrize("mesh", MESH_FORMATS)
def test_files_of_the_result_folder(tmp_path, mesh):
    plane, facing = np.ones((4, 4), np.float32), np.zeros((4, 4, 3), np.float32)
    facing[..., 2] = -1
    result = Result(
        depth=plane,
        normals=facing,
        albedo=-facing,
        confidence=plane,
        lights=Lights(np.zeros((1, 1, 3)), np.ones((1, 1))),
        camera=Camera(4, 4, 100.0, 100.0, 1.5, 1.5),
        prepared_depth=plane,
        depth_sigma=plane,
        normal_sigma=plane,
        method="none",
    )
    save_result(result, tmp_path / "out", mesh=mesh)
    section = files().split("## Result folder")[1]
    listed = {
        name for row in table(section, "file") for name in re.findall(r"`([\w.]+\.\w+)`", row[0])
    }
    written = {path.name for path in (tmp_path / "out").iterdir()}
    others = set(MESH_FORMATS) - {mesh}
    assert written == listed - {mesh_file(name) for name in others}
