/** Written by `make generate` from `src/agribot/ui/wire.py`: change that one. SI units; the map is East-North-Up. */

export type GateState = 'standby' | 'checking' | 'driving' | 'slowed' | 'held' | 'stopped' | 'by hand'

export type SensorState = 'fine' | 'silent' | 'late' | 'frozen' | 'contradicted'

export type MissionAction =
  | 'start'
  | 'pause'
  | 'resume'
  | 'cancel'
  | 'skip_row'
  | 'return_home'
  | 'nudge_left'
  | 'nudge_right'

export type RecordingAction = 'start' | 'stop'

export type ShapeKind = 'polygon' | 'route'

export type Vec2 = [number, number]

export type Mode = 'mission' | 'paused' | 'teleop' | 'stopped' | 'waiting' | 'done' | 'replay'

export type Role = 'operator' | 'viewer'

export type SeatState = 'you' | 'free' | 'other'

export type EventLevel = 'info' | 'warn' | 'fault'

export type CheckState = 'ok' | 'warn' | 'fault'

export type CasterState = 'asked' | 'connected' | 'failed'

export type CalibrationPhase = 'driving' | 'computing' | 'found' | 'failed'

export type SettingType = 'number' | 'boolean' | 'string' | 'choice'

export type SettingValue = number | boolean | string

export type PanelKind = 'layer' | 'plot' | 'form' | 'image' | 'button' | 'listener'

export type Sample = (number | null)[]

export type PageRequest =
  | UseName
  | TakeSeat
  | LeaveSeat
  | ScaleSpeed
  | PressStop
  | ClearStop
  | ControlMission
  | ControlRecording
  | MarkMoment
  | GoTo
  | CorrectPose
  | PointOut
  | DrawShape

export type PageMessage = PageRequest | Ping | Receipt | DriveByHand

export type Growth = TracePiece | PathPiece | WeedChanges | NewEvents | ReceiverState

export type ServerMessage =
  | Growth
  | Hello
  | Snapshot
  | State
  | LiveState
  | SeatChange
  | FieldChange
  | Verdict
  | Pong
  | Bye

/** Stand still until the stop is cleared; anybody may say so. */
export interface PressStop {
  kind: 'press_stop'
  id?: string
}

/** Let the robot go after a stop. */
export interface ClearStop {
  kind: 'clear_stop'
  id?: string
}

/**
 * Do `action`.
 *
 * "start" restarts a mission that has ended and resumes one that is paused. The two nudges move
 * the line of the row under the robot aside, a step each.
 */
export interface ControlMission {
  kind: 'control_mission'
  id?: string
  action: MissionAction
}

export interface ControlRecording {
  kind: 'control_recording'
  id?: string
  action: RecordingAction
}

/** Mark this moment in the recording. */
export interface MarkMoment {
  kind: 'mark_moment'
  id?: string
  text?: string
}

/** Drive to a place, as RViz's 2D Goal; answered when the mission took or refused it. */
export interface GoTo {
  kind: 'go_to'
  id?: string
  x_map_m: number
  y_map_m: number
  yaw_map_rad?: number | null
}

/** Where a robot at rest stands, as RViz's 2D Pose Estimate, with one sigma of each. */
export interface CorrectPose {
  kind: 'correct_pose'
  id?: string
  x_map_m: number
  y_map_m: number
  yaw_map_rad: number
  std_m?: number
  std_rad?: number
}

/** A place that somebody clicked, for the recording. */
export interface PointOut {
  kind: 'point_out'
  id?: string
  x_map_m: number
  y_map_m: number
}

/** A polygon or route that somebody drew, for the recording. */
export interface DrawShape {
  kind: 'draw_shape'
  id?: string
  shape: ShapeKind
  corners_map_m: Vec2[]
}

/** Answered at once by a pong; `sent_ms` is the sender's own clock. */
export interface Ping {
  kind: 'ping'
  sent_ms: number
}

/** How many messages the page has received since it was opened. */
export interface Receipt {
  kind: 'receipt'
  count: number
}

/** What the others are shown as the name of this page's operator. */
export interface UseName {
  kind: 'use_name'
  id?: string
  name: string
}

/** Operate the robot from now on; `force` takes the seat from its holder. */
export interface TakeSeat {
  kind: 'take_seat'
  id?: string
  force?: boolean
}

/** Hand the operator's seat back. */
export interface LeaveSeat {
  kind: 'leave_seat'
  id?: string
}

