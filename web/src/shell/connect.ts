/** Who is connected, and how a tablet or phone joins. */

import type { App } from '../app.ts'
import { el } from '../dom.ts'
import { say } from '../say.ts'

export async function showConnect(app: App): Promise<void> {
  const { session, store, dialogs } = app
  const people = say('pagesConnected', { count: store.clients })
  const body: Node[] = [el('p', {}, people)]
  if (session.lan_url) {
    body.push(el('p', {}, say('openAddressOnDevice')), el('p', { class: 'mono select-all' }, session.lan_url))
    if (session.qr_svg) body.push(qrImage(session.qr_svg))
  } else {
    body.push(el('p', {}, say('serverListensHere', { command: 'agribot ui --help' })))
  }
  await dialogs.ask(say('connectedPages'), body, [])
}

function qrImage(svg: string): HTMLElement {
  return el('img', {
    class: 'qr',
    alt: say('qrCodeOfTheAddress'),
    src: `data:image/svg+xml,${encodeURIComponent(svg)}`,
  })
}
