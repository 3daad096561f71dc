"""Recordings: what the body felt over time, with the simulator's truth kept apart."""

from bodyimage_kin.recordings.files import read_recording, write_recording
from bodyimage_kin.recordings.from_arrays import recording
from bodyimage_kin.recordings.resampling import resample
from bodyimage_kin.recordings.schema import (
    align,
    canonical_order,
    check,
    experience,
    first_taxel,
    is_scattered,
    joint_names,
    require_aligned,
    without_truth,
)
from bodyimage_kin.recordings.settings import Drag, Noise
from bodyimage_kin.recordings.simulation import simulate, simulate_many

__all__ = [
    "Drag",
    "Noise",
    "align",
    "canonical_order",
    "check",
    "experience",
    "first_taxel",
    "is_scattered",
    "joint_names",
    "read_recording",
    "recording",
    "require_aligned",
    "resample",
    "simulate",
    "simulate_many",
    "without_truth",
    "write_recording",
]
