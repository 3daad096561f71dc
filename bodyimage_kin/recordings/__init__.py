"""Recordings: what the body felt over time, with the simulator's truth kept apart."""

from bodyimage_kin.recordings.files import read_recording, write_recording
from bodyimage_kin.recordings.schema import check, experience
from bodyimage_kin.recordings.settings import Drag, Noise
from bodyimage_kin.recordings.simulation import simulate, simulate_many

__all__ = [
    "Drag",
    "Noise",
    "check",
    "experience",
    "read_recording",
    "simulate",
    "simulate_many",
    "write_recording",
]
