"""What the documentation says is so: its examples run, the tests and tables it names are there."""

import ast
import json
import pkgutil
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"


def python_blocks(page):
    """(first line, code) of each Python block of a Markdown page."""
    text = page.read_text(encoding="utf-8")
    return [
        (text.count("\n", 0, found.start(1)) + 1, found.group(1))
        for found in re.finditer(r"^```python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    ]


PROMISES = """
assert 0.0 < errors.relative_error.median().item() < 1.0
assert J.shape[0] == 1000
assert bk.metrics.topological_error(maps.tactile_map) < 320
"""


CALIBRATED = """
assert fit.explains
assert chosen.q.shape == (10, body.p)
"""


UNCERTAIN = """
assert maps.covariance.shape == (21, 21, 2, 2)
assert scores["error"] > 0
"""


EXTENDED = """
assert scores.relative_error_use.sel(probe="training").item() < 1.0
assert other.camera.model.unit == "px"
"""


RECORDED = """
assert recording.joint.values.tolist() == joints
assert recording.hand_image.notnull().all("axis").sum() == 295
assert (wrong.iloc[1:] < 0.6 * wrong.iloc[0]).all() and wrong.iloc[0] < 1.0
"""


VIEWED = """
assert moment.hand.shape == (3,)
assert scene.samples("touch") == touch.sizes["time"]
"""


FORETOLD = """
print(fk.CalibratedArm(body).predict(known))
"""


TUNED = """
assert study.estimators
"""


LAWFUL = """
assert AdapterWithHessian
"""


FIGURES = """
assert table["value"].notna().sum() == body.skin.count
assert {path.suffix for path in __import__("pathlib").Path("figures").iterdir()} == {".svg", ".png", ".csv"}
"""


OWN_ROBOT = """
assert bk.load_embodiment("my.toml") == body
assert recording.hand_image.attrs["units"] == "px"
assert {"training", "joint_space"} <= set(scores.probe.values.tolist())
"""


SKINS = """
assert skin.shape == (21, 21) and not skin.notes
assert np.allclose(np.linalg.norm(ball.link_positions - [0.0, 0.0, 0.06], axis=1), 0.075)
assert patches.pieces == 1 and patches.link_normals[:, 0].min() > 0
assert (touch["touched"] >= 0).mean() > 0.7
"""


@pytest.mark.parametrize(
    ("page", "promises"),
    [
        pytest.param(ROOT / "README.md", PROMISES, id="README.md"),
        pytest.param(DOCS / "quickstart.md", PROMISES, id="quickstart.md"),
        pytest.param(DOCS / "calibration.md", CALIBRATED, id="calibration.md"),
        pytest.param(DOCS / "uncertainty.md", UNCERTAIN, id="uncertainty.md"),
        pytest.param(DOCS / "your_own_robot.md", OWN_ROBOT, id="your_own_robot.md"),
        pytest.param(DOCS / "skins.md", SKINS, id="skins.md"),
        pytest.param(DOCS / "foreknowledge.md", FORETOLD, id="foreknowledge.md", marks=pytest.mark.slow),
        pytest.param(DOCS / "tuning.md", TUNED, id="tuning.md", marks=pytest.mark.slow),
        pytest.param(DOCS / "test_your_kinematics.md", LAWFUL, id="test_your_kinematics.md"),
        pytest.param(DOCS / "extend.md", EXTENDED, id="extend.md"),
        pytest.param(DOCS / "your_own_recording.md", RECORDED, id="your_own_recording.md"),
        pytest.param(DOCS / "view.md", VIEWED, id="view.md"),
        pytest.param(DOCS / "api" / "figures.md", FIGURES, id="figures.md"),
    ],
)
def test_examples_run_one_after_the_other(page, promises, tmp_path):
    # The pages' "robot.urdf" is any robot of the reader's.
    shutil.copy(ROOT / "urdf" / "infant.urdf", tmp_path / "robot.urdf")
    shutil.copy(ROOT / "tests" / "testing" / "my_kinematics.py", tmp_path)
    blocks = python_blocks(page)
    assert blocks
    lines = []
    for line, code in blocks:
        # At the lines of the page, so that a failure points there.
        lines += [""] * (line - 1 - len(lines)) + code.splitlines()
    (tmp_path / "example.py").write_text("\n".join(lines) + promises, encoding="utf-8")
    # In a process of its own, as a reader would run them.
    done = subprocess.run(
        [sys.executable, "-W", "error", "example.py"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout


def test_every_equation_names_tests_that_exist():
    text = (DOCS / "equations.md").read_text(encoding="utf-8")
    named = re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", text)
    assert len(named) > 25
    for path, test in named:
        tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
        assert test in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}, f"{path}::{test}"


def test_no_equation_is_missing():
    rows = re.findall(r"^\| ([\d, ]+)(?:, literal)? \|", (DOCS / "equations.md").read_text(), re.MULTILINE)
    assert {int(number) for row in rows for number in row.split(",")} == set(range(1, 20))


def test_every_name_the_pages_link_to_is_there():
    linked = set()
    for page in DOCS.rglob("*.md"):
        text = page.read_text(encoding="utf-8")
        linked |= {one or other for one, other in re.findall(r"\{py:\w+\}`(?:[^`<]*<([\w.]+)>|~?([\w.]+))`", text)}
    assert len(linked) > 40
    for name in linked:
        pkgutil.resolve_name(name)


def test_every_file_that_pages_link_to_is_there():
    pages = [*ROOT.glob("*.md"), *DOCS.rglob("*.md"), *(ROOT / "comparisons").rglob("*.md")]
    links = 0
    for page in pages:
        text = re.sub(r"```.*?```|`[^`\n]*`", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
        for target in re.findall(r"\]\(([^)\s]+)\)", text):
            if re.match(r"https?:|mailto:|#", target):
                continue
            links += 1
            assert (page.parent / target.partition("#")[0]).exists(), f"{page.relative_to(ROOT)} links to {target}"
    assert links > 20


def test_every_page_with_code_is_run():
    listed = (ROOT / "tests" / "test_docs.py").read_text(encoding="utf-8")
    others = {"study.md"}  # a study of ten seeds, on a recording of the reader's
    for page in [ROOT / "README.md", *DOCS.rglob("*.md")]:
        if python_blocks(page) and page.name not in others:
            assert f'"{page.name}"' in listed, f"{page.name} has code that no test runs"


def test_every_table_of_the_ambiguities_is_shown():
    table = (ROOT / "comparisons/ambiguities/table.md").read_text(encoding="utf-8")
    page = (DOCS / "ambiguities.md").read_text(encoding="utf-8")
    for edge, side in (("start-after", "begin"), ("end-before", "end")):
        shown = re.findall(rf':{edge}: "<!-- {side} (\w+) -->"', page)
        assert sorted(shown) == sorted(re.findall(rf"<!-- {side} (\w+) -->", table))


def test_every_dependency_is_explained():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = [name for extra in project["optional-dependencies"].values() for name in extra]
    wanted = {re.match(r"[\w-]+", name).group() for name in [*project["dependencies"], *extras]} - {"bodyimage-kin"}
    rows = [
        line.strip("| ").split(" | ")
        for line in (DOCS / "dependencies.md").read_text().splitlines()
        if line[:3] == "| `"
    ]
    # The cell before the last names the libraries.
    assert {name for row in rows for name in re.findall(r"`([\w-]+)`", row[-2])} == wanted


@pytest.mark.slow
def test_the_documentation_builds_without_a_warning(tmp_path):
    pytest.importorskip("sphinx")
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-n", "-q", str(DOCS), str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_the_ambiguities_run_and_leave_no_table_out(tmp_path):
    script = ROOT / "comparisons/ambiguities/run.py"
    command = [sys.executable, str(script), "--seeds", "1", "--duration", "30", "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    kept, made = (json.loads((folder / "results.json").read_text()) for folder in (script.parent, tmp_path))
    readings = [{name: list(found) for name, found in result["values"].items()} for result in (kept, made)]
    assert readings[0] == readings[1]
    assert kept["measures"] == made["measures"]
    assert {path.name for path in tmp_path.iterdir()} == {"results.json", "table.md", "figure.svg", "figure.png"}
