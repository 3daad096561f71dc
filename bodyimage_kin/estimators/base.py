"""What an estimator is, what it returns, and how that is kept on disk.

An estimator is a frozen spec: its fields say everything but the data and the seed. ``fit`` is pure and returns a
learned Jacobian. Its arrays are kept as safetensors beside a JSON file that names the kind; loading looks the kind up
in our own list and imports nothing a file names.
"""

from __future__ import annotations

import abc
import dataclasses
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
import xarray as xr
from jaxtyping import Float
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor

from bodyimage_kin._arrays import ArrayLike, as_postures
from bodyimage_kin._files import atomic_path, write_text
from bodyimage_kin.errors import InvalidConfig, InvalidPosture, InvalidRecording
from bodyimage_kin.recordings.schema import check

_FORMAT = {"format": "bodyimage_kin learned Jacobian", "version": 1}


@dataclasses.dataclass(frozen=True, eq=False)
class Pairs:
    """What an experience teaches: felt postures and displacements of joints and hand image, one row a step.

    Attributes:
        q: (steps, p) posture before the step [rad].
        dq: (steps, p) displacement of the joints [rad].
        image: (steps, m) hand image before the step [m].
        dr: (steps, m) displacement of the hand image [m].
    """

    q: Float[Tensor, "steps p"]
    dq: Float[Tensor, "steps p"]
    image: Float[Tensor, "steps m"]
    dr: Float[Tensor, "steps m"]


def pairs(exp: xr.Dataset) -> Pairs:
    """All steps of an experience at whose both ends posture and hand image are felt.

    Raises:
        InvalidRecording: No such step, or none in which a joint moves.
    """
    check(exp)
    q, image = exp["q"].values, exp["hand_image"].values
    felt = np.isfinite(q).all(-1) & np.isfinite(image).all(-1)
    step = felt[:, :-1] & felt[:, 1:]
    if not step.any():
        raise InvalidRecording(
            "the experience has no two successive samples in which the hand is seen; "
            "learn from a recording with the hand in view, such as a bk.motions.Circle"
        )
    dq = np.diff(q, axis=1)[step]
    if not dq.any():
        raise InvalidRecording("no joint moves in the experience, so it teaches no displacement; record a motion")
    tensors = (q[:, :-1][step], dq, image[:, :-1][step], np.diff(image, axis=1)[step])
    return Pairs(*(torch.from_numpy(np.ascontiguousarray(array)) for array in tensors))


