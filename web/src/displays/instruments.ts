/** Displays painted over the map: instruments in its corners, and a picture of the robot that moves with it. */

import { decoded, disparityCanvas } from './pictures.ts'
import type {
  CompressedImage,
  DisparityImage,
  Image as RosImage,
  Imu,
  NumberMessage,
  Odometry,
  PoseStamped,
  TextMessage,
} from './messages.ts'
import { anglesOf, frameOf, within } from './messages.ts'
import type { FramePose } from './messages.ts'
import type { Option, Options } from './options.ts'
import { amount, choice, colour, flag, number, words } from './options.ts'
import type { Setting } from './setting.ts'
import { decimals, say } from '../say.ts'

export interface Surface {
  pen: CanvasRenderingContext2D
  width: number
  height: number
  at: (x: number, y: number) => [number, number]
  pxPerM: number
  bearing: number
  /** To be called when what is painted has changed since. */
  repaint: () => void
}
export interface Box {
  x: number
  y: number
  w: number
  h: number
}

const ANCHORS = [
  'top left',
  'top centre',
  'top right',
  'centre left',
  'centre',
  'centre right',
  'bottom left',
  'bottom centre',
  'bottom right',
]

function anchored(anchor: string, above = 12): Option[] {
  return [
    choice('anchor', say('corner'), anchor, ...ANCHORS.filter((other) => other !== anchor)),
    number('offset_x', say('distanceFromTheSide'), 72, 0, 2000, 1, 'px'),
    number('offset_y', say('distanceFromTopOrBottom'), above, 0, 2000, 1, 'px'),
  ]
}

function sized(w: number, h: number): Option[] {
  return [
    number('w', say('width'), w, 1, 4000, 1),
    number('h', say('height'), h, 1, 4000, 1),
    choice('units', say('sizesIn'), 'px', '%'),
    flag('keep_ratio', say('keepTheShape'), true),
  ]
}

export const ATTITUDE_OPTIONS: Option[] = [...anchored('bottom right'), ...sized(120, 120).slice(0, 3)]
export const IMAGE_OPTIONS: Option[] = [...anchored('top centre'), ...sized(240, 180)]
export const TEXT_OPTIONS: Option[] = [
  ...anchored('bottom left', 40),
  colour('#ffffff'),
  flag('background', say('darkBehindIt'), true),
  number('font_px', say('size'), 16, 8, 72, 1, 'px'),
  { name: 'prefix', label: say('textBefore'), value: '' },
  { name: 'postfix', label: say('textAfter'), value: '' },
]
export const FLOAT_OPTIONS: Option[] = [...TEXT_OPTIONS, number('digits', say('decimals'), 2, 0, 9, 1)]

/** Where a thing of a size goes on the map. */
export function placedBox(options: Options, surface: { width: number; height: number }, w: number, h: number): Box {
  const anchor = words(options, 'anchor')
  const [dx, dy] = [amount(options, 'offset_x'), amount(options, 'offset_y')]
  const x = anchor.includes('left') ? dx : anchor.includes('right') ? surface.width - w - dx : (surface.width - w) / 2
  const y = anchor.includes('top') ? dy : anchor.includes('bottom') ? surface.height - h - dy : (surface.height - h) / 2
  return { x, y, w, h }
}

export function sizeOf(
  options: Options,
  surface: { width: number; height: number },
  picture?: { width: number; height: number },
): [number, number] {
  const percent = words(options, 'units') === '%'
  const w = percent ? (amount(options, 'w') * surface.width) / 100 : amount(options, 'w')
  if (options.keep_ratio && picture?.width) return [w, (w * picture.height) / picture.width]
  return [w, percent ? (amount(options, 'h') * surface.height) / 100 : amount(options, 'h')]
}

export interface Tilt {
  roll: number
  pitch: number
}

export function foldAttitude(_: Tilt | undefined, message: Imu | Odometry | PoseStamped): Tilt {
  const q =
    'orientation' in message
      ? message.orientation
      : 'position' in message.pose
        ? message.pose.orientation
        : (message as Odometry).pose.pose.orientation
  const { roll, pitch } = anglesOf(q)
  return { roll, pitch }
}

const PITCH_SHOWN = Math.PI / 4

