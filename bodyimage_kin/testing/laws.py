"""The laws of kinematics, one function each: what holds of every robot, posture and link, whatever the library.

A law is called with what builds a library and with a case. It gives the error that it found, relative to the case's
scale (None where the case has nothing to ask: a robot without followers), and raises :class:`LawBroken` when that is
above the law's bound::

    laws.pose_equals_oracle(MyLibrary, case)
    laws.pose_equals_oracle.within(1e-5)(MyLibraryInFloat32, case)

Errors are relative to ``max(1, |q|, reach)`` (:attr:`Case.scale`), times the multipliers of followers for every
derivative (:attr:`Case.gain`): a robot of ten metres at an angle of a million may be wrong by more than a finger.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import torch

from bodyimage_kin.testing._law import DIFFERENCES, EXACT32, Question, differences, law
from bodyimage_kin.testing._library import Wrapped
from bodyimage_kin.testing._spec import JointSpec, rename
from bodyimage_kin.testing._threads import others_in_between
from bodyimage_kin.testing.oracle import oracle

__all__ = [
    "batch_equals_loop",
    "dtype_is_kept",
    "empty_batch",
    "full_turns_change_nothing",
    "gradcheck",
    "gradgradcheck",
    "hessian_equals_differences",
    "hessian_symmetry",
    "invariant_under_axis_scaling",
    "invariant_under_explicit_defaults",
    "invariant_under_renaming",
    "invariant_under_reordering",
    "jacobian_equals_differences",
    "jacobian_equals_oracle",
    "mimic_is_multiplier_times_column",
    "off_path_columns_are_zero",
    "pose_equals_oracle",
    "references_convert",
    "threads_equal_one",
]

_THREADS, _LINKS, _TURNS = 4, 2, 20
"""Threads that call at once, links that they ask for, and postures of each at each link."""

# Against the oracle ---------------------------------------------------------------------------------------------------


@law()
def pose_equals_oracle(question: Question) -> dict[str, float]:
    """The pose is the oracle's."""
    pose, _ = question.library.pose_and_jacobian(question.q, question.link)
    return {"pose against the oracle's": question.error("pose", pose, oracle(question.case).pose)}


@law("jacobian")
def jacobian_equals_oracle(question: Question) -> dict[str, float]:
    """The Jacobian is the oracle's."""
    _, jacobian = question.library.pose_and_jacobian(question.q, question.link)
    return {"Jacobian against the oracle's": question.error("jacobian", jacobian, oracle(question.case).jacobian)}


# The Jacobian within itself ------------------------------------------------------------------------------------------


@law("jacobian", bound=DIFFERENCES)
def jacobian_equals_differences(question: Question) -> dict[str, float]:
    """The Jacobian is the difference of poses."""
    if not question.case.robot.n:
        return {}
    pose, jacobian = question.library.pose_and_jacobian(question.q, question.link)
    derivative = differences(lambda q: question.evaluated(q)[0], question.q, question.steps())
    # dR R^T is skew: its three numbers are the angular velocity.
    spin = derivative[:, :3, :3] @ pose[:3, :3].T
    turn = np.stack([spin[:, 2, 1] - spin[:, 1, 2], spin[:, 0, 2] - spin[:, 2, 0], spin[:, 1, 0] - spin[:, 0, 1]])
    expected = np.concatenate([derivative[:, :3, 3].T, turn / 2.0])
    return {"Jacobian against differences of poses": question.error("jacobian", jacobian, expected)}


@law("jacobian")
def off_path_columns_are_zero(question: Question) -> dict[str, float]:
    """Columns of joints off the path are zero."""
    _, jacobian = question.library.pose_and_jacobian(question.q, question.link)
    on_path = {k for _, k, _, _ in question.case.robot.folded(question.link)}
    off = [column for column in range(question.case.robot.n) if column not in on_path]
    if not off:
        return {}
    return {"columns off the path": question.error("jacobian", jacobian[:, off], np.zeros((6, len(off))))}


