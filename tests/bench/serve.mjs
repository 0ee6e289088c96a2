#!/usr/bin/env node
// SPDX-License-Identifier: Apache-2.0
// What the daemon costs and who disturbs whom: users on this machine, memory a user, overhead without rendering,
// clients of every temper, connections that do nothing, hours of coming and going.
//
//   node tests/bench/serve.mjs [--bin DIR] [--only PARTS] [--seconds N] [--minutes N] [--volume V] [--out FILE.csv]
//
// The clients share the machine with the daemon, and their work is in every figure. One line a measurement:
//   part, clients, size, fps_min, fps_mean, p50_ms, p95_ms, p99_ms, kbytes_frame, rss_mib, cpu_share, note
import { execFileSync, spawn } from 'node:child_process';
import { once } from 'node:events';
import fs from 'node:fs';
import net from 'node:net';
import os from 'node:os';
import path from 'node:path';
import tls from 'node:tls';
import { parseArgs } from 'node:util';
import WebSocket from 'ws';

const PARTS = ['overhead', 'viewers', 'sessions', 'memory', 'fairness', 'idle', 'soak'];
const COLUMNS = ['part', 'clients', 'size', 'fps_min', 'fps_mean', 'p50_ms', 'p95_ms', 'p99_ms', 'kbytes_frame', 'rss_mib',
  'cpu_share', 'note'];
const UPDATE_MS = 1000 / 30; // a hand on the mouse
const { values: options } = parseArgs({
  options: {
    bin: { type: 'string', default: 'build/release/bin' },
    only: { type: 'string', default: PARTS.slice(0, -1).join(',') },
    seconds: { type: 'string', default: '5' },
    minutes: { type: 'string', default: '20' },
    volume: { type: 'string', default: 'demo:engine?size=128' },
    out: { type: 'string' },
    disturb: { type: 'string' }, // this process is a client of that temper
    port: { type: 'string' },
    token: { type: 'string' },
    secure: { type: 'boolean' },
    help: { type: 'boolean' },
  },
});
const seconds = Number(options.seconds);
const pause = (ms) => new Promise((resolve) => { setTimeout(resolve, ms); });
const rows = [];
process.env.NODE_TLS_REJECT_UNAUTHORIZED = '0'; // the daemon's certificate is made for the run

function note(row) {
  rows.push(row);
  const text = COLUMNS.filter((c) => row[c] !== undefined && c !== 'part').map((c) => `${c} ${row[c]}`).join('  ');
  process.stdout.write(`${row.part}: ${text}\n`);
}

const round = (x, digits = 1) => (Number.isFinite(x) ? Number(x.toFixed(digits)) : '');
const mean = (list) => list.reduce((a, b) => a + b, 0) / list.length;

function share(list, part) {
  const sorted = [...list].sort((a, b) => a - b);
  return sorted[Math.min(sorted.length - 1, Math.floor(part * sorted.length))];
}

/** The daemon as a child, and what the system says of it. */
class Daemon {
  static async start(backend, args = []) {
    const daemon = new Daemon();
    daemon.child = spawn(path.join(options.bin, 'splatd'), ['--listen', '127.0.0.1:0', '--backend', backend, '--volume', options.volume,
      '--participants', '64', '--connections', '1024', '--connections-per-address', '1024', ...args], { stdio: ['ignore', 'pipe', 'pipe'] });
    let log = '';
    daemon.child.stderr.on('data', (data) => { log = (log + data).slice(-4000); });
    const [line] = await Promise.race([once(daemon.child.stdout, 'data'), once(daemon.child, 'close').then(() => [''])]);
    const address = /listening on (\S+)/.exec(String(line));
    if (!address) throw new Error(`splatd does not start: ${log}`);
    const url = new URL(address[1]);
    daemon.port = Number(url.port);
    daemon.token = url.searchParams.get('token');
    daemon.secure = url.protocol === 'https:';
    await daemon.look();
    return daemon;
  }

