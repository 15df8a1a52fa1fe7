import './label.css'
import { el, setText } from '../dom.ts'
import { startTheme } from '../shell/theme.ts'
import { LabelCanvas } from './canvas.ts'
import { Gestures } from './gestures.ts'
import { KINDS } from './painting.ts'
import { makeBar, makeComputing, makePanel, setRadius } from './panel.ts'
import { Session } from './session.ts'

const LOOK_MS = 2000
const PROBLEM_MS = 8000

function keysOf(session: Session, canvas: LabelCanvas): Map<string, () => void> {
  const keys = new Map<string, () => void>([
    ['p', () => void session.setTool('plant')],
    ['r', () => void session.setTool('rename')],
    ['b', () => void session.setTool('brush')],
    ['f', () => void session.setTool('fill')],
    ['v', () => void session.setTool('move')],
    ['z', () => session.undo()],
    ['y', () => session.redo()],
    ['0', () => canvas.fit()],
    ['+', () => canvas.zoom(1.25)],
    ['-', () => canvas.zoom(0.8)],
    ['[', () => setRadius(session, session.radius - Math.ceil(session.radius / 5))],
    [']', () => setRadius(session, session.radius + Math.ceil(session.radius / 5))],
    ['arrowleft', () => void session.step(-1)],
    ['arrowright', () => void session.step(1)],
    ['enter', () => void session.finish()],
  ])
  for (const kind of KINDS) {
    keys.set(kind.key, () => {
      session.kind = kind.id
      session.emit('change', undefined)
    })
  }
  return keys
}

function listenToKeys(session: Session, canvas: LabelCanvas): void {
  const keys = keysOf(session, canvas)
  addEventListener('keydown', (event) => {
    const target = event.target as HTMLElement
    const isOfSlider = target.matches('input') && /^(Arrow|Page|Home|End)/.test(event.key)
    const isOfButton = target.matches('button') && event.key === 'Enter'
    const isHeld = event.key === 'Enter' && event.repeat // one press finishes one picture
    if (isOfSlider || isOfButton || isHeld || event.altKey) return
    const isRedo = event.key.toLowerCase() === 'z' && event.shiftKey
    const press = keys.get(isRedo ? 'y' : event.key.toLowerCase())
    if (!press || (event.ctrlKey && !['z', 'y'].includes(event.key.toLowerCase()))) return
    event.preventDefault()
    press()
  })
}

function showProblems(session: Session): HTMLElement {
  const node = el('p', { class: 'problem', role: 'alert', hidden: true })
  let timer = 0
  session.on('problem', (text) => {
    setText(node, text)
    node.hidden = false
    clearTimeout(timer)
    timer = window.setTimeout(() => (node.hidden = true), PROBLEM_MS)
  })
  return node
}

/** Asks for the list until the network has seen all pictures. */
async function watch(session: Session): Promise<void> {
  while (session.pictures.some((one) => one.uncertainty === null)) {
    await new Promise((resolve) => setTimeout(resolve, LOOK_MS))
    await session.refresh().catch(() => undefined)
  }
}

async function boot(): Promise<void> {
  startTheme()
  const canvas = new LabelCanvas()
  const session = new Session(canvas)
  new Gestures(canvas, session)
  document.body.append(
    el(
      'div',
      { class: 'label-page' },
      makeBar(session),
      el('main', {}, canvas.node, makeComputing(session), showProblems(session)),
      makePanel(session, canvas),
    ),
  )
  listenToKeys(session, canvas)
  addEventListener('beforeunload', (event) => session.isUnsaved && event.preventDefault())
  await session.start().catch((error: Error) => session.emit('problem', error.message))
  await watch(session)
}

void boot()
