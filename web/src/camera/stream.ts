/** The camera socket: image and class mask, one acknowledgement per drawn image, nothing queued. */

import { socketUrl } from '../link.ts'
import type { Store } from '../store.ts'
import type { CameraPacket } from '../decode.ts'
import { parseCameraPacket } from '../decode.ts'

const RETRY_MS = 1000

export interface Frame {
  bitmap: ImageBitmap
  packet: CameraPacket
}

export class CameraStream {
  private socket: WebSocket | null = null
  private closed = false
  private retry = 0
  private isCut = false
  private readonly undo: (() => void)[]
  onImage: (frame: Frame) => void = () => undefined
  onMask: (frame: Frame) => void = () => undefined
  onLost: () => void = () => undefined

  constructor(
    private readonly store: Store,
    private withMask: boolean,
  ) {
    this.undo = [store.on('link', (linked) => this.follow(linked)), store.on('restart', () => this.reopen())]
    this.open()
  }

  /** What cut the other line has cut this one, which would notice it only after a minute. */
  private follow(linked: boolean): void {
    if (linked && this.isCut) this.reopen()
    this.isCut = !linked
  }

  /** A new line begins with the picture of now; what is under way on the old one counts no more. */
  private reopen(): void {
    clearTimeout(this.retry)
    if (this.socket) {
      this.socket.onclose = this.socket.onmessage = null
      this.socket.close()
    }
    this.onLost()
    this.open()
  }

  setMask(withMask: boolean): void {
    if (withMask === this.withMask) return
    this.withMask = withMask
    this.socket?.close()
  }

  close(): void {
    this.closed = true
    for (const undo of this.undo) undo()
    clearTimeout(this.retry)
    this.socket?.close()
  }

  private open(): void {
    const socket = new WebSocket(socketUrl(`/ws/cam/main?mask=${this.withMask ? 1 : 0}`))
    socket.binaryType = 'arraybuffer'
    socket.onmessage = (event: MessageEvent<unknown>) => {
      if (event.data instanceof ArrayBuffer) void this.receive(socket, event.data)
    }
    socket.onclose = () => {
      if (this.closed) return
      this.onLost()
      this.retry = window.setTimeout(() => this.open(), RETRY_MS)
    }
    this.socket = socket
  }

  private async receive(socket: WebSocket, data: ArrayBuffer): Promise<void> {
    const packet = parseCameraPacket(data)
    if (!packet) return
    const type = packet.kind === 'image' ? 'image/jpeg' : 'image/png'
    const bitmap = await createImageBitmap(new Blob([packet.file], { type })).catch(() => null)
    if (bitmap && !this.closed && socket === this.socket) {
      ;(packet.kind === 'image' ? this.onImage : this.onMask)({ bitmap, packet })
      if (packet.kind === 'image') this.store.counters.cam++
    }
    bitmap?.close()
    if (packet.kind === 'image' && socket.readyState === WebSocket.OPEN) socket.send('a')
  }
}
