"""What each ambiguity of Fuke, Ogino and Asada (2007) is worth: every reading run, all else as in the library.

    python comparisons/fuke2007/ambiguities.py          # writes ambiguities.json and ambiguities.md beside this file

The infant touches its face for 200 s. Kinematic recordings train the network for 200 steps, those with dynamics and
torque noise for 500, as the paper has it. `docs/ambiguities.md` says what the paper leaves open and what we chose.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import Any

# One math thread: the same bits everywhere.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import torch
from networks import Network
from world import Scores, World, of_all, of_map, of_world

import bodyimage_kin as bk
from bodyimage_kin.body_image import PostureToImage
from bodyimage_kin.estimators import ConstantJacobian, LearnedJacobian
from bodyimage_kin.recordings.simulate import DragSettings

HERE = Path(__file__).parent
URDFS = HERE.parents[1] / "urdf"
MEASURES = {
    "displacement": ("displacement error", "{:.2f}"),
    "face": ("Jacobian error on the face", "{:.2f}"),
    "tour": ("tour RMSE [mm]", "{:.1f}"),
    "touch": ("hand RMSE [mm]", "{:.1f}"),
    "span": ("map span", "{:.2f}"),
    "disparity": ("map disparity", "{:.3f}"),
    "topological": ("topological error", "{:.0f}"),
    "posture_span": ("posture map span", "{:.2f}"),
    "excitation": ("least / largest joint motion", "{:.2f}"),
}


def _networks(readings: Mapping[str, Network]) -> Callable[[World], dict[str, Scores]]:
    """Networks that differ in some fields; their steps are the world's unless a reading has its own."""

    def run(world: World) -> dict[str, Scores]:
        felt = bk.experience(world.circle)
        specs = {name: replace(spec, steps=spec.steps or world.steps) for name, spec in readings.items()}
        return {name: of_all(world, spec.fit(felt, world.seed)) for name, spec in specs.items()}

    return run


def _maps(readings: Mapping[str, Mapping[str, Any]]) -> Callable[[World], dict[str, Scores]]:
    """Maps learned with other settings from the same hand estimate."""
    return lambda world: {name: of_map(world, world.hand, **settings) for name, settings in readings.items()}


def posture(world: World) -> dict[str, Scores]:
    """Whether the posture is an input of f, and what no constant Jacobian can do better."""
    felt = bk.experience(world.circle)
    best = ConstantJacobian(torch.from_numpy(world.truth.mean(0)))
    return {
        "f(dq), the paper's network": of_all(world, world.learned),
        "f(q, dq), the same network": of_all(world, Network(steps=world.steps, posture=True).fit(felt, world.seed)),
        "f(q, dq), 20 times the steps": of_all(
            world, Network(steps=20 * world.steps, posture=True).fit(felt, world.seed)
        ),
        "constant, least squares": of_all(world, bk.estimators.LeastSquares().fit(felt)),
        "constant, mean of the true ones on the face": of_all(world, best),
    }


def jacobian_of_f(world: World) -> dict[str, Scores]:
    """Which Jacobian of f(dq): itself, without its bias, at zero, or the secant."""
    q, dq = world.motion
    zero = torch.zeros_like(dq)
    with torch.no_grad():
        at_zero = world.learned.jacobian(q[:1])[0]
        bias = world.learned.displacement(q[:1], zero[:1])[0]
        response = world.learned.displacement(q, dq) - bias
    secant = torch.linalg.lstsq(dq, response, driver="gelsd").solution.T
    return {
        "f(dq) itself": of_all(world, world.learned),
        "f(dq) - f(0)": of_all(world, _Unbiased(world.learned, bias)),
        "its derivative at zero": of_all(world, ConstantJacobian(at_zero)),
        "its secant over the touching motion": of_all(world, ConstantJacobian(secant.contiguous())),
    }


class _Unbiased(LearnedJacobian):
    def __init__(self, learned: LearnedJacobian, bias: torch.Tensor) -> None:
        self.learned, self.bias, self.p, self.m = learned, bias, learned.p, learned.m

    def _displacement(self, q: torch.Tensor, dq: torch.Tensor) -> torch.Tensor:
        return self.learned.displacement(q, dq) - self.bias


def reset_to(world: World) -> dict[str, Scores]:
    """What the integral is set to at a reset."""
    felt = bk.experience(world.touch)
    F = PostureToImage.fit(bk.experience(world.circle))
    settings: dict[str, dict[str, Any]] = {
        "the known image of the reference taxel": {},
        "F(theta), extrapolated from the circle": {"reset": "posture_map", "posture_map": F},
        "the true image (a diagnostic)": {"reset": "true"},
        "never reset": {"reset": "none", "initial": felt["reference_image"].values},
    }
    # The diagnostic alone is handed the truth.
    given = {name: world.touch if setting.get("reset") == "true" else felt for name, setting in settings.items()}
    return {
        name: of_map(world, bk.integrate(given[name], world.learned, **setting)) for name, setting in settings.items()
    }


