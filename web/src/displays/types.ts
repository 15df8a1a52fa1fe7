/** The kinds of display that the map knows, one row each: what they read, what can be set, how they are drawn. */

import { CLOUD_OPTIONS, drawSpots, foldCloud, foldScan, SCAN_OPTIONS } from './clouds.ts'
import type { Drawing } from './drawing.ts'
import { drawGeoJson, foldGeoJson } from './features.ts'
import type { ToolId } from './host.ts'
import {
  ATTITUDE_OPTIONS,
  FLOAT_OPTIONS,
  foldAttitude,
  foldDisparity,
  foldImage,
  foldNumber,
  foldRobotPose,
  foldText,
  IMAGE_OPTIONS,
  paintAttitude,
  paintImage,
  paintRobot,
  paintText,
  ROBOT_IMAGE_OPTIONS,
  TEXT_OPTIONS,
} from './instruments.ts'
import type { Surface } from './instruments.ts'
import { drawMarkers, foldMarkers } from './markers.ts'
import type { Option } from './options.ts'
import { amount, choice, colour, number, words } from './options.ts'
import { foldGrid, GRID_OPTIONS, layGrid, layTexture } from './pictures.ts'
import type { Laid } from './pictures.ts'
import type { Setting } from './setting.ts'
import {
  drawFrame,
  drawPath,
  drawRoute,
  drawTrack,
  foldFix,
  foldFrame,
  foldOdometry,
  foldPose,
  FRAME_OPTIONS,
  ODOMETRY_OPTIONS,
  PATH_OPTIONS,
  TRACK_OPTIONS,
} from './tracks.ts'
import { say } from '../say.ts'

/**
 * What a display remembers of earlier messages is made by `fold`; without it, that is the newest message.
 * What messages and memory are is the type's own affair, hence `never`.
 */
type Fold = (state: never, message: never, setting: Setting) => unknown
interface Row {
  id: string
  title: string
  reads: string
  options: Option[]
  fold?: Fold
}
export interface ShapesType extends Row {
  kind: 'shapes'
  needsNoSource?: boolean
  draw: (state: never, draw: Drawing, setting: Setting) => void
}
export interface LaidType extends Row {
  kind: 'laid'
  lay: (state: never, setting: Setting) => Laid | null | Promise<Laid | null>
}
export interface PaintedType extends Row {
  kind: 'painted'
  paint: (state: never, surface: Surface, setting: Setting) => void
}
export interface TilesType extends Row {
  kind: 'tiles'
}
export interface ToolType extends Row {
  kind: 'tool'
  tool: ToolId
}
export type DisplayType = ShapesType | LaidType | PaintedType | TilesType | ToolType

function shapes(
  id: string,
  title: string,
  reads: string,
  options: Option[],
  draw: ShapesType['draw'],
  fold?: Fold,
): ShapesType {
  return { kind: 'shapes', id, title, reads, options, draw, ...(fold ? { fold } : {}) }
}

function painted(
  id: string,
  title: string,
  reads: string,
  options: Option[],
  paint: PaintedType['paint'],
  fold: Fold,
): PaintedType {
  return { kind: 'painted', id, title, reads, options, paint, fold }
}

function tool(id: string, title: string, reads: string, which: ToolId): ToolType {
  return { kind: 'tool', id, title, reads, options: [], tool: which }
}