@law()
def mimic_is_multiplier_times_column(question: Question) -> dict[str, float]:
    """A follower adds its multiplier times its own column to that of the joint it follows."""
    robot = question.case.robot
    if all(joint.mimic is None for joint in robot.joints):
        return {}
    free = robot.freed()
    fold, offset = np.zeros((free.n, robot.n)), np.zeros(free.n)
    for row, name in enumerate(free.joint_names):
        source, multiplier, constant = robot.follows(name)
        fold[row, robot.joint_names.index(source)], offset[row] = multiplier, constant
    pose, jacobian = Wrapped(question.build, free).pose_and_jacobian(fold @ question.q + offset, question.link)
    found = question.library.pose_and_jacobian(question.q, question.link)
    return question.both(found, (pose, jacobian @ fold), "against the robot whose followers are free")


@law("jacobian", "references")
def references_convert(question: Question) -> dict[str, float]:
    """References convert into each other."""
    q, link = question.q, question.link
    pose, jacobian = question.library.pose_and_jacobian(q, link)
    rotation, (x, y, z) = pose[:3, :3], pose[:3, 3]
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    expected = {
        "local_world_aligned": jacobian,
        "local": np.concatenate([rotation.T @ jacobian[:3], rotation.T @ jacobian[3:]]),
        "world": np.concatenate([jacobian[:3] + across @ jacobian[3:], jacobian[3:]]),
    }
    # The position enters twice.
    return {
        f"Jacobian in {reference!r}": question.error(
            "jacobian", question.library.jacobian(q, link, reference), values, question.case.scale
        )
        for reference, values in expected.items()
    }


# What must not change anything ----------------------------------------------------------------------------------------


@law()
def invariant_under_renaming(question: Question) -> dict[str, float]:
    """Names mean nothing."""
    robot = question.case.robot
    # Reversed, so that an alphabetical order is another one.
    links = {link: f"l{index:03d}" for index, link in enumerate(reversed(robot.links))}
    joints = {joint.name: f"j{index:03d}" for index, joint in enumerate(reversed(robot.joints))}
    other = Wrapped(question.build, rename(robot, links, joints))
    expected = question.library.pose_and_jacobian(question.q, question.link)
    return question.both(other.pose_and_jacobian(question.q, links[question.link]), expected, "under other names")


@law()
def invariant_under_reordering(question: Question) -> dict[str, float]:
    """The file's order means nothing but the order of the posture."""
    robot = question.case.robot
    turned = replace(robot, joints=robot.joints[::-1], links=robot.links[::-1], text=None)
    found = Wrapped(question.build, turned).pose_and_jacobian(question.q[::-1].copy(), question.link)
    pose, jacobian = question.library.pose_and_jacobian(question.q, question.link)
    return question.both(found, (pose, jacobian[:, ::-1]), "with the file turned round")


@law()
def invariant_under_axis_scaling(question: Question) -> dict[str, float]:
    """The length of an axis means nothing."""
    robot = question.case.robot
    if all(joint.kind == "fixed" for joint in robot.joints):
        return {}
    factors = (3.0, 0.01, 700.0)
    joints = tuple(_longer(joint, factors[index % 3]) for index, joint in enumerate(robot.joints))
    other = Wrapped(question.build, replace(robot, joints=joints, text=None))
    expected = question.library.pose_and_jacobian(question.q, question.link)
    return question.both(other.pose_and_jacobian(question.q, question.link), expected, "with longer axes")


@law()
def invariant_under_explicit_defaults(question: Question) -> dict[str, float]:
    """A default written out means what it means left out."""
    found = Wrapped(question.build, question.case.robot.explicit()).pose_and_jacobian(question.q, question.link)
    expected = question.library.pose_and_jacobian(question.q, question.link)
    return question.both(found, expected, "with every default written out")


