// SPDX-License-Identifier: Apache-2.0
// What applies to every response: compression, cross-origin requests, and the limit of requests per connection.
import assert from 'node:assert/strict';
import http from 'node:http';
import { after, before, test } from 'node:test';
import { gunzipSync } from 'node:zlib';
import { compare } from '../support/compare.mjs';
import { Daemon, Raw, Stream, runToEnd } from './harness.mjs';

const PAGE = 'https://viewer.example:8443';
let daemon;
before(async () => {
  daemon = await Daemon.start(['--volume', 'demo:engine?size=16', '--allow-origin', `http://other.example,${PAGE}`,
    '--connection-requests', '5']);
  await daemon.loaded('engine');
});
after(async () => assert.equal(await daemon.stop(), 0));

/** Sends one request. Resolves to {status, headers, body} without decoding the body. */
function ask(target, { method = 'GET', headers = {}, token = daemon.token, body } = {}) {
  return new Promise((resolve, reject) => {
    const all = { ...(token ? { Authorization: `Bearer ${token}` } : {}), ...headers };
    const request = http.request(daemon.base + target, { method, headers: all, agent: false }, (answer) => {
      const parts = [];
      answer.on('data', (part) => parts.push(part));
      answer.on('end', () => resolve({ status: answer.statusCode, headers: answer.headers, body: Buffer.concat(parts) }));
    });
    request.on('error', reject);
    request.end(body);
  });
}

const GZIP = { 'Accept-Encoding': 'br, gzip' };

test('text is compressed for a client that accepts gzip, and decompresses to the same text', async () => {
  for (const target of ['/api/v1/volumes/engine/view', '/api/v1/openapi.yaml', '/api/v1/view.schema.json', '/', '/app/chunks/page.js']) {
    const plain = await ask(target);
    assert.equal(plain.headers['content-encoding'], undefined);
    assert.match(plain.headers.vary ?? '', /Accept-Encoding/, target);
    const packed = await ask(target, { headers: GZIP });
    assert.equal(packed.headers['content-encoding'], 'gzip', target);
    assert.equal(packed.headers['content-type'], plain.headers['content-type']);
    compare(packed.body.length, '<', plain.body.length * 0.6, `${target}: ${packed.body.length} of ${plain.body.length}`);
    assert.equal(Number(packed.headers['content-length']), packed.body.length);
    assert.ok(gunzipSync(packed.body).equals(plain.body), target);
    const head = await ask(target, { method: 'HEAD', headers: GZIP });
    assert.deepEqual([head.headers['content-length'], head.headers['content-encoding']], [String(packed.body.length), 'gzip']);
  }
});

test('responses stay uncompressed without Accept-Encoding: gzip, when they are short, and when they are images', async () => {
  for (const accepted of ['gzip;q=0', 'identity', 'br', '']) {
    const answer = await ask('/api/v1/openapi.yaml', { headers: { 'Accept-Encoding': accepted } });
    assert.equal(answer.headers['content-encoding'], undefined, accepted);
  }
  assert.equal((await ask('/healthz', { headers: GZIP })).headers['content-encoding'], undefined);
  const image = await ask('/api/v1/render?format=png', {
    method: 'POST', headers: { ...GZIP, 'Content-Type': 'application/json' }, body: '{"size":[256,256]}' });
  assert.equal(image.headers['content-encoding'], undefined);
});

test('a compressed response has a weak ETag, which still gives a 304', async () => {
  const saved = await ask('/api/v1/views', { method: 'POST', headers: { 'Content-Type': 'application/json' }, body: '{}' });
  for (const target of ['/', `/api/v1/views/${JSON.parse(saved.body).id}`]) {
    const plain = await ask(target);
    const packed = await ask(target, { headers: GZIP });
    assert.equal(packed.headers.etag, `W/${plain.headers.etag}`);
    for (const etag of [plain.headers.etag, packed.headers.etag]) {
      const known = await ask(target, { headers: { ...GZIP, 'If-None-Match': etag } });
      assert.deepEqual([known.status, known.headers.etag, known.headers.vary, known.headers['cache-control'], known.body.length],
        [304, packed.headers.etag, packed.headers.vary, packed.headers['cache-control'], 0]);
    }
  }
});

test('repeated header lines are joined into one list, and a request target may be an absolute URL', async () => {
  const lines = async (target, headers) => {
    const raw = await Raw.connect(daemon.port);
    const all = ['Host: x', `Authorization: Bearer ${daemon.token}`, 'Connection: close', ...headers];
    raw.write(`GET ${target} HTTP/1.1\r\n${all.join('\r\n')}\r\n\r\n`);
    await raw.until(() => raw.ended, 'the end of the connection');
    return raw.text();
  };
  const { etag } = (await ask('/')).headers;
  assert.match(await lines('/', ['If-None-Match: "x"', `if-none-match: ${etag}`]), /^HTTP\/1.1 304/);
  assert.match(await lines('/', ['If-None-Match: "x"', 'If-None-Match: "y"', 'Accept-Encoding: br', 'Accept-Encoding: gzip']),
    /^HTTP\/1.1 200[^]*content-encoding: gzip/i);
  assert.match(await lines('/healthz', [`Authorization: Bearer x`]), /^HTTP\/1.1 200/);
  assert.match(await lines('/api/v1/volumes', [`Authorization: Bearer x`]), /^HTTP\/1.1 401/, 'two Authorization headers count as no token');
  assert.match(await lines(`${daemon.base}/healthz`, []), /^HTTP\/1.1 200/);
  assert.match(await lines('http://x', []), /^HTTP\/1.1 200[^]*text\/html/i);
  assert.match(await lines(`http://x/api/v1/volumes/none?token=${daemon.token}`, []), /^HTTP\/1.1 404[^]*none/);
});

