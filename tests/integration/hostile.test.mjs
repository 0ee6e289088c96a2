// SPDX-License-Identifier: Apache-2.0
// Clients that vanish, stall or send invalid data. Each test ends with a check that a well-behaved client is served.
import assert from 'node:assert/strict';
import { spawn } from 'node:child_process';
import { once } from 'node:events';
import { after, before, test } from 'node:test';
import { fileURLToPath } from 'node:url';
import { compare } from '../support/compare.mjs';
import { clientFrame, Daemon, Raw, within } from './harness.mjs';

let daemon;
before(async () => {
  daemon = await Daemon.start(['--volume', 'demo:engine?size=32', '--message-size', '64K', '--header-time', '0.5',
    '--ping-time', '1', '--stall-time', '2', '--connections', '200', '--connections-per-address', '150']);
  await daemon.loaded('engine');
});
after(async () => assert.equal(await daemon.stop(), 0));

async function othersAreServed() {
  const stream = await daemon.stream();
  await stream.update({ background: [1, 0, 0, 1] }, 5);
  await stream.final(5);
  await stream.end();
}

const masked = (text) => clientFrame(1, text);
const ping = (id) => masked(JSON.stringify({ jsonrpc: '2.0', id, method: 'ping' }));

const closeWith = (code, reason = '') => Buffer.concat([Buffer.from([code >> 8, code & 255]), Buffer.from(reason)]);

test('frames that violate the protocol close the connection with the code that the protocol defines', async () => {
  const session = await daemon.session();
  const cases = [
    ...[4, 2, 1, 7].map((rsv) => [`reserved bits ${rsv}`, clientFrame(1, '{}', { rsv }), 1002]),
    ['reserved bits of a ping', clientFrame(9, 'x', { rsv: 1 }), 1002],
    ['not masked', clientFrame(1, '{}', { masked: false }), 1002],
    ...[3, 4, 5, 6, 7, 11, 12, 13, 14, 15].map((opcode) => [`the unknown opcode ${opcode}`, clientFrame(opcode, 'x'), 1002]),
    ['a continuation of nothing', clientFrame(0, 'x'), 1002],
    ['a fragmented ping', clientFrame(9, 'x', { fin: false }), 1002],
    ['a ping over 125 bytes', clientFrame(9, 'x'.repeat(126)), 1002],
    ['a message within a message', Buffer.concat([clientFrame(1, '{', { fin: false }), clientFrame(1, '}')]), 1002],
    ['a continuation behind a whole message', Buffer.concat([clientFrame(1, '{}'), clientFrame(0, 'x')]), 1002],
    ['a fragmented close', clientFrame(8, closeWith(1000), { fin: false }), 1002],
    ['a close over 125 bytes', clientFrame(8, closeWith(1000, 'x'.repeat(124))), 1002],
    ['an overlong form in UTF-8', clientFrame(1, Buffer.from([0xc0, 0xaf])), 1007],
    ['what is beyond U+10FFFF', clientFrame(1, Buffer.from([0xf4, 0x90, 0x80, 0x80])), 1007],
    ['UTF-8 that is cut', clientFrame(1, Buffer.from([0xe2, 0x82])), 1007],
    ['UTF-8 that is wrong across fragments', Buffer.concat([clientFrame(1, Buffer.from([0xe2]), { fin: false }), clientFrame(0, Buffer.from([0x28, 0xa1]))]), 1007],
    ['text that is not UTF-8', clientFrame(1, Buffer.from([0xc3, 0x28])), 1007],
    ['a surrogate in UTF-8', clientFrame(1, Buffer.from([0xed, 0xa0, 0x80])), 1007],
    ['a binary message', clientFrame(2, 'x'), 1003],
    ['a message over the limit', clientFrame(1, 'x'.repeat(65537)), 1009],
    ['fragments over the limit', Buffer.concat([clientFrame(1, 'x'.repeat(40000), { fin: false }), clientFrame(0, 'x'.repeat(40000))]), 1009],
    ['too many fragments', Buffer.concat([clientFrame(1, 'x', { fin: false }), ...Array(1100).fill(clientFrame(0, 'x', { fin: false }))]), 1009],
    ['a close with half a code', clientFrame(8, Buffer.from([3])), 1002],
    ...[0, 999, 1004, 1005, 1006, 1015, 1016, 2999, 5000, 65535].map((code) => [`a close with ${code}`, clientFrame(8, closeWith(code)), 1002]),
    ...[1000, 1001, 1002, 1003, 1007, 1008, 1009, 1010, 1011, 3000, 3999, 4000, 4999].map((code) => [`a close with ${code}`, clientFrame(8, closeWith(code)), code]),
    ['a close with a long reason', clientFrame(8, closeWith(1000, 'é'.repeat(61))), 1000],
  ];
  for (const [what, bytes, code] of cases) {
    const raw = await Raw.webSocket(daemon, session);
    raw.write(bytes);
    assert.equal(await raw.closeCode().catch((error) => error.message), code, what);
    // The server also ends the TCP connection, whatever the client does.
    await raw.until(() => raw.ended, `the end after ${what}`);
    raw.destroy();
  }
  await othersAreServed();
});

