// A test signal: its kind and numbers inside the limits that the server keeps, how it goes, and where its recording is.

import { modeWords } from './modes.js';
import { element, say } from './text.js';

const ASK_MS = 1000;
const MEANING = {
  prbs: 'Two levels in pseudo-random order: the most power for its torque.', multisine: 'Many sines at once: frequency responses.',
  chirp: 'A sine that rises through all frequencies.', steps: 'Up, rest, down, rest: friction, dead zone, delay.',
};
const STATES = { making: 'The signal is being made …', playing: 'It is being played; then the law that acts now goes on alone.', refused: 'not played: ', over: '' };

export class Experiment {
  constructor(place, page) {
    Object.assign(this, { page, told: null, kind: '' });
    this.choice = element('select', { id: 'signal-kind', 'aria-label': 'Signal', onchange: () => this.build(this.choice.value) });
    this.meaning = element('p', { class: 'detail' });
    this.fields = element('div', { class: 'fields' });
    this.arm = element('button', { type: 'button', class: 'arm', onclick: () => page.commands.send('arm') }, 'Arm');
    this.hint = element('p', { class: 'detail', id: 'signal-hint' });
    this.start = element('button', { type: 'button', class: 'primary', id: 'signal-start', onclick: () => this.begin() }, 'Play');
    this.state = element('p', { id: 'signal-state', role: 'status' });
    this.link = element('a', { href: '#work', hidden: true }, 'See it among the recordings');
    place.append(element('p', { class: 'detail' }, 'It is added to the law that holds the ball now, and recorded. STOP ends it, as everything.'),
      this.choice, this.meaning, this.fields, this.hint, element('div', { class: 'tools' }, this.arm, this.start), this.state, this.link);
    addEventListener('view', () => this.ask());
    addEventListener('signal', event => this.fill(event.detail));
    this.ask();
    setInterval(() => this.ask(), ASK_MS);
  }

  async ask() {
    const busy = ['making', 'playing'].includes(this.told?.last?.state);
    if (this.told && !busy && (document.hidden || this.page.views.shown !== 'try')) return;
    try {
      this.told = await (await fetch('/api/experiment')).json();
      if (!this.kind) {
        this.choice.replaceChildren(...Object.keys(this.told.signals).map(name => element('option', { value: name }, name)));
        this.build(Object.keys(this.told.signals)[0]);
      }
      if (this.wanted) this.fill(this.wanted);
    } catch {
      // the server is gone; the link says so
    }
  }

  build(kind, values = {}) {
    this.kind = this.choice.value = kind;
    say(this.meaning, MEANING[kind] ?? '');
    this.fields.replaceChildren(...this.told.signals[kind].map(({ name, label, unit, low, high, usual, whole }) => element('label', {},
      `${label}${unit ? ` (${unit})` : ''}, ${low} to ${high}`,
      element('input', { type: 'number', name, min: low, max: high, step: whole ? 1 : 'any', value: values[name] ?? usual, placeholder: usual === null ? 'what the model allows' : null, 'data-signal': name }))));
  }

  /** What a diagnosis proposes: its numbers, as far as this form has them. */
  fill(planned) {
    this.wanted = planned;
    if (!this.told) return;
    this.wanted = undefined;
    const [, kind, rest] = /experiment (\w+)(.*)/.exec(planned.command) ?? [];
    const values = Object.fromEntries([...(rest ?? '').matchAll(/--([\w-]+) ([\d.e+-]+)/g)].map(([, name, value]) => [name, value]));
    if (!(kind in this.told.signals)) {
      say(this.state, `The diagnosis proposes ${planned.signal || 'an experiment'}, which needs a ball that nobody holds: record it on the terminal (“Report” has the command), then find it here among the recordings.`);
      return;
    }
    this.build(kind, values);
    say(this.state, `As the diagnosis proposes: ${(planned.reason || `to tell ${planned.tells_apart.join(' from ')}`).replace(/\.$/, '')}.`);
  }

  async begin() {
    const inputs = [...this.fields.querySelectorAll('input')], bad = inputs.find(input => !input.checkValidity());
    if (bad) return bad.reportValidity();
    const numbers = Object.fromEntries(inputs.filter(input => input.value !== '').map(input => [input.name, Number(input.value)]));
    const { commands, device } = this.page;
    commands.show('test signal: being made …', 'waiting');
    this.sent = true;
    await commands.request('test signal', '/api/experiment/begin', { device: device.identity, kind: this.kind, numbers }, () => 'test signal: it plays', 90000);
    this.sent = false;
    return this.ask();
  }

  show(device) {
    if (this.page.views.shown !== 'try' || !this.told) return;
    const { last, offered, reason } = this.told, may = Boolean(this.page.commands.user), mode = device?.word('mode');
    const missing = !offered ? `${reason}.` : !may ? 'Log in first.' : !['RUNNING', 'READY'].includes(mode) ? `Arm it first: ${modeWords(device)}.` : '';
    say(this.hint, missing);
    this.hint.hidden = !missing;
    const busy = this.sent || ['making', 'playing'].includes(last?.state);
    this.arm.hidden = !may || ['RUNNING', 'READY'].includes(mode);
    this.start.disabled = Boolean(missing) || busy;
    if (!last || JSON.stringify(last) === this.shown) return;
    this.shown = JSON.stringify(last);
    const recording = last.recording ? ` Recorded as ${last.recording}.` : '';
    say(this.state, `${last.kind}: ${STATES[last.state]}${['refused', 'over'].includes(last.state) ? `${last.why === 'done' ? 'played to its end' : last.why}.` : ''}${recording}`);
    this.link.hidden = !last.recording;
  }
}
