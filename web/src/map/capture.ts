/** Pictures and videos of the map with everything drawn over it. */

import type { Map as MapLibre } from 'maplibre-gl'

const VIDEO_FPS = 15
const VIDEO_TYPES = ['video/webm;codecs=vp9', 'video/webm;codecs=vp8', 'video/webm', 'video/mp4']

export class Capture {
  private readonly canvas = document.createElement('canvas')
  private recorder: MediaRecorder | null = null
  private readonly copy = (): void => this.compose()
  private parts: Blob[] = []
  private timer = 0

  constructor(private readonly map: MapLibre, private readonly overlay: HTMLCanvasElement) {}

  /** The GL canvas can only be read while it is being drawn. */
  private compose(): void {
    const gl = this.map.getCanvas()
    const [w, h] = [gl.width & ~1, gl.height & ~1] // video codecs want even sizes
    if (this.canvas.width !== w || this.canvas.height !== h) {
      this.canvas.width = w
      this.canvas.height = h
    }
    const pen = this.canvas.getContext('2d')
    pen?.drawImage(gl, 0, 0)
    pen?.drawImage(this.overlay, 0, 0, gl.width, gl.height)
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
    const type = typeof MediaRecorder === 'undefined' ? undefined : VIDEO_TYPES.find((name) => MediaRecorder.isTypeSupported(name))
    if (!type || this.recorder) return false
    this.compose()
    this.map.on('render', this.copy)
    this.timer = window.setInterval(() => this.map.triggerRepaint(), 1000 / VIDEO_FPS)
    this.recorder = new MediaRecorder(this.canvas.captureStream(VIDEO_FPS), { mimeType: type })
    this.parts = []
    this.recorder.ondataavailable = ({ data }) => this.parts.push(data)
    this.recorder.start(1000)
    return true
  }

  /** The film and how its file name ends; null when there is none. */
  stop(): Promise<{ film: Blob; suffix: string } | null> {
    const recorder = this.recorder
    if (!recorder) return Promise.resolve(null)
    return new Promise((resolve) => {
      recorder.onstop = () => resolve({ film: new Blob(this.parts, { type: recorder.mimeType }), suffix: recorder.mimeType.includes('mp4') ? 'mp4' : 'webm' })
      recorder.stop()
      clearInterval(this.timer)
      this.map.off('render', this.copy)
      this.recorder = null
    })
  }
}