test('a false length makes the daemon neither wait nor allocate memory', async () => {
  const raw = await Raw.webSocket(daemon, await daemon.session());
  raw.write(Buffer.from([0x81, 0xff, 0x7f, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 1, 2, 3, 4, 5]));
  assert.equal(await raw.closeCode(), 1009);
  raw.destroy();
  await othersAreServed();
});

test('text that is not a request gets an error answer, and the stream stays open', async () => {
  const raw = await Raw.webSocket(daemon, await daemon.session());
  for (const text of ['', '{', 'null', '[[[[[[[[', '{"jsonrpc":"1.0"}', '{"jsonrpc":"2.0","method":5,"id":1}', '[]', '{"a":1,"a":2}',
    '['.repeat(1000), '"\\ud800"', '1e999', '{"jsonrpc":"2.0","id":[],"method":"ping"}']) raw.write(masked(text));
  raw.write(ping(99));
  await raw.answer(99);
  const errors = raw.frames().filter((f) => f.opcode === 1).map((f) => JSON.parse(String(f.payload))).filter((m) => m.error);
  assert.equal(errors.length, 12);
  assert.ok(errors.every((m) => [-32700, -32600].includes(m.error.code)), JSON.stringify(errors));
  raw.destroy();
});

test('fragmented messages, single bytes and bytes sent before the handshake is answered are read correctly', async () => {
  const session = await daemon.session();
  const raw = await Raw.webSocket(daemon, session, { extra: ping('early') });
  await raw.answer('early');
  const text = JSON.stringify({ jsonrpc: '2.0', id: 'é', method: 'ping' });
  const bytes = Buffer.from(text);
  raw.write(clientFrame(1, bytes.subarray(0, 24), { fin: false }));
  raw.write(clientFrame(9, 'between'));
  for (const [i, byte] of [...bytes.subarray(24)].entries()) {
    raw.write(clientFrame(0, [byte], { fin: i === bytes.length - 25 }));
  }
  await raw.answer('é');
  assert.ok(raw.frames().some((f) => f.opcode === 10 && String(f.payload) === 'between'), 'the ping between two fragments was answered');
  for (const byte of ping('slow')) raw.write(Buffer.from([byte]));
  await raw.answer('slow');
  // Empty fragments, control frames of any size between them, and unsolicited pongs.
  raw.write(clientFrame(1, '', { fin: false }));
  for (const size of [0, 1, 125]) raw.write(clientFrame(9, 'p'.repeat(size)));
  raw.write(clientFrame(10, 'unasked'));
  raw.write(clientFrame(0, text, { fin: false }));
  raw.write(clientFrame(0, ''));
  await raw.until(() => raw.frames().filter((f) => f.opcode === 1 && String(f.payload).includes('"id":"é"')).length === 2, 'a second answer');
  for (const size of [0, 1, 125]) assert.ok(raw.frames().some((f) => f.opcode === 10 && String(f.payload) === 'p'.repeat(size)), `a ping of ${size} bytes was answered`);
  raw.destroy();
});

test('requests sent together with the handshake, more than one read takes, are all answered without further input', async () => {
  const session = await daemon.session();
  const many = Array.from({ length: 300 }, (_, i) => ping(i));
  const raw = await Raw.webSocket(daemon, session, { extra: Buffer.concat(many) });
  for (const i of many.keys()) await raw.answer(i);
  raw.destroy();
  // A client that ends its side while the daemon does not read it is not cut off either. (Answers still queued when the daemon reads the close are dropped.)
  const brief = await Raw.webSocket(daemon, session);
  brief.socket.end(Buffer.concat([...many, clientFrame(8, Buffer.from([0x03, 0xe8]))]));
  assert.equal(await brief.closeCode(), 1000);
  await brief.answer(200);
  brief.destroy();
});

