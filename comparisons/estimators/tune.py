"""Tunes every estimator under one budget on seen data alone: ``python comparisons/estimators/tune.py``.

Three searches, each with candidates and hidden parts of its own. The first decides, and is ``tuning.json``: every
candidate, its error, what was chosen. The others say how much of that was luck: ``luck.json`` has what each search
chose, and what an onlooker then measures on the face. Some ten minutes on two quiet cores.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import lru_cache
from pathlib import Path
from typing import Any

# Before numpy: one math thread a process, or results depend on how sums are divided among them.
os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
import torch
import xarray as xr

import bodyimage_kin as bk
from bodyimage_kin.errors import BodyImageKinError
from bodyimage_kin.recordings import simulate_many
from bodyimage_kin.recordings.schema import versions
from bodyimage_kin.study import plain_numbers
from bodyimage_kin.study.cells import fit_all
from bodyimage_kin.study.random_streams import stream
from bodyimage_kin.study.specs import ESTIMATOR
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
SEARCHES = 3
"""The first decides."""
FACES = 3
"""Recordings of each condition on which an onlooker measures what was chosen."""
BUDGET = 24
WORKERS = 2
NOT_TUNED = ("Ensemble", "Conformal", "Misinformed", "Given", "Saved", "Nominal")
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
def setting(conditions: tuple[str, ...]) -> tuple[bk.Embodiment, bk.Embodiment, Sequence[xr.Dataset]]:
    """The body, as it is and as it is thought to be, and these conditions' experiences, one after the other."""
    torch.set_num_threads(1)
    body = bk.load_embodiment(EMBODIMENT)
    experiences = []
    for condition in conditions:
        circle, noise = bk.motions.Circle(), bk.Noise(**CONDITIONS[condition])
        recordings = simulate_many(body, circle, recording_seeds(condition), noise=noise, threads=1)
        experiences += [bk.experience(recording) for recording in recordings]
    wrong = bk.estimators.Misinformed(bk.estimators.Analytic(body)).told(body, experiences[0], SEED)
    return body, wrong, experiences


def tune_family(name: str, conditions: tuple[str, ...], search: int) -> Tuned:
    """One estimator's search, in a worker; who calibrates begins at a body that is off."""
    body, wrong, experiences = setting(conditions)
    known = body if name == "Analytic" else wrong
    return tune(name, experiences, budget=BUDGET, seed=SEED + search, body=known, draws=DRAWS)


def on_face(name: str, condition: str, settings: Sequence[Mapping[str, Any]]) -> list[list[float | None]]:
    """The error on the face with each of these settings, in a worker: a row a setting, a column a recording."""
    torch.set_num_threads(1)
    body = bk.load_embodiment(EMBODIMENT)
    noise, face = bk.Noise(**CONDITIONS[condition]), bk.probes.Face()
    seeds = [stream(SEED, f"luck/{condition}/{index}", 2) for index in range(FACES)]
    seen = [bk.experience(bk.simulate(body, bk.motions.Circle(), seed=a, noise=noise)) for a, _ in seeds]
    touch = bk.motions.RandomTouch(duration=80.0)
    use = [bk.simulate(body, touch, seed=b, noise=noise) for _, b in seeds]
    wrong = bk.estimators.Misinformed(bk.estimators.Analytic(body)).told(body, seen[0], SEED)
    found: list[list[float | None]] = []
    for one in settings:
        spec = ESTIMATOR.build({name: dict(one)}, body=body if name == "Analytic" else wrong)
        found.append([])
        for learned, *with_use in zip(fit_all(spec, seen, range(FACES)), seen, use, strict=True):
            try:
                scored = bk.score(learned, body, *with_use, [face], scores=["relative_error_use"])
            except BodyImageKinError:
                found[-1].append(None)
                continue
            found[-1].append(plain_numbers(scored["relative_error_use"].item()))
    return found


def main() -> None:
    """Tunes all, writes, and prints a line for each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--workers", type=int, default=WORKERS, help=f"processes (default: {WORKERS})")
    parser.add_argument("--out", type=Path, default=HERE / "tuning.json", help="file of the results")
    parser.add_argument("--luck", type=Path, default=HERE / "luck.json", help="file of what other searches chose")
    parser.add_argument("--conditions", nargs="+", choices=CONDITIONS, default=list(CONDITIONS), help="of the circle")
    asked = parser.parse_args()
    conditions = tuple(asked.conditions)
    with ProcessPoolExecutor(asked.workers, multiprocessing.get_context("spawn")) as pool:
        searches = [searched(pool, conditions, search) for search in range(SEARCHES)]
        luck = {condition: lucky(pool, condition, conditions, searches) for condition in conditions}
    tuned = searches[0]
    asked.luck.write_text(json.dumps({"conditions": luck}, indent=1, allow_nan=False) + "\n", encoding="utf-8")
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


def searched(pool: ProcessPoolExecutor, conditions: tuple[str, ...], search: int) -> dict[str, Tuned]:
    """Each family's search, in the order of the package; says when one is there."""
    count = len(FAMILIES)
    found = {}
    for name, tuned in zip(
        FAMILIES, pool.map(tune_family, FAMILIES, [conditions] * count, [search] * count), strict=True
    ):
        print(f"search {search}, {name}: {sum(one.seconds for one in tuned.candidates):.0f} s", flush=True)
        found[name] = tuned
    return {name: found[name] for name in bk.estimators.names() if name in found}


def lucky(
    pool: ProcessPoolExecutor, condition: str, conditions: Sequence[str], searches: Sequence[Mapping[str, Tuned]]
) -> dict[str, Any]:
    """Family -> settings as they come and as each search chose them, with the error on the face of each."""
    at = indices(condition, conditions)
    settings = {
        name: [dict(first.candidates[0].settings), *(dict(search[name].best(at).settings) for search in searches)]
        for name, first in searches[0].items()
    }
    measured = dict(
        zip(settings, pool.map(on_face, settings, [condition] * len(settings), settings.values()), strict=True)
    )
    return {
        name: {
            "settings": settings[name],
            "seen": [plain_numbers(search[name].best(at).score(at)) for search in searches],
            "on_face": [plain_numbers(np.median([np.inf if one is None else one for one in row])) for row in rows],
            "on_face_of_each": rows,
        }
        for name, rows in measured.items()
    }


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
