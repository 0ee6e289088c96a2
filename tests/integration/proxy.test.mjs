// SPDX-License-Identifier: Apache-2.0
// The daemon behind nginx and HAProxy, below a prefix and with TLS, as deploy/nginx.conf and deploy/haproxy.cfg set them up.
import assert from 'node:assert/strict';
import { spawn } from 'node:child_process';
import { once } from 'node:events';
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import https from 'node:https';
import net from 'node:net';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { after, before, describe, test } from 'node:test';
import { fileURLToPath } from 'node:url';
import { certify } from './certificate.mjs';
import { Daemon, Stream, within } from './harness.mjs';

const DEPLOY = fileURLToPath(new URL('../../deploy/', import.meta.url));
let daemon;
let folder;
let ca;

before(async () => {
  folder = mkdtempSync(path.join(tmpdir(), 'splatd-proxy-'));
  const prefix = path.join(folder, 'volumes');
  certify(prefix, 'volumes');
  ca = readFileSync(`${prefix}.crt`);
  writeFileSync(`${prefix}.pem`, Buffer.concat([ca, readFileSync(`${prefix}.key`)]), { mode: 0o600 });
  daemon = await Daemon.start(['--volume', 'demo:engine?size=16', '--upload-dir', path.join(folder, 'uploads')]);
  await daemon.loaded('engine');
});
after(async () => {
  assert.equal(await daemon.stop(), 0);
  rmSync(folder, { recursive: true });
});

/** Replaces parts of a committed file that depend on the machine. Each must be there. */
function adapt(name, parts) {
  let text = readFileSync(path.join(DEPLOY, name), 'utf8');
  for (const [from, to] of parts) {
    assert.ok(text.includes(from), `${name} has no ${from}`);
    text = text.replaceAll(from, to);
  }
  return text;
}

/** Writes a main configuration around the configuration of the site, as the distribution has it. Returns the arguments of nginx. */
function nginx(port) {
  const site = adapt('nginx.conf', [['listen 443 ssl', `listen 127.0.0.1:${port} ssl`], ['127.0.0.1:8080', `127.0.0.1:${daemon.port}`],
    ['/etc/ssl/certs/volumes.crt', path.join(folder, 'volumes.crt')], ['/etc/ssl/private/volumes.key', path.join(folder, 'volumes.key')],
    ['/var/log/nginx/splatd.log', path.join(folder, 'nginx-requests.log')]]);
  const own = path.join(folder, 'nginx.conf');
  const temporary = ['client_body', 'proxy', 'fastcgi', 'uwsgi', 'scgi'].map((name) => `${name}_temp_path ${folder}/${name};`).join(' ');
  writeFileSync(own, `daemon off; master_process off; pid ${folder}/nginx.pid; events {}\nhttp { ${temporary}\n${site} }\n`);
  return ['-e', path.join(folder, 'nginx-errors.log'), '-c', own];
}

function haproxy(port) {
  const own = path.join(folder, 'haproxy.cfg');
  writeFileSync(own, `global\n    log stdout format raw local0\n${adapt('haproxy.cfg', [['bind :443', `bind 127.0.0.1:${port}`],
    ['127.0.0.1:8080', `127.0.0.1:${daemon.port}`], ['/etc/haproxy/volumes.pem', path.join(folder, 'volumes.pem')]])}`);
  return ['-db', '-f', own];
}

async function freePort() {
  const server = net.createServer().listen(0, '127.0.0.1');
  await once(server, 'listening');
  const { port } = server.address();
  server.close();
  await once(server, 'close');
  return port;
}

/** Starts a proxy, on another port if the chosen one was taken meanwhile. */
async function start(program, configure) {
  for (let attempt = 0; ; attempt += 1) {
    const port = await freePort();
    const child = spawn(program, configure(port), { stdio: ['ignore', 'pipe', 'pipe'] });
    const proxy = { child, port, log: '', ended: once(child, 'close') };
    for (const stream of [child.stdout, child.stderr]) stream.on('data', (text) => { proxy.log += text; });
    const answers = async () => {
      while (child.exitCode === null) {
        const socket = net.connect({ port, host: '127.0.0.1' });
        const open = await new Promise((resolve) => { socket.on('connect', () => resolve(true)).on('error', () => resolve(false)); });
        socket.destroy();
        if (open) return true;
      }
      return false;
    };
    if (await within(answers(), `${program} to listen`)) return proxy;
    assert.ok(attempt < 4, `${program}: ${proxy.log}`);
  }
}

/** Sends one request. Resolves to {status, headers, body}. */
function request(port, target, { method = 'GET', headers = {}, body, token = daemon.token } = {}) {
  return within(new Promise((resolve, reject) => {
    const all = token ? { Authorization: `Bearer ${token}`, ...headers } : headers;
    const sent = https.request({ port, host: '127.0.0.1', path: target, method, ca, headers: all, agent: false }, (answer) => {
      const parts = [];
      answer.on('data', (part) => parts.push(part)).on('error', reject)
        .on('end', () => resolve({ status: answer.statusCode, headers: answer.headers, body: Buffer.concat(parts) }));
    });
    sent.on('error', reject);
    sent.end(body);
  }), `an answer to ${method} ${target}`);
}

