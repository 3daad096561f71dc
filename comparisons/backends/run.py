"""Writes the tables of this folder: ``python comparisons/backends/run.py`` (some ten minutes on one core)."""

from __future__ import annotations

import importlib.util
import logging
import sys
from pathlib import Path

from adapters import LIBRARIES

from bodyimage_kin.testing.conform import conform

HERE = Path(__file__).parent
# How frax is called stands beside the measurements of speed.
sys.path.append(str(HERE.parent / "speed"))
ON_FILES = (
    *("pose_equals_oracle", "jacobian_equals_oracle", "hessian_equals_differences", "off_path_columns_are_zero"),
    *("mimic_is_multiplier_times_column", "invariant_under_renaming", "invariant_under_explicit_defaults"),
)
"""The laws that a published robot can put to the test in a new way; the others are about arrays and derivatives."""


def main() -> int:
    """All three tables; the exit status is that of our own backends."""
    # It says at every posture what it assumes of followers.
    logging.getLogger("yourdfpy").setLevel(logging.CRITICAL)
    ours = conform(None, None, 100, HERE / "random")
    print(ours, flush=True)
    corpus = conform("example-robot-data", None, 3, HERE / "corpus", laws=ON_FILES)
    print(corpus, flush=True)
    installed = {name: adapter for name, (module, adapter) in LIBRARIES.items() if importlib.util.find_spec(module)}
    others = conform(None, installed, 100, HERE / "others")
    print(others)
    for name, report in (("random", ours), ("corpus", corpus), ("others", others)):
        (HERE / name / "table.txt").write_text(f"{report}\n", encoding="utf-8")
    # Of the corpus some files are refused, for the reasons in the table.
    return ours.exit_status or int(bool(corpus.failures))


if __name__ == "__main__":
    sys.exit(main())
