import { api, message } from '../api.ts'
import { el } from '../dom.ts'
import { say } from '../say.ts'

/** Ask for the access token until the server takes it. */
export function login(host: HTMLElement): Promise<void> {
  return new Promise((resolve) => {
    const input = el('input', {
      type: 'password',
      class: 'field-input',
      autocomplete: 'current-password',
      required: true,
    })
    const error = el('p', { class: 'form-error', role: 'alert' })
    const form = el(
      'form',
      { class: 'login card' },
      el('h2', {}, 'AGRIBOT'),
      el('p', {}, say('enterToken')),
      el('label', { class: 'field' }, el('span', {}, say('accessToken')), input),
      error,
      el('button', { class: 'button primary', type: 'submit' }, say('open')),
    )
    const page = el('div', { class: 'login-page' }, form)
    form.addEventListener('submit', (event) => {
      event.preventDefault()
      api.login(input.value.trim()).then(
        () => {
          page.remove()
          resolve()
        },
        (problem: unknown) => (error.textContent = message(problem)),
      )
    })
    host.append(page)
    input.focus()
  })
}
