// What the page sends: STOP for everybody, the rest for who is logged in. Every answer of a daemon is shown, and how long
// it took.

import { byId, clock, inClicks, number, say } from './text.js';

const TYPING = 'input:not([type=checkbox]), textarea, select';
const PATIENCE_MS = 8000;
const LOADS_MS = 25000; // a file is read, checked, made ready and watched first
const LOADS = ['controller', 'trial', 'experiment'];
const ASK_MS = 20000; // whether the login still lasts

const told = ({ device, command, ok, reason, mode, reference, key, value }) =>
  `${(device ?? '').split('@')[0]} ${command}${key ? ` ${key} ${value}` : ''}: ${ok ? `${mode}${command === 'reference' ? `, reference ${number(reference, 3, true)} rad` : ''}` : `${reason}`.replace(`${command}: `, '')}`;

export class Commands {
  constructor(chosen) {
    Object.assign(this, { chosen, user: null, proof: '', possible: false, turn: 0 });
    byId('stop').addEventListener('click', () => this.stop());
    document.addEventListener('keydown', event => this.key(event), true);
    for (const button of byId('drive').querySelectorAll('button')) {
      button.addEventListener('click', () => this.send(button.dataset.command));
    }
    byId('login').addEventListener('click', () => (this.user ? this.logout() : this.ask()));
    byId('credentials-away').addEventListener('click', () => byId('credentials').close());
    byId('credentials-form').addEventListener('submit', event => this.login(event));
    this.who();
    setInterval(() => this.who(), ASK_MS);
  }

  key(event) {
    if (event.key === 'Escape' && byId('credentials').open) byId('credentials').close();
    if (event.code !== 'Space' || event.target.closest?.(TYPING)) return;
    event.preventDefault();
    event.stopPropagation();
    if (!event.repeat) this.stop();
  }

  /** Content of an answer, whatever its status; a login that is over is noticed. */
  async post(path, content = {}, patience = PATIENCE_MS) {
    const answer = await fetch(path, {
      method: 'POST',
      headers: { 'content-type': 'application/json', 'x-hoopd-proof': this.proof },
      body: JSON.stringify(content),
      signal: AbortSignal.timeout(patience),
    });
    if (answer.status === 401 && this.user) this.be(null);
    return answer.json();
  }

  /** Something that this page's server is asked to do; its answer stands beside STOP, in `words` where it was done. */
  async request(what, path, content, words, patience = PATIENCE_MS) {
    try {
      const answer = await this.post(path, content, patience);
      this.show(answer.ok ? words(answer) : `${what}: ${answer.reason}`, answer.ok ? 'good' : 'bad');
      return answer;
    } catch (error) {
      this.show(`${what}: no answer from this page’s server (${error.name})`, 'bad');
      return { ok: false, reason: 'no answer' };
    }
  }

  async stop() {
    const begun = performance.now();
    byId('stop').classList.add('sent');
    this.show('STOP sent …', 'waiting');
    try {
      const { ok, answers, reason } = await this.post('/api/stop');
      const lines = answers?.map(told) ?? [];
      const after = `${Math.round(performance.now() - begun)} ms`;
      this.show(lines.length ? `${lines.join(' · ')} (${after})` : reason ?? 'no device is known: nothing was sent', ok ? 'good' : 'bad');
    } catch (error) {
      this.show(`STOP: no answer from this page’s server (${error.name}). Use “hoopd disarm” or the device’s own switch.`, 'bad');
    } finally {
      byId('stop').classList.remove('sent');
    }
  }

  /** A command to the chosen device; true when it was obeyed. */
  async send(command, value = null, key = '') {
    const begun = performance.now(), device = this.chosen()?.identity;
    if (!this.user || !device) {
      this.show(`${command}: ${device ? 'nobody is logged in' : 'no device is chosen'}: nothing was sent`, 'bad');
      return false;
    }
    this.show(`${command} sent …`, 'waiting');
    try {
      const answer = await this.post('/api/command', { device, command, value, key }, LOADS.includes(command) ? LOADS_MS : PATIENCE_MS);
      this.show(`${told({ device, command, ...answer })} (${Math.round(performance.now() - begun)} ms)`, answer.ok ? 'good' : 'bad');
      return answer.ok;
    } catch (error) {
      this.show(`${command}: no answer from this page’s server (${error.name})`, 'bad');
      return false;
    }
  }

  show(text, state) {
    say(byId('answer'), `${clock(Date.now() / 1e3)} ${inClicks(text)}`);
    byId('answer').dataset.state = state;
  }

  // ---- login

  async who() {
    const { turn } = this;
    try {
      const { possible, user, proof } = await (await fetch('/api/me')).json();
      if (turn !== this.turn) return; // asked before somebody logged in or out
      this.possible = possible;
      if (this.user && !user) this.show('the login is over: log in again to drive', 'bad');
      this.be(user, proof);
    } catch {
      // the server is gone; the link says so
    }
  }

  be(user, proof = '') {
    Object.assign(this, { user, proof });
    byId('login').hidden = !this.possible;
    say(byId('login'), user ? 'Log out' : 'Log in');
    byId('who').hidden = !user;
    say(byId('who'), user ?? '');
    document.body.classList.toggle('may-drive', Boolean(user));
    for (const button of byId('drive').querySelectorAll('button')) button.disabled = !user;
    say(byId('drive-hint'), user ? '' : this.possible ? 'Log in to drive.' : 'To look only: no daemon here takes commands over zenoh (telemetry.control).');
  }

  /** Beside the page, not over it: STOP stays within reach. */
  ask() {
    say(byId('credentials-wrong'), '');
    byId('credentials').show();
    byId('credentials-form').elements.user.focus();
  }

  async login(event) {
    event.preventDefault();
    const form = byId('credentials-form'), { user, password } = form.elements;
    try {
      const answer = await this.post('/api/login', { user: user.value, password: password.value });
      if (answer.ok) {
        form.reset();
        byId('credentials').close();
        this.turn += 1;
        this.be(answer.user, answer.proof);
        return;
      }
      say(byId('credentials-wrong'), answer.reason);
    } catch (error) {
      say(byId('credentials-wrong'), `no answer from this page’s server (${error.name})`);
    }
    password.value = '';
    password.focus();
  }

  async logout() {
    await this.post('/api/logout').catch(() => null);
    this.turn += 1;
    this.be(null);
  }
}
