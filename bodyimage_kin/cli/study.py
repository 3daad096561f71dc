"""What the commands ``study``, ``report`` and ``fit`` do, as functions that return an exit status."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from bodyimage_kin.cli.status import show_failures
from bodyimage_kin.recordings import experience, read_recording
from bodyimage_kin.study import Study, failures, read_study
from bodyimage_kin.study.results import MISSING, write_results
from bodyimage_kin.study.specs import ESTIMATOR

__all__ = ["fit_command", "report_command", "study_command"]


def study_command(
    path: Path,
    out: Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    retry: bool = False,
    twice: bool = False,
) -> int:
    """``bodyimage-kin study FILE.toml --out DIR``: runs what is missing, writes ``results.nc`` and ``report.html``.

    Args:
        path: The study's TOML file.
        out: The store.
        workers: Of the pool of processes; None: one a processor.
        scheduler: Address of a Dask scheduler; instead of the pool.
        retry: Whether cells that failed are tried again.
        twice: Whether each cell is computed twice, and fails where that differs.

    Returns:
        0, or :data:`bodyimage_kin.cli.status.FAILED` when a cell failed.

    Raises:
        BodyImageKinError: As :meth:`Study.from_toml` and :meth:`Study.run`.
    """
    results = Study.from_toml(path).run(out, scheduler, workers=workers, retry=retry, twice=twice, progress=True)
    return _written(results, out)


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
        0, or :data:`bodyimage_kin.cli.status.FAILED` when a cell failed.

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
    return show_failures(
        (f"{one['embodiment']}/{one['recording']}/{one['estimator']}", one["seeds"], one["failure"])
        for one in failures(results)
        if one["failure"] != MISSING
    )
