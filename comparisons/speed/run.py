"""Speed and accuracy of kinematics engines, written beside this file: ``python comparisons/speed/run.py``.

A quarter of an hour on a quiet machine; ``--quick`` for a first look.
"""

from __future__ import annotations

import sys
from pathlib import Path

import bench


def main() -> None:
    """Measures, and writes speed.md, speed.json, speed.svg and speed.png."""
    settings = bench.QUICK if "--quick" in sys.argv else bench.Settings()
    result = bench.run(settings, report=lambda what: print(what, file=sys.stderr, flush=True))
    print(bench.write(result, Path(__file__).parent))


if __name__ == "__main__":
    main()
