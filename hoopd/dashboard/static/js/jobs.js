// Jobs: what may be asked for, what waits, runs and is over, and what it wrote.

import { byId, element, inClicks, number, renew, say } from './text.js';

const WORDS = { waiting: 'waits', running: 'runs', done: 'done', failed: 'failed', cancelled: 'cancelled' };
const LABELS = {
  'report.html': 'Report', 'figure.svg': 'Figure', 'result.json': 'Numbers', 'model.yaml': 'Model', 'controller.yaml': 'Controller', 'output.txt': 'Output',
};
const address = (job, name) => `/api/work/file?job=${job}&name=${encodeURIComponent(name)}`;

export class Jobs {
  constructor(work) {
    Object.assign(this, { work, chosen: [], told: null, formOf: '', listed: '' });
    byId('job-form').addEventListener('submit', event => this.ask(event));
    addEventListener('chosen', event => { this.chosen = event.detail; this.tell(); });
  }

  show(told) {
    const first = this.told === null;
    this.told = told;
    if (first) this.form('diagnose' in told.forms ? 'diagnose' : Object.keys(told.forms)[0]);
    this.models();
    this.tell();
    const shown = JSON.stringify([told.jobs, this.work.commands.user]);
    if (shown === this.listed) return;
    this.listed = shown;
    renew(byId('jobs'), () => (told.jobs.length ? told.jobs.map(job => this.row(job)) : [element('li', { class: 'nothing' }, 'none yet')]));
    this.work.renew();
  }

  // ---- asking

  form(kind) {
    this.kind = kind;
    const { forms } = this.told, form = forms[kind];
    const choose = element('select', { 'aria-label': 'Job', onchange: event => this.form(event.target.value) },
      ...Object.keys(forms).map(name => element('option', { value: name, selected: name === kind }, name)));
    const fields = form.fields.map(field => this.field(field));
    if (form.laws.length) fields.unshift(this.labelled('Law', this.choice('law', form.laws)));
    if (form.holdout) fields.unshift(this.labelled('Held back, to judge', this.choice('holdout', [''], { none: 'none of the chosen' })));
    this.used = element('p', { class: 'detail' });
    this.send = element('button', { class: 'primary' }, 'Start');
    byId('job-form').replaceChildren(
      element('div', { class: 'tools' }, choose, element('span', { class: 'detail' }, form.meaning)),
      this.used, element('div', { class: 'fields' }, ...fields), element('div', {}, this.send));
    this.models();
    this.tell();
  }

  labelled(label, control) {
    return element('label', {}, label, control);
  }

  choice(name, values, { none = 'as usual' } = {}) {
    return element('select', { name }, ...values.map(value => element('option', { value }, value || none)));
  }

  field({ option, label, kind, choices, unit, usual }) {
    const name = option.replace(/^-+/, ''), text = unit ? `${label} (${unit})` : label;
    if (kind === 'choice') return this.labelled(text, this.choice(name, ['', ...choices]));
    if (kind === 'flag') return this.labelled(text, this.choice(name, ['', ...choices], { none: 'leave it out' }));
    if (kind === 'model' || kind === 'identified') return this.labelled(text, element('select', { name, 'data-models': kind, 'data-usual': usual }));
    return this.labelled(text, element('input', { name, autocomplete: 'off', inputmode: kind === 'number' ? 'decimal' : null }));
  }

  /** Models to choose from, kept up to date without losing the choice. */
  models() {
    const of = Object.fromEntries(this.told.jobs.map(job => [`${job.number}/model.yaml`, job]));
    for (const place of byId('job-form').querySelectorAll('[data-models]')) {
      const fits = this.told.models.filter(name => (of[name]?.order.kind === 'identify') === (place.dataset.models === 'identified'));
      const text = fits.join();
      if (place.dataset.shown === text) continue;
      const kept = place.dataset.shown ? place.value : place.dataset.usual;
      place.dataset.shown = text;
      place.replaceChildren(element('option', { value: '' }, 'as usual'),
        ...fits.map(name => element('option', { value: name }, of[name] ? `job ${of[name].number}, ${of[name].order.kind}` : name)));
      if (fits.includes(kept)) place.value = kept;
    }
  }

  tell() {
    if (!this.told) return;
    const form = this.told.forms[this.kind], { user } = this.work.commands;
    const held = byId('job-form').querySelector('[name=holdout]');
    if (held && held.dataset.shown !== this.chosen.join('\n')) {
      held.dataset.shown = this.chosen.join('\n');
      const kept = held.value;
      held.replaceChildren(element('option', { value: '' }, 'none of the chosen'), ...this.chosen.map(name => element('option', { value: name }, name)));
      if (this.chosen.includes(kept)) held.value = kept;
    }
    say(this.used, !form.recordings ? '' : this.chosen.length ? `On ${this.chosen.join(', ')}.` : 'Choose recordings in the table.');
    this.used.hidden = !form.recordings;
    this.send.disabled = !user || (form.recordings && !this.chosen.length);
    say(this.send, user ? 'Start' : 'Start (log in first)');
  }

  async ask(event) {
    event.preventDefault();
    const fields = Object.fromEntries([...new FormData(byId('job-form'))].filter(([, value]) => value));
    const held = fields.holdout;
    delete fields.holdout;
    const form = this.told.forms[this.kind];
    await this.work.change(`job ${this.kind}`, 'ask', {
      kind: this.kind, fields, holdout: held ? [held] : [],
      recordings: form.recordings ? this.chosen.filter(name => name !== held) : [],
    });
  }

