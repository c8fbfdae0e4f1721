// Two controllers take turns: choose one, watch, read the answer with its interval, accept or roll back.

import { modeWords } from './modes.js';
import { drawn, element, number, say, short } from './text.js';

const ASK_MS = 1000, LIST_MS = 4000;
const REST_S = 2.75; // a block in the mean: rests of the accepted law, and a filter that is watched
const FIELDS = [
  { name: 'blocks', label: 'Blocks at most', value: 20, min: 6, max: 200, step: 2, unit: '' },
  { name: 'hold_s', label: 'Each reference', value: 2, min: 0.5, max: 60, step: 0.5, unit: 's' },
  { name: 'amplitude_rad', label: 'References up to', value: 0.1, min: 0, max: 0.5, step: 0.01, unit: 'rad' },
];
const MEASURES = {
  ball: { label: 'smaller error of the ball', result: 'ball_rms_rad', name: 'ball’s error', row: 'ball’s error, rad rms' },
  cost: { label: 'smaller cost of the design (torque is charged)', result: 'cost', name: 'cost', row: 'cost of a tick' },
};
const BESIDE = [{ result: 'torque_at_rest_nm', row: 'torque at rest, N m rms' }]; // told, and decides nothing
const CONFIRM_MS = 15000;
const READ_MS = 700;
const VERDICTS = {
  better: ['good', 'The candidate is better.'], worse: ['bad', 'The candidate is worse.'],
  'not told apart': ['', 'They cannot be told apart.'], 'went back': ['bad', 'The candidate was taken back.'], stopped: ['bad', 'The run was cut short.'],
};
const file = key => `${key ?? '–'}`.replace(/@(.{8}).*/, '  ($1)');
const percent = value => (value === null || value === undefined ? '?' : `${number(value, Math.abs(value) < 10 ? 1 : 0, true)} %`);

export class Compare {
  constructor(place, page) {
    Object.assign(this, { page, last: null, listed: '', drawnOf: '' });
    this.acting = element('strong');
    this.choice = element('select', { id: 'candidate', 'aria-label': 'Candidate' });
    this.by = element('select', { id: 'compare-by' }, ...Object.entries(MEASURES).map(([value, { label }]) => element('option', { value }, label)));
    this.fields = FIELDS.map(one => this.field(one));
    this.start = element('button', { type: 'button', class: 'primary', id: 'compare-start', onclick: () => this.begin() }, 'Start');
    this.stop = element('button', { type: 'button', id: 'compare-end', onclick: () => this.send('Comparison ended', 'end') }, 'End it');
    this.arm = element('button', { type: 'button', class: 'arm', onclick: () => page.commands.send('arm') }, 'Arm');
    this.hint = element('p', { class: 'detail', id: 'compare-hint' });
    this.bar = element('progress', { max: 1, value: 0, 'aria-label': 'Blocks that are over' });
    this.step = element('p', { id: 'compare-step', role: 'status' });
    this.verdict = element('p', { class: 'verdict', id: 'compare-verdict', role: 'status' });
    this.warnings = element('ul', { class: 'warnings', id: 'compare-warnings' });
    this.table = element('table', { class: 'proposal', id: 'compare-table' });
    this.figure = element('div', { class: 'pairs', id: 'compare-figure' });
    this.accept = element('button', { type: 'button', class: 'primary', id: 'compare-accept', onclick: () => this.decide() }, 'Accept');
    this.back = element('button', { type: 'button', id: 'compare-back', onclick: () => this.send('Rolled back', 'decide', { accept: false }) }, 'Roll back');
    this.decided = element('p', { class: 'detail', id: 'compare-decided', role: 'status' });
    place.append(
      element('p', { class: 'detail' }, 'The controller that acts and a candidate take turns, in random order, with the same references, until it is clear which one is better. The one that acts now is back at once when the candidate does badly, when something fails, or when this page is closed.'),
      element('div', { class: 'versus' }, element('span', {}, 'Acts now: ', this.acting), element('label', {}, 'Candidate', this.choice), element('label', {}, 'Better means', this.by)),
      element('div', { class: 'fields' }, ...this.fields), this.hint,
      element('div', { class: 'tools' }, this.arm, this.start, this.stop), this.step, this.bar, this.verdict, this.warnings, this.table, this.figure,
      element('div', { class: 'tools' }, this.accept, this.back), this.decided);
    addEventListener('candidate', event => { this.wanted = event.detail; this.list(); });
    addEventListener('view', () => this.list());
    this.list();
    setInterval(() => this.list(), LIST_MS);
    setInterval(() => this.ask(), ASK_MS);
  }

