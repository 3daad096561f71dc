"""A real arm before a tracker and a camera: ``python comparisons/motoman/run.py --data FOLDER``, results beside this.

FOLDER holds ``motoman/`` with the files of ``ctu-vras/multirobot-calibration`` (``UserData/Robots/Motoman``), or is
named by ``BODYIMAGE_KIN_DATA``; without it nothing is done, and that is said. Some ten minutes of one quiet core.
"""

from __future__ import annotations

import argparse
import json
import os
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import motoman
import numpy as np
import torch
import xarray as xr

import bodyimage_kin as bk
from bodyimage_kin import estimators, figures, metrics
from bodyimage_kin.calibration import Calibrated, Observed, Prior
from bodyimage_kin.errors import DataWarning
from bodyimage_kin.estimators import fold_of_each
from bodyimage_kin.study.statistics import ratio_of_sums

HERE = Path(__file__).parent
PRIOR = Prior(axes=2e-3, offsets=1e-3, hand_shift=5e-3, camera_shift=0.05, camera_turn=0.05)
"""Of an industrial arm: tilts of 0.1 degrees, origins off by 1 mm; the tracker's frame is known roughly."""
FREE = ("axes", "offsets", "hand", "camera")
SIGMA = 1e-3
"""What the best rigid arm leaves of a coordinate in ``updated_leica``, by median [m]."""
LEARNERS: Mapping[str, estimators.Estimator] = {
    "least_squares": estimators.LeastSquares(),
    "paper_mlp": estimators.PaperMLP(steps=500),
    "nearest_neighbours": estimators.NearestNeighbours(),
    "polynomial": estimators.Polynomial(),
    "rational_polynomial": estimators.RationalPolynomial(),
    "rational_trig": estimators.RationalTrig(degree=2, iterations=2),
    "trig_ridge": estimators.TrigRidge(),
    "trig_ridge_6": estimators.TrigRidge(degree=6),
    "kernel_ridge": estimators.KernelRidge(),
    "kernel_ridge_periodic": estimators.KernelRidge("periodic"),
    "gaussian_process": estimators.GaussianProcess(),
    "gaussian_process_radial": estimators.GaussianProcess("radial", most=500),
}
LABELS = {
    "trig_ridge_6": "trigonometric ridge, degree 6",
    "kernel_ridge": "kernel ridge, trigonometric",
    "kernel_ridge_periodic": "kernel ridge, periodic",
    "gaussian_process_radial": "Gaussian process, radial",
    "nominal": "nominal body",
    "calibrated": "calibrated body",
}
IN_PIXELS = ("least_squares", "polynomial", "trig_ridge", "kernel_ridge", "gaussian_process")
REGIONS = {"higher table": "higher_table", "lower table": "lower_table", "wall": "wall_table"}
SIZES = (10, 20, 50, 100, 200, 400)
REPLAYED = (5, 10, 20, 40)
SUBSETS = 5
ORDERS = {"probes": "aimed at the poses", "everything": "D-optimal", "random": "random"}


def calibrated(body: bk.Embodiment, exp: xr.Dataset, noise: float = SIGMA, prior: Prior = PRIOR) -> Calibrated:
    """The arm fitted to images of a stated noise."""
    return bk.calibrate(body, Observed(exp, use=["images"], noise={"images": noise}), prior=prior, free=FREE, folds=2)


def only(exp: xr.Dataset, kept: np.ndarray) -> xr.Dataset:
    """Some poses of a recording of one trial."""
    return exp.isel(time=np.flatnonzero(kept) if kept.dtype == bool else kept)


def pooled(wrong: np.ndarray, size: np.ndarray, run: np.ndarray) -> list[float]:
    """Root of the ratio of sums, and its 95 % over runs of successive poses (BCa)."""
    sums = [np.bincount(run, values, minlength=run.max() + 1) for values in (wrong, size)]
    found = ratio_of_sums(*sums)
    return [found.estimate, found.lower, found.upper]


# The full Jacobian ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Truth:
    """The arm calibrated on all poses, and all that is asked of it."""

    exp: xr.Dataset
    nominal: bk.Embodiment
    fit: Calibrated

    @property
    def q(self) -> np.ndarray:
        """All poses [rad]."""
        return np.asarray(self.exp["q"].values[0])

    @property
    def jacobian(self) -> np.ndarray:
        """At all poses [m/rad], in the tracker's axes."""
        return jacobian(self.fit.body, self.q)


