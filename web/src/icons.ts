/** The page's icons: 24 px line drawings, inline, so that no font and no request is needed. */

import { svg } from './dom.ts'

const PATHS = {
  drive: 'M12 3 19 21l-7-4-7 4Z',
  plan: 'M4 7l6-3 5 3 5-3v13l-5 3-5-3-6 3ZM10 4v13M15 7v13',
  teleop:
    'M12 3v5m0 8v5m9-9h-5M8 12H3m9-9L9.5 5.5M12 3l2.5 2.5M12 21l-2.5-2.5M12 21l2.5-2.5M3 12l2.5-2.5M3 12l2.5 2.5' +
    'M21 12l-2.5-2.5M21 12l-2.5 2.5M12 10a2 2 0 1 0 0 4 2 2 0 0 0 0-4Z',
  robot: 'M12 2.5 20.5 7v10L12 21.5 3.5 17V7ZM3.5 7 12 12l8.5-5M12 12v9.5',
  camera: 'M3 8h4l2-3h6l2 3h4v11H3ZM12 10a3.5 3.5 0 1 0 0 7 3.5 3.5 0 0 0 0-7Z',
  plots: 'M3 3v18h18M7 15l4-5 3 3 5-7',
  weeds: 'M12 21v-9m0 3c-5 0-7-3-7-7 5 0 7 3 7 7Zm0-3c0-5 3-7 7-7 0 5-3 7-7 7ZM6 21h12',
  recordings: 'M12 3a9 9 0 1 0 0 18 9 9 0 0 0 0-18ZM10 8.5v7l6-3.5Z',
  record: 'M12 3a9 9 0 1 0 0 18 9 9 0 0 0 0-18ZM12 8.5a3.5 3.5 0 1 0 0 7 3.5 3.5 0 0 0 0-7Z',
  settings: 'M4 6h10m4 0h2M4 12h2m4 0h10M4 18h8m4 0h4M16 4v4M8 10v4m6 2v4',
  health: 'M3 12h4l3-8 4 16 3-8h4',
  more: 'M5 12h.01M12 12h.01M19 12h.01',
  play: 'M7 4.5v15l12-7.5Z',
  pause: 'M8 5v14M16 5v14',
  cancel: 'M6 6l12 12M18 6 6 18',
  skip: 'M5 5v14l9-7ZM18 5v14',
  home: 'M4 11l8-7 8 7v9h-5v-6H9v6H4Z',
  stop: 'M8.2 3h7.6L21 8.2v7.6L15.8 21H8.2L3 15.8V8.2Z',
  layers: 'M12 3 3 8l9 5 9-5ZM3 12.5l9 5 9-5M3 17l9 5 9-5',
  follow: 'M12 2v4m0 12v4M2 12h4m12 0h4M12 7a5 5 0 1 0 0 10 5 5 0 0 0 0-10Z',
  fit: 'M4 9V4h5M20 9V4h-5M4 15v5h5M20 15v5h-5',
  measure: 'M3 16 16 3l5 5L8 21ZM7 12l2 2m1-5 2 2m1-5 2 2',
  pin: 'M12 21s7-6.5 7-12a7 7 0 0 0-14 0c0 5.5 7 12 7 12ZM12 7a2.5 2.5 0 1 0 0 5 2.5 2.5 0 0 0 0-5Z',
  pose: 'M5 19 19 5m0 0h-7m7 0v7M5 16a3 3 0 1 0 0 6 3 3 0 0 0 0-6Z',
  goal: 'M6 21V4m0 0h12l-3 4.5L18 13H6',
  point: 'M12 9a3 3 0 1 0 0 6 3 3 0 0 0 0-6ZM12 2v3m0 14v3M2 12h3m14 0h3',
  plus: 'M12 5v14M5 12h14',
  up: 'M12 19V5m-6 6 6-6 6 6',
  down: 'M12 5v14m-6-6 6 6 6-6',
  left: 'M19 12H5m6-6-6 6 6 6',
  right: 'M5 12h14m-6-6 6 6-6 6',
  video: 'M3 6h12v12H3ZM15 11l6-4v10l-6-4',
  tools: 'M14.8 6.2a4.2 4.2 0 0 0-5.6 5.3L3 17.7 6.3 21l6.2-6.2a4.2 4.2 0 0 0 5.3-5.6l-2.6 2.6-3-.9-.8-2.9Z',
  copy: 'M8 8h12v12H8ZM16 8V4H4v12h4',
  minus: 'M5 12h14',
  theme: 'M12 3a9 9 0 1 0 0 18ZM12 3a9 9 0 0 1 0 18',
  link: 'M4 15a11 11 0 0 1 16 0M7.5 18a6 6 0 0 1 9 0M12 21h.01M1.5 11.5a15 15 0 0 1 21 0',
  clock: 'M12 3a9 9 0 1 0 0 18 9 9 0 0 0 0-18ZM12 7v5l3.5 2',
  satellite: 'M8 8 4 4m4 4-3 3 4 4 3-3M8 8l3-3 4 4-3 3m0 0 4 4m-1-1 3-3 4 4-3 3-4-4M5 17a4 4 0 0 0 3 3',
  battery: 'M3 8h15v8H3ZM21 11v2',
  person: 'M12 4a4 4 0 1 0 0 8 4 4 0 0 0 0-8ZM4 21c0-4 4-6 8-6s8 2 8 6',
  people:
    'M9 5a3.5 3.5 0 1 0 0 7 3.5 3.5 0 0 0 0-7ZM2.5 20c0-3.5 3-5.5 6.5-5.5s6.5 2 6.5 5.5' +
    'M16 5.5a3.5 3.5 0 0 1 0 6.5M18 15c2 .6 3.5 2.3 3.5 5',
  save: 'M5 4h11l3 3v13H5ZM8 4v5h7V4M8 20v-6h8v6',
  download: 'M12 4v11m0 0-4-4m4 4 4-4M4 20h16',
  upload: 'M12 16V5m0 0L8 9m4-4 4 4M4 20h16',
  undo: 'M9 7 4 12l5 5M4 12h10a6 6 0 0 1 0 12',
  redo: 'm15 7 5 5-5 5M20 12H10a6 6 0 0 0 0 12',
  trash: 'M4 7h16M9 7V4h6v3M6 7l1 13h10l1-13',
  polygon: 'M12 3l9 6.5-3.5 10.5h-11L3 9.5Z',
  line: 'M4 20 20 4M4 20h.01M20 4h.01',
  hand:
    'M8 12V5.5a1.5 1.5 0 0 1 3 0V11m0-6.5a1.5 1.5 0 0 1 3 0V11m0-5a1.5 1.5 0 0 1 3 0v8' +
    'c0 4-2.5 7-6 7s-5-2-6.5-5L3 13c1-1.5 3-1 4 .5l1 1.5',
  check: 'm4 12.5 5 5L20 6.5',
  warning: 'M12 3 22 20H2ZM12 10v4.5M12 17.5h.01',
  info: 'M12 3a9 9 0 1 0 0 18 9 9 0 0 0 0-18ZM12 11v5.5M12 7.5h.01',
  freeze: 'M12 2v20M3.5 7l17 10M20.5 7l-17 10',
  image: 'M3 5h18v14H3ZM3 16l5-5 5 5 3-3 5 5M15 8.5h.01',
  mark: 'M6 3h12v18l-6-5-6 5Z',
  gamepad:
    'M7 8h10a5 5 0 0 1 5 5.5c0 4-3.5 5-5.5 2.5h-9C5.5 18.5 2 17.5 2 13.5A5 5 0 0 1 7 8Z' +
    'M7 11v3m-1.5-1.5h3M15.5 12h.01M18 13.5h.01',
  tag: 'M4 4h8l8 8-8 8-8-8ZM8 8h.01',
} as const

export type IconName = keyof typeof PATHS

export function icon(name: IconName, size = 24): SVGSVGElement {
  return svg(
    'svg',
    {
      class: 'icon',
      viewBox: '0 0 24 24',
      width: size,
      height: size,
      fill: 'none',
      stroke: 'currentColor',
      'stroke-width': name === 'more' ? '3' : '1.8',
      'stroke-linecap': 'round',
      'stroke-linejoin': 'round',
      'aria-hidden': 'true',
    },
    svg('path', { d: PATHS[name] }),
  )
}
