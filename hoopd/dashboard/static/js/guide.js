// The guided calibration: steps in their order, each with what it found, its plot and a word; below them the versions.

import { figure } from './drawing.js';
import { byId, clock, element, renew, say } from './text.js';

const ASK_MS = 1500, STEP_MS = 20000;
const sentence = words => `${words.charAt(0).toUpperCase()}${words.slice(1)}`;
const SERVES = 'One test signal of 8 s serves steps 5 to 7: small torques on top of the law that holds the ball. Arm first.';
const shown = value => (value === null || value === undefined ? '–' : typeof value === 'object' ? JSON.stringify(value).replace(/"/g, '') : `${value}`);
const address = (path, fields) => `/api/guide/${path}?${new URLSearchParams(fields)}`;

export class Guide {
  constructor(page) {
    Object.assign(this, { page, told: null, cards: new Map(), busy: '', asking: false, versionsShown: '', wrong: '' });
    this.summary = element('p', { class: 'summary', role: 'status' });
    this.list = element('ol', { class: 'steps' });
    this.why = element('input', { id: 'guide-why', maxlength: 200, autocomplete: 'off', placeholder: 'why, in a few words (lens changed)' });
    this.accept = element('button', { type: 'button', class: 'primary', id: 'guide-accept', onclick: () => this.take() }, 'Accept');
    this.choice = element('p', { class: 'detail', id: 'guide-choice' });
    byId('guide').append(this.summary, this.list,
      element('div', { class: 'take' }, element('h3', {}, 'Accept what was found'), this.choice, element('label', {}, 'Occasion', this.why), this.accept));
    addEventListener('view', () => this.enter());
    setInterval(() => this.ask(), ASK_MS);
    this.enter();
  }

  get seen() {
    return this.page.views.shown === 'calibrate';
  }

  /** The live picture lies in the view that is shown; there is one. */
  enter() {
    const picture = document.querySelector('article.picture');
    if (this.seen) byId('guide-picture').append(picture);
    else if (picture.parentElement.id === 'guide-picture') document.querySelector('.panels').prepend(picture);
    this.ask();
  }

  async ask() {
    const device = this.page.device?.identity;
    if (!this.seen || this.asking || !device || document.hidden) return;
    this.asking = true;
    try {
      const told = await (await fetch(address('', { device }).replace('/?', '?'))).json();
      this.told = told.ok ? told : null;
      this.wrong = told.ok ? '' : `${told.reason}`;
      this.show();
    } catch {
      // the server is gone; the link says so
    } finally {
      this.asking = false;
    }
  }

  async post(path, content, what) {
    const { commands, device } = this.page;
    const done = ({ value }) => `${what}: ${Number.isInteger(value) ? `version ${value}` : value ?? 'plays'}`;
    const answer = await commands.request(what, `/api/guide/${path}`, { device: device.identity, ...content }, done, STEP_MS);
    this.busy = '';
    await this.ask();
    return answer;
  }

  look(step) {
    this.busy = step.name;
    this.show();
    this.post('step', { step: step.name }, step.title).then(answer => this.fail(step, answer));
  }

  play(step) {
    this.busy = step.name;
    this.show();
    this.post('play', {}, 'test signal').then(answer => this.fail(step, answer));
  }

  /** What hindered a step stands at the step, until it is done again. */
  fail(step, { ok, reason }) {
    const card = this.cards.get(step.name);
    say(card.wrong, ok ? '' : `${reason}`);
  }

  async take() {
    const steps = this.chosen();
    const answer = await this.post('accept', { steps, why: this.why.value }, `calibration of ${steps.join(', ')}`);
    if (answer.ok) this.why.value = '';
  }

  restore(number) {
    this.post('restore', { number }, `calibration restored from ${number}`);
  }

  chosen() {
    return [...this.cards].filter(([, card]) => card.box.checked && !card.box.disabled).map(([name]) => name);
  }

  // ---- what is shown

  show() {
    say(byId('guide-wrong'), this.wrong);
    if (!this.told) return;
    const { told } = this, may = Boolean(this.page.commands.user);
    told.steps.forEach((step, place) => this.card(step, place, may));
    const left = told.steps.filter(step => told.open.includes(step.name)).map(step => step.title.toLowerCase());
    say(this.summary, left.length ? `Still open: ${left.join(', ')}.` : 'Every step was accepted once. Repeat one after a change at the device.');
    const steps = this.chosen(), doubtful = steps.filter(name => !told.steps.find(step => step.name === name).result.good);
    say(this.choice, told.keeps ? `${told.keeps}.` : !steps.length ? 'Do a step, or several; then choose which results are accepted.'
      : `A new version from: ${steps.join(', ')}.${doubtful.length ? ` Doubtful: ${doubtful.join(', ')}.` : ''} It counts from the daemon’s next start.`);
    this.accept.disabled = !may || Boolean(told.keeps) || !steps.length;
    say(this.accept, may ? 'Accept' : 'Accept (log in first)');
    this.showVersions(may);
  }

  card(step, place, may) {
    if (!this.cards.has(step.name)) this.make(step, place);
    const card = this.cards.get(step.name), { result, accepted, before } = step, moving = step.moves;
    const state = !result ? (before ? 'kept' : 'open') : result.good ? 'good' : 'doubtful';
    card.row.dataset.state = state;
    say(card.word, { open: 'open', kept: 'accepted earlier', good: 'good', doubtful: 'doubtful' }[state] + (result && accepted ? `, accepted in ${accepted}` : ''));
    say(card.why, result ? [`${sentence(result.why)}.`, ...result.notes.map(sentence)].join(' ') : before ? `${sentence(before.why)}.` : step.asks);
    const running = this.busy === step.name || (moving && ['plays'].includes(this.told.motion));
    card.button.disabled = !may || Boolean(this.busy) || running || (moving && Boolean(this.told.moves));
    say(card.button, running ? '…' : moving ? (result ? 'Play again' : 'Play the test signal') : result ? 'Repeat' : 'Look');
    say(card.motion, moving ? (this.told.moves ? 'The page’s server needs --recordings and the daemon’s folder, --controllers.' : this.told.motion ? `The test signal ${this.told.motion}.` : step.name === this.told.steps.find(one => one.moves).name ? SERVES : '') : '');
    const fresh = result && !accepted;
    if (card.box.disabled && fresh) card.box.checked = result.good;
    if (!fresh) card.box.checked = false;
    card.box.disabled = !fresh;
    card.boxLabel.hidden = !fresh;
    if (card.at === result?.at) return;
    card.at = result?.at;
    card.plot.classList.toggle('alone', Boolean(result && !result.drawings.length));
    card.plot.replaceChildren(...(result ? this.plots(step, result) : []));
  }

  make(step, place) {
    const word = element('strong', { class: 'word' }), why = element('p', { class: 'why' }), plot = element('div', { class: 'plot' });
    const wrong = element('p', { class: 'wrong', role: 'alert' }), motion = element('p', { class: 'detail' });
    const box = element('input', { type: 'checkbox', disabled: true, 'aria-label': `Accept ${step.title}`, onchange: () => this.show() });
    const boxLabel = element('label', { class: 'choose-step' }, box, 'accept this');
    const button = element('button', { type: 'button', 'data-step': step.name, onclick: () => (step.moves ? this.play(step) : this.look(step)) });
    const row = element('li', { 'data-step-card': step.name }, element('div', { class: 'head' }, element('h3', {}, `${place + 1}. ${step.title}`), word, boxLabel, button), why, wrong, motion, plot);
    this.cards.set(step.name, { row, word, why, plot, wrong, motion, box, boxLabel, button, at: undefined });
    this.list.append(row);
  }

  plots(step, result) {
    const src = address('picture', { device: this.page.device.identity, step: step.name, at: result.at });
    const picture = result.picture ? [element('a', { href: src, target: '_blank', rel: 'noopener' }, element('img', { src, alt: `What was looked at: ${step.title}`, width: 216 }))] : [];
    return [...picture, ...result.drawings.filter(one => one.curves.length).map(one => figure(one, step.title))];
  }

  showVersions(may) {
    const { versions, in_force: force, wrong } = this.told;
    const now = JSON.stringify([versions, force, may, wrong]);
    if (now === this.versionsShown) return;
    this.versionsShown = now;
    const state = force.number === null ? 'No calibration was accepted yet.' : force.differs === null ? 'Whether the daemon has it is not known.'
      : force.differs.length ? `Version ${force.number} counts from the daemon’s next start; other there now: ${force.differs.join(', ')}.` : `The daemon runs with version ${force.number}.`;
    say(byId('guide-force'), wrong ? `The daemon cannot start with version ${versions[0].number}: ${wrong}. Roll back to an earlier one.` : state);
    byId('guide-force').dataset.state = wrong || force.differs?.length ? 'note' : '';
    renew(byId('guide-versions'), () => versions.map(one => this.version(one, one === versions[0], may)));
  }

  version(one, newest, may) {
    const changes = one.changes.map(({ key, before, now }) => element('li', {}, element('code', {}, key), ` ${shown(before)} → ${shown(now)}`));
    const proofs = (one.evidence ?? []).map(name => element('a', { href: address('evidence', { number: one.number, name }), target: '_blank', rel: 'noopener' }, name));
    const steps = Object.entries(one.steps ?? {}).map(([name, { good, why }]) => element('li', { 'data-good': String(good) }, `${name}: ${good ? 'good' : 'doubtful'}, ${why}`));
    return element('li', { class: one.wrong ? 'spoiled' : '', 'data-row': one.number },
      element('div', { class: 'head' }, element('b', {}, `Version ${one.number}${newest ? ', newest' : ''}`),
        newest || one.date === undefined ? '' : element('button', { type: 'button', disabled: !may, onclick: () => this.restore(one.number) }, 'Roll back to it')),
      element('small', {}, one.date ? `${one.date.slice(0, 10)} ${clock(Date.parse(one.date) / 1e3)} · ${one.who} · ${one.why}` : ''),
      one.wrong ? element('p', { class: 'wrong' }, one.wrong) : '',
      element('ul', {}, ...(changes.length ? changes : [element('li', {}, 'no key changed')])),
      element('details', {}, element('summary', {}, 'Evidence'), element('ul', {}, ...steps), element('p', { class: 'proofs' }, ...proofs)));
  }
}