const json = (body) => ({ method: 'POST', body: JSON.stringify(body), headers: { 'Content-Type': 'application/json' } });
/** The path of a Location, which is relative to the path of the request. */
const resolve = (location, target) => new URL(location, `https://x${target}`).pathname;

for (const [name, configure] of [['nginx', nginx], ['haproxy', haproxy]]) {
  describe(name, () => {
    let proxy;
    before(async () => { proxy = await start(`/usr/sbin/${name}`, configure); });
    after(async () => {
      proxy.child.kill('SIGTERM');
      await within(proxy.ended, `the end of ${name}`);
    });

    test('the page and its parts are below the prefix', async () => {
      const moved = await request(proxy.port, '/volumes', { token: null });
      assert.equal(moved.status, 308);
      assert.equal(resolve(moved.headers.location, '/volumes'), '/volumes/');
      const page = await request(proxy.port, '/volumes/', { token: null });
      assert.equal(page.status, 200);
      const parts = [...String(page.body).matchAll(/(?:src|href)="([^"#:]+)"/g)].map(([, part]) => resolve(part, '/volumes/'));
      assert.ok(parts.some((part) => part.endsWith('.js')), String(page.body).slice(0, 500));
      for (const part of parts) {
        assert.match(part, /^\/volumes\//);
        assert.equal((await request(proxy.port, part, { token: null })).status, 200, part);
      }
      assert.equal((await request(proxy.port, '/healthz')).status, 404);
    });

    test('requests, tokens and addresses in answers work below the prefix', async () => {
      assert.equal((await request(proxy.port, '/volumes/api/v1/volumes', { token: null })).status, 401);
      assert.equal((await request(proxy.port, `/volumes/api/v1/volumes?token=${daemon.token}`, { token: null })).status, 200);
      const created = await request(proxy.port, '/volumes/api/v1/views', json({ volume: 'engine', size: [32, 32] }));
      assert.equal(created.status, 201);
      const view = resolve(created.headers.location, '/volumes/api/v1/views');
      assert.match(view, /^\/volumes\/api\/v1\/views\//);
      assert.equal((await request(proxy.port, view)).status, 200);
      const image = await request(proxy.port, '/volumes/api/v1/render?format=png', json({ volume: 'engine', size: [32, 32] }));
      assert.equal(image.status, 200);
      assert.equal(image.body.toString('latin1', 1, 4), 'PNG');
    });

    test('a file is uploaded, larger than what proxies take by default', async () => {
      const side = 130;
      const file = Buffer.concat([Buffer.from(`NRRD0004\ntype: uint8\ndimension: 3\nsizes: ${side} ${side} ${side}\nencoding: raw\n\n`), Buffer.alloc(side ** 3, 7)]);
      const created = await request(proxy.port, '/volumes/api/v1/uploads', { method: 'POST',
        headers: { 'Tus-Resumable': '1.0.0', 'Upload-Length': file.length, 'Upload-Metadata': `filename ${Buffer.from(`${name}.nrrd`).toString('base64')}` } });
      assert.equal(created.status, 201);
      const upload = resolve(created.headers.location, '/volumes/api/v1/uploads');
      assert.match(upload, /^\/volumes\/api\/v1\/uploads\//);
      for (const [from, to] of [[0, 1000], [1000, file.length]]) {
        const answer = await request(proxy.port, upload, { method: 'PATCH', body: file.subarray(from, to),
          headers: { 'Tus-Resumable': '1.0.0', 'Content-Type': 'application/offset+octet-stream', 'Upload-Offset': from } });
        assert.equal(answer.status, 204);
        assert.equal(answer.headers['upload-offset'], String(to));
      }
      const loading = await request(proxy.port, '/volumes/api/v1/volumes', json({ upload: path.basename(upload) }));
      assert.equal(loading.status, 202);
      assert.match(resolve(loading.headers.location, '/volumes/api/v1/volumes'), /^\/volumes\/api\/v1\/volumes\//);
      assert.deepEqual((await daemon.loaded(JSON.parse(loading.body).id)).dims, [side, side, side]);
    });

    test('streams open from the page of the proxy only, and send frames', async () => {
      const session = JSON.parse((await request(proxy.port, '/volumes/api/v1/sessions', json({ view: { volume: 'engine' } }))).body);
      const url = `wss://127.0.0.1:${proxy.port}/volumes/api/v1/sessions/${session.id}/stream?token=${session.tokens.control}`;
      const stream = await Stream.open(url, { session, ca, origin: `https://127.0.0.1:${proxy.port}` });
      await stream.update({ background: [1, 0, 0, 1] }, 1);
      await stream.final(1);
      await stream.end();
      await assert.rejects(Stream.open(url, { session, ca, origin: 'https://elsewhere.example' }), { status: 403 });
    });

    test('the log of the proxy has the requests, and no tokens', async () => {
      await request(proxy.port, `/volumes/api/v1/presets?token=${daemon.token}`, { token: null });
      const log = () => (name === 'nginx' ? readFileSync(path.join(folder, 'nginx-requests.log'), 'utf8') : proxy.log);
      const written = async () => { while (!log().includes('/volumes/api/v1/presets')) await new Promise((next) => { setImmediate(next); }); };
      await within(written(), 'the line of the log');
      assert.ok(!log().includes(daemon.token));
    });
  });
}
