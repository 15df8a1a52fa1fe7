/** Texts of the page in the language that this browser uses, which stays the same until the page is loaded again. */

import { en } from './texts/en.ts'
import type { Forms, Key, Texts, ValuesOf } from './texts/types.ts'

interface Table {
  texts: Texts
  /** What the robot calls by an English name. */
  names: Readonly<Record<string, string>>
}

/** Read when the page uses one. */
export const TABLES = {
  en: async (): Promise<Table> => ({ texts: en, names: {} }),
  de: (): Promise<Table> => import('./texts/de.ts'),
  hi: (): Promise<Table> => import('./texts/hi.ts'),
}
export type Language = keyof typeof TABLES
/** Each by its own name. */
export const LANGUAGES: Record<Language, string> = { en: 'English', de: 'Deutsch', hi: 'हिन्दी' }
const KEPT = 'language'
const PLAIN_DIGITS = 6
const NUMBER = /\d+(?:\.\d+)?/g

const isLanguage = (name: string): name is Language => name in TABLES

/** The one that was chosen here, or the first of the browser's that the page knows. */
export function findLanguage(kept: string | null, wanted: readonly string[]): Language {
  const known = [kept ?? '', ...wanted].map((name) => name.toLowerCase().split('-')[0])
  return known.find(isLanguage) ?? 'en'
}

/** Kept in this browser; takes effect when the page is loaded again. */
export function keepLanguage(language: Language): void {
  localStorage.setItem(KEPT, language)
}

const isPage = typeof document !== 'undefined'
const wanted = isPage ? navigator.languages : []
export const language: Language = isPage ? findLanguage(localStorage.getItem(KEPT), wanted) : 'en'
if (isPage) document.documentElement.lang = language
let table = await TABLES[language]().catch(TABLES.en) // a page without its texts still has STOP
/** That of the region, where the browser names one. */
let locale = wanted.find((name) => name.toLowerCase().startsWith(language)) ?? language
let plurals = new Intl.PluralRules(locale)
const formats = new Map<number, Intl.NumberFormat>()

/** For tests: the page itself has one language. */
export async function useLanguage(other: Language): Promise<void> {
  table = await TABLES[other]()
  locale = other
  plurals = new Intl.PluralRules(locale)
  formats.clear()
}

/** A text of the page, with values in place of the names in braces. */
export function say<K extends Key>(key: K, ...[values]: ValuesOf<K>): string {
  return fill(table.texts[key], values ?? {})
}

function fill(text: string | Forms, values: Record<string, string | number>): string {
  if (typeof text !== 'string') return fill(choose(text, Number(values.count)), values)
  return text.replace(/\{(\w+)\}/g, (_, name: string) => String(values[name]))
}

function choose(forms: Forms, count: number): string {
  return plurals.select(count) === 'one' ? forms.one : forms.other
}

/** What is called so by the robot, with its own numbers; undefined where the language has no name for it. */
export function findName(name: string): string | undefined {
  const numbers = name.match(NUMBER) ?? []
  const known = table.names[name.replace(NUMBER, '#')]
  return known?.replace(/#/g, () => numbers.shift() ?? '')
}

/** The name that the language has for it, else the robot's own. */
export function named(name: string): string {
  return findName(name) ?? name
}

/** The language of what the robot says: null for the page's own, as an attribute of the element that shows it. */
export function langOf(said: string): Language | null {
  return language === 'en' || !/[a-z]/i.test(said) || findName(said) !== undefined ? null : 'en'
}

/** A number with as many decimals, as the language writes it. */
export function decimals(value: number, digits: number): string {
  let format = formats.get(digits)
  if (!format) {
    const options = { minimumFractionDigits: digits, maximumFractionDigits: digits, useGrouping: false }
    format = new Intl.NumberFormat(locale, options)
    formats.set(digits, format)
  }
  return format.format(value)
}

/** A number with the decimals that it has. */
export function plain(value: number): string {
  return value.toLocaleString(locale, { maximumFractionDigits: PLAIN_DIGITS, useGrouping: false })
}

/** A count of many things, with its thousands apart. */
export function many(count: number): string {
  return count.toLocaleString(locale)
}

/** Day and time of the day. */
export function dated(when: Date): string {
  return when.toLocaleString(locale, { dateStyle: 'medium', timeStyle: 'short' })
}
