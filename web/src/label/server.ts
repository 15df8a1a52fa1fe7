/** What the page asks of `agribot label`. */

import type { AreaTool } from './areas.ts'
import type { Classes, Pieces, Raster } from './painting.ts'
import { say } from '../say.ts'

export type State = 'new' | 'draft' | 'done'

export interface PictureState {
  number: number
  name: string
  state: State
  uncertainty: number | null
}

export interface PictureList {
  about: string
  pictures: PictureState[]
}

const BASE = '/api/v1/pictures'

/** Somebody else has saved the picture since it was opened; the server has kept what was drawn. */
export class SavedMeanwhile extends Error {}

/** The classes of a picture, and the revision of what is saved of it. */
export interface SavedClasses {
  classes: Classes
  revision: string
}

/** The server is away, or the line to it. */
export class NoAnswer extends Error {}

async function ask(path: string, init?: RequestInit): Promise<Response> {
  let answer: Response
  try {
    answer = await fetch(`${BASE}${path}`, init)
  } catch {
    throw new NoAnswer(say('labelDoesNotAnswer'))
  }
  if (!answer.ok) {
    const told = (await answer.json().catch(() => null)) as { error?: string } | null
    const text = told?.error ?? say('serverAnswered', { status: answer.status })
    throw answer.status === 409 ? new SavedMeanwhile(text) : new Error(text)
  }
  return answer
}

function raster<T extends Uint8Array | Uint16Array>(answer: Response, data: T): Raster<T> {
  const size = (name: string): number => Number(answer.headers.get(name))
  return { width: size('x-width'), height: size('x-height'), data }
}

export async function listPictures(): Promise<PictureList> {
  return (await (await ask('')).json()) as PictureList
}

export async function readPicture(number: number): Promise<ImageBitmap> {
  return createImageBitmap(await (await ask(`/${number}/picture`)).blob())
}

export async function readClasses(number: number): Promise<SavedClasses> {
  const answer = await ask(`/${number}/classes`)
  const classes = raster(answer, new Uint8Array(await answer.arrayBuffer()))
  return { classes, revision: answer.headers.get('etag') ?? '' }
}

const AREA_PATHS: Record<AreaTool, string> = { fill: 'superpixels', plant: 'plants' }

/** The number of the superpixel or of the plant of every pixel. */
export async function readAreas(number: number, tool: AreaTool): Promise<Pieces> {
  const answer = await ask(`/${number}/${AREA_PATHS[tool]}`)
  return raster(answer, new Uint16Array(await answer.arrayBuffer()))
}

/** Saves what replaces `revision`; gives the new one. */
export async function saveClasses(
  number: number,
  data: Uint8Array,
  revision: string,
  isDone: boolean,
): Promise<string> {
  const init = { method: 'PUT', body: data.slice(), headers: { 'if-match': revision } }
  const answer = await ask(`/${number}/classes?done=${isDone ? 1 : 0}`, init)
  return answer.headers.get('etag') ?? ''
}
