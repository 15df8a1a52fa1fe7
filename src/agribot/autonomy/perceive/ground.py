"""Where the pixels of a camera image meet the ground."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from agribot.autonomy.perceive.crop_cover import CoverGrid
from agribot.autonomy.perceive.far_view import FarView
from agribot.autonomy.perceive.weed_scores import ScoreGrid
from agribot.core.errors import PerceptionError
from agribot.core.lens import distort, undistort
from agribot.core.messages import FloatArray
from agribot.core.robot import CameraSpec

# A ray that sinks less than this per metre meets the ground too far away and counts as sky.
MIN_SINK_RATIO = 1e-3
# Half of a big plant: closer to the image edge, it would be cut.
VIEW_MARGIN_M = 0.2
MAX_LENS_ERROR_PX = 0.05


class HorizonError(PerceptionError):
    """A pixel looks at or above the horizon and never meets the ground."""


def pixels_to_ground(
    pixels_px: FloatArray, k_px: FloatArray, body_from_camera: FloatArray
) -> FloatArray:
    """Intersect pixel rays with the flat ground plane z_body = 0.

    Args:
        pixels_px: (N, 2) columns u right, v down, from the centre of the top left pixel.
        k_px: (3, 3) pinhole matrix of the undistorted image.
        body_from_camera: (4, 4) pose of the optical frame in the body frame.
    Returns: (N, 2) x_body_m, y_body_m of each pixel.
    Raises: HorizonError: some ray points at or above the horizon.
    Source: Hartley & Zisserman 2004, section 8.1.
    """
    ground_body_m = _intersect(pixels_px, k_px, body_from_camera)
    sky = np.isnan(ground_body_m[:, 0])
    if sky.any():
        u_px, v_px = pixels_px[np.argmax(sky)]
        raise HorizonError(
            f"{int(sky.sum())} of {len(pixels_px)} pixels look above the horizon, the first at "
            f"u {u_px:.1f}, v {v_px:.1f}; pass only pixels below it or check the camera pose"
        )
    return ground_body_m


def ground_to_pixels(
    ground_body_m: FloatArray, k_px: FloatArray, body_from_camera: FloatArray
) -> FloatArray:
    """Project points of the ground, (N, 2), to pixels (N, 2); NaN behind the camera."""
    count = len(ground_body_m)
    points = np.column_stack([ground_body_m, np.zeros(count), np.ones(count)])
    p_camera_m = points @ np.linalg.inv(body_from_camera).T
    depth_m = np.where(p_camera_m[:, 2] > 0.0, p_camera_m[:, 2], np.nan)
    projected: FloatArray = (p_camera_m[:, :3] @ k_px.T)[:, :2] / depth_m[:, None]
    return projected


def _intersect(pixels_px: FloatArray, k_px: FloatArray, body_from_camera: FloatArray) -> FloatArray:
    """As `pixels_to_ground`, with NaN for rays that never meet the ground."""
    rays_px = np.column_stack([pixels_px, np.ones(len(pixels_px))])
    rays_camera = rays_px @ np.linalg.inv(k_px).T
    rays_body = rays_camera @ body_from_camera[:3, :3].T
    x_m, y_m, z_m = body_from_camera[:3, 3]
    sink = -rays_body[:, 2] / np.linalg.norm(rays_body, axis=1)
    distance_ratio = np.where(
        sink > MIN_SINK_RATIO, z_m / np.where(sink > MIN_SINK_RATIO, -rays_body[:, 2], 1.0), np.nan
    )
    return np.column_stack(
        [x_m + distance_ratio * rays_body[:, 0], y_m + distance_ratio * rays_body[:, 1]]
    )


def _straighten(pixels_px: FloatArray, camera: CameraSpec) -> FloatArray:
    """Find the pinhole's pixels of the lens's pixels (N, 2).

    Raises: PerceptionError: the distortion has no inverse over the whole picture.
    """
    if not any(camera.distortion):
        return pixels_px
    centre_px, focal_px = camera.matrix()[:2, 2], camera.focal_px
    seen = (pixels_px - centre_px) / focal_px
    ideal = undistort(seen, camera.distortion)
    error_px = float(np.abs(distort(ideal, camera.distortion) - seen).max()) * focal_px
    if error_px > MAX_LENS_ERROR_PX:
        raise PerceptionError(
            f"the lens distortion {camera.distortion} cannot be undone over the whole picture: "
            f"{error_px:.3g} px are left, the limit is {MAX_LENS_ERROR_PX}; calibrate the camera"
        )
    straight: FloatArray = ideal * focal_px + centre_px
    return straight


def find_rays(camera: CameraSpec, shape: tuple[int, int]) -> FloatArray:
    """Find the directions (h, w, 3) in the optical frame into which cells (h, w) of a picture look.

    Raises: PerceptionError: the lens distortion cannot be undone.
    """
    pixels_px = _place_cells(camera, shape, 0.0, 0)
    straight = _straighten(pixels_px, camera)
    rays_px = np.column_stack([straight, np.ones(len(straight))])
    rays: FloatArray = (rays_px @ np.linalg.inv(camera.matrix()).T).reshape(*shape, 3)
    return rays


def _place_cells(
    camera: CameraSpec, shape: tuple[int, int], offset_px: float, extra: int
) -> FloatArray:
    """Place (h + extra, w + extra) cells of a picture, shifted by `offset_px` cells: (N, 2) px."""
    height, width = shape
    u_px = (np.arange(width + extra) + offset_px + 0.5) * (camera.width_px / width) - 0.5
    v_px = (np.arange(height + extra) + offset_px + 0.5) * (camera.height_px / height) - 0.5
    places: FloatArray = np.stack(np.meshgrid(u_px, v_px), axis=-1).reshape(-1, 2)
    return places


class GroundLookup:
    """Ground position and ground area of every pixel of a class map, computed once.

    The camera's lens distortion is taken out: pixels are those of the picture as it is taken.

    Attributes, all (h, w) of the class map, NaN (area: 0) above the horizon:
        x_body_m, y_body_m: where the pixel centre meets the ground.
        range_m: horizontal distance from the camera.
        area_m2: ground covered by the pixel.
        footprint_m: longer side of the pixel on the ground.
    `camera_xyz_body_m` is the camera's position; `view_body_m` the corners, counter-clockwise,
    of the ground within `max_range_m` of it on which a small plant is seen whole; `cover_grid`
    puts the pixels within that range into cells, `score_grid` what a network says about stems.
    `far_view` is the ground on which rows far away are seen, None of a camera that looks down.
    """

    def __init__(
        self,
        camera: CameraSpec,
        body_from_camera: FloatArray,
        map_shape: tuple[int, int],
        max_range_m: float,
        row_spacing_m: float | None = None,
    ) -> None:
        """Compute the ground of each pixel; rows of the field are `row_spacing_m` apart, if known.

        Raises: PerceptionError: the camera is not above the ground, or sees none within range.
        """
        if body_from_camera[2, 3] <= 0.0:
            raise PerceptionError(
                f"camera is {body_from_camera[2, 3]:.3f} m over the ground; it must be above "
                "it to see plants: check the camera joint of the robot description"
            )
        self.camera = camera
        self.map_shape = map_shape
        self.max_range_m = max_range_m
        self.camera_xyz_body_m = body_from_camera[:3, 3].copy()
        corners = self._grid(body_from_camera, offset_px=-0.5, extra=1)
        centres = self._grid(body_from_camera, offset_px=0.0, extra=0)
        self.x_body_m: npt.NDArray[np.float32] = centres[..., 0].astype(np.float32)
        self.y_body_m: npt.NDArray[np.float32] = centres[..., 1].astype(np.float32)
        self.range_m = np.hypot(
            self.x_body_m - self.camera_xyz_body_m[0], self.y_body_m - self.camera_xyz_body_m[1]
        )
        down = corners[1:, :-1] - corners[:-1, :-1]
        right = corners[:-1, 1:] - corners[:-1, :-1]
        self.area_m2 = np.nan_to_num(
            np.abs(right[..., 0] * down[..., 1] - right[..., 1] * down[..., 0])
        ).astype(np.float32)
        self.footprint_m = np.maximum(
            np.linalg.norm(down, axis=-1), np.linalg.norm(right, axis=-1)
        ).astype(np.float32)
        self.view_body_m = self._view_polygon()
        self.cover_grid = CoverGrid(
            self.x_body_m, self.y_body_m, self.range_m <= max_range_m, self.camera_xyz_body_m
        )
        self.score_grid = ScoreGrid(self.x_body_m, self.y_body_m, self.range_m)
        self.far_view = FarView.open(
            self.x_body_m, self.y_body_m, self.range_m, self.camera_xyz_body_m, row_spacing_m
        )

    def _grid(self, body_from_camera: FloatArray, offset_px: float, extra: int) -> FloatArray:
        """Ground points, (h + extra, w + extra, 2), of map pixels shifted by `offset_px`."""
        height, width = self.map_shape
        grid = _place_cells(self.camera, self.map_shape, offset_px, extra)
        points = _intersect(_straighten(grid, self.camera), self.camera.matrix(), body_from_camera)
        return points.reshape(height + extra, width + extra, 2)

    def _view_polygon(self) -> tuple[tuple[float, float], ...]:
        seen = self.range_m <= self.max_range_m
        points = np.column_stack([self.x_body_m[seen], self.y_body_m[seen]]).astype(np.float64)
        if len(points) < 3:
            raise PerceptionError(
                f"camera sees no ground within {self.max_range_m:.2f} m; tilt it down in the "
                "robot description or raise perception.max_range_m"
            )
        return tuple((float(x), float(y)) for x, y in _thin(_surround_deep(points)))


def _surround_deep(points: FloatArray) -> FloatArray:
    """Return the corners (N, 2), counter-clockwise, around the points deep enough in their hull."""
    import shapely

    # One line through all of them: a point each would be very many objects for the same hull.
    hull = shapely.convex_hull(shapely.linestrings(points))
    deep = shapely.buffer(hull, -VIEW_MARGIN_M)
    shapely.prepare(deep)
    inside = points[shapely.contains_xy(deep, points)]
    if len(inside) >= 3:
        hull = shapely.convex_hull(shapely.linestrings(inside))
    corners: FloatArray = shapely.get_coordinates(shapely.orient_polygons(hull))
    return corners[:-1]


def _thin(polygon: FloatArray, tolerance_m: float = 0.01) -> FloatArray:
    """Drop the corners that lie within `tolerance_m` of the line between their neighbours."""
    kept = list(polygon)
    index = 0
    while index < len(kept) and len(kept) > 3:
        before, corner, after = kept[index - 1], kept[index], kept[(index + 1) % len(kept)]
        side, arm = after - before, corner - before
        off_m = abs(side[0] * arm[1] - side[1] * arm[0]) / max(np.linalg.norm(side), 1e-12)
        if off_m < tolerance_m:
            del kept[index]
        else:
            index += 1
    return np.array(kept)