test('two requests with bodies and a stream handshake work when they arrive one byte at a time', async () => {
  const session = await daemon.session();
  const trickle = async (raw, text) => {
    for (const byte of Buffer.from(text)) if (!raw.socket.write(Buffer.from([byte]))) await within(once(raw.socket, 'drain'), 'the socket to drain');
  };
  const raw = await Raw.connect(daemon.port);
  raw.socket.setNoDelay(true);
  const body = JSON.stringify({ size: [16, 16], background: [0, 1, 0, 1] });
  const post = `POST /api/v1/render?format=png HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer ${daemon.token}\r\nContent-Type: application/json\r\n`;
  await trickle(raw, `${post}Content-Length: ${body.length}\r\n\r\n${body}`
    + `${post}Transfer-Encoding: chunked\r\n\r\n5\r\n${body.slice(0, 5)}\r\n${(body.length - 5).toString(16)}\r\n${body.slice(5)}\r\n0\r\n\r\n`);
  await raw.until(() => raw.text().match(/HTTP\/1\.1 200/g)?.length === 2 && raw.text().match(/IEND/g)?.length === 2, 'two images');
  raw.destroy();
  const stream = await Raw.connect(daemon.port);
  stream.socket.setNoDelay(true);
  const target = new URL(daemon.streamUrl(session));
  await trickle(stream, `GET ${target.pathname}${target.search} HTTP/1.1\r\nHost: ${target.host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n`
    + 'Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n');
  await stream.until(() => stream.text().includes('\r\n\r\n'), 'the handshake');
  stream.start = stream.bytes.indexOf('\r\n\r\n') + 4;
  for (const byte of ping('slow')) stream.write(Buffer.from([byte]));
  await stream.answer('slow');
  stream.destroy();
});

test('a client that never reads is dropped, the log names it, and other clients lose no frame', async () => {
  const session = await daemon.session();
  const raw = await Raw.webSocket(daemon, session);
  raw.socket.pause();
  // Request the view repeatedly without reading the answers, until the daemon stops reading.
  const text = masked(JSON.stringify({ jsonrpc: '2.0', id: 1, method: 'view.get' }));
  const flood = Buffer.concat(Array(2000).fill(text));
  for (let i = 0; i < 20 && raw.socket.write(flood); i++);
  raw.socket.on('error', () => {});
  const lively = await daemon.stream({ session });
  for (let i = 1; i <= 20; i++) {
    await lively.update({ background: [i / 20, 0, 0, 1] }, i);
    await lively.frame((f) => f.seq >= i, `frame ${i}`);
  }
  // The size of the kernel's buffers decides which limit applies first.
  const { port } = raw.socket.address();
  await daemon.untilLogged(new RegExp(`stream of 127.0.0.1:${port} (dropped: it took no data for 2.0 s|closed with 1008: slow reader)`));
  raw.destroy();
  await lively.end();
  await othersAreServed();
});

test('a client that reads but never acknowledges is closed with the reason', async () => {
  const stream = await daemon.stream({ acks: false });
  const { code, reason } = await stream.until(() => stream.closed, 'the close');
  assert.equal(code, 1008);
  assert.match(reason, /slow reader.*--stall-time/);
});

test('a silent client is pinged, then dropped', async () => {
  const session = await daemon.session();
  const raw = await Raw.webSocket(daemon, session);
  await raw.until(() => raw.frames().some((f) => f.opcode === 9), 'a ping');
  // Acknowledgements alone would keep a client alive; this client sends nothing.
  await raw.until(() => raw.ended, 'the end');
  raw.destroy();
});

