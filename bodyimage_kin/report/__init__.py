"""Pages made of results and figures."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray as xr

    from bodyimage_kin.body import Embodiment
    from bodyimage_kin.calibration import Calibrated, NextPostures

__all__ = ["publish", "write", "write_calibration", "write_next_postures", "write_scores"]


def write(
    results: xr.Dataset,
    path: str | os.PathLike[str],
    *,
    baseline: str | None = None,
    atlas: str | None = None,
    labels: Mapping[str, str] | None = None,
) -> Path:
    """Writes a study's results as one HTML page that needs nothing else, no network either.

    Every figure shows its values under the pointer, and has them as CSV beside it.

    Args:
        results: Of :meth:`bodyimage_kin.Study.run`.
        path: The page.
        baseline: Name of the estimator that others are compared with; None: the first that is not the truth itself.
        atlas: Name of the estimator whose errors are drawn over the face, where scores of each posture were kept; None:
            the one with the smallest error.
        labels: What a reader calls estimators, recordings ... by name; before those of the study's config, and of
            ``bodyimage_kin.figures.labels``.

    Returns:
        The page's path.

    Raises:
        UnknownName: No such estimator.
        InvalidConfig: Not the results of a study.
    """
    from bodyimage_kin.report import _study_page

    return _study_page.write(results, Path(path), baseline, atlas, labels)


def publish(
    results: xr.Dataset,
    folder: str | os.PathLike[str],
    *,
    baseline: str | None = None,
    labels: Mapping[str, str] | None = None,
) -> Path:
    """Writes what a published comparison consists of, beside its config and its findings.

    ``results.json`` has the numbers of table and figure with their intervals, ``table.md`` the ones to be read,
    ``table.tex`` the same for a paper (booktabs), ``errors.svg``, ``errors.png`` and ``errors.csv`` the errors at every
    probe. Ratios are on the face; p-values are adjusted over all comparisons of one embodiment.

    Args:
        results: Of :meth:`bodyimage_kin.Study.run`.
        folder: Made when missing.
        baseline: Name of the estimator that others are compared with; None: the first that is not the truth itself.
        labels: As of :func:`write`.

    Returns:
        The table's path.

    Raises:
        UnknownName: No such estimator.
        InvalidConfig: Results without ``relative_error_use``, or of a study that was not run to its end.
        OutputRefused: A folder that cannot be written to.
    """
    from bodyimage_kin.report import _publication

    return _publication.write(results, Path(folder), baseline, labels)


def write_scores(
    rows: xr.Dataset,
    path: str | os.PathLike[str],
    *,
    against: Mapping[str, xr.Dataset] | None = None,
    verdict: str = "",
    said: Sequence[str] = (),
) -> Path:
    """Writes what estimators foretell of hidden parts of a recording as one page for whoever made it.

    Args:
        rows: Of ``bk.score({...}, None, recording)``.
        path: The page.
        against: Estimator -> its scores against a calibrated body (``bk.score(learned, calibrated, recording)``).
        verdict: Of that body.
        said: Warnings on the way.

    Returns:
        The page's path.

    Raises:
        InvalidConfig: Other results.
    """
    from bodyimage_kin.report import _score_page

    return _score_page.write(rows, Path(path), against, verdict, said)


def write_calibration(calibrated: Calibrated, path: str | os.PathLike[str], *, said: Sequence[str] = ()) -> Path:
    """Writes what a calibration found as one page: what it is worth, what was off, what remains unknown.

    Args:
        calibrated: Of :func:`bodyimage_kin.calibrate`.
        path: The page.
        said: Warnings on the way.

    Returns:
        The page's path.
    """
    from bodyimage_kin.report import _calibration_page

    return _calibration_page.write(calibrated, Path(path), said)


def write_next_postures(
    chosen: NextPostures,
    body: Embodiment,
    probes: Sequence[str],
    path: str | os.PathLike[str],
    *,
    said: Sequence[str] = (),
) -> Path:
    """Writes postures to look at next as one page, with the error that is expected after each.

    Args:
        chosen: Of :func:`bodyimage_kin.next_postures`.
        body: Whose postures they are.
        probes: Names of the probes at which the error is expected.
        path: The page.
        said: Warnings on the way.

    Returns:
        The page's path.
    """
    from bodyimage_kin.report import _next_page

    return _next_page.write(chosen, body, probes, Path(path), said)
