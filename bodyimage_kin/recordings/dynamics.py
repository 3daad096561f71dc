"""Course with dynamics: an external force drags the hand along a path, the arm follows passively (section 4.1).

The force on the hand is ``k (x* - x) + d (v* - v)`` in all components, on request with a random torque on the hand
beside it. Weak springs pull the joints towards a rest posture; the skin is solid and the hand slides on it. MuJoCo
simulates several motions at once, in threads; a motion's bits depend neither on the threads nor on the other motions.
"""

from __future__ import annotations

import contextlib
import copy
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
import torch
from jaxtyping import Float
from mujoco import rollout

from bodyimage_kin.body import reach
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import InvalidConfig, Unreachable
from bodyimage_kin.recordings import mujoco_model
from bodyimage_kin.recordings.settings import Drag, Noise
from bodyimage_kin.robot.nearest import nearest_on_shapes

__all__ = ["Course", "drag", "start_posture", "whole_steps"]

_CHUNK = 10.0
"""Simulated time between two returns from MuJoCo's threads [s]: bounds the memory for controls and states."""
_STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS.value


@dataclass(frozen=True, eq=False)
class Course:
    """One way of the hand to simulate.

    Attributes:
        centres: (steps, 3) where the hand's centre is led, one each step, in the axes of ``front_link`` [m].
        rest: (p,) rest posture; the arm starts displaced least from it, at rest, the hand on its path.
        noise: Draws the random torques.
        press: Whether the path lies on the skin and the hand is to be pressed on.
    """

    centres: Float[np.ndarray, "steps 3"]
    rest: Float[np.ndarray, "p"]
    noise: np.random.Generator
    press: bool = False


def whole_steps(duration: float, step: float, name: str) -> int:
    """How many steps a duration has.

    Raises:
        InvalidConfig: Not a whole number of at least one; names the field.
    """
    count = round(duration / step)
    if count < 1 or abs(count * step - duration) > 1e-9 * duration:
        raise InvalidConfig(f"{name}={duration!r}: give a whole number of simulation steps of {step:g} s")
    return count