def jacobian(body: bk.Embodiment, q: np.ndarray) -> np.ndarray:
    """Of the reflector in the tracker's axes."""
    return np.asarray(body.hand_image_jacobian(torch.from_numpy(q)).numpy())


def headline(truth: Truth) -> dict[str, Any]:
    """Every learner, and the bodies, on fifths that they did not see: the error of the full Jacobian."""
    fold = fold_of_each(truth.exp, 5)[0]
    q, J = truth.q, truth.jacobian
    run = truth.exp["block"].values[0]
    observed = truth.exp["hand_image"].values[0]
    answers: dict[str, tuple[np.ndarray, np.ndarray]] = {}

    def add(name: str, learn: Callable[[xr.Dataset], Any]) -> None:
        Jh, image = np.empty_like(J), np.full_like(observed, np.nan)
        for one in range(5):
            learned = learn(only(truth.exp, fold != one))
            here = torch.from_numpy(q[fold == one])
            if isinstance(learned, bk.Embodiment):
                Jh[fold == one] = learned.hand_image_jacobian(here).numpy()
            else:
                Jh[fold == one] = learned.jacobian(here).detach().numpy()
            if hasattr(learned, "hand_image"):
                image[fold == one] = learned.hand_image(here).detach().numpy()
        answers[name] = Jh, image
        print(name, flush=True)

    for name, spec in LEARNERS.items():
        add(name, lambda exp, spec=spec: spec.fit(exp, seed=0))
    add("nominal", lambda exp: truth.nominal)
    add("calibrated", lambda exp: calibrated(truth.nominal, exp).body)
    size = (J**2).sum((1, 2))
    rows: dict[str, Any] = {}
    for name, (Jh, image) in answers.items():
        off = np.linalg.norm(image - observed, axis=1)
        rows[name] = {
            "jacobian": pooled(((Jh - J) ** 2).sum((1, 2)), size, run),
            "image_mm": None if np.isnan(off).all() else 1e3 * float(np.median(off)),
        }
    draws = [metrics.pooled_relative_error(J, jacobian(one, q)) for one in truth.fit.draws(20, seed=0)]
    halves = [calibrated(truth.nominal, only(truth.exp, run % 2 == one)).body for one in (0, 1)]
    spectrum = metrics.local_spectrum(q)
    return {
        "poses": len(q),
        "rows": rows,
        "truth": {
            "draws": [float(np.mean(draws)), float(np.std(draws))],
            "halves": metrics.pooled_relative_error(jacobian(halves[0], q), jacobian(halves[1], q)),
            "moved": spectrum.share,
            "left_mm": 1e3 * float(np.median(np.linalg.norm(truth.fit.fit.residuals[0], axis=1))),
            "unknown": len(truth.fit.unobservable),
        },
    }


def by_size(truth: Truth) -> dict[str, Any]:
    """Error of the full Jacobian at poses that were not learned from, by how many were."""
    J, count = truth.jacobian, len(truth.q)
    learners: dict[str, Callable[[xr.Dataset], np.ndarray]] = {
        name: lambda exp, spec=LEARNERS[name]: spec.fit(exp, seed=0).jacobian(truth.q).detach().numpy()
        for name in ("least_squares", "trig_ridge", "kernel_ridge", "gaussian_process_radial")
    }
    learners["calibrated"] = lambda exp: jacobian(calibrated(truth.nominal, exp).body, truth.q)
    found: dict[str, Any] = {name: {} for name in learners}
    for size in SIZES:
        for subset in range(SUBSETS):
            chosen = np.random.default_rng([size, subset]).permutation(count)[:size]
            rest = ~np.isin(np.arange(count), chosen)
            exp = only(truth.exp, np.sort(chosen))
            for name, learn in learners.items():
                found[name].setdefault(size, []).append(metrics.pooled_relative_error(J[rest], learn(exp)[rest]))
        print(f"{size} poses", flush=True)
    return found


class Poses(bk.probes.Probe):
    """The recorded poses."""

    def __init__(self, q: np.ndarray) -> None:
        self.q = q

    def postures(self, body: bk.Embodiment, seen: xr.Dataset | None) -> np.ndarray:
        """All of them; whatever was seen."""
        return self.q


