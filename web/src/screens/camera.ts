/** The camera, large, with what the network sees laid over it. */

import { api } from '../api.ts'
import type { App, Screen } from '../app.ts'
import { CameraPicture, CLASSES } from '../camera/picture.ts'
import { download, el, setText } from '../dom.ts'
import { icon } from '../icons.ts'
import { say } from '../say.ts'

export const camera: Screen = {
  id: 'camera',
  title: say('camera'),
  icon: 'camera',
  mount(host, app) {
    if (!app.session.camera) {
      host.append(el('p', { class: 'card empty' }, say('noCameraInProfile')))
      return () => undefined
    }
    const picture = new CameraPicture(app.store)
    const label = el('span', { class: 'picture-label' })
    const freeze = el(
      'button',
      {
        type: 'button',
        class: 'button',
        'aria-pressed': 'false',
        onclick: () => {
          picture.frozen = !picture.frozen
          freeze.setAttribute('aria-pressed', String(picture.frozen))
        },
      },
      icon('freeze', 20),
      say('freeze'),
    )
    const save = el(
      'button',
      {
        type: 'button',
        class: 'button',
        onclick: () => {
          picture.image.toBlob((blob) => blob && download(`camera-${Date.now()}.png`, blob), 'image/png')
        },
      },
      icon('download', 20),
      say('savePicture'),
    )
    const keep = keepButton(app)
    const frame = el('div', { class: 'card camera-frame' }, picture.node, label)
    host.append(
      frame,
      el(
        'div',
        { class: 'card camera-tools' },
        el('h2', {}, say('overlay')),
        overlaySlider(picture),
        classToggles(picture),
        el('div', { class: 'button-row' }, freeze, save, keep),
      ),
    )
    const timer = setInterval(() => {
      const nowMs = performance.now()
      setText(label, picture.frozen ? say('frozenLabel', { label: picture.label(nowMs) }) : picture.label(nowMs))
      keep.disabled = !app.mayCommand || picture.frozen // the robot keeps its newest frame, not the one that is shown
    }, 250)
    return () => {
      clearInterval(timer)
      picture.close()
    }
  },
}

function keepButton(app: App): HTMLButtonElement {
  return el(
    'button',
    {
      type: 'button',
      class: 'button',
      disabled: true,
      title: say('keepFrameTitle'),
      onclick: () => void keepFrame(app),
    },
    icon('save', 20),
    say('keepForTraining'),
  )
}

async function keepFrame(app: App): Promise<void> {
  const kept = await app.attempt(api.keepFrame())
  if (kept) app.toasts.show('info', say('keptFrame', kept))
}

function overlaySlider(picture: CameraPicture): HTMLElement {
  const value = el('span', { class: 'value' })
  const slider = el('input', {
    type: 'range',
    min: 0,
    max: 1,
    step: 0.05,
    value: picture.opacity,
    oninput: () => apply(),
  })
  const apply = (): void => {
    picture.setOpacity(Number(slider.value))
    setText(value, `${Math.round(picture.opacity * 100)} %`)
  }
  setText(value, `${Math.round(picture.opacity * 100)} %`)
  return el('label', { class: 'field' }, el('span', { class: 'label-row' }, say('opacity'), value), slider)
}

function classToggles(picture: CameraPicture): HTMLElement {
  return el(
    'div',
    { class: 'checks' },
    ...CLASSES.map((cls) => {
      const box = el('input', {
        type: 'checkbox',
        checked: picture.shown.has(cls.index),
        onchange: () => picture.toggleClass(cls.index, box.checked),
      })
      return el('label', { class: 'check' }, box, el('span', { class: `swatch class-${cls.index}` }), cls.name)
    }),
  )
}
