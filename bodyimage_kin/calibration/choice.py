"""Where to look next: the postures whose images tell most of the Jacobian where nothing is seen.

Images, and the Jacobian at the probes, are linearised in the body's measures about the current estimate
(:mod:`bodyimage_kin.calibration.design`). Postures are chosen one by one, each the best after those before, then
exchanged as long as that lowers the error that is left after all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pandas as pd
import torch
import xarray as xr
from jaxtyping import Bool, Float, Int

from bodyimage_kin import _checks
from bodyimage_kin._arrays import ArrayLike, as_float_array
from bodyimage_kin._shown import table
from bodyimage_kin.body import Embodiment, VirtualScreen
from bodyimage_kin.calibration.calibrated import Calibrated
from bodyimage_kin.calibration.design import FREE, Aim, Design
from bodyimage_kin.calibration.fitting import calibrate
from bodyimage_kin.calibration.prior import Prior
from bodyimage_kin.calibration.problem import Observed
from bodyimage_kin.errors import InvalidConfig, NotVisible
from bodyimage_kin.estimators.parametric import Group
from bodyimage_kin.metrics.probes import Probe, probe_postures

__all__ = ["NextPostures", "next_postures"]

_CANDIDATES = 5000
_SCREEN_NOISE = 2e-4
"""Of images on a virtual screen [m], where nothing is said."""
_DRAWN = 200
"""Postures that are drawn at most for each candidate wanted, before the hand is said to be hardly ever seen."""
_SHOWN = 20
"""Postures that a notebook shows at most."""


@dataclass(frozen=True, eq=False)
class NextPostures:
    """Postures to go to, best first.

    Attributes:
        q: (count, p) felt postures [rad or m].
        chosen: (count,) which candidates they are.
        predicted_error: (count + 1,) predicted relative error of the Jacobian at the probes, before any and after each.
        joints: Names of the felt joints.
    """

    q: Float[np.ndarray, "count p"]
    chosen: Int[np.ndarray, "count"]
    predicted_error: Float[np.ndarray, "after"]
    joints: tuple[str, ...]

    def __repr__(self) -> str:
        begin, end = self.predicted_error[0], self.predicted_error[-1]
        return f"NextPostures({len(self.q)} postures, predicted error {begin:.3g} -> {end:.3g})"

    def to_csv(self) -> str:
        """A row a posture, as :func:`bodyimage_kin.read_recording` reads it once images were added.

        ``q.JOINT`` [rad or m] and the error that is expected after it.
        """
        columns = {f"q.{name}": self.q[:, index] for index, name in enumerate(self.joints)}
        frame = pd.DataFrame({**columns, "expected_error": self.predicted_error[1:]})
        return str(frame.to_csv(index_label="number", lineterminator="\n"))

    def _repr_html_(self) -> str:
        """The postures for notebooks, and the error that is predicted after each."""
        rows = {
            f"{index}": f"{', '.join(f'{value:.3f}' for value in q)}; predicted error {error:.3g}"
            for index, (q, error) in enumerate(zip(self.q[:_SHOWN], self.predicted_error[1:], strict=False), start=1)
        }
        head = f"{', '.join(self.joints)}; predicted error before {self.predicted_error[0]:.3g}"
        return table("NextPostures", head, rows)


def next_postures(
    body: Embodiment | Calibrated,
    seen: xr.Dataset | None,
    probes: Probe | Sequence[Probe],
    count: int,
    *,
    candidates: ArrayLike | None = None,
    prior: Prior | None = None,
    noise: float | None = None,
    free: Sequence[Group] | None = None,
    aim: Aim = "probes",
    metric: ArrayLike | Literal["identity"] = "identity",
    apart: float = 1e-3,
    exchange: bool = True,
    seed: int = 0,
) -> NextPostures:
    """Postures whose images would tell most of the Jacobian at the probes, best first.

    Args:
        body: As it is thought to be, or a body that was calibrated: then what it was calibrated on counts as seen.
        seen: An experience that was seen already, images alone, to which the body is fitted (beside what it was
            calibrated on); None: nothing more was, and without a calibration the prior alone speaks.
        probes: Where the Jacobian is asked for.
        count: How many postures to choose.
        candidates: (n, p) postures to choose from; None: 5,000 drawn within the joint limits. Those beyond the limits
            by more than ``apart``, or in which the camera does not see the hand, are never chosen.
        prior: How far each measure may be off; None: :class:`Prior`'s defaults.
        noise: Standard deviation of the images [their unit]; None: as estimated by a calibrated body, else 0.2 mm on a
            virtual screen. Other units must say it.
        free: Groups of measures that may be off; None: those that were calibrated, else axes and offsets.
        aim: ``"probes"``: the error there (A-optimal); ``"everything"``: all measures alike (D-optimal, by the
            determinant of the information); ``"random"``: candidates in random order, to compare with.
        metric: (p, p) motion metric of the error, or ``"identity"``.
        apart: Least distance of any two chosen postures in their farthest joint [rad or m]; the encoders' noise.
        exchange: Whether postures that were chosen one by one are exchanged as long as that lowers the error left
            after all of them. False: the first few are the best few as well, as in the order in which the poses of a
            recording would have been chosen.
        seed: Of candidates that are drawn, and of random order.

    Raises:
        InvalidConfig: A noise that must be said, or fewer distinct candidates in view than are to be chosen.
        NotVisible: A body whose hand hardly ever comes before the camera.
    """
    _checks.choice("aim", aim, ("probes", "everything", "random"))
    number = _checks.whole("count", count, least=1)
    known = body if isinstance(body, Calibrated) else None
    if seen is not None:
        known = _refitted(body, seen, prior, noise, free)
    estimate = known.body if known is not None else body
    assert isinstance(estimate, Embodiment)
    design = Design.of(
        estimate, known, prior or (known.prior if known else Prior()), _noise(estimate, known, noise), free
    )
    q = _candidates(estimate, candidates, seed)
    far = _checks.number("apart", apart, least=0.0)
    visible = np.flatnonzero(estimate.visible(torch.from_numpy(q)).numpy() & _within(estimate, q, far))
    at_probes = _probe_postures(estimate, probes, seen)
    A = design.importance(at_probes, _metric(metric, estimate.p))
    order = np.random.default_rng(seed).permutation(visible) if aim == "random" else visible
    best, errors = design.choose(q[order], A, number, aim, far, _checks.flag("exchange", exchange))
    chosen = order[best]
    return NextPostures(q[chosen], chosen, errors, estimate.joints)


# Inner ---------------------------------------------------------------------------------------------------------------


def _refitted(
    body: Embodiment | Calibrated,
    seen: xr.Dataset,
    prior: Prior | None,
    noise: float | None,
    free: Sequence[Group] | None,
) -> Calibrated:
    """The body fitted to what was seen, and to what it was calibrated on before."""
    known = body if isinstance(body, Calibrated) else None
    thought = body.problem.body if isinstance(body, Calibrated) else body
    before = known.problem.observed if known is not None else ()
    if known is not None and any(seen.identical(one.experience) for one in before):
        return known
    told = _noise(thought, known, noise)
    return calibrate(
        thought,
        [*before, Observed(seen, use=["images"], noise={"images": told})],
        prior=prior or (known.prior if known is not None else None),
        free=free or (known.groups if known is not None else FREE),
    )


def _noise(body: Embodiment, known: Calibrated | None, noise: float | None) -> float:
    if noise is not None:
        return _checks.number("noise", noise, above=0.0)
    if known is not None:
        kinds = [term.name for term in known.problem.terms]
        if "images" in kinds:
            return known.fit.sigma[kinds.index("images")]
    if isinstance(body.camera.model, VirtualScreen):
        return _SCREEN_NOISE
    raise InvalidConfig(
        f"noise: say the standard deviation of the images [{body.camera.model.unit}]; there is a default for a virtual "
        "screen alone"
    )


def _metric(metric: ArrayLike | Literal["identity"], p: int) -> Float[np.ndarray, "p p"]:
    if isinstance(metric, str):
        _checks.choice("metric", metric, ("identity",))
        return np.eye(p)
    return as_float_array(metric, "metric", shapes=((p, p),))


def _candidates(body: Embodiment, candidates: ArrayLike | None, seed: int) -> Float[np.ndarray, "count p"]:
    if candidates is not None:
        q = as_float_array(candidates, "candidates", ndim=2)
        if q.ndim != 2 or q.shape[1] != body.p or not np.isfinite(q).all():
            raise InvalidConfig(
                f"candidates have shape {q.shape}; give finite postures of {body.p} felt joints, (n, {body.p})"
            )
        return q
    columns = [body.felt_robot.joint_index(name) for name in body.joints]
    found: list[Float[np.ndarray, "some p"]] = []
    count = 0
    for number in range(_DRAWN):
        drawn = body.felt_robot.sample(_CANDIDATES, seed=seed + number)[:, columns]
        found.append(drawn[body.visible(drawn)].numpy())
        count += len(found[-1])
        if count >= _CANDIDATES:
            return np.concatenate(found)[:_CANDIDATES]
    if count == 0:
        raise NotVisible(
            f"embodiment '{body.name}': the camera sees the hand in none of {_DRAWN * _CANDIDATES} postures"
        )
    return np.concatenate(found)


def _within(body: Embodiment, q: Float[np.ndarray, "count p"], slack: float) -> Bool[np.ndarray, "count"]:
    """Which postures the joints reach."""
    columns = [body.felt_robot.joint_index(name) for name in body.joints]
    lower, upper = (limit.numpy()[columns] for limit in (body.felt_robot.lower, body.felt_robot.upper))
    return np.asarray(((q >= lower - slack) & (q <= upper + slack)).all(axis=1))


def _probe_postures(
    body: Embodiment, probes: Probe | Sequence[Probe], seen: xr.Dataset | None
) -> Float[np.ndarray, "postures p"]:
    every = [probes] if isinstance(probes, Probe) else list(probes)
    if not every:
        raise InvalidConfig("probes: give at least one; without it nothing is asked for")
    return np.concatenate([probe_postures(probe, body, seen).numpy() for probe in every])
