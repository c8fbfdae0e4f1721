// The controller that acts: its name, what follows it, and its gains, set one by one inside the daemon's limits. What is
// shown as the value is what the daemon tells; a field keeps what somebody types until it is applied or given up.

import { element, say, short } from './text.js';

const LIST_MS = 5000, ALIVE_MS = 1000;
const LOADS = {
  controller: ['Load', 'take it over; while it runs its filter is watched for 2 s first'],
  trial: ['Try', 'on trial while this page watches: it goes back by itself when it does worse'],
  experiment: ['Play', 'a test signal, then back'],
};

/** What the device says can be set, as far as it is numbers. */
const told = device => Object.fromEntries(Object.entries(device.state.status.tunables ?? {})
  .filter(([, one]) => Number.isFinite(one?.low) && Number.isFinite(one.high) && Number.isFinite(one.value)));

export class Controller {
  constructor(place, page) {
    Object.assign(this, { page, shape: '', fields: new Map(), past: new Map() });
    this.name = element('strong', { id: 'controller-file' });
    this.state = element('p', { class: 'detail', id: 'controller-state', role: 'status' });
    this.gains = element('div', { id: 'gains' });
    this.undo = element('button', { type: 'button', id: 'undo', onclick: () => this.back() });
    this.choices = ['accept', 'revert'].map(command => element('button', { type: 'button', id: command, onclick: () => page.commands.send(command) },
      { accept: 'Accept', revert: 'Revert' }[command]));
    this.file = element('input', { id: 'load-file', list: 'load-files', autocomplete: 'off', placeholder: 'NAME.yaml@HASH', 'aria-label': 'Controller to load, name and hash' });
    this.files = element('datalist', { id: 'load-files' });
    this.loads = Object.entries(LOADS).map(([command, [label, title]]) => element('button', { type: 'button', id: `load-${command}`, title, onclick: () => this.load(command) }, label));
    place.append(this.name, this.state, this.gains, element('div', { class: 'gain-tools' }, this.undo, ...this.choices),
      element('div', { class: 'gain-tools' }, this.file, this.files, ...this.loads));
    this.list();
    setInterval(() => this.list(), LIST_MS);
    setInterval(() => this.watch(), ALIVE_MS);
  }

  /** What the daemon's folder has, where the page's server knows it; any other name and hash can be typed. */
  async list() {
    if (document.hidden) return;
    try {
      const keys = (await (await fetch('/api/work/controllers')).json()).map(one => one.key);
      if (keys.join() === this.listed) return;
      this.listed = keys.join();
      this.files.replaceChildren(...keys.map(key => element('option', { value: key })));
    } catch {
      // the server is gone; the link says so
    }
  }

  async load(command) {
    const { device } = this.page, key = this.file.value.trim();
    if (!key || !device) {
      this.page.commands.show(`${command}: ${key ? 'no device is chosen' : 'name a file first, as NAME.yaml@HASH'}: nothing was sent`, 'bad');
      return;
    }
    if (await this.page.commands.send(command, null, key) && command === 'trial') this.watched = device.identity;
  }

  /** Of a trial that began here this page is the supervisor, as long as it is open: silence takes the trial back. */
  async watch() {
    const { device } = this.page;
    if (!this.watched || device?.identity !== this.watched) return;
    const answer = await this.page.commands.post('/api/command', { device: device.identity, command: 'alive' }).catch(() => null);
    if (answer && !answer.ok) this.watched = '';
  }

  show(device) {
    const controller = device.state.status.controller ?? {}, tunables = told(device), may = Boolean(this.page.commands.user);
    say(this.name, `${controller.file ?? '–'}`);
    this.name.title = `${controller.sha256 ?? ''}`;
    say(this.state, this.words(controller));
    this.build(device, tunables);
    for (const [name, { field, apply, now }] of this.fields) {
      const { value } = tunables[name];
      say(now, `now ${short(value)}; from ${tunables[name].low} to ${tunables[name].high}`);
      if (document.activeElement !== field && !field.dataset.typed) field.value = String(Number(value.toPrecision(4)));
      field.disabled = apply.disabled = !may;
    }
    const last = this.steps(device).at(-1);
    this.undo.disabled = !may || !last;
    say(this.undo, last ? `Undo ${last.name}: back to ${short(last.value)}` : 'Undo');
    const [accept, revert] = this.choices;
    accept.hidden = !controller.trial;
    revert.hidden = !controller.purpose || controller.purpose === 'controller';
    accept.disabled = revert.disabled = this.file.disabled = !may;
    for (const button of this.loads) button.disabled = !may;
  }

  words({ sha256 = '', purpose, accepted, next }) {
    const parts = [sha256 ? `hash ${`${sha256}`.slice(0, 12)}` : ''];
    if (next) parts.push(`${next} follows and is watched: it is about to take over`);
    if (purpose === 'trial') parts.push(`on trial against ${accepted}`);
    if (purpose === 'experiment') parts.push(`a test signal; then ${accepted} is back`);
    return parts.filter(Boolean).join(' · ');
  }

  /** Fields of what can be set, made anew only for another device, run, controller or set of names. */
  build(device, tunables) {
    const names = Object.keys(tunables);
    const { file, sha256, since } = device.state.status.controller ?? {};
    const shape = JSON.stringify([device.identity, device.state.run, file, sha256, since, names, names.map(name => [tunables[name].low, tunables[name].high])]);
    if (shape === this.shape) return;
    this.shape = shape;
    this.fields.clear();
    this.gains.replaceChildren(...(names.length ? names.map(name => this.row(name, tunables[name])) : [element('p', { class: 'detail' }, 'No gains to set.')]));
  }

  row(name, { low, high }) {
    const field = element('input', {
      type: 'number', step: 'any', min: low, max: high, 'data-gain': name, 'aria-label': name,
      oninput: () => { field.dataset.typed = 'yes'; },
      onkeydown: event => {
        if (event.key === 'Enter') this.apply(name);
        else if (event.key === 'Escape') {
          delete field.dataset.typed;
          field.blur();
        }
      },
    });
    const apply = element('button', { type: 'button', 'data-apply': name, onclick: () => this.apply(name) }, 'Apply');
    const now = element('small');
    this.fields.set(name, { field, apply, now });
    return element('div', { class: 'gain' }, element('span', {}, name.replaceAll('_', '_\u200b')), field, apply, now);
  }

  /** What was set on this page in this run under this controller; another one's gains are no way back. */
  steps(device) {
    if (!this.past.has(this.shape)) this.past.set(this.shape, []);
    return this.past.get(this.shape);
  }

  async apply(name) {
    const { device } = this.page, { field } = this.fields.get(name), before = told(device)[name]?.value;
    if (!field.dataset.typed) return; // what is shown is rounded: only what somebody typed is sent
    if (field.value === '' || !field.checkValidity()) {
      field.reportValidity();
      return;
    }
    const steps = this.steps(device);
    if (!await this.page.commands.send('tune', Number(field.value), name)) return;
    delete field.dataset.typed;
    if (before !== undefined) steps.push({ name, value: before });
  }

  async back() {
    const steps = this.steps(this.page.device), last = steps.at(-1);
    if (last && await this.page.commands.send('tune', last.value, last.name)) steps.splice(steps.indexOf(last), 1);
  }
}
