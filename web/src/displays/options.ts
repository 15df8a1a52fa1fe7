/** What an operator can set of a display. The kind of an option follows from its value. */

import { say } from '../say.ts'

export type OptionValue = number | boolean | string
export interface Option {
  name: string
  label: string
  value: OptionValue
  choices?: string[]
  min?: number
  max?: number
  step?: number
  unit?: string
}
export type Options = Record<string, OptionValue>

export const number = (
  name: string,
  label: string,
  value: number,
  min: number,
  max: number,
  step: number,
  unit = '',
): Option => ({ name, label, value, min, max, step, unit })
export const choice = (name: string, label: string, ...choices: string[]): Option => ({
  name,
  label,
  value: choices[0],
  choices,
})
export const colour = (value: string, name = 'color', label = say('colour')): Option => ({ name, label, value })
export const flag = (name: string, label: string, value: boolean): Option => ({ name, label, value })

/** The options of a type with what was chosen; a value of the wrong type is ignored. */
export function filled(options: Option[], chosen: Options = {}): Options {
  return Object.fromEntries(
    options.map((option) => [
      option.name,
      typeof chosen[option.name] === typeof option.value ? chosen[option.name] : option.value,
    ]),
  )
}

export const amount = (options: Options, name: string): number => Number(options[name] ?? 0)
export const words = (options: Options, name: string): string => String(options[name] ?? '')
