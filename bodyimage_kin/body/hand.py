"""The hand: what is seen, and what touches."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin._arrays import ArrayLike, as_float_array
from bodyimage_kin._checks import number, text
from bodyimage_kin.errors import InvalidConfig

__all__ = ["Hand"]


@dataclass(frozen=True, eq=False, init=False)
class Hand:
    """A spherical hand on a link.

    Attributes:
        link: The link that carries it.
        offset: (3,) its centre, in the link [m]; given as tensor, array or list.
        radius: [m]; 0: a point.

    Raises:
        InvalidConfig: An offset that is not three finite numbers, or a negative radius.
    """

    link: str
    offset: Float[Tensor, "3"]
    radius: float

    def __init__(self, link: str, offset: ArrayLike = (0.0, 0.0, 0.0), radius: float = 0.0) -> None:
        place = as_float_array(offset, "hand offset", shapes=((3,),), error=InvalidConfig)
        for axis, value in zip("xyz", place.tolist(), strict=True):
            number(f"hand offset {axis}", value)
        object.__setattr__(self, "link", text("hand link", link))
        object.__setattr__(self, "offset", torch.from_numpy(place.copy()))
        object.__setattr__(self, "radius", number("hand radius", radius, least=0.0))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Hand):
            return NotImplemented
        return (self.link, self.radius) == (other.link, other.radius) and torch.equal(self.offset, other.offset)

    def __hash__(self) -> int:
        return hash((self.link, self.radius, *self.offset.tolist()))

    def __repr__(self) -> str:
        return f"Hand({self.link!r}, offset={tuple(self.offset.tolist())}, radius={self.radius})"
