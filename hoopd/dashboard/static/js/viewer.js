// A page of results inside this one: a panel with a title, a link and a frame, whose names begin alike.

import { byId, say } from './text.js';

export function openPage(panel, title, address) {
  byId(panel).hidden = false;
  say(byId(`${panel}-title`), title);
  byId(`${panel}-link`).href = address;
  byId(`${panel}-frame`).src = address;
  byId(panel).scrollIntoView({ behavior: 'smooth', block: 'start' });
}

export function closePage(panel) {
  byId(panel).hidden = true;
  byId(`${panel}-frame`).src = 'about:blank';
}
