/** What a text is and takes, read from the English ones. */

import type { en } from './en.ts'

/** A text for one thing and one for several. */
export interface Forms {
  one: string
  other: string
}
type English = typeof en
export type Key = keyof English
/** What the file of another language holds: no text less, and none more. */
export type Texts = { [K in Key]: English[K] extends string ? string : Forms }

type FormsOf<Text> = Text extends string ? Text : Text extends Forms ? Text[keyof Forms] : never
type Named<Text> = Text extends `${string}{${infer Name}}${infer Rest}` ? Name | Named<Rest> : never
type NamesOf<K extends Key> = Named<FormsOf<English[K]>>
/** The values that a text wants by the names in its braces; none where it has none. */
export type ValuesOf<K extends Key> = [NamesOf<K>] extends [never] ? [] : [values: Record<NamesOf<K>, string | number>]