  /** Into the daemon's folder, and on to the comparison with what acts. */
  async compare({ number: job }) {
    const key = await this.work.change(`job ${job}: to the daemon’s folder`, 'hand_over', { number: job });
    if (!key) return;
    dispatchEvent(new CustomEvent('candidate', { detail: key }));
    location.hash = '#try';
  }

  /** The form of a design, with the model that a job wrote. */
  design({ number: job, order }) {
    const identified = order.kind === 'identify', form = byId('job-form');
    if (!this.told.models.includes(`${job}/model.yaml`)) {
      this.work.commands.show(`the model of job ${job} is not there any more`, 'bad');
      return;
    }
    this.form('design');
    form.querySelector(`[name=${identified ? 'identified' : 'model'}]`).value = `${job}/model.yaml`;
    if (identified) form.querySelector('[name=law]').value = 'identified';
    form.scrollIntoView({ behavior: 'smooth', block: 'center' });
    this.send.focus({ preventScroll: true });
    this.work.commands.show(`the form designs on the model of job ${job}: choose a law, then Start`, 'waiting');
  }

  /** The same diagnosis with its model, though that is doubtful. */
  write({ number: job, order }) {
    const [yes] = this.told.forms[order.kind].fields.find(one => one.option === '--yes').choices;
    return this.work.change(`job ${job}, with its model`, 'ask', { ...order, fields: { ...order.fields, yes } });
  }

  /** The experiment that a diagnosis proposes, into the form that plays it. */
  async next({ number: job }) {
    const { next_experiment: planned } = await (await fetch(address(job, 'result.json'))).json().catch(() => ({}));
    if (!planned?.command) {
      this.work.commands.show(`job ${job} proposes no experiment: ${planned?.reason || 'nothing is left to be told apart'}`, 'waiting');
      return;
    }
    dispatchEvent(new CustomEvent('signal', { detail: planned }));
    location.hash = '#try';
  }

  // ---- what there is

  /** What a job that is over leads to: a click each, instead of the commands that its output names. */
  steps(job) {
    const { order, files } = job, has = name => files.includes(name), { hands_over: offered } = this.told;
    const may = Boolean(this.work.commands.user), ofTheHoop = !order.fields.plant; // what designs and plays knows no other plant
    const step = (label, title, act, can) => element('button', { type: 'button', disabled: !can, title, onclick: () => act.call(this, job) }, label);
    return [
      ofTheHoop && order.kind === 'diagnose' && has('result.json') && step('Next experiment', 'the one that tells most, into the form that plays it', this.next, true),
      order.kind === 'diagnose' && job.line.includes('--yes') && step('Again, and write the model', 'as “A doubtful model: write it, too” does', this.write, may),
      ofTheHoop && has('model.yaml') && step('Design with this model', 'the form of a design, filled in', this.design, true),
      has('controller.yaml') && step('Compare', offered ? 'it takes turns with the controller that acts, in Try' : 'the page’s server was started without --controllers', this.compare, may && offered),
    ].filter(Boolean);
  }

  /** Of a job whose report is open: it may be gone meanwhile. */
  stepsNow(number) {
    const job = this.told.jobs.find(one => one.number === number);
    return job ? this.steps(job) : [];
  }

  row(job) {
    const { told } = this, { order, state, progress } = job, may = Boolean(this.work.commands.user);
    const on = [...order.recordings, ...order.holdout.map(name => `${name} (held back)`), ...Object.entries(order.fields).map(([name, value]) => `${name} ${value}`)];
    const seconds = job.begun && (job.ended ?? Date.now() / 1e3) - job.begun;
    const act = (label, path) => element('button', { type: 'button', disabled: !may, onclick: () => this.work.change(`job ${job.number}: ${label}`, path, { number: job.number }) }, label);
    const open = name => this.work.open(`job ${job.number}: ${LABELS[name]}`, address(job.number, name), name === 'report.html' ? () => this.stepsNow(job.number) : undefined);
    const over = !['waiting', 'running'].includes(state), steps = over ? this.steps(job) : [];
    return element('li', { 'data-state': state, 'data-row': job.number },
      element('div', { class: 'row' }, element('b', {}, `${job.number} ${order.kind}`), element('span', {}, `${WORDS[state]}${seconds && over ? ` in ${number(seconds, 0)} s` : ''}`)),
      element('small', {}, [on.join(', '), `by ${job.who}`].filter(Boolean).join(' · ')),
      state === 'running' ? element('progress', progress?.share === null || progress?.share === undefined ? {} : { value: progress.share }) : '',
      progress?.step ? element('small', {}, progress.step) : '',
      job.line ? element('span', { class: 'wrong' }, inClicks(job.line)) : '',
      job.summary ? element('p', { class: 'says' }, job.summary) : '',
      element('div', { class: 'row' },
        ...job.files.filter(name => name !== 'controller.yaml' && name !== 'model.yaml').map(name => element('button', { type: 'button', onclick: () => open(name) }, LABELS[name])),
        ...job.files.filter(name => name.endsWith('.yaml')).map(name => element('a', { href: address(job.number, name), download: `job${job.number}-${name}` }, LABELS[name])),
        told.hands_over && job.files.includes('controller.yaml') ? act('To the daemon’s folder', 'hand_over') : '',
        over ? act('Again', 'again') : act('Cancel', 'cancel'), over ? act('Remove', 'remove') : ''),
      steps.length ? element('div', { class: 'row next' }, element('small', {}, 'Next:'), ...steps) : '');
  }
}