/** A body twist that holds for a moment; `mono_ms` is the robot's clock when it was wanted. */
export interface DriveByHand {
  kind: 'drive_by_hand'
  v_mps: number
  yaw_rate_radps: number
  mono_ms?: number | null
}

/** The share of the robot's speed that this page's hand may use. */
export interface ScaleSpeed {
  kind: 'scale_speed'
  id?: string
  ratio: number
}

/** The newest fix; `quality` has the numbers of NMEA GGA field 6; 0 is no fix. */
export interface GnssState {
  lat_deg: number
  lon_deg: number
  quality: number
  std_m: number | null
}

export interface BatteryState {
  voltage_v: number
  charge_pct: number | null
}

/** How far the mission is: `row` is -1 between rows, `eta_s` null unless it drives. */
export interface MissionProgress {
  state: string
  reason: string
  reason_kinds?: string[]
  row: number
  rows_total: number
  rows_done: number
  s_m: number
  length_m: number
  eta_s: number | null
  waypoints_total: number
  waypoints_reached: number
  leg: string
  refusal: string
}

/**
 * A calibration that is under way, or has ended and is not put aside yet.
 *
 * `directions` are those that the compass has seen until now; null for any other.
 */
export interface CalibrationProgress {
  kind: string
  phase: CalibrationPhase
  motion: string
  share: number
  reason: string
  directions: boolean[] | null
}

/** Where in the recording of this name the page is. */
export interface ReplayProgress {
  name: string
  t_s: number
  start_s: number
  end_s: number
  speed: number
}

/** One line of the implement's own status, in its own words. */
export interface ImplementLine {
  name: string
  text: string
}

/**
 * State of the last gate before the motors, the time from which on it is so, and why.
 *
 * `reason` is empty where the state of the robot says it already.
 */
export interface ShownGate {
  state: GateState
  since_s: number
  reason: string
  reason_kinds?: string[]
}

/**
 * An item of the list before the start, and what is wrong with it; good where nothing is.
 *
 * `remark` is what is to be known of one that is good.
 */
export interface StartCheck {
  name: string
  wrong: string
  remark: string
  wrong_kinds: string[]
  remark_kinds: string[]
}

export type StartCheckRow = [name: string, wrong: string, remark: string, wrong_kinds: string[], remark_kinds: string[]]

export function readStartCheck(row: StartCheckRow): StartCheck {
  return {
    name: row[0],
    wrong: row[1],
    remark: row[2],
    wrong_kinds: row[3],
    remark_kinds: row[4],
  }
}

/** What is held against a sensor, and the time from which on. */
export interface SensorDoubt {
  sensor: string
  state: SensorState
  since_s: number | null
  reason: string
  reason_kinds?: string[]
}

/**
 * The robot at one of its ticks, and the samples of its signals since the state before.
 *
 * `pose` is x, y (m) and yaw (rad) in the map, null while it is not known; `tilt_rad` roll and
 * pitch. `mono_ms` is when the robot was so. `gnss` is null before the first fix, and again once
 * the robot calls GNSS silent. `recording` is the folder that is being written, empty while
 * nothing is recorded, null where nothing can be. `checks` is the newest list before a start,
 * `doubts` are the sensors that are not fine.
 */
export interface State {
  kind: 'state'
  tick: number
  t_s: number
  epoch: number
  mono_ms: number
  pose: [number, number, number] | null
  pos_std_m: number | null
  yaw_std_rad: number | null
  v_mps: number | null
  yaw_rate_radps: number | null
  cross_track_m: number | null
  joints_rad: number[]
  tilt_rad: Vec2 | null
  gnss: GnssState | null
  battery: BatteryState | null
  mission: MissionProgress | null
  mode: Mode
  stop: string
  stop_kinds?: string[]
  reason: string
  reason_kinds?: string[]
  gate: ShownGate | null
  checks: StartCheckRow[]
  doubts: SensorDoubt[]
  implement: ImplementLine[]
  weed_count: number
  pace_ratio: number | null
  recording: string | null
  calibration: CalibrationProgress | null
  replay: ReplayProgress | null
  signals: Sample[]
}

/** A plant of the weed map; on the wire a row of these columns, for there may be 50,000. */
export interface Weed {
  id: number
  plant: number
  x_map_m: number
  y_map_m: number
  std_m: number
  confidence: number
  area_m2: number
  sightings: number
  first_seen_s: number
  last_seen_s: number
  treated_s: number | null
  left: string
}