def replayed(truth: Truth) -> dict[str, Any]:
    """The recorded poses in the order in which they would have been chosen, and at random."""
    q, J = truth.q, truth.jacobian
    # Not to choose from hundreds of poses by hundreds: every fifth is asked for.
    asked = Poses(q[::5])
    begin = metrics.pooled_relative_error(J, jacobian(truth.nominal, q))
    found: dict[str, Any] = {"nominal": begin, "orders": {}}
    orders = [("probes", 0), ("everything", 0), *(("random", seed) for seed in range(SUBSETS))]
    for aim, seed in orders:
        chosen = bk.next_postures(
            truth.nominal, None, asked, max(REPLAYED), candidates=q, prior=PRIOR, noise=SIGMA, free=FREE, aim=aim,
            exchange=False, seed=seed,
        )  # fmt: skip
        measured = []
        for size in REPLAYED:
            fit = calibrated(truth.nominal, only(truth.exp, np.sort(chosen.chosen[:size])))
            measured.append(metrics.pooled_relative_error(J, jacobian(fit.body, q)))
        foretold = [float(chosen.predicted_error[size]) for size in REPLAYED]
        found["orders"].setdefault(aim, []).append({"measured": measured, "foretold": foretold})
        print(aim, seed, flush=True)
    return found


# Region to region ----------------------------------------------------------------------------------------------------


def regions(folder: Path, eye: int = 1, face: int = 0) -> dict[str, Any]:
    """What pixels of one region teach about another: recordings 1 are learned from, recordings 2 judge."""
    seen = {name: motoman.markers(folder, f"no_leica_{short}1_5x5", eye) for name, short in REGIONS.items()}
    judge = {name: motoman.markers(folder, f"no_leica_{short}2_5x5", eye) for name, short in REGIONS.items()}
    body = motoman.seen_by(eye)
    found: dict[str, Any] = {
        "moved": {name: metrics.local_spectrum(one.of(face).q).share for name, one in judge.items()},
        "image": {},
        "pairs": {},
    }

    def note(name: str, begin: str, answer: Callable[[np.ndarray, np.ndarray], np.ndarray], learned: Any) -> None:
        for end, rows in judge.items():
            of = rows.of(face)
            off = np.linalg.norm(answer(of.q, motoman.FACES[of.face]) - of.image, axis=1)
            found["image"].setdefault(name, {}).setdefault(begin, {})[end] = float(np.median(off))
            hidden = estimators.pairs(plain(of))
            error = metrics.pair_error(metrics.predicted_pairs(learned, hidden), hidden.dr.numpy())
            found["pairs"].setdefault(name, {}).setdefault(begin, {})[end] = error.relative

    for begin, rows in seen.items():
        exp = plain(rows.of(face))
        for name in IN_PIXELS:
            learned = LEARNERS[name].fit(exp, seed=0)
            if hasattr(learned, "hand_image"):
                note(name, begin, lambda q, _, learned=learned: learned.hand_image(q).detach().numpy(), learned)
        fit = calibrated(body, rows.recording(), noise=5.0, prior=Prior())
        for name, one in (("nominal", body), ("calibrated", fit.body)):
            # The Jacobian of the body is that of its own point of the hand: here the marker's middle.
            at_face = estimators.Analytic(with_face(one, face)).fit(exp)
            note(name, begin, lambda q, offset, one=one: bodys_image(one, q, offset), at_face)
        print(begin, flush=True)
    return found


def plain(rows: motoman.Markers) -> xr.Dataset:
    """One face, of which a learner need not know where it is in the hand."""
    return bk.recording(q=rows.q, hand_image=rows.image, joints=list(motoman.JOINTS), order="scattered", unit="px")


def with_face(body: bk.Embodiment, face: int) -> bk.Embodiment:
    """The body whose hand is where a face is."""
    offset = body.hand.offset.numpy() + motoman.FACES[face]
    return bk.Embodiment.build(
        body.robot, joints=body.joints, hand=bk.Hand(body.hand.link, offset=offset), camera=body.camera
    )


