/** Everything that crosses the wire between the page and the robot's server. SI units, map frame = ENU metres. */

export type Vec2 = [number, number]
export type Seat = 'you' | 'free' | 'other'
export type Mode = 'mission' | 'paused' | 'teleop' | 'stopped' | 'waiting' | 'done' | 'replay'
export type Level = 'info' | 'warn' | 'fault'
export type MissionAction = 'start' | 'pause' | 'resume' | 'cancel' | 'skip_row' | 'return_home'

/** id, class (0 weed, 1 crop), x, y, std_m, confidence, area_m2, sightings, first_s, last_s, treated_s */
export type Weed = [
  id: number,
  cls: number,
  x: number,
  y: number,
  stdM: number,
  confidence: number,
  areaM2: number,
  sightings: number,
  firstS: number,
  lastS: number,
  treatedS: number | null,
]

export interface LogEvent {
  t: number
  level: Level
  source: string
  text: string
}
export interface PathData {
  xy: Vec2[]
  row: number[]
}
export interface Mission {
  state: string
  reason: string
  row: number | null
  rows_total: number
  rows_done: number[]
  s_m: number
  length_m: number
  eta_s: number | null
  wp_total: number
  wp_reached: number
  leg?: string
  refusal?: string
}
export interface Replay {
  name: string
  t_s: number
  start_s: number
  end_s: number
  speed: number
}
export interface State {
  k: 's'
  e: number
  n: number
  t: number
  /** The robot's steady clock when it was as told here. */
  mono_ms: number
  pose: [x: number, y: number, yaw: number] | null
  std: [posM: number, yawRad: number] | null
  vel: Vec2
  cmd: Vec2
  joints: number[]
  gnss: { lat: number; lon: number; q: number | string; std: number } | null
  mission: Mission | null
  mode: Mode
  stop: string
  reason: string
  battery: { v: number; pct: number | null } | null
  att?: [roll: number, pitch: number] | null
  weeds: number
  rtf: number | null
  xte_m: number | null
  nozzles: boolean[]
  sig: number[][]
  replay?: Replay | null
  /** The folder that is being written, empty while nothing is recorded. */
  recording?: string
  /** A calibration that is under way or has ended and is not put aside yet. */
  calibration?: Calibrating | null
}

export interface Calibrating {
  kind: string
  phase: 'driving' | 'computing' | 'found' | 'failed'
  motion: string
  share: number
  reason: string
  /** Of the compass: which directions it has seen so far. */
  directions: boolean[] | null
}

/** What grows, piece by piece; `e` names the channel and the stretch of it that it belongs to. */
export type Growth =
  | { k: 'traj'; e: number; first: number; xy: Vec2[] }
  | ({ k: 'path'; e: number; first: number } & PathData)
  | { k: 'weeds'; e: number; rev: number; set: Weed[]; gone: number[] }
  | { k: 'events'; e: number; events: LogEvent[] }

/** The beginning of everything that is shown from now on; what is left of it follows in pieces. */
export interface Snapshot {
  k: 'snap'
  e: number
  source: string
  name: string
  traj: { first: number; xy: Vec2[] }
  weeds: { rev: number; all: Weed[] }
  path: PathData
  events: LogEvent[]
  signals: { names: string[]; units: string[] }
}

export type ServerMessage =
  | {
      k: 'hello'
      run: number
      session: string
      id?: string
      seat: Seat
      holder: string
      clients: number
      source: string
    }
  | Snapshot
  | State
  | Growth
  | { k: 'live'; mode: Mode; stop: string }
  | { k: 'seat'; seat: Seat; holder: string; clients: number }
  | { k: 'field' }
  | { k: 'ack'; id: string | null; ok: boolean; reason: string }
  | { k: 'pong'; c: number; mono_ms: number; wall_ms: number }
  | { k: 'bye'; reason: string }

/** Commands that the server answers with an ack. */
export type Command =
  | { k: 'clear_stop' }
  | { k: 'mission'; action: MissionAction }
  | { k: 'goto'; x: number; y: number; yaw: number | null }
  | { k: 'pose_estimate'; x: number; y: number; yaw: number }
  | { k: 'point'; x: number; y: number }
  | { k: 'record'; action: 'start' | 'stop' }
  | { k: 'mark'; text: string }
  | { k: 'shape'; what: 'polygon' | 'route'; xy: Vec2[] }

export type ClientMessage =
  | (Command & { id: string })
  | { k: 'ping'; c: number }
  | { k: 'name'; name: string }
  | { k: 'take'; force: boolean }
  | { k: 'release' }
  | { k: 'got'; n: number }
  | { k: 'drive'; seq: number; v: number; w: number; mono_ms?: number }
  | { k: 'scale'; value: number }
  | { k: 'stop'; id: string }

const KINDS = new Set([
  'hello',
  'snap',
  's',
  'traj',
  'path',
  'weeds',
  'events',
  'live',
  'seat',
  'field',
  'ack',
  'pong',
  'bye',
])

/** The message in one text frame, or null for anything that is not one of ours. */
export function parseMessage(text: string): ServerMessage | null {
  let value: unknown
  try {
    value = JSON.parse(text)
  } catch {
    return null
  }
  if (typeof value !== 'object' || value === null) return null
  const kind = (value as { k?: unknown }).k
  return typeof kind === 'string' && KINDS.has(kind) ? (value as ServerMessage) : null
}

