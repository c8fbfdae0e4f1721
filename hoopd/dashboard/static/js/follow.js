// What `hoopd learn` and `hoopd heal` do beside the daemon: the story so far, the versions, and what is asked of a person.

import { byId, clock, element, number, renew, say, short } from './text.js';
import { closePage, openPage } from './viewer.js';

const ASK_MS = 1500;
const percent = share => `${number(100 * share, 0)} %`;
const HEAD = {
  learn: ['run', 'signal', 's', 'believed after it', 'sure', 'still open'],
  heal: ['version', 'begun', 'state', 'what', 'proof, nats', 'promised: before, new', 'measured', ''],
};

export class Follow {
  constructor(page) {
    Object.assign(this, { page, asking: false, shown: '', told: [] });
    addEventListener('view', () => this.ask());
    setInterval(() => this.ask(), ASK_MS);
    byId('follow-viewer-away').addEventListener('click', () => closePage('follow-viewer'));
    this.ask();
  }

  async ask() {
    if (this.asking || document.hidden || this.page.views?.shown !== 'follow') return;
    this.asking = true;
    try {
      this.told = await (await fetch('/api/follow')).json();
      this.draw();
    } catch {
      // the server is gone; the link says so
    } finally {
      this.asking = false;
    }
  }

  draw() {
    const shown = JSON.stringify([this.told, this.page.commands.user]);
    if (shown === this.shown) return; // the focus stays where it is
    this.shown = shown;
    byId('follow-none').hidden = this.told.length > 0;
    say(byId('follow-none'), 'This server was started without --follow FOLDER: the folder of a hoopd learn or hoopd heal.');
    renew(byId('followed'), () => this.told.map((one, place) => this.panel(one, place)));
  }

  panel(one, place) {
    const title = element('h2', { id: `followed-${place}` }, `${one.kind === 'heal' ? `Heal: ${one.device}` : 'Learn'} (${one.name})`);
    const state = element('p', { class: 'detail', role: 'status' }, one.reason || this.state(one));
    const asks = one.asks ? [element('p', { class: 'asks' }, element('b', {}, 'Asked of a person: '), one.asks, '.')] : [];
    const body = one.kind === 'heal' ? this.versions(one, place) : one.kind === 'learn' ? this.runs(one, place) : [];
    return element('article', { class: 'panel', 'data-row': place, 'aria-labelledby': `followed-${place}` }, title, state, ...asks, ...body);
  }

  state(one) {
    if (one.kind === 'learn') return one.running ? `It runs: ${one.doing || 'it begins'}.` : one.ended;
    const phase = one.versions[0]?.state;
    return `Version ${one.acting} acts. ${one.running ? `It is followed${['diagnosing', 'proving', 'trying'].includes(phase) ? `: version ${one.versions[0].number} is ${phase}` : ''}.` : 'Nobody follows it now: hoopd heal.'}`;
  }

  table(kind, name, rows) {
    const head = element('tr', {}, ...HEAD[kind].map(word => element('th', { scope: 'col' }, word)));
    return element('div', { class: 'scroll', tabindex: 0, role: 'region', 'aria-label': name },
      element('table', { class: 'proposal' }, element('thead', {}, head), element('tbody', {}, ...rows)));
  }

  runs(one, place) {
    const spent = one.runs.reduce((sum, run) => sum + run.seconds, 0);
    const rows = one.runs.map((run, k) => element('tr', {},
      element('th', { scope: 'row' }, `${k + 1}`), element('td', { title: run.why }, run.signal), element('td', {}, number(run.seconds, 0)),
      element('td', {}, run.explanation), element('td', {}, percent(run.sure)), element('td', {}, run.open.join('; ') || 'nothing')));
    return [
      element('p', { class: 'detail' }, `${number(spent, 0)} s of ${number(one.budget_s, 0)} s were recorded; ${percent(one.confidence)} are asked for.`),
      this.table('learn', `Runs of ${one.name}`, rows),
      element('div', { class: 'tools' }, ...one.pages.map(() => this.opener('Story', `Story of ${one.name}`, `/followed/${place}/story.html`))),
    ];
  }

  versions(one, place) {
    const rows = one.versions.map(version => element('tr', { 'data-row': `${place}/${version.number}`, 'data-state': version.number === one.acting ? 'acting' : null },
      element('th', { scope: 'row' }, `${version.number}${version.number === one.acting ? ' (acts)' : ''}`),
      element('td', {}, clock(version.begun)), element('td', { title: version.history.join('\n') }, version.state),
      element('td', {}, `${version.reason}${version.decided_by ? ` (${version.decided_by})` : ''}`), element('td', {}, number(version.nats, 0)),
      element('td', {}, version.promised.map(short).join(', ')), element('td', {}, version.measured.map(short).join(', ') || '–'),
      element('td', {}, ...(version.report ? [this.opener('Report', `Version ${version.number}`, `/followed/${place}/${String(version.number).padStart(4, '0')}/report.html`)] : []))));
    return [this.table('heal', `Versions of ${one.name}`, rows), ...one.waiting.map(waiting => this.question(place, waiting))];
  }

  question(place, waiting) {
    const { user } = this.page.commands;
    const button = (accept, word) => element('button', { type: 'button', class: accept ? 'primary' : null, disabled: !user, onclick: () => this.decide(place, waiting, accept) }, word);
    return element('div', { class: 'tools' }, button(true, `Accept version ${waiting}`), button(false, `Leave version ${waiting}`), ...(user ? [] : [element('span', { class: 'detail' }, 'Log in first.')]));
  }

  opener(word, title, address) {
    return element('button', { type: 'button', onclick: () => openPage('follow-viewer', title, address) }, word);
  }

  async decide(folder, waiting, accept) {
    const { commands } = this.page;
    commands.show(`version ${waiting} …`, 'waiting');
    await commands.request(`version ${waiting}`, '/api/follow/decide', { folder, number: waiting, accept }, answer => answer.command);
    await this.ask();
  }
}
