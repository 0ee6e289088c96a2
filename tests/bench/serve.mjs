#!/usr/bin/env node
// SPDX-License-Identifier: Apache-2.0
// Measures the cost of the daemon and how clients affect each other: users per machine, memory per user, overhead without
// rendering, hostile client behaviours, idle connections, and hours of clients that connect and disconnect.
//
//   node tests/bench/serve.mjs [--bin DIR] [--only PARTS] [--seconds N] [--rounds N] [--minutes N] [--volume V]
//     [--backend NAME] [--large V --large V] [--behaviour TEXT] [--out FILE.csv]
//
// The clients share the machine with the daemon, so every figure includes their work. Prints one line per measurement; COLUMNS
// and SOAK_COLUMNS are the columns of the file. `soak` is measured alone because it has other columns.
import { execFileSync } from 'node:child_process';
import { once } from 'node:events';
import fs from 'node:fs';
import net from 'node:net';
import os from 'node:os';
import path from 'node:path';
import { parseArgs } from 'node:util';
import { CROWD, HEAVY, others, plain, secure } from './serve/hostile.mjs';
import { child, Client, CODECS, Daemon, mean, median, pause, round, watch } from './serve/peers.mjs';
import { soak } from './serve/soak.mjs';

const PARTS = ['overhead', 'motion', 'edits', 'streams', 'drag', 'loop', 'awake', 'viewers', 'sessions', 'memory', 'hostile', 'idle', 'soak'];
const NAMED = ['motion', 'edits', 'streams', 'drag', 'loop', 'soak']; // measured only if they are named: they have files of their own
const COLUMNS = ['part', 'what', 'volume', 'clients', 'px', 'side', 'coarse', 'fps_min', 'fps_mean', 'p50_ms', 'p95_ms', 'p99_ms', 'work_ms', 'wait_p50_ms', 'wait_p95_ms', 'kbytes_frame',
  'rss_mib', 'cpu_share', 'change_percent', 'alone_fps', 'alone_p95_ms', 'kib_each', 'wanted', 'limit', 'held', 'refused', 'cpu_ms_frame', 'cpu_rest_percent', 'final_ms', 'note'];
const SOAK_COLUMNS = ['minute', 'clients', 'errands', 'sessions', 'rss_mib', 'descriptors', 'failed'];
const WANTED_FPS = 10; // frames per second that each user needs when the most users are counted
const { values: options } = parseArgs({
  options: {
    bin: { type: 'string', default: 'build/release/bin' },
    only: { type: 'string', default: PARTS.filter((part) => !NAMED.includes(part)).join(',') },
    seconds: { type: 'string', default: '4' },
    rounds: { type: 'string', default: '3' },
    minutes: { type: 'string', default: '20' },
    backend: { type: 'string', default: 'cpu' }, // of the part streams
    volume: { type: 'string', default: 'demo:engine?size=128' },
    behaviour: { type: 'string', default: '' }, // only behaviours whose names contain it
    large: { type: 'string', multiple: true, default: ['demo:phantom?size=256', 'demo:vessels?size=256'] }, // volumes of the hostile clients
    out: { type: 'string' },
    help: { type: 'boolean' },
  },
});
const seconds = Number(options.seconds);
const rows = [];

const start = (backend, args = [], volumes = []) => Daemon.start(options.bin, backend, [options.volume, ...volumes], args);

function note(row) {
  rows.push(row);
  const line = Object.entries(row).filter(([key, value]) => value !== '' && key !== 'part').map(([key, value]) => `${key} ${value}`).join('  ');
  process.stdout.write(`${row.part ?? 'soak'}: ${line}\n`);
}

/** Writes a row of users with the same behaviour. */
function measured(part, what, seen, more = {}) {
  note({ part, what, volume: options.volume, px: 512, ...seen, ...more });
}

