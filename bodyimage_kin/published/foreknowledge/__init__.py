"""Foreknowledge: the error on the face, foretold before the face is touched.

What a robot learned of its hand in sight is used where it cannot look. Can it know beforehand how wrong it will be
there? Predictors are given the experience and the joints felt while touching; what they say is held against the error
that only an onlooker can measure, always in conditions that they were not calibrated on.
"""

from bodyimage_kin.published.foreknowledge.arms import CalibratedArm as CalibratedArm
from bodyimage_kin.published.foreknowledge.arms import PerturbedArms as PerturbedArms
from bodyimage_kin.published.foreknowledge.cell import Cell as Cell
from bodyimage_kin.published.foreknowledge.cell import Failed as Failed
from bodyimage_kin.published.foreknowledge.cell import Settings as Settings
from bodyimage_kin.published.foreknowledge.conditions import CONDITIONS as CONDITIONS
from bodyimage_kin.published.foreknowledge.conditions import Condition as Condition
from bodyimage_kin.published.foreknowledge.evaluate import Combination as Combination
from bodyimage_kin.published.foreknowledge.evaluate import PostureScore as PostureScore
from bodyimage_kin.published.foreknowledge.evaluate import Score as Score
from bodyimage_kin.published.foreknowledge.evaluate import evaluate as evaluate
from bodyimage_kin.published.foreknowledge.evaluate import evaluate_by_posture as evaluate_by_posture
from bodyimage_kin.published.foreknowledge.evaluate import leave_one_condition_out as leave_one_condition_out
from bodyimage_kin.published.foreknowledge.evaluate import r2 as r2
from bodyimage_kin.published.foreknowledge.evaluate import slope as slope
from bodyimage_kin.published.foreknowledge.known import Foresight as Foresight
from bodyimage_kin.published.foreknowledge.known import Known as Known
from bodyimage_kin.published.foreknowledge.known import PlausibleTruths as PlausibleTruths
from bodyimage_kin.published.foreknowledge.known import Predictor as Predictor
from bodyimage_kin.published.foreknowledge.predictors import ExcitationDeficit as ExcitationDeficit
from bodyimage_kin.published.foreknowledge.predictors import GaussianProcessPosterior as GaussianProcessPosterior
from bodyimage_kin.published.foreknowledge.predictors import MeanPostureDistance as MeanPostureDistance
from bodyimage_kin.published.foreknowledge.run import NothingCame as NothingCame
from bodyimage_kin.published.foreknowledge.run import markdown as markdown
from bodyimage_kin.published.foreknowledge.run import run as run
from bodyimage_kin.published.foreknowledge.run import summarise as summarise
from bodyimage_kin.published.foreknowledge.run import write_summary as write_summary
