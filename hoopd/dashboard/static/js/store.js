// What the page keeps of a device: ten minutes of every channel, its newest status, its latest events.
//
// A column is twice as long as what is kept, so that the newest part always lies in one piece: it is moved to the front
// once in ten minutes, and a chart is handed a view of it.

const KEPT = 30000;
const EVENTS = 200;
export const WALL = 'wall';

export class Device {
  constructor(identity) {
    this.identity = identity;
    this.state = { name: identity, endpoint: '', alive: false, run: '', runs: 0, status: {} };
    this.names = [];
    this.words = {};
    this.events = [];
    this.columns = new Map([[WALL, new Float64Array(2 * KEPT)]]);
    this.length = 0;
    this.next = 0; // number of the row that comes after the last one here
    this.ready = false; // the history is here
    this.waiting = []; // rows that came before it
  }

  /** One frame's news. */
  take(news) {
    if (news.state) this.state = news.state;
    if (news.names) this.names = news.names;
    if (news.words) this.words = news.words;
    if (news.events) this.events = [...this.events, ...news.events].slice(-EVENTS);
    if (!news.rows) return;
    const part = { first: news.first, names: this.names, rows: news.rows };
    if (this.ready) this.add(part);
    else this.waiting.push(part);
  }

  /** The server's history: it replaces what is here. */
  load(buffer) {
    const size = new DataView(buffer).getUint32(0, true);
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
    const count = Math.min(header.rows, KEPT), skipped = header.rows - count;
    header.names.forEach((name, place) => {
      const from = 4 + size + 8 * (place * header.rows + skipped);
      this.column(name).set(new Float64Array(buffer, from, count));
    });
    this.names = header.names;
    this.words = header.words;
    this.length = count;
    this.next = header.first + header.rows;
    this.ready = true;
    this.waiting.splice(0).forEach(part => this.add(part));
  }

  add({ first, names, rows }) {
    rows.forEach((row, place) => {
      if (first + place < this.next) return;
      this.next = first + place + 1;
      if (this.length === 2 * KEPT) this.move();
      names.forEach((name, at) => { this.column(name)[this.length] = row[at] ?? NaN; });
      this.length += 1;
    });
  }

  column(name) {
    if (!this.columns.has(name)) this.columns.set(name, new Float64Array(2 * KEPT).fill(NaN));
    return this.columns.get(name);
  }

  move() {
    for (const column of this.columns.values()) {
      column.copyWithin(0, KEPT);
      column.fill(NaN, KEPT);
    }
    this.length = KEPT;
  }

  /** The newest number of a channel, NaN when it is missing. */
  last(name) {
    return this.length && this.columns.has(name) ? this.columns.get(name)[this.length - 1] : NaN;
  }

  /** The newest number that there is among the last rows, and how many rows ago it came. */
  lastKnown(name, rows = 100) {
    const column = this.columns.get(name);
    if (!column) return [NaN, Infinity];
    for (let back = 1; back <= Math.min(rows, this.length); back += 1) {
      const value = column[this.length - back];
      if (!Number.isNaN(value)) return [value, back - 1];
    }
    return [NaN, Infinity];
  }

  /** Text of a channel that has words. */
  word(name) {
    return this.words[name]?.[this.last(name)] ?? '';
  }

  /** First row at or after a moment. */
  rowAt(wall) {
    const times = this.columns.get(WALL);
    let low = 0, high = this.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (times[middle] < wall) low = middle + 1;
      else high = middle;
    }
    return low;
  }
}
