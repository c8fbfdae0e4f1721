// Numbers, faults, timing, camera and events of the device that is shown.

import { meaning, modeOf } from './modes.js';
import { byId, clock, element, inClicks, number, Rows, say } from './text.js';

const BOARD_STATUS = ['enabled', 'time-out latched', 'torque limited', 'fault'];
const BOARD_ERRORS = ['crc', 'seq gap', 'overcurrent', 'encoder', 'supply', 'overspeed'];
const DEGREES = 180 / Math.PI;
const MEAN_ROWS = 100; // two seconds
const SHOWN_EVENTS = 60;
const milliseconds = seconds => `${number(seconds * 1e3, 2)} ms`;
const bits = (value, names) => names.filter((_, bit) => value & (1 << bit)).join(', ') || 'none';

export class Panels {
  constructor() {
    this.timing = new Rows(byId('timing'));
    this.camera = new Rows(byId('camera'));
    this.readouts = new Map();
    for (const [key, name, unit] of [['ball', 'Ball', 'rad'], ['reference', 'Reference', 'rad'], ['torque', 'Torque', 'N m'], ['speed', 'Hoop', 'rad/s']]) {
      const value = element('span', { class: 'value' }), more = element('span', { class: 'more' });
      byId('readouts').append(element('div', { class: key }, element('dt', {}, name), element('dd', {}, value, element('span', { class: 'unit' }, unit), more)));
      this.readouts.set(key, [value, more]);
    }
    this.shownFaults = '';
    this.shownEvent = null;
  }

  show(device, stale) {
    this.showMode(device, stale);
    this.showNumbers(device);
    this.showFaults(device);
    this.showTiming(device);
    this.showCamera(device);
    this.showEvents(device);
  }

  showMode(device, stale) {
    const mode = modeOf(device) || '–', place = byId('mode');
    say(place, stale ? `${mode} ?` : mode);
    place.dataset.mode = stale ? 'stale' : mode;
    say(byId('mode-detail'), stale ? 'nothing comes from this device: these are its last numbers' : meaning(device));
  }

  showNumbers(device) {
    const ball = device.last('x_hat_2'), sigma = device.state.status.deviation?.[2];
    this.readout('ball', ball, 3, `${number(ball * DEGREES, 1, true)}°${Number.isFinite(sigma) ? ` ± ${number(2 * sigma * DEGREES, 1)}°` : ''}`);
    this.readout('reference', device.last('reference'), 3, `${number(device.last('reference') * DEGREES, 1, true)}°`);
    this.readout('torque', device.last('u'), 3, `${number(device.last('current'), 2, true)} A`);
    this.readout('speed', device.last('x_hat_1'), 2, `${number(device.last('x_hat_0') / (2 * Math.PI), 2, true)} turns`);
  }

  readout(key, value, decimals, more) {
    const [main, beside] = this.readouts.get(key);
    say(main, number(value, decimals, true));
    say(beside, more);
  }

  showFaults(device) {
    const { faults = [], causes = {}, arming } = device.state.status;
    const now = JSON.stringify([device.identity, faults, causes, arming]);
    if (now === this.shownFaults) return;
    this.shownFaults = now;
    const rows = faults.map(name => element('div', { class: 'fault' },
      element('strong', {}, name), element('p', {}, inClicks(causes[name]?.meaning ?? '')),
      element('p', { class: 'clears' }, causes[name]?.clears ? `clears: ${inClicks(causes[name].clears)}` : '')));
    const none = element('p', { class: 'none' }, 'none');
    const arm = arming ? [element('p', { class: 'arming' }, `arming: ${arming}`)] : [];
    byId('faults').replaceChildren(...(rows.length ? rows : [none]), ...arm);
    byId('faults').closest('.panel').classList.toggle('bad', rows.length > 0);
  }