/** Sends fifty changes per second, one by one; nothing is rendered. */
async function overhead() {
  for (const px of [512, 1024]) {
    const daemon = await start('null');
    const client = await Client.open(daemon, await daemon.session(px));
    client.configure({ max_fps: 120, progressive: false, quality: 60 });
    client.drive(20);
    measured('overhead', 'from a change to its JPEG of quality 60, null backend', await watch(daemon, [client], seconds), { px });
    client.end();
    await daemon.stop();
  }
}

/** Measures hand to picture: each client sends sixty changes per second, or the next one when a frame arrives. `work` is the time of
 * rendering and encoding; `wait` is the rest of the latency. */
async function motion() {
  for (const backend of ['null', 'cpu'])
    for (const [n, fps] of [[1, 30], [1, 60], [1, 120], [1, 0], [8, 60]]) {
      const daemon = await start(backend);
      const clients = [];
      while (clients.length < n) clients.push(await Client.open(daemon, await daemon.session(512)));
      for (const client of clients) {
        client.configure({ max_fps: fps || 120 });
        if (fps) client.drive(1000 / 60);
        else client.lockstep();
      }
      measured('motion', `${backend}, ${fps ? `60 changes per second, max_fps ${fps}` : 'a change per frame, max_fps 120'}`, await watch(daemon, clients, seconds));
      clients.forEach((client) => client.end());
      await daemon.stop();
    }
}

/** Turns, and drags a point of the transfer function, in alternation: both should have the same frame rate. */
async function edits() {
  const daemon = await start('cpu');
  const client = await Client.open(daemon, await daemon.session(1024));
  client.configure({ max_fps: 60 });
  for (let round = 0; round < Number(options.rounds); round++)
    for (const [what, step] of [['turning', () => client.turn()], ['dragging a point', () => client.edit()]]) {
      client.drive(1000 / 60, step);
      measured('edits', what, await watch(daemon, [client], seconds), { px: 1024 });
      clearTimeout(client.timer);
    }
  client.end();
  await daemon.stop();
}

/** Sessions of 1024 px that all turn at the same time, with one backend. */
async function streams() {
  for (const n of [1, 8, 32]) {
    const daemon = await start(options.backend);
    const clients = [];
    while (clients.length < n) clients.push(await Client.open(daemon, await daemon.session(1024)));
    for (const client of clients) {
      client.configure({ max_fps: 60 });
      client.drive(1000 / 60);
    }
    measured('streams', `${options.backend}, 60 changes per second, max_fps 60`, await watch(daemon, clients, seconds), { px: 1024 });
    clients.forEach((client) => client.end());
    await daemon.stop();
  }
}

/** A user drags the view, rests, and drags again. `final_ms` is the time from the last change to its final frame, the median of the
 * rounds; the other columns are the medians of the frames of the drags. */
async function drag() {
  const daemon = await start(options.backend);
  const client = await Client.open(daemon, await daemon.session(512));
  const final = () => new Promise((resolve) => { client.onFinal = resolve; });
  const rounds = [];
  await final(); // the first frame builds what is cached of the volume
  client.configure({ max_fps: 60 });
  for (let i = 0; i < Number(options.rounds); i++) {
    client.drive(1000 / 60);
    const seen = await watch(daemon, [client], seconds);
    clearTimeout(client.timer);
    const begin = performance.now();
    await final();
    rounds.push({ ...seen, final_ms: performance.now() - begin });
  }
  const middle = Object.keys(rounds[0]).map((key) => [key, round(median(rounds.map((one) => one[key])), 2)]);
  measured('drag', `${options.backend}, 60 changes per second, max_fps 60`, Object.fromEntries(middle));
  client.end();
  await daemon.stop();
}

/** Measures scripts that request one image after the other. */
async function loop() {
  for (const backend of ['null', 'cpu']) {
    const daemon = await start(backend);
    for (const parallel of [1, 2, 4]) measured('loop', `${backend}, POST /render, JPEG`, await daemon.loop(512, parallel, seconds));
    daemon.hangUp();
    await daemon.stop();
  }
}

