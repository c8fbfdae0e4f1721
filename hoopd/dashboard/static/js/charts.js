// Strip charts: any channels, several in one chart, ten minutes back. All charts share one span of time, one cursor and
// two marks. Which charts there are is kept by this browser.

import { Chart } from './chart.js';
import { byId, clock, element, number, say } from './text.js';

const KEY = 'hoopd.charts';
const FIRST = [['psi', 'x_hat_2', 'reference'], ['u'], ['x_hat_1', 'x_hat_3'], ['lateness_s', 'execution_s']];
const SPANS = [[10, '10 s'], [30, '30 s'], [120, '2 min'], [600, '10 min']];
const LEAST_S = 0.2, MOST_S = 600;
const MOST_CHARTS = 12;
const STEP = 1.6; // of a key that makes the span longer or shorter

export class Charts {
  constructor(tools, place, channels) {
    Object.assign(this, { place, channels, span: 30, end: null, dirty: true, drawnAt: 0, marks: [] });
    this.charts = [];
    this.makeTools(tools);
    for (const names of this.kept()) this.add(names);
    this.held = null; // the chart in which somebody drags
    addEventListener('mouseup', () => setTimeout(() => { this.held = null; }));
    new ResizeObserver(() => { this.charts.forEach(chart => chart.resize()); this.dirty = true; }).observe(place);
  }

  makeTools(tools) {
    this.spans = SPANS.map(([seconds, text]) => element('button', { type: 'button', onclick: () => this.show(seconds, this.end) }, text));
    this.pause = element('button', { type: 'button', title: 'Pause (p)', onclick: () => this.toggle() }, 'Pause');
    this.now = element('button', { type: 'button', title: 'Back to now (l)', onclick: () => this.show(this.span, null) }, 'Now');
    this.marked = element('output', { class: 'marked' });
    const more = element('button', { type: 'button', onclick: () => this.add([]).choose() }, 'Add chart');
    const reset = element('button', { type: 'button', class: 'quiet', onclick: () => this.reset() }, 'Reset charts');
    tools.append(element('div', { class: 'group', role: 'group', 'aria-label': 'Span' }, ...this.spans),
      this.pause, this.now, more, reset, this.marked);
    this.showTools();
  }

  kept() {
    try {
      const kept = JSON.parse(localStorage.getItem(KEY));
      if (Array.isArray(kept) && kept.every(names => Array.isArray(names) && names.every(name => typeof name === 'string'))) return kept.slice(0, MOST_CHARTS);
    } catch {
      // somebody else's text: begin anew
    }
    return FIRST;
  }

  keep() {
    localStorage.setItem(KEY, JSON.stringify(this.charts.map(chart => chart.names)));
    this.dirty = true;
  }

  add(names) {
    const chart = new Chart(this, names);
    if (this.charts.length < MOST_CHARTS) {
      this.charts.push(chart);
      this.place.append(chart.card);
      this.keep();
    }
    return chart;
  }

  remove(chart) {
    this.charts.splice(this.charts.indexOf(chart), 1);
    chart.end();
    this.keep();
  }

  reset() {
    this.charts.splice(0).forEach(chart => chart.end());
    FIRST.forEach(names => this.add(names));
    this.show(30, null);
    this.mark(null);
  }

  /** A span of time that ends at a moment; null: goes on with now. */
  show(span, end) {
    this.span = Math.min(MOST_S, Math.max(LEAST_S, span));
    this.end = end;
    this.dirty = true;
    this.showTools();
  }

  toggle() {
    this.show(this.span, this.end === null ? this.shownEnd : null);
  }

  key(key) {
    const end = this.end ?? this.shownEnd, keys = {
      p: () => this.toggle(),
      l: () => this.show(this.span, null),
      '+': () => this.show(this.span / STEP, this.end),
      '-': () => this.show(this.span * STEP, this.end),
      ArrowLeft: () => this.show(this.span, end - this.span / 4),
      ArrowRight: () => this.show(this.span, end + this.span / 4 < this.newest ? end + this.span / 4 : null),
    };
    keys[key]?.();
    return key in keys;
  }

  /** The next of two marks at a moment; the third call takes them away. */
  mark(at) {
    this.marks = at === null || this.marks.length === 2 ? [] : [...this.marks, at];
    const [a, b] = this.marks;
    say(this.marked, b !== undefined ? `B − A = ${number(b - a, 3, true)} s` : a !== undefined ? `A at ${clock(a, 3)}` : '');
    this.dirty = true;
  }

  showTools() {
    const paused = this.end !== null;
    this.spans.forEach((button, place) => button.setAttribute('aria-pressed', String(this.span === SPANS[place][0])));
    this.pause.setAttribute('aria-pressed', String(paused));
    say(this.pause, paused ? 'Go on' : 'Pause');
    byId('charts').classList.toggle('paused', paused);
  }

  recolour() {
    this.charts.forEach(chart => chart.build());
    this.dirty = true;
  }

  draw(device, now, clockNow) {
    this.device = device;
    this.newest = Math.max(device.last('wall') || 0, clockNow - 1);
    const moves = this.end === null;
    // A long span moves by less than a pixel in a frame.
    const pause = this.span > 200 ? 500 : this.span > 60 ? 200 : 80;
    if (this.held || (!this.dirty && (!moves || now - this.drawnAt < pause))) return;
    this.drawnAt = now;
    this.dirty = false;
    this.shownEnd = this.end ?? this.newest;
    this.charts.forEach(chart => chart.draw(device, this.shownEnd - this.span, this.shownEnd));
  }
}
