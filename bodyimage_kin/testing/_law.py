"""What a law is: how it is asked of a library, and how its error is judged."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from bodyimage_kin.testing._library import Build, NotOffered, Wrapped
from bodyimage_kin.testing._spec import Case

EXACT: Final = 200 * float(np.finfo(np.float64).eps)
"""Bound of what rounding alone explains, 4.4e-14."""
EXACT32: Final = 200 * float(np.finfo(np.float32).eps)
"""The same in float32."""
DIFFERENCES: Final = 1e-9
"""Bound of what is compared with differences of five points: their error is near eps^(4/5), with room for curvature."""
STEP: Final = 1e-3
"""Distance of the points of a difference [rad or m], before multipliers."""
_CURVATURE: Final = 10.0
"""Room for curvature in differences of values that are wrong by a tolerance."""


class LawBroken(AssertionError):
    """A library breaks a law.

    Attributes:
        law: The law's name.
        case: The robot, posture and link.
        error: Relative to the case's scale; inf when the library gave something of another shape, or NaN.
        detail: What differs.
    """

    def __init__(self, law: str, case: Case, error: float, bound: float, detail: str) -> None:
        self.law, self.case, self.error, self.detail = law, case, error, detail
        super().__init__(
            f"{law}: {detail}; relative error {error:.2e}, allowed {bound:.1e}\n"
            f"link {case.link!r}, posture {dict(zip(case.robot.joint_names, case.q, strict=True))}\n"
            f"{case.robot.to_urdf() if case.robot.text is None else case.robot.name}"
        )


@dataclass(frozen=True)
class Law:
    """One law, called as ``law(build, case)``.

    Attributes:
        name: What it says, in one word.
        about: What it says, in one line.
        needs: What a library must offer for the law to be asked of it.
        bound: The largest relative error that keeps the law.
        check: Gives errors relative to scale, by what they are an error of; nothing of a case that has nothing to ask.
        step: Distance of the points of a difference [rad or m], before multipliers.
    """

    name: str
    about: str
    needs: frozenset[str]
    bound: float
    check: Callable[[Question], dict[str, float]]
    step: float = STEP

    @property
    def __name__(self) -> str:
        return self.name

    def within(self, tolerance: float) -> Law:
        """The same law for a library whose values are not exact: float32 inside, or Jacobians by differences.

        Differences are then taken of points farther apart, ``tolerance^(1/5)``, and may be wrong by
        ``10 tolerance^(4/5)``: what is gained by distance is lost to noise, and the other way round.

        Args:
            tolerance: The largest relative error of a pose, a Jacobian or a hessian; a law's own bound where that is
                larger.
        """
        if self.bound != DIFFERENCES:
            return replace(self, bound=max(self.bound, tolerance))
        return replace(self, bound=max(self.bound, _CURVATURE * tolerance**0.8), step=max(self.step, tolerance**0.2))

    def __call__(self, build: Build, case: Case) -> float | None:
        """The largest error found, relative to scale; None where the case has nothing to ask.

        Args:
            build: Makes the library from a URDF text (see :class:`Library`).
            case: What to check it on.

        Raises:
            LawBroken: The error is above the bound.
            NotOffered: The library does not offer what the law is about.
        """
        question = Question(build, case, self.step)
        missing = sorted(self.needs - question.library.offers)
        if missing:
            raise NotOffered(f"{self.name}: the library does not offer {' and '.join(missing)}")
        found = self.check(question)
        if not found:
            return None
        detail, error = max(found.items(), key=lambda item: item[1])
        if error > self.bound:
            raise LawBroken(self.name, case, error, self.bound, detail)
        return error


LAWS: dict[str, Law] = {}
"""Every law by name, in the order of reports."""


class Question:
    """A case and the library built for it."""

    def __init__(self, build: Build, case: Case, step: float = STEP) -> None:
        self.build, self.case, self.step = build, case, step
        self.library = Wrapped(build, case.robot)
        self.q, self.link = case.posture, case.link

    @property
    def truth_scale(self) -> dict[str, float]:
        """What errors of a pose, a Jacobian and a hessian are divided by."""
        scale, gain = self.case.scale, self.case.gain
        return {"pose": scale, "jacobian": scale * gain, "hessian": scale * gain * gain}

    def error(self, what: str, found: Any, expected: Any, times: float = 1.0) -> float:
        """The largest difference relative to scale; inf for another shape or a NaN."""
        found, expected = np.asarray(found), np.asarray(expected)
        if found.shape != expected.shape:
            return math.inf
        difference = np.abs(found.astype(np.float64) - expected)
        worst = float(difference.max(initial=0.0)) / (self.truth_scale[what] * times)
        return worst if math.isfinite(worst) else math.inf

    def both(self, found: tuple[Any, Any], expected: tuple[Any, Any], what: str) -> dict[str, float]:
        """Errors of a pose and a Jacobian."""
        return {
            f"pose {what}": self.error("pose", found[0], expected[0]),
            f"Jacobian {what}": self.error("jacobian", found[1], expected[1]),
        }

    def steps(self) -> Float[np.ndarray, "n"]:
        """Steps of differences: smaller where followers multiply them."""
        return np.full(self.case.robot.n, self.step / self.case.gain)

    def evaluated(
        self, postures: Float[np.ndarray, "postures n"], link: str | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Poses and Jacobians of several postures, one call each; of the case's link unless another is named."""
        pairs = [self.library.pose_and_jacobian(q, self.link if link is None else link) for q in postures]
        n = self.case.robot.n
        if not pairs:
            return np.empty((0, 4, 4)), np.empty((0, self.library.rows, n))
        return np.stack([pose for pose, _ in pairs]), np.stack([jacobian for _, jacobian in pairs])


def law(*needs: str, bound: float = EXACT) -> Callable[[Callable[[Question], dict[str, float]]], Law]:
    """Makes a law of a function and enters it in :data:`LAWS`.

    Args:
        needs: What the library must offer (:class:`Law`).
        bound: The largest relative error that keeps the law.
    """

    def decorate(check: Callable[[Question], dict[str, float]]) -> Law:
        LAWS[check.__name__] = made = Law(check.__name__, inspect.getdoc(check) or "", frozenset(needs), bound, check)
        return made

    return decorate


def differences(
    function: Callable[[Float[np.ndarray, "postures n"]], np.ndarray],
    q: Float[np.ndarray, "n"],
    steps: Float[np.ndarray, "n"],
) -> np.ndarray:
    """The derivative of a function by every joint value: central differences of four points, of fourth order.

    Args:
        function: Values (postures, ...) at postures (postures, n).
        q: Where [rad or m].
        steps: Distance of the points, for each joint.

    Returns:
        (n, ...), the derivative by each joint value first.
    """
    n = len(q)
    # What is added to a large angle is not what arrives: divide by what did.
    steps = (q + steps) - q
    offsets = np.array([-2.0, -1.0, 1.0, 2.0])
    postures = q + offsets[:, None, None] * np.diag(steps)
    values = function(postures.reshape(4 * n, n))
    far_below, below, above, far_above = values.reshape(4, n, *values.shape[1:])
    slopes = (8.0 * (above - below) - (far_above - far_below)) / 12.0
    return np.asarray(slopes / steps.reshape(-1, *[1] * (slopes.ndim - 1)))
