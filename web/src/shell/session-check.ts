/** Whether another run of the robot's program answers where a line could not be opened. */

import type { SessionInfo } from '../wire.ts'

interface Line {
  /** Loads the page anew for another run, but not before a STOP that no robot has heard was said. */
  expect: (run: number) => void
}

/** Asks once at a time; a run that wants a login opens no line before the page is loaded anew. */
export function sessionCheck(line: Line, ask: () => Promise<SessionInfo>, reload: () => void): () => void {
  let isAsking = false
  return () => {
    if (isAsking) return
    isAsking = true
    ask()
      .then(
        (now) => (now.needs_login ? reload() : line.expect(now.run)),
        () => undefined,
      )
      .finally(() => (isAsking = false))
  }
}
