/** Saved fields on the robot, and files in and out. */

import type { FeatureCollection } from 'geojson'
import { api } from '../api.ts'
import type { App } from '../app.ts'
import { download, el } from '../dom.ts'
import { icon } from '../icons.ts'
import { say } from '../say.ts'

export const IMPORT_TYPES = '.geojson,.json,.gpkg,.kml,.kmz,.gpx,.zip' // what the server reads
const EXPORTS = [
  ['ISOXML', '.isoxml.zip'],
  ['GPX', '.gpx'],
  ['Shapefile', '.shp.zip'],
  ['KMZ', '.kmz'],
  ['KML', '.kml'],
  ['GeoPackage', '.gpkg'],
  ['GeoJSON', '.geojson'],
] as const

interface Document {
  /** Leaves nothing drawn; Undo brings it back. */
  clear: () => void
  content: () => FeatureCollection
  open: (collection: FeatureCollection) => void
}

export function fileCard(app: App, document: Document): HTMLElement {
  const file = el('input', {
    type: 'file',
    accept: IMPORT_TYPES,
    class: 'visually-hidden',
    'aria-label': say('fieldFile'),
    tabindex: -1,
    onchange: () => void read(),
  })
  const read = async (): Promise<void> => {
    const chosen = file.files?.[0]
    if (!chosen) return
    file.value = ''
    const field = await importOne(app, chosen)
    if (!field) return
    document.open(field)
    if (field.left_out) app.toasts.show('warn', field.left_out)
  }
  const button = (name: Parameters<typeof icon>[0], text: string, action: () => void): HTMLElement =>
    el('button', { type: 'button', class: 'button', onclick: action }, icon(name, 20), text)
  return el(
    'div',
    { class: 'card stack' },
    el('h2', {}, say('field')),
    el(
      'div',
      { class: 'pair-grid' },
      button('plus', say('newField'), () => document.clear()),
      button('plan', say('open'), () => void open(app, document)),
      button('save', say('save'), () => void save(app, document)),
      button('upload', say('import'), () => file.click()),
      button('download', say('export'), () => void exportTo(app, document)),
    ),
    file,
  )
}

/** Reads a file and asks which of its fields is meant where it holds several; null where none is. */
async function importOne(app: App, file: File): Promise<Awaited<ReturnType<typeof api.importField>> | null> {
  const all = await app.attempt(api.importField(file))
  if (!all?.fields) return all
  const about = say('severalFields', { file: file.name, count: all.fields.length })
  const name = await app.dialogs.pick(say('whichField'), about, all.fields, say('open'))
  return name ? app.attempt(api.importField(file, name)) : null
}

async function exportTo(app: App, document: Document): Promise<void> {
  const about = say('exportAbout')
  const ending = await app.dialogs.ask(
    say('exportTheField'),
    [about],
    EXPORTS.map(([label, value]) => ({ label, value })),
  )
  const file = ending && (await app.attempt(api.exportField(ending, document.content())))
  if (file) download(`field${ending}`, file)
}

async function open(app: App, document: Document): Promise<void> {
  const names = await app.attempt(api.fields())
  if (!names) return
  const about = names.length ? say('openingReplaces') : say('noFieldSaved')
  const name = await app.dialogs.ask(
    say('openAField'),
    [about],
    names.map((value) => ({ label: value, value })),
  )
  const field = name && (await app.attempt(api.loadField(name)))
  if (field) document.open(field)
}

async function save(app: App, document: Document): Promise<void> {
  const name = await app.dialogs.prompt(say('saveTheField'), say('nameOfTheField'))
  if (name && (await app.attempt(api.saveField(name, document.content()))))
    app.toasts.show('info', say('fieldSaved', { name }))
}
