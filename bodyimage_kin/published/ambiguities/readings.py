"""What the paper leaves open, and every reading of it: which row learns on which recording."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from bodyimage_kin.estimators import LeastSquares, PaperMLP
from bodyimage_kin.published.ambiguities.jacobians import AtZero, FaceMean, Secant, Unbiased
from bodyimage_kin.published.ambiguities.networks import Network
from bodyimage_kin.published.ambiguities.scores import FELT_STEPS
from bodyimage_kin.study import Row

__all__ = ["AMBIGUITIES", "INFANT", "ROWS", "STEPS", "STREAM", "Ambiguity", "Place", "Reading"]

INFANT = "infant"
STEPS: Mapping[str, int] = {"kinematic": 200, "noise": 500}
"""Motion -> descent steps of the network, as the paper has them without and with noise."""
STREAM = "ambiguities"
"""All readings are paired by seed: what they do not differ in is the same, first weights too."""

RowOf = Callable[[int], Row]
"""From descent steps to a row."""


def _network(**fields: Any) -> RowOf:
    """The network with other settings."""
    return lambda steps: Row(Network(steps=steps, **fields), stream=STREAM)


def _used(**settings: Any) -> RowOf:
    """The library's network, used in another way."""
    return lambda steps: Row(PaperMLP(steps=steps), stream=STREAM, **settings)


ROWS: Mapping[str, Row | RowOf] = {
    "network": _used(),
    "ten_layers": _network(depth=10),
    "two_layers": _network(depth=2),
    "three_units": _network(hidden=3),
    "thirty_units": _network(hidden=30),
    "logistic_units": _network(unit="logistic"),
    "scaled_to_range": _network(scaling="range"),
    "unscaled": _network(scaling="none"),
    "unscaled_sum": _network(scaling="none", update="sum"),
    "after_each_sample": lambda steps: Row(PaperMLP(steps=steps, online=True), stream=STREAM),
    "a_sample_a_step": _network(update="sample"),
    "with_posture": _network(posture=True),
    "with_posture_longer": lambda steps: Row(Network(steps=20 * steps, posture=True), stream=STREAM),
    "least_squares": Row(LeastSquares()),
    "mean_on_the_face": Row(FaceMean()),
    "unbiased": lambda steps: Row(Unbiased(PaperMLP(steps=steps)), stream=STREAM),
    "at_zero": lambda steps: Row(AtZero(PaperMLP(steps=steps)), stream=STREAM),
    "secant": lambda steps: Row(
        Secant(PaperMLP(steps=steps)), told={"motion": f"{__package__}.scores:{FELT_STEPS.name.upper()}"}, stream=STREAM
    ),
    "reset_by_posture": _used(reset="posture_map"),
    "reset_to_truth": _used(reset="true"),
    "no_reset": _used(reset="none"),
    "one_displacement": _used(reset="secant"),
    "analytic": Row("Analytic"),
    "analytic_one_displacement": Row("Analytic", reset="secant"),
    "kernel_mm": _used(maps={"gamma": 40.0 / 9.0}),
    "kernel_plain": _used(maps={"kernel": "plain"}),
    "kernel_plain_mm": _used(maps={"kernel": "plain", "gamma": 40.0 / 3.0}),
    "kernel_annealed": _used(maps={"gamma_final": 1.0}),
    "kernel_posture_40": _used(maps={"gamma_posture": 40.0}),
    "alpha_constant": _used(maps={"alpha": "constant"}),
    "alpha_per_visit": _used(maps={"alpha": "per_visit"}),
    "silent_touches": _used(maps={"silence": 0.2}),
    "silent_taxels": _used(maps={"silence": 0.2, "silence_mode": "taxel"}),
}
"""Key -> row; those that train a network are functions of its steps."""


@dataclass(frozen=True)
class Place:
    """Where a reading stands in the study.

    Attributes:
        embodiment: Its name.
        recording: Likewise.
        key: Of ``ROWS``.
        steps: Of the network.
    """

    embodiment: str
    recording: str
    key: str
    steps: int

    @property
    def name(self) -> str:
        """Of the row, in results."""
        return self.key if isinstance(ROWS[self.key], Row) else f"{self.key}_{self.steps}"

    @property
    def row(self) -> Row:
        """What learns there."""
        found = ROWS[self.key]
        return found if isinstance(found, Row) else found(self.steps)


@dataclass(frozen=True)
class Reading:
    """One way to read the paper.

    Attributes:
        name: As tables call it.
        key: Of ``ROWS``.
        change: How the recordings differ from those of the motion; empty: not at all.
        steps: Of the network; None: those of the motion.
        embodiment: Its name in the study.
    """

    name: str
    key: str = "network"
    change: str = ""
    steps: int | None = None
    embodiment: str = INFANT

    def place(self, motion: str) -> Place:
        """Where it stands for a motion."""
        recording = f"{motion}_{self.change}" if self.change else motion
        return Place(self.embodiment, recording, self.key, self.steps or STEPS[motion])


@dataclass(frozen=True)
class Ambiguity:
    """What the paper leaves open.

    Attributes:
        measures: What its table shows, in this order.
        readings: The first is the library's.
        motions: Of ``STEPS``.
    """

    measures: tuple[str, ...]
    readings: tuple[Reading, ...]
    motions: tuple[str, ...] = tuple(STEPS)


