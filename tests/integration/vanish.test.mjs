// SPDX-License-Identifier: Apache-2.0
// Clients that vanish silently: no FIN and no RST arrives, as when a laptop loses its network. The daemon and its clients
// run in a private network namespace, whose only link goes down.
import assert from 'node:assert/strict';
import { execFileSync, spawn, spawnSync } from 'node:child_process';
import { once } from 'node:events';
import { mkdtempSync, readdirSync, readlinkSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { test } from 'node:test';
import tls from 'node:tls';
import { fileURLToPath } from 'node:url';
import { compare } from '../support/compare.mjs';
import { Daemon, Raw, within } from './harness.mjs';

const FILE = fileURLToPath(import.meta.url);
const ALONE = ['-rn', process.execPath, FILE];

/** Sets the link of this network up or down, without tools of the system. */
function link(up) {
  execFileSync('/usr/bin/python3', ['-c', 'import fcntl, socket, struct\n'
    + `fcntl.ioctl(socket.socket(), 0x8914, struct.pack("16sh14x", b"lo", ${up ? 0x41 : 0}))`]); // SIOCSIFFLAGS
}

function sockets(daemon) {
  const folder = `/proc/${daemon.child.pid}/fd`;
  return readdirSync(folder).filter((name) => {
    try {
      return readlinkSync(path.join(folder, name)).startsWith('socket:');
    } catch {
      return false; // closed in the meantime
    }
  }).length;
}

async function untilOnly(daemon, count) {
  const end = Date.now() + 60000;
  while (sockets(daemon) > count) {
    compare(Date.now(), '<', end, `${sockets(daemon)} sockets are open, ${count} were; ${daemon.log.slice(-1500)}`);
    await new Promise((resolve) => setTimeout(resolve, 20));
  }
}

/** Opens a connection, with or without TLS, that sends `text` and does not read. */
async function speak(daemon, text) {
  const raw = await Raw.connect(daemon.port);
  if (!daemon.base.startsWith('https')) {
    raw.socket.pause();
    raw.write(text);
    return raw;
  }
  raw.socket.removeAllListeners('data');
  const socket = tls.connect({ socket: raw.socket, rejectUnauthorized: false });
  socket.on('error', () => {});
  await within(once(socket, 'secureConnect'), 'a TLS handshake');
  socket.pause();
  socket.write(text);
  return raw;
}

async function vanish(t, secure) {
  const daemon = await Daemon.start(['--volume', 'demo:engine?size=32', '--ping-time', '1', '--stall-time', '2',
    '--header-time', '2', '--request-time', '6', '--idle-time', '2', ...secure]);
  t.after(() => {
    link(true);
    daemon.kill('SIGKILL'); // in case it did not exit
  });
  const before = sockets(daemon);
  await daemon.loaded('engine');
  const session = await daemon.session();
  const made = await daemon.post('/api/v1/paths', { view: { volume: 'engine' }, size: [512, 512], frames: 10000, keyframes: [{ frame: 10000, view: { camera: { fov_y: 60 } } }] });
  assert.equal(made.status, 202, JSON.stringify(made.json));
  await untilOnly(daemon, before); // fetch keeps connections open: they end after --idle-time
  const [idle, busy] = [await daemon.stream({ session }), await daemon.stream({ session, acks: false })];
  await idle.final();
  await busy.frame(() => true, 'a frame');
  const get = (what) => `GET ${what} HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer ${daemon.token}\r\n\r\n`;
  const request = get('/api/v1/openapi.yaml');
  const rest = [await speak(daemon, ''), await speak(daemon, 'GET /healthz HT'), await speak(daemon, request),
    await speak(daemon, request.repeat(500)), await speak(daemon, get(`/api/v1/paths/${made.json.id}/events`))];
  if (secure.length) { // during the handshake
    rest.push(await Raw.connect(daemon.port), await Raw.connect(daemon.port));
    rest.at(-1).write(Buffer.from([0x16, 3, 1, 0, 200, 1, 0]));
  }
  compare(sockets(daemon), '>', before);
  const { localPort } = idle.socket._socket;
  link(false);
  for (const stream of [idle, busy]) stream.socket.on('error', () => {}).terminate();
  for (const raw of rest) raw.socket.destroy();
  await daemon.untilLogged(`stream of 127.0.0.1:${localPort} dropped: silent for`);
  await untilOnly(daemon, before);
  await daemon.untilLogged(/stream of 127\.0\.0\.1:\d+ (closed with 1008|dropped: it took no data)/);
  link(true);
  assert.equal((await daemon.json(`/api/v1/paths/${made.json.id}`)).json.state, 'running', 'the path continues without a client');
  assert.equal((await daemon.fetch(`/api/v1/paths/${made.json.id}`, { method: 'DELETE' })).status, 204);
  assert.equal((await daemon.fetch('/healthz')).status, 200);
  assert.equal(await daemon.stop(), 0);
}

function certificate(folder) {
  const [cert, key] = [path.join(folder, 'cert.pem'), path.join(folder, 'key.pem')];
  execFileSync('openssl', ['req', '-x509', '-newkey', 'ec', '-pkeyopt', 'ec_paramgen_curve:P-256', '-nodes', '-days', '30', '-subj',
    '/CN=127.0.0.1', '-keyout', key, '-out', cert], { stdio: 'ignore' });
  return ['--tls-cert', cert, '--tls-key', key];
}

if (process.env.SPLATD_TEST_ALONE) {
  link(true);
  test('nothing remains of clients that vanished', (t) => vanish(t, []));
  test('nothing remains of TLS clients that vanished', async (t) => {
    const folder = mkdtempSync(path.join(tmpdir(), 'splatd-vanish-'));
    process.env.NODE_TLS_REJECT_UNAUTHORIZED = '0';
    t.after(() => rmSync(folder, { recursive: true }));
    await vanish(t, certificate(folder));
  });
} else {
  test('clients that vanish silently', async (t) => {
    if (spawnSync('unshare', ['-rn', 'true']).status !== 0) return t.skip('no network of its own: unshare -rn');
    const child = spawn('unshare', ALONE, { env: { ...process.env, SPLATD_TEST_ALONE: '1', NODE_TEST_CONTEXT: '' }, stdio: ['ignore', 'pipe', 'pipe'] });
    let out = '';
    child.stdout.on('data', (data) => { out += data; });
    child.stderr.on('data', (data) => { out += data; });
    const [code] = await once(child, 'close');
    assert.equal(code, 0, out);
    assert.match(out, /pass 2/);
  });
}