test('a killed client does not disturb other clients', async () => {
  const session = await daemon.session();
  const stream = await daemon.stream({ session });
  const script = `
    import WebSocket from ${JSON.stringify(import.meta.resolve ? String(await import.meta.resolve('ws')) : 'ws')};
    const socket = new WebSocket(${JSON.stringify(daemon.streamUrl(session))}, ['splatd.v1']);
    socket.on('message', (data, isBinary) => {
      if (!isBinary) return;
      socket.send(JSON.stringify({ jsonrpc: '2.0', method: 'stream.ack', params: { frame: data.readUInt32LE(8) } }));
      console.log('frame');
    });`;
  const child = spawn(process.execPath, ['--input-type=module', '-e', script],
    { stdio: ['ignore', 'pipe', 'inherit'], cwd: fileURLToPath(new URL('.', import.meta.url)) });
  await within(once(child.stdout, 'data'), 'the other client to see a frame');
  await stream.note('session.participants', (p) => p.participants.length === 2);
  const from = stream.notes.length;
  child.kill('SIGKILL');
  await stream.until(() => stream.notes.slice(from).some((n) => n.method === 'session.participants' && n.params.participants.length === 1),
    'the notification that the participant left');
  await stream.update({ background: [0, 0, 1, 1] }, 3);
  await stream.final(3);
  await stream.end();
});

const LARGE = JSON.stringify({ volume: 'engine', size: [8192, 8192], filter: { lowpass: 8 } });
const LARGE_REQUEST = (token) => `POST /api/v1/render HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer ${token}\r\n`
  + `Content-Type: application/json\r\nContent-Length: ${LARGE.length}\r\n\r\n${LARGE}`;

test('large images for clients that disconnected are not rendered and delay no other client', async () => {
  const slow = await Daemon.start(['--volume', 'demo:engine?size=64', '--frame-size', '8192x8192'], { backend: 'cpu' });
  await slow.loaded('engine');
  const impatient = [];
  for (let i = 0; i < 4; i += 1) {
    const raw = await Raw.connect(slow.port);
    raw.write(LARGE_REQUEST(slow.token));
    impatient.push(raw);
  }
  // A stream is served while large images are rendered or wait.
  const stream = await slow.stream();
  await stream.update({ background: [1, 0, 0, 1] }, 1);
  await stream.final(1);
  assert.ok(impatient.every((raw) => raw.bytes.length === 0), 'no large image was finished before the stream was served');
  await stream.end();
  const peers = impatient.map((raw) => raw.socket.address().port);
  for (const raw of impatient) raw.destroy();
  for (const port of peers) await slow.untilLogged(`snapshot for 127.0.0.1:${port} not rendered`);
  const { status } = await slow.fetch('/api/v1/render', {
    method: 'POST', body: '{"volume": "engine", "size": [16, 16]}', headers: { 'Content-Type': 'application/json' },
  });
  assert.equal(status, 200);
  assert.equal(await slow.stop(), 0);
});

test('invalid bytes on the port end the connection', async () => {
  const noise = Buffer.from(Array.from({ length: 4096 }, (_, i) => (i * 7919 + 13) & 255));
  for (const bytes of [noise, Buffer.alloc(1000), Buffer.from('\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03', 'latin1'),
    Buffer.from('GET / HTTP/9.9\r\n\r\n'), Buffer.from('GET\r\n\r\n'), Buffer.from(`GET /${'a'.repeat(100000)} HTTP/1.1\r\n\r\n`),
    Buffer.from(`GET / HTTP/1.1\r\nHost: x\r\n${'X-Y: z\r\n'.repeat(20000)}\r\n`),
    Buffer.from('POST /api/v1/render HTTP/1.1\r\nHost: x\r\nContent-Length: -5\r\n\r\n'),
    Buffer.from('POST /api/v1/render HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\nZZZ\r\n')]) {
    const raw = await Raw.connect(daemon.port);
    raw.socket.on('error', () => {});
    raw.write(bytes);
    raw.socket.end();
    await raw.until(() => raw.ended, 'the end');
    assert.ok(!raw.text().startsWith('HTTP/1.1 2') || bytes.includes('HTTP/9.9'), raw.text().slice(0, 100));
    raw.destroy();
  }
  await othersAreServed();
});

