// The way to the server: one WebSocket that is opened again for as long as the page lives, and the history of a device.

import { Device } from './store.js';

const SILENCE_MS = 3000; // the server says something every second
const PAUSES_MS = [250, 500, 1000, 2000];

export class Link {
  constructor(changed) {
    this.devices = new Map();
    this.endpoints = {};
    this.audit = [];
    this.open = false;
    this.now = 0; // the server's clock at its last word, s
    this.behind = 0; // ours against it, s
    this.changed = changed;
    this.failures = 0;
    this.connect();
    setInterval(() => this.watch(), 500);
  }

  connect() {
    const scheme = location.protocol === 'https:' ? 'wss' : 'ws';
    const socket = this.socket = new WebSocket(`${scheme}://${location.host}/api/live`);
    this.heard = performance.now();
    socket.onmessage = event => this.take(JSON.parse(event.data));
    socket.onclose = () => this.lost(socket);
  }

  take(frame) {
    this.heard = performance.now();
    if (!this.open) {
      this.open = true;
      this.failures = 0;
      // Another server may count anew: begin with its history.
      for (const device of this.devices.values()) this.begin(device);
    }
    if (frame.now) [this.now, this.behind] = [frame.now, Date.now() / 1e3 - frame.now];
    if (frame.audit) this.audit = frame.audit;
    if (frame.endpoints) this.endpoints = frame.endpoints;
    for (const [identity, news] of Object.entries(frame.devices)) {
      if (!this.devices.has(identity)) {
        this.devices.set(identity, new Device(identity));
        this.begin(this.devices.get(identity));
      }
      this.devices.get(identity).take(news);
    }
    this.changed();
  }

  async begin(device) {
    device.ready = false;
    const socket = this.socket;
    try {
      const answer = await fetch(`/api/history?device=${encodeURIComponent(device.identity)}`);
      if (answer.ok) device.load(await answer.arrayBuffer());
      else if (answer.status === 404) this.devices.delete(device.identity);
    } catch {
      // the server is gone: `lost` tries again
    }
    if (!device.ready && this.socket === socket && this.open) setTimeout(() => this.begin(device), 1000);
  }

  lost(socket) {
    if (socket !== this.socket) return;
    this.open = false;
    this.socket = null;
    this.changed();
    setTimeout(() => this.connect(), PAUSES_MS[Math.min(this.failures, PAUSES_MS.length - 1)]);
    this.failures += 1;
  }

  watch() {
    const socket = this.socket;
    if (!socket || performance.now() - this.heard < SILENCE_MS) return;
    socket.onclose = null;
    socket.close();
    this.lost(socket);
  }

  /** The server's clock, s. */
  clock() {
    return Date.now() / 1e3 - this.behind;
  }
}
