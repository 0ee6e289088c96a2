// SPDX-License-Identifier: Apache-2.0
// Streams: view updates, frames, flow control and roles.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { startProxy } from '../bench/serve/proxy.mjs';
import { compare } from '../support/compare.mjs';
import { Daemon, FINAL, LOSSLESS, Stream, turned } from './harness.mjs';

let daemon;
before(async () => {
  daemon = await Daemon.start(['--volume', 'demo:engine?size=32', '--volume', 'demo:phantom?size=24', '--stall-time', '300']);
  await daemon.loaded('engine');
  await daemon.loaded('phantom');
});
after(async () => assert.equal(await daemon.stop(), 0));

test('a joining client gets a first frame, then one of final quality at full size', async () => {
  const stream = await daemon.stream();
  const final = await stream.final(0);
  assert.deepEqual([final.width, final.height], [512, 512]);
  assert.equal(final.codec, 1);
  assert.equal(final.payload.readUInt16BE(0), 0xffd8);
  assert.equal(stream.frames[0].frame, 1);
  assert.ok(stream.frames.every((f, i) => f.frame === i + 1), 'frames are numbered without gaps');
  const stats = await stream.note('stream.stats');
  assert.equal(stats.params.backend, 'null');
  await stream.end();
});

test('an update is answered, shown in a frame with its seq, and refined', async () => {
  const stream = await daemon.stream();
  assert.deepEqual(await stream.update({ background: [1, 0, 0, 1] }, 7), { seq: 7 });
  await stream.frame((f) => f.seq === 7, 'a frame of seq 7');
  await stream.final(7);
  const { view, seq } = await stream.call('view.get');
  assert.deepEqual(view.background, [1, 0, 0, 1]);
  assert.equal(seq, 7);
  await stream.end();
});

test('after a burst of updates the last frame shows the last view, and some updates get no frame of their own', async () => {
  const stream = await daemon.stream();
  const answers = [];
  const count = 400;
  for (let i = 1; i <= count; i++) answers.push(stream.update(turned(stream.session.view, i), i));
  await Promise.all(answers);
  await stream.final(count);
  const last = stream.frames.at(-1);
  assert.equal(last.seq, count);
  compare(stream.frames.length, '<', count / 2, `${stream.frames.length} frames for ${count} updates`);
  const order = stream.frames.map((f) => f.seq);
  assert.deepEqual(order, [...order].sort((a, b) => a - b), 'never an older view after a newer one');
  await stream.end();
});

test('frames keep arriving during a long drag', async () => {
  const stream = await daemon.stream();
  // Update as fast as answers arrive, so that a newer view is always pending, until enough frames have arrived.
  let seq = 0;
  while (stream.frames.length < 12) {
    seq += 1;
    await stream.update(turned(stream.session.view, seq), seq);
  }
  await stream.final(seq);
  await stream.end();
});

test('vectors play without messages of the client, for all participants, until they are stopped', async () => {
  assert.equal((await daemon.post('/api/v1/volumes', { uri: 'demo:tornado?size=16', id: 'tornado' })).status, 202);
  await daemon.loaded('tornado');
  const session = await daemon.session({ volume: 'tornado', layers: [{ type: 'vectors' }], size: [64, 64] });
  const stream = await daemon.stream({ session });
  const guest = await daemon.stream({ session });
  await stream.final(0);
  await assert.rejects(stream.call('time.play', { rate: 0 }), /periods per second/);
  assert.deepEqual(await stream.call('time.play', { rate: 2 }), { rate: 2, steps: 0, step: 0, count: 1, loading: false });
  assert.equal((await guest.note('time.changed')).params.rate, 2);
  for (const one of [stream, guest]) {
    const first = one.frames.length;
    await one.frame((f) => f.frame > first + 5, 'frames while the vectors move');
  }
  assert.equal((await stream.call('time.stop')).rate, 0);
  const { view } = await stream.call('view.get');
  assert.ok(view.layers[0].phase >= 0 && view.layers[0].phase <= 1);
  await stream.frame((f) => f.flags & FINAL && f === stream.frames.at(-1), 'a final frame after the stop');
  await stream.end();
  await guest.end();
});

