"""What the commands about a user's own recording share: reading it, and what is said while something is computed."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from bodyimage_kin.errors import InvalidConfig

if TYPE_CHECKING:
    import xarray as xr

    from bodyimage_kin.body import Embodiment


@dataclass(frozen=True, kw_only=True)
class Reading:
    """How a table is read; a NetCDF file says all of this itself."""

    order: Literal["stream", "scattered"] | None = None
    """Whether rows of a table follow each other in time, or are postures in no order."""
    unit: tuple[str, ...] = ()
    """Units of a table, such as q=deg hand_position=mm; radians, metres and pixels where nothing is said."""

    def read(self, path: Path, body: Embodiment | None) -> xr.Dataset:
        """The recording; columns are found by their names (q.JOINT, hand_image.u ...)."""
        from bodyimage_kin.recordings import read_recording
        from bodyimage_kin.recordings.tables import TABLES

        if path.suffix.lower() not in TABLES and not self.order and not self.unit:
            return read_recording(path)
        units = dict(_part(one) for one in self.unit)
        return read_recording(path, robot=body, order=self.order, units=units or None)


def _part(text: str) -> tuple[str, str]:
    variable, mark, unit = text.partition("=")
    if not mark:
        raise InvalidConfig(f"--unit {text}: give VARIABLE=UNIT, such as q=deg")
    return variable, unit


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
