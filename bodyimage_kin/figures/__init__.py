"""Figures: functions that draw on given axes and return them.

All are called alike: what is drawn first (a body, a recording, results), then ``ax``, the axes to draw on. Without
``ax`` a drawing gets a figure of its own, which pyplot knows. Metres are shown as millimetres, other units as they are;
an image is drawn as the eye sees it, x to the right and y down.

Several drawings side by side are a :func:`row`; other figures are made of :func:`panels` inside :func:`style`, and
finished by :func:`letters` and :func:`legend`. :func:`save` writes them. Names are shown as :func:`label` says.
"""

from bodyimage_kin.figures._errors import attribution as attribution
from bodyimage_kin.figures._errors import dose_response as dose_response
from bodyimage_kin.figures._errors import error_by_distance as error_by_distance
from bodyimage_kin.figures._errors import errors as errors
from bodyimage_kin.figures._errors import score_chain as score_chain
from bodyimage_kin.figures._foreknowledge import predicted_errors as predicted_errors
from bodyimage_kin.figures._foreknowledge import r2_bars as r2_bars
from bodyimage_kin.figures._layout import DOUBLE_COLUMN as DOUBLE_COLUMN
from bodyimage_kin.figures._layout import SINGLE_COLUMN as SINGLE_COLUMN
from bodyimage_kin.figures._layout import legend as legend
from bodyimage_kin.figures._layout import letters as letters
from bodyimage_kin.figures._layout import panels as panels
from bodyimage_kin.figures._layout import row as row
from bodyimage_kin.figures._maps import learning as learning
from bodyimage_kin.figures._maps import posture_map as posture_map
from bodyimage_kin.figures._maps import tactile_map as tactile_map
from bodyimage_kin.figures._marks import decades as decades
from bodyimage_kin.figures._paths import trajectories as trajectories
from bodyimage_kin.figures._paths import velocities as velocities
from bodyimage_kin.figures._recording import recording as recording
from bodyimage_kin.figures._robot import joints as joints
from bodyimage_kin.figures._robot import postures as postures
from bodyimage_kin.figures._robot import robot as robot
from bodyimage_kin.figures._saving import save as save
from bodyimage_kin.figures._saving import svg as svg
from bodyimage_kin.figures._saving import values as values
from bodyimage_kin.figures._screen import virtual_screen as virtual_screen
from bodyimage_kin.figures._sight import hand_image as hand_image
from bodyimage_kin.figures._sight import line_of_sight as line_of_sight
from bodyimage_kin.figures._skin import face as face
from bodyimage_kin.figures._skin import grid as grid
from bodyimage_kin.figures._skin import skin as skin
from bodyimage_kin.figures._style import looks as looks
from bodyimage_kin.figures._style import style as style
from bodyimage_kin.figures.labels import drawn as drawn
from bodyimage_kin.figures.labels import label as label
from bodyimage_kin.figures.labels import labelled as labelled

__all__ = [
    "DOUBLE_COLUMN",
    "SINGLE_COLUMN",
    "attribution",
    "decades",
    "dose_response",
    "drawn",
    "error_by_distance",
    "errors",
    "face",
    "grid",
    "hand_image",
    "joints",
    "label",
    "labelled",
    "learning",
    "legend",
    "letters",
    "line_of_sight",
    "looks",
    "panels",
    "posture_map",
    "postures",
    "predicted_errors",
    "r2_bars",
    "recording",
    "robot",
    "row",
    "save",
    "score_chain",
    "skin",
    "style",
    "svg",
    "tactile_map",
    "trajectories",
    "values",
    "velocities",
    "virtual_screen",
]
