import assert from 'node:assert/strict'
import { test } from 'node:test'
import { sortFiles } from '../src/screens/recordings.ts'

test('the report of a recording comes first and by its name, what belongs to the program not at all', () => {
  const files = ['config.toml', 'job.json', 'map.png', 'report.html', 'report.json', 'run.lock', 'run.mcap']
  assert.deepEqual(sortFiles(files), {
    named: [
      ['report.html', 'Report'],
      ['run.mcap', 'Recording'],
    ],
    others: ['config.toml', 'job.json', 'map.png', 'report.json'],
  })
  assert.deepEqual(sortFiles(['run.mcap']), { named: [['run.mcap', 'Recording']], others: [] })
})
