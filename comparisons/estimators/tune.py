"""Tunes every estimator under one budget on seen data alone: ``python comparisons/estimators/tune.py``.

Writes ``tuning.json`` beside this file: every candidate, its score, what was chosen. A few minutes on two quiet cores.
"""

from __future__ import annotations

import argparse
import itertools
import multiprocessing
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import lru_cache
from pathlib import Path

# Before numpy: one math thread a process, or results depend on how sums are divided among them.
os.environ["OMP_NUM_THREADS"] = "1"

import torch
import xarray as xr

import bodyimage_kin as bk
from bodyimage_kin.recordings import simulate_many
from bodyimage_kin.recordings.schema import versions
from bodyimage_kin.study.random_streams import stream
from bodyimage_kin.study.tuning import Tuned, tune, write_tuning

HERE = Path(__file__).parent
EMBODIMENT = "infant"
CONDITIONS: Mapping[str, Mapping[str, float]] = {
    "noise_free": {},
    "torque_noise": {"torque": 0.1},
    "noisy": {"torque": 0.1, "encoder": 1e-3, "image": 2e-4},
}
"""Noise of the circle that is learned from. Each condition's own best is what its study takes: ``run.py``."""
RECORDINGS = 1
"""Of each condition."""
DRAWS = 4
"""Directions along which what lies farthest is hidden, of each recording."""
SEED = 0
BUDGET = 24
WORKERS = 2
NOT_TUNED = ("Ensemble", "Conformal", "Given", "Saved", "Nominal")
"""They take over the settings of the estimator within, or learn nothing."""
# The longest first, so that no worker is left alone with one at the end.
FAMILIES = sorted(
    (name for name in bk.estimators.names() if name not in NOT_TUNED),
    key=lambda name: (not name.endswith("Network"), name not in ("PostureMLP", "RationalTrig", "SelfCalibration")),
)


def recording_seeds(condition: str) -> list[int]:
    """Seeds of a stream of its own, apart from every study's."""
    return [stream(SEED, f"tuning/{condition}/{index}")[0] for index in range(RECORDINGS)]


@lru_cache(maxsize=1)
def setting(conditions: tuple[str, ...]) -> tuple[bk.Embodiment, Sequence[xr.Dataset]]:
    """The body, and the experiences of these conditions, one condition after the other."""
    torch.set_num_threads(1)
    body = bk.load_embodiment(EMBODIMENT)
    experiences = []
    for condition in conditions:
        circle, noise = bk.motions.Circle(), bk.Noise(**CONDITIONS[condition])
        recordings = simulate_many(body, circle, recording_seeds(condition), noise=noise, threads=1)
        experiences += [bk.experience(recording) for recording in recordings]
    return body, experiences


def tune_family(name: str, conditions: tuple[str, ...]) -> Tuned:
    """One estimator's search, in a worker."""
    body, experiences = setting(conditions)
    return tune(name, experiences, budget=BUDGET, seed=SEED, body=body, draws=DRAWS)


def main() -> None:
    """Tunes all, writes, and prints a line for each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--workers", type=int, default=WORKERS, help=f"processes (default: {WORKERS})")
    parser.add_argument("--out", type=Path, default=HERE / "tuning.json", help="file of the results")
    parser.add_argument("--conditions", nargs="+", choices=CONDITIONS, default=list(CONDITIONS), help="of the circle")
    asked = parser.parse_args()
    conditions = tuple(asked.conditions)
    with ProcessPoolExecutor(asked.workers, multiprocessing.get_context("spawn")) as pool:
        found = dict(zip(FAMILIES, searched(pool, conditions), strict=True))
    tuned = {name: found[name] for name in bk.estimators.names() if name in found}
    write_tuning(
        asked.out,
        tuned,
        embodiment=EMBODIMENT,
        conditions={
            condition: {
                "noise": dict(CONDITIONS[condition]),
                "seeds": recording_seeds(condition),
                "best": {name: dict(one.best(indices(condition, conditions)).settings) for name, one in tuned.items()},
                "by_draw": {
                    name: [dict(best.settings) for best in one.by_draw(indices(condition, conditions))]
                    for name, one in tuned.items()
                },
            }
            for condition in conditions
        },
        versions=versions(),
        fits={name: len(one.candidates) * DRAWS * RECORDINGS * len(conditions) for name, one in tuned.items()},
        seconds={name: round(sum(each.seconds for each in one.candidates)) for name, one in tuned.items()},
    )
    print(table(tuned))


def searched(pool: ProcessPoolExecutor, conditions: tuple[str, ...]) -> list[Tuned]:
    """Each family's search, in their order; says when one is there."""
    found = []
    for name, tuned in zip(FAMILIES, pool.map(tune_family, FAMILIES, itertools.repeat(conditions)), strict=False):
        print(f"{name}: {sum(one.seconds for one in tuned.candidates):.0f} s", flush=True)
        found.append(tuned)
    return found


def indices(condition: str, conditions: Sequence[str]) -> list[int]:
    """Places of a condition's experiences among all."""
    first = list(conditions).index(condition) * RECORDINGS
    return list(range(first, first + RECORDINGS))


def table(tuned: Mapping[str, Tuned]) -> str:
    """Scores of the default and of what was chosen, and the settings."""
    lines = [f"{'':22} {'default':>9} {'chosen':>9}  of  failed  settings"]
    for name, one in tuned.items():
        best, tried = one.best(), one.candidates
        failed = sum(not candidate.errors for candidate in tried)
        settings = ", ".join(f"{key}={value}" for key, value in best.settings.items()) or "nothing to tune"
        scores = f"{tried[0].score():9.3g} {best.score():9.3g}"
        lines.append(f"{name:22} {scores} {len(tried):3d} {failed:7d}  {settings}")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