/** Measures the cost of a frame of one user, and of all clients while that user rests. The other clients have idle sessions of
 * their own. The first client is the user. */
async function awake() {
  for (const n of [1, 1000]) {
    const [limit, connections] = [n + 100, 2 * n + 100].map(String); // a part of the connections is kept for others
    const daemon = await start('null', ['--sessions', limit, '--connections', connections, '--connections-per-address', connections]);
    const clients = [];
    while (clients.length < n) clients.push(await Client.open(daemon, await daemon.session(512)));
    const rest = await watch(daemon, clients, seconds, Math.min(4, seconds)); // after every client has its final frame
    clients[0].configure({ max_fps: 120, progressive: false, quality: 60 });
    clients[0].drive(20);
    const seen = await watch(daemon, clients.slice(0, 1), seconds);
    measured('awake', 'sessions, one of which moves, null backend', { ...seen, clients: n, cpu_rest_percent: round(100 * rest.cpu_share, 0) });
    clients.forEach((client) => client.end());
    await daemon.stop();
  }
}

async function viewers() {
  for (const n of [1, 8, 63]) {
    const daemon = await start('auto');
    const session = await daemon.session(512);
    const driver = await Client.open(daemon, session, { token: daemon.token }); // a place is kept for the owner
    const clients = [];
    for (let i = 0; i < n; i++) clients.push(await Client.open(daemon, session, { role: 'view' }));
    driver.drive();
    measured('viewers', 'of one view, which a further client turns', await watch(daemon, clients, seconds));
    [driver, ...clients].forEach((client) => client.end());
    await daemon.stop();
  }
}

/** Measures `n` users with one session each, all of which rotate their view. */
async function users(n, settings, what) {
  const daemon = await start('auto');
  const clients = [];
  for (let i = 0; i < n; i++) {
    clients.push(await Client.open(daemon, await daemon.session(512)));
    clients[i].configure(settings);
    clients[i].drive();
  }
  const seen = await watch(daemon, clients, seconds, Math.min(2, seconds));
  measured('sessions', what, seen);
  clients.forEach((client) => client.end());
  await daemon.stop();
  return seen;
}

/** Measures users with the default settings, where the daemon reduces image size and detail when time is short. Then finds, by
 * doubling and bisection, the most users for whom frames of full quality reach WANTED_FPS even for the slowest. */
async function sessions() {
  for (const n of [1, 8, 16]) await users(n, {}, 'sides and detail as time allows');
  let held = 0;
  let missed = 65;
  for (let n = 2; missed - held > 1; n = missed > 64 ? Math.min(64, 2 * n) : (held + missed) >> 1)
    if ((await users(n, { progressive: false }, 'full side, detail and quality')).fps_min >= WANTED_FPS) held = n;
    else missed = n;
}

/** Measures the memory of one more client: the slope from 8 to 40 clients. */
async function memory() {
  for (const [kind, format] of [['viewer', 'jpeg'], ['session', 'jpeg'], ['session', 'vp8'], ['session', 'vp9']]) {
    const daemon = await start('auto', ['--rest-time', '60', '--video-pixels', '64M']);
    const shared = await daemon.session(512);
    const clients = [];
    const mib = [];
    for (const n of [8, 40]) {
      while (clients.length < n) {
        const watches = kind === 'viewer' && clients.length > 0; // it watches the view that the first client rotates
        const client = await Client.open(daemon, kind === 'viewer' ? shared : await daemon.session(512), { role: watches ? 'view' : 'control' });
        client.configure({ format });
        if (!watches) client.drive(200);
        clients.push(client);
      }
      mib.push((await watch(daemon, clients, seconds)).rss_mib);
    }
    const all = clients.reduce((sum, client) => sum + client.frames, 0);
    const so = clients.reduce((sum, client) => sum + (client.codecs[CODECS[format]] ?? 0), 0);
    measured('memory', `a ${kind}, ${format}`, { clients: 40, rss_mib: mib[1], kib_each: round(1024 * (mib[1] - mib[0]) / 32),
      note: `${round(100 * so / all, 0)} % of the frames were ${format}` });
    clients.forEach((client) => client.end());
    await daemon.stop();
  }
}

