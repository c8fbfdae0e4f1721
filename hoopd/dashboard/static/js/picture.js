// The live picture: asked for while its panel is open and seen, and at no other time.

import { byId, number, say } from './text.js';

const RETRY_MS = 1000;
const SILENT_MS = 2000;
const INK = { circle: '#3ddc97', zero: '#f0e442', ball: '#56b4e9' }; // bright in both themes: a picture has its own light

export class Picture {
  /** `chosen` gives the device that is shown. */
  constructor(chosen) {
    Object.assign(this, { chosen, open: false, view: 'camera', socket: null, asked: '', shown: 0, times: [], heard: 0, triedAt: -RETRY_MS });
    this.canvas = byId('picture-canvas');
    byId('picture-open').addEventListener('click', () => this.toggle());
    for (const button of document.querySelectorAll('[data-picture]')) {
      button.addEventListener('click', () => this.choose(button.dataset.picture));
    }
    setInterval(() => this.watch(), 200);
  }

  toggle() {
    this.open = !this.open;
    byId('picture-open').setAttribute('aria-expanded', String(this.open));
    say(byId('picture-open'), this.open ? 'Close' : 'Show');
    byId('picture-body').hidden = !this.open;
    this.watch();
  }

  choose(view) {
    this.view = view;
    for (const button of document.querySelectorAll('[data-picture]')) {
      button.setAttribute('aria-pressed', String(button.dataset.picture === view));
    }
    this.watch();
  }

  /** Open the way to the picture that is wanted now, or close it. */
  watch() {
    const device = this.chosen();
    const seen = this.open && device && !document.hidden && byId('picture-body').offsetParent;
    const wanted = seen ? `device=${encodeURIComponent(device.identity)}&view=${this.view}` : '';
    if (wanted !== this.asked) this.end();
    this.asked = wanted;
    const now = performance.now();
    if (wanted && !this.socket && now - this.triedAt >= RETRY_MS) this.begin(wanted, now);
    if (wanted && now - this.heard > SILENT_MS) {
      this.canvas.classList.add('old');
      say(byId('picture-text'), 'no picture comes: the rig without pictures, an older daemon, or a camera that stands still');
    }
  }

  begin(wanted, now) {
    this.triedAt = this.heard = now;
    const socket = this.socket = new WebSocket(`${location.protocol === 'https:' ? 'wss' : 'ws'}://${location.host}/api/picture?${wanted}`);
    socket.binaryType = 'arraybuffer';
    socket.onmessage = event => this.take(socket, event.data);
    socket.onclose = () => { if (socket === this.socket) this.socket = null; };
  }

  end() {
    this.socket?.close();
    this.socket = null;
    this.triedAt = -RETRY_MS;
    this.times = [];
  }

  async take(socket, data) {
    const bytes = new Uint8Array(data), cut = bytes.indexOf(10);
    try {
      const about = JSON.parse(new TextDecoder().decode(bytes.subarray(0, cut)));
      const image = await createImageBitmap(new Blob([bytes.subarray(cut + 1)], { type: 'image/jpeg' }));
      if (socket === this.socket) this.draw(image, about);
      image.close();
    } catch {
      // no picture of ours: the line below says that none comes
    }
  }

  draw(image, about) {
    const { canvas } = this, [width, height] = about.size_px;
    Object.assign(canvas, { width, height });
    const pen = canvas.getContext('2d');
    pen.drawImage(image, 0, 0, width, height);
    canvas.classList.remove('old');
    this.mark(pen, about, width / 240);
    this.heard = performance.now();
    this.shown += 1;
    this.times = [...this.times.filter(at => this.heard - at < 2000), this.heard];
    const rate = this.times.length > 1 ? (this.times.length - 1) / (this.heard - this.times[0]) * 1e3 : NaN;
    const ball = about.ball_px ? `ball at ${number(about.ball_px[0], 1)}, ${number(about.ball_px[1], 1)} px, confidence ${number(about.confidence, 2)}` : 'no ball found';
    say(byId('picture-text'), `${ball} · threshold ${number(about.threshold, 0)} · ${number(rate, 1)} pictures/s`);
  }

  /** Circle, its centre, the direction of zero, and the ball. A pixel's centre is its number, so the corner is -1/2. */
  mark(pen, about, line) {
    const [x, y, radius] = about.circle_px.map((v, i) => i < 2 ? v + 0.5 : v);
    const stroke = (ink, draw) => {
      for (const [colour, wide] of [['#000a', 2.2 * line], [INK[ink], line]]) {
        Object.assign(pen, { strokeStyle: colour, lineWidth: wide });
        pen.beginPath();
        draw();
        pen.stroke();
      }
    };
    const cross = (cx, cy, arm) => { pen.moveTo(cx - arm, cy); pen.lineTo(cx + arm, cy); pen.moveTo(cx, cy - arm); pen.lineTo(cx, cy + arm); };
    stroke('circle', () => { pen.arc(x, y, radius, 0, 2 * Math.PI); });
    stroke('circle', () => cross(x, y, 6 * line));
    // psi = atan2(cx - x, y - cy)
    const at = share => [x - share * radius * Math.sin(about.zero_angle_rad), y + share * radius * Math.cos(about.zero_angle_rad)];
    stroke('zero', () => { pen.moveTo(...at(0.75)); pen.lineTo(...at(1.2)); });
    if (!about.ball_px) return;
    const [bx, by] = about.ball_px.map(v => v + 0.5);
    stroke('ball', () => { pen.arc(bx, by, about.ball_radius_px, 0, 2 * Math.PI); });
    stroke('ball', () => cross(bx, by, 4 * line));
  }
}
