"""Studies: grids of independent cells, worked off in processes."""

from bodyimage_kin.study.study import Study as Study
from bodyimage_kin.study.summary import chain as chain
from bodyimage_kin.study.summary import compare as compare
from bodyimage_kin.study.summary import failures as failures
from bodyimage_kin.study.summary import summarise as summarise