def displacement_of_posture(world: World) -> dict[str, Scores]:
    """The displacement in equation 7: of each step, or from the reset's posture."""
    felt = bk.experience(world.touch)
    return {
        "steps summed": of_map(world, world.hand),
        "one displacement from the reset": of_map(world, bk.integrate(felt, world.learned, reset="secant")),
        "steps summed, true Jacobian": of_map(world, bk.integrate(felt, _analytic(world))),
        "one displacement, true Jacobian": of_map(world, bk.integrate(felt, _analytic(world), reset="secant")),
    }


def _analytic(world: World) -> LearnedJacobian:
    return bk.estimators.Analytic(world.body).fit(bk.experience(world.circle))


def reset_interval(world: World, duration: float, settings: Mapping[str, Any]) -> dict[str, Scores]:
    """When the integral is reset."""
    found = {"every 10 s": of_map(world, world.hand)}
    for name, interval in {"every 5 s": 5.0, "every 30 s": 30.0, "only at the start": None}.items():
        touch = bk.simulate.random_touch(
            world.body, seed=world.seed, duration=duration, reset_interval=interval, **settings
        )
        other = replace(world, touch=touch)
        found[name] = of_map(other, bk.integrate(bk.experience(touch), world.learned))
    return found


def silence(world: World) -> dict[str, Scores]:
    """Whether touches or taxels are silent."""
    # The recording's own silence is undone, so that only the reading's is left.
    spoken = replace(world, touch=world.touch.assign(taxel=world.touch["true_taxel"]))
    return _maps(
        {
            "a whole touch, 20%": {"silence": 0.2},
            "each taxel by itself, 20%": {"silence": 0.2, "silence_mode": "taxel"},
            "none": {},
        }
    )(spoken)


def noise(noisy: World, quiet: World, duration: float) -> dict[str, Scores]:
    """Noise on the hand's torque or on joint angles, and how strong."""
    found = {"torque on the hand, variance 0.01, held 2 ms": of_world(noisy)}
    drags = {
        "torque, standard deviation 0.01": {"torque_variance": 1e-4},
        "torque, held 20 ms": {"torque_variance": 0.01, "torque_hold": 0.02},
        "torque, held 100 ms": {"torque_variance": 0.01, "torque_hold": 0.1},
    }
    for name, drag in drags.items():
        world = World.record(noisy.body, noisy.seed, noisy.steps, duration, dynamics=True, drag=DragSettings(**drag))
        found[name] = of_world(world)
    for name, deviation in {"0.1 rad (variance 0.01)": 0.1, "0.01 rad": 0.01, "0.001 rad": 0.001}.items():
        rng = np.random.default_rng(quiet.seed)
        felt = [
            recording.assign(q=recording["q"] + deviation * rng.standard_normal(recording["q"].shape))
            for recording in (quiet.circle, quiet.tour, quiet.touch)
        ]
        found[f"joint angles, {name}"] = of_world(World(quiet.body, quiet.seed, noisy.steps, *felt))
    return found | {"none": of_world(replace(quiet, steps=noisy.steps))}


def noise_and_steps(noisy: World, quiet: World) -> dict[str, Scores]:
    """Noise and learning steps crossed: Fig. 9 and Table 1."""
    return {
        f"{name} noise, {steps} steps": of_world(replace(world, steps=steps))
        for name, world in (("without", quiet), ("with", noisy))
        for steps in (200, 500)
    }


def circle(world: World, settings: Mapping[str, Any]) -> dict[str, Scores]:
    """Where the hand circles while it learns."""
    found = {"radius 5 cm, 3 cm in front": of_all(world, world.learned)}
    for radius, distance in ((0.05, 0.015), (0.05, 0.06), (0.05, 0.1), (0.03, 0.03)):
        seen = bk.simulate.circle(world.body, seed=world.seed, radius=radius, distance=distance, **settings)
        learned = Network(steps=world.steps).fit(bk.experience(seen), world.seed)
        found[f"radius {100 * radius:g} cm, {100 * distance:g} cm in front"] = of_all(world, learned)
    return found


def dimensions(world: World, longer: Mapping[str, bk.Embodiment], duration: float) -> dict[str, Scores]:
    """An arm of other lengths."""
    found = {"the infant's arm": of_world(world)}
    for name, body in longer.items():
        found[name] = of_world(World.record(body, world.seed, world.steps, duration, dynamics=False))
    return found


