// The hoop's speed by hand: a stick that counts only while it is held. It says so ten times a second; whatever lets it go
// (finger, key, focus, a page that is hidden or closed) ends it, and the daemon ends it by itself after 0.3 s of silence.

import { byId, drawn, element, number, say } from './text.js';

const EVERY_MS = 100, PATIENCE_MS = 1000;
const HALF = 100, KNOB = 15, WIDE = 250, HIGH = 44; // of the drawing
const DEAD = 0.04; // share of the way that still means zero
const FIRST_KEY = 0.1, KEY_STEP = 0.05; // shares of the limit
const TURNS = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 };

export class Joystick {
  constructor(page) {
    Object.assign(this, { page, share: 0, held: null, key: '', wrong: '' });
    this.knob = drawn('g', { class: 'knob' }, drawn('circle', { r: KNOB }), drawn('path', { d: 'M-6,-4l-4,4l4,4M6,-4l4,4l-4,4' }));
    this.bar = drawn('line', { class: 'pull' });
    this.svg = drawn('svg', { viewBox: `${-WIDE / 2} ${-HIGH / 2} ${WIDE} ${HIGH}`, tabindex: 0, role: 'slider', 'aria-label': 'Hoop speed: hold', 'aria-describedby': 'joystick-text' },
      drawn('line', { class: 'way', x1: -HALF, x2: HALF }), drawn('line', { class: 'middle', y1: -9, y2: 9 }), this.bar, this.knob);
    this.text = element('p', { class: 'detail', id: 'joystick-text' });
    byId('joystick').append(element('span', { class: 'title' }, 'Turn the hoop'), this.svg, this.text);
    this.listen();
  }

  listen() {
    const { svg } = this, away = () => this.release();
    svg.addEventListener('pointerdown', event => this.begin(event));
    svg.addEventListener('pointermove', event => this.held && !this.key && this.pull(event));
    for (const name of ['pointerup', 'pointercancel', 'lostpointercapture', 'blur']) svg.addEventListener(name, away);
    svg.addEventListener('keydown', event => this.press(event));
    svg.addEventListener('keyup', event => event.key === this.key && this.release());
    addEventListener('blur', away);
    addEventListener('pagehide', away);
    document.addEventListener('visibilitychange', () => document.hidden && this.release());
  }

  /** rad/s to each side; 0: the law in force follows no speed, or an older daemon knows of none. */
  get limit() {
    const told = this.page.device?.state.status.speed_limit;
    return Number.isFinite(told) ? told : 0;
  }

  get may() {
    const { device } = this.page;
    return Boolean(this.page.commands.user && device && this.limit > 0 && device.word('mode') === 'RUNNING');
  }

  begin(event) {
    if (!this.may || this.held || event.button) return;
    event.preventDefault();
    this.svg.focus();
    this.svg.setPointerCapture(event.pointerId);
    this.hold();
    this.pull(event);
  }

  pull(event) {
    const box = this.svg.getBoundingClientRect(), scale = Math.min(box.width / WIDE, box.height / HIGH);
    const share = Math.max(-1, Math.min(1, (event.clientX - box.left - box.width / 2) / (HALF * scale)));
    this.move(Math.abs(share) < DEAD ? 0 : share);
  }

  press(event) {
    const turn = TURNS[event.key];
    if (event.key === 'Escape') this.release();
    if (!turn || !this.may) return;
    event.preventDefault();
    event.stopPropagation();
    if (!this.held) {
      this.key = event.key;
      this.hold();
      this.move(turn * FIRST_KEY);
    } else if (event.key === this.key) this.move(Math.max(-1, Math.min(1, this.share + turn * KEY_STEP)));
  }

  move(share) {
    this.share = share;
    this.knob.setAttribute('transform', `translate(${share * HALF} 0)`);
    this.bar.setAttribute('x2', share * HALF);
  }

  hold() {
    this.held = this.page.device;
    this.wrong = '';
    this.svg.classList.add('held');
    this.drive(this.held);
  }

  /** As long as it is held: one question after the other, so that none overtakes the last. */
  async drive(device) {
    let sent = false;
    while (this.held === device && !this.wrong) {
      const begun = performance.now(), value = Math.round(this.share * this.limit * 100) / 100;
      if (value || sent) this.wrong = await this.send(device, value, !sent);
      sent = sent || value !== 0;
      await new Promise(done => { setTimeout(done, Math.max(0, EVERY_MS - (performance.now() - begun))); });
    }
    if (this.held === device) this.release();
    if (sent) await this.send(device, 0, true);
  }

  /** Why it was not obeyed; empty when it was. */
  async send(device, value, tell) {
    const { commands } = this.page, say_ = (text, state) => commands.show(`${device.state.name} speed: ${text}`, state);
    try {
      const answer = await commands.post('/api/command', { device: device.identity, command: 'speed', value }, PATIENCE_MS);
      if (answer.ok && tell) say_(value ? 'driven by hand' : 'let go', 'good');
      if (!answer.ok) say_(answer.reason, 'bad');
      return answer.ok ? '' : `${answer.reason}`;
    } catch (error) {
      say_(`no answer from this page’s server (${error.name}); the daemon stops it by itself`, 'bad');
      return 'no answer';
    }
  }

  release() {
    if (!this.held) return;
    this.held = null;
    this.key = '';
    this.svg.classList.remove('held');
    this.move(0);
  }

  show(device) {
    if (this.held && this.held !== device) this.release();
    const { limit, may } = this, wanted = this.share * limit;
    this.svg.classList.toggle('may', may);
    this.svg.setAttribute('aria-disabled', String(!may));
    this.svg.setAttribute('aria-valuemin', -limit);
    this.svg.setAttribute('aria-valuemax', limit);
    this.svg.setAttribute('aria-valuenow', wanted);
    this.svg.setAttribute('aria-valuetext', `${number(wanted, 1, true)} rad/s`);
    say(this.text, this.words(device, limit, wanted));
  }

  words(device, limit, wanted) {
    if (device.state.status.speed_limit === undefined) return 'This daemon takes no hoop speed.';
    if (!limit) return 'Not with the law in force: it regulates the ball’s angle and follows no hoop speed.';
    if (this.held) return `wanted ${number(wanted, 1, true)} rad/s, is ${number(device.last('dtheta'), 1, true)} rad/s`;
    if (!this.page.commands.user) return `Log in to drive. Up to ${number(limit, 0)} rad/s to each side.`;
    if (device.word('mode') !== 'RUNNING') return 'While it runs: hold and pull, let go to stop.';
    return `Hold and pull, let go to stop. Up to ${number(limit, 0)} rad/s to each side; arrow keys, too.`;
  }
}
