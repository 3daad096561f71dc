"""What the commands about a user's own recording share: reading it, and what is said while something is computed."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import arg

from bodyimage_kin.cli.arguments import Command, pairs

if TYPE_CHECKING:
    import xarray as xr

    from bodyimage_kin.body import Embodiment


@dataclass(frozen=True, kw_only=True)
class Reading(Command):
    """A command that reads a recording of the user's own; a NetCDF file says all of this itself."""

    order: Annotated[Literal["stream", "scattered"] | None, arg(metavar="stream|scattered", help_behavior_hint="")] = (
        None
    )
    """Rows of a table one after the other in time, or postures in no order; a column of time says the first."""
    units: Annotated[tuple[str, ...], arg(metavar="NAME=VALUE ...", help_behavior_hint="")] = ()
    """Units in a table: q=deg, hand_position=mm, time=ms. Else radians, metres, seconds, pixels."""

    def read(self, path: Path, body: Embodiment | None) -> xr.Dataset:
        """The recording; columns are found by their names (q.JOINT, hand_image.u ...)."""
        from bodyimage_kin.recordings import read_recording
        from bodyimage_kin.recordings.tables import TABLES

        if path.suffix.lower() not in TABLES and not self.order and not self.units:
            return read_recording(path)
        return read_recording(path, robot=body, order=self.order, units=pairs("--units", self.units) or None)


@contextmanager
def heard() -> Iterator[list[str]]:
    """What is warned of inside, each once, for the page."""
    from bodyimage_kin.errors import DataWarning

    said: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", DataWarning)
        try:
            yield said
        finally:
            said += dict.fromkeys(str(one.message) for one in caught if issubclass(one.category, DataWarning))
