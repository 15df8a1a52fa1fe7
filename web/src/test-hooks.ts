/** `window.__agribot`: counters and state for browser tests, so that they wait for facts, not for time. */

import type { App } from './app.ts'
import type { Router } from './shell/router.ts'
import type { Field, State, Vec2 } from './wire.ts'

export interface Hooks {
  state: () => State | null
  field: () => Field | null
  counters: Record<string, number>
  readonly screen: string
  readonly ready: boolean
  map: unknown
  goal: () => Vec2 | null
  scene: (() => unknown) | null
}

declare global {
  interface Window {
    __agribot?: Hooks
  }
}

export function installHooks(app: App, router: Router): void {
  window.__agribot = {
    state: () => app.store.state,
    field: () => app.field,
    counters: app.store.counters,
    get screen() {
      return router.current
    },
    get ready() {
      return app.store.state !== null && app.field !== null
    },
    map: null,
    goal: () => null,
    scene: null,
  }
}
