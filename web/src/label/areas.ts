/** Areas of a picture that the server computes, superpixels and plants: each asked for once. */

import type { Pieces } from './painting.ts'
import { say } from '../say.ts'

export type AreaTool = 'fill' | 'plant'
/** What an area tool paints, as the page names it. */
export const AREA_NAMES: Record<AreaTool, string> = { fill: say('areasSuperpixels'), plant: say('areasPlants') }

export class Areas {
  private readonly found = new Map<AreaTool, Pieces>()
  private readonly asked = new Map<AreaTool, Promise<Pieces>>()

  constructor(private readonly read: (tool: AreaTool) => Promise<Pieces>) {}

  /** The areas where they are here, else null. */
  get(tool: AreaTool): Pieces | null {
    return this.found.get(tool) ?? null
  }

  isComputing(tool: AreaTool): boolean {
    return this.asked.has(tool)
  }

  /** Waits for the areas; after a failure the next call asks again. */
  load(tool: AreaTool): Promise<Pieces> {
    const here = this.found.get(tool)
    if (here) return Promise.resolve(here)
    const asked = this.asked.get(tool) ?? this.ask(tool)
    this.asked.set(tool, asked)
    return asked
  }

  private async ask(tool: AreaTool): Promise<Pieces> {
    try {
      const pieces = await this.read(tool)
      this.found.set(tool, pieces)
      return pieces
    } finally {
      this.asked.delete(tool)
    }
  }
}