def bodys_image(body: bk.Embodiment, q: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Pixels of points of the hand."""
    place = body.hand.offset.numpy() + offset
    return np.asarray(body.hand_image(torch.from_numpy(q), hand_offset=place, on_invisible="nan").numpy())


# Floor ---------------------------------------------------------------------------------------------------------------


def floors(folder: Path) -> dict[str, float]:
    """Noise of one observation, from poses that were repeated some twenty times."""
    found: dict[str, float] = {}
    for name in ("table1", "table2", "wall1", "wall2"):
        points = motoman.tracker_points(folder, f"leica_rep_{name}")["hand_image"].values[0]
        found[f"tracker, {name} [mm]"] = 1e3 * metrics.noise_floor(points, np.zeros(len(points), dtype=int))
        rows = motoman.markers(folder, f"leica_rep_{name}", 1)
        found[f"eye 1, {name} [px]"] = metrics.noise_floor(rows.image, rows.face)
    return found


# Results -------------------------------------------------------------------------------------------------------------


def markdown(found: Mapping[str, Any]) -> str:
    """The tables that are published."""
    with figures.labelled(LABELS):
        return "\n".join([*_headline(found["headline"]), *_regions(found["regions"]), *_sizes(found["sizes"]),
                          *_replay(found["replay"]), *_floors(found["floors"])])  # fmt: skip


def _headline(found: Mapping[str, Any]) -> list[str]:
    truth = found["truth"]
    lines = [
        "## The full Jacobian",
        "",
        f"`updated_leica`, {found['poses']} poses, fifths held out in turn. Relative error of the Jacobian against the "
        "body calibrated on all poses (in brackets 95 % over 20 runs of successive poses, BCa), and median error of "
        f"the reflector's place. {100 * truth['moved']:.0f} % of directions are moved locally. The truth's own doubt: "
        f"draws from its posterior are {truth['draws'][0]:.4f} (sd {truth['draws'][1]:.4f}) from it, its two halves "
        f"{truth['halves']:.4f} from each other; {truth['unknown']} of its directions are known from the prior alone, "
        f"and it leaves a median of {truth['left_mm']:.2f} mm.",
        "",
        "| | relative Jacobian error | place, held out [mm] |",
        "| --- | ---: | ---: |",
    ]
    for name, row in sorted(found["rows"].items(), key=lambda item: -item[1]["jacobian"][0]):
        error, low, high = row["jacobian"]
        digits = 4 if error < 0.05 else 2
        place = "" if row["image_mm"] is None else f"{row['image_mm']:.1f}"
        lines.append(f"| {figures.label(name)} | {error:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}] | {place} |")
    return [*lines, ""]


def _regions(found: Mapping[str, Any]) -> list[str]:
    names = list(REGIONS)
    lines = [
        "## From region to region",
        "",
        "Eye 1, one marker of the twenty (bodies are fitted to all). Learned from the first recording of a region "
        "(row), judged on the second one of each (column): median error [px], and relative error of pairs of near "
        "postures in brackets. Both recordings of a region go through the same poses: the diagonal says what is "
        "repeatable, the rest what is learned. Share of directions that the poses move locally: "
        + ", ".join(f"{name} {100 * found['moved'][name]:.0f} %" for name in names)
        + ".",
        "",
        "| | learned on | " + " | ".join(names) + " |",
        "| --- | --- |" + " ---: |" * len(names),
    ]
    for name, of in found["image"].items():
        for begin, ends in of.items():
            if name == "nominal" and begin != names[0]:
                continue
            on = "nothing" if name == "nominal" else begin
            cells = [f"{ends[end]:.4g} ({found['pairs'][name][begin][end]:.2f})" for end in names]
            lines.append(f"| {figures.label(name)} | {on} | " + " | ".join(cells) + " |")
    return [*lines, ""]


def _sizes(found: Mapping[str, Any]) -> list[str]:
    lines = [
        "## How many poses",
        "",
        f"Relative error of the full Jacobian at the poses left out: median (least to most) of {SUBSETS} random "
        "subsets.",
        "",
        "| poses | " + " | ".join(map(str, SIZES)) + " |",
        "| --- |" + " ---: |" * len(SIZES),
    ]
    for name, of in found.items():
        cells = []
        for values in of.values():
            digits = 4 if np.median(values) < 0.05 else 2
            cells.append(f"{np.median(values):.{digits}f} ({min(values):.{digits}f} to {max(values):.{digits}f})")
        lines.append(f"| {figures.label(name)} | " + " | ".join(cells) + " |")
    return [*lines, ""]


def _replay(found: Mapping[str, Any]) -> list[str]:
    words = ORDERS | {"random": f"random, median of {SUBSETS}"}
    lines = [
        "## Where to look next, replayed",
        "",
        "Poses of `updated_leica` in the order in which `bk.next_postures` would have chosen them, by an industrial "
        f"arm's prior (axes {1e3 * PRIOR.axes:.0f} mrad, origins {1e3 * PRIOR.offsets:.0f} mm, noise {1e3 * SIGMA:.0f} "
        f"mm): relative error of the calibrated body's Jacobian, and in brackets what was foretold. The nominal body "
        f"has {found['nominal']:.4f}.",
        "",
        "| order | " + " | ".join(f"{size} poses" for size in REPLAYED) + " |",
        "| --- |" + " ---: |" * len(REPLAYED),
    ]
    for aim, runs in found["orders"].items():
        measured, foretold = (np.median([run[key] for run in runs], axis=0) for key in ("measured", "foretold"))
        cells = [f"{one:.4f} ({other:.4f})" for one, other in zip(measured, foretold, strict=True)]
        lines.append(f"| {words[aim]} | " + " | ".join(cells) + " |")
    return [*lines, ""]


def _floors(found: Mapping[str, float]) -> list[str]:
    said = ", ".join(f"{name.replace(' [mm]', '').replace(' [px]', '')} {value:.3f} {name[-3:-1]}"
                     for name, value in found.items())  # fmt: skip
    return ["## Floor", "", f"Noise of one observation, from repeats of one pose (root mean square): {said}.", ""]


@figures.style()
def draw(found: Mapping[str, Any], folder: Path) -> None:
    """How many poses each learner needs; what choosing them is worth."""
    with figures.labelled(LABELS):
        figure, grid = figures.panels(1, 2, height=2.6)
        sizes, replay = grid[0]
        looks = figures.looks(found["sizes"])
        for name, of in found["sizes"].items():
            values = np.array([np.median(one) for one in of.values()])
            sizes.plot(SIZES, values, marker="o", ms=3, label=figures.label(name), color=looks[name]["color"])
        sizes.set(xscale="log", yscale="log", xlabel="poses learned from", ylabel="relative Jacobian error")
        for (aim, runs), line in zip(found["replay"]["orders"].items(), ("o-", "s--", "^:"), strict=True):
            replay.plot(REPLAYED, np.median([run["measured"] for run in runs], axis=0), line, ms=3, label=ORDERS[aim])
        replay.axhline(found["replay"]["nominal"], color="0.6", linewidth=0.8)
        replay.set(xlabel="poses chosen", ylabel="relative Jacobian error", ylim=(0, None))
        sizes.legend(fontsize="small")
        replay.legend(fontsize="small", title="order")
    figures.save(figure, folder, "poses")


def main(arguments: Sequence[str] | None = None) -> None:
    """Computes everything; writes results.json, table.md and the figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--data", type=Path, default=None, help="folder that holds motoman/ (default: BODYIMAGE_KIN_DATA)"
    )
    parser.add_argument("--out", type=Path, default=HERE, help="folder of the results")
    asked = parser.parse_args(arguments)
    folder = asked.data or Path(os.environ.get("BODYIMAGE_KIN_DATA", ""))
    if not (folder / "motoman" / "updated_leica_dataset.mat").is_file():
        print(
            f"skipped: no motoman/updated_leica_dataset.mat in '{folder}'; give --data FOLDER (README.md says whence)"
        )
        return
    torch.set_num_threads(1)
    warnings.simplefilter("ignore", DataWarning)
    began = time.perf_counter()
    exp = motoman.tracker_points(folder, "updated_leica")
    nominal = motoman.tracked(exp)
    truth = Truth(exp, nominal, calibrated(nominal, exp))
    found = {
        "floors": floors(folder),
        "headline": headline(truth),
        "regions": regions(folder),
        "sizes": by_size(truth),
        "replay": replayed(truth),
    }
    asked.out.mkdir(parents=True, exist_ok=True)
    (asked.out / "results.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    (asked.out / "table.md").write_text(markdown(json.loads(json.dumps(found))), encoding="utf-8")
    draw(found, asked.out)
    print(markdown(found))
    print(f"{time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