def drag(
    body: Embodiment,
    courses: Sequence[Course],
    settings: Drag,
    noise: Noise,
    *,
    sampling: float,
    threads: int | None = None,
) -> list[Float[np.ndarray, "samples p"]]:
    """Simulates courses, each on its own, all at once.

    Args:
        body: The embodiment.
        courses: What to simulate; their lengths may differ.
        settings: How the hand is dragged.
        noise: Its torque disturbs the hand.
        sampling: Time between samples, a whole number of steps [s].
        threads: At most this many; None: as many as there are processors. The bits do not depend on it.

    Returns:
        Joint values at the samples, one array a course: its first row is the start, one row every ``sampling`` while
        the course lasts [rad].

    Raises:
        InvalidConfig: A sampling time that is no whole number of steps, or a simulation that diverges.
        InvalidURDF: A robot that cannot be simulated (no masses).
        Unreachable: The hand cannot reach a path's first point within the joint limits.
    """
    every = whole_steps(sampling, settings.step, "sampling")
    # What is not drawn is not held either.
    hold = whole_steps(noise.torque_hold, settings.step, "noise: torque_hold") if noise.torque else 1
    if not courses:
        return []
    model = mujoco_model.build(
        body,
        step=settings.step,
        stiffness=settings.stiffness,
        damping=settings.damping,
        joint_damping=settings.joint_damping,
        rest_stiffness=settings.rest_stiffness,
        friction=settings.friction,
    )
    models = [_at_rest(model, course.rest) for course in courses]
    state = np.stack([_state(model, start_posture(body, course)) for course in courses])
    lengths = [len(course.centres) for course in courses]
    steps = max(lengths) - 1
    controls = [_Controls(body, course, settings, steps, noise.torque, hold) for course in courses]
    workers = min(len(courses), threads or os.cpu_count() or 1)
    data = [mujoco.MjData(model) for _ in range(workers)]
    # A chunk ends with a sample and with a random torque's hold.
    unit = math.lcm(every, hold)
    chunk = unit * max(1, round(_CHUNK / settings.step / unit))
    # The state begins with the time.
    columns = 1 + mujoco_model.joint_columns(model)
    sampled = [state[:, None, columns]]
    with _warnings_kept_quiet(), rollout.Rollout(nthread=workers if workers > 1 else 0) as pool:
        for begin in range(0, steps, chunk):
            here = slice(begin, min(begin + chunk, steps))
            states, _ = pool.rollout(models, data, state, np.stack([one.take(here) for one in controls]), chunk_size=1)
            state = states[:, -1]
            # MuJoCo repeats the last state where a simulation fails, and time stands still.
            if not (np.isfinite(states).all() and np.allclose(state[:, 0], here.stop * settings.step)):
                raise InvalidConfig(f"the dynamics diverge with drag: step={settings.step:g}; give a smaller step")
            sampled.append(states[:, every - 1 :: every, columns])
    q = np.concatenate(sampled, axis=1)
    return [rows[: 1 + (length - 1) // every] for rows, length in zip(q, lengths, strict=True)]


@contextlib.contextmanager
def _warnings_kept_quiet() -> Iterator[None]:
    """Keeps MuJoCo's warnings from being printed and written to a file where the user works; time tells of failure."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


def start_posture(body: Embodiment, course: Course) -> Float[np.ndarray, "p"]:
    """The posture displaced least from rest in which the hand is at the path's first point.

    Raises:
        Unreachable: There is none within the joint limits.
    """
    lower, upper = body.felt_robot.lower, body.felt_robot.upper
    target = torch.from_numpy(course.centres[:1])
    q, reached = reach.least_displacement(
        body.hand_in_front_and_jacobian, target, torch.from_numpy(course.rest), lower, upper
    )
    if not bool(reached.all()):
        raise Unreachable("the hand cannot reach the path's first point within the joint limits")
    return np.asarray(q[0].numpy())


class _Controls:
    """The controls of one course: targets shifted so that the damper acts on the velocity relative to the target's."""

    def __init__(self, body: Embodiment, course: Course, settings: Drag, steps: int, torque: float, hold: int) -> None:
        targets = course.centres
        if course.press:
            _, normals, _ = nearest_on_shapes(body.require_skin().touched_surface, targets)
            targets = targets - settings.press * normals
        velocity = np.gradient(targets, settings.step, axis=0) if len(targets) > 1 else np.zeros_like(targets)
        # MuJoCo's force is k (control - x) - d v.
        targets = targets + settings.damping / settings.stiffness * velocity
        # A course shorter than the longest goes on at its end, unseen.
        self.targets = np.concatenate([targets, np.repeat(targets[-1:], max(0, steps - len(targets)), axis=0)])
        self.noise, self.torque, self.hold = course.noise, torque, hold

    def take(self, steps: slice) -> Float[np.ndarray, "steps 6"]:
        """The controls of the next steps; each is taken once, in order."""
        targets = self.targets[steps]
        torques = np.zeros_like(targets)
        if self.torque:
            drawn = self.noise.standard_normal((math.ceil(len(targets) / self.hold), 3))
            torques = self.torque * np.repeat(drawn, self.hold, axis=0)[: len(targets)]
        return np.concatenate([targets, torques], axis=1)


def _at_rest(model: mujoco.MjModel, rest: Float[np.ndarray, "p"]) -> mujoco.MjModel:
    """The model whose springs are relaxed at a posture."""
    model = copy.copy(model)
    model.qpos_spring[mujoco_model.joint_columns(model)] = rest
    return model


def _state(model: mujoco.MjModel, q: Float[np.ndarray, "p"]) -> Float[np.ndarray, "state"]:
    """MuJoCo's state of a posture at rest, at time zero."""
    data = mujoco.MjData(model)
    data.qpos[mujoco_model.joint_columns(model)] = q
    state = np.empty(mujoco.mj_stateSize(model, _STATE))
    mujoco.mj_getState(model, data, state, _STATE)
    return state
