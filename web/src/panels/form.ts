/** Reads the fields of a struct out of its JSON schema, and values out of the form's inputs. */

import type { SettingValue } from '../wire.ts'

/** As much of a JSON schema as msgspec makes of a struct. */
export interface FormField {
  type?: string
  default?: SettingValue
  enum?: string[]
  minimum?: number
  maximum?: number
  description?: string
  title?: string
}
export interface FormSchema {
  $ref?: string
  $defs?: Record<string, FormSchema>
  properties?: Record<string, FormField>
  required?: string[]
}

export interface NamedField extends FormField {
  name: string
  required: boolean
}

export function fieldsOf(schema: FormSchema): NamedField[] {
  const name = schema.$ref?.split('/').pop()
  const body = (name ? schema.$defs?.[name] : undefined) ?? schema
  return Object.entries(body.properties ?? {}).map(([key, field]) => ({
    ...field,
    name: key,
    required: body.required?.includes(key) ?? false,
  }))
}

/** What the input holds, as the type that the field wants. */
export function readField(field: NamedField, text: string, checked: boolean): SettingValue {
  if (field.type === 'boolean') return checked
  return field.type === 'number' || field.type === 'integer' ? Number(text) : text
}
