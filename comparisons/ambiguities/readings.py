"""Every reading of every ambiguity, run on the recordings of one seed."""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from networks import Network
from world import Scores, World, of_all, of_map, of_world

import bodyimage_kin as bk
from bodyimage_kin.body_image import PostureToImage
from bodyimage_kin.estimators import ConstantJacobian, LearnedJacobian, PaperMLP

URDFS = Path(__file__).parents[2] / "urdf"
MEASURES = {
    "hidden": ("displacement", "tour", "topological"),
    "learning_rate": ("displacement", "tour", "topological"),
    "kernel": ("span", "disparity", "topological"),
    "posture_kernel": ("posture_span",),
    "alpha": ("span", "disparity", "topological"),
    "posture": ("displacement", "face", "topological"),
    "jacobian": ("displacement", "tour", "touch"),
    "reset_to": ("touch", "span", "topological"),
    "secant": ("touch", "span", "topological"),
    "silence": ("span", "disparity", "topological"),
    "circle": ("displacement", "tour", "span"),
    "reset_when": ("touch", "span", "topological"),
    "noise": ("excitation", "displacement", "tour", "topological"),
    "captions": ("displacement", "tour", "topological"),
    "dimensions": ("displacement", "tour", "span"),
}
"""What each ambiguity's table shows, in the order of the tables."""


class Found(NamedTuple):
    """Scores of the readings of one ambiguity; the first reading is the library's."""

    ambiguity: str
    motion: str
    readings: Mapping[str, Scores]


def of_seed(seed: int, duration: float) -> tuple[list[Found], float]:
    """All readings on the recordings of one seed.

    Args:
        seed: Of recordings and first weights.
        duration: Of touching [s].

    Returns:
        What was found, and how far the network of this comparison is from the package's, relative.
    """
    body, longer = bodies()
    drag: dict[str, Any] = {"dynamics": True, "noise": bk.Noise(torque=0.1)}
    settings: dict[str, dict[str, Any]] = {"kinematic": {"dynamics": False}, "noise": drag}
    kinematic = World.record(body, seed, 200, duration, **settings["kinematic"])
    noisy = World.record(body, seed, 500, duration, **drag)
    quiet = World.record(body, seed, 200, duration, dynamics=True)
    found = []
    for motion, world in (("kinematic", kinematic), ("noise", noisy)):
        found += [Found(ambiguity, motion, readings(world)) for ambiguity, readings in READINGS.items()]
        found.append(Found("circle", motion, circle(world, settings[motion])))
    found += [
        Found("reset_when", "noise", reset_interval(noisy, duration, drag)),
        Found("noise", "noise", noise(noisy, quiet, duration)),
        Found("captions", "noise", noise_and_steps(noisy, quiet)),
        Found("dimensions", "kinematic", dimensions(kinematic, longer, duration)),
    ]
    return found, network_difference(noisy)


def network_difference(world: World) -> float:
    """Largest difference between the predictions of `Network` and of the package's own, which must be rounding."""
    q, dq = world.motion
    ours = PaperMLP(steps=world.steps).fit(bk.experience(world.circle), world.seed).displacement(q, dq)
    return float((world.learned.displacement(q, dq) - ours).abs().max() / ours.abs().max())


@cache
def bodies() -> tuple[bk.Embodiment, dict[str, bk.Embodiment]]:
    """The infant, and infants with other arms, read once a process."""
    factors = {"10% shorter": 0.9, "15% longer": 1.15}
    with tempfile.TemporaryDirectory() as folder:
        arms = {
            f"upper arm and forearm {name}": infant_with_arm(factor, Path(folder, f"{factor}"))
            for name, factor in factors.items()
        }
    return bk.load_embodiment("infant"), arms


def _networks(readings: Mapping[str, Network | PaperMLP]) -> Callable[[World], dict[str, Scores]]:
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


@dataclass(frozen=True, eq=False)
class _Unbiased(LearnedJacobian):
    learned: LearnedJacobian
    bias: torch.Tensor

    @property
    def p(self) -> int:
        return self.learned.p

    @property
    def m(self) -> int:
        return self.learned.m

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
        touch = bk.simulate(world.body, bk.motions.RandomTouch(duration, interval), world.seed, **settings)
        other = replace(world, touch=touch)
        found[name] = of_map(other, bk.integrate(bk.experience(touch), world.learned))
    return found


def silence(world: World) -> dict[str, Scores]:
    """Whether touches or taxels are silent."""
    # The recording's own silence is undone, so that only the reading's is left.
    spoken = replace(world, touch=world.touch.assign(touched=world.touch["true_touched"]))
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
    torques = {
        "torque, standard deviation 0.01": bk.Noise(torque=0.01),
        "torque, held 20 ms": bk.Noise(torque=0.1, torque_hold=0.02),
        "torque, held 100 ms": bk.Noise(torque=0.1, torque_hold=0.1),
    }
    for name, torque in torques.items():
        world = World.record(noisy.body, noisy.seed, noisy.steps, duration, dynamics=True, noise=torque)
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
        seen = bk.simulate(world.body, bk.motions.Circle(radius, distance), world.seed, **settings)
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
READINGS: dict[str, Callable[[World], dict[str, Scores]]] = {
    "hidden": _networks(
        {
            "one layer of 10 units": AS_IS,
            "ten layers of 10 units": replace(AS_IS, depth=10),
            "two layers of 10 units": replace(AS_IS, depth=2),
            "one layer of 3 units": replace(AS_IS, hidden=3),
            "one layer of 30 units": replace(AS_IS, hidden=30),
            "logistic units": replace(AS_IS, unit="logistic"),
        }
    ),
    "learning_rate": _networks(
        {
            "divided by the spread, mean over samples": AS_IS,
            "brought to [-1, 1], mean over samples": replace(AS_IS, scaling="range"),
            "radians and metres, mean over samples": replace(AS_IS, scaling="none"),
            "radians and metres, sum over samples": replace(AS_IS, scaling="none", update="sum"),
            "divided by the spread, after each sample": PaperMLP(steps=0, online=True),
            "divided by the spread, a step is one sample": replace(AS_IS, update="sample"),
        }
    ),
    "kernel": _maps(
        {
            "exp(-d^2/40), d in taxels": {},
            "exp(-d^2/40), d in mm (3 mm a taxel)": {"gamma": 40.0 / 9.0},
            "exp(-d/40), d in taxels": {"kernel": "plain"},
            "exp(-d/40), d in mm": {"kernel": "plain", "gamma": 40.0 / 3.0},
            "exp(-d^2/gamma), gamma 40 to 1": {"gamma_final": 1.0},
        }
    ),
    "posture_kernel": _maps({"5.8, the same share of the grid": {}, "40, as for taxels": {"gamma_posture": 40.0}}),
    "alpha": _maps(
        {
            "0.3 to 0.02, geometric": {},
            "0.1, constant": {"alpha": "constant"},
            "1 / visits of the winner": {"alpha": "per_visit"},
        }
    ),
    "posture": posture,
    "jacobian": jacobian_of_f,
    "reset_to": reset_to,
    "secant": displacement_of_posture,
    "silence": silence,
}
"""Those that need no recording but the world's."""