export type WeedRow = [
  id: number,
  plant: number,
  x_map_m: number,
  y_map_m: number,
  std_m: number,
  confidence: number,
  area_m2: number,
  sightings: number,
  first_seen_s: number,
  last_seen_s: number,
  treated_s: number | null,
  left: string,
]

export function readWeed(row: WeedRow): Weed {
  return {
    id: row[0],
    plant: row[1],
    x_map_m: row[2],
    y_map_m: row[3],
    std_m: row[4],
    confidence: row[5],
    area_m2: row[6],
    sightings: row[7],
    first_seen_s: row[8],
    last_seen_s: row[9],
    treated_s: row[10],
    left: row[11],
  }
}

/** A line of the log; `state` is the new one of the mission or the gate, where that changed. */
export interface LogEvent {
  t_s: number
  level: EventLevel
  source: string
  text: string
  state: string
}

/** Places where the robot was, from the one with the number `first` on. */
export interface TracePiece {
  kind: 'trace'
  epoch: number
  first: number
  points_map_m: Vec2[]
}

/**
 * The planned path from its point with the number `first` on; 0 begins another path.
 *
 * `rows` is the crop row of each point, -1 between rows.
 */
export interface PathPiece {
  kind: 'path'
  epoch: number
  first: number
  points_map_m: Vec2[]
  rows: number[]
}

/** Plants that are new or different, and the numbers of those that are gone. */
export interface WeedChanges {
  kind: 'weeds'
  epoch: number
  set: WeedRow[]
  gone: number[]
}

export interface NewEvents {
  kind: 'events'
  epoch: number
  events: LogEvent[]
}

/** A satellite by system (GP, GL, GA, GB, GQ, SB) and number; `snr_db` is 0 where unheard. */
export interface SeenSatellite {
  system: string
  number: number
  elevation_deg: number
  azimuth_deg: number
  snr_db: number
  is_used: boolean
}

export type SeenSatelliteRow = [
  system: string,
  number: number,
  elevation_deg: number,
  azimuth_deg: number,
  snr_db: number,
  is_used: boolean,
]

export function readSeenSatellite(row: SeenSatelliteRow): SeenSatellite {
  return {
    system: row[0],
    number: row[1],
    elevation_deg: row[2],
    azimuth_deg: row[3],
    snr_db: row[4],
    is_used: row[5],
  }
}

/**
 * The GNSS receiver's status, once a second where it is new; null and empty: not reported.
 *
 * Ages are those when the message was made. `quality` has the numbers of NMEA GGA field 6,
 * `std_m` is 1 sigma of East and of North. `device` is where it is read from, empty for the
 * platform's own receiver. The counts are of all satellites; `satellites` has the most
 * important. `correction_hz` counts the messages of `caster` that were passed on, and
 * `correction_use_ratio` is the share of those since the state before that the receiver says to
 * have used. The troubles are for a person. `unmeasured` is how a place came about without
 * satellites ("dead reckoning", "held"), and `unread` names kinds of messages that are not read.
 */
export interface ReceiverState {
  kind: 'receiver'
  epoch: number
  is_simulated: boolean
  device: string
  fix_age_s: number | null
  quality: number
  std_m: number | null
  rate_hz: number | null
  status_age_s: number | null
  satellites: SeenSatelliteRow[]
  used_count: number
  in_view_count: number
  hdop: number | null
  pdop: number | null
  vdop: number | null
  correction_age_s: number | null
  correction_hz: number | null
  correction_use_ratio: number | null
  caster: string
  caster_state: CasterState | null
  correction_trouble: string
  line_trouble: string
  unmeasured: string
  position_trouble: string
  unread: string[]
}

export interface SignalTable {
  names: string[]
  units: string[]
}

/**
 * The beginning of everything that is shown from now on; what is left follows in pieces.
 *
 * `epoch` names what is shown, and the stretch of it, as in all that belongs to it. `source` is
 * the robot's platform, "replay" or "description".
 */
export interface Snapshot {
  kind: 'snapshot'
  epoch: number
  source: string
  name: string
  signals: SignalTable
  trace: TracePiece
  path: PathPiece
  weeds: WeedChanges
  events: NewEvents
}

/** The first message on a line; `run` is another one where the robot's program is. */
export interface Hello {
  kind: 'hello'
  run: number
  session: string
  role: Role
  version: string
  source: string
  seat: SeatState
  holder: string
  clients: number
}

/** Who has the operator's seat, and how many pages are connected. */
export interface SeatChange {
  kind: 'seat'
  seat: SeatState
  holder: string
  clients: number
}

/** What the robot itself does while the page looks at a recording. */
export interface LiveState {
  kind: 'live_state'
  mode: Mode
  stop: string
}

