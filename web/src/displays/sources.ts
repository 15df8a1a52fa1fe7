/** Where displays get their messages: what the robot says, and what programs add to the page from Python. */

import { api } from '../api.ts'
import type { App } from '../app.ts'
import { CameraStream } from '../camera/stream.ts'
import type { MapSource, PanelInfo, State } from '../wire.ts'
import type { Odometry, PoseStamped } from './messages.ts'
import { ofYaw } from './messages.ts'
import { say } from '../say.ts'

export type Listener = (message: unknown) => void
/** What is wrong with what a source gives and what was left out of it; `isStale` says that it has stopped. */
export interface Condition {
  note: string
  leftOut: string
  isStale: boolean
}
export type Tell = (condition: Condition) => void
/** `types` are the display types that can draw its messages; `listen` gives the function that ends it. */
export interface Source {
  id: string
  title: string
  /** The network that it comes from, where it is not the robot itself. */
  network?: string
  types: string[]
  listen: (hear: Listener, tell: Tell) => () => void
  /** What a map on the robot is drawn from, which says nothing. */
  tiles?: MapSource
}

function ofState(app: App, pick: (state: State) => unknown): Source['listen'] {
  return (hear) =>
    app.store.on('state', (state) => {
      const message = pick(state)
      if (message !== null && message !== undefined) hear(message)
    })
}

function header(state: State): Odometry['header'] {
  return { frame_id: 'map', stamp: { sec: Math.floor(state.t_s), nanosec: Math.round((state.t_s % 1) * 1e9) } }
}

function poseOf(state: State): PoseStamped | null {
  if (!state.pose) return null
  const [x, y, yaw] = state.pose
  return { header: header(state), pose: { position: { x, y }, orientation: ofYaw(yaw) } }
}

function odometryOf(state: State): Odometry | null {
  const stamped = poseOf(state)
  if (!stamped) return null
  const covariance = new Array<number>(36).fill(0)
  const { pos_std_m: pos, yaw_std_rad: yaw } = state
  if (pos !== null && yaw !== null) [covariance[0], covariance[7], covariance[35]] = [pos ** 2, pos ** 2, yaw ** 2]
  return { header: stamped.header, pose: { pose: stamped.pose, covariance } }
}

function fixOf(state: State): unknown {
  if (!state.gnss) return null
  const { lat_deg, lon_deg, std_m } = state.gnss
  const variance = (std_m ?? 0) ** 2
  const track = state.pose ? 90 - (state.pose[2] * 180) / Math.PI : undefined
  return {
    header: header(state),
    latitude: lat_deg,
    longitude: lon_deg,
    track,
    position_covariance: [variance, 0, 0, 0, variance, 0, 0, 0, 0],
  }
}

/** Roll, pitch and yaw as the quaternion of an IMU. */
function imuOf(state: State): unknown {
  if (!state.tilt_rad) return null
  const [[cr, sr], [cp, sp], [cy, sy]] = [state.tilt_rad[0], state.tilt_rad[1], state.pose?.[2] ?? 0].map((angle) => [
    Math.cos(angle / 2),
    Math.sin(angle / 2),
  ])
  const orientation = {
    w: cr * cp * cy + sr * sp * sy,
    x: sr * cp * cy - cr * sp * sy,
    y: cr * sp * cy + sr * cp * sy,
    z: cr * cp * sy - sr * sp * cy,
  }
  return { header: header(state), orientation }
}

function pathListener(
  app: App,
  message: (points: { pose: PoseStamped['pose'] }[], state: State | null) => unknown,
  event: 'path' | 'state',
): Source['listen'] {
  return (hear) => {
    const tell = (): void => {
      const { path, state } = app.store
      if (path)
        hear(
          message(
            path.points_map_m.map(([x, y]) => ({ pose: { position: { x, y } } })),
            state,
          ),
        )
    }
    tell()
    return event === 'path' ? app.store.on('path', tell) : everySecond(tell)
  }
}

