// SPDX-License-Identifier: Apache-2.0
// The daemon as a child process, its clients, and the measurements of both.
import { spawn } from 'node:child_process';
import { once } from 'node:events';
import fs from 'node:fs';
import http from 'node:http';
import https from 'node:https';
import path from 'node:path';
import WebSocket from 'ws';

export const UPDATE_MS = 1000 / 30; // updates of a mouse drag
export const CODECS = { jpeg: 1, png: 2, vp9: 5, vp8: 7 }; // codec numbers in the frame header
const FINAL = 2; // flag in the frame header
const UNCHECKED = { rejectUnauthorized: false }; // the certificate of the daemon is created for the run
const agents = { false: new http.Agent({ keepAlive: true }), true: new https.Agent({ keepAlive: true, ...UNCHECKED }) };

export const pause = (ms) => new Promise((resolve) => { setTimeout(resolve, ms); });
export const round = (x, digits = 1) => (Number.isFinite(x) ? Number(x.toFixed(digits)) : '');
const sum = (list) => list.reduce((a, b) => a + b, 0);
export const mean = (list) => sum(list) / list.length;

/** Returns the quantile `part` of the list. */
export function share(list, part) {
  const sorted = [...list].sort((a, b) => a - b);
  return sorted[Math.min(sorted.length - 1, Math.floor(part * sorted.length))];
}

/** Returns the median; for an even count the mean of the two middle values. */
export function median(list) {
  const sorted = [...list].sort((a, b) => a - b);
  const middle = sorted.length >> 1;
  return sorted.length % 2 ? sorted[middle] : (sorted[middle - 1] + sorted[middle]) / 2;
}

const children = new Set();
process.on('exit', () => children.forEach((child) => child.kill('SIGKILL')));

/** Starts a child process that ends with this process, however this process ends. */
export function child(program, args) {
  const process = spawn(program, args, { stdio: ['ignore', 'pipe', 'pipe'] });
  children.add(process);
  process.once('close', () => children.delete(process));
  process.log = '';
  process.stderr.on('data', (data) => { process.log = (process.log + data).slice(-4000); });
  return process;
}

/** The daemon: its HTTP requests, and its memory, CPU time and descriptors from the system. */
export class Daemon {
  static async start(bin, backend, volumes, args = []) {
    const daemon = new Daemon();
    daemon.child = child(path.join(bin, 'splatd'), ['--listen', '127.0.0.1:0', '--backend', backend,
      ...volumes.flatMap((volume) => ['--volume', volume]),
      '--participants', '64', '--connections', '1024', '--connections-per-address', '1024', ...args]);
    const [line] = await Promise.race([once(daemon.child.stdout, 'data'), once(daemon.child, 'close').then(() => [''])]);
    const address = /listening on (\S+)/.exec(String(line));
    if (!address) throw new Error(`splatd does not start: ${daemon.child.log}`);
    const url = new URL(address[1]);
    await daemon.look({ port: Number(url.port), token: url.searchParams.get('token'), secure: url.protocol === 'https:' });
    return daemon;
  }

  /** Waits for the volumes and reads their default views, in the order of --volume. */
  async look(where) {
    Object.assign(this, where);
    const { volumes } = await this.ask('GET', 'volumes');
    this.views = [];
    for (const { id } of volumes) {
      let state = 'loading';
      while (state === 'loading') {
        ({ state } = await this.ask('GET', `volumes/${id}`));
        if (state === 'loading') await pause(50);
      }
      this.views.push(await this.ask('GET', `volumes/${id}/view`));
    }
    return this;
  }

  async ask(method, target, body) {
    const { headers, bytes } = await this.send(method, target.startsWith('/') ? target : `/api/v1/${target}`, body);
    return headers['content-type']?.includes('json') ? JSON.parse(bytes) : bytes;
  }

  async send(method, target, body) {
    const request = (this.secure ? https : http).request({
      host: '127.0.0.1', port: this.port, path: target, method, agent: agents[this.secure],
      headers: { Authorization: `Bearer ${this.token}`, 'Content-Type': 'application/json' },
    });
    request.end(body && JSON.stringify(body));
    const [answer] = await once(request, 'response');
    const bytes = Buffer.concat(await answer.toArray());
    if (answer.statusCode >= 400) throw new Error(`${method} ${target}: ${answer.statusCode} ${bytes}`);
    return { headers: answer.headers, bytes };
  }