def infant_with_arm(factor: float, folder: Path) -> bk.Embodiment:
    """The infant with upper arm and forearm longer by a factor; the hand, the head and the masses stay."""
    tree = ET.parse(URDFS / "infant.urdf")
    for joint in tree.iter("joint"):
        if joint.get("name") in ("left_elbow", "left_wrist"):
            origin = joint.find("origin")
            assert origin is not None
            origin.set("xyz", " ".join(str(factor * float(part)) for part in origin.attrib["xyz"].split()))
    folder.mkdir()
    tree.write(folder / "infant.urdf")
    (folder / "infant.toml").write_text((URDFS / "infant.toml").read_text())
    return bk.load_embodiment(folder / "infant.toml")


AS_IS = Network(steps=0)
"""Zero steps stand for those of the world."""
NETWORKS = {
    "hidden": (
        ("displacement", "tour", "topological"),
        _networks(
            {
                "one layer of 10 units": AS_IS,
                "ten layers of 10 units": replace(AS_IS, depth=10),
                "two layers of 10 units": replace(AS_IS, depth=2),
                "one layer of 3 units": replace(AS_IS, hidden=3),
                "one layer of 30 units": replace(AS_IS, hidden=30),
                "logistic units": replace(AS_IS, unit="logistic"),
            }
        ),
    ),
    "learning_rate": (
        ("displacement", "tour", "topological"),
        _networks(
            {
                "divided by the spread, mean over samples": AS_IS,
                "brought to [-1, 1], mean over samples": replace(AS_IS, scaling="range"),
                "radians and metres, mean over samples": replace(AS_IS, scaling="none"),
                "radians and metres, sum over samples": replace(AS_IS, scaling="none", update="sum"),
                "divided by the spread, after each sample": replace(AS_IS, update="online"),
                "divided by the spread, a step is one sample": replace(AS_IS, update="sample"),
            }
        ),
    ),
}
MAPS = {
    "kernel": (
        ("span", "disparity", "topological"),
        _maps(
            {
                "exp(-d^2/40), d in taxels": {},
                "exp(-d^2/40), d in mm (3 mm a taxel)": {"gamma": 40.0 / 9.0},
                "exp(-d/40), d in taxels": {"kernel": "plain"},
                "exp(-d/40), d in mm": {"kernel": "plain", "gamma": 40.0 / 3.0},
                "exp(-d^2/gamma), gamma 40 to 1": {"gamma_final": 1.0},
            }
        ),
    ),
    "posture_kernel": (
        ("posture_span",),
        _maps({"5.8, the same share of the grid": {}, "40, as for taxels": {"gamma_posture": 40.0}}),
    ),
    "alpha": (
        ("span", "disparity", "topological"),
        _maps(
            {
                "0.3 to 0.02, geometric": {},
                "0.1, constant": {"alpha": "constant"},
                "1 / visits of the winner": {"alpha": "per_visit"},
            }
        ),
    ),
}


def run(seeds: int, duration: float) -> dict[str, Any]:
    """Every reading of every ambiguity: ambiguity -> measures and reading -> motion -> measure -> one value a seed."""
    body = bk.load_embodiment("infant")
    shown: dict[str, tuple[str, ...]] = {}
    values: dict[str, dict[str, dict[str, dict[str, list[float]]]]] = {}

    def note(ambiguity: str, measures: tuple[str, ...], motion: str, found: Mapping[str, Scores]) -> None:
        shown[ambiguity] = measures
        for reading, scores in found.items():
            place = values.setdefault(ambiguity, {}).setdefault(reading, {}).setdefault(motion, {})
            for measure in measures:
                place.setdefault(measure, []).append(float(scores[measure]))

    drag = {"dynamics": True, "drag": DragSettings(torque_variance=0.01)}
    with tempfile.TemporaryDirectory() as folder:
        arms = {
            f"upper arm and forearm {name}": infant_with_arm(factor, Path(folder, name.replace(" ", "_")))
            for name, factor in {"10% shorter": 0.9, "15% longer": 1.15}.items()
        }
        for seed in range(seeds):
            worlds = {
                "kinematic": World.record(body, seed, 200, duration, dynamics=False),
                "noise": World.record(body, seed, 500, duration, **drag),
            }
            quiet = World.record(body, seed, 200, duration, dynamics=True)
            settings: dict[str, dict[str, Any]] = {"kinematic": {"dynamics": False}, "noise": drag}
            for motion, world in worlds.items():
                for ambiguity, (measures, readings) in {**NETWORKS, **MAPS}.items():
                    note(ambiguity, measures, motion, readings(world))
                chain = ("displacement", "face", "topological")
                note("posture", chain, motion, posture(world))
                note("jacobian", ("displacement", "tour", "touch"), motion, jacobian_of_f(world))
                note("reset_to", ("touch", "span", "topological"), motion, reset_to(world))
                note("secant", ("touch", "span", "topological"), motion, displacement_of_posture(world))
                note("silence", ("span", "disparity", "topological"), motion, silence(world))
                note("circle", ("displacement", "tour", "span"), motion, circle(world, settings[motion]))
            note(
                "reset_when", ("touch", "span", "topological"), "noise", reset_interval(worlds["noise"], duration, drag)
            )
            note(
                "noise",
                ("excitation", "displacement", "tour", "topological"),
                "noise",
                noise(worlds["noise"], quiet, duration),
            )
            note("captions", ("displacement", "tour", "topological"), "noise", noise_and_steps(worlds["noise"], quiet))
            note(
                "dimensions",
                ("displacement", "tour", "span"),
                "kinematic",
                dimensions(worlds["kinematic"], arms, duration),
            )
            print(f"seed {seed} done", file=sys.stderr, flush=True)
    return {"measures": shown, "values": values, "network_difference": _check_network(worlds["noise"])}


