// The controller that acts: its name, what follows it, and its gains, set one by one inside the daemon's limits. What is
// shown as the value is what the daemon tells; a field keeps what somebody types until it is applied or given up.

import { element, say, short } from './text.js';

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
    place.append(this.name, this.state, this.gains, element('div', { class: 'gain-tools' }, this.undo, ...this.choices));
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
    accept.disabled = revert.disabled = !may;
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
