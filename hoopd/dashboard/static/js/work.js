// The bench: recordings and jobs, asked for while somebody looks at them.

import { Jobs } from './jobs.js';
import { Recordings } from './recordings.js';
import { byId, element, say } from './text.js';
import { closePage, openPage } from './viewer.js';

const ASK_MS = 1500;

export class Work {
  constructor(commands, seen) {
    Object.assign(this, { commands, seen, asking: false, steps: () => [] });
    this.recordings = new Recordings(this);
    this.jobs = new Jobs(this);
    addEventListener('view', () => this.ask());
    setInterval(() => this.ask(), ASK_MS);
    byId('viewer-away').addEventListener('click', () => this.close());
    this.ask();
  }

  async ask() {
    if (this.asking || !this.seen() || document.hidden) return;
    this.asking = true;
    try {
      this.show(await (await fetch('/api/work')).json());
    } catch {
      // the server is gone; the link says so
    } finally {
      this.asking = false;
    }
  }

  show(told) {
    byId('no-bench').hidden = told.offered;
    for (const part of document.querySelectorAll('[data-bench]')) part.hidden = !told.offered;
    if (!told.offered) {
      say(byId('no-bench'), `Recordings and jobs: ${told.reason}.`);
      return;
    }
    this.told = told;
    this.recordings.show(told.recordings);
    this.jobs.show(told);
  }

  /** Something is changed for who is logged in; the answer is shown beside STOP. What was made when it was done, else false. */
  async change(what, path, content) {
    const done = ({ queued, value }) => `${what}: ${queued ? `waits as job ${value}` : 'done'}`;
    const answer = await this.commands.request(what, `/api/work/${path}`, content, done);
    await this.ask();
    return answer.ok && (answer.value ?? true);
  }

  /** A page of results, inside this one; `steps`: makes buttons that do what its commands would. */
  open(title, address, steps = () => []) {
    Object.assign(this, { steps, shown: null });
    this.renew();
    openPage('viewer', title, address);
  }

  /** The buttons above the page that is open, as job and login are now. */
  renew() {
    const steps = this.steps(), shown = steps.map(step => step.outerHTML).join();
    if (shown === this.shown) return; // the focus stays where it is
    this.shown = shown;
    byId('viewer-steps').replaceChildren(...(steps.length ? [element('span', { class: 'detail' }, 'What the report asks for by a command is a click here:'), ...steps] : []));
  }

  close() {
    this.steps = () => [];
    closePage('viewer');
  }
}