  field({ name, label, value, min, max, step, unit }) {
    const input = element('input', { type: 'number', name, min, max, step, value, 'data-compare': name, oninput: () => { this.drawnOf = ''; } });
    return element('label', {}, `${label}${unit ? ` (${unit})` : ''}, ${min} to ${max}`, input);
  }

  get numbers() {
    return Object.fromEntries(this.fields.map(one => one.querySelector('input')).map(input => [input.name, Number(input.value)]));
  }

  /** What may be tried: the daemon's folder, without the one that acts. */
  async list() {
    if (document.hidden || this.page.views.shown !== 'try' || (this.last?.running && !this.wanted)) return; // meanwhile another one acts at times
    try {
      const keys = (await (await fetch('/api/work/controllers')).json()).map(one => one.key);
      const acting = this.page.device?.state.status.controller?.sha256, offered = keys.filter(key => !key.endsWith(`@${acting}`) && !key.startsWith('signal-'));
      const text = `${offered.join()} ${this.wanted ?? ''}`;
      if (text === this.listed) return;
      this.listed = text;
      const kept = this.wanted ?? this.choice.value;
      this.wanted = undefined;
      this.choice.replaceChildren(...(offered.length ? offered : ['']).map(key => element('option', { value: key, selected: key === kept }, key ? file(key) : 'none in the daemon’s folder')));
    } catch {
      // the server is gone; the link says so
    }
  }

  async ask() {
    if (!this.last?.running && (document.hidden || this.page.views.shown !== 'try')) return;
    try {
      const { proof } = this.page.commands;
      this.last = (await (await fetch('/api/compare', { headers: proof ? { 'x-hoopd-proof': proof } : {} })).json()).last;
    } catch {
      // the server is gone; the link says so
    }
  }

  async send(what, path, content = {}) {
    const { commands } = this.page;
    commands.show(`${what} …`, 'waiting');
    await commands.request(what, `/api/compare/${path}`, content, () => `${what}: done`, 25000);
    await this.ask();
  }

  /** One click takes what is better; what is not is asked for once more. */
  decide() {
    const { last } = this, since = Date.now() - (this.askedAt ?? 0), sure = last.verdict === 'better' || since < CONFIRM_MS;
    if (last.verdict !== 'better' && since < READ_MS) return undefined; // a double click reads nothing
    if (sure) {
      this.askedAt = 0;
      return this.send('Candidate accepted', 'decide', { accept: true, key: last.candidate, anyway: last.verdict !== 'better' });
    }
    this.askedAt = Date.now();
    say(this.decided, `By the ${MEASURES[last.judged_by].name} the candidate is not better (${last.verdict}). Click again within ${CONFIRM_MS / 1000} s to accept it all the same.`);
    return undefined;
  }

  begin() {
    const bad = this.fields.map(one => one.querySelector('input')).find(input => !input.checkValidity());
    if (bad) return bad.reportValidity();
    this.askedAt = 0;
    return this.send('Comparison begun', 'begin', { device: this.page.device.identity, key: this.choice.value, by: this.by.value, ...this.numbers, seed: Math.floor(Math.random() * 65536) });
  }

  show(device) {
    if (this.page.views.shown !== 'try') return;
    const { last } = this, running = Boolean(last?.running), may = Boolean(this.page.commands.user);
    const { file: name, sha256 } = device?.state.status.controller ?? {}, mode = device?.word('mode');
    say(this.acting, file(running ? last.accepted : `${name ?? '–'}@${sha256 ?? ''}`));
    const { blocks, hold_s: hold } = this.numbers, minutes = blocks * (2 + 4 * hold + REST_S) / 60;
    const missing = !may ? 'Log in first.' : mode !== 'RUNNING' ? `Arm it first: ${modeWords(device)}.` : !this.choice.value ? 'Design a controller and lay it into the daemon’s folder first.' : '';
    say(this.hint, missing || `At most ${number(minutes, 1)} minutes; it ends sooner when it is clear. Leave references and gains alone meanwhile.`);
    this.arm.hidden = !may || ['RUNNING', 'READY'].includes(mode);
    this.start.disabled = running || Boolean(missing);
    this.by.disabled = running;
    say(this.accept, last?.verdict === 'better' ? 'Accept' : Date.now() - (this.askedAt ?? 0) < CONFIRM_MS ? 'Accept it all the same' : 'Accept …');
    this.stop.disabled = !running || !may;
    this.stop.hidden = !running;
    this.bar.hidden = !running;
    const decides = Boolean(last && !running && last.pairs.length + (last.reason ? 1 : 0));
    this.accept.hidden = this.back.hidden = !decides;
    this.accept.disabled = this.back.disabled = !may;
    const text = JSON.stringify(last);
    if (text === this.drawnOf) return;
    this.drawnOf = text;
    this.draw(last, running);
  }

