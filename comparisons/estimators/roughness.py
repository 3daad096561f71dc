"""What no seen datum decides: ``python comparisons/estimators/roughness.py`` writes ``roughness.json`` beside it.

The error on the face over one setting of the best estimator without structure, ``RationalTrig(degree=None)``, beside
what two ways of hiding seen data say of it: arcs of the circle, and what lies farthest from the rest (four draws).
Where these do not order the setting as the face does, nothing seen can judge it, and the curve is the result.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np
import torch

import bodyimage_kin as bk
from bodyimage_kin.metrics import displacement_error, hold_out, hold_out_far
from bodyimage_kin.recordings.schema import versions
from bodyimage_kin.study import plain_numbers, statistics
from bodyimage_kin.study.random_streams import stream

HERE = Path(__file__).parent
CONDITIONS = {"torque_noise": {"torque": 0.1}, "noisy": {"torque": 0.1, "encoder": 1e-3, "image": 2e-4}}
ROUGHNESS = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0)
RECORDINGS, REGIONS, DRAWS = 3, 3, 4


def judged(spec: bk.estimators.Estimator, hidden: list[bk.metrics.HeldOut]) -> list[float]:
    """Relative displacement error on each hidden part, of what was learned from the rest."""
    found = []
    for one in hidden:
        learned = spec.fit(one.seen)
        with torch.no_grad():
            found.append(displacement_error(learned.displacement(one.hidden.q, one.hidden.dq), one.hidden.dr))
    return found


def main() -> None:
    """Computes the curves; prints a line for each recording."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", type=int, default=RECORDINGS, help="of each condition")
    parser.add_argument("--out", type=Path, default=HERE / "roughness.json", help="file of the results")
    asked = parser.parse_args()
    torch.set_num_threads(1)
    body = bk.load_embodiment("infant")
    began, conditions = time.monotonic(), {}
    for name, noise in CONDITIONS.items():
        face, arcs, far = [], [], []
        for index in range(asked.recordings):
            seeds = stream(0, f"roughness/{name}/{index}", 2)
            seen = bk.experience(bk.simulate(body, bk.motions.Circle(), seed=seeds[0], noise=bk.Noise(**noise)))
            use = bk.simulate(body, bk.motions.RandomTouch(duration=80.0), seed=seeds[1], noise=bk.Noise(**noise))
            specs = [bk.estimators.RationalTrig(degree=None, roughness=one) for one in ROUGHNESS]
            parted = hold_out(seen, REGIONS), hold_out_far(seen, DRAWS, seed=index)
            face.append([])
            for spec in specs:
                scored = bk.score(spec.fit(seen), body, seen, use, [bk.probes.Face()], scores=["relative_error_use"])
                face[-1].append(float(scored["relative_error_use"].item()))
            arcs.append([judged(spec, parted[0]) for spec in specs])
            far.append([judged(spec, parted[1]) for spec in specs])
            print(f"{name} {index}: {[f'{one:.3f}' for one in face[-1]]}, {time.monotonic() - began:.0f} s", flush=True)
        conditions[name] = {"noise": noise, **curves(np.array(face), np.array(arcs), np.array(far))}
    found = {
        "roughness": list(ROUGHNESS),
        "recordings": asked.recordings,
        "conditions": conditions,
        "seconds": round(time.monotonic() - began),
        "versions": versions(),
    }
    asked.out.write_text(json.dumps(found, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def curves(face: np.ndarray, arcs: np.ndarray, far: np.ndarray) -> dict[str, object]:
    """Medians over recordings of each setting, all values, and how the criteria rank the settings beside the face."""
    by_draw = np.median(far, axis=0).T
    return {
        "on_face": plain_numbers(np.median(face, axis=0)),
        "on_face_of_each": plain_numbers(face),
        "arcs": plain_numbers(np.median(arcs.mean(-1), axis=0)),
        "far": plain_numbers(np.median(far.mean(-1), axis=0)),
        "far_of_each_draw": plain_numbers(by_draw),
        "rank_correlation": {
            "arcs": plain_numbers(rank(arcs.mean(-1), face)),
            "far": plain_numbers(rank(far.mean(-1), face)),
            "far_of_each_draw": plain_numbers([rank(one[None], np.median(face, axis=0)[None]) for one in by_draw]),
        },
        "best": {
            "on_face": ROUGHNESS[int(np.median(face, axis=0).argmin())],
            "arcs": ROUGHNESS[int(np.median(arcs.mean(-1), axis=0).argmin())],
            "far": ROUGHNESS[int(np.median(far.mean(-1), axis=0).argmin())],
            "far_of_each_draw": [ROUGHNESS[int(one.argmin())] for one in by_draw],
        },
    }


def rank(criterion: np.ndarray, face: np.ndarray) -> float:
    """Median over recordings of the rank correlation over settings."""
    return float(np.median([statistics.correlation(*pair).estimate for pair in zip(criterion, face, strict=True)]))


if __name__ == "__main__":
    main()
