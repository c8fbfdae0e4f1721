// What the page sends: every answer of a daemon is shown, and how long it took.

import { byId, clock, say } from './text.js';

const TYPING = 'input:not([type=checkbox]), textarea, select';
const PATIENCE_MS = 8000;

async function post(path, content = {}) {
  const answer = await fetch(path, {
    method: 'POST',
    headers: { 'content-type': 'application/json' },
    body: JSON.stringify(content),
    signal: AbortSignal.timeout(PATIENCE_MS),
  });
  return answer.json();
}

function told({ device, command, ok, reason, mode }) {
  return `${(device ?? '').split('@')[0]} ${command}: ${ok ? mode : reason}`;
}

export class Commands {
  constructor() {
    this.place = byId('answer');
    byId('stop').addEventListener('click', () => this.stop());
    document.addEventListener('keydown', event => this.key(event), true);
  }

  key(event) {
    if (event.code !== 'Space' || event.target.closest(TYPING)) return;
    event.preventDefault();
    event.stopPropagation();
    if (!event.repeat) this.stop();
  }

  async stop() {
    const begun = performance.now();
    byId('stop').classList.add('sent');
    this.show('STOP sent …', 'waiting');
    try {
      const { ok, answers, reason } = await post('/api/stop');
      const lines = answers?.map(told) ?? [];
      const after = `${Math.round(performance.now() - begun)} ms`;
      this.show(lines.length ? `${lines.join(' · ')} (${after})` : reason ?? 'no device is known: nothing was sent', ok ? 'good' : 'bad');
    } catch (error) {
      this.show(`STOP: no answer from this page's server (${error.name}). Use \`hoopd disarm\` or the device's own switch.`, 'bad');
    } finally {
      byId('stop').classList.remove('sent');
    }
  }

  show(text, state) {
    say(this.place, `${clock(Date.now() / 1e3)} ${text}`);
    this.place.dataset.state = state;
  }
}
