/** What comes over a socket, read as what `wire.ts` says or left alone. */

import type { ServerMessage } from './wire.ts'
import { CAMERA_HEAD_BYTES, SERVER_KINDS } from './wire.ts'

/** The message in one text frame, or null for anything that is not one of ours. */
export function parseMessage(text: string): ServerMessage | null {
  let value: unknown
  try {
    value = JSON.parse(text)
  } catch {
    return null
  }
  if (typeof value !== 'object' || value === null) return null
  const { kind } = value as { kind?: unknown }
  return typeof kind === 'string' && SERVER_KINDS.includes(kind) ? (value as ServerMessage) : null
}

export interface CameraPacket {
  kind: 'image' | 'mask'
  level: number
  frame: number
  wallMs: number
  file: Uint8Array<ArrayBuffer>
}

/** One binary frame of the camera socket, or null when it is too short or of an unknown kind. */
export function parseCameraPacket(buffer: ArrayBuffer): CameraPacket | null {
  if (buffer.byteLength <= CAMERA_HEAD_BYTES) return null
  const view = new DataView(buffer)
  const kind = view.getUint8(0)
  if (kind > 1) return null
  return {
    kind: kind === 0 ? 'image' : 'mask',
    level: view.getUint8(1),
    frame: view.getUint32(4),
    wallMs: view.getFloat64(8),
    file: new Uint8Array(buffer, CAMERA_HEAD_BYTES),
  }
}
