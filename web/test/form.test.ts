import assert from 'node:assert/strict'
import { test } from 'node:test'
import { fieldsOf, readField } from '../src/panels/form.ts'

const schema = {
  $ref: '#/$defs/Spray',
  $defs: {
    Spray: {
      properties: {
        rate: { type: 'number', default: 0.5 },
        count: { type: 'integer' },
        dry: { type: 'boolean' },
        note: { type: 'string' },
      },
      required: ['count'],
    },
  },
}

test('the fields of a struct are found behind the reference of its schema', () => {
  const fields = fieldsOf(schema)
  assert.deepEqual(
    fields.map((f) => f.name),
    ['rate', 'count', 'dry', 'note'],
  )
  assert.deepEqual(
    fields.filter((f) => f.required).map((f) => f.name),
    ['count'],
  )
})

test('a value has the type that its field wants', () => {
  assert.deepEqual(
    fieldsOf(schema).map((f) => readField(f, '7', true)),
    [7, 7, true, '7'],
  )
})
