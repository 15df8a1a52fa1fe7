/** Pictures the map needs, drawn here instead of fetched: soil texture and labels. */

import type { Map as MapLibre } from 'maplibre-gl'
import { seededRandom } from '../seeded-random.ts'

const TEXTURE_PX = 128

/** Fine speckle, the same each time, so that motion shows where there is no aerial image. */
export function soilTexture(colour: string): ImageData | null {
  const canvas = document.createElement('canvas')
  canvas.width = canvas.height = TEXTURE_PX
  const pen = canvas.getContext('2d')
  if (!pen) return null
  const next = seededRandom(12345)
  pen.fillStyle = colour
  for (let i = 0; i < 260; i++) {
    pen.globalAlpha = 0.12 + 0.35 * next()
    pen.beginPath()
    pen.arc(next() * TEXTURE_PX, next() * TEXTURE_PX, 0.4 + 1.1 * next(), 0, 7)
    pen.fill()
  }
  return pen.getImageData(0, 0, TEXTURE_PX, TEXTURE_PX)
}

/** Draw `text:ink:halo:words` when a layer asks for it. */
export function serveLabels(map: MapLibre): void {
  map.setMissingStyleImageResolver((id) => {
    const [kind, ink, halo, ...rest] = id.split(':')
    if (kind !== 'text') return
    const image = labelImage(rest.join(':'), ink, halo)
    if (image && !map.hasImage(id)) map.addImage(id, image, { pixelRatio: 2 })
  })
}

function labelImage(words: string, ink: string, halo: string): ImageData | null {
  const canvas = document.createElement('canvas')
  const pen = canvas.getContext('2d', { willReadFrequently: true })
  if (!pen) return null
  const font = '600 24px system-ui, sans-serif'
  pen.font = font
  canvas.width = Math.ceil(pen.measureText(words).width) + 20
  canvas.height = 36
  pen.font = font
  pen.textBaseline = 'middle'
  pen.lineWidth = 6
  pen.lineJoin = 'round'
  pen.strokeStyle = halo
  pen.strokeText(words, 10, 18)
  pen.fillStyle = ink
  pen.fillText(words, 10, 18)
  return pen.getImageData(0, 0, canvas.width, canvas.height)
}
