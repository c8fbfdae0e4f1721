// The page: what comes over the link is shown, ten times a second or as often as the screen likes.

import { Calibrate } from './calibrate.js';
import { Charts } from './charts.js';
import { Commands } from './commands.js';
import { Compare } from './compare.js';
import { Controller } from './controller.js';
import { Experiment } from './experiment.js';
import { Follow } from './follow.js';
import { Guide } from './guide.js';
import { Hoop } from './hoop.js';
import { Joystick } from './joystick.js';
import { Link } from './link.js';
import { ModeLine } from './modes.js';
import { Panels } from './panels.js';
import { Picture } from './picture.js';
import { Target } from './target.js';
import { byId, element, renew, say } from './text.js';
import { Theme } from './theme.js';
import { Views } from './views.js';
import { Work } from './work.js';

const STALE_S = 1.5; // without a message: what is shown is old
const PANELS_MS = 200; // text that changes faster cannot be read

class Page {
  constructor(channels) {
    this.views = new Views();
    this.hoop = new Hoop(byId('rig'));
    this.panels = new Panels();
    this.charts = new Charts(byId('tools'), byId('charts'), channels);
    this.theme = new Theme(() => this.charts.recolour());
    this.commands = new Commands(() => this.device);
    this.target = new Target(this.hoop, this);
    this.joystick = new Joystick(this);
    this.picture = new Picture(() => this.device);
    this.controller = new Controller(byId('controller'), this);
    this.calibrate = new Calibrate(() => this.device, path => this.commands.post(path));
    this.work = new Work(this.commands, () => this.views.shown === 'work');
    this.experiment = new Experiment(byId('experiment'), this);
    this.follow = new Follow(this);
    this.modeLine = new ModeLine(byId('mode-line'), this);
    this.compare = new Compare(byId('compare'), this);
    this.tabs = '';
    this.textAt = 0;
    this.dirty = true;
    this.link = new Link(() => { this.dirty = true; });
    this.guide = new Guide(this);
    document.addEventListener('keydown', event => this.key(event));
    byId('help').addEventListener('click', () => this.help());
    const draw = now => { this.draw(now); requestAnimationFrame(draw); };
    requestAnimationFrame(draw);
  }

  get device() {
    const { devices } = this.link;
    return devices.get(this.views.device) ?? devices.values().next().value;
  }

  stale(device) {
    return !this.link.open || !device.state.alive || this.link.clock() - device.last('wall') > STALE_S;
  }

  draw(now) {
    const { device } = this;
    if (now - this.textAt >= PANELS_MS) {
      this.textAt = now;
      this.showLink(device);
      this.showTabs(device);
      this.panels.showAudit(this.link.audit);
      if (device) this.panels.show(device, this.stale(device));
      if (device) this.controller.show(device);
      if (device) this.joystick.show(device);
      this.modeLine.show(device, device && this.stale(device));
      this.compare.show(device);
      this.experiment.show(device);
      if (device) this.target.describe(device.last('reference'));
    }
    if (!device || this.views.shown !== 'drive') return;
    if (this.dirty) this.hoop.show(device, this.stale(device));
    this.charts.draw(device, now, this.link.clock());
    this.dirty = false;
  }

  showLink(device) {
    const { link } = this, place = byId('link');
    const lost = Object.entries(link.endpoints).filter(([, trouble]) => trouble);
    const stale = device && this.stale(device);
    const state = !link.open ? 'lost' : !device || stale || lost.length ? 'waiting' : 'live';
    say(place, { lost: 'page offline', waiting: 'waiting', live: 'live' }[state]);
    place.dataset.state = state;
    const notice = !link.open
      ? 'The page’s server does not answer: nothing here is new. It is asked again.'
      : lost.map(([endpoint, trouble]) => `${endpoint}: ${trouble}. It is asked again.`).join(' ')
        || (stale ? `${device.state.name}: the daemon is ${device.state.alive ? 'silent' : 'gone'}. The page waits for it.` : '')
        || (device ? '' : 'Connected; no device has told anything yet.');
    byId('notice').hidden = !notice;
    say(byId('notice'), notice);
  }

  showTabs(device) {
    const all = [...this.link.devices.values()];
    const names = all.map(one => one.state.name);
    const shown = JSON.stringify([device?.identity, all.map(one => [one.identity, one.word('mode'), this.stale(one)])]);
    if (shown === this.tabs) return;
    this.tabs = shown;
    renew(byId('devices'), () => all.map((one, place) => element('button', {
      type: 'button', 'aria-pressed': String(one === device), 'data-row': one.identity, title: `${one.state.endpoint} (${place + 1})`,
      onclick: () => this.choose(one),
    }, element('b', {}, names.indexOf(one.state.name) === names.lastIndexOf(one.state.name) ? one.state.name : one.identity),
    element('span', { 'data-mode': this.stale(one) ? 'stale' : one.word('mode') }, this.stale(one) ? 'gone' : one.word('mode')))));
    document.title = device ? `${device.state.name} ${this.stale(device) ? 'gone' : device.word('mode')} · hoopd` : 'hoopd';
  }

  choose(device) {
    this.views.keep(device.identity);
    this.dirty = true;
    this.textAt = 0;
  }

  help() {
    const hidden = !byId('keys').hidden;
    byId('keys').hidden = hidden;
    byId('help').setAttribute('aria-expanded', String(!hidden));
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest('input, textarea, select')) return;
    const device = [...this.link.devices.values()][Number(event.key) - 1];
    if (device) this.choose(device);
    else if (event.key === 't') this.theme.next();
    else if (event.key === '?') this.help();
    else if (this.views.shown !== 'drive' || !this.charts.key(event.key)) return;
    event.preventDefault();
  }
}

const answer = await fetch('/api/channels');
window.page = new Page(await answer.json());
