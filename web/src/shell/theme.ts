/** Light, dark and sunlight; kept in this browser. */

import { say } from '../say.ts'

export const THEMES = ['light', 'dark', 'sun'] as const
export type Theme = (typeof THEMES)[number]
export const THEME_NAMES: Record<Theme, string> = {
  light: say('themeLight'),
  dark: say('themeDark'),
  sun: say('sunlight'),
}

const listeners = new Set<() => void>()

export function theme(): Theme {
  const saved = document.documentElement.dataset.theme
  return THEMES.find((name) => name === saved) ?? 'light'
}

export function setTheme(next: Theme): void {
  document.documentElement.dataset.theme = next
  localStorage.setItem('theme', next)
  for (const listener of listeners) listener()
}

export function startTheme(): void {
  const saved = localStorage.getItem('theme')
  const system: Theme = matchMedia('(prefers-color-scheme: dark)').matches ? 'dark' : 'light'
  setTheme(THEMES.find((name) => name === saved) ?? system)
}

export function onTheme(listener: () => void): () => void {
  listeners.add(listener)
  return () => listeners.delete(listener)
}

/** The value of a CSS variable of the theme, for canvases. */
export function colour(name: string): string {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim()
}