class LearnedJacobian(abc.ABC):
    """A learned Jacobian: predicts how the hand image moves with the felt joints.

    Subclasses give :meth:`_displacement`, and :meth:`_jacobian` where there is a closed form, on checked tensors; those
    that can be saved list their arrays in ``arrays`` and register under ``kind``.
    """

    kind: ClassVar[str] = ""

    @property
    @abc.abstractmethod
    def p(self) -> int:
        """Number of felt joints."""

    @property
    @abc.abstractmethod
    def m(self) -> int:
        """Number of coordinates of a hand image."""

    def displacement(self, q: ArrayLike, dq: ArrayLike) -> Float[Tensor, "*batch m"]:
        """Predicted displacement of the hand image [m on the screen].

        Args:
            q: Postures ``(*batch, p)`` [rad].
            dq: Displacements of the joints ``(*batch, p)`` [rad]; shapes broadcast.

        Raises:
            InvalidPosture: A last axis that is not of p joints.
        """
        q, dq = as_postures(q, self.p), as_postures(dq, self.p, "displacement dq")
        if q.shape != dq.shape:
            try:
                shape = np.broadcast_shapes(q.shape, dq.shape)
            except ValueError:
                raise InvalidPosture(
                    f"posture q {tuple(q.shape)} and displacement dq {tuple(dq.shape)} do not fit together"
                ) from None
            q, dq = q.expand(shape), dq.expand(shape)
        return self._displacement(q, dq)

    def jacobian(self, q: ArrayLike) -> Float[Tensor, "*batch m p"]:
        """Derivative of the predicted displacement with respect to dq, at dq = 0 [m/rad].

        Args:
            q: Postures ``(*batch, p)`` [rad].

        Raises:
            InvalidPosture: A last axis that is not of p joints.
        """
        return self._jacobian(as_postures(q, self.p))

    @abc.abstractmethod
    def _displacement(self, q: Float[Tensor, "*batch p"], dq: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m"]:
        """The displacement, for checked tensors of one shape."""

    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        flat = q.reshape(-1, self.p)
        derivative = torch.func.vmap(torch.func.jacrev(self._displacement, argnums=1))
        return derivative(flat, torch.zeros_like(flat)).reshape(*q.shape[:-1], self.m, self.p)

    def arrays(self) -> Mapping[str, Tensor]:
        """Everything that was learned, by name."""
        raise InvalidConfig(f"{type(self).__name__} cannot be saved: it holds prior knowledge, not learned arrays")

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Tensor]) -> LearnedJacobian:
        """The inverse of :meth:`arrays`."""
        raise InvalidConfig(f"{cls.__name__} cannot be loaded")

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Writes ``learned.safetensors`` and ``learned.json`` into a folder, which is made when missing."""
        arrays = {name: array.detach().contiguous() for name, array in self.arrays().items()}
        place = Path(folder)
        place.mkdir(parents=True, exist_ok=True)
        with atomic_path(place / "learned.safetensors") as temporary:
            save_file(arrays, str(temporary))
        write_text(place / "learned.json", json.dumps({**_FORMAT, "kind": self.kind}, indent=2) + "\n")


class Estimator(abc.ABC):
    """A frozen spec that learns a Jacobian from an experience."""

    @abc.abstractmethod
    def fit(self, exp: xr.Dataset, seed: int = 0) -> LearnedJacobian:
        """Learns from an experience; pure: same experience and seed, same bits.

        Args:
            exp: An experience (:func:`bodyimage_kin.experience`).
            seed: Of whatever is drawn at random.

        Raises:
            InvalidRecording: Nothing in it to learn from.
        """

    def fit_many(self, experiences: Sequence[xr.Dataset], seeds: Sequence[int]) -> list[LearnedJacobian]:
        """Learns from several experiences, one seed each.

        Args:
            experiences: One for each seed.
            seeds: One for each experience.

        Raises:
            InvalidConfig: Unequal numbers of experiences and seeds.
        """
        check_many(experiences, seeds)
        return [self.fit(exp, seed) for exp, seed in zip(experiences, seeds, strict=True)]


def check_many(experiences: Sequence[xr.Dataset], seeds: Sequence[int]) -> None:
    """Raises InvalidConfig unless there is one seed for each experience."""
    if len(experiences) != len(seeds):
        raise InvalidConfig(f"fit_many got {len(experiences)} experiences and {len(seeds)} seeds; give one seed each")


def is_count(value: object, least: int) -> bool:
    """Whether a field is a whole number of at least this (a bool is none)."""
    return isinstance(value, int) and not isinstance(value, bool) and value >= least


def require(condition: bool, field: str, value: object, wanted: str) -> None:
    """Raises InvalidConfig naming a field of a spec, unless the condition holds."""
    if not condition:
        raise InvalidConfig(f"{field}={value!r}: give {wanted}")


def load_arrays(folder: str | os.PathLike[str]) -> tuple[str, dict[str, Any]]:
    """Kind and arrays that :meth:`LearnedJacobian.save` wrote.

    Raises:
        InvalidConfig: Files that are missing or were not written by it.
    """
    place = Path(folder)
    try:
        description = json.loads((place / "learned.json").read_text(encoding="utf-8"))
        kind = str(description["kind"])
        form = {field: description.get(field) for field in _FORMAT}
        arrays = load_file(str(place / "learned.safetensors"))
    except (OSError, ValueError, KeyError, TypeError, SafetensorError) as problem:
        raise InvalidConfig(f"'{folder}' holds no learned Jacobian: {problem}") from None
    if form != _FORMAT:
        raise InvalidConfig(f"'{folder}' holds no learned Jacobian that this version reads: it is of {form}")
    return kind, arrays