_OF_JACOBIANS = ("displacement", "tour", "topological")
_OF_MAPS = ("span", "disparity", "topological")
_OF_PATHS = ("touch", "span", "topological")
AMBIGUITIES: Mapping[str, Ambiguity] = {
    "hidden": Ambiguity(
        _OF_JACOBIANS,
        (
            Reading("one layer of 10 units"),
            Reading("ten layers of 10 units", "ten_layers"),
            Reading("two layers of 10 units", "two_layers"),
            Reading("one layer of 3 units", "three_units"),
            Reading("one layer of 30 units", "thirty_units"),
            Reading("logistic units", "logistic_units"),
        ),
    ),
    "learning_rate": Ambiguity(
        _OF_JACOBIANS,
        (
            Reading("divided by the spread, mean over samples"),
            Reading("brought to [-1, 1], mean over samples", "scaled_to_range"),
            Reading("radians and metres, mean over samples", "unscaled"),
            Reading("radians and metres, sum over samples", "unscaled_sum"),
            Reading("divided by the spread, after each sample", "after_each_sample"),
            Reading("divided by the spread, a step is one sample", "a_sample_a_step"),
        ),
    ),
    "kernel": Ambiguity(
        _OF_MAPS,
        (
            Reading("exp(-d^2/40), d in taxels"),
            Reading("exp(-d^2/40), d in mm (3 mm a taxel)", "kernel_mm"),
            Reading("exp(-d/40), d in taxels", "kernel_plain"),
            Reading("exp(-d/40), d in mm", "kernel_plain_mm"),
            Reading("exp(-d^2/gamma), gamma 40 to 1", "kernel_annealed"),
        ),
    ),
    "posture_kernel": Ambiguity(
        ("posture_span",),
        (Reading("5.8, the same share of the grid"), Reading("40, as for taxels", "kernel_posture_40")),
    ),
    "alpha": Ambiguity(
        _OF_MAPS,
        (
            Reading("0.3 to 0.02, geometric"),
            Reading("0.1, constant", "alpha_constant"),
            Reading("1 / visits of the winner", "alpha_per_visit"),
        ),
    ),
    "posture": Ambiguity(
        ("displacement", "face", "topological"),
        (
            Reading("f(dq), the paper's network"),
            Reading("f(q, dq), the same network", "with_posture"),
            Reading("f(q, dq), 20 times the steps", "with_posture_longer"),
            Reading("constant, least squares", "least_squares"),
            Reading("constant, mean of the true ones on the face", "mean_on_the_face"),
        ),
    ),
    "jacobian": Ambiguity(
        ("displacement", "tour", "touch"),
        (
            Reading("f(dq) itself"),
            Reading("f(dq) - f(0)", "unbiased"),
            Reading("its derivative at zero", "at_zero"),
            Reading("its secant over the touching motion", "secant"),
        ),
    ),
    "reset_to": Ambiguity(
        _OF_PATHS,
        (
            Reading("the known image of the reference taxel"),
            Reading("F(theta), extrapolated from the circle", "reset_by_posture"),
            Reading("the true image (a diagnostic)", "reset_to_truth"),
            Reading("never reset", "no_reset"),
        ),
    ),
    "secant": Ambiguity(
        _OF_PATHS,
        (
            Reading("steps summed"),
            Reading("one displacement from the reset", "one_displacement"),
            Reading("steps summed, true Jacobian", "analytic"),
            Reading("one displacement, true Jacobian", "analytic_one_displacement"),
        ),
    ),
    "silence": Ambiguity(
        _OF_MAPS,
        (
            Reading("a whole touch, 20%", "silent_touches", "without_silence"),
            Reading("each taxel by itself, 20%", "silent_taxels", "without_silence"),
            Reading("none", change="without_silence"),
        ),
    ),
    "circle": Ambiguity(
        ("displacement", "tour", "span"),
        (
            Reading("radius 5 cm, 3 cm in front"),
            Reading("radius 5 cm, 1.5 cm in front", change="1.5_cm_in_front"),
            Reading("radius 5 cm, 6 cm in front", change="6_cm_in_front"),
            Reading("radius 5 cm, 10 cm in front", change="10_cm_in_front"),
            Reading("radius 3 cm, 3 cm in front", change="radius_3_cm"),
        ),
    ),
    "reset_when": Ambiguity(
        _OF_PATHS,
        (
            Reading("every 10 s"),
            Reading("every 5 s", change="reset_every_5_s"),
            Reading("every 30 s", change="reset_every_30_s"),
            Reading("only at the start", change="reset_at_the_start"),
        ),
        motions=("noise",),
    ),
    "noise": Ambiguity(
        ("excitation", "displacement", "tour", "topological"),
        (
            Reading("torque on the hand, variance 0.01, held 2 ms"),
            Reading("torque, standard deviation 0.01", change="of_torque_0.01"),
            Reading("torque, held 20 ms", change="held_20_ms"),
            Reading("torque, held 100 ms", change="held_100_ms"),
            Reading("joint angles, 0.1 rad (variance 0.01)", change="of_joints_0.1_rad"),
            Reading("joint angles, 0.01 rad", change="of_joints_0.01_rad"),
            Reading("joint angles, 0.001 rad", change="of_joints_0.001_rad"),
            Reading("none", change="free"),
        ),
        motions=("noise",),
    ),
    "captions": Ambiguity(
        _OF_JACOBIANS,
        tuple(
            Reading(f"{name} noise, {steps} steps", change=change, steps=steps)
            for name, change in (("without", "free"), ("with", ""))
            for steps in (200, 500)
        ),
        motions=("noise",),
    ),
    "dimensions": Ambiguity(
        ("displacement", "tour", "span"),
        (
            Reading("the infant's arm"),
            Reading("upper arm and forearm 10% shorter", embodiment="shorter_arm"),
            Reading("upper arm and forearm 15% longer", embodiment="longer_arm"),
        ),
        motions=("kinematic",),
    ),
}
"""Name -> ambiguity, in the order of the tables."""
