"""Test any kinematics library: random robots, an analytic oracle, and the laws that every library must keep.

Needs Hypothesis: ``pip install bodyimage-kin[testing]``.
"""

from __future__ import annotations

from bodyimage_kin.errors import MissingDependency

try:
    import hypothesis as _hypothesis  # noqa: F401
except ImportError:
    raise MissingDependency(
        "bodyimage_kin.testing needs hypothesis, which is not installed; pip install 'bodyimage-kin[testing]'"
    ) from None

from bodyimage_kin.testing import laws as laws
from bodyimage_kin.testing._law import LAWS as LAWS
from bodyimage_kin.testing._law import Law as Law
from bodyimage_kin.testing._law import LawBroken as LawBroken
from bodyimage_kin.testing._library import Library as Library
from bodyimage_kin.testing._library import NotOffered as NotOffered
from bodyimage_kin.testing._spec import Case as Case
from bodyimage_kin.testing._spec import JointSpec as JointSpec
from bodyimage_kin.testing._spec import RobotSpec as RobotSpec
from bodyimage_kin.testing.oracle import Truth as Truth
from bodyimage_kin.testing.oracle import oracle as oracle
from bodyimage_kin.testing.strategies import batch_shapes as batch_shapes
from bodyimage_kin.testing.strategies import cases as cases
from bodyimage_kin.testing.strategies import postures as postures
from bodyimage_kin.testing.strategies import robots as robots

__all__ = [
    "LAWS",
    "Case",
    "JointSpec",
    "Law",
    "LawBroken",
    "Library",
    "NotOffered",
    "RobotSpec",
    "Truth",
    "batch_shapes",
    "cases",
    "laws",
    "oracle",
    "postures",
    "robots",
]
