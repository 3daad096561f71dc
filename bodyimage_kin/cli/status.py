"""What ``study --status`` does, with nothing heavy imported: it answers at once."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

from bodyimage_kin.study.kept import rows_of

__all__ = ["FAILED", "show_failures", "status_command"]

FAILED = 1
"""Exit status of a run that is complete, but for cells that failed."""


def status_command(out: Path) -> int:
    """``bodyimage-kin study --status DIR``: how many recordings of each cell are done, failed and missing.

    Returns:
        0, or :data:`FAILED` when a cell failed.

    Raises:
        InvalidConfig: A folder without a study.
    """
    found = []
    for row in rows_of(out):
        name = f"{row.embodiment}/{row.recording}/{row.estimator}"
        failed = sum(map(len, row.failures.values()))
        print(f"{name}: {row.total - row.missing - failed} of {row.total} done", end="")
        print(f", {failed} failed" * bool(failed) + f", {row.missing} to do" * bool(row.missing))
        found += [(name, seeds, failure) for failure, seeds in row.failures.items()]
    return show_failures(found)


def show_failures(found: Iterable[tuple[str, Iterable[int], str]]) -> int:
    """Says what went wrong: with what, for which seeds, and how."""
    status = 0
    for name, seeds, failure in found:
        print(f"{name}, seeds {', '.join(map(str, seeds))}: {failure}", file=sys.stderr)
        status = FAILED
    return status
