"""Recordings: what the body felt over time, with the simulator's truth kept apart."""

from bodyimage_kin.recordings.files import read_recording as read_recording
from bodyimage_kin.recordings.files import write_recording as write_recording
from bodyimage_kin.recordings.schema import check as check
from bodyimage_kin.recordings.schema import experience as experience