test('a page of an allowed origin may send requests and read responses, but needs a token', async () => {
  const preflight = (Origin, target = '/api/v1/sessions', method = 'POST') => ask(target, {
    method: 'OPTIONS', token: null, headers: { Origin, 'Access-Control-Request-Method': method, 'Access-Control-Request-Headers': 'authorization, content-type' } });
  const allowed = await preflight(PAGE);
  assert.equal(allowed.status, 204);
  assert.equal(allowed.headers['access-control-allow-origin'], PAGE);
  assert.match(allowed.headers['access-control-allow-methods'], /\bPOST\b/);
  for (const name of ['Authorization', 'Content-Type', 'If-None-Match']) assert.match(allowed.headers['access-control-allow-headers'], new RegExp(name));
  assert.equal(allowed.headers['access-control-allow-credentials'], undefined);
  assert.match(allowed.headers.vary, /Origin/);
  assert.match((await preflight(PAGE, '/api/v1/volumes/engine', 'DELETE')).headers['access-control-allow-methods'], /DELETE/);
  const answer = await ask('/api/v1/volumes', { headers: { Origin: PAGE } });
  assert.equal(answer.headers['access-control-allow-origin'], PAGE);
  assert.match(answer.headers['access-control-expose-headers'], /ETag/);
  const denied = await ask('/api/v1/volumes', { headers: { Origin: PAGE }, token: null });
  assert.deepEqual([denied.status, denied.headers['access-control-allow-origin']], [401, PAGE], 'the page may read the reason of the refusal');
});

test('other origins get no CORS headers', async () => {
  for (const Origin of ['https://viewer.example', 'http://viewer.example:8443', 'https://evil.example', `${PAGE}.evil`, 'null', `${PAGE},http://other.example`]) {
    const preflight = await ask('/api/v1/volumes', { method: 'OPTIONS', token: null, headers: { Origin, 'Access-Control-Request-Method': 'GET' } });
    assert.deepEqual([preflight.status, preflight.headers['access-control-allow-origin']], [401, undefined], Origin);
    const answer = await ask('/api/v1/volumes', { headers: { Origin } });
    assert.deepEqual([answer.status, answer.headers['access-control-allow-origin']], [200, undefined]);
    assert.match(answer.headers.vary, /Origin/);
  }
  const session = await daemon.session();
  await assert.rejects(Stream.open(daemon.streamUrl(session), { origin: 'https://evil.example' }), { status: 403 });
  const stream = await Stream.open(daemon.streamUrl(session), { origin: PAGE });
  await stream.final(0);
  await stream.end();
});

test('no origin is allowed by default, and an invalid --allow-origin is refused at start-up', async () => {
  const closed = await Daemon.start(['--volume', 'demo:engine?size=16']);
  const answer = await closed.fetch('/healthz', { headers: { Origin: PAGE } });
  assert.equal(answer.headers.get('access-control-allow-origin'), null);
  assert.match((await closed.fetch('/')).headers.get('content-security-policy'), /frame-ancestors 'none'$/);
  assert.equal(await closed.stop(), 0);
  for (const list of ['*', 'viewer.example', 'https://a/', 'https://a, https://b']) {
    const { status, err } = await runToEnd(['--listen', '127.0.0.1:0', '--backend', 'null', '--allow-origin', list]);
    assert.notEqual(status, 0, list);
    assert.match(err, /--allow-origin: .*is not an origin/);
  }
  const long = Array.from({ length: 36 }, (_, i) => `https://viewer${i}.example`).join(',');
  assert.match((await runToEnd(['--listen', '127.0.0.1:0', '--backend', 'null', '--allow-origin', long])).err, /--allow-origin: the list has 8\d\d characters and may have 700/);
});

test('pages of the origins that --allow-origin lists may frame the page', async () => {
  assert.match((await daemon.fetch('/')).headers.get('content-security-policy'), new RegExp(`frame-ancestors http://other.example ${PAGE}`));
});

test('a connection serves up to --connection-requests requests, pipelined or not; its last response says Connection: close', async () => {
  const one = `GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n`;
  const all = await Raw.connect(daemon.port);
  all.write(one.repeat(8));
  await all.until(() => all.ended, 'the end of the connection');
  const answers = all.text().split('HTTP/1.1 ').slice(1);
  assert.equal(answers.length, 5, 'at most --connection-requests responses');
  answers.forEach((answer, i) => {
    assert.match(answer, /^200 /);
    assert.equal(/Connection: close/i.test(answer), i === 4, `response ${i}`);
  });
  const slow = await Raw.connect(daemon.port);
  for (let i = 1; i <= 5; i++) {
    slow.write(one);
    await slow.until(() => slow.text().split('HTTP/1.1 200').length === i + 1, `response ${i}`);
  }
  await slow.until(() => slow.ended, 'the end of the connection');
  const old = await Raw.connect(daemon.port);
  old.write('GET /healthz HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n');
  await old.until(() => old.ended, 'the end of the connection that the client requested');
  assert.match(old.text(), /^HTTP\/1.1 200/);
});
