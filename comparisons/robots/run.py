"""The experiment and the estimators on humanoids of the field: ``python comparisons/robots/run.py --out FOLDER``.

Needs the robots, ``pip install bodyimage-kin[robots]``. What was computed before is found in the folder and not
computed again. Writes ``results.json`` and ``table.md`` beside this file; ``--proposals`` alone writes
``proposals.md``: what ``bodyimage-kin embodiment new`` makes of the robots of the package.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

import bodyimage_kin as bk
from bodyimage_kin.errors import BodyImageKinError
from bodyimage_kin.figures import label
from bodyimage_kin.published import fuke2007
from bodyimage_kin.robot.meshes import package_file
from bodyimage_kin.study import Simulation, markdown_table, plain_numbers

HERE = Path(__file__).parent
BODIES = ("infant", "g1", "talos", "romeo", "icub")
WAYS = {"kinematic": {"dynamics": False}, "dynamics": {"dynamics": True}}
NOISE = bk.Noise(encoder=1e-3, image=2e-4)
ESTIMATORS: Mapping[str, Any] = {
    "zero": {"bodyimage_kin.estimators.nulls:Zero": {"truth": {"Analytic": {}}}},
    "least_squares": "LeastSquares",
    "paper_mlp": {"PaperMLP": {"hidden": 10, "learning_rate": 0.2, "steps": 500}},
    "trig_ridge": "TrigRidge",
    "polynomial": {"Polynomial": {"degree": 3}},
    "gaussian_process": "GaussianProcess",
    "kernel_ridge": "KernelRidge",
    "rational_polynomial": {"RationalPolynomial": {"degree": 2}},
    "rational_trig": "RationalTrig",
    # The body as drawn, and corrected: the true one is not told.
    "nominal": {"Misinformed": {"spec": {"Analytic": {}}}},
    "self_calibration": {"Misinformed": {"spec": {"SelfCalibration": {}}}},
}
"""As they come, nothing tuned."""
SCORE = "relative_error_use"
PACKAGE = "package://example-robot-data/robots/"
PROPOSED: tuple[tuple[str, dict[str, str]], ...] = (
    ("g1_description/urdf/g1_29dof_rev_1_0.urdf", {"hand": "left_rubber_hand"}),
    ("talos_data/robots/talos_full_v2.urdf", {"hand": "gripper_left_base_link"}),
    ("talos_data/robots/talos_reduced.urdf", {"hand": "gripper_left_base_link"}),
    ("romeo_description/urdf/romeo.urdf", {"hand": "l_wrist"}),
    ("icub_description/robots/icub.urdf", {"hand": "l_hand"}),
    ("human_description/robots/human.urdf", {"hand": "left_hand"}),
    ("simple_humanoid_description/urdf/simple_humanoid.urdf", {"hand": "l_wrist"}),
    ("alex_description/urdf/alex_nub_hands.urdf", {"hand": "leftNub"}),
    ("baxter_description/urdf/baxter.urdf", {"hand": "left_gripper_base_link"}),
    ("tiago_description/robots/tiago_dual.urdf", {"hand": "hand_left_palm_link"}),
    ("tiago_pro_description/robots/tiago_pro.urdf", {"hand": "gripper_left_base_link"}),
    ("pr2_description/urdf/pr2.urdf", {"hand": "l_gripper_palm_link"}),
    ("centauro_description/urdf/centauro.urdf", {"hand": "ball1_tip"}),
)
"""Robots of the package with an arm and something like a head; nothing but the hand is said."""


def claims_of(body: str, seeds: int, out: Path) -> dict[str, Any]:
    """The paper's experiment on one robot: each claim's mean, least and most over recordings, and who else meets it."""
    results = fuke2007.grid(body, seeds, quick=True).run(out / "fuke2007" / body)
    return {
        one["name"]: {key: one[key] for key in ("statement", "asked_by", "measured", "least", "most", "passed_by")}
        for one in fuke2007.judge(results)["claims"]
    }


def errors_of(body: str, seeds: int, out: Path) -> dict[str, dict[str, dict[str, float | None]]]:
    """Way of moving -> estimator -> its error on the face: median, least and most over recordings."""
    study = bk.Study(
        body,
        {way: Simulation(bk.motions.Circle(), noise=NOISE, **how) for way, how in WAYS.items()},
        ESTIMATORS,
        probes={"on_face": bk.probes.Face()},
        scores=("relative_error", SCORE),
        seeds=seeds,
    )
    results = study.run(out / "estimators" / body)
    found = results[SCORE].sel(probe="on_face").squeeze("embodiment")
    return {way: {name: _three(found.sel(recording=way, estimator=name).values) for name in ESTIMATORS} for way in WAYS}


def proposed() -> str:
    """What is proposed for each robot, and what keeps it from working, as Markdown."""
    rows = []
    for file, asked in PROPOSED:
        began = time.monotonic()
        name = Path(file).stem
        try:
            found = bk.body.propose(bk.Robot.from_urdf(package_file(PACKAGE + file)), **asked)
        except BodyImageKinError as problem:
            rows.append((name, asked["hand"], "-", "-", "refused", _short(str(problem))))
            print(f"{name}: {time.monotonic() - began:.0f} s", flush=True)
            continue
        body, skin = found.body, found.body.require_skin()
        size = "-" if skin.layout is None else f"{1e3 * skin.layout.size[1]:.0f} x {1e3 * skin.layout.size[0]:.0f} mm"
        told = "; ".join(_short(str(one)) for one in found.findings)
        rows.append((name, asked["hand"], str(body.p), f"{size} of {skin.link}", "yes" if found.works else "no", told))
        print(f"{name}: {time.monotonic() - began:.0f} s", flush=True)
    head = ("robot", "hand", "joints", "skin", "fit for the experiment", "what was found")
    works = sum(row[4] == "yes" for row in rows)
    return (
        "# Bodies proposed of a hand's name alone\n\n"
        f"{works} of {len(rows)} robots of the package example-robot-data can run the paper's experiment as proposed "
        "by `bodyimage-kin embodiment new`.\n\n" + markdown_table(head, rows, words=len(head)) + "\n"
    )


def table(found: Mapping[str, Any]) -> str:
    """The results as Markdown."""
    bodies = list(found["bodies"])
    seeds = found["seeds"]
    first = found["bodies"][bodies[0]]
    claims = [
        (
            one["statement"],
            *(
                f"{robot['claims'][name]['measured']:.3f} ({robot['claims'][name]['least']:.3f} to "
                f"{robot['claims'][name]['most']:.3f})"
                for robot in found["bodies"].values()
            ),
        )
        for name, one in first["claims"].items()
    ]
    errors = [
        (
            label(name),
            way,
            *(_over(robot["errors"][way][name]) for robot in found["bodies"].values()),
        )
        for way in WAYS
        for name in ESTIMATORS
    ]
    return "\n".join(
        [
            "# The experiment and the estimators on humanoids of the field",
            "",
            f"{seeds} recordings a robot: claims by their mean, errors by their median, with least and most. "
            "A robot is the unit that varies, and five are too few for an interval over robots. A dash: on one "
            "recording there is no Jacobian, for the body as drawn would touch its face where it has no image.",
            "",
            "## What the paper claims, in numbers",
            "",
            markdown_table(("claim", *bodies), claims, words=len(bodies) + 1),
            "",
            "## Relative error on the face, in the felt motion's metric",
            "",
            markdown_table(("estimator", "moved", *bodies), errors, words=len(bodies) + 2),
            "",
        ]
    )


def main() -> None:
    """Computes what is missing, and writes everything."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("reproduction/robots"), help="folder of the stores")
    parser.add_argument("--seeds", type=int, default=3, help="recordings a robot (default: 3)")
    parser.add_argument("--publish", type=Path, default=HERE, help="folder of what is kept")
    parser.add_argument("--proposals", action="store_true", help="only the table of proposals")
    asked = parser.parse_args()
    if asked.proposals:
        (asked.publish / "proposals.md").write_text(proposed(), encoding="utf-8")
        return
    found: dict[str, Any] = {"seeds": asked.seeds, "bodies": {}}
    for body in BODIES:
        began = time.monotonic()
        found["bodies"][body] = {
            "errors": errors_of(body, asked.seeds, asked.out),
            "claims": claims_of(body, asked.seeds, asked.out),
        }
        print(f"{body}: {time.monotonic() - began:.0f} s", flush=True)
    (asked.publish / "results.json").write_text(json.dumps(found, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    (asked.publish / "table.md").write_text(table(found), encoding="utf-8")


def _three(values: Float[np.ndarray, "seeds"]) -> dict[str, float | None]:
    return dict(plain_numbers({"median": np.median(values), "least": values.min(), "most": values.max()}))


def _over(error: Mapping[str, float | None]) -> str:
    told = ["-" if one is None else f"{one:.3f}" if one < 100 else f"{one:.2g}" for one in error.values()]
    return f"{told[0]} ({told[1]} to {told[2]})"


def _short(text: str) -> str:
    """Without the places of this machine, and no longer than a cell bears."""
    words = ["..." if word.strip("',;").startswith("/") else word for word in text.split()]
    told = " ".join(words)
    return told if len(told) < 320 else f"{told[:317]}..."


if __name__ == "__main__":
    main()
