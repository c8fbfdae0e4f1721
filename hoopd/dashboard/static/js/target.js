// The ball's target, taken by hand: drag it along the hoop, or focus it and use the arrow keys. One command is sent when it
// is let go; until the daemon has answered, the drawing shows where it was taken beside where it is.

import { number } from './text.js';

const KEY_RAD = 0.01, PAGE_RAD = 0.1;
const KEY_PAUSE_MS = 400; // after the last key
const TURNS = { ArrowLeft: KEY_RAD, ArrowUp: KEY_RAD, ArrowRight: -KEY_RAD, ArrowDown: -KEY_RAD, PageUp: PAGE_RAD, PageDown: -PAGE_RAD };

export class Target {
  constructor(hoop, page) {
    Object.assign(this, { hoop, page, wanted: null, dragging: false });
    const { handle } = hoop;
    handle.addEventListener('pointerdown', event => this.begin(event));
    handle.addEventListener('pointermove', event => this.dragging && this.move(event));
    handle.addEventListener('pointerup', () => this.end());
    handle.addEventListener('pointercancel', () => this.give());
    handle.addEventListener('keydown', event => this.key(event));
  }

  get may() {
    return Boolean(this.page.commands.user && this.page.device);
  }

  get limit() {
    return this.page.device?.state.status.reference_limit ?? 0.5;
  }

  begin(event) {
    if (!this.may) return;
    this.dragging = true;
    this.hoop.handle.setPointerCapture(event.pointerId);
    event.preventDefault();
    this.hoop.handle.focus();
  }

  move(event) {
    const box = this.hoop.svg.getBoundingClientRect();
    const x = event.clientX - (box.left + box.width / 2), y = event.clientY - (box.top + box.height / 2);
    this.want(Math.atan2(-x, y));
  }

  want(angle) {
    // to a thousandth of a radian, inside what the daemon takes
    this.wanted = Math.round(Math.max(-this.limit, Math.min(this.limit, angle)) * 1000) / 1000;
    this.hoop.want(this.wanted);
  }

  end() {
    if (!this.dragging) return;
    this.dragging = false;
    this.send();
  }

  give() {
    this.dragging = false;
    clearTimeout(this.timer);
    this.wanted = null;
    this.hoop.want(NaN);
  }

  async send() {
    clearTimeout(this.timer);
    if (this.wanted !== null) await this.page.commands.send('reference', this.wanted);
    if (!this.dragging) this.give();
  }

  key(event) {
    if (event.key === 'Escape') this.give();
    else if (event.key === 'Enter') this.send();
    else if (!(event.key in TURNS) || !this.may) return;
    else {
      this.want((this.wanted ?? this.page.device.last('reference')) + TURNS[event.key]);
      clearTimeout(this.timer);
      this.timer = setTimeout(() => this.send(), KEY_PAUSE_MS);
    }
    event.preventDefault();
    event.stopPropagation();
  }

  /** What a screen reader says of it. */
  describe(reference) {
    const { handle } = this.hoop, now = this.wanted ?? reference;
    handle.setAttribute('aria-disabled', String(!this.may));
    handle.setAttribute('aria-valuemin', -this.limit);
    handle.setAttribute('aria-valuemax', this.limit);
    handle.setAttribute('aria-valuenow', Number.isFinite(now) ? now : 0);
    handle.setAttribute('aria-valuetext', `${number(now, 3)} rad`);
  }
}
