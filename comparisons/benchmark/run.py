"""One row for any estimator: ``python comparisons/benchmark/run.py --estimator package.module:Class [--data FOLDER]``.

Without ``--estimator`` ours are scored. The simulated bodies need nothing; the real arm needs the files of
``ctu-vras/multirobot-calibration`` in ``FOLDER/motoman`` (or ``BODYIMAGE_KIN_DATA``), and is left out, and said so,
without them. Each row is a file under ``rows/``; ``table.md`` is made of all. README.md says how to enter one's own.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import xarray as xr

import bodyimage_kin as bk
from bodyimage_kin import metrics
from bodyimage_kin.calibration import drawn_bodies
from bodyimage_kin.errors import BodyImageKinError, DataWarning, Unreachable
from bodyimage_kin.estimators import Estimator, Learned, LearnedJacobian, edges
from bodyimage_kin.study.specs import ESTIMATOR
from bodyimage_kin.study.statistics import ratio_of_sums

HERE = Path(__file__).parent
VERSION = 1
"""Of tasks and splits; rows of another version are not compared."""
BODIES, RUNS, FOLDS = 20, 20, 5
NOISE = bk.Noise(torque=0.1, encoder=1e-3, image=2e-4)
EYE = 1
"""Of the arm, whose pixels are a task."""
REPEATS = 1e-3
"""Postures nearer than twice this [rad] are one, seen again."""


@dataclass(frozen=True, eq=False)
class DrawnJacobian(LearnedJacobian):
    """The Jacobian of a body as it is drawn; of no motion where its hand is out of its sight."""

    body: bk.Embodiment

    @property
    def p(self) -> int:
        """Number of felt joints."""
        return self.body.p

    @property
    def m(self) -> int:
        """Number of coordinates of a hand image."""
        return self.body.m

    def _displacement(self, q: torch.Tensor, dq: torch.Tensor) -> torch.Tensor:
        return (self._jacobian(q) @ dq[..., None])[..., 0]

    def _jacobian(self, q: torch.Tensor) -> torch.Tensor:
        return torch.nan_to_num(self.body.hand_image_jacobian(q, on_invisible="nan"), nan=0.0)


@dataclass(frozen=True)
class Drawing(Estimator):
    """Knows the body of each task as it is drawn, and learns nothing."""

    def fit(self, exp: xr.Dataset, seed: int = 0) -> DrawnJacobian:
        """The nominal body's Jacobian; a tracker stands where that body best agrees with what was seen."""
        unit = str(exp["hand_image"].attrs["units"])
        if [str(name) for name in exp["joint"].values] != list(motoman.JOINTS):
            return DrawnJacobian(bk.load_embodiment("infant"), unit=unit)
        return DrawnJacobian(motoman.seen_by(EYE) if unit == "px" else motoman.tracked(exp), unit=unit)


OURS: Mapping[str, Any] = {
    "nominal body": Drawing(),
    "least squares": "LeastSquares",
    "paper's network": {"PaperMLP": {"steps": 500}},
    "nearest neighbours": "NearestNeighbours",
    "cubic polynomial": "Polynomial",
    "ratio of polynomials": "RationalPolynomial",
    "trigonometric ridge": "TrigRidge",
    "kernel ridge, trigonometric": "KernelRidge",
    "kernel ridge, periodic": {"KernelRidge": {"kernel": "periodic"}},
    "Gaussian process": {"GaussianProcess": {"degree": 3, "most": 500}},
    "rational trigonometric": {"RationalTrig": {"degree": 2, "iterations": 2}},
}
PIXELS = ("higher_table{}_5x5", "lower_table{}_5x5", "wall_table{}_5x5", "self_lower{}_4x4", "self_upper{}_4x4")
WORDS = {
    "bodies": "simulated bodies, face",
    "everywhere": "arm everywhere, tracker",
    "cube": "arm in a cube, tracker",
    "pixels": "arm in a region, pixels",
}


@dataclass(frozen=True, eq=False)
class Part:
    """One thing to learn and to be judged on.

    Attributes:
        seen: What is learned from.
        judge: Of what was learned: squared errors and squared sizes, a number a unit.
    """

    seen: xr.Dataset
    judge: Any


# Tasks ---------------------------------------------------------------------------------------------------------------


