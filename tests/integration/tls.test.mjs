// SPDX-License-Identifier: Apache-2.0
// TLS: the same responses and streams as without it, and clients that use TLS incorrectly or not at all.
import assert from 'node:assert/strict';
import { spawn } from 'node:child_process';
import { createHash } from 'node:crypto';
import { once } from 'node:events';
import { chmodSync, copyFileSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import https from 'node:https';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { Duplex } from 'node:stream';
import { after, before, test } from 'node:test';
import tls from 'node:tls';
import { compare } from '../support/compare.mjs';
import { certify } from './certificate.mjs';
import { clientFrame, Daemon, Raw, runToEnd, Stream, within } from './harness.mjs';

const folder = mkdtempSync(path.join(tmpdir(), 'splatd-tls-'));
const at = (name) => path.join(folder, name);
const [cert, key] = [at('cert.pem'), at('key.pem')];

function install(name) {
  copyFileSync(at(`${name}.crt`), cert);
  copyFileSync(at(`${name}.key`), key);
}

let daemon;
let ca;
const secure = ['--tls-cert', cert, '--tls-key', key];
before(async () => {
  for (const name of ['one', 'two']) certify(at(name), name);
  install('one');
  ca = [readFileSync(at('one.crt')), readFileSync(at('two.crt'))];
  daemon = await Daemon.start(['--volume', 'demo:engine?size=32', ...secure, '--handshakes', '8', '--header-time', '2',
    '--connections', '100']);
  for (;;) if (JSON.parse((await ask('/api/v1/volumes/engine')).body).state !== 'loading') break;
});
after(async () => {
  assert.equal(await daemon.stop(), 0);
  rmSync(folder, { recursive: true });
});

/** Sends one request. Resolves to {status, headers, body, subject}. */
function ask(target, { method = 'GET', body, of = daemon, ...options } = {}) {
  const headers = { Authorization: `Bearer ${of.token}`, ...(body ? { 'Content-Type': 'application/json' } : {}) };
  return within(new Promise((resolve, reject) => {
    const request = https.request(of.base + target, { method, ca, headers, agent: false, ...options }, (answer) => {
      const parts = [];
      const subject = answer.socket.getPeerCertificate().subject.CN;
      answer.on('data', (data) => parts.push(data)).on('error', reject);
      answer.on('end', () => resolve({ status: answer.statusCode, headers: answer.headers, body: Buffer.concat(parts), subject }));
    });
    request.on('error', reject);
    request.end(body);
  }), `an answer to ${target}`);
}

async function session(of = daemon) {
  return JSON.parse((await ask('/api/v1/sessions', { method: 'POST', body: '{}', of })).body);
}

async function othersAreServed() {
  assert.equal((await ask('/healthz')).status, 200);
}

function connect(options = {}) {
  return within(new Promise((resolve, reject) => {
    const socket = tls.connect({ port: daemon.port, host: '127.0.0.1', ca, ...options }, () => resolve(socket));
    socket.on('error', reject);
  }), 'a TLS connection');
}

/** Resolves to all bytes until the end of the connection. */
async function readAll(socket) {
  const parts = [];
  socket.on('data', (data) => parts.push(data));
  await within(once(socket, 'end'), 'the end of a TLS connection');
  return Buffer.concat(parts);
}

test('the printed address is https; TLS 1.2 and 1.3 work, older versions are refused', async () => {
  assert.match(daemon.out, /^splatd: listening on https:\/\/127\.0\.0\.1:\d+\/\?token=\w+\n$/);
  for (const version of ['TLSv1.2', 'TLSv1.3']) {
    const socket = await connect({ minVersion: version, maxVersion: version, ALPNProtocols: ['h2', 'http/1.1'] });
    assert.equal(socket.getProtocol(), version);
    assert.equal(socket.alpnProtocol, 'http/1.1');
    socket.end('GET /healthz HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n');
    assert.match(String(await readAll(socket)), /^HTTP\/1\.1 200/);
  }
  await assert.rejects(connect({ minVersion: 'TLSv1', maxVersion: 'TLSv1.1', ciphers: 'DEFAULT@SECLEVEL=0' }));
  await assert.rejects(connect({ maxVersion: 'TLSv1.2', ciphers: 'AES128-SHA:AES256-GCM-SHA384' }), 'no forward secrecy');
});

test('images and bodies of a megabyte are the same as without TLS', async () => {
  const plain = await Daemon.start(['--volume', 'demo:engine?size=32']);
  await plain.loaded('engine');
  const view = JSON.stringify({ size: [1024, 1024] });
  const expected = Buffer.from(await (await plain.fetch('/api/v1/render?format=png', {
    method: 'POST', body: view, headers: { 'Content-Type': 'application/json' } })).arrayBuffer());
  const got = await ask('/api/v1/render?format=png', { method: 'POST', body: view + ' '.repeat(1000000) });
  assert.equal(got.status, 200);
  const hash = (bytes) => createHash('sha256').update(bytes).digest('hex');
  assert.equal(hash(got.body), hash(expected));
  assert.equal((await ask('/api/v1/render', { method: 'POST', body: ' '.repeat(2000000) })).status, 413);
  assert.equal(await plain.stop(), 0);
});

test('streams carry frames and large messages, and either side can close them', async () => {
  const of = await session();
  const stream = await Stream.open(daemon.streamUrl(of), { session: of, ca });
  await stream.update({ size: [1024, 1024], background: [0, 1, 0, 1] }, 7);
  await stream.final(7);
  await assert.rejects(stream.call('view.get', { x: 'y'.repeat(900000) }), /unknown member/);
  await assert.rejects(stream.call('view.get', { x: 'y'.repeat(1100000) }), /closed with 1009/);
  const second = await Stream.open(daemon.streamUrl(of), { session: of, ca });
  await ask(`/api/v1/sessions/${of.id}`, { method: 'DELETE' });
  assert.equal((await second.until(() => second.closed, 'the close')).code, 1000);
});

test('the daemon notices a client that disconnects, and the log names it', async () => {
  const of = await session();
  const stream = await Stream.open(daemon.streamUrl(of), { session: of, ca });
  await stream.final();
  const { localPort } = stream.socket._socket;
  stream.socket.terminate();
  await daemon.untilLogged(`stream of 127.0.0.1:${localPort} joined`);
  await daemon.untilLogged(new RegExp(`stream of session ${of.id} (ended|cut)`));
});

test('a plain HTTP request gets the advice to use https', async () => {
  const raw = await Raw.connect(daemon.port);
  raw.write('GET / HTTP/1.1\r\nHost: x\r\n\r\n');
  await raw.until(() => raw.ended, 'the end of the connection');
  assert.match(raw.text(), /^HTTP\/1\.1 400 Bad Request\r\n/);
  const [head, body] = raw.text().split('\r\n\r\n');
  assert.equal(JSON.parse(body).detail, 'this port speaks TLS; use https');
  assert.match(head, new RegExp(`Content-Length: ${body.length}`));
  await othersAreServed();
});

test('invalid bytes, truncated ClientHellos and silent connections are ended', async () => {
  const greeting = Buffer.from('16030100ff010000fb0303', 'hex');
  const cases = [Buffer.from([0]), Buffer.alloc(70000, 0xff), greeting, Buffer.from('16030140000100', 'hex'), Buffer.from('\x15\x03\x01\x00\x02\x02\x28', 'latin1'),
    Buffer.from('1603010005010000010', 'hex'), Buffer.from('80800103010057', 'hex'), Buffer.from('{"a":1}\n')];
  for (const bytes of cases) {
    const raw = await Raw.connect(daemon.port);
    raw.write(bytes);
    await raw.until(() => raw.ended, `the end after ${bytes.subarray(0, 8).toString('hex')}`); // at --header-time at the latest
    raw.destroy();
  }
  const silent = await Raw.connect(daemon.port);
  await silent.until(() => silent.ended, 'the end of a silent connection');
  for (let i = 0; i < 20; i++) (await Raw.connect(daemon.port)).destroy();
  await othersAreServed();
});

test('invalid records in an open connection end it, and none of their bytes reach HTTP', async () => {
  for (const maxVersion of ['TLSv1.2', 'TLSv1.3']) {
    for (const bytes of [Buffer.alloc(40000, 0xa5), Buffer.from('17030300200000000000000000000000000000000000000000000000000000000000000000', 'hex'),
      Buffer.from('1703034001', 'hex'), Buffer.from('1503030002022a', 'hex'), Buffer.from('16030300040e000000', 'hex')]) {
      const raw = await Raw.connect(daemon.port);
      const socket = await connect({ socket: raw.socket, maxVersion });
      socket.on('error', () => {});
      const ended = within(new Promise((resolve) => { raw.socket.on('end', resolve).on('close', resolve); }),
        `the end after ${bytes.subarray(0, 8).toString('hex')} in ${maxVersion}`); // at --header-time at the latest
      let got = '';
      socket.on('data', (data) => { got += data; });
      raw.write(bytes);
      await ended;
      assert.equal(got, '');
      raw.destroy();
    }
  }
  await othersAreServed();
});

test('100 clients join at once', async () => {
  const many = await Daemon.start(['--volume', 'demo:engine?size=32', ...secure, '--participants', '32']);
  const of = [await session(many)];
  while (!of[0].id) of[0] = await session(many); // the volume loads
  for (let i = 1; i < 4; i++) of.push(await session(many));
  const streams = await Promise.all(Array.from({ length: 100 }, (_, i) => Stream.open(many.streamUrl(of[i % 4]), { session: of[i % 4], ca })));
  await Promise.all(streams.map((stream) => stream.final()));
  await Promise.all(streams.map((stream) => stream.end()));
  assert.equal(await many.stop(), 0);
});

test('handshake and request work when they arrive one byte at a time', async () => {
  const raw = await Raw.connect(daemon.port);
  raw.socket.setNoDelay(true);
  const slow = new Duplex({
    read() {},
    write(data, _, done) {
      for (const byte of data) raw.write(Buffer.from([byte]));
      done();
    },
    final(done) { raw.socket.end(done); },
  });
  raw.socket.removeAllListeners('data');
  raw.socket.on('data', (data) => slow.push(data)).on('end', () => slow.push(null));
  const socket = await connect({ socket: slow });
  socket.write('GET /healthz HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n');
  assert.match(String(await readAll(socket)), /^HTTP\/1\.1 200/);
});

test('the deadlines of HTTP apply behind TLS, and the connection ends with a close_notify', async () => {
  const ends = ['', 'GET /healthz HTTP/1.1\r\nHost: '].map(async (start) => {
    const socket = await connect();
    const port = socket.localPort;
    if (start) socket.write(start);
    assert.equal((await readAll(socket)).length, 0);
    await daemon.untilLogged(`connection of 127.0.0.1:${port} closed: it exceeded --header-time`);
  });
  await Promise.all(ends);
  await othersAreServed();
});

test('slow handshakes do not keep other clients out', async () => {
  const held = [];
  for (let i = 0; i < 30; i++) {
    held.push(await Raw.connect(daemon.port));
    held.at(-1).write(Buffer.from([0x16, 3, 1]));
  }
  await othersAreServed();
  await held[0].until(() => held[0].ended, 'the end of the oldest handshake');
  await daemon.untilLogged('more than 8 handshakes at a time (--handshakes)');
  for (const raw of held) raw.destroy();
});

test('a client that ended its side still gets its response, which ends with a close_notify', async () => {
  const request = 'GET /api/v1/openapi.yaml HTTP/1.1\r\nHost: x\r\nConnection: close\r\n'
    + `Authorization: Bearer ${daemon.token}\r\n\r\n`;
  const socket = await connect({ allowHalfOpen: true });
  socket.end(request);
  const text = (await readAll(socket)).toString('latin1');
  assert.match(text, /^HTTP\/1\.1 200/);
  assert.equal(text.length, text.indexOf('\r\n\r\n') + 4 + Number(/Content-Length: (\d+)/i.exec(text)[1]));
  // OpenSSL prints this when the peer ends the connection without a close_notify.
  const client = spawn('openssl', ['s_client', '-quiet', '-connect', `127.0.0.1:${daemon.port}`], { stdio: ['pipe', 'pipe', 'pipe'] });
  let [out, err] = ['', ''];
  client.stdout.on('data', (data) => { out += data; });
  client.stderr.on('data', (data) => { err += data; });
  client.stdin.write(request);
  await within(once(client, 'close'), 'the end of openssl');
  assert.match(out, /^HTTP\/1\.1 200/);
  assert.doesNotMatch(err, /unexpected eof/);
});

test('a second handshake is refused', async () => {
  const client = spawn('openssl', ['s_client', '-tls1_2', '-connect', `127.0.0.1:${daemon.port}`], { stdio: ['pipe', 'pipe', 'pipe'] });
  let out = '';
  client.stdout.on('data', (data) => {
    if (!out.includes('Verify return code') && (out + data).includes('Verify return code')) client.stdin.write('R\n');
    out += data;
  });
  client.stderr.on('data', () => {});
  await within(once(client, 'close'), 'the end of openssl');
  assert.match(out, /Verify return code/);
  // The daemon ends the connection at once, not after a deadline.
  await daemon.untilLogged(/TLS connection of \S+ ended: Rehandshake was requested/);
  await othersAreServed();
});

test('a TLS 1.3 key update works in the middle of a connection', async () => {
  const client = spawn('openssl', ['s_client', '-tls1_3', '-connect', `127.0.0.1:${daemon.port}`], { stdio: ['pipe', 'pipe', 'pipe'] });
  let out = '';
  let err = '';
  client.stdout.on('data', (data) => {
    if (!out.includes('Verify return code') && (out + data).includes('Verify return code')) client.stdin.write('K\n');
    out += data;
  });
  client.stderr.on('data', (data) => {
    if (!err.includes('KEYUPDATE') && (err + data).includes('KEYUPDATE'))
      client.stdin.write('GET /healthz HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n');
    err += data;
  });
  await within(once(client, 'close'), 'the end of openssl');
  assert.match(out, /HTTP\/1\.1 200/);
});

test('a client that does not read delays no other client', async () => {
  const of = await session();
  const raw = await connect();
  const target = new URL(daemon.streamUrl(of));
  raw.write(`GET ${target.pathname}${target.search} HTTP/1.1\r\nHost: ${target.host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n`
    + 'Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n');
  raw.pause();
  for (let i = 0; i < 4000; i++)
    raw.write(clientFrame(1, JSON.stringify({ jsonrpc: '2.0', id: i, method: 'view.get' })));
  const other = await Stream.open(daemon.streamUrl(of), { session: of, ca });
  await other.update({ background: [1, 0, 0, 1] }, 3);
  await other.final(3);
  await other.end();
  raw.destroy();
});

test('a client that stops reading in the middle of its responses is dropped', async () => {
  const short = await Daemon.start(['--volume', 'demo:engine?size=32', ...secure, '--request-time', '0.5', '--idle-time', '0.5']);
  const raw = await connect({ port: short.port });
  const { localPort } = raw;
  raw.on('error', () => {});
  raw.pause();
  // Request more than the kernel's buffers hold.
  const request = `GET /api/v1/openapi.yaml HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer ${short.token}\r\n\r\n`;
  raw.write(request.repeat(900));
  await short.untilLogged(`TLS connection of 127.0.0.1:${localPort} closed: the client did not read the rest within --request-time`);
  raw.destroy();
  assert.equal((await ask('/healthz', { of: short })).status, 200);
  assert.equal(await short.stop(), 0);
});

test('silent clients, before or after the handshake, use no more connections than the limit of their address', async (t) => {
  const small = await Daemon.start([...secure, '--connections', '40', '--connections-per-address', '4', '--http-threads', '1',
    '--header-time', '600', '--handshakes', '100']);
  const silent = await Promise.all(Array.from({ length: 100 }, () => Raw.connect(small.port)));
  t.after(() => silent.forEach((raw) => raw.destroy()));
  let ended = 0;
  const enough = new Promise((resolve) => {
    for (const raw of silent) raw.until(() => raw.ended, 'the end of a silent connection').then(() => ++ended === 64 && resolve(), () => {});
  });
  await within(enough, () => `64 connections to end (${ended} did)`);
  const { status, body } = await ask('/metrics', { of: small, localAddress: '127.0.0.2' });
  assert.equal(status, 200);
  assert.match(String(body), /^splatd_connections_refused_total\{reason="address"\} 64$/m);
  assert.equal(await small.stop(), 0);
});

test('handshakes per second are limited per address, and other addresses are served', async () => {
  const slow = await Daemon.start([...secure, '--handshake-rate', '1', '--connections', '100']);
  const get = (localAddress) => ask('/healthz', { of: slow, localAddress });
  const all = await Promise.allSettled(Array.from({ length: 60 }, () => get('127.0.0.1')));
  const served = all.filter((one) => one.value?.status === 200).length;
  compare(served, '>=', 16, `${served} of 60`);
  compare(served, '<', 60, `${served} of 60`);
  await slow.untilLogged('its address started more than 1 handshakes per second (--handshake-rate)');
  assert.equal((await get('127.0.0.2')).status, 200);
  assert.match(String((await ask('/metrics', { of: slow, localAddress: '127.0.0.3' })).body),
    /^splatd_connections_refused_total\{reason="handshakes"\} [1-9]/m);
  assert.equal(await slow.stop(), 0);
});

test('after SIGHUP new connections get the new certificate and old ones continue; an invalid certificate changes nothing', async () => {
  const of = await session();
  const stream = await Stream.open(daemon.streamUrl(of), { session: of, ca });
  assert.equal((await ask('/healthz')).subject, 'one');
  install('two');
  daemon.kill('SIGHUP');
  await daemon.untilLogged('reloaded');
  assert.equal((await ask('/healthz')).subject, 'two');
  writeFileSync(cert, 'no certificate');
  daemon.kill('SIGHUP');
  await daemon.untilLogged(/reload failed; keeping the old configuration: \S+cert\.pem: is not a PEM certificate/);
  assert.equal((await ask('/healthz')).subject, 'two');
  await stream.update({ background: [0, 0, 1, 1] }, 9);
  await stream.final(9);
  await stream.end();
});

test('shutdown sends WebSocket close and close_notify through TLS', async () => {
  install('one');
  const other = await Daemon.start(['--volume', 'demo:engine?size=32', ...secure]);
  let of;
  do of = await session(other); while (!of.id);
  const stream = await Stream.open(other.streamUrl(of), { session: of, ca });
  await stream.final();
  other.kill('SIGTERM');
  await stream.note('server.draining');
  assert.equal((await stream.until(() => stream.closed, 'the close')).code, 1001);
  assert.equal(await within(other.ended, 'the end of the daemon'), 0);
});

test('an unusable certificate or key is reported at start-up', async () => {
  install('one');
  const bad = at('bad.pem');
  writeFileSync(bad, 'x', { mode: 0o600 });
  const open = at('open.key');
  copyFileSync(key, open);
  chmodSync(open, 0o644);
  const cases = [
    [['--tls-cert', cert], 2, '--tls-cert: --tls-cert and --tls-key must be given together'],
    [['--tls-key', key], 2, '--tls-key: --tls-cert and --tls-key must be given together'],
    [['--tls-cert', at('none'), '--tls-key', key], 1, `${at('none')}: cannot read the file: No such file`],
    [['--tls-cert', folder, '--tls-key', key], 1, `${folder}: cannot read the file: Is a directory`],
    [['--tls-cert', '/dev/zero', '--tls-key', key], 1, '/dev/zero: cannot read the file'],
    [['--tls-cert', bad, '--tls-key', key], 1, `${bad}: is not a PEM certificate`],
    [['--tls-cert', cert, '--tls-key', bad], 1, `${bad}: is not a PEM private key`],
    [['--tls-cert', cert, '--tls-key', at('two.key')], 1, `${at('two.key')}: is not the key of the certificate`],
    [['--tls-cert', cert, '--tls-key', open], 1, `${open}: users other than its owner can read or change the private key (mode 0644)`],
    [['--listen', '0.0.0.0:0'], 2, '0.0.0.0:0: another address than loopback needs TLS'],
  ];
  for (const [args, status, text] of cases) {
    const run = await runToEnd(['--listen', '127.0.0.1:0', '--backend', 'null', ...args]);
    assert.equal(run.status, status, `${args}: ${run.err}`);
    assert.ok(run.err.includes(text), run.err);
    assert.equal(run.out, '');
  }
});
