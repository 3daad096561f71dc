"""The error on the face, foretold: ``python comparisons/foreknowledge/run.py``, results beside this file.

Some ten minutes on two quiet cores; ``--quick`` for a first look at two recordings of each condition. With ``--store``
an interrupted run is taken up where it ended. What failed stands in the results, and the command then exits with 1.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import bodyimage_kin as bk
from bodyimage_kin import figures
from bodyimage_kin.published import foreknowledge

PREDICTORS = (
    "posture_distance",
    "excitation_deficit",
    "gaussian_process",
    "without_structure",
    "perturbed_arms",
    "calibrated_arm",
)
"""Those with a panel each; the structure is unknown to the first three."""


@figures.style()
def draw(found: Mapping[str, Any], folder: Path) -> None:
    """Predicted against measured for each estimator, and what each predictor is worth."""
    for estimator, of in found["estimators"].items():
        shown = [name for name in PREDICTORS if name in of["predictors"]]
        figure, grid = figures.panels(2, 3, height=4.9, sharex=True, sharey=True)
        for axes, predictor in zip(grid.flat, shown, strict=False):
            figures.predicted_errors(found, estimator, predictor, axes, scale=axes in grid[:, -1])
            axes.label_outer()
        for axes in grid.flat[len(shown) :]:
            axes.remove()
        figures.letters(grid.flat[: len(shown)])
        figures.legend(figure)
        figures.save(figure, folder, f"predicted_{estimator}")
    figure, grid = figures.panels(math.ceil(len(found["estimators"]) / 2), 2, height=5.6, sharex=True, sharey=True)
    for axes, estimator in zip(grid.flat, found["estimators"], strict=True):
        figures.r2_bars(found, estimator, axes)
        axes.label_outer()
    figures.letters(grid.flat)
    figures.save(figure, folder, "r2")


def main() -> None:
    """Computes everything; writes results.json, results.md and two figures, each as SVG and PNG."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=30, help="recordings of each condition (default: 30)")
    parser.add_argument("--workers", type=int, default=None, help="processes (default: one a core)")
    parser.add_argument("--quick", action="store_true", help="two recordings of each condition")
    parser.add_argument("--store", type=Path, default=None, help="folder of the study (default: none is kept)")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent, help="folder of the results")
    asked = parser.parse_args()
    study = foreknowledge.grid(seeds=2 if asked.quick else asked.seeds)
    with tempfile.TemporaryDirectory() as folder:
        results = study.run(asked.store or folder, workers=asked.workers, progress=True)
    found = foreknowledge.judge(results, bk.load_embodiment("infant"))
    asked.out.mkdir(parents=True, exist_ok=True)
    foreknowledge.write_summary(found, asked.out / "results.json")
    (asked.out / "results.md").write_text(foreknowledge.markdown(found), encoding="utf-8")
    draw(found, asked.out)
    print(foreknowledge.markdown(found))
    if found["failed"]:
        raise SystemExit(f"{len(found['failed'])} conditions and seeds failed; results.md has their words")


if __name__ == "__main__":
    main()
