"""The graph of a skin's taxels: who is next to whom, and the skin laid flat with distances kept as well as can be."""

from __future__ import annotations

import numpy as np
import scipy.sparse
from jaxtyping import Float, Int
from scipy.sparse.csgraph import connected_components, shortest_path

from bodyimage_kin.errors import InvalidConfig

_MOST = 4000
"""Taxels of one piece that are laid flat; distances between all pairs are kept in memory."""


def around(
    taxel: int, shape: tuple[int, ...], edges: Int[np.ndarray, "edges 2"], what: str = "the taxel"
) -> Int[np.ndarray, "taxels"]:
    """A taxel and those next to it: by the graph, on a grid (rows, columns) also across corners.

    Raises:
        InvalidConfig: There is no such taxel.
    """
    count = int(np.prod(shape))
    if not 0 <= taxel < count:
        raise InvalidConfig(f"{what} is taxel {taxel}; there are 0 to {count - 1}")
    if len(shape) == 1:
        return np.unique([taxel, *edges[(edges == taxel).any(1)].ravel()])
    row, column = divmod(int(taxel), shape[1])
    return np.arange(count).reshape(shape)[max(0, row - 1) : row + 2, max(0, column - 1) : column + 2].ravel()


def flatten(
    positions: Float[np.ndarray, "taxels 3"],
    edges: Int[np.ndarray, "edges 2"],
    axes: Float[np.ndarray, "2 3"],
) -> Float[np.ndarray, "taxels 2"]:
    """Places in a plane [m] whose distances are those along the graph, as nearly as can be (classical scaling, Isomap).

    Args:
        positions: Of the taxels [m].
        edges: Pairs of neighbours; pieces that no edge joins are laid side by side.
        axes: Which way is right and down in the plane: each piece is turned, or turned over, towards them.
    """
    count = len(positions)
    next_to = scipy.sparse.coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), (count, count)).tocsr()
    # Straight ways to all within three steps: along the edges of a grid alone, a diagonal would be longer by half.
    step = next_to + next_to.T + scipy.sparse.identity(count, format="csr")
    near = scipy.sparse.triu(step @ step @ step, 1).tocoo()
    lengths = np.linalg.norm(positions[near.row] - positions[near.col], axis=1)
    graph = scipy.sparse.coo_matrix((np.maximum(lengths, 1e-12), (near.row, near.col)), (count, count)).tocsr()
    pieces, piece_of = connected_components(graph, directed=False)
    places = np.zeros((count, 2))
    beside = 0.0
    for piece in sorted(range(pieces), key=lambda one: float((positions[piece_of == one] @ axes[0]).mean())):
        taxels = np.flatnonzero(piece_of == piece)
        flat = _scaled(positions[taxels], graph[taxels][:, taxels], axes)
        low, high = flat.min(0), flat.max(0)
        places[taxels] = flat + np.array([beside - low[0], -(low[1] + high[1]) / 2])
        beside += float(high[0] - low[0]) + 0.08 * max(float(np.ptp(positions, axis=0).max()), 1e-9)
    return places - (places.max(0) + places.min(0)) / 2


def _scaled(
    positions: Float[np.ndarray, "taxels 3"], graph: scipy.sparse.csr_matrix, axes: Float[np.ndarray, "2 3"]
) -> Float[np.ndarray, "taxels 2"]:
    projected = (positions - positions.mean(0)) @ axes.T
    if not 3 <= len(positions) <= _MOST:
        return projected
    squared = shortest_path(graph, directed=False) ** 2
    centred = squared - squared.mean(0) - squared.mean(1)[:, None] + squared.mean()
    eigenvalues, vectors = np.linalg.eigh(-centred / 2)
    flat = vectors[:, -2:] * np.sqrt(np.maximum(eigenvalues[-2:], 0.0))
    # Turned as the piece is seen (orthogonal Procrustes), which also settles the signs that eigenvectors leave open.
    left, _, right = np.linalg.svd(flat.T @ projected)
    return flat @ (left @ right)
