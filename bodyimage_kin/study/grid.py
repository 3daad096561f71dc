"""What stands along a study's axes: recordings that belong together, and rows of its results."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bodyimage_kin._checks import choice, flag, text, whole
from bodyimage_kin.body_image.integration import METHODS, RESETS
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.recordings import Drag, Noise
from bodyimage_kin.study.specs import arguments

__all__ = ["ROLES", "Row", "Simulation", "row_of"]

ROLES = ("training", "use", "tour")
"""Recordings of an entry: learned from, used on, compared along."""


@dataclass(frozen=True)
class Simulation:
    """Recordings that belong together: what is learned from, and what that is used on.

    A bare motion or dataset given to a study stands for ``Simulation(training=...)``.

    Attributes:
        training: A motion; several, recorded as trials of one recording; or what is there already: a recording
            (``xarray.Dataset``), or a list of them, one a seed, taken as they are.
        use: Touches: their motion's metric counts, and maps are learned from them. Likewise a motion, a recording or a
            list of them. None: what the study says; without that 80 s of random touch beside a simulated training, and
            nothing beside a recording.
        tour: Where displacements are compared. None: a tour of the face beside a simulated training, at its speed and
            sampling. ``use`` and ``tour`` are left out on a body without a skin.
        dynamics: As of :func:`bodyimage_kin.simulate`, for all motions.
        noise: Likewise.
        touch_seen: Likewise; False: images of the hand while it touches count as unseen, whatever the eye sees then.
        stream: Name of the random streams of what is simulated; entries of one name are paired: the same motion moves
            the same way in all of them. Empty: the entry's own name.
    """

    training: Any
    use: Any = None
    tour: Any = None
    dynamics: bool | Drag = True
    noise: Noise | None = None
    stream: str = ""
    touch_seen: bool = True

    def __post_init__(self) -> None:
        flag("touch_seen", self.touch_seen)
        if not isinstance(self.dynamics, Drag):
            object.__setattr__(self, "dynamics", flag("dynamics", self.dynamics))
        if self.noise is not None and not isinstance(self.noise, Noise):
            raise InvalidConfig(f"noise is {type(self.noise).__name__}; give bk.Noise(...) or None")
        if self.stream:
            text("stream", self.stream)


@dataclass(frozen=True)
class Row:
    """One row of a study's results: an estimator, and how what it learns is used.

    A bare estimator given to a study stands for ``Row(estimator)``.

    Attributes:
        estimator: Object, class, name or table; None: direct sight, which is handed the true image of the hand and has
            no Jacobian.
        told: Setting -> name of a fact of the recording: what the estimator is told beside the experience, such as
            ``{"scale": "depth_ratio"}``.
        method: Rule of :func:`bodyimage_kin.integrate`.
        substeps: Likewise.
        reset: Likewise, for touches; the posture map is learned from the training, ``"none"`` begins at the reference.
        on: Names of the recordings, or ``embodiment/recording``, that the row is computed on; none: all.
        maps: Settings of :meth:`bodyimage_kin.BodyImage.learn` that differ from the study's.
        first_maps: As of the study, where it differs.
        stream: Name of the random stream of the fit; rows of one name and one estimator learn the same. Empty: its own.
    """

    estimator: Any = None
    told: Mapping[str, str] = field(default_factory=dict)
    method: str = "euler"
    substeps: int = 1
    reset: str = "reference"
    on: tuple[str, ...] = ()
    maps: Mapping[str, Any] = field(default_factory=dict)
    first_maps: int | Mapping[Any, int] | None = None
    stream: str = ""

    def __post_init__(self) -> None:
        choice("method", self.method, METHODS)
        choice("reset", self.reset, RESETS)
        whole("substeps", self.substeps, least=1)
        on: Any = self.on
        if isinstance(on, str) or not all(isinstance(name, str) for name in on):
            raise InvalidConfig(f"on={on!r}: give names of recordings in a list")
        object.__setattr__(self, "on", tuple(on))
        for name, value in (("told", self.told), ("maps", self.maps)):
            if not isinstance(value, Mapping):
                raise InvalidConfig(f"{name}={value!r}: give a table of settings")
        if self.told and self.estimator is None:
            raise InvalidConfig("told: direct sight has no setting that could be told; name an estimator")


def row_of(table: Mapping[str, Any], folder: Path = Path()) -> Row:
    """The row of a table, its estimator not yet built.

    Raises:
        InvalidConfig: A setting that a row does not have, or out of range.
    """
    if "estimator" not in table:
        return Row(dict(table))
    settings = arguments("row", Row, {key: value for key, value in table.items() if key != "estimator"}, folder)
    return Row(None if table["estimator"] == "none" else table["estimator"], **settings)
