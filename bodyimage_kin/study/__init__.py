"""Studies: grids of independent cells, worked off in processes."""
