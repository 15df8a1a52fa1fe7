import type { Screen } from '../app.ts'
import { camera } from './camera.ts'
import { drive } from './drive.ts'
import { health } from './health.ts'
import { recordings } from './recordings.ts'
import { settings } from './settings.ts'
import { teleop } from './teleop.ts'
import { weeds } from './weeds.ts'

/** Every screen in the order of the rail; the first four are the tabs of a phone. */
export const SCREENS: Screen[] = [drive, teleop, camera, weeds, recordings, settings, health]