@law()
def full_turns_change_nothing(question: Question) -> dict[str, float]:
    """A full turn of a joint that nothing scales changes nothing."""
    robot = question.case.robot
    expected = question.library.pose_and_jacobian(question.q, question.link)
    errors: dict[str, float] = {}
    for k, joint in enumerate(robot.free_joints):
        driven = [(other, multiplier) for other, i, multiplier, _ in robot.folded(question.link) if i == k]
        if all(other.kind != "prismatic" and multiplier == round(multiplier) for other, multiplier in driven):
            turned = question.q.copy()
            turned[k] += 2.0 * math.pi
            found = question.library.pose_and_jacobian(turned, question.link)
            # 2 pi itself is rounded.
            errors |= question.both(found, expected, f"after a full turn of joint {joint.name!r}")
    return errors


# Arrays ---------------------------------------------------------------------------------------------------------------


@law("batch")
def batch_equals_loop(question: Question) -> dict[str, float]:
    """A batch is a loop."""
    n = question.case.robot.n
    postures = np.stack([question.q, np.zeros(n), -question.q, question.q + 0.5, 0.5 * question.q, np.ones(n)])
    loop = question.evaluated(postures)
    errors: dict[str, float] = {}
    for batch in ((6,), (2, 3), (3, 1, 2), (1, 6)):
        found = question.library.pose_and_jacobian(postures.reshape(*batch, n), question.link)
        expected = loop[0].reshape(*batch, 4, 4), loop[1].reshape(*batch, question.library.rows, n)
        errors |= question.both(found, expected, f"of a batch {batch}")
    return errors


@law("batch")
def empty_batch(question: Question) -> dict[str, float]:
    """An empty batch gives empty results."""
    n, rows = question.case.robot.n, question.library.rows
    errors: dict[str, float] = {}
    for batch in ((0,), (2, 0)):
        found = question.library.pose_and_jacobian(np.empty((*batch, n)), question.link)
        expected = np.empty((*batch, 4, 4)), np.empty((*batch, rows, n))
        errors |= question.both(found, expected, f"of a batch {batch}")
    return errors


@law("float32", bound=EXACT32)
def dtype_is_kept(question: Question) -> dict[str, float]:
    """Float32 in, float32 out, and as near as it can be."""
    single = question.q.astype(np.float32)
    found = question.library.pose_and_jacobian(single, question.link)
    dtypes = [values.dtype for values in found]
    expected = question.library.pose_and_jacobian(single.astype(np.float64), question.link)
    dtypes_wanted = [np.dtype(np.float32)] * 2
    kept = dtypes == dtypes_wanted and all(values.dtype == np.float64 for values in expected)
    return {f"dtype ({dtypes[0]}, {dtypes[1]})": 0.0 if kept else math.inf} | question.both(
        found, expected, "in float32"
    )


@law("threads")
def threads_equal_one(question: Question) -> dict[str, float]:
    """Called from several threads at once, on other postures and links, it says what it says in one."""
    robot = question.case.robot
    if not robot.n:
        return {}
    others = sorted((link for link in robot.links if link != question.link), key=lambda link: -len(robot.path(link)))
    links = [question.link, *others[: _LINKS - 1]]
    lengths = np.linspace(-1.0, 1.0, _TURNS)[:, None]
    postures = [question.q * lengths + 0.3 * thread * lengths[::-1] for thread in range(_THREADS)]
    begin = threading.Barrier(_THREADS)

    def asked(question: Question, thread: int) -> list[tuple[np.ndarray, np.ndarray]]:
        """Of one link by all threads at once, twice, then of the next."""
        batch = "batch" in question.library.offers
        ask = question.library.pose_and_jacobian if batch else question.evaluated
        return [ask(postures[thread], link) for link in links for _ in range(2)]

    def work(thread: int) -> list[tuple[np.ndarray, np.ndarray]]:
        begin.wait()
        with others_in_between():
            return asked(question, thread)

    alone = Question(question.build, question.case)
    expected = [asked(alone, thread) for thread in range(_THREADS)]
    # Nothing was asked of this one yet: what it builds when first asked is built by all threads at once.
    with ThreadPoolExecutor(_THREADS) as pool:
        found = list(pool.map(work, range(_THREADS)))
    errors = {"pose": 0.0, "Jacobian": 0.0}
    for values, wanted in zip(found, expected, strict=True):
        for value, alike in zip(values, wanted, strict=True):
            for what, error in question.both(value, alike, "").items():
                errors[what.strip()] = max(errors[what.strip()], error)
    return {f"{what} of {_THREADS} threads against one": error for what, error in errors.items()}


