"""What ``study --status`` does, with nothing heavy imported: it answers at once."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

from bodyimage_kin.cli.arguments import print_json
from bodyimage_kin.study.kept import rows_of

__all__ = ["FAILED", "show_failures", "status_command"]

FAILED = 1
"""Exit status of a run that is complete, but for cells that failed."""


def status_command(out: Path, *, json: bool = False) -> int:
    """``bodyimage-kin study --status DIR``: how many recordings of each cell are done, failed and missing.

    Args:
        out: The store.
        json: As a JSON document, for a machine.

    Returns:
        0, or :data:`FAILED` when a cell failed.

    Raises:
        InvalidConfig: A folder without a study.
    """
    found, rows = [], list[dict[str, str | int]]()
    seeds = 0
    for row in rows_of(out):
        seeds, failed = row.total, sum(map(len, row.failures.values()))
        names: dict[str, str | int] = {
            "embodiment": row.embodiment,
            "recording": row.recording,
            "estimator": row.estimator,
        }
        rows.append({**names, "done": seeds - row.missing - failed, "failed": failed, "to_do": row.missing})
        found += [("/".join(map(str, names.values())), ones, failure) for failure, ones in row.failures.items()]
    if json:
        print_json({"seeds": seeds, "rows": rows})
    for one in () if json else rows:
        print(f"{one['embodiment']}/{one['recording']}/{one['estimator']}: {one['done']} of {seeds} done", end="")
        print(f", {one['failed']} failed" * bool(one["failed"]) + f", {one['to_do']} to do" * bool(one["to_do"]))
    return show_failures(found)


def show_failures(found: Iterable[tuple[str, Iterable[int], str]]) -> int:
    """Says what went wrong: with what, for which seeds, and how."""
    status = 0
    for name, seeds, failure in found:
        print(f"{name}, seeds {', '.join(map(str, seeds))}: {failure}", file=sys.stderr)
        status = FAILED
    return status