/** Measures one working client, alone and beside another client of each behaviour. The speed of the machine drifts, so each round
 * measures every behaviour once, between measurements alone, and the row has the medians. */
async function hostile() {
  await beside({ ...plain, ...others }, []);
  const folder = fs.mkdtempSync(path.join(os.tmpdir(), 'splat-serve-'));
  const [cert, key] = ['cert.pem', 'key.pem'].map((name) => path.join(folder, name));
  execFileSync('openssl', ['req', '-x509', '-newkey', 'rsa:2048', '-nodes', '-days', '2', '-subj', '/CN=bench', '-keyout', key, '-out', cert],
    { stdio: 'ignore' });
  // The default limit of all addresses except the addresses of this machine.
  await beside(secure, ['--tls-cert', cert, '--tls-key', key, '--handshake-rate', '50']);
  fs.rmSync(folder, { recursive: true });
}

async function beside(kinds, args) {
  const daemon = await start('auto', ['--stall-time', '3600', ...args], options.large);
  const session = await daemon.session(512);
  const victim = await Client.open(daemon, session);
  victim.drive();
  const alone = () => watch(daemon, [victim], 0.3 * seconds);
  const names = Object.keys(kinds).filter((kind) => kind.includes(options.behaviour));
  const found = Object.fromEntries(names.map((kind) => [kind, []]));
  let before = await alone();
  for (let i = 0; i < Number(options.rounds); i++)
    for (const kind of names) {
      const seen = await besideOne(daemon, session, victim, kind);
      const after = await alone();
      found[kind].push({ ...seen, change: 100 * (2 * seen.fps_mean / (before.fps_mean + after.fps_mean) - 1),
        alone_fps: (before.fps_mean + after.fps_mean) / 2, alone_p95_ms: (before.p95_ms + after.p95_ms) / 2 });
      before = after;
    }
  victim.end();
  await daemon.stop();
  for (const [kind, list] of Object.entries(found)) tell(kind, list);
}

/** Measures `victim` beside another process with a client of that kind, and how often the other client was served. */
async function besideOne(daemon, session, victim, kind) {
  const { port, token, secure: tls } = daemon;
  const other = child(process.execPath, [new URL('serve/hostile.mjs', import.meta.url).pathname, kind,
    JSON.stringify({ port, token, secure: tls, victim: session })]);
  const ended = once(other, 'close');
  await Promise.race([once(other.stdout, 'data'), ended]);
  const begin = performance.now();
  const seen = await watch(daemon, [victim], 0.6 * seconds);
  if (other.exitCode !== null) throw new Error(`the client that is ${kind} ended: ${other.log}`);
  let served = '';
  other.stdout.on('data', (data) => { served += data; });
  const took = (performance.now() - begin) / 1000;
  other.kill();
  await ended;
  return { ...seen, served: Number(served), served_fps: Number(served) / took };
}

function tell(kind, list) {
  const middle = (what, digits = 1) => round(median(list.map((one) => one[what])), digits);
  const count = [CROWD, HEAVY].find((n) => kind.startsWith(`${n} sessions`));
  const share = count ? `, each ${round(middle('served_fps') / count)} times per second; it has ${round(100 * middle('render_share', 3))} % of the rendering, an equal share is ${round(100 / (count + 1))} %` : '';
  measured(kind in others ? 'beside' : 'hostile', kind, {
    ...Object.fromEntries(['side', 'fps_mean', 'p50_ms', 'p95_ms', 'p99_ms', 'kbytes_frame', 'rss_mib', 'alone_fps', 'alone_p95_ms'].map((key) => [key, middle(key)])),
    clients: 1, cpu_share: middle('cpu_share', 2), change_percent: middle('change'),
    note: `changes ${list.map((one) => round(one.change)).join(', ')} %; the other was served ${middle('served', 0)} times${share}`,
  });
}