  showTiming(device) {
    const { status } = device.state;
    this.timing.set('tick rate', `${number(status.tick_rate_hz, 1)} Hz`);
    this.timing.set('lateness, now', milliseconds(device.last('lateness_s')));
    this.timing.set('lateness, worst of 1 s', milliseconds(status.lateness_worst_s));
    this.timing.set('lateness, 99 %', milliseconds(status.lateness_p99_s));
    this.timing.set('execution, now', milliseconds(device.last('execution_s')));
    this.timing.set('execution, worst of 1 s', milliseconds(status.execution_worst_s));
    this.timing.set('execution, 99 %', milliseconds(status.execution_p99_s));
    this.timing.set('missed ticks', `${status.missed_ticks ?? '–'}`, status.missed_ticks ? 'note' : '');
    this.timing.set('board', bits(device.last('status'), BOARD_STATUS));
    const errors = device.last('errors');
    this.timing.set('board errors', bits(errors, BOARD_ERRORS), errors ? 'bad' : '');
  }

  showCamera(device) {
    const { status } = device.state, [taken, ago] = device.lastKnown('psi_t');
    const age = device.last('t') - taken;
    this.camera.set('age of the picture', Number.isFinite(age) ? `${number(age * 1e3, 0)} ms` : 'none for 2 s', ago > 10 ? 'bad' : '');
    this.camera.set('pictures with the ball', `${number(this.rate(device), 1)} Hz`);
    for (const [name, count] of Object.entries(status.camera ?? {})) this.camera.set(`camera: ${name}`, `${count}`);
    const { dropped, published } = status.telemetry ?? {};
    this.camera.set('telemetry dropped', dropped === undefined ? '–' : `${dropped} of ${published}`, dropped ? 'note' : '');
    const recorder = status.recorder;
    this.camera.set('recorder', recorder ? Object.entries(recorder).map(([name, count]) => `${name} ${count}`).join(', ') : 'off');
    this.camera.set('run', device.state.run || '–');
  }

  /** Pictures in the last two seconds, by the device's own time. */
  rate(device) {
    const rows = Math.min(MEAN_ROWS, device.length), psi = device.columns.get('psi_t'), times = device.columns.get('t');
    if (rows < 2 || !psi || !times) return NaN;
    let pictures = 0;
    for (let row = device.length - rows + 1; row < device.length; row += 1) pictures += Number.isNaN(psi[row]) ? 0 : 1;
    return pictures / (times[device.length - 1] - times[device.length - rows]);
  }

  showEvents(device) {
    const newest = device.events.at(-1) ?? device.identity;
    if (newest === this.shownEvent) return;
    this.shownEvent = newest;
    const rows = device.events.filter(one => one.event !== 'speed' || one.level !== 'debug').slice(-SHOWN_EVENTS).reverse().map(event => {
      const fields = Object.entries(event.fields ?? {}).map(([name, value]) => `${name === event.event ? '' : `${name} `}${typeof value === 'object' ? JSON.stringify(value) : inClicks(value)}`);
      return element('li', { 'data-level': String(event.level) }, element('time', {}, clock(event.wall)),
        element('b', {}, String(event.event)), element('span', {}, fields.join(' · ')));
    });
    byId('events').replaceChildren(...rows);
  }

  /** Who commanded what from this page, newest first. */
  showAudit(lines) {
    if (lines === this.shownAudit) return;
    this.shownAudit = lines;
    const rows = [...lines].reverse().map(line => element('li', { 'data-level': line.ok ? 'info' : 'warning' },
      element('time', {}, clock(Date.parse(line.time) / 1e3)), element('b', {}, `${line.who || 'somebody'}`),
      element('span', {}, [line.device?.split('@')[0], line.command, line.command === 'reference' ? number(line.value, 3, true) : line.key ? `${line.key} ${line.value}` : '', '→', line.ok ? line.mode ?? 'done' : line.reason].filter(Boolean).join(' '))));
    byId('audit').replaceChildren(...(rows.length ? rows : [element('li', { class: 'nothing' }, 'none yet')]));
  }
}
