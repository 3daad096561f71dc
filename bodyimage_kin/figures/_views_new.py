@dataclass(frozen=True)
class View:
    """Where the drawing is seen from.

    Attributes:
        look_from: The eye, in the root [m]; for an orthographic view only its direction matters.
        look_to: The point in the middle of the picture, in the root [m].
        up: What is up in the picture, in the root.
        perspective: True scale at ``look_to``, larger when nearer; otherwise orthographic, true scale everywhere.
    """

    look_from: ArrayLike
    look_to: ArrayLike = (0.0, 0.0, 0.0)
    up: ArrayLike = (0.0, 0.0, 1.0)
    perspective: bool = False

    @classmethod
    def around(
        cls,
        target: ArrayLike,
        *,
        azimuth: float | int,
        elevation: float | int,
        distance: float | int = 1.0,
        perspective: bool = False,
    ) -> View:
        """The view of ``target`` (root, [m]) from ``distance`` [m] at azimuth (x to y) and elevation [degrees]."""
        a, e = np.radians([azimuth, elevation])
        middle = np.asarray(target, dtype=float)
        eye = middle + distance * np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        return cls(tuple(eye.tolist()), tuple(middle.tolist()), perspective=perspective)

    def axes(self) -> Float[np.ndarray, "3 3"]:
        """Right, up and forward in the root, as rows.

        Raises:
            InvalidConfig: The eye is at the point it looks to, or looks along ``up``.
        """
        forward = np.subtract(self.look_to, self.look_from)
        right = np.cross(forward, self.up)
        scale = np.linalg.norm(forward) * np.linalg.norm(self.up)
        if not np.linalg.norm(right) > 1e-9 * scale:
            raise InvalidConfig(f"{self} has no direction or looks along its up vector; move look_from or change up")
        forward, right = forward / np.linalg.norm(forward), right / np.linalg.norm(right)
        return np.stack([right, np.cross(right, forward), forward])


def project(points: ArrayLike, view: View) -> tuple[Float[np.ndarray, "*batch 2"], Float[np.ndarray, "*batch"]]:
    """Points on the picture plane and how far away they are.

    Args:
        points: ``(*batch, 3)`` in the root [m].
        view: Where they are seen from.

    Returns:
        Right and up from the middle of the picture [m], and the distance along the line of sight: from the eye in
        perspective, from ``look_to`` otherwise [m]. Points behind a perspective eye are NaN.

    Raises:
        InvalidArray: The last axis is not of length 3.
        InvalidConfig: The view has no direction.
    """
    array = np.asarray(points, dtype=float)
    if array.ndim == 0 or array.shape[-1] != 3:
        raise InvalidArray(f"points have shape {array.shape}; the last axis must be x, y, z")
    along = (array - np.asarray(view.look_to)) @ view.axes().T
    flat, depth = along[..., :2], along[..., 2]
    if view.perspective:
        distance = float(np.linalg.norm(np.subtract(view.look_to, view.look_from)))
        depth = np.where(depth + distance > 0, depth + distance, np.nan)
        flat = flat * (distance / depth)[..., None]
    return flat, depth


def hidden(
    points: ArrayLike, surface: Surface, view: View, *, margin: float | int = 1e-3
) -> Bool[np.ndarray, "points"]:
    """Whether the robot covers each of ``points`` ``(points, 3)`` (root, [m]), seen from the view.

    Args:
        points: The points of a path, taxels ...
        surface: What may cover them.
        view: Where they are seen from.
        margin: How far in front of a point a triangle must be to cover it [m]; taxels lie on triangles.
    """
    flat, depth = project(points, view)
    corners, corner_depth = project(surface.corners, view)
    a, ab, ac = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
    (left, bottom), (right, top) = np.nanmin(flat, 0), np.nanmax(flat, 0)
    low, high = corners.min(1), corners.max(1)
    near = (low[:, 0] <= right) & (high[:, 0] >= left) & (low[:, 1] <= top) & (high[:, 1] >= bottom)
    seen = near & (np.abs(area) > 1e-15)
    a, ab, ac, area, corner_depth = a[seen], ab[seen], ac[seen], area[seen], corner_depth[seen]
    # Seen in perspective it is the inverse of the depth that is linear over a triangle.
    linear = 1 / corner_depth if view.perspective else corner_depth
    covered = np.zeros(len(flat), dtype=bool)
    for index, point in enumerate(flat):
        offset = point - a
        u = (offset[:, 0] * ac[:, 1] - offset[:, 1] * ac[:, 0]) / area
        v = (ab[:, 0] * offset[:, 1] - ab[:, 1] * offset[:, 0]) / area
        inside = (u >= 0) & (v >= 0) & (u + v <= 1)
        met = linear[inside]
        at = met[:, 0] + u[inside] * (met[:, 1] - met[:, 0]) + v[inside] * (met[:, 2] - met[:, 0])
        covered[index] = bool(((1 / at if view.perspective else at) < depth[index] - margin).any())
    return covered


