"""What each ambiguity of Fuke, Ogino and Asada (2007) is worth: every reading run, all else as in the library.

    python comparisons/ambiguities/run.py               # writes results.json, table.md and the figure beside this file
    python comparisons/ambiguities/run.py --redraw      # table and figure again, from the results that are there

The infant touches its face for 200 s. Kinematic recordings train the network for 200 steps, those with dynamics and
torque noise for 500, as the paper has it. `docs/ambiguities.md` says what the paper leaves open and what we chose.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import os
import re
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from importlib import metadata
from pathlib import Path
from typing import Any

# One math thread, here and in every worker: the same bits everywhere.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import figure
import numpy as np
import torch
from readings import MEASURES, Found, of_seed

import bodyimage_kin as bk
from bodyimage_kin import figures
from bodyimage_kin._files import write_text
from bodyimage_kin._progress import Report, progress
from bodyimage_kin.study.statistics import PUBLISHED, holm, interval, sign_flip

HERE = Path(__file__).parent
HEADS = {
    "displacement": ("displacement error", 3),
    "face": ("Jacobian error on the face", 3),
    "tour": ("tour RMSE [mm]", 1),
    "touch": ("hand RMSE [mm]", 1),
    "span": ("map span", 3),
    "disparity": ("map disparity", 3),
    "topological": ("topological error", 1),
    "posture_span": ("posture map span", 3),
    "excitation": ("least / largest joint motion", 2),
}
"""Measure -> what the tables call it, and digits after the point."""
DIVERGED = 1e4
"""A score beyond is of a network that diverged, as is one that is not finite."""
PACKAGES = ("bodyimage-kin", "pin", "mujoco", "torch", "numpy", "scipy", "minisom")


def run(seeds: int, duration: float, workers: int | None, report: Report) -> dict[str, Any]:
    """Scores of every reading: ambiguity -> reading -> motion -> measure -> one value a seed, None where it diverged.

    They are the same whatever the number of workers (None: one a core): each seed has its own streams and one thread.
    """
    by_seed = dict(_seeds(seeds, duration, workers, report))
    difference = max(difference for _, difference in by_seed.values())
    if difference > 1e-9:
        raise SystemExit(f"the network of this comparison is not the package's: {difference:.1e} apart")
    values: dict[str, Any] = {ambiguity: {} for ambiguity in MEASURES}
    for seed in range(seeds):
        for ambiguity, motion, readings in by_seed[seed][0]:
            for reading, scores in readings.items():
                place = values[ambiguity].setdefault(reading, {}).setdefault(motion, {})
                for measure in dict.fromkeys((*MEASURES[ambiguity], *figure.PANELS)):
                    if measure in scores:
                        place.setdefault(measure, []).append(_rounded(scores[measure]))
    return {"values": values, "network_difference": difference}


def _seeds(
    seeds: int, duration: float, workers: int | None, report: Report
) -> Iterator[tuple[int, tuple[list[Found], float]]]:
    count = min(workers or os.cpu_count() or 1, seeds)
    # Forked children would inherit torch's threads in whatever state they are.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(count, mp_context=context, initializer=torch.set_num_threads, initargs=(1,)) as pool:
        waiting = {pool.submit(of_seed, seed, duration): seed for seed in range(seeds)}
        try:
            for done, future in enumerate(as_completed(waiting), start=1):
                yield waiting[future], future.result()
                report(done, seeds)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _rounded(value: float) -> float | None:
    """Four digits that count."""
    return float(f"{value:.4g}") if math.isfinite(value) and abs(value) <= DIVERGED else None


def summarise(values: Mapping[str, Any], measures: Mapping[str, Sequence[str]]) -> dict[str, Any]:
    """What can be said over recordings, nested as the values.

    Returns:
        Each measure's mean with its 95 % BCa interval, the number of recordings in which it diverged, and for what the
        table shows, p of no paired difference from the first reading, adjusted over the table.
    """
    return {ambiguity: _summary(readings, measures[ambiguity]) for ambiguity, readings in values.items()}


def _summary(readings: Mapping[str, Any], shown: Sequence[str]) -> dict[str, Any]:
    rows = {
        (reading, motion, measure): np.array(found, dtype=float)
        for reading, by_motion in readings.items()
        for motion, by_measure in by_motion.items()
        for measure, found in by_measure.items()
    }
    own = next(iter(readings))
    compared = [row for row in rows if row[0] != own and row[2] in shown]
    flips = [_p(rows[row] - rows[own, *row[1:]]) for row in compared]
    p = dict(zip(compared, holm(flips), strict=True))
    summary: dict[str, Any] = {}
    for row, found in rows.items():
        reading, motion, measure = row
        mean = interval(found)
        one = {"mean": mean.estimate, "lower": mean.lower, "upper": mean.upper, "p_holm": p.get(row, np.nan)}
        place = summary.setdefault(reading, {}).setdefault(motion, {})
        place[measure] = {name: _rounded(value) for name, value in one.items()}
        place[measure]["diverged"] = int(np.isnan(found).sum())
    return summary


def _p(differences: np.ndarray) -> float:
    """Of no difference; NaN where too few recordings have one."""
    finite = differences[np.isfinite(differences)]
    return sign_flip(finite) if len(finite) > 1 else np.nan


def tables(result: Mapping[str, Any]) -> str:
    """The markdown page: one table an ambiguity, between markers by which documentation includes it."""
    seeds = result["seeds"]
    publishable = seeds >= PUBLISHED
    legend = (
        r"A star: differs from the first reading (sign flips of paired differences, Holm over the table, 5 %)."
        if publishable
        else f"Fewer than {PUBLISHED} recordings: intervals are for orientation, and no differences are tested."
    )
    lines = [
        "# What each ambiguity of the paper is worth",
        "",
        f"Made by `{result['command']}`; mean and 95 % BCa interval over {seeds} recordings of each motion, "
        f"{result['duration']:g} s of touching.",
        f"Versions: {', '.join(f'{name} {version}' for name, version in result['versions'].items())}.",
        f"The first reading of each table is the library's. {legend}",
        "",
    ]
    for ambiguity, readings in result["summary"].items():
        measures = result["measures"][ambiguity]
        motions = list(next(iter(readings.values())))
        several = len(motions) > 1
        head = [f"{HEADS[m][0]}{f', {motion}' if several else ''}" for m in measures for motion in motions]
        lines += [f"<!-- begin {ambiguity} -->", "", f"| reading | {' | '.join(head)} |"]
        lines += [f"| --- |{' ---: |' * len(head)}"]
        for reading, by_motion in readings.items():
            cells = [
                _cell(by_motion[motion][m], HEADS[m][1], seeds, publishable) for m in measures for motion in motions
            ]
            lines.append(f"| {reading} | {' | '.join(cells)} |")
        lines += ["", f"<!-- end {ambiguity} -->", ""]
    return "\n".join(lines)


def _cell(one: Mapping[str, Any], digits: int, seeds: int, publishable: bool) -> str:
    if one["mean"] is None:
        return "diverges"
    text = f"{one['mean']:.{digits}f}"
    if one["lower"] is not None and one["lower"] < one["upper"]:
        text += f" [{one['lower']:.{digits}f}, {one['upper']:.{digits}f}]"
    if publishable and one["p_holm"] is not None and one["p_holm"] < 0.05:
        text += r" \*"
    return f"{text}, {one['diverged']} of {seeds} diverge" if one["diverged"] else text


def write(result: Mapping[str, Any], folder: Path) -> None:
    """Writes results, tables and figure."""
    folder.mkdir(parents=True, exist_ok=True)
    # A line for each row of numbers, and for each summary.
    text = re.sub(
        r"\[[^][{}]*\]|\{[^][{}]*\}",
        lambda found: re.sub(r"\s+", " ", found[0]),
        json.dumps(result, indent=1, allow_nan=False, ensure_ascii=False),
    )
    write_text(folder / "results.json", text + "\n")
    write_text(folder / "table.md", tables(result).rstrip() + "\n")
    figures.save(figure.draw(result["summary"]), folder, "figure")


def main() -> None:
    """Runs and writes everything."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=PUBLISHED, help="recordings of each motion (default: 30)")
    parser.add_argument("--duration", type=float, default=200.0, help="of touching [s] (default: 200)")
    parser.add_argument("--workers", type=int, default=None, help="processes (default: one a core)")
    parser.add_argument("--out", type=Path, default=HERE, help="folder to write to")
    parser.add_argument("--redraw", action="store_true", help="only summarise and draw the results of that folder")
    asked = parser.parse_args()
    if asked.redraw:
        result = json.loads((asked.out / "results.json").read_text(encoding="utf-8"))
    else:
        began = time.perf_counter()
        with progress("seeds") as report:
            result = run(asked.seeds, asked.duration, asked.workers, report)
        print(f"{time.perf_counter() - began:.0f} s", file=sys.stderr)
        result |= {
            "measures": MEASURES,
            "seeds": asked.seeds,
            "duration": asked.duration,
            "urdf_sha256": bk.load_embodiment("infant").robot.sha256,
            "versions": {name: metadata.version(name) for name in PACKAGES},
            "command": f"python comparisons/ambiguities/run.py --seeds {asked.seeds} --duration {asked.duration:g}",
        }
    result["summary"] = summarise(result["values"], result["measures"])
    first = ("command", "seeds", "duration", "versions", "urdf_sha256", "network_difference", "measures", "summary")
    write({name: result[name] for name in (*first, "values")}, asked.out)


if __name__ == "__main__":
    main()