/** The ids are those of mapviz's plugins; `geojson` is ours. */
export const DISPLAY_TYPES: DisplayType[] = [
  painted(
    'attitude_indicator',
    say('attitude'),
    'sensor_msgs/Imu, nav_msgs/Odometry, geometry_msgs/PoseStamped',
    ATTITUDE_OPTIONS,
    paintAttitude,
    foldAttitude,
  ),
  tool('coordinate_picker', say('coordinatePicker'), say('aTapOnTheMap'), 'coordinates'),
  painted('disparity', say('disparity'), 'stereo_msgs/DisparityImage', IMAGE_OPTIONS, paintImage, foldDisparity),
  tool('draw_polygon', say('drawAPolygon'), say('tapsOnTheMap'), 'polygon'),
  painted('float', say('kindNumber'), 'std_msgs/Float64', FLOAT_OPTIONS, paintText, foldNumber),
  shapes('gps', say('gpsTrack'), 'gps_common/GPSFix', TRACK_OPTIONS, drawTrack, foldFix),
  {
    ...shapes(
      'grid',
      say('kindGrid'),
      say('nothing'),
      [
        choice('frame', say('fixedTo'), 'map', 'base_link'),
        number('x', say('east'), 0, -1000, 1000, 0.1, 'm'),
        number('y', say('north'), 0, -1000, 1000, 0.1, 'm'),
        number('size', say('cell'), 1, 0.01, 100, 0.01, 'm'),
        number('rows', say('gridRows'), 10, 1, 500, 1),
        number('columns', say('columns'), 10, 1, 500, 1),
        colour('#5a5140'),
        number('width', say('lineWidth'), 1, 1, 10, 1, 'px'),
      ],
      drawGrid,
    ),
    needsNoSource: true,
  },
  painted(
    'image',
    say('kindPicture'),
    'sensor_msgs/Image, sensor_msgs/CompressedImage',
    IMAGE_OPTIONS,
    paintImage,
    foldImage,
  ),
  shapes('laserscan', say('laserScan'), 'sensor_msgs/LaserScan', SCAN_OPTIONS, drawSpots, foldScan),
  shapes(
    'marker',
    say('markers'),
    'visualization_msgs/Marker, visualization_msgs/MarkerArray',
    [],
    drawMarkers,
    foldMarkers,
  ),
  tool('measuring', say('measure'), say('tapsOnTheMap'), 'measure'),
  tool('move_base', say('driveToAPlace'), say('aPressAndDrag'), 'goal'),
  shapes('navsat', say('fixes'), 'sensor_msgs/NavSatFix', TRACK_OPTIONS, drawTrack, foldFix),
  {
    kind: 'laid',
    id: 'occupancy_grid',
    title: say('occupancyGrid'),
    reads: 'nav_msgs/OccupancyGrid, map_msgs/OccupancyGridUpdate',
    options: GRID_OPTIONS,
    fold: foldGrid,
    lay: layGrid,
  },
  shapes('odometry', say('odometry'), 'nav_msgs/Odometry', ODOMETRY_OPTIONS, drawTrack, foldOdometry),
  shapes('path', say('kindPath'), 'nav_msgs/Path', PATH_OPTIONS, drawPath),
  tool('plan_route', say('planARoute'), say('tapsOnTheMap'), 'route'),
  tool('point_click_publisher', say('publishAPoint'), say('aTapOnTheMap'), 'point'),
  shapes('pointcloud2', say('pointCloud'), 'sensor_msgs/PointCloud2', CLOUD_OPTIONS, drawSpots, foldCloud),
  shapes('pose', say('kindPose'), 'geometry_msgs/PoseStamped', TRACK_OPTIONS, drawTrack, foldPose),
  painted(
    'robot_image',
    say('pictureOfTheRobot'),
    'geometry_msgs/PoseStamped',
    ROBOT_IMAGE_OPTIONS,
    paintRobot,
    foldRobotPose,
  ),
  shapes(
    'route',
    say('kindRoute'),
    'marti_nav_msgs/Route',
    [...PATH_OPTIONS, colour('#d22f26', 'icon', say('colourOfTheArrow'))],
    drawRoute,
  ),
  painted('string', say('kindText'), 'std_msgs/String', TEXT_OPTIONS, paintText, foldText),
  {
    kind: 'laid',
    id: 'textured_marker',
    title: say('texturedMarker'),
    reads: 'marti_visualization_msgs/TexturedMarker',
    options: [],
    lay: layTexture,
  },
  shapes('tf_frame', say('kindFrame'), 'geometry_msgs/TransformStamped', FRAME_OPTIONS, drawFrame, foldFrame),
  { kind: 'tiles', id: 'tile_map', title: say('tileMap'), reads: say('anImportedMap'), options: [] },
  {
    kind: 'tiles',
    id: 'multires_image',
    title: say('multiResolutionImage'),
    reads: say('anImportedPyramid'),
    options: [],
  },
  shapes(
    'geojson',
    'GeoJSON',
    say('longitudeAndLatitude'),
    [
      colour('#b1128a'),
      number('width_px', say('lineWidth'), 2, 1, 20, 1, 'px'),
      number('radius_px', say('pointSize'), 5, 1, 40, 1, 'px'),
      number('opacity', say('opacity'), 1, 0, 1, 0.05),
    ],
    drawGeoJson,
    foldGeoJson,
  ),
]

export function typeOf(id: string): DisplayType | undefined {
  return DISPLAY_TYPES.find((type) => type.id === id)
}

function drawGrid(_: unknown, draw: Drawing, { options, robot }: Setting): void {
  const [fx, fy, yaw] = words(options, 'frame') === 'map' ? [0, 0, 0] : robot
  const [c, s] = [Math.cos(yaw), Math.sin(yaw)]
  const at = (x: number, y: number): [number, number] => [fx + c * x - s * y, fy + s * x + c * y]
  const [x0, y0, size] = [amount(options, 'x'), amount(options, 'y'), amount(options, 'size')]
  const [rows, columns] = [amount(options, 'rows'), amount(options, 'columns')]
  const look = { color: words(options, 'color'), width: amount(options, 'width') }
  for (let i = 0; i <= columns; i++) draw.line([at(x0 + i * size, y0), at(x0 + i * size, y0 + rows * size)], look)
  for (let i = 0; i <= rows; i++) draw.line([at(x0, y0 + i * size), at(x0 + columns * size, y0 + i * size)], look)
}
