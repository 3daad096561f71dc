"""Scores of learned Jacobians, trajectories and maps: pure functions on arrays."""

from bodyimage_kin.metrics.jacobian import displacement_error as displacement_error
from bodyimage_kin.metrics.jacobian import pooled_relative_error as pooled_relative_error
from bodyimage_kin.metrics.jacobian import relative_error as relative_error
from bodyimage_kin.metrics.jacobian import unit_metric as unit_metric
from bodyimage_kin.metrics.maps import Procrustes as Procrustes
from bodyimage_kin.metrics.maps import folded_cells as folded_cells
from bodyimage_kin.metrics.maps import procrustes as procrustes
from bodyimage_kin.metrics.maps import scores as scores
from bodyimage_kin.metrics.maps import span as span
from bodyimage_kin.metrics.maps import topological_error as topological_error
from bodyimage_kin.metrics.trajectory import curl as curl
from bodyimage_kin.metrics.trajectory import trajectory_rmse as trajectory_rmse
from bodyimage_kin.metrics.trajectory import velocity_correlation as velocity_correlation
from bodyimage_kin.metrics.trajectory import velocity_nrmse as velocity_nrmse
