"""What the paper leaves open (Fuke, Ogino and Asada, 2007), and what every reading of it is worth.

:func:`grid` is every reading as a study, :func:`judge` what its results say.
"""

from bodyimage_kin.published.ambiguities.grid import ARMS, grid, infant_with_arm, places, recordings
from bodyimage_kin.published.ambiguities.jacobians import AtZero, FaceMean, Secant, Unbiased
from bodyimage_kin.published.ambiguities.judge import (
    DRAWN,
    MEASURES,
    Measure,
    judge,
    markdown,
    summarise,
    write_summary,
)
from bodyimage_kin.published.ambiguities.networks import Network
from bodyimage_kin.published.ambiguities.readings import AMBIGUITIES, ROWS, STEPS, Ambiguity, Place, Reading

__all__ = [
    "AMBIGUITIES",
    "ARMS",
    "DRAWN",
    "MEASURES",
    "ROWS",
    "STEPS",
    "Ambiguity",
    "AtZero",
    "FaceMean",
    "Measure",
    "Network",
    "Place",
    "Reading",
    "Secant",
    "Unbiased",
    "grid",
    "infant_with_arm",
    "judge",
    "markdown",
    "places",
    "recordings",
    "summarise",
    "write_summary",
]