/** Another field or task: what the page read of it is out of date. */
export interface FieldChange {
  kind: 'field_change'
}

/** What became of the request with this `id`: done, or why not. */
export interface Verdict {
  kind: 'verdict'
  id: string
  ok: boolean
  reason: string
}

/** Answers a ping: its own time, and this machine's clocks. */
export interface Pong {
  kind: 'pong'
  sent_ms: number
  mono_ms: number
  wall_ms: number
}

/** The line ends; `reason` is for a person. */
export interface Bye {
  kind: 'bye'
  reason: string
}

export interface Login {
  token: string
}

/** All that a caller without a session gets. */
export interface LoginNeeded {
  version: string
  needs_login: boolean
}

/** What is served here, and to whom. */
export interface SessionInfo {
  version: string
  run: number
  profile: string
  source: string
  role: Role
  lan_url: string | null
  qr_svg: string | null
  camera: boolean
  needs_login: boolean
}

/** Every refusal: one sentence for a person. */
export interface Problem {
  error: string
}

/** The origin of the map. */
export interface DatumPlace {
  lat_deg: number
  lon_deg: number
}

/** A crop row: its ends, its curvature (left positive) and the points to draw it by. */
export interface FieldRow {
  index: number
  start_map_m: Vec2
  end_map_m: Vec2
  curvature_radpm: number
  points_map_m: Vec2[]
}

/**
 * The ground that a map shows.
 *
 * `rows` are the task's, swaths of a plan too; `crop_map_m` are all rows of crop that stand there.
 * `declination_deg` is that of magnetic North as the robot takes it, East positive.
 */
export interface Field {
  name: string
  datum: DatumPlace
  datum_source: string
  declination_deg: number
  rows: FieldRow[]
  crop_map_m: Vec2[][]
  boundary_map_m: Vec2[] | null
  obstacles_map_m: Vec2[][]
  waypoints_map_m: Vec2[]
  start_map_m: Vec2 | null
}

/** `body_from_camera` is a 4x4 matrix by rows. */
export interface CameraInfo {
  width_px: number
  height_px: number
  hfov_rad: number
  body_from_camera: number[]
}

export interface Robot {
  name: string
  urdf_url: string
  footprint_body_m: Vec2[]
  max_speed_mps: number
  max_yaw_rate_radps: number
  camera: CameraInfo | null
  wheel_joints: string[]
  has_compass: boolean
  tool_width_m: number | null
}

export interface SignalInfo {
  name: string
  unit: string
  fields: string[]
}

/** `ok` is null for a run that has no report. */
export interface RecordingInfo {
  name: string
  utc: string
  size_bytes: number
  duration_s: number | null
  profile: string | null
  ok: boolean | null
  reason: string
  files: string[]
}

export interface Recordings {
  disk_free_bytes: number
  current: string | null
  recordings: RecordingInfo[]
}

/** Show a recording from `t_s` on, or the robot again where `name` is null; 0 is a pause. */
export interface ReplayWish {
  name?: string | null
  speed?: number
  t_s?: number | null
}

/** What the caller's pages look at now. */
export interface Shown {
  source: string
  replay: ReplayProgress | null
}

export interface MarkText {
  text?: string
}

/** A frame kept on the robot for training, and how many lie there. */
export interface KeptFrame {
  folder: string
  image: string
  count: number
}

export interface Setting {
  key: string
  value: SettingValue
  default: SettingValue | null
  type: SettingType
  unit: string
  live: boolean
  about: string
  min: number | null
  max: number | null
  choices: string[] | null
}

export interface SettingGroup {
  name: string
  keys: Setting[]
}

export interface SettingGroups {
  groups: SettingGroup[]
}

/** Each key is applied or refused for itself. */
export interface SettingsReply {
  applied: Record<string, SettingValue>
  refused: Record<string, string>
}