def bodies() -> Iterator[Part]:
    """Infants off by the default prior, the paper's circle with all noise; the Jacobian on the face is asked for."""
    count = 0
    for seed, body in enumerate(drawn_bodies(bk.load_embodiment("infant"), 2 * BODIES, seed=2007)):
        if count == BODIES:
            return
        try:
            q = body.touch_postures(range(body.skin.count))
            seen = bk.experience(bk.simulate(body, bk.motions.Circle(), seed, noise=NOISE))
            touch = bk.simulate(body, bk.motions.RandomTouch(duration=40.0), seed, noise=NOISE)
        except Unreachable:
            continue
        count += 1
        true, metric = body.hand_image_jacobian(q).numpy(), metrics.motion_metric(touch)

        def judge(learned: Learned, q: Any = q, true: np.ndarray = true, metric: np.ndarray = metric) -> Any:
            off = learned.jacobian(q).detach().numpy() - true
            return [[float(np.einsum("nij,jk,nik->", one, metric, one))] for one in (off, true)]

        yield Part(seen, judge)


def tracked(folder: Path, name: str) -> Iterator[Part]:
    """Places of the reflector, fifths of successive runs held out in turn; displacements within runs are asked for."""
    points = motoman.tracker_points(folder, name)
    run = points["block"].values[0]
    for fold in range(FOLDS):
        hidden = run * FOLDS // RUNS == fold
        yield Part(points.isel(time=~hidden), _displacements(points.isel(time=hidden), run[hidden]))


def pixels(folder: Path) -> Iterator[Part]:
    """One marker before one eye, fifths of each region's poses in turn: both recordings go through the same ones."""
    for name in PIXELS:
        both = [motoman.markers(folder, f"no_leica_{name.format(one)}", EYE).of(0) for one in (1, 2)]
        number = np.concatenate([one.pose for one in both])
        exp = bk.recording(
            q=np.concatenate([one.q for one in both]),
            hand_image=np.concatenate([one.image for one in both]),
            joints=list(motoman.JOINTS),
            order="scattered",
            unit="px",
            encoder_noise=REPEATS,
        )
        fold = np.unique(number, return_inverse=True)[1] * FOLDS // len(np.unique(number))
        for one in range(FOLDS):
            hidden = exp.isel(time=fold == one)
            yield Part(exp.isel(time=fold != one), _displacements(hidden, np.zeros(hidden.sizes["time"], dtype=int)))


def _displacements(hidden: xr.Dataset, run: np.ndarray) -> Any:
    """Judges by displacements between near postures of a run, none of which was seen."""
    q, image = hidden["q"].values[0], hidden["hand_image"].values[0]
    ends = [np.flatnonzero(run == one)[edges(q[run == one], noise=REPEATS)] for one in np.unique(run)]

    def judge(learned: Learned) -> Any:
        found: list[list[float]] = [[], []]
        for of in ends:
            dr = image[of[:, 1]] - image[of[:, 0]]
            told = metrics.displacements_along(
                lambda at: learned.jacobian(torch.from_numpy(at)).detach(), q[of[:, 0]], q[of[:, 1]], dr.shape[1]
            )
            found[0].append(float(((told - dr) ** 2).sum()))
            found[1].append(float((dr**2).sum()))
        return found

    return judge


def tasks(folder: Path | None) -> dict[str, list[Part]]:
    """Every task that can be done here."""
    found = {"bodies": list(bodies())}
    if folder is not None:
        found |= {
            "everywhere": list(tracked(folder, "updated_leica")),
            "cube": list(tracked(folder, "leica_right_hand_6x6x6")),
            "pixels": list(pixels(folder)),
        }
    return found


# Rows ----------------------------------------------------------------------------------------------------------------


def row(name: str, spec: Estimator, given: Mapping[str, Sequence[Part]]) -> dict[str, Any]:
    """The errors of an estimator: of each task the whole, its 95 % over units (BCa), and what each unit has."""
    found: dict[str, Any] = {"name": name, "version": VERSION, "estimator": repr(spec), "tasks": {}}
    for task, parts in given.items():
        began = time.perf_counter()
        wrong: list[float] = []
        size: list[float] = []
        try:
            for seed, part in enumerate(parts):
                learned = spec.fit(part.seen, seed)
                one, other = part.judge(learned)
                wrong += one
                size += other
        except BodyImageKinError as problem:
            found["tasks"][task] = {"failed": str(problem)}
            continue
        found["tasks"][task] = {**pooled(wrong, size), "units": len(size), "seconds": time.perf_counter() - began}
    return found