export interface CameraPacket {
  kind: 'image' | 'mask'
  level: number
  frame: number
  wallMs: number
  file: Uint8Array<ArrayBuffer>
}

const CAMERA_HEADER_BYTES = 16

/** One binary frame of the camera socket, or null when it is too short or of an unknown kind. */
export function parseCameraPacket(buffer: ArrayBuffer): CameraPacket | null {
  if (buffer.byteLength <= CAMERA_HEADER_BYTES) return null
  const view = new DataView(buffer)
  const kind = view.getUint8(0)
  if (kind > 1) return null
  return {
    kind: kind === 0 ? 'image' : 'mask',
    level: view.getUint8(1),
    frame: view.getUint32(4),
    wallMs: view.getFloat64(8),
    file: new Uint8Array(buffer, CAMERA_HEADER_BYTES),
  }
}

// ---- HTTP

export interface Session {
  version: string
  run: number
  profile: string
  source: 'sim' | 'hardware' | 'replay' | 'description'
  role: 'operator' | 'viewer'
  needs_login: boolean
  lan_url: string | null
  qr_svg: string | null
  camera: boolean
  screens: string[]
}
export interface Field {
  name: string
  datum: { lat_deg: number; lon_deg: number }
  datum_source?: string
  rows: { index: number; start_map_m: Vec2; end_map_m: Vec2; points_map_m: Vec2[] }[]
  boundary_map_m: Vec2[] | null
  obstacles_map_m?: Vec2[][]
  waypoints_map_m: Vec2[]
  start_map_m: Vec2 | null
}
export interface Robot {
  name: string
  urdf_url: string
  footprint_body_m: Vec2[]
  max_speed_mps: number
  max_yaw_rate_radps: number
  camera: { width_px: number; height_px: number; body_from_camera: number[]; hfov_rad?: number } | null
  wheel_joints: string[]
}
export interface Recording {
  name: string
  utc: string
  size_bytes: number
  duration_s: number | null
  profile: string | null
  ok: boolean | null
  reason: string
  files: string[]
}
/** A frame kept on the robot for training, and how many lie there. */
export interface KeptFrame {
  folder: string
  image: string
  count: number
}

export interface Recordings {
  disk_free_bytes: number
  current: string | null
  recordings: Recording[]
}
export type SettingValue = number | boolean | string
export interface Setting {
  key: string
  value: SettingValue
  default: SettingValue
  type: 'number' | 'boolean' | 'string' | 'choice'
  min: number | null
  max: number | null
  choices: string[] | null
  unit: string
  live: boolean
  about: string
}
export interface Settings {
  groups: { name: string; keys: Setting[] }[]
}
export interface SettingsReply {
  applied: Record<string, SettingValue>
  refused: Record<string, string>
}
export interface CalibrationKind {
  name: string
  title: string
  about: string
  ground: string
  duration_s: number
}
export interface CalibrationChange {
  label: string
  unit: string
  before: number | null
  after: number
  std: number | null
}
export interface CalibrationFound {
  ok: boolean
  reasons: string[]
  changes: CalibrationChange[]
  settings: string[]
  errors_deg: [ByDirection, ByDirection] | null
}
export type ByDirection = (number | null)[]
export interface Calibrations {
  kinds: CalibrationKind[]
  now: Calibrating | null
  found: CalibrationFound | null
  file: string
  settings: string[]
  broken: string
  can_undo: boolean
}
export interface HealthCheck {
  name: string
  state: 'ok' | 'warn' | 'fault'
  value: string | number | null
  text: string
  advice: string
}
export interface Health {
  checks: HealthCheck[]
  rates: { topic: string; expected_hz: number | null; measured_hz: number | null }[]
  cpu_ratio: number | null
  memory_bytes: number | null
  log: LogEvent[]
}
export interface MapSource {
  name: string
  url: string
  minzoom: number
  maxzoom: number
  bounds: [number, number, number, number] | null
  attribution: string | null
}
/** A configuration of mapviz: displays from the lowest to the topmost, and what has no counterpart. */
export interface ImportedView {
  displays: {
    type: string
    title: string
    source: string
    options: Record<string, SettingValue>
    visible: boolean
    opacity: number
  }[]
  left_out: { name: string; why: string }[]
  view: { target: 'map' | 'position' | 'heading'; turn: number }
}
/** The way to a goal before it is sent; without numbers where the robot was not asked. */
export interface Way {
  xy: Vec2[]
  length_m: number | null
  time_s: number | null
}
export interface PlanReply {
  ok: boolean
  reasons: { text: string; at_map_m: Vec2 | null }[]
  length_m: number
  area_m2: number
  time_s: number
  path: Vec2[]
}
export interface FormField {
  type?: string
  default?: SettingValue
  enum?: string[]
  minimum?: number
  maximum?: number
  description?: string
  title?: string
}
export interface FormSchema {
  $ref?: string
  $defs?: Record<string, FormSchema>
  properties?: Record<string, FormField>
  required?: string[]
}
export interface Panel {
  id: string
  title: string
  kind: 'layer' | 'plot' | 'form' | 'image' | 'button' | 'listener'
  fields?: string[]
  schema?: FormSchema
  refresh_s?: number
  needs_seat?: boolean
  /** Of a layer: which kind of display draws it, and how. */
  type?: string
  style?: Record<string, SettingValue>
  draw_order?: number
  visible?: boolean
  /** Of a listener: the shapes it wants to hear of. */
  what?: 'point' | 'polygon' | 'route'
}
