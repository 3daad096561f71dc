"""The units of a map: how many there are, in which shape, and how far apart."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from jaxtyping import Float, Int

from bodyimage_kin._arrays import ArrayLike, as_float_array
from bodyimage_kin.body import Skin
from bodyimage_kin.body.clusters import middle, touched_place
from bodyimage_kin.body_image._checks import choice, grid_shape
from bodyimage_kin.errors import InvalidArray, InvalidConfig

Units: TypeAlias = "Skin | tuple[int, int] | list[int] | ArrayLike"
"""A skin, (rows, columns) of a grid, or distances between all pairs of taxels (taxels, taxels)."""

WINNERS = ("first", "all", "largest", "middle")


@dataclass(frozen=True, eq=False)
class Layout:
    """The units of a map.

    Attributes:
        shape: (rows, columns) of a grid, (taxels,) of any other skin.
        distances: (taxels, taxels) of a skin that is no grid; None: those of the grid, in its units.
        skin: Whose taxels they are, where it is no grid; None: not known.
    """

    shape: tuple[int, ...]
    distances: Float[np.ndarray, "taxels taxels"] | None = None
    skin: Skin | None = None

    @classmethod
    def of(cls, skin: Units) -> Layout:
        """The units that a user gives.

        Raises:
            InvalidConfig: Neither a skin nor a grid, and no distances.
            InvalidArray: Distances that are not square and symmetric, or negative.
        """
        if isinstance(skin, Skin):
            return cls(skin.shape) if skin.shape is not None else cls((skin.count,), skin.distances, skin)
        if np.ndim(skin) != 2:
            return cls(grid_shape("skin", skin))
        distances = as_float_array(skin, "skin (distances between taxels)")
        if len(distances) != distances.shape[1] or not np.isfinite(distances).all() or (distances < 0).any():
            raise InvalidArray("skin: distances must be (taxels, taxels), finite and not negative")
        if not np.allclose(distances, distances.T) or np.diag(distances).any():
            raise InvalidArray("skin: distances must be symmetric, and 0 from a taxel to itself")
        return cls((len(distances),), distances)

    @property
    def grid(self) -> tuple[int, int] | None:
        """(rows, columns); None of a skin that is no grid."""
        return None if self.distances is not None else (self.shape[0], self.shape[1])

    @property
    def count(self) -> int:
        """Number of units."""
        return math.prod(self.shape)

    def exponents(self, kernel: str) -> Float[np.ndarray, "taxels taxels"]:
        """Logarithm of the kernel at gamma = 1 between all pairs, of a skin that is no grid."""
        if self.distances is None:
            raise InvalidConfig("a grid has its exponents by offset")
        return -(self.distances**2) if kernel == "squared" else -self.distances

    def winners(self, rule: str | None) -> str:
        """Which of the taxels felt at once win: as asked, or what is usual for these units."""
        if rule is None:
            return "first" if self.distances is None else "all" if self.skin is None else "largest"
        choice("winners", rule, WINNERS)
        if rule != "first" and self.distances is None:
            raise InvalidConfig(f"winners={rule!r} is of skins that are no grid; a grid has one winner, the first")
        if rule in ("largest", "middle") and self.skin is None:
            raise InvalidConfig(f"winners={rule!r} needs to know where taxels are; give a Skin in place of distances")
        return rule


def winning(
    layout: Layout,
    rule: str,
    touched: Int[np.ndarray, "steps contacts"],
    intensity: Float[np.ndarray, "steps contacts"] | None,
) -> tuple[Int[np.ndarray, "steps winners"], Float[np.ndarray, "steps winners"]]:
    """The winners of every step, first ones first (-1: none), and the logarithm of how strongly each is felt.

    Args:
        layout: The taxels.
        rule: ``"first"`` active one, ``"all"``, the single ``"largest"`` cluster, without which nothing wins, or the
            taxel in its ``"middle"``.
        touched: Active taxels, -1: none.
        intensity: Of each; None: all alike. The strongest of a step counts 1, what is not above 0 is not felt.
    """
    strength = np.ones(touched.shape) if intensity is None else np.where(np.isfinite(intensity), intensity, 0.0)
    felt = (touched >= 0) & (strength > 0.0)
    if rule == "first":
        felt &= np.cumsum(felt, axis=1) == 1
    elif rule in ("largest", "middle") and layout.skin is not None:
        # Most touches of a recording are among few sets of taxels.
        known: dict[bytes, np.ndarray] = {}
        places = layout.skin.link_positions
        for step in np.flatnonzero(felt.sum(axis=1) > 1):
            active = np.where(felt[step], touched[step], -1)
            key = active.tobytes()
            if key not in known:
                members = touched_place(places, active)
                if members is None:
                    members = np.empty(0, dtype=np.int64)
                elif rule == "middle":
                    members = members[[middle(places[members])]]
                known[key] = (active[:, None] == members).any(axis=1)
            felt[step] &= known[key]
    order = np.argsort(~felt, axis=1, kind="stable")
    active = np.take_along_axis(np.where(felt, touched, -1), order, axis=1)
    strength = np.take_along_axis(np.where(felt, strength, 1.0), order, axis=1)
    most = np.where(active >= 0, strength, 0.0).max(axis=1, keepdims=True, initial=0.0)
    width = max(1, int((active >= 0).sum(axis=1).max(initial=0)))
    return active[:, :width], np.log(np.where(active >= 0, strength, 1.0) / np.where(most > 0, most, 1.0))[:, :width]
