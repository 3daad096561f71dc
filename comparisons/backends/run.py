"""Writes the tables of this folder: ``python comparisons/backends/run.py`` (some ten minutes on one core)."""

from __future__ import annotations

import importlib.util
import logging
import sys
from pathlib import Path

from adapters import LIBRARIES

from bodyimage_kin.testing.conform import conform

HERE = Path(__file__).parent


def main() -> int:
    """All three tables; the exit status is that of our own backends."""
    # It says at every posture what it assumes of followers.
    logging.getLogger("yourdfpy").setLevel(logging.CRITICAL)
    ours = conform(None, None, 200, HERE / "random")
    print(ours)
    corpus = conform("example-robot-data", None, 3, HERE / "corpus")
    print(corpus)
    installed = {name: adapter for name, (module, adapter) in LIBRARIES.items() if importlib.util.find_spec(module)}
    others = conform(None, installed, 200, HERE / "others")
    print(others)
    for name, report in (("random", ours), ("corpus", corpus), ("others", others)):
        (HERE / name / "table.txt").write_text(f"{report}\n", encoding="utf-8")
    return ours.exit_status or corpus.exit_status


if __name__ == "__main__":
    sys.exit(main())