def _check_network(world: World) -> float:
    """Largest relative difference between `Network` and the package's own, which must be rounding."""
    felt = bk.experience(world.circle)
    q, dq = world.motion
    ours = bk.estimators.PaperMLP(steps=world.steps).fit(felt, world.seed).displacement(q, dq)
    difference = float((world.learned.displacement(q, dq) - ours).abs().max() / ours.abs().max())
    if difference > 1e-9:
        raise SystemExit(f"the network of this comparison is not the package's: {difference:.1e} apart")
    return difference


def tables(result: Mapping[str, Any], command: str) -> str:
    """The markdown page: one table an ambiguity, between markers by which documentation includes it."""
    lines = [
        "# What each ambiguity of the paper is worth",
        "",
        f"Made by `{command}`; mean ± standard deviation over {result['seeds']} seeds, {result['duration']:g} s of "
        "touching.",
        f"Versions: {', '.join(f'{name} {version}' for name, version in result['versions'].items())}.",
        "The first reading of each table is the library's.",
        "",
    ]
    for ambiguity, readings in result["values"].items():
        measures = result["measures"][ambiguity]
        motions = list(next(iter(readings.values())))
        several = len(motions) > 1
        head = [f"{MEASURES[m][0]}{f', {motion}' if several else ''}" for m in measures for motion in motions]
        lines += [f"<!-- begin {ambiguity} -->", "", f"| reading | {' | '.join(head)} |"]
        lines += [f"| --- |{' ---: |' * len(head)}"]
        for reading, by_motion in readings.items():
            cells = [_cell(by_motion[motion][m], MEASURES[m][1]) for m in measures for motion in motions]
            lines.append(f"| {reading} | {' | '.join(cells)} |")
        lines += ["", f"<!-- end {ambiguity} -->", ""]
    return "\n".join(lines)


def _cell(values: list[float], form: str) -> str:
    found = np.array(values)
    if not np.isfinite(found).all() or np.abs(found).max() > 1e4:
        return "diverges"
    return f"{form.format(found.mean())} ± {form.format(found.std())}"


def main() -> None:
    """Runs and writes both files."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--duration", type=float, default=200.0, help="of touching [s]")
    parser.add_argument("--out", type=Path, default=HERE, help="folder to write to")
    asked = parser.parse_args()
    torch.set_num_threads(1)
    began = time.perf_counter()
    result = run(asked.seeds, asked.duration)
    print(f"{time.perf_counter() - began:.0f} s", file=sys.stderr)
    packages = ("bodyimage-kin", "pin", "mujoco", "torch", "numpy", "scipy", "minisom")
    result |= {
        "seeds": asked.seeds,
        "duration": asked.duration,
        "urdf_sha256": bk.load_embodiment("infant").robot.sha256,
        "versions": {name: metadata.version(name) for name in packages},
    }
    command = f"python comparisons/fuke2007/ambiguities.py --seeds {asked.seeds} --duration {asked.duration:g}"
    result["command"] = command
    rounded = json.loads(json.dumps(result), parse_float=lambda text: float(f"{float(text):.6g}"))
    for name, text in (
        ("ambiguities.json", json.dumps(rounded, indent=1)),
        ("ambiguities.md", tables(result, command)),
    ):
        temporary = asked.out / f".{name}.tmp"
        temporary.write_text(text.rstrip() + "\n", encoding="utf-8")
        os.replace(temporary, asked.out / name)


if __name__ == "__main__":
    main()
