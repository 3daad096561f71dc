"""``bodyimage-kin score``: how wrong is a learned map of one's own recording?"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from tyro.conf import Positional, arg

from bodyimage_kin.cli._reading import Reading, heard
from bodyimage_kin.cli.arguments import File, Flag, MaybeEmbodiment, MaybeNumber, Names, Seed, finite, print_json

if TYPE_CHECKING:
    import xarray as xr

    from bodyimage_kin.body import Embodiment
    from bodyimage_kin.calibration import Calibrated
    from bodyimage_kin.estimators import Estimator

__all__ = ["ESTIMATORS", "Score"]

ESTIMATORS = (
    "LeastSquares",
    "PaperMLP",
    "NearestNeighbours",
    "LocallyWeighted",
    "Polynomial",
    "RationalPolynomial",
    "TrigRidge",
    "RationalTrig",
    "KernelRidge",
    "GaussianProcess",
)
"""One of each kind that learns from a few hundred postures in seconds."""


@dataclass(frozen=True)
class Score(Reading):
    """Say how wrong learned hand-eye maps are, no truth being known: what each foretells of parts hidden from it.

    With a robot, its calibrated body is held beside them, and says how wrong they are in all directions.
    """

    EXAMPLES: ClassVar[tuple[str, ...]] = (
        "bodyimage-kin score recording.csv --units q=deg",
        "bodyimage-kin score poses.csv --order scattered --robot my.toml --estimators RationalTrig GaussianProcess",
    )

    recording: Annotated[Path, Positional, arg(metavar="RECORDING")]
    """The recording: NetCDF, or a table (CSV, Parquet, MATLAB) with columns q.JOINT and hand_image.u, hand_image.v."""
    robot: MaybeEmbodiment = None
    """Its embodiment: a name, or the path of a TOML file."""
    estimators: Names = ()
    """Names of estimators, or package.module:Class; nothing: ten of them."""
    folds: Annotated[int, arg(metavar="N")] = 5
    """Parts of the recording that are hidden in turn."""
    noise: MaybeNumber = None
    """Root mean squared noise of one image, in its unit; by default from repeated postures, or from what the
    calibrated body leaves."""
    seed: Seed = 0
    """Of whatever is drawn at random."""
    out: File = Path("scores.html")
    """The page."""
    json: Flag = False
    """The errors as JSON, for a machine."""

    def __call__(self) -> int:
        """Runs it; exit status 1 when nothing could learn."""
        import numpy as np

        from bodyimage_kin import report
        from bodyimage_kin.body.file import load_embodiment
        from bodyimage_kin.calibration import calibrate
        from bodyimage_kin.recordings import align, experience
        from bodyimage_kin.study import held_out_scores, noise_of

        body = None if self.robot is None else load_embodiment(self.robot)
        against, verdict, noise = None, "", self.noise
        with heard() as said:
            exp = experience(self.read(self.recording, body))
            exp = exp if body is None else align(exp, body)
            specs = _specs(self.estimators or ESTIMATORS, body)
            calibrated = None
            if body is not None:
                _tell("the calibrated body")
                calibrated = calibrate(body, exp)
                verdict = calibrated.verdict
                if noise is None and np.isnan(noise_of(exp)):
                    noise = calibrated.fit.sigma[calibrated.labels.index("images")] * body.m**0.5
            rows = held_out_scores(specs, exp, folds=self.folds, noise=noise, seed=self.seed, tell=_tell)
            if calibrated is not None:
                against = _against(specs, rows, exp, calibrated, self.seed)
        page = report.write_scores(rows, self.out, against=against, verdict=verdict, said=said)
        errors = rows["pair_error_relative"]
        order = rows["estimator"].values[np.argsort(np.nan_to_num(errors.values, nan=np.inf), kind="stable")]
        status = int(not np.isfinite(errors.values).any())
        if self.json:
            print_json(
                {"page": str(page), "verdict": verdict, "notes": list(said), "estimators": _numbers(rows, order)}
            )
            return status
        for name in order:
            why = str(rows["failure"].sel(estimator=name).item())
            print(f"{name}: {why}" if why else f"{name}: {100 * float(errors.sel(estimator=name)):.3g} % of the motion")
        print(page)
        return status


def _numbers(rows: xr.Dataset, order: Iterable[str]) -> dict[str, Any]:
    """Errors of hidden motions over the motions, with their interval, the best first."""
    found: dict[str, Any] = {}
    for name in map(str, order):
        of = rows.sel(estimator=name)
        error = {part: finite(float(of[f"pair_error_relative{part}"])) for part in ("", "_lower", "_upper")}
        found[name] = {
            "relative_error": error[""],
            "interval": [error["_lower"], error["_upper"]],
            "failure": str(of["failure"].item()),
        }
    return found


def _tell(what: str) -> None:
    print(f"{what} ...", file=sys.stderr)


def _specs(names: tuple[str, ...], body: Embodiment | None) -> dict[str, Estimator]:
    """Estimators by name; with a body, also the body as it is thought to be."""
    from bodyimage_kin.errors import InvalidConfig
    from bodyimage_kin.study.specs import ESTIMATOR, snake

    found = {}
    for name in names:
        if body is None and ESTIMATOR.wants_body(name):
            raise InvalidConfig(f"{name} knows the body: give --robot")
        found[snake(name.rpartition(":")[2])] = ESTIMATOR.build(name, body=body)
    if body is not None:
        found["nominal"] = ESTIMATOR.build({"Nominal": {"embodiment": body}})
    return found


def _against(
    specs: dict[str, Estimator], rows: xr.Dataset, exp: xr.Dataset, calibrated: Calibrated, seed: int
) -> dict[str, xr.Dataset]:
    """Scores of what learns from all of the recording, against the body calibrated on it."""
    from bodyimage_kin.metrics.probes import Face, Training
    from bodyimage_kin.study import score

    _tell("against the calibrated body")
    probes = {"training": Training()} | ({} if calibrated.body.skin is None else {"on_face": Face()})
    names = ["relative_error", "relative_error_moved"]
    failure = rows["failure"]
    return {
        name: score(spec.fit(exp, seed), calibrated, exp, probes=probes, scores=names, seed=seed)
        for name, spec in specs.items()
        if not str(failure.sel(estimator=name).item())
    }
