// The mode of a device and what is behind it, in words: the same on every view and in every hint.

import { element, inClicks, say } from './text.js';

const MODES = {
  DISARMED: 'drive off',
  READY: 'drive on, no torque: waits for board and ball',
  RUNNING: 'drive on, the controller acts',
  STOPPING: 'brakes the hoop, then disarms',
  FAULT: 'drive off until somebody acknowledges',
};
const text = value => (typeof value === 'string' ? value : '');
const names = value => (Array.isArray(value) ? value.filter(text) : []);

export const modeOf = device => device?.word('mode') || text(device?.state.status.mode);

/** Faults behind the mode: those that led to it, and those in the way of arming; each with what it means and what clears it,
    once a status of this mode has told so: it comes once a second, the event of a change at once. */
export function reasons(device) {
  const { status = {}, because } = device?.state ?? {}, mode = modeOf(device), of = told => !text(told) || told === mode;
  const led = of(because?.mode) ? names(because?.names) : [], current = Boolean(status.causes) && of(status.mode);
  const causes = current ? status.causes : {}, known = Object.keys(causes);
  const hinders = ['DISARMED', 'FAULT'].includes(mode) ? text(status.arming).split(', ').filter(name => known.includes(name)) : [];
  return [...new Set([...led, ...hinders])].map(name => ({
    name, meaning: text(causes[name]?.meaning), clears: known.includes(name) ? inClicks(text(causes[name]?.clears)) : current ? 'is over' : '',
  }));
}

const told = ({ name, meaning, clears }) => {
  const words = meaning ? `${meaning}${clears ? `; clears: ${clears}` : ''}` : clears;
  return words ? `${name} (${words})` : name;
};

/** What a hint says, as a daemon's refusal does: the mode, and the names of the faults behind it; the line above has the rest. */
export function modeWords(device) {
  const behind = reasons(device).map(({ name }) => name).join(', ');
  return `the mode is ${modeOf(device) || 'unknown'}${behind ? ` (${behind})` : ''}`;
}

/** What the mode means, or why it is another one than somebody wants. */
export function meaning(device) {
  const behind = reasons(device), mode = modeOf(device);
  return behind.length ? `${mode === 'FAULT' ? 'drive off' : MODES[mode] ?? ''}: ${behind.map(told).join(', ')}` : MODES[mode] ?? '';
}

/** A line on every view but the first, which says it larger; what is scrolled to stops below it. */
export class ModeLine {
  constructor(place, page) {
    this.place = place;
    this.page = page;
    this.mode = element('strong');
    this.words = element('span');
    this.clear = element('button', { type: 'button', onclick: () => page.commands.send('clear') }, 'Clear faults');
    place.append(this.mode, this.words, this.clear);
    new ResizeObserver(() => document.documentElement.style.setProperty('--mode-line', `${place.offsetHeight}px`)).observe(place);
  }

  show(device, stale) {
    const mode = stale ? 'stale' : modeOf(device);
    this.place.hidden = this.page.views.shown === 'drive' || !device;
    this.place.dataset.mode = mode;
    say(this.mode, stale ? `${modeOf(device) || '–'} ?` : mode || '–');
    say(this.words, stale ? 'nothing comes from this device: this is what it told last' : meaning(device));
    this.clear.hidden = stale || mode !== 'FAULT' || !this.page.commands.user;
  }
}