/** Opens `count` silent connections. */
async function connectMany(daemon, count) {
  const many = { sockets: [], refused: 0 };
  for (let i = 0; i < count; i++) {
    const socket = net.connect(daemon.port, '127.0.0.1').on('error', () => {});
    let open = true;
    const refuse = () => { many.refused += open; open = false; };
    socket.once('data', refuse).once('close', refuse);
    many.sockets.push(socket);
    if (i % 200 === 199) await pause(5);
  }
  for (let last = -1, quiet = 0; quiet < 5; await pause(200)) { // until the count is stable
    const count = daemon.files() + many.refused;
    quiet = count === last ? quiet + 1 : 0;
    last = count;
  }
  return many;
}

/** Opens 10,000 silent connections, above or below the limit, while a user works. */
async function idle() {
  const wanted = 10000;
  const files = Number(/Max open files\s+\S+\s+(\d+)/.exec(fs.readFileSync('/proc/self/limits', 'utf8'))?.[1] ?? Infinity);
  for (const limit of [1024, wanted + 2000]) {
    if (files < limit + 1000) {
      process.stderr.write(`skipped: ${wanted} idle connections; a process may open ${files} files here (ulimit -Hn)\n`);
      continue;
    }
    const daemon = await start('auto', ['--connections', String(limit), '--connections-per-address', String(limit), '--header-time', '600']);
    const client = await Client.open(daemon, await daemon.session(512));
    client.drive();
    daemon.hangUp();
    const before = await watch(daemon, [client], seconds);
    const [rss, open] = [daemon.rssMib(), daemon.files()];
    const { sockets, refused } = await connectMany(daemon, wanted);
    const held = daemon.files() - open;
    const seen = await watch(daemon, [client], seconds);
    measured('idle', `${wanted} connections, --connections ${limit}`, { ...seen, wanted, limit, held, refused, alone_fps: before.fps_mean, alone_p95_ms: before.p95_ms,
      change_percent: round(100 * (seen.fps_mean / before.fps_mean - 1)), kib_each: round(1024 * (daemon.rssMib() - rss) / Math.max(1, held)) });
    sockets.forEach((socket) => socket.destroy());
    client.end();
    await daemon.stop();
  }
}

async function soakMeasured() {
  await soak((args) => start('auto', args), Number(options.minutes), ({ rss, ...seen }) => {
    note({ ...seen, rss_mib: round(rss) });
    if (options.out) save();
  });
}

async function measure(wanted) {
  const unknown = wanted.find((name) => !PARTS.includes(name));
  const problem = unknown !== undefined ? `"${unknown}" is not one of ${PARTS.join(', ')}`
    : wanted.length > 1 && wanted.includes('soak') ? 'soak is measured alone' : '';
  if (problem) {
    process.stderr.write(`serve.mjs: --only: ${problem}\n`);
    process.exit(2);
  }
  for (const name of wanted) {
    await { overhead, motion, edits, streams, drag, loop, awake, viewers, sessions, memory, hostile, idle, soak: soakMeasured }[name]();
    if (options.out) save();
  }
}

function save() {
  const columns = rows[0]?.part ? COLUMNS : SOAK_COLUMNS;
  const cell = (value) => (/[",]/.test(value) ? `"${String(value).replaceAll('"', '""')}"` : value ?? '');
  fs.writeFileSync(options.out, `${[columns, ...rows.map((row) => columns.map((c) => cell(row[c])))].map((line) => line.join(',')).join('\n')}\n`);
}

if (options.help) {
  const [, , ...head] = fs.readFileSync(new URL(import.meta.url), 'utf8').split('\n', 10);
  process.stdout.write(`${head.map((line) => line.slice(3)).join('\n')}\nparts: ${PARTS.join(', ')}\n`);
} else {
  await measure(options.only.split(','));
}
