"""Scores of learned Jacobians, trajectories and maps: pure functions on arrays.

``[unit]`` is the unit of the hand image: m on a virtual screen, px, m in space. Joints count in rad (or m).
"""

from bodyimage_kin.metrics.attribution import Attribution, attribute
from bodyimage_kin.metrics.basin import Basin, servo_basin
from bodyimage_kin.metrics.depth import depth_ratio
from bodyimage_kin.metrics.excitation import Excitation, excitation, motion_metric
from bodyimage_kin.metrics.held_out import HeldOut, hold_out, hold_out_folds
from bodyimage_kin.metrics.jacobian import (
    axis_relative_error,
    column_cosine,
    column_log_norm_ratio,
    displacement_error,
    jacobian_errors,
    log_condition_difference,
    manipulability_ratio,
    pooled_relative_error,
    pooled_scale_free_error,
    relative_error,
    row_space_angles,
    scale_free_error,
    singular_value_ratios,
)
from bodyimage_kin.metrics.maps import (
    Procrustes,
    error_in_space,
    folded_cells,
    permuted,
    procrustes,
    quantization_error,
    scores,
    shuffled_touches,
    span,
    topographic_error,
    topological_error,
)
from bodyimage_kin.metrics.neighbourhoods import continuity, neighbours_kept, trustworthiness
from bodyimage_kin.metrics.observed import (
    LocalSpectrum,
    ObservedError,
    displacements_along,
    image_error,
    local_spectrum,
    noise_floor,
    pair_error,
    predicted_pairs,
    stated_noise,
)
from bodyimage_kin.metrics.servo import critical_gain, locally_stable, monotone, servo_matrix
from bodyimage_kin.metrics.trajectory import curl, trajectory_rmse, velocity_correlation, velocity_nrmse
from bodyimage_kin.metrics.trajectory_split import ErrorSplit, error_split

__all__ = [
    "Attribution",
    "Basin",
    "ErrorSplit",
    "Excitation",
    "HeldOut",
    "LocalSpectrum",
    "ObservedError",
    "Procrustes",
    "attribute",
    "axis_relative_error",
    "column_cosine",
    "column_log_norm_ratio",
    "continuity",
    "critical_gain",
    "curl",
    "depth_ratio",
    "displacement_error",
    "displacements_along",
    "error_in_space",
    "error_split",
    "excitation",
    "folded_cells",
    "hold_out",
    "hold_out_folds",
    "image_error",
    "jacobian_errors",
    "local_spectrum",
    "locally_stable",
    "log_condition_difference",
    "manipulability_ratio",
    "monotone",
    "motion_metric",
    "neighbours_kept",
    "noise_floor",
    "pair_error",
    "permuted",
    "pooled_relative_error",
    "pooled_scale_free_error",
    "predicted_pairs",
    "procrustes",
    "quantization_error",
    "relative_error",
    "row_space_angles",
    "scale_free_error",
    "scores",
    "servo_basin",
    "servo_matrix",
    "shuffled_touches",
    "singular_value_ratios",
    "span",
    "stated_noise",
    "topographic_error",
    "topological_error",
    "trajectory_rmse",
    "trustworthiness",
    "velocity_correlation",
    "velocity_nrmse",
]
