/** Driving by hand: pad, keys, gamepad; needs the seat, stops when anything lets go. */

import type { App, Screen } from '../app.ts'
import { CameraPicture } from '../camera/picture.ts'
import { el, setText } from '../dom.ts'
import { icon } from '../icons.ts'
import { savedScale } from '../link.ts'
import { HAND_MS } from '../link-monitor.ts'
import { chooseSeat, takeSeat } from '../shell/seat.ts'
import { GamepadLine } from '../teleop/gamepad-line.ts'
import { listenKeys, listenLeaving, listenPad } from '../teleop/inputs.ts'
import type { Limits } from '../teleop/machine.ts'
import { SCALES, TeleopMachine } from '../teleop/machine.ts'
import { fixed } from '../format.ts'
import { say } from '../say.ts'

const SEND_EVERY_MS = 50
const HUNG_MS = 1000
const HELP = say('driveHelp')
const AGAIN = say('holdAgain')
const ARM_FIRST = say('armFirst')
const SEAT_FIRST = say('takeControlFirst')

export const teleop: Screen = {
  id: 'teleop',
  title: say('screenTeleop'),
  icon: 'teleop',
  mount(host, app) {
    const machine = new TeleopMachine()
    const knob = el('div', { class: 'pad-knob', 'aria-hidden': 'true' })
    const pad = makePad(knob)
    const readout = el('output', { class: 'readout' })
    const gamepad = new GamepadLine()
    const arm = armSwitch(app, machine)
    const camera = app.session.camera && !app.off.has('camera') ? new CameraPicture(app.store, false) : null
    const label = el('span', { class: 'picture-label' })
    host.append(
      el(
        'div',
        { class: 'card teleop-view' },
        camera ? camera.node : el('p', { class: 'empty' }, say('noCamera')),
        camera && label,
      ),
      el(
        'div',
        { class: 'card teleop-pad' },
        arm.node,
        pad,
        arm.whyNot,
        readout,
        scaleChoice(app),
        el('p', { class: 'muted help' }, HELP),
        gamepad.node,
      ),
    )
    listenPad(pad, knob, machine)
    const undo = [
      listenKeys(machine),
      listenLeaving(() => {
        machine.releaseAll()
        send(app, machine)
      }),
      arm.done,
    ]
    let lastMs = performance.now()
    const sender = setInterval(() => {
      const nowMs = performance.now()
      if (nowMs - lastMs > HUNG_MS) machine.releaseAll() // the robot stood meanwhile and shall not set off by itself
      lastMs = nowMs
      if (app.store.isStopped) machine.releaseAll() // nor when somebody clears the stop
      gamepad.tick(machine)
      arm.update()
      send(app, machine)
      showDrive(readout, app)
      if (camera) setText(label, camera.label(performance.now()))
    }, SEND_EVERY_MS)
    return () => {
      clearInterval(sender)
      machine.setArmed(false)
      send(app, machine)
      for (const work of undo) work()
      camera?.close()
    }
  },
}

function makePad(knob: HTMLElement): HTMLElement {
  return el(
    'div',
    {
      class: 'pad',
      role: 'application',
      tabindex: 0,
      'aria-label': say('drivePad'),
    },
    ...['up', 'right', 'down', 'left'].map((way) => el('span', { class: `pad-arrow ${way}`, 'aria-hidden': 'true' })),
    knob,
  )
}

function limits(app: App): Limits {
  return { speedMps: app.robot?.max_speed_mps ?? 0.5, yawRateRadps: app.robot?.max_yaw_rate_radps ?? 0.5 }
}

function send(app: App, machine: TeleopMachine): void {
  const drive = machine.tick(limits(app))
  const sentMs = app.store.monitor.robotMs(performance.now())
  if (drive) app.link.send({ kind: 'drive_by_hand', v_mps: drive.v, yaw_rate_radps: drive.w, mono_ms: sentMs })
}

function showDrive(readout: HTMLElement, app: App): void {
  const state = app.store.state
  const [v, w] = [state?.v_mps ?? 0, state?.yaw_rate_radps ?? 0]
  setText(readout, `${fixed(v, 2, 'm/s')}   ${fixed((w * 180) / Math.PI, 0, '°/s')}`)
}

function armSwitch(
  app: App,
  machine: TeleopMachine,
): { node: HTMLElement; whyNot: HTMLElement; update: () => void; done: () => void } {
  const button = el('button', { type: 'button', class: 'button primary arm', 'aria-pressed': 'false' })
  const word = el('span')
  const why = el('p', { class: 'why-not', role: 'status' })
  button.append(icon('hand', 20), word)
  let wanted = false
  const update = (): void => {
    const { store } = app
    const allowed = app.mayDriveByHand
    if (store.seat !== 'you' && machine.isArmed) wanted = false
    machine.setArmed(wanted && allowed)
    button.setAttribute('aria-pressed', String(machine.isArmed))
    setText(why, whyNot(app, machine, wanted))
    setText(
      word,
      machine.isArmed ? say('drivingByHandEnd') : store.seat === 'you' ? say('driveByHand') : say('takeControlToDrive'),
    )
    document.querySelector('.pad')?.classList.toggle('armed', machine.isArmed)
  }
  const arm = async (): Promise<void> => {
    const onMission = app.store.state?.mode === 'mission'
    if (
      onMission &&
      !(await app.dialogs.confirm(say('interruptTheMission'), [say('interruptBody')], say('driveByHand'), 'danger'))
    )
      return
    wanted = true
    update()
  }
  const takeSeatAndArm = async (): Promise<void> => {
    if (await takeSeat(app)) void arm()
  }
  button.addEventListener('click', () => {
    if (machine.isArmed || wanted) wanted = false
    else if (app.store.seat === 'you') void arm()
    else if (app.store.seat === 'free') void takeSeatAndArm()
    else void chooseSeat(app)
    update()
  })
  update()
  return { node: button, whyNot: why, update, done: app.store.on('seat', update) }
}

const seconds = (ms: number): string => fixed(ms / 1000, 1, 's')

/** Why what is held does not drive, or would not. */
function whyNot(app: App, machine: TeleopMachine, wanted: boolean): string {
  if (wanted && !app.mayDriveByHand) return slowText(app)
  if (!machine.isHeldInVain || app.store.isStopped) return ''
  return machine.isArmed ? AGAIN : app.store.seat === 'you' ? ARM_FIRST : SEAT_FIRST
}

/** Why a hand may not drive now. */
function slowText({ store }: App): string {
  const { roundTripMs } = store.monitor
  if (!store.linked) return say('noLink')
  if (!store.answers || roundTripMs > HAND_MS)
    return say('answersTooLate', { time: seconds(roundTripMs), limit: seconds(HAND_MS) })
  return store.stale ? say('dataTooOld') : ''
}

function scaleChoice(app: App): HTMLElement {
  const saved = savedScale()
  const buttons = SCALES.map((value) =>
    el(
      'button',
      {
        type: 'button',
        class: 'segment',
        'aria-pressed': String(value === saved),
        'data-value': value,
        onclick: () => choose(value),
      },
      `${value * 100} %`,
    ),
  )
  const choose = (value: number): void => {
    for (const button of buttons) button.setAttribute('aria-pressed', String(Number(button.dataset.value) === value))
    localStorage.setItem('speed-scale', String(value))
    app.link.send({ kind: 'scale_speed', ratio: value })
  }
  return el('div', { class: 'segments', role: 'group', 'aria-label': say('speedLimit') }, ...buttons)
}
