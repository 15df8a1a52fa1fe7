import { colour } from './theme.ts'

/** The map's colours in the current theme. */
export interface Palette {
  ground: string
  texture: string
  grid: string
  boundary: string
  row: string
  path: string
  trajectory: string
  goal: string
  goalDone: string
  weed: string
  crop: string
  robot: string
  robotEdge: string
  ellipse: string
  tool: string
  halo: string
  ink: string
}

const NAMES: (keyof Palette)[] = [
  'ground',
  'texture',
  'grid',
  'boundary',
  'row',
  'path',
  'trajectory',
  'goal',
  'goalDone',
  'weed',
  'crop',
  'robot',
  'robotEdge',
  'ellipse',
  'tool',
  'halo',
  'ink',
]

export function palette(): Palette {
  return Object.fromEntries(NAMES.map((name) => [name, colour(`map-${name}`)])) as unknown as Palette
}