  draw(last, running) {
    for (const part of [this.verdict, this.warnings, this.table, this.figure]) part.hidden = !last;
    say(this.step, running ? last.step : '');
    if (!last) return;
    this.bar.value = last.share;
    const [state, words] = VERDICTS[last.verdict] ?? ['', 'Not clear yet.'], measure = MEASURES[last.judged_by];
    this.verdict.dataset.state = state;
    say(this.verdict, `${last.reason ? `${words.replace(/\.$/, ':')} ${last.reason}.` : words} Judged by the ${measure.name}.`);
    this.warnings.replaceChildren(...(last.warnings ?? []).map(one => element('li', {}, one)));
    const row = (label, { accepted, candidate, change_percent: change, interval_percent: [low, high] }, digits) => element('tr', {},
      element('th', { scope: 'row' }, label), element('td', {}, digits(accepted)), element('td', {}, digits(candidate)),
      element('td', {}, percent(change)), element('td', {}, low === null || high === null ? 'too few pairs' : `${percent(low)} … ${percent(high)}`));
    this.table.replaceChildren(
      element('thead', {}, element('tr', {}, ...['', `acts: ${file(last.accepted)}`, `candidate: ${file(last.candidate)}`, 'change', `interval, ${number(100 * (1 - last.alpha), 0)} %, at any look`].map(one => element('th', { scope: 'col' }, one)))),
      element('tbody', {}, ...[...Object.values(MEASURES), ...BESIDE].map(one => row(`${one.row}${one === measure ? ' (decides)' : ''}`, last[one.result], short))));
    this.figure.replaceChildren(...(last.pairs.length ? [pairs(last, measure), element('p', { class: 'detail' }, `Change of the ${measure.name}, pair by pair (dots), and the interval so far (bars). Below zero the candidate is better.`)] : []));
    if (last.decided) this.askedAt = 0;
    say(this.decided, last.decided ? `The candidate was ${last.decided}.` : '');
  }
}

/** Change of what decides after each pair, with its interval; negative is better. */
function pairs({ pairs: all, ...last }, { result, name }) {
  const WIDE = 640, HIGH = 190, LEFT = 60, LOW = 28;
  const ends = last[result].intervals_percent, changes = all.map(one => 100 * (one[result].candidate / one[result].accepted - 1));
  const values = [0, ...changes, ...ends.flat()].filter(value => value !== null && Math.abs(value) < 400);
  const low = Math.min(...values), high = Math.max(...values), room = (high - low || 1) * 0.08;
  const x = k => LEFT + (k + 0.5) * (WIDE - LEFT - 10) / all.length;
  const y = value => (HIGH - LOW) * (1 - (Math.min(high, Math.max(low, value)) - low + room) / (high - low + 2 * room)) + 4;
  const text = (place, height, words, anchor) => drawn('text', { x: place, y: height, 'text-anchor': anchor, class: 'axis' }, words);
  return drawn('svg', { viewBox: `0 0 ${WIDE} ${HIGH}`, role: 'img', 'aria-label': `change of the ${name} by pair: ${changes.map(one => percent(one)).join(', ')}` },
    drawn('line', { x1: LEFT, x2: WIDE, y1: y(0), y2: y(0), class: 'zero' }),
    ...[low, 0, high].filter((one, k, shown) => k === 1 || Math.abs(y(one) - y(shown[1])) > 14).map(one => text(LEFT - 8, y(one) + 4, one ? percent(one) : '0 %', 'end')),
    ...ends.flatMap(([from, to], k) => (from === null || to === null ? [] : [drawn('line', { x1: x(k), x2: x(k), y1: y(from), y2: y(to), class: 'interval' })])),
    ...changes.map((one, k) => drawn('circle', { cx: x(k), cy: y(one), r: 5, class: 'pair' })),
    ...changes.map((one, k) => text(x(k), HIGH - 10, `${k + 1}`, 'middle')),
    text(LEFT, HIGH - 10, 'pair', 'end'));
}