  /** Requests one image after the other over kept-alive connections, `parallel` at a time, each of another view. Returns what
   * watch() returns; `wait` is the time beside rendering and encoding. */
  async loop(px, parallel, seconds) {
    const [latencies, works, cpu, begin] = [[], [], this.cpuMs(), performance.now()];
    const end = begin + 1000 * seconds;
    const [x, y, z] = this.views[0].camera.position;
    const one = async (first) => {
      for (let i = first; performance.now() < end; i += parallel) {
        const sent = performance.now();
        const view = { ...this.views[0], size: [px, px], camera: { ...this.views[0].camera, position: [x + 0.01 * i, y, z] } };
        const { headers } = await this.send('POST', '/api/v1/render?format=jpeg', view);
        latencies.push(performance.now() - sent);
        works.push(Number(headers['x-render-time']) + Number(headers['x-encode-time']));
      }
    };
    await Promise.all(Array.from({ length: parallel }, (_, i) => one(i)));
    const took = (performance.now() - begin) / 1000;
    const waits = latencies.map((ms, i) => ms - works[i]);
    return {
      clients: parallel, side: px, fps_mean: round(latencies.length / took), work_ms: round(share(works, 0.5), 2),
      wait_p50_ms: round(share(waits, 0.5), 2), wait_p95_ms: round(share(waits, 0.95), 2),
      p50_ms: round(share(latencies, 0.5)), p95_ms: round(share(latencies, 0.95)), p99_ms: round(share(latencies, 0.99)),
      cpu_share: round((this.cpuMs() - cpu) / 1000 / took, 2),
    };
  }

  /** Returns a metric without labels. */
  async gauge(name) {
    return Number(new RegExp(`^${name} (\\d+)$`, 'm').exec(await this.ask('GET', '/metrics'))[1]);
  }

  /** Ends idle keep-alive connections. */
  hangUp() {
    agents[this.secure].destroy();
  }

  session(px, view = this.views[0]) {
    return this.ask('POST', 'sessions', { view: { ...view, size: [px, px] } });
  }

  rssMib() {
    return Number(/VmRSS:\s+(\d+)/.exec(fs.readFileSync(`/proc/${this.child.pid}/status`, 'utf8'))[1]) / 1024;
  }

  files() {
    return fs.readdirSync(`/proc/${this.child.pid}/fd`).length;
  }

  cpuMs() {
    const fields = fs.readFileSync(`/proc/${this.child.pid}/stat`, 'utf8').replace(/^.*\) /, '').split(' ');
    return (Number(fields[11]) + Number(fields[12])) * 10;
  }

  async stop() {
    const ended = once(this.child, 'close');
    this.child.kill('SIGTERM');
    await ended;
  }
}

/** A stream that acknowledges each frame after `delay` ms, or never (Infinity), and records arrivals. A refusal ends the program,
 * because the measurement would not be the intended one. */
export class Client {
  static #opened = 0;
  seq = 0;
  /** The start angle of its rotation. Each client has different views, because the daemon does not render the same view twice. */
  phase = 2.4 * Client.#opened++;
  sent = new Map();

  static async open(daemon, session, { role = 'control', token = session.tokens[role], delay = 0 } = {}) {
    const client = new Client();
    client.reset();
    client.view = session.view ?? daemon.views[0];
    client.socket = new WebSocket(`ws${daemon.secure ? 's' : ''}://127.0.0.1:${daemon.port}/api/v1/sessions/${session.id}/stream?token=${token}`,
      ['splatd.v1'], { perMessageDeflate: false, ...UNCHECKED });
    client.socket.on('message', (data, isBinary) => (isBinary ? client.#take(data, delay) : client.#hear(data)));
    client.socket.on('error', () => {});
    await once(client.socket, 'open');
    return client;
  }

  #take(data, delay) {
    const frame = data.readUInt32LE(8);
    const seq = data.readUInt32LE(12);
    this.frames++;
    this.bytes += data.length;
    this.pixels += data.readUInt16LE(16) * data.readUInt16LE(18);
    this.renderUs += data.readUInt32LE(20);
    this.codecs[data[4]] = (this.codecs[data[4]] ?? 0) + 1;
    if (this.sent.has(seq)) {
      const latency = performance.now() - this.sent.get(seq);
      this.latencies.push(latency);
      this.works.push((data.readUInt32LE(20) + data.readUInt32LE(24)) / 1000);
      this.waits.push(latency - this.works.at(-1));
      for (const key of this.sent.keys()) if (key <= seq) this.sent.delete(key);
    }
    if (delay === 0) this.tell('stream.ack', { frame });
    else if (delay < Infinity) setTimeout(() => this.tell('stream.ack', { frame }), delay);
    this.onFrame?.(seq, data);
    if (data[5] & FINAL && seq === this.seq) this.onFinal?.();
  }

  #hear(data) {
    const { method, params, error } = JSON.parse(data);
    if (error || method === 'render.error') throw new Error(`the daemon answers ${data}`);
    if (method === 'stream.stats') this.coarse.push(params.coarse);
  }

