"""Who is next to whom among taxels, how far apart they are along the skin, and which way they face."""

from __future__ import annotations

import numpy as np
import scipy.sparse
import scipy.spatial
from jaxtyping import Float, Int
from scipy.sparse.csgraph import connected_components, shortest_path

__all__ = ["along", "grid_edges", "near_edges", "normals_of", "pieces", "spacing_of"]

Points = Float[np.ndarray, "count 3"]
Edges = Int[np.ndarray, "edges 2"]
_REACH = 2.0
"""Neighbours are nearer than this many spacings."""
_AROUND = 8
"""Taxels from which a normal is computed."""


def grid_edges(rows: int, columns: int) -> Edges:
    """Each taxel of a grid with the one to its right, and with the one below."""
    taxels = np.arange(rows * columns).reshape(rows, columns)
    aside = np.stack([taxels[:, :-1], taxels[:, 1:]], -1).reshape(-1, 2)
    below = np.stack([taxels[:-1], taxels[1:]], -1).reshape(-1, 2)
    return np.concatenate([aside, below])


def spacing_of(positions: Points) -> float:
    """Median distance of a taxel to the next one in another place [m]; 0 of a single place."""
    places = np.unique(positions, axis=0)
    if len(places) < 2:
        return 0.0
    return float(np.median(np.asarray(scipy.spatial.KDTree(places).query(places, k=2)[0])[:, 1]))


def near_edges(positions: Points) -> Edges:
    """Pairs of taxels nearer than two spacings."""
    if len(positions) < 2:
        return np.empty((0, 2), dtype=np.int64)
    pairs = scipy.spatial.KDTree(positions).query_pairs(_REACH * spacing_of(positions), output_type="ndarray")
    return np.asarray(pairs[np.lexsort(pairs.T[::-1])], dtype=np.int64)


def pieces(count: int, edges: Edges) -> tuple[int, Int[np.ndarray, "taxels"]]:
    """Number of pieces of the graph, and the piece of each taxel."""
    found, label = connected_components(_matrix(count, edges, np.ones(len(edges))), directed=False)
    return int(found), label


def along(
    positions: Points, edges: Edges
) -> tuple[Float[np.ndarray, "taxels taxels"], Int[np.ndarray, "taxels taxels"]]:
    """Distances along the graph [m], straight between pieces; and the taxel before the last on the way of each pair.

    Where no way leads, the taxel before is negative.
    """
    lengths = np.linalg.norm(positions[edges[:, 0]] - positions[edges[:, 1]], axis=1)
    # A stored zero is no edge to scipy: taxels in one place are a picometre apart.
    graph = _matrix(len(positions), edges, np.maximum(lengths, 1e-12))
    distances, before = shortest_path(graph, directed=False, return_predecessors=True)
    apart = np.isinf(distances)
    if apart.any():
        distances[apart] = scipy.spatial.distance.cdist(positions, positions)[apart]
    return distances, before


def normals_of(positions: Points, inside: Float[np.ndarray, "3"]) -> Points:
    """Unit normals: the smallest principal axis of a taxel and those around it, away from a point inside of the link.

    Args:
        positions: In the link [m].
        inside: A point inside of the link [m].
    """
    away = positions - inside
    if len(positions) < 3:
        return _unit(away)
    nearest = scipy.spatial.KDTree(positions).query(positions, k=min(_AROUND + 1, len(positions)))[1]
    around = positions[nearest] - positions[nearest].mean(1, keepdims=True)
    normals = np.linalg.svd(around)[2][:, 2]
    return np.asarray(np.where((normals * away).sum(1, keepdims=True) < 0.0, -normals, normals))


def _unit(vectors: Points) -> Points:
    """Unit vectors; z where there is no direction."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(np.where(length > 1e-12, vectors / np.maximum(length, 1e-12), [0.0, 0.0, 1.0]))


def _matrix(count: int, edges: Edges, values: Float[np.ndarray, "edges"]) -> scipy.sparse.csr_matrix:
    return scipy.sparse.coo_matrix((values, (edges[:, 0], edges[:, 1])), (count, count)).tocsr()
