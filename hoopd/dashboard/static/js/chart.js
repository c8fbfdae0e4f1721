// One strip chart: a card with its channels and what they are at the cursor; uPlot draws.

import { clock, element, say, short } from './text.js';
import { WALL } from './store.js';

const HELD = new Set(['u', 'reference', 'mode', 'status', 'errors']); // hold from one row to the next
const GAP_S = 0.25; // a channel that is silent for longer has a gap; a camera that comes every other tick has none
const DASHES = [[], [7, 4], [2, 3], [10, 3, 2, 3], [4, 4], [12, 4]];
const MOST_SERIES = 6;
const CLICK_PX = 4;
const ESTIMATES = ['hoop angle, estimate', 'hoop speed, estimate', 'ball angle, estimate', 'ball speed, estimate'];
const SCALED = { lateness_s: [1e3, 'ms'], execution_s: [1e3, 'ms'] }; // as a person reads them
const LABELS = {
  psi: 'ball angle', reference: 'reference', u: 'torque', theta: 'hoop angle', dtheta: 'hoop speed', current: 'current',
  lateness_s: 'lateness', execution_s: 'execution',
};

export class Chart {
  constructor(charts, names) {
    Object.assign(this, { charts, names: names.slice(0, MOST_SERIES) });
    this.chips = element('div', { class: 'chips' });
    this.menu = element('div', { class: 'menu' });
    this.details = element('details', { class: 'choose', ontoggle: () => this.fillMenu() }, element('summary', {}, 'Channels'), this.menu);
    const away = element('button', { type: 'button', class: 'quiet', title: 'Take this chart away', 'aria-label': 'Take this chart away', onclick: () => charts.remove(this) }, '✕');
    this.canvas = element('div', { class: 'canvas' });
    this.card = element('article', { class: 'chart' }, element('div', { class: 'chart-head' }, this.chips, this.details, away), this.canvas);
  }

  choose() {
    this.details.open = true;
  }

  end() {
    this.plot?.destroy();
    this.card.remove();
  }

  resize() {
    if (this.plot && this.canvas.clientWidth) this.plot.setSize({ width: this.canvas.clientWidth, height: this.canvas.clientHeight });
  }

  fillMenu() {
    if (!this.details.open) return;
    const known = [...new Set([...this.charts.device?.names ?? [], ...this.names])].filter(name => name !== WALL);
    this.menu.replaceChildren(...known.map(name => {
      const box = element('input', { type: 'checkbox', checked: this.names.includes(name), onchange: () => this.toggle(name, box.checked) });
      return element('label', {}, box, ` ${this.label(name)} `, element('code', {}, name));
    }));
  }

  toggle(name, wanted) {
    this.names = wanted ? [...this.names, name].slice(-MOST_SERIES) : this.names.filter(one => one !== name);
    this.build();
    this.fillMenu();
    this.charts.keep();
  }

  label(name) {
    const estimate = /^x_hat_(\d)$/.exec(name);
    return estimate ? ESTIMATES[estimate[1]] ?? name : LABELS[name] ?? name;
  }

  unit(name) {
    if (name in SCALED) return SCALED[name][1];
    const [, base, place] = /^(.*?)(?:_(\d))?$/.exec(name);
    const { channels } = this.charts;
    return channels[name]?.unit ?? channels[base]?.unit.split(', ')[place] ?? '';
  }

  build() {
    this.plot?.destroy();
    this.plot = this.data = null; // the data are those of the channels before
    const style = getComputedStyle(document.documentElement), colour = name => style.getPropertyValue(`--${name}`).trim();
    this.colours = this.names.map((_, place) => colour(`series-${place}`));
    this.chips.replaceChildren(...this.names.map((name, place) => element('span', { class: `chip s${place}`, title: this.charts.channels[name]?.meaning ?? name },
      element('i', {}), this.label(name), element('output', {}), element('small', {}, this.unit(name)))));
    if (!this.names.length) this.chips.replaceChildren(element('span', { class: 'chip' }, 'choose channels'));
    const axis = { stroke: colour('quiet'), grid: { stroke: colour('grid'), width: 1 }, ticks: { stroke: colour('grid'), width: 1 }, font: '12px system-ui, sans-serif' };
    this.canvas.replaceChildren();
    this.plot = new uPlot({
      width: this.canvas.clientWidth || 600, height: this.canvas.clientHeight || 168, legend: { show: false }, padding: [8, 26, 0, 0],
      scales: { x: { time: true, auto: false }, y: { range: padded } },
      cursor: { sync: { key: 'hoopd' }, drag: { x: true, y: false, setScale: false, dist: CLICK_PX }, points: { size: 7 } },
      axes: [{ ...axis, space: 90, size: 28, values: (plot, ticks, place, space, step) => ticks.map(tick => clock(tick, step < 1 ? 1 : 0)) }, { ...axis, size: 64, values: (plot, ticks) => ticks.map(tick => `${tick}`.replace('-', '−')) }],
      series: [{}, ...this.names.map((name, place) => this.series(name, place))],
      hooks: { setSelect: [plot => this.zoom(plot)], setCursor: [plot => this.showValues(plot)], draw: [plot => this.drawMarks(plot)] },
    }, this.empty(), this.canvas);
    this.listen(this.plot.over);
  }

