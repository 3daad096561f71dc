"""The error on the face, foretold: ``python comparisons/foreknowledge/run.py``, results beside this file.

Some ten minutes on two quiet cores; ``--quick`` for a first look at two recordings of each condition. With ``--store``
an interrupted run is taken up where it ended. What failed stands in the results, and the command then exits with 1.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from bodyimage_kin._files import write_text
from bodyimage_kin._progress import progress
from bodyimage_kin.figures import foreknowledge_figures, style
from bodyimage_kin.published import foreknowledge


def main() -> None:
    """Computes everything; writes results.json, results.md and two figures, each as SVG and PNG."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=30, help="recordings of each condition (default: 30)")
    parser.add_argument("--workers", type=int, default=None, help="processes (default: one a core)")
    parser.add_argument("--quick", action="store_true", help="two recordings of each condition")
    parser.add_argument("--store", type=Path, default=None, help="folder that keeps what is done (default: none)")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent, help="folder of the results")
    asked = parser.parse_args()
    settings = foreknowledge.Settings(seeds=2 if asked.quick else asked.seeds)
    with progress("conditions and seeds") as report:
        cells = foreknowledge.run(settings, workers=asked.workers, store=asked.store, progress=report)
    found = foreknowledge.summarise(settings, cells)
    asked.out.mkdir(parents=True, exist_ok=True)
    foreknowledge.write_summary(found, asked.out / "results.json")
    write_text(asked.out / "results.md", foreknowledge.markdown(found))
    for estimator in found["estimators"]:
        figure = foreknowledge_figures.predicted_against_measured(found, estimator)
        style.save(figure, asked.out, f"predicted_{estimator}")
    style.save(foreknowledge_figures.r2_bars(found), asked.out, "r2")
    print(foreknowledge.markdown(found))
    if found["failed"]:
        raise SystemExit(f"{len(found['failed'])} conditions and seeds failed; results.md has their words")


if __name__ == "__main__":
    main()