def pooled(wrong: Sequence[float], size: Sequence[float]) -> dict[str, Any]:
    """Root of the ratio of sums over units."""
    each = np.sqrt(np.array(wrong) / np.array(size))
    if np.ptp(each) <= 1e-9:
        # All units are alike: there is nothing to resample.
        error, ends = float(np.sqrt(np.sum(wrong) / np.sum(size))), [each.min(), each.max()]
    else:
        found = ratio_of_sums(wrong, size)
        error, ends = found.estimate, [found.lower, found.upper]
    return {"error": error, "interval": ends, "each": each.tolist()}


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """All rows of this version, best mean rank first; of each task the rank stands before the error."""
    here = [one for one in rows if one["version"] == VERSION and not one.get("not_as_published")]
    names = [task for task in WORDS if any("error" in one["tasks"].get(task, {}) for one in here)]
    ranks: dict[str, list[int]] = {one["name"]: [] for one in here}
    cells: dict[str, list[str]] = {one["name"]: [] for one in here}
    for task in names:
        error = {one["name"]: one["tasks"].get(task, {}).get("error", np.inf) for one in here}
        order = sorted(error, key=lambda name: error[name])
        for one in here:
            of, name = one["tasks"].get(task, {}), one["name"]
            ranks[name].append(order.index(name) + 1)
            if "error" not in of:
                cells[name].append("failed" if "failed" in of else "")
                continue
            low, high = of["interval"]
            cells[name].append(f"{ranks[name][-1]}: {of['error']:.3g} [{low:.3g}, {high:.3g}]")
    lines = [
        f"Version {VERSION} of tasks and splits. Rank and relative error, in brackets 95 % over units (BCa): "
        f"{BODIES} bodies, {RUNS} runs of successive poses, 25 runs in five regions.",
        "",
        "| estimator | mean rank | " + " | ".join(WORDS[task] for task in names) + " |",
        "| --- | ---: |" + " ---: |" * len(names),
    ]
    for name in sorted(ranks, key=lambda one: np.mean(ranks[one])):
        lines.append(f"| {name} | {np.mean(ranks[name]):.1f} | " + " | ".join(cells[name]) + " |")
    return "\n".join(lines) + "\n"


def splits(given: Mapping[str, Sequence[Part]]) -> dict[str, Any]:
    """What is learned from in each part, as a hash: whoever has other numbers has other data or splits."""
    return {
        "version": VERSION,
        "learned_from": {
            task: [hashlib.sha256(np.round(part.seen["q"].values, 6).tobytes()).hexdigest()[:16] for part in parts]
            for task, parts in given.items()
        },
    }


def differing(found: Mapping[str, Any]) -> list[str]:
    """Tasks that are not learned from what was published."""
    file = HERE / "splits.json"
    published = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else found
    if published["version"] != found["version"]:
        return list(found["learned_from"])
    return [task for task, of in found["learned_from"].items() if of != published["learned_from"].get(task)]


def main(arguments: Sequence[str] | None = None) -> None:
    """Scores estimators, writes a row each and the table of all rows."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--estimator", help="package.module:Class, or a class of bk.estimators (default: all of ours)")
    parser.add_argument("--settings", type=json.loads, default={}, help="its settings, as JSON")
    parser.add_argument("--name", help="of the row (default: the class)")
    parser.add_argument("--data", type=Path, default=None, help="holds motoman/ (default: BODYIMAGE_KIN_DATA)")
    parser.add_argument("--out", type=Path, default=HERE, help="folder of the rows and the table")
    parser.add_argument("--publish-splits", action="store_true", help="for a new version: write what is learned from")
    asked = parser.parse_args(arguments)
    folder: Path | None = asked.data or Path(os.environ.get("BODYIMAGE_KIN_DATA", ""))
    if not (folder / "motoman" / "updated_leica_dataset.mat").is_file():
        print(f"the real arm is left out: no motoman/updated_leica_dataset.mat in '{folder}'; give --data FOLDER")
        folder = None
    torch.set_num_threads(1)
    warnings.simplefilter("ignore", DataWarning)
    name = asked.name or (asked.estimator or "").rpartition(":")[2]
    wanted = {name: {asked.estimator: asked.settings}} if asked.estimator else OURS
    specs = {label: ESTIMATOR.build(one, Path()) for label, one in wanted.items()}
    given = tasks(folder)
    differ = differing(splits(given))
    if differ:
        print(f"not the published splits: {', '.join(differ)}; other files, or another version of this package")
    (asked.out / "rows").mkdir(parents=True, exist_ok=True)
    for label, spec in specs.items():
        found = row(label, spec, given) | {"not_as_published": differ}
        file = asked.out / "rows" / f"{label.replace(' ', '_').replace(',', '').replace(chr(39), '')}.json"
        file.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        print(label, {task: round(of.get("error", np.nan), 4) for task, of in found["tasks"].items()}, flush=True)
    if asked.publish_splits:
        (HERE / "splits.json").write_text(json.dumps(splits(given), indent=1) + "\n", encoding="utf-8")
    rows = [json.loads(file.read_text(encoding="utf-8")) for file in sorted((asked.out / "rows").glob("*.json"))]
    (asked.out / "table.md").write_text(table(rows), encoding="utf-8")
    print(table(rows))


sys.path.insert(0, str(HERE.parent / "motoman"))
import motoman  # noqa: E402  # the robot of the neighbouring comparison

if __name__ == "__main__":
    main()