  series(name, place) {
    const stepped = HELD.has(name) ? { paths: uPlot.paths.stepped({ align: 1 }) } : {};
    return { label: name, stroke: this.colours[place], width: 1.75, dash: DASHES[place], points: { show: false }, ...stepped };
  }

  empty() {
    return [[], ...this.names.map(() => [])];
  }

  listen(over) {
    let begun = [0, 0];
    // what is about to be chosen stands still meanwhile
    over.addEventListener('mousedown', event => { begun = [event.clientX, event.clientY]; this.charts.held = this; });
    over.addEventListener('dblclick', () => { this.charts.mark(null); this.charts.show(30, null); });
    over.addEventListener('click', event => {
      if (Math.hypot(event.clientX - begun[0], event.clientY - begun[1]) > CLICK_PX || event.detail > 1) return;
      this.charts.mark(this.plot.posToVal(event.offsetX, 'x'));
    });
  }

  zoom(plot) {
    const { left, width } = plot.select;
    // uPlot tells the other charts of a selection, too, by scales that they may not have yet
    if (this.charts.held !== this || width <= CLICK_PX) return;
    const from = plot.posToVal(left, 'x'), until = plot.posToVal(left + width, 'x');
    plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    this.charts.show(until - from, until);
  }

  draw(device, from, until) {
    if (!this.plot) this.build();
    const first = Math.max(0, device.rowAt(from) - 1), last = Math.min(device.length, device.rowAt(until) + 1);
    const times = device.columns.get(WALL).subarray(first, last);
    this.data = [times, ...this.names.map(name => lines(device.columns.get(name), times, first, last, SCALED[name]?.[0] ?? 1))];
    this.plot.setData(this.data, false);
    this.plot.setScale('x', { min: from, max: until });
    this.showValues(this.plot);
  }

  /** At the cursor, or the newest. */
  showValues(plot) {
    if (!this.data) return;
    const at = plot.cursor.idx ?? this.data[0].length - 1;
    this.chips.querySelectorAll('output').forEach((output, place) => {
      const column = this.data[place + 1];
      let row = at;
      while (row > 0 && row > at - 25 && column[row] === undefined) row -= 1;
      const words = this.charts.device?.words[this.names[place]];
      say(output, words ? words[column[row]] ?? '–' : short(column[row]));
    });
  }

  /** The marks A and B, and where the mode changed. */
  drawMarks(plot) {
    const style = getComputedStyle(document.documentElement), ratio = devicePixelRatio;
    const { ctx } = plot;
    ctx.save();
    ctx.font = `${11 * ratio}px system-ui, sans-serif`;
    ctx.lineWidth = ratio;
    ctx.setLineDash([2 * ratio, 3 * ratio]);
    ctx.strokeStyle = ctx.fillStyle = style.getPropertyValue('--quiet');
    ctx.textAlign = 'left';
    // the newest first: where names would overlap the one that still holds is told
    const modes = (this.charts.device?.events ?? []).filter(({ event }) => event === 'mode').reverse();
    modes.reduce((room, { wall, fields }) => this.drawMark(plot, wall, `${fields?.mode ?? ''}`, room), Infinity);
    ctx.setLineDash([]);
    ctx.strokeStyle = ctx.fillStyle = style.getPropertyValue('--text');
    this.charts.marks.forEach((at, place) => this.drawMark(plot, at, 'AB'[place]));
    ctx.restore();
  }

  /** A line with a name that ends left of `room`; the room that is left for the one before it. */
  drawMark({ ctx, bbox, valToPos }, at, text, room = Infinity) {
    const x = Math.round(valToPos(at, 'x', true)), begin = x + 3 * devicePixelRatio;
    if (x < bbox.left || x > bbox.left + bbox.width) return room;
    ctx.beginPath();
    ctx.moveTo(x, bbox.top);
    ctx.lineTo(x, bbox.top + bbox.height);
    ctx.stroke();
    if (begin + ctx.measureText(text).width >= room) return Math.min(room, x);
    ctx.fillText(text, begin, bbox.top + 10 * devicePixelRatio);
    return x;
  }
}

/** A column as uPlot likes it: undefined where a row has no number, null where a channel is silent for long. */
function lines(column, times, first, last, factor) {
  const line = new Array(last - first);
  if (!column) return line;
  let known = -Infinity;
  for (let row = first; row < last; row += 1) {
    const value = column[row], place = row - first;
    if (Number.isNaN(value)) {
      if (times[place] - known > GAP_S) line[place] = null;
    } else {
      if (place && times[place] - known > GAP_S && line[place - 1] === undefined) line[place - 1] = null;
      line[place] = value * factor;
      known = times[place];
    }
  }
  return line;
}

function padded(plot, low, high) {
  if (low === null || low === undefined || !Number.isFinite(low) || !Number.isFinite(high)) return [-1, 1];
  const room = (high - low) * 0.08 || Math.abs(high) * 0.1 || 1e-3;
  return [low - room, high + room];
}