test('requests that a proxy could parse differently are refused and end their connection', async () => {
  const post = 'POST /api/v1/render HTTP/1.1\r\n';
  const many = 'a=b&'.repeat(500);
  for (const [text, status, detail] of [
    [`${post}Host: x\r\nContent-Length: 2\r\nContent-Length: 2\r\n\r\n{}`, 400, /Content-Length/],
    [`${post}Host: x\r\nContent-Length: 2\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n`, 400, /Transfer-Encoding/],
    [`${post}Host: x\r\nTransfer-Encoding: gzip\r\n\r\n`, 400, /must be chunked/],
    [`${post}Host: x\r\nTransfer-Encoding: gzip, chunked\r\n\r\n0\r\n\r\n`, 400, /must be chunked/],
    ['GET /healthz HTTP/1.1\r\nHost: x\r\nHost: y\r\n\r\n', 400, /exactly one Host/],
    ['GET /healthz HTTP/1.1\r\n\r\n', 400, /exactly one Host/],
    ...['-5', '+5', 'abc', '0x5', '5, 5', '', '99999999999999999999'].map((size) => [`${post}Host: x\r\nContent-Length: ${size}\r\n\r\n{}`, 400, /Content-Length must be/]),
    // libmicrohttpd has blanks behind a value in the value.
    [`${post}Host: x\r\nContent-Length: 2 \r\n\r\n{}`, 400, /without a blank behind it/],
    [`${post}Host: x\r\nTransfer-Encoding: chunked \r\n\r\n0\r\n\r\n`, 400, /without a blank behind it/],
    [`${post}Host: x\r\nContent-Length : 2\r\n\r\n{}`, 400, /name of a header/],
    [`${post}Host: x\r\nX: a\x01b\r\nContent-Length: 2\r\n\r\n{}`, 400, /control character/],
    ['GET /healthz HTTP/1.1\r\nHost: x\r\nX: a\0b\r\n\r\n', 400, /NUL/],
    ['GET /healthz\0 HTTP/1.1\r\nHost: x\r\n\r\n', 400, /NUL/],
    ['GET /healthz\0?x HTTP/1.1\r\nHost: x\r\n\r\n', 400, /NUL/],
    ['GE\0T /healthz HTTP/1.1\r\nHost: x\r\n\r\n', 400, /NUL/],
    ['GET\0 /healthz HTTP/1.1\r\nHost: x\r\n\r\n', 400, /NUL/],
    ['GET  /healthz HTTP/1.1\r\nHost: x\r\n\r\n', 400, /more than one blank/],
    ['GET /healthz HTTP/1.1\r\nX: a\0b\r\nHost: x\r\n\r\n', 400, /NUL/],
    ['GET /healthz HTTP/1.1\r\nHost: x\0\r\n\r\n', 400, /NUL/],
    [`${post}Host: x\r\nContent-Length: 2\0\r\n\r\n{}`, 400, /NUL/],
    ['GET /healthz HTTP/1.1\r\nHost: x\r\nX: a\r\n b\r\nY: c\r\n\r\n', 400, /continues another/],
    ['GET /healthz HTTP/1.1\r\nHost: x\r\nX: a\r\n\tb\r\n\r\n', 400, /continues another/],
    ['GET /healthz HTTP/1.1\r\nHost: x\r\nX:\r\n \r\n\r\n', 400, /continues another/],
    ['GET /healthz HTTP/1.1\nHost: x\n\n', 400, /CR LF/],
    ['GET /healthz HTTP/1.1\r\nHost: x\r\nX: a\rY: b\r\n\r\n', 400, /control character/],
    ['GET /healthz HTTP/1.1\r\nHost: x\r\nX: a\r\r\n\r\n', 400, /control character/],
    [`GET /healthz HTTP/1.1\r\nHost: x\r\n${'A: b\r\n'.repeat(128)}\r\n`, 431, /more than 128 headers/],
    ['GET /%00 HTTP/1.1\r\nHost: x\r\n\r\n', 400, /%00/],
    [`GET /api/v1/volumes?token=${daemon.token}%00x HTTP/1.1\r\nHost: x\r\n\r\n`, 400, /%00/],
    [`GET /healthz?${many} HTTP/1.1\r\nHost: x\r\n\r\n`, 414, /16/],
    [`DELETE /api/v1/volumes/engine?token=${daemon.token}&${many} HTTP/1.1\r\nHost: x\r\n\r\n`, 414, /16/],
    [`GET /healthz?${'a&'.repeat(10)}${'a'.repeat(29500)} HTTP/1.1\r\nHost: x\r\n\r\n`, 414, /--header-size/]]) {
    const raw = await Raw.connect(daemon.port);
    // The following bytes must not be parsed as a request.
    raw.write(`${text}GET /smuggled HTTP/1.1\r\nHost: x\r\n\r\n`);
    await raw.until(() => raw.ended, `the end after ${text.slice(0, 80)}`);
    const answers = raw.text().match(/^HTTP\/1.1 \d+/gm);
    assert.deepEqual(answers, [`HTTP/1.1 ${status}`], text.slice(0, 80));
    assert.match(raw.text(), detail);
    assert.equal(raw.text().match(/^Content-Type: application\/problem\+json\r$/gm)?.length, 1, text.slice(0, 80));
    raw.destroy();
  }
  const blank = await Raw.connect(daemon.port);
  blank.write(`GET /api/v1/volumes HTTP/1.1\r\nHost: x \r\nAuthorization:\tBearer ${daemon.token} \t \r\nX:\r\nY: \t\r\n\r\n`);
  await blank.until(() => blank.text().startsWith('HTTP/1.1 200'), 'an answer to headers with blanks around their values');
  blank.destroy();
  const raw = await Raw.connect(daemon.port);
  raw.write('GET /healthz HTTP/1.0\r\n\r\n');
  await raw.until(() => raw.text().startsWith('HTTP/1.1 200'), 'an answer to HTTP/1.0 without Host');
  raw.destroy();
  await othersAreServed();
});