function everySecond(work: () => void): () => void {
  const timer = setInterval(work, 1000)
  return () => clearInterval(timer)
}

function cameraListener(app: App): Source['listen'] {
  return (hear) => {
    const stream = new CameraStream(app.store, false)
    stream.onImage = ({ bitmap }) => {
      const canvas = document.createElement('canvas')
      canvas.width = bitmap.width
      canvas.height = bitmap.height
      canvas.getContext('2d')?.drawImage(bitmap, 0, 0)
      hear(canvas)
    }
    return () => stream.close()
  }
}

export function robotSources(app: App): Source[] {
  const stamped = ofState(app, poseOf)
  const sources: Source[] = [
    { id: 'gnss', title: say('gnssReceiver'), types: ['gps', 'navsat'], listen: ofState(app, fixOf) },
    { id: 'odometry', title: say('estimatedPose'), types: ['odometry'], listen: ofState(app, odometryOf) },
    { id: 'pose', title: say('estimatedPose'), types: ['pose', 'robot_image'], listen: stamped },
    {
      id: 'base_link',
      title: 'base_link',
      types: ['tf_frame'],
      listen: ofState(app, (state) => {
        const pose = poseOf(state)?.pose
        return (
          pose && {
            header: header(state),
            child_frame_id: 'base_link',
            transform: { translation: pose.position, rotation: pose.orientation },
          }
        )
      }),
    },
    { id: 'imu', title: say('tilt'), types: ['attitude_indicator'], listen: ofState(app, imuOf) },
    {
      id: 'path',
      title: say('plannedPath'),
      types: ['path'],
      listen: pathListener(app, (poses) => ({ poses }), 'path'),
    },
    {
      id: 'route',
      title: say('pathAndPlace'),
      types: ['route'],
      listen: pathListener(
        app,
        (points, state) => ({
          route_points: points,
          position_m: state?.mission?.s_m,
        }),
        'state',
      ),
    },
    {
      id: 'mission',
      title: say('stateOfTheMission'),
      types: ['string'],
      listen: ofState(app, (state) => ({
        data: [state.mission?.state, state.reason].filter(Boolean).join(': ') || state.mode,
      })),
    },
  ]
  if (app.session.camera)
    sources.push({ id: 'camera', title: say('camera'), types: ['image'], listen: cameraListener(app) })
  app.store.signals.names.forEach((name, i) =>
    sources.push({
      id: `signal:${name}`,
      title: name,
      types: ['float'],
      listen: ofState(app, (state) => {
        const value = state.signals.at(-1)?.[i + 1]
        return typeof value === 'number' ? { data: value } : null
      }),
    }),
  )
  return sources
}

/** Data that a program gives: asked for again and again while somebody looks. */
export function panelSource(panel: PanelInfo, isShown: () => boolean): Source {
  const types = [panel.kind === 'image' ? 'image' : (panel.type ?? 'geojson')]
  const listen = (hear: Listener): (() => void) => {
    let known = ''
    const load = async (): Promise<void> => {
      const response = await api.panelData(panel.id).catch(() => null)
      if (!response) return
      if (panel.kind === 'image')
        return hear({ format: '', data: Array.from(new Uint8Array(await response.arrayBuffer())) })
      const text = await response.text()
      if (text === known) return // nothing new: the map need not be drawn again
      known = text
      hear(JSON.parse(text))
    }
    void load()
    const timer = setInterval(
      () => {
        if (isShown()) void load()
      },
      (panel.refresh_s ?? 1) * 1000,
    )
    return () => clearInterval(timer)
  }
  return { id: panel.id, title: panel.title, types, listen }
}

/** A map on the robot. */
export function tileSource(tiles: MapSource, type: string): Source {
  return { id: tiles.name, title: tiles.name, types: [type], listen: () => () => undefined, tiles }
}