# Derivatives ----------------------------------------------------------------------------------------------------------


@law("jacobian", "gradient", bound=DIFFERENCES)
def gradcheck(question: Question) -> dict[str, float]:
    """Gradients are differences."""

    def values(q: torch.Tensor) -> torch.Tensor:
        return _flat(question.library.tensors(q, question.link))

    return _gradient_error("gradient against differences", question, values, "hessian")


@law("jacobian", "gradient", bound=DIFFERENCES)
def gradgradcheck(question: Question) -> dict[str, float]:
    """Gradients of gradients are differences of gradients."""

    def gradient(q: torch.Tensor) -> torch.Tensor:
        if not q.requires_grad:
            q = q.clone().requires_grad_()
        values = _flat(question.library.tensors(q, question.link))
        # One number of them all, in which no two terms can cancel: incommensurate weights.
        weights = torch.cos(torch.arange(len(values), dtype=values.dtype) ** 1.5)
        given = torch.autograd.grad(values @ weights, q, create_graph=True, allow_unused=True)[0]
        return torch.zeros_like(q) if given is None else given

    return _gradient_error("second gradient against differences", question, gradient, "third")


@law("jacobian", "hessian", bound=DIFFERENCES)
def hessian_equals_differences(question: Question) -> dict[str, float]:
    """The hessian is the difference of Jacobians."""
    if not question.case.robot.n:
        return {}
    hessian = question.library.hessian(question.q, question.link)
    derivative = differences(lambda q: question.evaluated(q)[1], question.q, question.steps())
    expected = np.moveaxis(derivative, 0, -1)
    return {"hessian against differences of Jacobians": question.error("hessian", hessian, expected)}


@law("jacobian", "hessian")
def hessian_symmetry(question: Question) -> dict[str, float]:
    """Position rows of the hessian are symmetric, angular rows differ by the cross product of columns."""
    hessian = question.library.hessian(question.q, question.link)
    _, jacobian = question.library.pose_and_jacobian(question.q, question.link)
    angular = jacobian[3:]
    # d2R / dq_i dq_k is symmetric: H_ang[:, i, k] - H_ang[:, k, i] = J_wk x J_wi.
    cross = np.cross(angular[:, None, :], angular[:, :, None], axis=0)
    swapped = hessian.swapaxes(-1, -2)
    return {
        "position rows of the hessian against their transpose": question.error("hessian", hessian[:3], swapped[:3]),
        "angular rows of the hessian against their transpose": question.error(
            "hessian", hessian[3:] - swapped[3:], cross
        ),
    }


def _flat(values: tuple[torch.Tensor, torch.Tensor]) -> torch.Tensor:
    return torch.cat([value.reshape(-1) for value in values])


def _gradient_error(
    what: str, question: Question, function: Callable[[torch.Tensor], torch.Tensor], order: str
) -> dict[str, float]:
    """The largest difference between a gradient by torch and by differences, relative to scale."""
    if not question.case.robot.n:
        return {}
    q = torch.from_numpy(question.q)
    found = torch.autograd.functional.jacobian(function, q).detach().numpy()  # type: ignore[no-untyped-call]

    def values(postures: np.ndarray) -> np.ndarray:
        return np.stack([function(posture).detach().numpy() for posture in torch.from_numpy(postures)])

    expected = differences(values, question.q, question.steps()).T
    times = 1.0 if order == "hessian" else question.case.gain * len(found)
    return {what: question.error("hessian", found, expected, times)}


def _longer(joint: JointSpec, factor: float) -> JointSpec:
    if joint.kind == "fixed":
        return joint
    x, y, z = joint.axis or (1.0, 0.0, 0.0)
    return replace(joint, axis=(factor * x, factor * y, factor * z))