test('a newer view cancels the refinement of an older one and is shown next', async () => {
  const own = await Daemon.start(['--volume', 'demo:engine?size=32', '--log-level', 'debug', '--rest-time', '0.01',
    '--frame-size', '6000x6000']);
  await own.loaded('engine');
  const stream = await own.stream();
  await stream.call('stream.configure', { size: [6000, 6000] });
  const begun = () => own.log.split('begins').length - 1;
  const cancelled = () => own.log.split('refinement cancelled').length - 1;
  // The test card needs long for 36 million pixels. A refinement that ends before its update arrives proves nothing: try the
  // next one. Each refinement has a deadline, and so has their number.
  const ATTEMPTS = 50;
  let seq = 0;
  let seen = 0;
  while (cancelled() === 0 && seq < ATTEMPTS) {
    await own.until(() => begun() > seen, 'a refinement to start');
    seen = begun();
    seq += 1;
    await stream.update(turned(stream.session.view, seq), seq);
    await stream.frame((f) => f.seq === seq, `a frame of seq ${seq}`);
  }
  await own.until(() => cancelled() > 0, `one of ${seq} refinements to be cancelled`);
  const order = stream.frames.map((f) => f.seq);
  assert.deepEqual(order, [...order].sort((a, b) => a - b), 'never an older view after a newer one');
  const final = await stream.final(seq);
  assert.deepEqual([final.width, final.height], [6000, 6000]);
  await stream.end();
  assert.equal(await own.stop(), 0);
});

test('a client that withholds acknowledgements gets two frames, and other clients continue', async () => {
  const session = await daemon.session();
  const stalled = await daemon.stream({ session, acks: false });
  const lively = await daemon.stream({ session });
  for (let i = 1; i <= 60; i++) {
    await lively.update(turned(session.view, i), i);
    await lively.frame((f) => f.seq >= i, `a frame of ${i}`);
  }
  await lively.final(60);
  // The answer arrives after everything that was sent before it.
  await stalled.call('ping');
  assert.equal(stalled.frames.length, 2);
  stalled.acks = true;
  stalled.ack(2);
  const last = await stalled.frame((f) => f.flags & FINAL, 'the final frame', 2);
  assert.equal(last.seq, 0, 'this client sent no update');
  await Promise.all([stalled.end(), lively.end()]);
});

