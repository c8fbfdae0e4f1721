// A calibration proposed from the live picture: values beside those in force, and the text for the configuration.

import { byId, element, number, say } from './text.js';

const DECIMALS = { rad: 4, px: 1, grey: 0 };

export class Calibrate {
  /** `chosen` gives the device that is shown; `post` asks the server. */
  constructor(chosen, post) {
    byId('calibrate').addEventListener('click', async () => {
      const device = chosen()?.identity;
      if (!device) return;
      byId('calibrate').disabled = true;
      say(byId('calibrate-text'), 'looking …');
      try {
        this.show(await post(`/api/calibration?device=${encodeURIComponent(device)}`));
      } catch (error) {
        this.show({ ok: false, reason: `no answer from this page’s server (${error.name})` });
      } finally {
        byId('calibrate').disabled = false;
      }
    });
  }

  show(answer) {
    byId('calibrate-proposal').hidden = !answer.ok;
    if (!answer.ok) return say(byId('calibrate-text'), `No proposal: ${answer.reason}`);
    const bad = answer.rows.filter(row => !row.good);
    say(byId('calibrate-text'), [bad.length ? `Doubtful: ${[...new Set(bad.map(row => row.name))].join(', ')}.` : 'Good in every value.', ...answer.notes].join(' '));
    byId('calibrate-rows').replaceChildren(...answer.rows.map(({ name, unit, proposed, now, good, why }) => {
      const digits = DECIMALS[unit] ?? 2;
      return element('tr', {}, element('th', { scope: 'row' }, `${name}, ${unit}`), element('td', {}, number(proposed, digits)),
        element('td', {}, number(proposed - now, digits, true)), element('td', { 'data-good': String(good) }, `${good ? 'good' : 'doubtful'}: ${why}`));
    }));
    say(byId('calibrate-section'), answer.text);
  }
}
