"""Published studies, each a grid of cells and a judgement of what comes out."""