  /** Waits for its volume, and takes its view. */
  async look() {
    const { volumes } = await this.ask('GET', 'volumes');
    this.volume = volumes[0].id;
    while ((await this.ask('GET', `volumes/${this.volume}`)).state === 'loading') await pause(50);
    this.view = await this.ask('GET', `volumes/${this.volume}/view`);
  }

  async ask(method, target, body) {
    const answer = await fetch(`http${this.secure ? 's' : ''}://127.0.0.1:${this.port}${target.startsWith('/') ? '' : '/api/v1/'}${target}`, {
      method, body: body && JSON.stringify(body), headers: { Authorization: `Bearer ${this.token}`, 'Content-Type': 'application/json' },
    });
    const text = await answer.text();
    return answer.headers.get('content-type')?.includes('json') ? JSON.parse(text) : text;
  }

  async gauge(name) {
    return Number(new RegExp(`^${name} (\\d+)$`, 'm').exec(await this.ask('GET', '/metrics'))[1]);
  }

  session(size) {
    return this.ask('POST', 'sessions', { view: { ...this.view, size: [size, size] } });
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

/** A stream that acknowledges each frame after `delay` ms, or never (Infinity), and notes what came when. */
class Client {
  frames = 0;
  bytes = 0;
  seq = 0;
  sent = new Map();
  latencies = [];

  static async open(daemon, session, { role = 'control', delay = 0 } = {}) {
    const client = new Client();
    client.view = session.view ?? daemon.view;
    client.socket = new WebSocket(`ws${daemon.secure ? 's' : ''}://127.0.0.1:${daemon.port}/api/v1/sessions/${session.id}/stream?token=${session.tokens[role]}`,
      ['splatd.v1'], { perMessageDeflate: false });
    client.socket.on('message', (data, isBinary) => isBinary && client.#take(data, delay));
    client.socket.on('error', () => {});
    await once(client.socket, 'open');
    return client;
  }

  #take(data, delay) {
    const now = performance.now();
    const frame = data.readUInt32LE(8);
    const seq = data.readUInt32LE(12);
    this.frames++;
    this.bytes += data.length;
    if (this.sent.has(seq)) {
      this.latencies.push(now - this.sent.get(seq));
      for (const key of this.sent.keys()) if (key <= seq) this.sent.delete(key);
    }
    this.onFrame?.();
    if (delay === 0) this.#ack(frame);
    else if (delay < Infinity) setTimeout(() => this.#ack(frame), delay);
  }

  #ack(frame) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(`{"jsonrpc":"2.0","method":"stream.ack","params":{"frame":${frame}}}`);
  }

  /** Turns the camera a step further. */
  update() {
    const [x, y, z] = this.view.camera.position;
    const [tx, ty, tz] = this.view.camera.target;
    const angle = (++this.seq) * 0.02;
    const [dx, dz] = [x - tx, z - tz];
    const position = [tx + dx * Math.cos(angle) - dz * Math.sin(angle), y, tz + dx * Math.sin(angle) + dz * Math.cos(angle)];
    this.sent.set(this.seq, performance.now());
    this.socket.send(JSON.stringify({
      jsonrpc: '2.0', id: this.seq, method: 'view.update', params: { seq: this.seq, patch: { camera: { position, target: [tx, ty, tz] } } },
    }));
  }

  configure(params) {
    this.socket.send(JSON.stringify({ jsonrpc: '2.0', id: 'configure', method: 'stream.configure', params }));
  }

  drive(period = UPDATE_MS) {
    this.timer = setInterval(() => this.socket.readyState === WebSocket.OPEN && this.update(), period);
  }

  reset() {
    Object.assign(this, { frames: 0, bytes: 0, latencies: [] });
  }

  end() {
    clearInterval(this.timer);
    this.socket.terminate();
  }
}

/** Runs for the wanted time after a second of warming up, and sums up what `clients` saw. */
async function watch(daemon, clients, time = seconds) {
  await pause(1000);
  clients.forEach((client) => client.reset());
  const cpu = daemon.cpuMs();
  const begin = performance.now();
  await pause(1000 * time);
  const took = (performance.now() - begin) / 1000;
  const fps = clients.map((client) => client.frames / took);
  const latencies = clients.flatMap((client) => client.latencies);
  return {
    fps_min: round(Math.min(...fps)), fps_mean: round(mean(fps)),
    p50_ms: round(share(latencies, 0.5)), p95_ms: round(share(latencies, 0.95)), p99_ms: round(share(latencies, 0.99)),
    kbytes_frame: round(clients.reduce((sum, c) => sum + c.bytes, 0) / Math.max(1, clients.reduce((sum, c) => sum + c.frames, 0)) / 1000),
    rss_mib: round(daemon.rssMib()), cpu_share: round((daemon.cpuMs() - cpu) / 1000 / took, 2),
  };
}

/** Twenty changes a second, one by one; nothing is rendered. */
async function overhead() {
  for (const size of [512, 1024]) {
    const daemon = await Daemon.start('null');
    const client = await Client.open(daemon, await daemon.session(size));
    client.configure({ max_fps: 120 });
    client.drive(50);
    note({ part: 'overhead', clients: 1, size, ...await watch(daemon, [client]), note: 'null backend; change to picture' });
    client.end();
    await daemon.stop();
  }
}

async function viewers() {
  for (const n of [1, 2, 4, 8, 16, 32, 63]) {
    const daemon = await Daemon.start('auto');
    const session = await daemon.session(512);
    const driver = await Client.open(daemon, session);
    const clients = [];
    for (let i = 0; i < n; i++) clients.push(await Client.open(daemon, session, { role: 'view' }));
    driver.drive();
    note({ part: 'viewers', clients: n, size: 512, ...await watch(daemon, clients), note: 'of one shared view, which a further client turns' });
    [driver, ...clients].forEach((client) => client.end());
    await daemon.stop();
  }
}

async function sessions() {
  for (const n of [1, 2, 4, 8, 16]) {
    const daemon = await Daemon.start('auto');
    const clients = [];
    for (let i = 0; i < n; i++) clients.push(await Client.open(daemon, await daemon.session(512)));
    clients.forEach((client) => client.drive());
    note({ part: 'sessions', clients: n, size: 512, ...await watch(daemon, clients), note: 'each turns its own view' });
    clients.forEach((client) => client.end());
    await daemon.stop();
  }
}

/** What one more costs: the slope from 8 to 40. */
async function memory() {
  for (const kind of ['viewer', 'session']) {
    const daemon = await Daemon.start('auto', ['--rest-time', '60']);
    const session = await daemon.session(512);
    const clients = [];
    const add = async () => {
      const of = kind === 'viewer' ? session : await daemon.session(512);
      clients.push(await Client.open(daemon, of));
      clients.at(-1).drive(200);
    };
    const measured = [];
    for (const n of [8, 40]) {
      while (clients.length < n) await add();
      await pause(1000 * seconds);
      measured.push(daemon.rssMib());
    }
    note({ part: 'memory', clients: 40, size: 512, rss_mib: round(measured[1]), note: `${round((measured[1] - measured[0]) / 32, 2)} MiB a ${kind}` });
    clients.forEach((client) => client.end());
    await daemon.stop();
  }
}

/** Clients of ill temper, each in a process of its own: what they do to the daemon counts, not what they do to this one. */
const disturbers = {
  slow: async (daemon) => (await Client.open(daemon, await daemon.session(512), { delay: 500 })).drive(),
  stalled: async (daemon) => {
    const client = await Client.open(daemon, await daemon.session(512), { delay: Infinity });
    client.drive();
    client.socket._socket.pause();
  },
  greedy: async (daemon) => { // wants nothing but large final pictures, of a view that it turns without end
    const client = await Client.open(daemon, await daemon.session(4096));
    client.configure({ progressive: false, size: [4096, 4096], quality: 100, max_fps: 60 });
    client.drive();
  },
  'flooding with messages': async (daemon) => {
    const client = await Client.open(daemon, await daemon.session(512), { delay: Infinity });
    const send = () => {
      while (client.socket.bufferedAmount < 1e6) client.update();
      setImmediate(send);
    };
    send();
  },
  'flooding with requests': async (daemon) => {
    for (let i = 0; i < 4; i++) (async () => { for (;;) await daemon.ask('GET', 'volumes').catch(() => pause(10)); })();
  },
  'flooding with pictures': async (daemon) => {
    for (let i = 0; i < 4; i++) (async () => { for (;;) await daemon.ask('POST', 'render', daemon.view).catch(() => pause(10)); })();
  },
};

/** The first message of a TLS client. */
async function greeting() {
  const server = net.createServer().listen(0, '127.0.0.1');
  await once(server, 'listening');
  const client = tls.connect({ port: server.address().port, host: '127.0.0.1', ecdhCurve: 'P-256' }).on('error', () => {});
  const [socket] = await once(server, 'connection');
  const [hello] = await once(socket, 'data');
  [client, socket, server].forEach((one) => (one.destroy ?? one.close).call(one));
  return hello;
}

/** Costs whoever does it next to nothing, and the daemon a signature each time. */
const secureDisturbers = {
  'beginning TLS handshakes': async (daemon) => {
    const hello = await greeting();
    const begin = () => {
      const socket = net.connect(daemon.port, '127.0.0.1', () => socket.write(hello));
      socket.on('error', () => {}).on('close', begin).once('data', () => socket.resetAndDestroy());
    };
    for (let i = 0; i < 64; i++) begin();
  },
};

async function disturb(kind) {
  const daemon = Object.assign(new Daemon(), { port: Number(options.port), token: options.token, secure: options.secure });
  await daemon.look();
  await { ...disturbers, ...secureDisturbers }[kind](daemon);
  process.stdout.write('at work\n');
}

/** One client at work, alone and beside others that are slow, stalled, greedy or flooding. The machine has moods: each is compared with
 * the time alone just before and just after. */
async function fairness() {
  await fairBeside(disturbers, []);
  const folder = fs.mkdtempSync(path.join(os.tmpdir(), 'splat-serve-'));
  const [cert, key] = ['cert.pem', 'key.pem'].map((name) => path.join(folder, name));
  execFileSync('openssl', ['req', '-x509', '-newkey', 'rsa:2048', '-nodes', '-days', '2', '-subj', '/CN=bench', '-keyout', key, '-out', cert],
    { stdio: 'ignore' });
  await fairBeside(secureDisturbers, ['--tls-cert', cert, '--tls-key', key]);
  fs.rmSync(folder, { recursive: true });
}

async function fairBeside(kinds, args) {
  const daemon = await Daemon.start('auto', ['--stall-time', '3600', ...args]);
  const fast = await Client.open(daemon, await daemon.session(512));
  fast.drive();
  let before = await watch(daemon, [fast]);
  note({ part: 'fairness', clients: 1, size: 512, ...before, note: `alone${daemon.secure ? ', by TLS' : ''}` });
  for (const kind of Object.keys(kinds)) {
    const other = spawn(process.execPath, [process.argv[1], '--disturb', kind, '--port', String(daemon.port), '--token', daemon.token,
      ...(daemon.secure ? ['--secure'] : [])],
      { stdio: ['ignore', 'pipe', 'inherit'] });
    await once(other.stdout, 'data');
    const beside = await watch(daemon, [fast]);
    other.kill();
    await once(other, 'close');
    const after = await watch(daemon, [fast]);
    const change = 100 * (2 * beside.fps_mean / (before.fps_mean + after.fps_mean) - 1);
    note({ part: 'fairness', clients: 2, size: 512, ...beside,
      note: `beside one that is ${kind}: ${change < 0 ? '' : '+'}${round(change)} %; alone ${before.fps_mean} before, ${after.fps_mean} after` });
    before = after;
  }
  fast.end();
  await daemon.stop();
}

/** Opens `count` plain connections that say nothing; how many were ended or answered. */
async function connectMany(daemon, count) {
  const sockets = [];
  let refused = 0;
  for (let i = 0; i < count; i++) {
    const socket = net.connect(daemon.port, '127.0.0.1');
    socket.on('error', () => {}).once('data', () => { refused++; }).once('close', () => { refused++; });
    sockets.push(socket);
    if (i % 200 === 199) await pause(5);
  }
  await pause(1000);
  return { sockets, refused };
}

/** 10,000 connections without a word: over the limit they wait in the system's backlog, below it they are held; a user works on. */
async function idle() {
  for (const limit of [1024, 12000]) {
    const daemon = await Daemon.start('auto', ['--connections', String(limit), '--connections-per-address', String(limit), '--header-time', '600']);
    const client = await Client.open(daemon, await daemon.session(512));
    client.drive();
    const before = (await watch(daemon, [client]), daemon.rssMib());
    const { sockets, refused } = await connectMany(daemon, 10000);
    const held = daemon.files();
    const measured = await watch(daemon, [client]);
    note({ part: 'idle', clients: 10000, size: 512, ...measured,
      note: `limit ${limit}: ${held} descriptors, ${refused} refused, ${round((daemon.rssMib() - before) * 1024 / Math.max(1, held), 1)} KiB a connection` });
    sockets.forEach((socket) => socket.destroy());
    client.end();
    await daemon.stop();
  }
}

/** People come and go, a fifth of them without ending their session; memory, sessions and descriptors at the end of each minute. */
async function soak() {
  const daemon = await Daemon.start('auto', ['--session-time', '60']);
  const clients = new Set();
  const end = performance.now() + 60000 * Number(options.minutes);
  let minute = performance.now() + 60000;
  let served = 0;
  while (performance.now() < end) {
    if (clients.size < 12) {
      const session = await daemon.session(256);
      const client = await Client.open(daemon, session);
      client.drive(50 + Math.random() * 200);
      client.id = session.id;
      client.until = performance.now() + 2000 + Math.random() * 15000;
      clients.add(client);
      served++;
    }
    for (const client of clients)
      if (performance.now() > client.until) {
        client.end();
        clients.delete(client);
        if (Math.random() < 0.8) await daemon.ask('DELETE', `sessions/${client.id}`);
      }
    await daemon.ask('POST', 'render?format=jpeg', { ...daemon.view, size: [128, 128] }).catch(() => {});
    await pause(100);
    if (performance.now() > minute) {
      minute += 60000;
      note({ part: 'soak', clients: served, size: 256, rss_mib: round(daemon.rssMib()), note: `${await daemon.gauge('splatd_sessions')} sessions, ${daemon.files()} descriptors` });
    }
  }
  clients.forEach((client) => client.end());
  await daemon.stop();
}

const parts = { overhead, viewers, sessions, memory, fairness, idle, soak };
if (options.help) {
  process.stdout.write(`${fs.readFileSync(new URL(import.meta.url), 'utf8').split('\n').slice(2, 10).map((l) => l.slice(3)).join('\n')}\nparts: ${PARTS.join(', ')}\n`);
  process.exit(0);
}
if (options.disturb) {
  await disturb(options.disturb);
} else {
  await measure(options.only.split(','));
}

async function measure(wanted) {
  const unknown = wanted.find((name) => !parts[name]);
  if (unknown) {
    process.stderr.write(`serve.mjs: --only: "${unknown}" is none of ${PARTS.join(', ')}\n`);
    process.exit(2);
  }
  for (const name of wanted) {
    await parts[name]();
    if (options.out) save();
  }
}

function save() {
  const cell = (value) => (/[",]/.test(value) ? `"${String(value).replaceAll('"', '""')}"` : value ?? '');
  fs.writeFileSync(options.out, `${[COLUMNS, ...rows.map((row) => COLUMNS.map((c) => cell(row[c])))].map((line) => line.join(',')).join('\n')}\n`);
}
