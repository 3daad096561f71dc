"""What the commands ``study``, ``report`` and ``fit`` do, as functions that return an exit status."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import xarray as xr

from bodyimage_kin.cli.arguments import print_json
from bodyimage_kin.recordings import experience, read_recording
from bodyimage_kin.study import Study, failures, read_study
from bodyimage_kin.study.results import MISSING, write_results
from bodyimage_kin.study.specs import ESTIMATOR

__all__ = ["FAILED", "fit_command", "report_command", "status_command", "study_command"]

FAILED = 1
"""Exit status of a run that is complete, but for cells that failed."""


def study_command(
    path: Path, out: Path, *, workers: int | None = None, scheduler: str | None = None, retry: bool = False
) -> int:
    """``bodyimage-kin study FILE.toml --out DIR``: runs what is missing, writes ``results.nc`` and ``report.html``.

    Args:
        path: The study's TOML file.
        out: The store.
        workers: Of the pool of processes; None: one a processor.
        scheduler: Address of a Dask scheduler; instead of the pool.
        retry: Whether cells that failed are tried again.

    Returns:
        0, or :data:`FAILED` when a cell failed.

    Raises:
        BodyImageKinError: As :meth:`Study.from_toml` and :meth:`Study.run`.
    """
    results = Study.from_toml(path).run(out, scheduler, workers=workers, retry=retry, progress=True)
    return _written(results, out)


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
    results = read_study(out)
    said = results["failure"].transpose("embodiment", "recording", "estimator", "seed")
    total, rows = said.sizes["seed"], list[dict[str, str | int]]()
    for place in np.ndindex(said.shape[:3]):
        one = said[place]
        missing = int((one == MISSING).sum())
        failed = int((one != "").sum()) - missing
        names = {str(dim): str(one[dim].item()) for dim in said.dims[:3]}
        rows.append({**names, "done": total - missing - failed, "failed": failed, "to_do": missing})
    if json:
        print_json({"seeds": total, "rows": rows})
    for row in () if json else rows:
        print(f"{row['embodiment']}/{row['recording']}/{row['estimator']}: {row['done']} of {total} done", end="")
        print(f", {row['failed']} failed" * bool(row["failed"]) + f", {row['to_do']} to do" * bool(row["to_do"]))
    return _show_failures(results)


def report_command(
    out: Path,
    baseline: str | None = None,
    atlas: str | None = None,
    publish: Path | None = None,
    into: Path | None = None,
) -> int:
    """``bodyimage-kin report DIR``: writes ``results.nc`` and ``report.html`` of what is done so far.

    Args:
        out: The store; nothing that its study names is imported.
        baseline: Name of the estimator that others are compared with; None: as :func:`bodyimage_kin.report.write`.
        atlas: Name of the estimator whose errors are drawn over the face; None: likewise.
        publish: Folder for numbers, table and figure of a published comparison (:func:`bodyimage_kin.report.publish`).
        into: Folder for both files, where the store is read-only; None: the store.

    Returns:
        0, or :data:`FAILED` when a cell failed.

    Raises:
        InvalidConfig: A folder without a study.
        UnknownName: No such estimator.
    """
    results = read_study(out)
    if publish is not None:
        from bodyimage_kin import report

        report.publish(results, publish, baseline=baseline)
    return _written(results, into or out, baseline, atlas)


def fit_command(estimator: str, recording: Path, out: Path, *, embodiment: str | None = None, seed: int = 0) -> int:
    """``bodyimage-kin fit ESTIMATOR RECORDING.nc --out DIR``: learns from one recording, keeps what was learned.

    Args:
        estimator: Name of a class, or ``package.module:Class``.
        recording: NetCDF file of a recording or an experience.
        out: Folder for the learned Jacobian.
        embodiment: For an estimator that knows the body.
        seed: Of whatever is drawn at random.

    Returns:
        0.

    Raises:
        BodyImageKinError: As reading and fitting.
    """
    from bodyimage_kin.body.file import load_embodiment

    body = None if embodiment is None else load_embodiment(embodiment)
    spec = ESTIMATOR.build(estimator, body=body)
    spec.fit(experience(read_recording(recording)), seed=seed).save(out)
    print(out)
    return 0


def _written(results: xr.Dataset, out: Path, baseline: str | None = None, atlas: str | None = None) -> int:
    from bodyimage_kin import report

    write_results(results, out / "results.nc")
    page = report.write(results, out / "report.html", baseline=baseline, atlas=atlas)
    print(page)
    return _show_failures(results)


def _show_failures(results: xr.Dataset) -> int:
    found = [one for one in failures(results) if one["failure"] != MISSING]
    for one in found:
        seeds = ", ".join(map(str, one["seeds"]))
        place = f"{one['embodiment']}/{one['recording']}/{one['estimator']}"
        print(f"{place}, seeds {seeds}: {one['failure']}", file=sys.stderr)
    return FAILED if found else 0
