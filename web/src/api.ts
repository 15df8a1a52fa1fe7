/** The HTTP side of the server. Every failure becomes an `ApiError` with the server's own sentence. */

import type { FeatureCollection } from 'geojson'
import type {
  Calibrations,
  CalibrationStart,
  ExportedView,
  Field,
  GoalPlace,
  GoalPreview,
  Health,
  ImportedView,
  KeptFrame,
  Login,
  MapSource,
  PanelInfo,
  PlanReply,
  PlanWish,
  Recordings,
  ReplayWish,
  Robot,
  SessionInfo,
  SettingGroups,
  SettingsReply,
  SettingValue,
  TopicNetworkInfo,
  TopicNews,
  TopicWish,
  TopicWishes,
} from './wire.ts'
import { language, say } from './say.ts'

/** What a lost network swallows would keep a connection for minutes. */
const SESSION_MS = 10_000

export class ApiError extends Error {
  readonly status: number
  constructor(status: number, message: string) {
    super(message)
    this.status = status
  }
}

async function request(path: string, init: RequestInit = {}): Promise<Response> {
  let response: Response
  try {
    const headers = { ...init.headers, 'Accept-Language': language }
    response = await fetch(path, { credentials: 'same-origin', ...init, headers })
  } catch {
    throw new ApiError(0, say('noAnswerCheckLink'))
  }
  if (!response.ok) throw new ApiError(response.status, await reason(response))
  return response
}

async function reason(response: Response): Promise<string> {
  try {
    const body = (await response.json()) as { error?: unknown }
    if (typeof body.error === 'string') return body.error
  } catch {
    // not JSON: the status has to do
  }
  return say('robotAnsweredStatus', { status: `${response.status} ${response.statusText}` })
}

async function get<T>(path: string, init: RequestInit = {}): Promise<T> {
  return (await request(path, init)).json() as Promise<T>
}

async function write(method: string, path: string, body: unknown): Promise<Response> {
  return request(path, { method, headers: { 'Content-Type': 'application/json' }, body: JSON.stringify(body) })
}

async function ask<T>(method: string, path: string, body: unknown): Promise<T> {
  return (await write(method, path, body)).json() as Promise<T>
}

const name = encodeURIComponent

/** What a field file holds; `left_out` names in one line what is not in it. */
/** `fields` names those in the file, where it holds several. */
interface ImportedField extends FeatureCollection {
  left_out?: string
  fields?: string[]
}

export const api = {
  session: () => get<SessionInfo>('/api/v1/session', { signal: AbortSignal.timeout(SESSION_MS) }),
  login: (token: string) => write('POST', '/api/v1/login', { token } satisfies Login),
  /** Of the robot, or of the recording of this name that is shown. */
  field: (recording: string | null) =>
    get<Field>(`/api/v1/field${recording === null ? '' : `?recording=${name(recording)}`}`),
  robot: () => get<Robot>('/api/v1/robot'),
  health: () => get<Health>('/api/v1/health'),
  maps: () => get<MapSource[]>('/api/v1/maps'),

  recordings: () => get<Recordings>('/api/v1/recordings'),
  replay: (recording: string | null, speed: number, tS: number) =>
    write('POST', '/api/v1/replay', { name: recording, speed, t_s: tS } satisfies ReplayWish),

  /** A small picture of a weed, and when it was taken. */
  weedPicture: async (id: number): Promise<{ picture: Blob; takenS: number }> => {
    const response = await request(`/api/v1/weeds/${id}/picture`)
    return { picture: await response.blob(), takenS: Number(response.headers.get('x-captured-s')) }
  },
  keepFrame: () => ask<KeptFrame>('POST', '/api/v1/frames', {}),

  settings: () => get<SettingGroups>('/api/v1/settings'),
  changeSettings: (changes: Record<string, SettingValue>) => ask<SettingsReply>('PATCH', '/api/v1/settings', changes),

  calibrations: () => get<Calibrations>('/api/v1/calibrations'),
  calibrate: (what: 'start' | 'cancel' | 'accept' | 'undo', body: CalibrationStart = {}) =>
    ask<Calibrations>('POST', `/api/v1/calibrations/${what}`, body),

  fields: () => get<string[]>('/api/v1/fields'),
  loadField: (id: string) => get<FeatureCollection>(`/api/v1/fields/${name(id)}`),
  saveField: (id: string, field: FeatureCollection) => write('PUT', `/api/v1/fields/${name(id)}`, field),
  deleteField: (id: string) => request(`/api/v1/fields/${name(id)}`, { method: 'DELETE' }),
  /** Reads a field file; of several fields in it the one that is named. */
  importField: async (file: File, field = ''): Promise<ImportedField> => {
    const path = `/api/v1/fields/import?filename=${name(file.name)}&field=${name(field)}`
    return (await request(path, { method: 'POST', body: file })).json() as Promise<ImportedField>
  },
  exportField: async (ending: string, field: FeatureCollection): Promise<Blob> =>
    (await write('POST', `/api/v1/fields/export?format=${ending}`, field)).blob(),
  previewGoal: (goal: GoalPlace) => ask<GoalPreview>('POST', '/api/v1/goal/preview', goal),
  plan: (body: PlanWish) => ask<PlanReply>('POST', '/api/v1/plan', body),
  applyPlan: (body: PlanWish) => write('POST', '/api/v1/plan/apply', body),

  views: () => get<string[]>('/api/v1/views'),
  loadView: (id: string) => get<Record<string, unknown>>(`/api/v1/views/${name(id)}`),
  saveView: (id: string, view: object) => write('PUT', `/api/v1/views/${name(id)}`, view),

  importView: async (file: File): Promise<ImportedView> =>
    (await request('/api/v1/views/import', { method: 'POST', body: file })).json() as Promise<ImportedView>,
  exportView: async (displays: object[], view: object): Promise<string> =>
    (await write('POST', '/api/v1/views/export', { displays, view: { ...view } } satisfies ExportedView)).text(),

  graphPicture: async (network: string): Promise<string> =>
    (await request(`/api/v1/graph/${name(network)}/picture.svg`)).text(),
  topics: () => get<TopicNetworkInfo[]>('/api/v1/ros/topics'),
  readTopics: (topics: TopicWish[]) =>
    ask<TopicNews[]>('POST', '/api/v1/ros/topics/read', { topics } satisfies TopicWishes),

  panels: () => get<PanelInfo[]>('/api/v1/panels'),
  panelData: (id: string) => request(`/api/v1/panels/${name(id)}`),
  submitPanel: (id: string, values: object) => write('POST', `/api/v1/panels/${name(id)}`, values),
}

export function message(error: unknown): string {
  return error instanceof Error ? error.message : String(error)
}
