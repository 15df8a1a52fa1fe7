/** ROS messages as JSON (what rosbridge or `message_to_ordereddict` give), as far as displays read them. */

import type { Vec2 } from '../wire.ts'

export interface Header {
  frame_id?: string
  stamp?: { sec: number; nanosec: number }
  /** Where the robot found the frame, as a 4 x 4 matrix row by row: in the map, or fixed to the robot. */
  in_map?: number[]
  in_body?: number[]
}
export interface Point3 {
  x: number
  y: number
  z?: number
}
export interface Quaternion {
  x: number
  y: number
  z: number
  w: number
}
export interface Pose {
  position: Point3
  orientation?: Quaternion
}
export interface PoseStamped {
  header?: Header
  pose: Pose
}
export interface NavSatFix {
  header?: Header
  latitude: number
  longitude: number
  position_covariance?: number[]
}
/** gps_common: `track` is in degrees clockwise from north. */
export interface GpsFix extends NavSatFix {
  track?: number
  speed?: number
  err_horz?: number
}
export interface Odometry {
  header?: Header
  pose: { pose: Pose; covariance?: number[] }
}
export interface Imu {
  header?: Header
  orientation: Quaternion
}
export interface RosPath {
  header?: Header
  poses: PoseStamped[]
}
/** marti_nav_msgs: a route and how far along it the robot is, in metres. */
export interface Route {
  header?: Header
  route_points: { pose: Pose }[]
  position_m?: number
}
export interface TransformStamped {
  header?: Header
  child_frame_id?: string
  transform: { translation: Point3; rotation: Quaternion }
}
export interface LaserScan {
  header?: Header
  angle_min: number
  angle_increment: number
  range_min: number
  range_max: number
  ranges: (number | null)[]
  intensities?: number[]
}
export interface PointField {
  name: string
  offset: number
  datatype: number
}
export interface PointCloud2 {
  header?: Header
  fields: PointField[]
  is_bigendian?: boolean
  point_step: number
  width: number
  height: number
  data: Bytes
}
export interface Colour {
  r: number
  g: number
  b: number
  a?: number
}
export interface Marker {
  header?: Header
  ns?: string
  id?: number
  type: number
  action?: number
  pose?: Pose
  scale?: Point3
  color?: Colour
  points?: Point3[]
  colors?: Colour[]
  text?: string
}
export interface MarkerArray {
  markers: Marker[]
}
export interface OccupancyGrid {
  header?: Header
  info: { resolution: number; width: number; height: number; origin?: Pose }
  data: Bytes
}
/** map_msgs/OccupancyGridUpdate */
export interface OccupancyGridUpdate {
  header?: Header
  x: number
  y: number
  width: number
  height: number
  data: Bytes
}
export interface Image {
  header?: Header
  width: number
  height: number
  encoding: string
  step?: number
  is_bigendian?: number
  data: Bytes
}
export interface CompressedImage {
  header?: Header
  format: string
  data: Bytes
}
export interface DisparityImage {
  header?: Header
  image: Image
  min_disparity: number
  max_disparity: number
}
export interface TexturedMarker {
  header?: Header
  pose: Pose
  resolution: number
  alpha?: number
  image: Image | CompressedImage
}
export interface TexturedMarkerArray {
  markers: TexturedMarker[]
}
export interface NumberMessage {
  data: number
}
export interface TextMessage {
  data: string
}
/** Bytes as base64 text (rosbridge) or as numbers. */
export type Bytes = string | number[]

export function bytesOf(data: Bytes): Uint8Array<ArrayBuffer> {
  return typeof data === 'string'
    ? Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0))
    : Uint8Array.from(data, (value) => value & 255)
}

export interface Angles {
  roll: number
  pitch: number
  yaw: number
}

export function anglesOf(q: Quaternion | undefined): Angles {
  if (!q) return { roll: 0, pitch: 0, yaw: 0 }
  return {
    roll: Math.atan2(2 * (q.w * q.x + q.y * q.z), 1 - 2 * (q.x * q.x + q.y * q.y)),
    pitch: Math.asin(Math.max(-1, Math.min(1, 2 * (q.w * q.y - q.z * q.x)))),
    yaw: Math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z)),
  }
}

export function ofYaw(yaw: number): Quaternion {
  return { x: 0, y: 0, z: Math.sin(yaw / 2), w: Math.cos(yaw / 2) }
}

/** Robot-fixed frames move with the robot; everything else is the map. */
const BODY_FRAMES = /(^|\/)(base_link|base_footprint|body|chassis|laser|scan|camera)\w*$/

/** Where the frame of a message lies in the map: origin and heading. */
export type FramePose = [x: number, y: number, yaw: number]

export function frameOf(header: Header | undefined, robot: FramePose): FramePose {
  if (header?.in_map) return flat(header.in_map)
  if (header?.in_body) {
    const [x, y, yaw] = flat(header.in_body)
    return [...placed(robot, { x, y }), robot[2] + yaw]
  }
  return BODY_FRAMES.test(header?.frame_id ?? '') ? robot : [0, 0, 0]
}

export function placed([x, y, yaw]: FramePose, p: Point3): Vec2 {
  const c = Math.cos(yaw)
  const s = Math.sin(yaw)
  return [x + c * p.x - s * p.y, y + s * p.x + c * p.y]
}

/** A pose in a frame as a frame of its own. */
export function within(frame: FramePose, pose: Pose | undefined): FramePose {
  if (!pose) return frame
  const [x, y] = placed(frame, pose.position)
  return [x, y, frame[2] + anglesOf(pose.orientation).yaw]
}

/** A transform as seen from above: origin and heading. */
function flat(m: number[]): FramePose {
  return [m[3], m[7], Math.atan2(m[4], m[0])]
}

/** Where points of a frame lie in the map, the frame tilted as it may be, such as that of a camera. */
export function placer(header: Header | undefined, robot: FramePose): (p: Point3) => Vec2 {
  const m = header?.in_map ?? header?.in_body
  if (!m) {
    const frame = frameOf(header, robot)
    return (p) => placed(frame, p)
  }
  const around: FramePose = header?.in_map ? [0, 0, 0] : robot
  return ({ x, y, z = 0 }) =>
    placed(around, { x: m[0] * x + m[1] * y + m[2] * z + m[3], y: m[4] * x + m[5] * y + m[6] * z + m[7] })
}
