/** Elements built in one expression, and text that is only touched when it changes. */

type Child = Node | string | null | undefined | false
type Handler = (event: Event) => void
type Attributes = Record<string, string | number | boolean | null | undefined | Handler>

export function el<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  attributes: Attributes = {},
  ...children: Child[]
): HTMLElementTagNameMap[K] {
  const node = document.createElement(tag)
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue
    if (typeof value === 'function') node.addEventListener(name.replace(/^on/, ''), value)
    else node.setAttribute(name, value === true ? '' : String(value))
  }
  append(node, children)
  return node
}

/** An element of a picture. */
export function svg<K extends keyof SVGElementTagNameMap>(
  tag: K,
  attributes: Record<string, string | number> = {},
  ...children: Child[]
): SVGElementTagNameMap[K] {
  const node = document.createElementNS('http://www.w3.org/2000/svg', tag)
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, String(value))
  append(node, children)
  return node
}

export function append(node: Element, children: Child[]): void {
  for (const child of children) if (child) node.append(child)
}

export function replace(node: Element, ...children: Child[]): void {
  node.replaceChildren()
  append(node, children)
}

/** As `replace`, where the children differ: a button that is made anew under a finger is not pressed. */
export function update(node: Element, ...children: Element[]): void {
  const there = node.children
  if (children.length !== there.length || children.some((one, i) => !one.isEqualNode(there[i] ?? null)))
    node.replaceChildren(...children)
}

export function setText(node: Node, text: string): void {
  if (node.textContent !== text) node.textContent = text
}

export function setAttr(node: Element, name: string, value: string | null): void {
  if (value === null) node.removeAttribute(name)
  else if (node.getAttribute(name) !== value) node.setAttribute(name, value)
}

export function need<T extends Element>(root: ParentNode, selector: string): T {
  const found = root.querySelector<T>(selector)
  if (!found) throw new Error(`no ${selector} in the page`)
  return found
}

/** Offer text or a blob as a file. */
export function download(name: string, content: Blob | string): void {
  const blob = typeof content === 'string' ? new Blob([content], { type: 'text/plain' }) : content
  const url = URL.createObjectURL(blob)
  el('a', { href: url, download: name }).click()
  setTimeout(() => URL.revokeObjectURL(url), 10_000)
}
