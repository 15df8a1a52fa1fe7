/** The robot in three dimensions. */

import type { App, Screen } from '../app.ts'
import { el, replace, setText } from '../dom.ts'
import { fixed, words } from '../format.ts'
import { icon } from '../icons.ts'
import type { Joint, Scene } from '../scene/scene.ts'
import { onTheme } from '../shell/theme.ts'
import { decimals, langOf, say } from '../say.ts'

export const robot: Screen = {
  id: 'robot',
  title: say('screenRobot'),
  icon: 'robot',
  async mount(host, app) {
    const stage = el('div', { class: 'card stage' })
    const joints = el('div', { class: 'card stack joints' })
    const view = el('div', { class: 'card stack' })
    host.append(stage, el('div', { class: 'side' }, view, joints))
    if (app.off.has('scene') || !app.robot) {
      stage.append(el('p', { class: 'empty' }, app.robot ? say('sceneIsOff') : say('noDescription')))
      return () => undefined
    }
    const scene = await makeScene(stage)
    if (!scene) return () => undefined
    if (app.store.isSlow) scene.drawLess()
    replace(
      view,
      el('h2', {}, say('view')),
      ...(app.session.source === 'description' ? [] : [followButton(scene)]),
      check(say('camerasFieldOfView'), true, (on) => scene.showFrustum(on)),
      check(say('framesOfTheLinks'), false, (on) => scene.showFrames(on)),
    )
    if (window.__agribot) window.__agribot.scene = () => scene.shown()
    const undo = [onTheme(() => scene.recolour()), app.store.on('slow', () => scene.drawLess())]
    void showRobot(scene, app, joints, undo)
    return () => {
      for (const work of undo) work()
      if (window.__agribot) window.__agribot.scene = null
      scene.close()
    }
  },
}

async function makeScene(stage: HTMLElement): Promise<Scene | null> {
  try {
    const { Scene } = await import('../scene/scene.ts')
    return new Scene(stage)
  } catch {
    stage.append(el('p', { class: 'empty' }, say('noWebGlForScene')))
    return null
  }
}

async function showRobot(scene: Scene, app: App, joints: HTMLElement, undo: (() => void)[]): Promise<void> {
  if (!app.robot) return
  const found = await app.attempt(scene.load(app.robot))
  if (!found || !joints.isConnected) return // or the screen was left meanwhile
  const wheels = app.robot.wheel_joints
  undo.push(app.store.on('state', (state) => scene.update(state, wheels)))
  undo.push(...jointPanel(scene, app, joints, found))
}

/**
 * Live joints show their angle; the others, and all of them with no live data, have a slider.
 * Returns how to end it.
 */
function jointPanel(scene: Scene, app: App, panel: HTMLElement, found: Joint[]): (() => void)[] {
  const undo: (() => void)[] = []
  const isLive = (): boolean => Boolean(app.store.state?.joints_rad.length) && !app.store.stale
  const live = isLive() ? new Set(app.robot?.wheel_joints ?? []) : new Set<string>()
  const rows = found.map((joint) => {
    const { name, lower, upper } = joint
    if (live.has(name)) {
      const angle = el('span', { class: 'value' })
      const index = app.robot?.wheel_joints.indexOf(name) ?? 0
      undo.push(
        app.store.on('state', (state) =>
          setText(angle, `${decimals((((state.joints_rad[index] ?? 0) * 180) / Math.PI) % 360, 0)}°`),
        ),
      )
      return el('div', { class: 'label-row' }, el('span', { lang: langOf(name) }, words(name)), angle)
    }
    const at = Math.min(Math.max(0, lower), upper)
    const place = el('span', { class: 'value' }, jointPlace(joint, at))
    const slider = el('input', {
      type: 'range',
      min: lower,
      max: upper,
      step: (upper - lower) / 720,
      value: at,
      'aria-label': words(name),
      oninput: () => {
        scene.setJoint(name, Number(slider.value))
        setText(place, jointPlace(joint, Number(slider.value)))
      },
    })
    return el(
      'div',
      { class: 'field' },
      el('div', { class: 'label-row' }, el('span', { lang: langOf(name) }, words(name)), place),
      slider,
    )
  })
  replace(panel, el('h2', {}, say('joints')), ...rows)
  return undo
}

function jointPlace(joint: Joint, value: number): string {
  return joint.unit === 'm' ? fixed(value, 3, 'm') : `${decimals((value * 180) / Math.PI, 0)}°`
}

function followButton(scene: Scene): HTMLElement {
  const button = el(
    'button',
    {
      type: 'button',
      class: 'button',
      'aria-pressed': 'true',
      onclick: () => {
        scene.follow = !scene.follow
        button.setAttribute('aria-pressed', String(scene.follow))
      },
    },
    icon('follow', 20),
    say('followTheRobot'),
  )
  return button
}

function check(label: string, on: boolean, change: (on: boolean) => void): HTMLElement {
  const box = el('input', { type: 'checkbox', checked: on, onchange: () => change(box.checked) })
  return el('label', { class: 'check' }, box, label)
}
