// Light or dark: the system's choice until somebody makes another, which this browser keeps.

import { byId } from './text.js';

const KEY = 'hoopd.theme';
const ORDER = ['dark', 'light'];

export class Theme {
  constructor(changed) {
    this.changed = changed;
    this.system = matchMedia('(prefers-color-scheme: light)');
    this.system.addEventListener('change', () => this.apply());
    byId('theme').addEventListener('click', () => this.next());
    this.apply();
  }

  get shown() {
    return localStorage.getItem(KEY) ?? (this.system.matches ? 'light' : 'dark');
  }

  next() {
    localStorage.setItem(KEY, ORDER[(ORDER.indexOf(this.shown) + 1) % ORDER.length]);
    this.apply();
  }

  apply() {
    document.documentElement.dataset.theme = this.shown;
    byId('theme').textContent = this.shown === 'dark' ? 'Light' : 'Dark';
    this.changed();
  }
}
