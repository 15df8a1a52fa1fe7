/** Written by `make generate` from `src/agribot/ui/wire.py`: change that one. */

import type { Screen } from '../app.ts'
import { camera } from './camera.ts'
import { drive } from './drive.ts'
import { health } from './health.ts'
import { plan } from './plan.ts'
import { plots } from './plots.ts'
import { recordings } from './recordings.ts'
import { robot } from './robot.ts'
import { settings } from './settings.ts'
import { teleop } from './teleop.ts'
import { weeds } from './weeds.ts'

/** Every screen in the order of the rail; the first four are the tabs of a phone. */
export const SCREENS: Screen[] = [drive, teleop, camera, weeds, plan, plots, robot, recordings, settings, health]
