// A drawing of numbers that were measured once: points, lines, steps and bars over one axis, with upright marks.

import { drawn, element, short } from './text.js';

const WIDE = 420, HIGH = 170, LEFT = 46, BELOW = 24, ABOVE = 16, RIGHT = 8;

const extent = numbers => {
  const known = numbers.filter(Number.isFinite);
  return known.length ? [Math.min(...known), Math.max(...known)] : [0, 1];
};
const plain = value => (Number.isInteger(value) ? `${value}`.replace('-', '−') : short(value));
const roomy = ([low, high], share) => {
  const room = (high - low || Math.abs(high) || 1) * share;
  return [low - room, high + room];
};

/** A figure element of what the server tells: axes with units, and a legend with the kind of each curve. */
export function figure({ x, y, curves, marks = {} }, label) {
  const bars = curves.some(({ kind }) => kind === 'bars');
  const wide = extent([...curves.flatMap(curve => curve.x), ...Object.values(marks)]), tall = bars ? [0, 1] : extent(curves.flatMap(curve => curve.y));
  const [left, right] = roomy(wide, 0.01), [low, high] = bars ? [0, 1.05] : roomy(tall, 0.06);
  const across = value => LEFT + (value - left) / (right - left) * (WIDE - LEFT - RIGHT);
  const up = value => HIGH - BELOW - (value - low) / (high - low) * (HIGH - BELOW - ABOVE);
  const paths = curves.map((curve, place) => drawn('path', { class: `curve s${place} ${curve.kind}`, d: way(curve, across, up, up(Math.max(low, 0))) }));
  const svg = drawn('svg', { viewBox: `0 0 ${WIDE} ${HIGH}`, role: 'img', 'aria-label': `${label}: ${y} over ${x}` },
    drawn('path', { class: 'axis', d: `M${LEFT},${ABOVE}V${HIGH - BELOW}H${WIDE - RIGHT}` }),
    ...(bars ? [] : tall.map(value => text(LEFT - 4, up(value) + 4, plain(value), 'end'))),
    text(across(wide[0]), HIGH - 10, plain(wide[0]), 'start'), text(across(wide[1]), HIGH - 10, plain(wide[1]), 'end'),
    ...paths, ...Object.entries(marks).flatMap(([name, value], place) => mark(name, value, place, across)));
  const legend = curves.map((curve, place) => element('span', { class: 'chip' }, element('i', { class: `s${place} ${curve.kind}` }), curve.label));
  return element('figure', { class: 'drawing' }, svg, element('figcaption', {}, ...legend, element('small', {}, `${y}, over ${x}`)));
}

function mark(name, value, place, across) {
  const at = across(value), before = at > WIDE / 2;
  return [drawn('line', { class: `mark m${place}`, x1: at, x2: at, y1: ABOVE, y2: HIGH - BELOW }),
    text(at + (before ? -4 : 4), ABOVE + 9 + 12 * place, `${name} ${plain(value)}`, before ? 'end' : 'start')];
}

function text(x, y, words, anchor) {
  return drawn('text', { x, y, 'text-anchor': anchor }, words);
}

function way({ kind, x, y }, across, up, ground) {
  const parts = [];
  for (let row = 0; row < x.length; row += 1) {
    const [px, py] = [across(x[row]), up(y[row])].map(value => value.toFixed(1));
    if (![x[row], y[row]].every(Number.isFinite)) continue;
    if (kind === 'points') parts.push(`M${px},${py}h.01`);
    else if (kind === 'bars') parts.push(`M${px},${ground.toFixed(1)}V${py}`);
    else if (kind === 'steps' && parts.length) parts.push(`H${px}V${py}`);
    else parts.push(`${parts.length ? 'L' : 'M'}${px},${py}`);
  }
  return parts.join('');
}