test('a client that sends its header one byte at a time is cut off at the deadline', async () => {
  const raw = await Raw.connect(daemon.port);
  const text = `GET /healthz HTTP/1.1\r\nHost: ${'x'.repeat(10000)}`;
  let at = 0;
  const timer = setInterval(() => { if (at < text.length) raw.write(text[at++]); }, 20);
  await raw.until(() => raw.ended, 'the end').finally(() => clearInterval(timer));
  compare(at, '<', text.length);
  raw.destroy();
  await othersAreServed();
});

test('every client over the connection limits gets an answer at once', async () => {
  // 100 concurrent streams of five sessions work; guests have three quarters of the places of a session.
  const session = await daemon.session();
  const sessions = [session, ...await Promise.all(Array.from({ length: 4 }, () => daemon.session()))];
  const streams = await Promise.all(Array.from({ length: 100 }, (_, i) => daemon.stream({ session: sessions[i % 5] })));
  await Promise.all(streams.map((s) => s.frame(() => true, 'a frame')));
  const more = await Promise.all(Array.from({ length: 60 }, () => Raw.connect(daemon.port)));
  for (const raw of more) raw.write('GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n');
  await Promise.all(more.map((raw) => raw.until(() => raw.text().includes('\r\n\r\n'), 'an answer')));
  const refused = more.filter((raw) => raw.text().startsWith('HTTP/1.1 429'));
  compare(refused.length, '>=', 10, `${refused.length} were refused`);
  assert.match(refused[0].text(), /--connections-per-address/);
  assert.match(refused[0].text(), /Retry-After: 1/);
  for (const raw of more) raw.destroy();
  await Promise.all(streams.map((s) => s.end()));
  await othersAreServed();
});

test('silent clients use no more connections than the limit of their address', async (t) => {
  const small = await Daemon.start(['--connections', '40', '--connections-per-address', '4', '--http-threads', '1', '--header-time', '600']);
  const silent = await Promise.all(Array.from({ length: 100 }, () => Raw.connect(small.port)));
  t.after(() => silent.forEach((raw) => raw.destroy()));
  // The daemon keeps 4 connections and 32 more that would receive the refusal.
  let ended = 0;
  const enough = new Promise((resolve) => {
    for (const raw of silent) raw.until(() => raw.ended, 'the end of a silent connection').then(() => ++ended === 64 && resolve(), () => {});
  });
  await within(enough, () => `64 connections to end (${ended} did)`);
  const other = await Raw.connect(small.port, { localAddress: '127.0.0.2' });
  other.write(`GET /metrics HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer ${small.token}\r\nConnection: close\r\n\r\n`);
  await other.until(() => other.ended, 'the metrics');
  assert.match(other.text(), /^HTTP\/1.1 200/);
  assert.match(other.text(), /^splatd_connections_refused_total\{reason="address"\} 64$/m);
  await small.untilLogged('refused: it has 36 connections');
  assert.equal(await small.stop(), 0);
  compare(small.log.match(/refused: it has 36 connections/g).length, '<', 64, 'repeated refusals are summarised in the log');
});
