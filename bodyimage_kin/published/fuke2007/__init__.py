"""The experiment of Fuke, Ogino and Asada (2007), with the analytic truth beside everything that is learned.

:func:`~bodyimage_kin.published.fuke2007.grid` is the experiment as a study,
:func:`~bodyimage_kin.published.fuke2007.judge` what its results say.
"""

from bodyimage_kin.published.fuke2007.blindness import FALSE_ALARMS, MEASURES, permuted_error, power
from bodyimage_kin.published.fuke2007.claims import CLAIMS, Claim
from bodyimage_kin.published.fuke2007.conditions import Conditions
from bodyimage_kin.published.fuke2007.corruption import DOSES, Corrupted
from bodyimage_kin.published.fuke2007.grid import (
    BLINDNESS,
    CONDITIONS,
    DIRECT,
    ESTIMATORS,
    GAMMA,
    MOTIONS,
    NETWORK,
    NULLS,
    Condition,
    check,
    grid,
    network,
)
from bodyimage_kin.published.fuke2007.judge import PROBES, judge, write_summary
from bodyimage_kin.published.fuke2007.scores import true_posture_map

__all__ = [
    "BLINDNESS",
    "CLAIMS",
    "CONDITIONS",
    "DIRECT",
    "DOSES",
    "ESTIMATORS",
    "FALSE_ALARMS",
    "GAMMA",
    "MEASURES",
    "MOTIONS",
    "NETWORK",
    "NULLS",
    "PROBES",
    "Claim",
    "Condition",
    "Conditions",
    "Corrupted",
    "check",
    "grid",
    "judge",
    "network",
    "permuted_error",
    "power",
    "true_posture_map",
    "write_summary",
]