  tell(method, params, id) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify({ jsonrpc: '2.0', id, method, params }));
  }

  configure(params) {
    this.tell('stream.configure', params, 'configure');
  }

  update(patch) {
    this.sent.set(++this.seq, performance.now());
    this.tell('view.update', { seq: this.seq, patch }, this.seq);
  }

  /** Rotates the camera by one step. */
  turn() {
    const [x, y, z] = this.view.camera.position;
    const [tx, ty, tz] = this.view.camera.target;
    const angle = this.phase + (this.seq + 1) * 0.02;
    const [dx, dz] = [x - tx, z - tz];
    const position = [tx + dx * Math.cos(angle) - dz * Math.sin(angle), y, tz + dx * Math.sin(angle) + dz * Math.cos(angle)];
    this.update({ camera: { position, target: [tx, ty, tz] } });
  }

  /** Moves a point of the transfer function by one step, as an editor does. */
  edit() {
    const { points } = this.view.transfer_function;
    const middle = points.length >> 1;
    const factor = 0.75 + 0.25 * Math.sin(this.phase + (this.seq + 1) * 0.1);
    this.update({ transfer_function: { points: points.map((point, i) => (i === middle ? { ...point, opacity: point.opacity * factor } : point)) } });
  }

  /** Repeats an action; by default it rotates the camera. Timers have a resolution of 1 ms, so each one runs to the next multiple
   * of the period. */
  drive(period = UPDATE_MS, step = () => this.turn()) {
    let due = performance.now();
    const repeat = () => {
      due = Math.max(due + period, performance.now() - period);
      this.timer = setTimeout(repeat, due - performance.now());
      step();
    };
    this.timer = setTimeout(repeat, period);
  }

  /** Rotates the camera whenever a frame of the last change arrives. */
  lockstep() {
    this.onFrame = (seq) => seq === this.seq && this.turn();
    this.turn();
  }

  reset() {
    Object.assign(this, { frames: 0, bytes: 0, pixels: 0, renderUs: 0, codecs: {}, coarse: [], latencies: [], works: [], waits: [] });
  }

  end() {
    clearTimeout(this.timer);
    this.socket.terminate();
  }
}

/** Measures what `clients` receive in `seconds`, after a warm-up. */
export async function watch(daemon, clients, seconds, warm = Math.min(1, seconds)) {
  await pause(1000 * warm);
  clients.forEach((client) => client.reset());
  const cpu = daemon.cpuMs();
  const begin = performance.now();
  await pause(1000 * seconds);
  const took = (performance.now() - begin) / 1000;
  const spent = daemon.cpuMs() - cpu;
  const total = (what) => sum(clients.map((client) => client[what]));
  const fps = clients.map((client) => client.frames / took);
  const all = (what) => clients.flatMap((client) => client[what]);
  const [latencies, works, waits] = ['latencies', 'works', 'waits'].map(all);
  return {
    clients: clients.length, side: round(Math.sqrt(total('pixels') / total('frames')), 0), coarse: round(mean(clients.flatMap((c) => c.coarse)), 2),
    fps_min: round(Math.min(...fps)), fps_mean: round(mean(fps)),
    work_ms: round(share(works, 0.5)), wait_p50_ms: round(share(waits, 0.5)), wait_p95_ms: round(share(waits, 0.95)),
    p50_ms: round(share(latencies, 0.5)), p95_ms: round(share(latencies, 0.95)), p99_ms: round(share(latencies, 0.99)),
    kbytes_frame: round(total('bytes') / total('frames') / 1000), rss_mib: round(daemon.rssMib()),
    cpu_share: round(spent / 1000 / took, 2), cpu_ms_frame: round(spent / total('frames'), 2), render_share: round(total('renderUs') / 1e6 / took, 3),
  };
}
