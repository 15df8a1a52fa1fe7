/** The camera picture with the class mask over it: opacity and classes are chosen here, not on the robot. */

import { el } from '../dom.ts'
import type { Store } from '../store.ts'
import { CameraStream } from './stream.ts'
import type { Frame } from './stream.ts'
import { decimals, say } from '../say.ts'

export const CLASSES = [
  { index: 0, name: say('weed'), rgb: [226, 54, 44] },
  { index: 1, name: say('crop'), rgb: [52, 190, 90] },
  { index: 2, name: say('soil'), rgb: [150, 110, 70] },
] as const

const RATE_WINDOW = 30
const MASK_LASTS = 5 // pictures

export class CameraPicture {
  readonly node: HTMLElement
  readonly image = el('canvas', { width: 640, height: 480, role: 'img', 'aria-label': say('cameraPicture') })
  readonly mask = el('canvas', { class: 'mask', 'aria-hidden': 'true' })
  opacity = 0.45
  frozen = false
  shown = new Set<number>([0, 1])
  private readonly stream: CameraStream
  private lastMask: ImageData | null = null
  private withoutMask = 0
  private arrivals: number[] = []
  private ageMs = NaN
  private size = ''
  private level = 0
  private readonly undo: () => void

  constructor(
    private readonly store: Store,
    withMask = true,
  ) {
    this.node = el('div', { class: 'picture' }, this.image, this.mask)
    this.stream = new CameraStream(store, withMask)
    this.stream.onImage = (frame) => this.drawImage(frame)
    this.stream.onMask = (frame) => this.drawMask(frame)
    this.stream.onLost = () => (this.arrivals = [])
    this.undo = store.on('restart', () => this.clear())
    this.applyOpacity()
  }

  close(): void {
    this.undo()
    this.stream.close()
  }

  setOpacity(opacity: number): void {
    this.opacity = opacity
    this.stream.setMask(opacity > 0)
    this.applyOpacity()
  }

  toggleClass(index: number, show: boolean): void {
    if (show) this.shown.add(index)
    else this.shown.delete(index)
    this.paintMask()
  }

  /** Pictures per second and the age of the last one, as a label. */
  label(nowMs: number): string {
    const recent = this.arrivals
    const last = recent[recent.length - 1]
    if (last === undefined || nowMs - last > 3000) return say('noPicture')
    const fps = recent.length > 1 ? ((recent.length - 1) * 1000) / (last - recent[0]) : 0
    const figures = { fps: decimals(fps, 0), age: decimals(this.ageMs, 0), size: this.size }
    return this.level ? say('pictureLabelLevel', { ...figures, level: this.level }) : say('pictureLabel', figures)
  }

  get live(): boolean {
    return this.arrivals.length > 0
  }

  private clear(): void {
    this.image.getContext('2d')?.clearRect(0, 0, this.image.width, this.image.height)
    this.forgetMask()
  }

  private applyOpacity(): void {
    this.mask.style.opacity = String(this.opacity)
  }

  private drawImage({ bitmap, packet }: Frame): void {
    this.arrivals.push(performance.now())
    if (this.arrivals.length > RATE_WINDOW) this.arrivals.shift()
    this.ageMs = this.store.monitor.ageOfWallMs(packet.wallMs, performance.now())
    this.level = packet.level
    this.size = `${bitmap.width}×${bitmap.height}`
    if (this.frozen) return
    if (++this.withoutMask > MASK_LASTS) this.forgetMask() // a recording has none
    fit(this.image, bitmap)
    this.image.getContext('2d')?.drawImage(bitmap, 0, 0)
  }

  private drawMask({ bitmap }: Frame): void {
    if (this.frozen) return
    fit(this.mask, bitmap)
    const pen = this.mask.getContext('2d', { willReadFrequently: true })
    if (!pen) return
    this.withoutMask = 0
    pen.clearRect(0, 0, bitmap.width, bitmap.height)
    pen.drawImage(bitmap, 0, 0)
    this.lastMask = pen.getImageData(0, 0, bitmap.width, bitmap.height)
    this.paintMask()
  }

  private forgetMask(): void {
    this.lastMask = null
    this.mask.getContext('2d')?.clearRect(0, 0, this.mask.width, this.mask.height)
  }

  private paintMask(): void {
    if (!this.lastMask) return
    const { data, width, height } = this.lastMask
    const out = new ImageData(width, height)
    for (let i = 0; i < data.length; i += 4) {
      const cls = classOf(data[i], data[i + 1], data[i + 2])
      if (!this.shown.has(cls)) continue
      const [r, g, b] = CLASSES[cls].rgb
      out.data[i] = r
      out.data[i + 1] = g
      out.data[i + 2] = b
      out.data[i + 3] = 255
    }
    this.mask.getContext('2d')?.putImageData(out, 0, 0)
  }
}

/** The palette draws weeds in red, crop in green and soil in neither: the browser gives colours, not indices. */
export function classOf(r: number, g: number, b: number): 0 | 1 | 2 {
  const most = Math.max(r, g, b)
  if (most < 40 || most - Math.min(r, g, b) < 40) return 2
  if (r === most && r - g > 90) return 0
  return g === most ? 1 : 2
}

function fit(canvas: HTMLCanvasElement, bitmap: ImageBitmap): void {
  if (canvas.width === bitmap.width && canvas.height === bitmap.height) return
  canvas.width = bitmap.width
  canvas.height = bitmap.height
}