test('the frames on the way to a distant client fill its round trip', async (t) => {
  const proxy = await startProxy(daemon.port, { rttMs: 400 });
  t.after(() => proxy.close());
  const session = await daemon.session();
  const stream = await Stream.open(daemon.streamUrl(session).replace(/:\d+\//, `:${proxy.port}/`), { session });
  await stream.call('stream.configure', { max_fps: 120, progressive: false, size: [16, 16] });
  let seq = 0;
  const before = new Map(); // frames that had arrived when an update was sent, by seq
  const drag = setInterval(() => {
    seq += 1;
    before.set(seq, stream.frames.length);
    stream.notify('view.update', { seq, patch: turned(session.view, seq) });
  }, 8);
  t.after(() => clearInterval(drag));
  // While an update is on its way there and its frame back, frames of earlier updates arrive.
  await stream.frame((frame, at) => frame.seq > 0 && at - before.get(frame.seq) > 8, 'frames on their way');
  clearInterval(drag);
  const { rtt_ms: rtt } = (await stream.note('stream.stats', (stats) => stats.rtt_ms > 0)).params;
  compare(rtt, '>=', 400);
  await stream.end();
});

test('two clients of the same size share an image, and each gets its own seq', async () => {
  const session = await daemon.session();
  const [a, b] = await Promise.all([daemon.stream({ session }), daemon.stream({ session })]);
  await a.update({ background: [0, 1, 0, 1] }, 41);
  await a.call('session.release_control');
  await b.update({ background: [0, 0, 1, 1] }, 17);
  const [x, y] = await Promise.all([
    a.frame((f) => (f.flags & FINAL) && f.seq === 41 && a.notes.some((n) => n.method === 'view.changed' && n.params.view.background[2] === 1), 'a final'),
    b.final(17)]);
  assert.ok(x);
  assert.ok(y);
  // The last final frames of both clients are equal byte for byte.
  const lastOf = (s) => s.frames.filter((f) => f.flags & FINAL).at(-1);
  await a.until(() => lastOf(a).payload.equals(lastOf(b).payload), 'the same image');
  await Promise.all([a.end(), b.end()]);
});

test('a client with the view token receives frames and notifications, and may not change the view', async () => {
  const session = await daemon.session();
  const control = await daemon.stream({ session });
  const viewer = await daemon.stream({ session, token: session.tokens.view });
  const list = await control.note('session.participants', (p) => p.participants.length === 2);
  assert.deepEqual(list.params.participants.map((p) => p.role).sort(), ['control', 'view']);
  await assert.rejects(viewer.update({ background: [1, 1, 1, 1] }), { code: -32004 });
  await control.update({ background: [1, 1, 0, 1] }, 3);
  const changed = await viewer.note('view.changed', (p) => p.view.background[1] === 1);
  compare(changed.params.by, '>', 0);
  await viewer.frame((f) => f.flags & FINAL, 'a frame for the viewer');
  await viewer.end();
  await control.note('session.participants', (p) => p.participants.length === 1);
  await control.end();
});

test('stream.configure grants format, quality, size and lossless, and remembers them', async () => {
  const stream = await daemon.stream();
  const { formats, ...granted } = await stream.call('stream.configure', { size: [96, 64], quality: 75, max_fps: 60 });
  for (const format of ['jpeg', 'png', 'webp']) assert.ok(formats.includes(format), format);
  assert.deepEqual(granted, { format: 'jpeg', quality: 75, subsampling: 'auto', max_fps: 60, size: [96, 64], progressive: true, lossless: false, depth: false, predict: 0, name: 'Guest 1' });
  await stream.frame((f) => (f.flags & FINAL) && f.width === 96 && f.height === 64, 'a final frame of 96 by 64');
  await stream.call('stream.configure', { lossless: true });
  const png = await stream.frame((f) => f.flags & LOSSLESS, 'a lossless frame');
  assert.equal(png.codec, 2);
  assert.ok(png.flags & FINAL);
  assert.equal(png.payload.toString('latin1', 1, 4), 'PNG');
  const from = stream.frames.length;
  await stream.call('stream.configure', { lossless: false, format: 'webp' });
  const webp = await stream.frame((f) => f.codec === 3, 'a WebP frame', from);
  assert.equal(webp.payload.toString('latin1', 0, 4), 'RIFF');
  for (const [params, pointer] of [[{ quality: 0 }, '/quality'], [{ quality: 50.5 }, '/quality'], [{ max_fps: 121 }, '/max_fps'],
    [{ size: [0, 5] }, '/size'], [{ size: [1, 2, 3] }, '/size'], [{ format: 'exr' }, '/format'], [{ progressive: 1 }, '/progressive']]) {
    await assert.rejects(stream.call('stream.configure', params), { code: -32602, data: { pointer } });
  }
  await assert.rejects(stream.call('stream.configure', { fps: 3 }), { code: -32602 });
  await stream.end();
});

/** Returns the sampling factors of the first component of a JPEG: [horizontal, vertical]. */
function factors(jpeg) {
  for (let i = 2; i + 12 < jpeg.length; i += 2 + jpeg.readUInt16BE(i + 2))
    if (jpeg[i] === 0xff && (jpeg[i + 1] === 0xc0 || jpeg[i + 1] === 0xc2)) return [jpeg[i + 11] >> 4, jpeg[i + 11] & 15];
  return null;
}

test('JPEG chroma subsampling follows the request of the client, over streams and HTTP', async () => {
  const stream = await daemon.stream();
  const CASES = [['4:4:4', [1, 1]], ['4:2:2', [2, 1]], ['4:2:0', [2, 2]], ['auto', [1, 1]]];
  for (const [subsampling, expected] of CASES) {
    const from = stream.frames.length;
    const granted = await stream.call('stream.configure', { quality: 90, subsampling });
    assert.equal(granted.subsampling, subsampling);
    const frame = await stream.frame((f) => f.flags & FINAL && `${factors(f.payload)}` === `${expected}`, subsampling, from);
    assert.equal(frame.codec, 1);
    const policy = await stream.note('stream.policy', ({ final }) => final.subsampling === `4:${expected[0] === 1 ? '4:4' : expected[1] === 1 ? '2:2' : '2:0'}`);
    assert.ok(policy.params.moving.subsampling);
    const snapshot = await daemon.fetch(`/api/v1/render?quality=90&subsampling=${subsampling}`, { method: 'POST', body: '{}', headers: { 'Content-Type': 'application/json' } });
    assert.deepEqual(factors(Buffer.from(await snapshot.arrayBuffer())), expected);
  }
  const etag = async (query) => (await daemon.fetch(`/api/v1/render?${query}`, { method: 'POST', body: '{}', headers: { 'Content-Type': 'application/json' } })).headers.get('ETag');
  assert.equal(await etag('subsampling=auto'), await etag('subsampling=4:4:4'));
  assert.notEqual(await etag('subsampling=auto'), await etag('subsampling=4:2:0'));
  assert.equal(await etag('format=png&subsampling=4:2:2'), await etag('format=png'));
  await assert.rejects(stream.call('stream.configure', { subsampling: '4:1:1' }), (e) => e.data.pointer === '/subsampling');
  assert.equal((await daemon.post('/api/v1/render?subsampling=none', {})).status, 400);
  await stream.end();
});

test('invalid updates change nothing and are refused with a JSON pointer', async () => {
  const stream = await daemon.stream();
  const before = (await stream.call('view.get')).view;
  await assert.rejects(stream.update({ camera: { fov_y: 500 } }), (e) => e.code === -32000 && e.data.pointer === '/camera/fov_y');
  await assert.rejects(stream.update({ colour: 1 }), (e) => e.code === -32000 && e.data.pointer === '/colour');
  await assert.rejects(stream.update({ volume: 'nope' }), { code: -32002 });
  await assert.rejects(stream.call('view.update', { seq: -1, patch: {} }), { code: -32602 });
  await assert.rejects(stream.call('view.update', { seq: 1 }), { code: -32602 });
  await assert.rejects(stream.call('view.explode'), { code: -32601 });
  stream.send('{"jsonrpc": "2.0", ');
  const parse = await stream.until(() => stream.notes.find((n) => n.id === null && n.error), 'an error without id');
  assert.equal(parse.error.code, -32700);
  stream.send('[]');
  await stream.until(() => stream.notes.find((n) => n.error?.code === -32600), 'an error of the request');
  assert.deepEqual((await stream.call('view.get')).view, before);
  await stream.end();
});

test('a patch with another volume starts from the default view of that volume, but keeps size and background', async () => {
  const stream = await daemon.stream();
  await stream.update({ background: [0.5, 0.25, 1, 1], size: [100, 80], camera: { fov_y: 77 } });
  await stream.update({ volume: 'phantom' }, 9);
  const { view } = await stream.call('view.get');
  const { json: fresh } = await daemon.json('/api/v1/volumes/phantom/view');
  assert.deepEqual(view, { ...fresh, background: [0.5, 0.25, 1, 1], size: [100, 80] });
  await stream.final(9);
  await stream.end();
});

test('a client that reconnects finds the view unchanged', async () => {
  const first = await daemon.stream();
  await first.update({ background: [0.25, 0.5, 0.75, 1] }, 5);
  await first.final(5);
  first.socket.terminate();
  const second = await daemon.stream({ session: first.session });
  assert.deepEqual((await second.call('view.get')).view.background, [0.25, 0.5, 0.75, 1]);
  await second.final(0);
  await second.end();
});

test('PATCH changes the view of a session for all participants, DELETE closes their streams', async () => {
  const stream = await daemon.stream();
  const path = `/api/v1/sessions/${stream.session.id}`;
  const { status } = await daemon.json(path, {
    method: 'PATCH', body: '{"view": {"background": [1, 0, 1, 1]}}', headers: { 'Content-Type': 'application/json' },
  });
  assert.equal(status, 200);
  const note = await stream.note('view.changed', (p) => p.view.background[2] === 1 && p.view.background[0] === 1);
  assert.equal(note.params.by, 0);
  const gone = await daemon.fetch(path, { method: 'DELETE' });
  assert.equal(gone.status, 204);
  const { code, reason } = await stream.until(() => stream.closed, 'the close');
  assert.equal(code, 1000);
  assert.match(reason, /deleted/);
  assert.equal((await daemon.fetch(path)).status, 404);
});

test('connected clients are notified while a volume loads', async () => {
  const stream = await daemon.stream();
  await daemon.post('/api/v1/volumes', { uri: 'demo:checkerboard?size=16', id: 'squares' });
  await stream.note('volume.progress', (p) => p.volume === 'squares' && p.state === 'ready' && p.progress === 1);
  assert.equal((await daemon.fetch('/api/v1/volumes/squares', { method: 'DELETE' })).status, 204);
  await stream.note('volume.progress', (p) => p.volume === 'squares' && p.state === 'unloaded');
  // Clients that connect later are not notified.
  const later = await daemon.stream();
  await daemon.post('/api/v1/volumes', { uri: 'demo:checkerboard?size=16', id: 'others' });
  await later.note('volume.progress', (p) => p.volume === 'others' && p.state === 'ready');
  assert.ok(!later.notes.some((n) => n.params.volume === 'squares'));
  assert.equal((await daemon.fetch('/api/v1/volumes/others', { method: 'DELETE' })).status, 204);
  await Promise.all([stream.end(), later.end()]);
});

test('a stream is refused for a wrong token, no token, an unknown session, another origin or another subprotocol', async () => {
  const session = await daemon.session();
  const refused = (url, options) => assert.rejects(Stream.open(url, options), (e) => e.status === options.status);
  await refused(daemon.streamUrl(session, 'nonsense'), { status: 401 });
  await refused(daemon.streamUrl(session).split('?')[0], { status: 401 });
  await refused(daemon.streamUrl({ id: 'ffffffffffffffff' }, daemon.token), { status: 404 });
  await refused(daemon.streamUrl({ id: 'ffffffffffffffff' }, 'nonsense'), { status: 401 });
  await refused(daemon.streamUrl(session), { status: 403, origin: 'http://evil.example' });
  await refused(daemon.streamUrl(session), { status: 400, protocols: ['splatd.v2'] });
  const own = await Stream.open(daemon.streamUrl(session), { origin: daemon.base });
  assert.equal(own.socket.protocol, 'splatd.v1');
  await own.end();
});
