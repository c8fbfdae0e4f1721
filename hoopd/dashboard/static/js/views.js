// Which part of the page is shown. The address keeps it, and the device: #VIEW/DEVICE.

const first = () => document.querySelector('[data-to]').dataset.to;

export class Views {
  constructor() {
    Object.assign(this, { shown: '', device: '' });
    addEventListener('hashchange', () => this.read());
    this.read();
  }

  get names() {
    return [...document.querySelectorAll('[data-to]')].map(one => one.dataset.to);
  }

  /** What the address says; one that names a device alone is of the first view. */
  read() {
    const text = location.hash.slice(1), word = text.split('/', 1)[0], named = this.names.includes(word);
    const view = named ? word : first();
    const device = named ? text.slice(word.length + 1) : text; // a device's name has slashes, too
    try {
      if (device) this.device = decodeURIComponent(device);
    } catch {
      // no address of ours
    }
    this.show(view);
  }

  show(view) {
    const changed = view !== this.shown;
    this.shown = view;
    for (const part of document.querySelectorAll('[data-view]')) part.hidden = part.dataset.view !== view;
    for (const link of document.querySelectorAll('[data-to]')) {
      if (link.dataset.to === view) link.setAttribute('aria-current', 'page');
      else link.removeAttribute('aria-current');
    }
    this.keep(this.device);
    if (changed) dispatchEvent(new CustomEvent('view', { detail: view }));
  }

  keep(device) {
    this.device = device;
    history.replaceState(null, '', `#${this.shown}${device ? `/${encodeURIComponent(device)}` : ''}`);
  }
}
