// Elements and numbers as text. What comes from a device becomes text content and never markup.

const SVG = 'http://www.w3.org/2000/svg';

export const byId = id => document.getElementById(id);

/** An element with attributes and children; a text child stays text. */
export function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  fill(made, attributes, children);
  return made;
}

/** The same for drawings. */
export function drawn(name, attributes = {}, ...children) {
  const made = document.createElementNS(SVG, name);
  fill(made, attributes, children);
  return made;
}

function fill(made, attributes, children) {
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith('on')) made.addEventListener(key.slice(2), value);
    else if (value !== null && value !== false) made.setAttribute(key, value === true ? '' : value);
  }
  made.append(...children);
}

/** Set a text only when it changes: a screen reader and the layout are spared the rest. */
export function say(target, text) {
  if (target.textContent !== text) target.textContent = text;
}

// A control that is replaced between press and release gets no click, and one that moves under the pointer gets another's.
const CLICK_MS = 50; // from the release to the click, with a finger too
const held = new Map(); // parents that are renewed once the pointer is up
let pressed = null, timer = 0;
addEventListener('pointerdown', event => {
  clearTimeout(timer);
  pressed = event.button === 0 ? event.target : null;
}, true);
const soon = () => { timer = setTimeout(release, CLICK_MS); };
for (const end of ['pointerup', 'pointercancel']) addEventListener(end, soon, true);
for (const end of ['blur', 'contextmenu']) addEventListener(end, release); // of the window, or a menu: no release is told any more

function release() {
  pressed = null;
  const waiting = [...held];
  held.clear();
  for (const [parent, make] of waiting) renew(parent, make);
}

/** Children, as `make` makes them, in the place of those before; who has the focus there keeps it, and never gets another row's. */
export function renew(parent, make) {
  if (pressed && parent.contains(pressed)) return void held.set(parent, make);
  const focused = parent.contains(document.activeElement) ? document.activeElement : null;
  const seen = focused?.matches(':focus-visible');
  const is = focused && identity(focused);
  parent.replaceChildren(...make());
  if (!focused) return;
  const same = parent.contains(focused) ? focused : [...parent.querySelectorAll(focused.tagName)].find(one => identity(one) === is);
  same?.focus({ preventScroll: true, focusVisible: seen });
}

/** What a control is: its row and, within that, what it says. */
const identity = one => JSON.stringify([one.closest('[data-row]')?.dataset.row, 'row' in one.dataset || (one.getAttribute('aria-label') ?? one.textContent)]);

/** A number with a fixed count of decimals, a real minus, and a dash when it is missing. */
export function number(value, decimals = 3, sign = false) {
  if (value === null || value === undefined || !Number.isFinite(value)) return '–';
  const text = Math.abs(value).toFixed(decimals);
  const zero = Number(text) === 0;
  return `${value < 0 && !zero ? '−' : sign ? '+' : ''}${text}`;
}

/** A number with about four digits, whatever its size. */
export function short(value) {
  if (value === null || value === undefined || !Number.isFinite(value)) return '–';
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-3 || size >= 1e5)) return value.toExponential(2).replace('-', '−');
  return number(value, size >= 1000 ? 0 : size >= 100 ? 1 : size >= 10 ? 2 : size >= 1 ? 3 : 4);
}

// What the page does for a command that a daemon or a job names: a click instead of a shell's word.
const CLICKS = {
  arm: '“Arm”', disarm: 'STOP', stop: '“Brake and stop”', clear: '“Clear faults”', controller: '“Load” (Drive)', experiment: '“Play” (Try)', compare: '“Start” (Try)',
  calibrate: '“Calibrate”', calibration: '“Calibrate”', diagnose: 'a job “diagnose” (Work)', design: 'a job “design” (Work)', fit: 'a job “fit” (Work)', identify: 'a job “identify” (Work)', plot: '“Plot” (Work)',
};
const OPTIONS = { 'without --yes': 'unless “A doubtful model” is “write it, too”' };

/** A sentence of a daemon or a job, with the page's own words for what it would type in a shell. */
export const inClicks = text => Object.entries(OPTIONS).reduce((said, [option, click]) => said.replaceAll(option, click),
  `${text}`.replace(/`hoopd (\w+)[^`]*`/g, (whole, name) => CLICKS[name] ?? whole).replace(/`([^`]*)`/g, '“$1”'));

/** Wall clock of a moment, s since 1970. */
export const clock = (seconds, decimals = 0) => {
  const at = new Date(seconds * 1e3);
  const two = part => String(part).padStart(2, '0');
  const rest = decimals ? `.${String(at.getMilliseconds()).padStart(3, '0').slice(0, decimals)}` : '';
  return `${two(at.getHours())}:${two(at.getMinutes())}:${two(at.getSeconds())}${rest}`;
};

/** Rows of a definition list, made once and filled again and again. */
export class Rows {
  constructor(list) {
    this.list = list;
    this.cells = new Map();
  }

  set(name, text, state = '') {
    if (!this.cells.has(name)) {
      const cell = element('dd');
      this.list.append(element('div', {}, element('dt', {}, name), cell));
      this.cells.set(name, cell);
    }
    const cell = this.cells.get(name);
    say(cell, text);
    if (cell.dataset.state !== state) cell.dataset.state = state;
  }
}
