/** Who is connected, and how a tablet or phone joins. */

import type { App } from '../app.ts'
import { el } from '../dom.ts'

export async function showConnect(app: App): Promise<void> {
  const { session, store, dialogs } = app
  const people = `${store.clients} ${store.clients === 1 ? 'page is' : 'pages are'} connected.`
  const body: Node[] = [el('p', {}, people)]
  if (session.lan_url) {
    body.push(
      el('p', {}, 'Open this address on a device in the same network:'),
      el('p', { class: 'mono select-all' }, session.lan_url),
    )
    if (session.qr_svg) body.push(qrImage(session.qr_svg))
  } else {
    body.push(
      el(
        'p',
        {},
        'This server listens on this computer only. Start it with a network address to let tablets and phones in: see ',
        el('code', {}, 'agribot ui --help'),
        '.',
      ),
    )
  }
  await dialogs.ask('Connected pages', body, [])
}

function qrImage(svg: string): HTMLElement {
  return el('img', { class: 'qr', alt: 'QR code of the address', src: `data:image/svg+xml,${encodeURIComponent(svg)}` })
}
