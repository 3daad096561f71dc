"""A calibrated body: what was found, how sure it is, what remains unknown, and in words what it is worth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd
import torch
from jaxtyping import Float, Int

from bodyimage_kin._arrays import ArrayLike, as_float_array
from bodyimage_kin._shown import Shown, table
from bodyimage_kin.body import Camera, Embodiment
from bodyimage_kin.calibration.observability import observability_indices, unobservable
from bodyimage_kin.calibration.prior import Prior
from bodyimage_kin.calibration.problem import Problem
from bodyimage_kin.calibration.urdf import urdf_of
from bodyimage_kin.errors import InvalidArray
from bodyimage_kin.estimators.map_fit import Fit
from bodyimage_kin.estimators.parametric import Group, Parameter
from bodyimage_kin.estimators.self_calibration import BodyProcess
from bodyimage_kin.robot import Robot

__all__ = ["Calibrated", "HeldOut"]

_EXPLAINED = 0.5
"""A fit whose held-out error is above this share of what the observations spread explains nothing."""
_MOVES = 0.02
"""A joint that moves less than this [rad or m] tells nothing of what is before it."""


@dataclass(frozen=True, eq=False)
class HeldOut(Shown):
    """Errors of observations that a fit did not see.

    Attributes:
        errors: Of each kind of evidence, (rows,) distance from what was observed [its unit].
        blocks: Of each kind, (rows,) the block that was hidden when it was judged.
    """

    errors: tuple[Float[np.ndarray, "_"], ...]
    blocks: tuple[Int[np.ndarray, "_"], ...]

    @property
    def medians(self) -> Float[np.ndarray, "terms"]:
        """Median error of each kind [its unit]."""
        return np.array([float(np.median(one)) for one in self.errors])

    def by_block(self, term: int = 0) -> Float[np.ndarray, "blocks"]:
        """Median error of each block [unit of that kind].

        Args:
            term: Which kind of evidence.
        """
        errors, blocks = self.errors[term], self.blocks[term]
        return np.array([float(np.median(errors[blocks == block])) for block in np.unique(blocks)])


@dataclass(frozen=True, eq=False)
class Calibrated:
    """A body fitted to what was observed of it. See :func:`bodyimage_kin.calibrate`.

    Attributes:
        problem: The body as it was thought to be, and the evidence.
        prior: How far its measures might have been off.
        groups: Kinds of parameters that were fitted.
        fit: Where the posterior has its mode, and how wide it is there.
        held_out: Errors of what each fit did not see.
        nominal: The same of the body as it was thought to be, a tracker's frame and planes fitted alone.
        robust: Whether the cost was Cauchy's.
    """

    problem: Problem
    prior: Prior
    groups: tuple[Group, ...]
    fit: Fit
    held_out: HeldOut
    nominal: HeldOut
    robust: bool = True

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Every measure that may be off, fitted or not."""
        return self.problem.parametric.parameters

    @property
    def covariance(self) -> Float[np.ndarray, "parameters parameters"]:
        """Of the posterior, zero where a measure was held; wider by the reduced chi-square where noise was unknown."""
        wider = 1.0 if self.fit.stated else max(self.fit.chi2, 1.0)
        return self.fit.covariance * wider

    @cached_property
    def body(self) -> Embodiment:
        """The body that was found."""
        return self.at(self.fit.theta)

    @cached_property
    def learned(self) -> BodyProcess:
        """The hand-eye map of the body that was found, with the doubt of the posterior, as estimators give it."""
        return BodyProcess(
            self.body, self.at, self.fit.theta, self.covariance, unit=self.problem.body.camera.model.unit
        )

    @property
    def robot(self) -> Robot:
        """Its robot: every joint that was fitted has its full 6D origin, which any reader of URDF understands."""
        return self.body.robot

    def to_urdf(self) -> str:
        """The file that the robot was read from, its joints where they were found: visuals and all else stay."""
        return urdf_of(self.problem.body.robot, self.robot)

    @property
    def skin_moved(self) -> bool:
        """Whether the skin was found elsewhere on its link."""
        groups = np.array([one.group == "skin" for one in self.parameters])
        return bool(self.fit.theta[groups].any())

    def hand_offset(self, offset: ArrayLike) -> Float[np.ndarray, "*batch 3"]:
        """Where points of the hand were found, such as those of a recording's ``hand_offset``.

        Args:
            offset: (*batch, 3) where they were thought to be in the hand's link [m].

        Returns:
            The same shape, as :attr:`body` takes them [m].

        Raises:
            InvalidArray: Not so many points.
        """
        thought = as_float_array(offset, "offset", ndim=1)
        if thought.shape[-1] != 3:
            raise InvalidArray(f"offset has shape {thought.shape}; give (*batch, 3)")
        pose = self.problem.parametric.mounted(self.fit.theta).get("hand", np.eye(4))
        return np.asarray(thought @ pose[:3, :3].T + pose[:3, 3])

    @property
    def free(self) -> int:
        """Number of measures that were fitted."""
        return int(self.fit.free.sum())

    def at(self, theta: ArrayLike) -> Embodiment:
        """The body with other values of its measures.

        Args:
            theta: (parameters,) in the order of :attr:`parameters`, zero for what is as it was thought to be.
        """
        values = as_float_array(theta, "theta", shapes=((len(self.parameters),),))
        parametric = self.problem.parametric
        return parametric.body_at(self.problem.body, values, self._camera(values, parametric.mounted(values)))

    def _camera(
        self, values: Float[np.ndarray, "parameters"], mounts: Mapping[str, Float[np.ndarray, "4 4"]]
    ) -> Camera:
        """The body's own camera, where it was one of those that saw."""
        camera = self.problem.body.camera
        for mount in self.problem.parametric.mounts:
            if (
                mount.group == "camera"
                and mount.link == camera.link
                and np.array_equal(mount.link_T_mount, camera.link_T_camera)
            ):
                intrinsics = self.problem.intrinsics[mount.name]
                count = len(intrinsics.parameters)
                first = self.parameters.index(intrinsics.parameters[0]) if count else 0
                return Camera(
                    camera.link, torch.from_numpy(mounts[mount.name]), intrinsics.at(values[first : first + count])
                )
        return camera

    def draws(self, count: int, seed: int = 0) -> list[Embodiment]:
        """Bodies drawn from the posterior (normal about its mode).

        Args:
            count: How many.
            seed: Same seed, same bodies.
        """
        return [self.at(theta) for theta in self.thetas(count, seed)]

    def thetas(self, count: int, seed: int = 0) -> Float[np.ndarray, "count parameters"]:
        """Measures drawn from the posterior, as :meth:`at` takes them."""
        free = self.fit.free
        values, vectors = np.linalg.eigh(self.covariance[np.ix_(free, free)])
        root = vectors * np.sqrt(values.clip(min=0.0))
        normal = np.random.default_rng(seed).standard_normal((count, int(free.sum())))
        found = np.tile(self.fit.theta, (count, 1))
        found[:, free] += normal @ root.T
        return found

    def to_csv(self) -> str:
        """A row for each measure that may be off: its name, group and unit, what was found, and how sure it is.

        ``prior`` is its standard deviation beforehand, ``inf`` where nothing was known; what was held has ``doubt`` 0.
        """
        frame = pd.DataFrame(
            {
                "measure": [one.name for one in self.parameters],
                "group": [one.group for one in self.parameters],
                "unit": [one.unit for one in self.parameters],
                "change": self.fit.theta,
                "doubt": np.sqrt(np.diagonal(self.covariance)),
                "prior": self.fit.sd,
                "fitted": self.fit.free,
            }
        )
        return str(frame.to_csv(index=False, lineterminator="\n"))

    @cached_property
    def unobservable(self) -> tuple[str, ...]:
        """Measures that the evidence does not tell, in words, the least told first."""
        return unobservable(self.fit, self.parameters)

    @cached_property
    def observability(self) -> dict[str, float]:
        """O1 to O5 (Joubair and Bonev 2013)."""
        return observability_indices(self.fit)

    @property
    def chi2(self) -> float:
        """Reduced chi-square; by construction about one where the noise was estimated."""
        return self.fit.chi2

    @property
    def labels(self) -> tuple[str, ...]:
        """What each kind of evidence is called, one recording after the other: ``images``, ``touches 2`` ..."""
        names = [term.name for term in self.problem.terms]
        return tuple(
            name if names.count(name) == 1 else f"{name} {names[: index + 1].count(name)}"
            for index, name in enumerate(names)
        )

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each kind of evidence."""
        return tuple(_unit(term) for term in self.problem.terms)

    @property
    def residuals(self) -> dict[str, Float[np.ndarray, "rows m"]]:
        """What the fit leaves of each kind of evidence [its unit]."""
        return dict(zip(self.labels, self.fit.residuals, strict=True))

    def residuals_by_region(self, joint: str, parts: int = 4) -> dict[str, Float[np.ndarray, "parts"]]:
        """Median residual of each kind in parts of a joint's range, of as many samples each.

        Args:
            joint: Name of a felt joint.
            parts: How many.
        """
        column = self.problem.body.joints.index(joint)
        found = {}
        for label, term, left in zip(self.labels, self.problem.terms, self.fit.residuals, strict=True):
            order = np.argsort(term.q[:, column], kind="stable")
            size = np.linalg.norm(left, axis=1)
            found[label] = np.array([np.median(size[part]) for part in np.array_split(order, parts) if len(part)])
        return found

    @cached_property
    def still(self) -> tuple[str, ...]:
        """Joints that hardly moved in all that was observed."""
        q = np.concatenate([term.q for term in self.problem.terms])
        spread = q.max(0) - q.min(0)
        return tuple(name for name, one in zip(self.problem.body.joints, spread, strict=True) if one < _MOVES)

    @property
    def explains(self) -> bool:
        """Whether what was held out is foreseen better than by its own mean."""
        return all(
            float(np.median(errors)) <= _EXPLAINED * _spread(term)
            for term, errors in zip(self.problem.terms, self.held_out.errors, strict=True)
        )

    @property
    def verdict(self) -> str:
        """One sentence for a person: is this body worth more than the one it was thought to be, and how sure is it?"""
        count = sum(len(one) for one in self.held_out.errors)
        errors = "; ".join(
            f"{label}: {_size(new, unit)} held out, {_size(old, unit)} before"
            for label, unit, new, old in zip(
                self.labels, self.units, self.held_out.medians, self.nominal.medians, strict=True
            )
        )
        if not self.explains:
            return (
                f"This fit explains nothing: what it did not see is no better foreseen than by the mean ({errors}). "
                "Are joints in radians, images in the camera's unit, and is it this body?"
            )
        said = f"{self.free} measures from {count} observations; {errors}"
        if self.still:
            return f"{said}. {', '.join(self.still)} hardly moved, so the fit says nothing of other postures of theirs."
        if (self.held_out.medians > self.nominal.medians).any():
            return f"{said}. The body as it was thought to be foresees better: keep that one."
        if self.unobservable:
            return f"{said}. {len(self.unobservable)} directions are known from the prior alone."
        return f"{said}. Everything fitted is told by what was observed."

    def __repr__(self) -> str:
        return f"Calibrated({self.problem.body.name!r}, {self.free} measures; {self.verdict})"

    def _repr_html_(self) -> str:
        """The same for notebooks, and what cannot be known."""
        rows = {
            "body": self.problem.body.name,
            "measures": str(self.free),
            "known from the prior alone": "; ".join(self.unobservable) or "none",
            "hardly moved": ", ".join(self.still) or "none",
        }
        return table("Calibrated", self.verdict, rows)


def _unit(term: object) -> str:
    intrinsics = getattr(term, "intrinsics", None)
    return intrinsics.model.unit if intrinsics is not None else "m"


def _size(value: float, unit: str) -> str:
    return f"{1e3 * value:.3g} mm" if unit == "m" else f"{value:.3g} {unit}"


def _spread(term: object) -> float:
    """Median distance of the observations from their middle [their unit]; inf of what has none, such as planes."""
    observed = getattr(term, "image", getattr(term, "observed", getattr(term, "target", None)))
    if observed is None:
        return float("inf")
    return float(np.nanmedian(np.linalg.norm(observed - np.nanmedian(observed, axis=0), axis=1)))
