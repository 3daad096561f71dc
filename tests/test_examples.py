"""The numbered examples of the documentation run as they are, and each shows a plot that can be read."""

import json
import os
import re
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
