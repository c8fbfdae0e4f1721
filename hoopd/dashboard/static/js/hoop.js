// The hoop as it stands: ball, picture, uncertainty, reference. Angles grow clockwise from the bottom, as in the picture
// of a camera that looks at the device: a positive ball angle is to the left.

import { drawn } from './text.js';

const TRACK = 96, BALL = 13, PATH = TRACK - BALL; // of a drawing 240 wide
const DEGREES = 180 / Math.PI;
const TWO_SIGMA = 2;

const turned = angle => `rotate(${angle * DEGREES})`;

export class Hoop {
  constructor(place) {
    this.spokes = drawn('g', { class: 'spokes' },
      ...[0, 120, 240].map(angle => drawn('line', { y1: 14, y2: TRACK, transform: `rotate(${angle})` })),
      drawn('circle', { class: 'hub', r: 14 }), drawn('circle', { class: 'index', cy: TRACK + 7, r: 3.4 }));
    this.band = drawn('path', { class: 'band' });
    this.ball = drawn('g', { class: 'ball' }, drawn('circle', { cy: PATH, r: BALL }), drawn('circle', { class: 'glint', cx: -4, cy: PATH - 4, r: 3 }));
    this.seen = drawn('g', { class: 'seen' }, drawn('path', { d: `M-7,${PATH}h14M0,${PATH - 7}v14` }));
    this.target = drawn('g', { class: 'target' },
      drawn('line', { y1: 50, y2: 106 }), drawn('path', { d: 'M0,101 l-8,15 h16 z' }));
    // taken by a thumb: larger than what is seen
    this.handle = drawn('g', { class: 'handle', tabindex: 0, role: 'slider', 'aria-label': 'Reference, the ball’s target' },
      drawn('circle', { cy: 108, r: 17 }));
    this.ghost = drawn('g', { class: 'ghost missing' },
      drawn('line', { y1: 14, y2: 106 }), drawn('circle', { cy: PATH, r: BALL }), drawn('path', { d: 'M0,101 l-8,15 h16 z' }));
    this.svg = drawn('svg', { viewBox: '-126 -126 252 252', role: 'group', 'aria-label': 'Hoop with ball' },
      drawn('circle', { class: 'rim', r: TRACK + 7 }), drawn('circle', { class: 'track', r: TRACK }),
      this.spokes, drawn('line', { class: 'plumb', y1: TRACK - 34, y2: TRACK }),
      this.band, this.target, this.ball, this.seen, this.ghost, this.handle);
    place.append(this.svg);
  }

  show(device, stale) {
    const ball = device.last('x_hat_2'), hoop = device.last('x_hat_0');
    this.svg.classList.toggle('stale', stale);
    this.place(this.spokes, hoop);
    this.place(this.ball, ball);
    this.reference = device.last('reference');
    this.place(this.target, this.reference);
    if (!Number.isFinite(this.wanted)) this.place(this.handle, this.reference);
    const [seen, ago] = device.lastKnown('psi', 25);
    this.place(this.seen, ago < 15 ? seen : NaN);
    this.uncertain(ball, device.state.status.deviation?.[2]);
  }

  /** Where somebody wants the target; NaN: nowhere. */
  want(angle) {
    this.wanted = angle;
    this.place(this.ghost, angle);
    this.place(this.handle, Number.isFinite(angle) ? angle : this.reference);
  }

  place(part, angle) {
    const hidden = !Number.isFinite(angle);
    part.classList.toggle('missing', hidden);
    if (!hidden) part.setAttribute('transform', turned(angle));
  }

  /** Two standard deviations to each side. */
  uncertain(ball, sigma) {
    if (!Number.isFinite(ball) || !Number.isFinite(sigma)) {
      this.band.setAttribute('d', '');
      return;
    }
    const half = Math.min(TWO_SIGMA * sigma, Math.PI * 0.999);
    const at = angle => `${-PATH * Math.sin(angle)},${PATH * Math.cos(angle)}`;
    this.band.setAttribute('d', `M${at(ball - half)}A${PATH},${PATH} 0 ${half > Math.PI / 2 ? 1 : 0} 1 ${at(ball + half)}`);
  }
}
