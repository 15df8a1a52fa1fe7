/** What a drawing depends on besides the messages. */

import type { Projection } from '../geo.ts'
import type { FramePose } from './messages.ts'
import type { Options } from './options.ts'

export interface Setting {
  options: Options
  robot: FramePose
  projection: Projection
}
