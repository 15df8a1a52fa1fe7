/** Pictures and videos of the map with everything drawn over it. */

import type { Map as MapLibre } from 'maplibre-gl'
import { say } from '../say.ts'

const VIDEO_FPS = 15
const VIDEO_TYPES = ['video/webm;codecs=vp9', 'video/webm;codecs=vp8', 'video/webm', 'video/mp4']

export const CAPTURE_SIZES = {
  window: say('asLargeAsWindow'),
  '480p': say('size480p'),
  '720p': say('size720p'),
}
export type CaptureSize = keyof typeof CAPTURE_SIZES
const SIZES_PX: Partial<Record<CaptureSize, [width: number, height: number]>> = {
  '480p': [640, 480],
  '720p': [1280, 720],
}

export class Capture {
  /** Of pictures and of the next video; of another shape than the window, its middle fills them. */
  size: CaptureSize = 'window'
  private readonly canvas = document.createElement('canvas')
  private recorder: MediaRecorder | null = null
  private readonly copy = (): void => this.compose()
  private parts: Blob[] = []
  private timer = 0
  /** The size at which a film was begun: it has one. */
  private filmed: CaptureSize | null = null

  constructor(
    private readonly map: MapLibre,
    private readonly overlay: HTMLCanvasElement,
  ) {}

  /** The GL canvas can only be read while it is being drawn. */
  private compose(): void {
    const gl = this.map.getCanvas()
    const [across, down] = [gl.width & ~1, gl.height & ~1] // video codecs want even sizes
    const [w, h] = SIZES_PX[this.filmed ?? this.size] ?? [across, down]
    const scale = Math.max(w / across, h / down)
    const place = [(w - scale * across) / 2, (h - scale * down) / 2, scale * gl.width, scale * gl.height] as const
    if (this.canvas.width !== w || this.canvas.height !== h) {
      this.canvas.width = w
      this.canvas.height = h
    }
    const pen = this.canvas.getContext('2d')
    pen?.drawImage(gl, ...place)
    pen?.drawImage(this.overlay, ...place)
  }

  picture(): Promise<Blob | null> {
    return new Promise((resolve) => {
      this.map.once('render', () => {
        this.compose()
        this.canvas.toBlob(resolve, 'image/png')
      })
      this.map.triggerRepaint()
    })
  }

  get isRecording(): boolean {
    return this.recorder !== null
  }

  /** Film the map until `stop`; false where the browser cannot. */
  start(): boolean {
    const type =
      typeof MediaRecorder === 'undefined' ? undefined : VIDEO_TYPES.find((name) => MediaRecorder.isTypeSupported(name))
    if (!type || this.recorder) return false
    this.filmed = this.size
    this.compose()
    this.map.on('render', this.copy)
    this.timer = window.setInterval(() => this.map.triggerRepaint(), 1000 / VIDEO_FPS)
    this.recorder = new MediaRecorder(this.canvas.captureStream(VIDEO_FPS), { mimeType: type })
    this.parts = []
    this.recorder.ondataavailable = ({ data }) => this.parts.push(data)
    this.recorder.start(1000)
    return true
  }

  /** The film and how its file name ends; null without a film. */
  stop(): Promise<{ film: Blob; suffix: string } | null> {
    const recorder = this.recorder
    if (!recorder) return Promise.resolve(null)
    return new Promise((resolve) => {
      recorder.onstop = () =>
        resolve({
          film: new Blob(this.parts, { type: recorder.mimeType }),
          suffix: recorder.mimeType.includes('mp4') ? 'mp4' : 'webm',
        })
      recorder.stop()
      clearInterval(this.timer)
      this.map.off('render', this.copy)
      this.recorder = null
      this.filmed = null
    })
  }
}