export interface CalibrationStart {
  kind?: string
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

/** `errors_deg` are those by direction, before and after, of the compass. */
export interface CalibrationFound {
  ok: boolean
  reasons: string[]
  changes: CalibrationChange[]
  settings: string[]
  errors_deg: [Sample, Sample] | null
}

export interface Calibrations {
  kinds: CalibrationKind[]
  now: CalibrationProgress | null
  found: CalibrationFound | null
  file: string
  settings: string[]
  broken: string
  can_undo: boolean
}

export interface HealthCheck {
  name: string
  state: CheckState
  text: string
  advice: string
  value: number | string | null
}

export interface SensorRate {
  topic: string
  expected_hz: number | null
  measured_hz: number | null
}

export interface ServerCost {
  cpu_s: number
  memory_bytes: number
}

export interface Health {
  checks: HealthCheck[]
  rates: SensorRate[]
  cpu_ratio: number | null
  memory_bytes: number
  server: ServerCost
  log: LogEvent[]
}

/** A map for the background; `bounds` are west, south, east and north. */
export interface MapSource {
  name: string
  url: string
  minzoom: number
  maxzoom: number
  bounds: [number, number, number, number] | null
  attribution: string | null
}

/** The way to a goal before it is sent. */
export interface GoalPreview {
  points_map_m: Vec2[]
  length_m: number
  time_s: number
}

export interface GoalPlace {
  x_map_m: number
  y_map_m: number
  yaw_map_rad?: number | null
}

/**
 * A field (GeoJSON) to be worked, and how; what is left out keeps its default.
 *
 * `margin_m` is left out for that of the field. The crop rows on the map are kept off, unless
 * `is_crop_gone`.
 */
export interface PlanWish {
  field: Record<string, unknown>
  implement_width_m?: number | null
  headland_passes?: number | null
  overlap_m?: number
  margin_m?: number | null
  swath_yaw_deg?: number | null
  is_crop_gone?: boolean
}

/** Why a field or a plan cannot be used, and where. */
export interface FieldReason {
  text: string
  at_map_m: Vec2 | null
}

/** What was found of a field, less its obstacles; `error` where it is not stored. */
export interface FieldReply {
  ok: boolean
  reasons: FieldReason[]
  area_m2: number
  length_m: number
  error?: string
}

/** A plan over a field; `path` is longitude and latitude, `error` why it is not used. */
export interface PlanReply {
  ok: boolean
  reasons: FieldReason[]
  warnings: string[]
  length_m: number | null
  area_m2: number | null
  time_s: number | null
  path: Vec2[]
  certificate: Record<string, unknown> | null
  error?: string
}

export interface ImportedDisplay {
  type: string
  title: string
  source: string
  options: Record<string, SettingValue>
  visible: boolean
  opacity: number
}

/** A display of mapviz that has no counterpart. */
export interface LeftOut {
  name: string
  why: string
}

export interface ViewTarget {
  target: 'map' | 'position' | 'heading'
  turn: number
}

/** A configuration of mapviz: displays from the lowest to the topmost. */
export interface ImportedView {
  displays: ImportedDisplay[]
  left_out: LeftOut[]
  view: ViewTarget
}

/** Displays of the page, and what it stays on, to become a configuration of mapviz. */
export interface ExportedView {
  displays: unknown[]
  view?: Record<string, unknown>
}

/** A panel that a program adds to the page, with what its kind has. */
export interface PanelInfo {
  id: string
  kind: PanelKind
  title: string
  refresh_s?: number
  fields?: string[]
  schema?: Record<string, unknown>
  needs_seat?: boolean
  type?: string
  style?: Record<string, unknown>
  draw_order?: number
  visible?: boolean
  what?: 'point' | 'polygon' | 'route'
  topic?: string
}

/** A topic that displays can show, and the displays that can. */
export interface ListedTopic {
  name: string
  type: string
  displays: string[]
  publishers: string[]
}

/** One network or recording and its topics; `problem` says why it has no topics. */
export interface TopicNetworkInfo {
  source: string
  title: string
  topics: ListedTopic[]
  problem: string
}

/** A topic that a display looks at; `after` is the number of the message that it has. */
export interface TopicWish {
  source: string
  name: string
  after: number
}

export interface TopicWishes {
  topics: TopicWish[]
}

/**
 * What a topic has said; `message` is left out where it is not newer, or has no room.
 *
 * `note` says what is wrong with it, `left_out` what was thinned, `is_stale` that it has stopped.
 */
export interface TopicNews {
  seq: number
  type: string
  age_s: number | null
  rate_hz: number | null
  is_stale: boolean
  note: string
  left_out: string
  message: unknown
}

/** What a button or form says to a press; `at_s` is the clock of the day. */
export interface PanelReply {
  text: string
  at_s: number
}

/** The kinds of messages that a server sends. */
export const SERVER_KINDS: readonly string[] = [
  'hello',
  'snapshot',
  'state',
  'trace',
  'path',
  'weeds',
  'events',
  'receiver',
  'live_state',
  'seat',
  'field_change',
  'verdict',
  'pong',
  'bye',
]

export const CAMERA_HEAD_BYTES = 16
