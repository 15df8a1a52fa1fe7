/** A form made from the robot's own list of settings; only what may change while it runs can be changed. */

import { api } from '../api.ts'
import type { App, Screen } from '../app.ts'
import { el, replace } from '../dom.ts'
import { bareName, quantity, words } from '../format.ts'
import { setTheme, theme, THEME_NAMES, THEMES } from '../shell/theme.ts'
import { CalibrationCard } from './calibration.ts'
import type { Setting, SettingGroup, SettingValue } from '../wire.ts'
import type { Language } from '../say.ts'
import { keepLanguage, langOf, language, LANGUAGES, named, say } from '../say.ts'

export const settings: Screen = {
  id: 'settings',
  title: say('screenSettings'),
  icon: 'settings',
  async mount(host, app) {
    const calibration = new CalibrationCard(app)
    const column = el(
      'div',
      { class: 'column' },
      pageCard(),
      calibration.node,
      el('p', { class: 'empty' }, say('readingTheSettings')),
    )
    host.append(column)
    const [found] = await Promise.all([app.attempt(api.settings()), calibration.look()])
    if (!found) return () => calibration.close()
    const groups = el('div', { class: 'column' })
    const show = (all: boolean): void => {
      replace(groups, ...found.groups.map((group) => groupCard(group, all, app)))
      if (!groups.childElementCount) groups.append(el('p', { class: 'card empty' }, say('noLiveSetting')))
    }
    const all = el('input', { type: 'checkbox', onchange: () => show(all.checked) })
    replace(
      column,
      pageCard(),
      calibration.node,
      el('label', { class: 'check' }, all, say('showFixedSettings')),
      groups,
    )
    show(false)
    return () => calibration.close()
  },
}

function groupCard(group: SettingGroup, all: boolean, app: App): HTMLElement | null {
  const keys = group.keys.filter((setting) => all || setting.live)
  if (!keys.length) return null
  return el(
    'section',
    { class: 'card stack' },
    el('h2', { lang: langOf(group.name) }, words(group.name)),
    ...keys.map((setting) => row(setting, app)),
  )
}

function pageCard(): HTMLElement {
  const buttons = THEMES.map((name) =>
    el(
      'button',
      {
        type: 'button',
        class: 'segment',
        'aria-pressed': String(name === theme()),
        'data-value': name,
        onclick: () => {
          setTheme(name)
          for (const button of buttons) button.setAttribute('aria-pressed', String(button.dataset.value === name))
        },
      },
      THEME_NAMES[name],
    ),
  )
  return el(
    'section',
    { class: 'card row-card' },
    el(
      'div',
      {},
      el('h2', {}, say('thisPage')),
      el('p', { class: 'muted' }, say('pageCardAbout')),
      el(
        'p',
        { class: 'small' },
        el('a', { href: './licences.txt', target: '_blank', rel: 'noopener' }, say('licences')),
      ),
    ),
    el(
      'div',
      { class: 'page-choices' },
      el('div', { class: 'segments', role: 'group', 'aria-label': say('theme') }, ...buttons),
      el('label', { class: 'field' }, el('span', {}, say('language')), languageChoice()),
    ),
  )
}

function languageChoice(): HTMLElement {
  const known = Object.entries(LANGUAGES) as [Language, string][]
  const select = el(
    'select',
    {
      onchange: () => {
        keepLanguage(select.value as Language)
        location.reload()
      },
    },
    ...known.map(([value, name]) => el('option', { value, lang: value, selected: value === language }, name)),
  )
  return select
}

function row(setting: Setting, app: App): HTMLElement {
  const id = `setting-${setting.key}`
  const input = control(setting, id)
  const about = setting.about && el('p', { class: 'small muted', lang: langOf(setting.about) }, named(setting.about))
  const note = el('p', { class: 'small muted', 'aria-live': 'polite' })
  const describe = (): void => {
    const parts: string[] = []
    if (setting.min !== null || setting.max !== null)
      parts.push(say('settingRange', { min: setting.min ?? '–∞', max: setting.max ?? '∞' }))
    if (String(setting.value) !== String(setting.default))
      parts.push(say('settingDefault', { value: String(setting.default) }))
    note.textContent = parts.join(' ')
    note.classList.remove('form-error')
  }
  describe()
  input.addEventListener('change', () => void apply())
  const apply = async (): Promise<void> => {
    const value = read(setting, input)
    const answer = await app.attempt(api.changeSettings({ [setting.key]: value }))
    const refused = answer?.refused[setting.key]
    if (answer && setting.key in answer.applied) {
      setting.value = answer.applied[setting.key]
      describe()
      const shown = `${setting.value}${setting.unit ? ` ${setting.unit}` : ''}`
      app.toasts.show('info', say('settingIsNow', { name: quantity(setting.key), value: shown }))
    } else if (refused) {
      note.textContent = refused
      note.classList.add('form-error')
    }
    if (read(setting, input) === value) write(setting, input) // else it was changed meanwhile, with an answer to come
  }
  return el(
    'div',
    { class: 'setting' },
    el('div', {}, el('label', { for: id, lang: langOf(bareName(setting.key)) }, quantity(setting.key)), about, note),
    el('div', { class: 'setting-control' }, input, setting.unit !== '' && el('span', { class: 'muted' }, setting.unit)),
  )
}

type Input = HTMLInputElement | HTMLSelectElement

function control(setting: Setting, id: string): Input {
  const disabled = !setting.live
  if (setting.type === 'choice') {
    return el(
      'select',
      { id, disabled },
      ...(setting.choices ?? []).map((choice) =>
        el('option', { value: choice, selected: choice === setting.value }, choice),
      ),
    )
  }
  if (setting.type === 'boolean')
    return el('input', { id, type: 'checkbox', disabled, checked: setting.value === true })
  const number = setting.type === 'number'
  return el('input', {
    id,
    disabled,
    class: 'field-input',
    type: number ? 'number' : 'text',
    step: number ? 'any' : null,
    min: setting.min,
    max: setting.max,
    value: String(setting.value),
    autocomplete: 'off',
  })
}

function read(setting: Setting, input: Input): SettingValue {
  if (setting.type === 'number') return Number(input.value)
  return input instanceof HTMLInputElement && setting.type === 'boolean' ? input.checked : input.value
}

function write(setting: Setting, input: Input): void {
  if (input instanceof HTMLInputElement && setting.type === 'boolean') input.checked = setting.value === true
  else input.value = String(setting.value)
}
