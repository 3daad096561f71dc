"""Studies: grids of independent cells, worked off in processes."""

from bodyimage_kin.study.study import Study as Study
