"""Estimators compared over bodies, not over recordings of one body: ``python comparisons/bodies/run.py --out FOLDER``.

Each infant of the population (``population.py``) is a study of its own, of one recording of each kind; what was
computed before is found in the folder and not computed again. Writes ``results.json`` and ``table.md`` beside this
file; ``--redraw`` makes the table again from the results that are there.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import json
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from population import Individual, drawn

import bodyimage_kin as bk
from bodyimage_kin import figures
from bodyimage_kin.study import Row, Simulation, failures, markdown_table, plain_numbers, statistics

HERE = Path(__file__).parent
BODIES = 40
RECORDINGS = ("circle", "several_depths")
SEVERAL = (
    "least_squares", "paper_mlp", "polynomial", "rational_polynomial", "rational_trig", "kernel_ridge",
    "gaussian_process",
)  # fmt: skip
"""Estimators that learn from circles at three distances as well."""
NULLS = {"zero": "Zero", "scaled": "Scaled", "rotated": "Rotated", "rank_one": "RankOne", "other_arm": "OtherArm"}
ESTIMATORS: Mapping[str, Any] = {
    "analytic": "Analytic",
    # Thought to be the infant of the package, and known to be off by centimetres.
    "nominal": {"Nominal": {"embodiment": "infant"}},
    "self_calibration": {"SelfCalibration": {"body": "infant", "offset_spread": 0.03}},
    # Thought to be what it is within 3 degrees and 5 mm: another wrong body for each infant.
    "nominal_near": {"Misinformed": {"spec": {"Analytic": {}}}},
    "self_calibration_near": {"Misinformed": {"spec": {"SelfCalibration": {}}}},
    "least_squares": "LeastSquares",
    "least_squares_scaled": Row("LeastSquares", told={"scale": "depth_ratio"}, on=("circle",)),
    "ridge": "Ridge",
    "paper_mlp": {"PaperMLP": {"hidden": 10, "learning_rate": 0.2, "steps": 200}},
    "paper_mlp_500": {"PaperMLP": {"hidden": 10, "learning_rate": 0.2, "steps": 500}},
    "posture_mlp": "PostureMLP",
    "jacobian_network": "JacobianNetwork",
    "forward_network": "ForwardNetwork",
    "nearest_neighbours": "NearestNeighbours",
    "locally_weighted": "LocallyWeighted",
    "trig_ridge": "TrigRidge",
    "polynomial": {"Polynomial": {"degree": 3}},
    "rational_polynomial": {"RationalPolynomial": {"degree": 2}},
    "rational_trig": "RationalTrig",
    "rational_trig_1": {"RationalTrig": {"roughness": 1.0}},
    "kernel_ridge": "KernelRidge",
    "gaussian_process": "GaussianProcess",
    "broyden": "Broyden",
    "recursive_least_squares": "RecursiveLeastSquares",
    "kalman": "Kalman",
    **{f"null_{n}": {f"bodyimage_kin.estimators.nulls:{c}": {"truth": {"Analytic": {}}}} for n, c in NULLS.items()},
}
"""As they come, nothing tuned."""
LABELS = {
    "polynomial": "cubic polynomial",
    "rational_polynomial": "ratio of quadratics",
    "rational_trig_1": "rational trigonometric, roughness 1",
    "nominal": "another infant's body, nothing learned",
    "self_calibration": "self-calibration from another infant's body",
    "nominal_near": "the body as drawn, 5 mm off, nothing learned",
    "self_calibration_near": "self-calibration from the body as drawn",
}
SCORE = "relative_error_use"
DEEP = "_three_depths"
"""Ends the name of a row that learned from circles at three distances."""


def study(one: Individual, body: bk.Embodiment) -> bk.Study:
    """One infant: what it sees, and all that learn from it."""

    def row(name: str, spec: Any) -> Any:
        both = name in SEVERAL
        return spec if both or isinstance(spec, Row) else Row(spec, on=("circle",))

    return bk.Study(
        {body.name: body},
        {name: Simulation(one.circles(name), noise=one.noise) for name in RECORDINGS},
        {name: row(name, spec) for name, spec in ESTIMATORS.items()},
        probes={"on_circle": bk.probes.Training(), "on_face": bk.probes.Face()},
        scores=("relative_error", SCORE, "scale_free_error", "attribution", "displacement_error", "fit_seconds"),
        seeds=1,
    )


def rows_of(results: xr.Dataset) -> dict[str, dict[str, float]]:
    """Row -> its errors on one infant, not-a-number where it failed."""
    found = {}
    for recording in RECORDINGS:
        for name in ESTIMATORS if recording == "circle" else SEVERAL:
            at = results.squeeze(["embodiment", "seed"]).sel(recording=recording, estimator=name)
            found[name if recording == "circle" else f"{name}{DEEP}"] = {
                "on_face": at[SCORE].sel(probe="on_face").item(),
                "on_circle": at[SCORE].sel(probe="on_circle").item(),
                "on_face_identity": at["relative_error"].sel(probe="on_face").item(),
            }
    return dict(plain_numbers(found))


def summarised(bodies: list[dict[str, Any]]) -> dict[str, Any]:
    """What can be said over bodies: each row's distribution, and each pair's ratio and certainty."""
    names = list(bodies[0]["errors"])
    errors = {name: np.array([_number(body["errors"][name]["on_face"]) for body in bodies]) for name in names}
    on_circle = {name: np.array([_number(body["errors"][name]["on_circle"]) for body in bodies]) for name in names}
    ranked = [name for name in names if name != "analytic"]
    rows = {
        name: {
            **vars(statistics.spread(errors[name])),
            "on_circle": statistics.spread(on_circle[name]).median,
        }
        for name in ranked
    }
    learners = [name for name in ranked if not name.startswith("null_")]
    pairs = statistics.ranked({name: errors[name] for name in learners})
    people = [body["individual"] for body in bodies]
    summary = {
        "infants": len(people),
        "drawn": sum(one["tries"] for one in people),
        "least_arm": min(one["arm"] for one in people),
        "most_arm": max(one["arm"] for one in people),
        "rows": rows,
        "pairs": {f"{a} < {b}": vars(pair) for (a, b), pair in pairs.items()},
    }
    return dict(plain_numbers(summary))


def table(found: Mapping[str, Any]) -> str:
    """The results as Markdown."""
    rows, pairs = found["summary"]["rows"], found["summary"]["pairs"]
    order = sorted(rows, key=lambda name: rows[name]["median"])
    lines = [
        "# Estimators over bodies",
        "",
        f"{len(found['bodies'])} infants, one recording each. Relative error on the face, in the felt motion's metric: "
        "median over infants with its interval (95 %, between two of the values), the tenth and the ninetieth "
        "percentile, and the share of infants on which it is above 1, the error of a Jacobian of zeros. Infants on "
        "which an estimator has no Jacobian at all are left out of its row.",
        "",
        markdown_table(
            ("estimator", "median", "95 %", "10 %", "90 %", "above 1", "median on what was seen", "infants"),
            [
                (
                    named(name),
                    _say(one["median"]),
                    f"{_say(one['lower'])} to {_say(one['upper'])}",
                    _say(one["low"]),
                    _say(one["high"]),
                    f"{100 * one['above_one']:.0f} %",
                    _say(one["on_circle"]),
                    f"{one['units']:.0f}",
                )
                for name, one in ((name, rows[name]) for name in order)
            ],
        ),
        "",
        "## Neighbours in rank",
        "",
        "Each against the next: the median ratio of errors on the same infant, and on how many infants the first errs "
        "less. Certain: by the sign test, adjusted over all pairs of rows together (Holm), below 5 %.",
        "",
        markdown_table(
            ("first", "second", "ratio", "95 %", "errs less on", "certain"),
            [
                (named(a), named(b), _say(one["ratio"]), f"{_say(one['lower'])} to {_say(one['upper'])}",
                 f"{one['wins']:.0f} of {one['units']:.0f}", "yes" if one["p_holm"] < 0.05 else "no")
                for a, b in _neighbours(order)
                if (one := pairs.get(f"{a} < {b}"))
            ],
            words=2,
        ),
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


@figures.style()
def draw(found: Mapping[str, Any], folder: Path) -> None:
    """Medians over infants with their intervals, on what was seen and on the face."""
    rows = {named(name): one for name, one in found["summary"]["rows"].items()}
    parts = {
        part: [[_number(one["on_circle"]) if part == "median" else np.nan, _number(one[part])] for one in rows.values()]
        for part in ("median", "lower", "upper")
    }
    medians = xr.Dataset(
        {part: (("estimator", "probe"), values) for part, values in parts.items()},
        {"estimator": list(rows), "probe": ["on_circle", "on_face"]},
    )
    figure, grid = figures.panels(height=0.9 + 0.16 * len(rows))
    figures.errors(medians, grid[0, 0], xlabel="relative error")
    figures.legend(figure)
    figures.save(figure, folder, "errors")


def named(row: str) -> str:
    """What a reader calls a row."""
    name = row.removesuffix(DEEP)
    return LABELS.get(name, figures.label(name)) + (", three depths" if row.endswith(DEEP) else "")


def main() -> None:
    """Computes what is missing, and writes everything."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("reproduction/bodies"), help="folder of the stores")
    parser.add_argument("--bodies", type=int, default=BODIES, help=f"infants (default: {BODIES})")
    parser.add_argument("--workers", type=int, default=None, help="processes (default: one a core)")
    parser.add_argument("--publish", type=Path, default=HERE, help="folder of what is kept")
    parser.add_argument("--redraw", action="store_true", help="only summarise the results that are there")
    asked = parser.parse_args()
    kept = asked.publish / "results.json"
    if asked.redraw:
        found = json.loads(kept.read_text(encoding="utf-8"))
    else:
        found = {"bodies": []}
        for number in range(asked.bodies):
            began = time.monotonic()
            one, body = drawn(number, asked.out / "bodies" / f"{number:02d}")
            results = study(one, body).run(asked.out / "studies" / f"{number:02d}", workers=asked.workers)
            found["bodies"].append(
                {
                    "individual": dataclasses.asdict(one),
                    "errors": rows_of(results),
                    "failures": failures(results),
                }
            )
            found |= {"versions": json.loads(results.attrs["versions"])}
            print(f"infant {number}: {time.monotonic() - began:.0f} s", flush=True)
    found["summary"] = summarised(found["bodies"])
    lines = ",\n".join(f"{json.dumps(key)}: {json.dumps(value, allow_nan=False)}" for key, value in found.items())
    kept.write_text(f"{{\n{lines}\n}}\n", encoding="utf-8")
    (asked.publish / "table.md").write_text(table(found), encoding="utf-8")
    draw(found, asked.publish)


def _neighbours(order: list[str]) -> list[tuple[str, str]]:
    learners = [name for name in order if not name.startswith("null_")]
    return list(itertools.pairwise(learners))


def _number(value: float | None) -> float:
    return float("nan") if value is None else value


def _say(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}" if value < 100 else f"{value:.2g}"


if __name__ == "__main__":
    main()
