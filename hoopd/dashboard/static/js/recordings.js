// The table of recordings: search, choose, plot, compare, download, and what people wrote about them.

import { byId, drawn, element, number, renew, say } from './text.js';

const WIDE = 120, HIGH = 34;
const COMPARED = 6;

const size = bytes => (bytes >= 1e6 ? `${number(bytes / 1e6, 1)} MB` : `${number(bytes / 1e3, 0)} kB`);
const two = part => String(part).padStart(2, '0');
const date = seconds => {
  const at = new Date(seconds * 1e3);
  return `${at.getFullYear()}-${two(at.getMonth() + 1)}-${two(at.getDate())} ${two(at.getHours())}:${two(at.getMinutes())}`;
};
const query = names => names.map(name => `name=${encodeURIComponent(name)}`).join('&');

/** Extremes over time as a path. */
function curve(extremes) {
  const known = extremes.filter(Boolean);
  const low = Math.min(...known.map(one => one[0])), high = Math.max(...known.map(one => one[1]));
  const y = value => (HIGH - 2 - ((value - low) / (high - low || 1)) * (HIGH - 4)).toFixed(1);
  let path = '', gap = true;
  extremes.forEach((one, k) => {
    if (one) path += `${gap ? 'M' : 'L'}${k + 0.5} ${y(one[0])}L${k + 0.5} ${y(one[1])}`;
    gap = !one;
  });
  return path;
}

const thumbnail = ({ curves }) => drawn('svg', { viewBox: `0 0 ${WIDE} ${HIGH}`, role: 'img', 'aria-label': Object.keys(curves).join(', ') },
  ...Object.values(curves).reverse().map((one, k, all) => drawn('path', { d: curve(one), class: `s${all.length - 1 - k}` })));

export class Recordings {
  constructor(work) {
    Object.assign(this, { work, chosen: new Set(), listed: [], shown: '', writing: new Map() });
    this.search = element('input', { type: 'search', placeholder: 'name, tag or note', 'aria-label': 'Search recordings', oninput: () => this.draw() });
    this.plot = element('button', { type: 'button', onclick: () => this.look([...this.chosen]) }, 'Plot');
    this.count = element('small', { class: 'detail' });
    byId('recording-tools').append(this.search, this.plot, this.count);
    this.draw();
  }

  show(listed) {
    const text = JSON.stringify(listed);
    if (text === this.shown) return;
    this.shown = text;
    this.listed = listed;
    const names = new Set(listed.map(one => one.name));
    for (const name of this.chosen) if (!names.has(name)) this.chosen.delete(name);
    this.draw();
  }

  /** Those that have every word of the search. */
  get found() {
    const words = this.search.value.toLowerCase().split(/\s+/).filter(Boolean);
    return this.listed.filter(one => {
      const text = [one.name, ...one.tags, one.note, ...(one.glance?.modes ?? [])].join(' ').toLowerCase();
      return words.every(word => text.includes(word));
    });
  }

  draw() {
    const { found } = this;
    const head = ['', 'Recording', '', 'Length', 'Changed', 'Size', ''].map(name => element('th', { scope: 'col' }, name));
    renew(byId('recordings'), () => [found.length
      ? element('table', {}, element('thead', {}, element('tr', {}, ...head)), element('tbody', {}, ...found.flatMap(one => [this.row(one), this.writing.get(one.name)].filter(Boolean))))
      : element('p', { class: 'detail' }, this.listed.length ? 'None with these words.' : 'No recording in the folder.')]);
    this.tell();
  }

  tell() {
    const many = this.chosen.size;
    say(this.plot, many > 1 ? `Compare ${many}` : 'Plot');
    this.plot.disabled = many < 1 || many > COMPARED;
    say(this.count, `${this.found.length} of ${this.listed.length}${many ? `, ${many} chosen` : ''}`);
    dispatchEvent(new CustomEvent('chosen', { detail: [...this.chosen] }));
  }

  row(one) {
    const { glance } = one;
    const box = element('input', {
      type: 'checkbox', 'aria-label': `choose ${one.name}`, onchange: () => {
        if (box.checked) this.chosen.add(one.name);
        else this.chosen.delete(one.name);
        this.tell();
      },
    });
    box.checked = this.chosen.has(one.name);
    const length = glance?.seconds === undefined ? (glance ? '–' : '…') : `${number(glance.seconds, glance.seconds < 100 ? 1 : 0)} s`;
    return element('tr', { 'data-row': one.name },
      element('td', {}, box),
      element('td', { class: 'name' }, one.name, element('br'), ...one.tags.map(tag => element('span', { class: 'tag' }, tag)),
        element('small', {}, glance?.wrong ?? one.note)),
      element('td', {}, glance?.curves ? thumbnail(glance) : ''),
      element('td', { class: 'number' }, length),
      element('td', { class: 'number' }, date(one.changed)),
      element('td', { class: 'number' }, size(one.bytes)),
      element('td', {},
        element('button', { type: 'button', onclick: () => this.look([one.name]) }, 'Plot'), ' ',
        element('button', { type: 'button', onclick: event => this.write(one, event.target.closest('tr')) }, 'Note'), ' ',
        element('a', { href: `/api/work/recording?${query([one.name])}`, download: one.name, 'aria-label': `download ${one.name}` }, 'Download')));
  }

  look(names) {
    this.work.open(names.join(', '), `/api/work/plot?${query(names)}`);
  }

  /** Tags and a note, below the row, until they are kept or put away. */
  write(one, row) {
    const away = () => {
      this.writing.get(one.name)?.remove();
      return this.writing.delete(one.name);
    };
    if (away()) return;
    const tags = element('input', { value: one.tags.join(', '), 'aria-label': 'Tags, separated by commas', placeholder: 'tags, separated by commas' });
    const note = element('textarea', { 'aria-label': 'Note', placeholder: 'note' }, one.note);
    const keep = async event => {
      event.preventDefault();
      if (!this.work.commands.user) {
        this.work.commands.show('log in to write a note', 'bad');
        return;
      }
      const remark = { name: one.name, tags: tags.value.split(','), note: note.value };
      if (await this.work.change(`note on ${one.name}`, 'remark', remark)) away();
    };
    const form = element('form', { class: 'remark', onsubmit: keep }, tags, note,
      element('div', {}, element('button', { class: 'primary' }, 'Keep')));
    this.writing.set(one.name, element('tr', { class: 'writing' }, element('td', { colspan: 7 }, form)));
    row.after(this.writing.get(one.name));
  }
}
