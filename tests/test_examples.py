"""The numbered examples of the documentation run as they are, and each shows a plot that can be read."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).parents[1] / "docs" / "examples").glob("*.py"))
# Runs a script as a reader would, then says what each panel of its figures shows.
RUN = """
import json, runpy, sys
import matplotlib.pyplot as plt
runpy.run_path(sys.argv[1], run_name="__main__")
panels = [axes for number in plt.get_fignums() for axes in plt.figure(number).axes]
# A panel without data says why it has none.
drawn = [
    [
        axes.has_data() or bool(axes.texts),
        axes.get_xlabel(),
        axes.get_ylabel(),
        axes.get_title() or axes.get_title("left"),
    ]
    for axes in panels
]
print(json.dumps(drawn))
"""
# Makes the notebook that the documentation offers for download, and runs it, a kernel of its own, cell by cell.
NOTEBOOK = """
import pathlib, sys
import nbformat
from nbclient import NotebookClient
from sphinx_gallery.notebook import python_to_jupyter_cli
script = pathlib.Path(sys.argv[1])
python_to_jupyter_cli([str(script)])
notebook = nbformat.read(script.with_suffix(".ipynb"), 4)
where = {"metadata": {"path": str(script.parent)}}
NotebookClient(notebook, timeout=600, kernel_name="python3", resources=where).execute()
nbformat.write(notebook, script.with_suffix(".ipynb"))
"""


def test_examples_are_numbered_without_holes():
    numbers = [int(re.fullmatch(r"plot_(\d+)_\w+", path.stem).group(1)) for path in EXAMPLES]
    assert sorted(numbers) == list(range(1, len(numbers) + 1))
    assert len(numbers) >= 5


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_short(path):
    assert 20 <= len(path.read_text(encoding="utf-8").splitlines()) <= 80


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_a_notebook_too(path):
    parser = pytest.importorskip("sphinx_gallery.py_source_parser", reason="sphinx-gallery is not installed")
    _, blocks = parser.split_code_and_text_blocks(str(path))
    cells = [text for kind, text, _ in blocks if kind == "code"]
    assert len(cells) >= 2
    for cell in cells:
        compile(cell, path.name, "exec")
    assert blocks[0][0] == "text", "it begins with what it is about"


@pytest.mark.slow
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs_as_a_notebook(path, tmp_path):
    for module in ("nbclient", "ipykernel", "sphinx_gallery"):
        pytest.importorskip(module, reason=f"{module} is not installed")
    script = shutil.copy(path, tmp_path)
    done = subprocess.run(
        [sys.executable, "-c", NOTEBOOK, script],
        env=os.environ | {"OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    notebook = json.loads((tmp_path / f"{path.stem}.ipynb").read_text(encoding="utf-8"))
    outputs = [one for cell in notebook["cells"] for one in cell.get("outputs", ())]
    printed = ["".join(one["text"]) for one in outputs if one["output_type"] == "stream"]
    shown = [one["data"] for one in outputs if one["output_type"] in ("display_data", "execute_result")]
    # Nobody complains; that something is compiled, once on a machine, may be said.
    complaints = ["".join(one["text"]) for one in outputs if one.get("name") == "stderr"]
    assert not [text for text in complaints if "compiling for this processor, once" not in text]
    assert printed
    assert any("image/png" in one for one in shown)
    # Nothing dumps arrays: what a cell ends with is shown in a few lines.
    assert all(len("".join(one["text/plain"])) < 600 for one in shown)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs_and_shows_a_plot(path, tmp_path):
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", RUN, str(path)],
        cwd=tmp_path,
        env=os.environ | {"MPLBACKEND": "Agg", "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    *printed, last = done.stdout.splitlines()
    assert printed
    panels = json.loads(last)
    assert panels
    for has_data, x, y, title in panels:
        assert has_data
        # Every panel names its axes or itself, scales of colours included.
        assert x or y or title
    assert not any(tmp_path.iterdir())