/** An artificial horizon: the ground stays level while the frame tilts with the robot. */
export function paintAttitude({ roll, pitch }: Tilt, surface: Surface, { options }: Setting): void {
  const { pen } = surface
  const box = placedBox(options, surface, ...sizeOf(options, surface))
  const radius = Math.min(box.w, box.h) / 2
  pen.save()
  pen.translate(box.x + box.w / 2, box.y + box.h / 2)
  pen.beginPath()
  pen.arc(0, 0, radius, 0, 7)
  pen.clip()
  pen.rotate(-roll)
  const horizon = Math.max(-1, Math.min(1, -pitch / PITCH_SHOWN)) * radius // nose up (pitch < 0) lowers the horizon
  pen.fillStyle = '#3d84c6'
  pen.fillRect(-2 * radius, -3 * radius, 4 * radius, 6 * radius)
  pen.fillStyle = '#8a5a2b'
  pen.fillRect(-2 * radius, horizon, 4 * radius, 3 * radius)
  pen.strokeStyle = '#ffffff'
  pen.lineWidth = 2
  for (const step of [-2, -1, 0, 1, 2]) {
    const half = step ? radius * 0.22 : 2 * radius
    const y = horizon + (step * radius) / 4.5
    pen.beginPath()
    pen.moveTo(-half, y)
    pen.lineTo(half, y)
    pen.stroke()
  }
  pen.rotate(roll)
  pen.strokeStyle = '#ffd21f'
  pen.lineWidth = 4
  pen.beginPath()
  pen.moveTo(-radius * 0.55, 0)
  pen.lineTo(-radius * 0.18, 0)
  pen.lineTo(0, radius * 0.14)
  pen.lineTo(radius * 0.18, 0)
  pen.lineTo(radius * 0.55, 0)
  pen.stroke()
  pen.restore()
  pen.beginPath()
  pen.arc(box.x + box.w / 2, box.y + box.h / 2, radius, 0, 7)
  pen.strokeStyle = FRAME_COLOUR
  pen.lineWidth = 3
  pen.stroke()
}

export function foldText(_: string | undefined, message: TextMessage, { options }: Setting): string {
  return `${words(options, 'prefix')}${message.data}${words(options, 'postfix')}`
}

export function foldNumber(_: string | undefined, message: NumberMessage, { options }: Setting): string {
  const value = decimals(Number(message.data), amount(options, 'digits'))
  return `${words(options, 'prefix')}${value}${words(options, 'postfix')}`
}

export function paintText(text: string, surface: Surface, { options }: Setting): void {
  const { pen } = surface
  const size = amount(options, 'font_px')
  pen.font = `600 ${size}px system-ui, sans-serif`
  const pad = size * 0.5
  const box = placedBox(options, surface, pen.measureText(text).width + 2 * pad, size * 1.7)
  if (options.background) {
    pen.fillStyle = 'rgb(10 14 12 / 78%)'
    pen.beginPath()
    pen.roundRect(box.x, box.y, box.w, box.h, 8)
    pen.fill()
  }
  pen.fillStyle = words(options, 'color')
  pen.textBaseline = 'middle'
  pen.fillText(text, box.x + pad, box.y + box.h / 2)
  pen.textBaseline = 'alphabetic'
}

type Picture = HTMLCanvasElement
/** Around a picture, and behind what is clear in it. */
const FRAME_COLOUR = '#1a211c'
const FRAME_PX = 2

/** A picture message, or a picture that the page has already. */
export async function foldImage(
  known: Picture | undefined,
  message: RosImage | CompressedImage | Picture,
): Promise<Picture | undefined> {
  return message instanceof HTMLCanvasElement ? message : ((await decoded(message)) ?? known)
}

export function foldDisparity(known: Picture | undefined, message: DisparityImage): Picture | undefined {
  return disparityCanvas(message.image, message.min_disparity, message.max_disparity) ?? known
}

export function paintImage(picture: Picture, surface: Surface, { options }: Setting): void {
  const { x, y, w, h } = placedBox(options, surface, ...sizeOf(options, surface, picture))
  const { pen } = surface
  pen.fillStyle = FRAME_COLOUR
  pen.fillRect(x - FRAME_PX, y - FRAME_PX, w + 2 * FRAME_PX, h + 2 * FRAME_PX)
  pen.drawImage(picture, x, y, w, h)
}

export const ROBOT_IMAGE_OPTIONS: Option[] = [
  { name: 'image', label: say('pictureNoseToTheRight'), value: '' },
  number('w', say('length'), 0.9, 0.05, 20, 0.05, 'm'),
  number('h', say('width'), 0.66, 0.05, 20, 0.05, 'm'),
  flag('keep_ratio', say('keepTheShape'), true),
  number('offset_x', say('forwards'), 0, -10, 10, 0.05, 'm'),
  number('offset_y', say('toTheLeft'), 0, -10, 10, 0.05, 'm'),
]

export function foldRobotPose(_: FramePose | undefined, message: PoseStamped, { robot }: Setting): FramePose {
  return within(frameOf(message.header, robot), message.pose)
}

const pictures = new Map<string, HTMLImageElement>()
const DEFAULT_PICTURE = './robot.svg'

export function paintRobot([x, y, yaw]: FramePose, surface: Surface, { options }: Setting): void {
  const { pen, at, pxPerM, bearing, repaint } = surface
  const url = words(options, 'image') || DEFAULT_PICTURE
  let picture = pictures.get(url)
  if (!picture) {
    picture = new Image()
    picture.onload = repaint
    picture.src = url
    pictures.set(url, picture)
  }
  if (!picture.complete || !picture.naturalWidth) return
  const w = amount(options, 'w')
  const h = options.keep_ratio ? (w * picture.naturalHeight) / picture.naturalWidth : amount(options, 'h')
  pen.save()
  pen.translate(...at(x, y))
  pen.rotate(-yaw - bearing)
  pen.scale(pxPerM, pxPerM)
  pen.drawImage(picture, amount(options, 'offset_x') - w / 2, -amount(options, 'offset_y') - h / 2, w, h)
  pen.restore()
}
