// SPDX-License-Identifier: Apache-2.0
// Clients that do not read: the frames that wait for them are memory of frames (--render-bytes), and only their owner's share of it.
import assert from 'node:assert/strict';
import { randomBytes } from 'node:crypto';
import fs from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { after, before, test } from 'node:test';
import { compare } from '../support/compare.mjs';
import { clientFrame, Daemon, decodeFrame, FINAL, Raw, within } from './harness.mjs';

const MIB = 2 ** 20;
const LIMIT = 48 * MIB;
const POOL = LIMIT / 2 / 4; // sessions have a half, and frames that wait a quarter of it
const SHARE = POOL * 3 / 4 * 3 / 4; // of one owner's guests
const FRAME = 400e3; // at least; the system's buffers take a part
const SIDE = 512;
const LOSSLESS = { lossless: true, progressive: false };
const send = (raw, method, params) => raw.write(clientFrame(1, JSON.stringify({ jsonrpc: '2.0', method, params })));
const TOKENS = { root: 'root-root-root-root', greedy: 'greedy-greedy-greedy', modest: 'modest-modest-modest' };
// What the metrics do not count: stacks, pages that the C library keeps, what is cached of the volume.
const TOLERANCE = 12 * MIB;

const folder = fs.mkdtempSync(path.join(tmpdir(), 'splatd-memory-test-'));
let daemon;
before(async () => {
  const [noise, numbers, tokens] = ['noise.nrrd', 'numbers.nrrd', 'tokens'].map((name) => path.join(folder, name));
  fs.writeFileSync(noise, Buffer.concat([Buffer.from('NRRD0004\ntype: uint8\ndimension: 3\nsizes: 48 48 4\nencoding: raw\n\n'), randomBytes(48 * 48 * 4)]));
  fs.writeFileSync(numbers, Buffer.concat([Buffer.from('NRRD0004\ntype: float\ndimension: 3\nsizes: 4 4 4\nendian: little\nencoding: raw\n\n'), Buffer.alloc(4 * 64)]));
  fs.writeFileSync(tokens, `${TOKENS.root} name=root\n${TOKENS.greedy} name=greedy role=control\n${TOKENS.modest} name=modest role=control\n`, { mode: 0o600 });
  daemon = await Daemon.start(['--volume', noise, '--volume', numbers, '--token-file', tokens, '--render-bytes', '48M', '--threads', '2', '--stall-time', '600', '--ping-time', '600'], { backend: 'cpu' });
  daemon.token = TOKENS.root;
  await daemon.loaded('noise');
  await daemon.loaded('numbers');
});
after(async () => {
  assert.equal(await daemon.stop(), 0);
  fs.rmSync(folder, { recursive: true });
});

const resident = () => Number(/VmRSS:\s+(\d+) kB/.exec(fs.readFileSync(`/proc/${daemon.child.pid}/status`, 'utf8'))[1]) * 1024;

/** Resolves to {answers: bytes of frames that wait for clients or are cached, all: all bytes except voxels}. */
async function counted() {
  const text = await (await daemon.fetch('/metrics')).text();
  const kinds = [...text.matchAll(/^splatd_memory_bytes\{kind="(\w+)"\} (\d+)$/gm)].map(([, kind, bytes]) => [kind, Number(bytes)]);
  return { answers: Object.fromEntries(kinds).answers, all: kinds.reduce((sum, [kind, bytes]) => sum + (kind === 'voxels' ? 0 : bytes), 0) };
}

let made = 0;
async function sessionOf(name, side = SIDE) {
  made += 1; // each session has an image of its own
  const { status, json } = await daemon.post('/api/v1/sessions', { view: { size: [side, side], shading: { mode: 'none' }, camera: { fov_y: 20 + made / 100 } } }, { token: TOKENS[name] });
  assert.equal(status, 201, JSON.stringify(json));
  return json;
}

/** Resolves to the width of the final frame that a client receives, or to the error in its place; token: with which it joins, a guest by default. */
async function finalWidth(name, token) {
  const stream = await daemon.stream({ session: await sessionOf(name), token });
  await stream.call('stream.configure', LOSSLESS);
  const answer = () => stream.frames.find(({ flags }) => flags & FINAL)?.width ?? stream.notes.find(({ method }) => method === 'render.error')?.params.message;
  const width = await stream.until(answer, `a final frame of ${name}, or an error`);
  await stream.end();
  return width;
}

/**
 * Opens at most so many streams of greedy, until `until()` is true, that read until their view is at rest in a small size, then ask for large frames and read
 * no more. Resolves to their connections.
 */
async function stopReading(most, until) {
  const idle = [];
  while (idle.length < most && !until()) {
    const raw = await Raw.webSocket(daemon, await sessionOf('greedy', 32));
    const last = () => raw.frames().filter(({ opcode }) => opcode === 2).map(({ payload }) => decodeFrame(payload)).find(({ flags }) => flags & FINAL);
    const { frame } = await raw.until(() => last() ?? until(), 'a small final frame');
    if (frame) send(raw, 'stream.ack', { frame });
    raw.socket.pause();
    send(raw, 'stream.configure', { ...LOSSLESS, size: [SIDE, SIDE] });
    idle.push(raw);
  }
  return idle;
}

const skip = process.env.SPLATD_SANITIZE && 'sanitizers: it takes minutes';
test('a slice that its client does not read leaves memory for other owners', { skip }, async () => {
  const BYTES = 2048 * 2048 * 4; // more than the share of 9 MiB
  const slice = (side) => `/api/v1/volumes/numbers/slice?format=raw&origin=2,2,2&normal=0,0,1&up=0,1,0&size=${side},${side}&spacing=0.001`;
  const answers = async () => (await counted()).answers;
  const unread = await Raw.connect(daemon.port);
  unread.socket.pause();
  unread.write(`GET ${slice(2048)} HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer ${TOKENS.greedy}\r\n\r\n`);
  await within((async () => { while (await answers() < BYTES); })(), 'the slice');
  assert.equal(await answers(), BYTES, 'no more than its samples have');
  const refused = await daemon.fetch(slice(8), { token: TOKENS.greedy });
  assert.deepEqual([refused.status, refused.headers.get('retry-after')], [429, '1']);
  assert.equal((await refused.json()).detail, `the answer needs 256 bytes; greedy has ${BYTES} bytes of images and slices that were not read, and may have ${BYTES}; read them first`);
  for (const name of ['modest', 'root']) {
    assert.equal((await daemon.fetch(slice(8), { token: TOKENS[name] })).status, 200, name);
    const image = { method: 'POST', body: '{"volume":"noise","size":[64,64]}', headers: { 'Content-Type': 'application/json' }, token: TOKENS[name] };
    assert.equal((await daemon.fetch('/api/v1/render', image)).status, 200, name);
  }
  unread.destroy();
  await within((async () => { while ((await daemon.fetch(slice(8), { token: TOKENS.greedy })).status !== 200); })(), 'memory that is given back');
});

test('frames that clients do not read take no more than the share of their owner\'s guests', { skip }, async () => {
  const base = resident();
  const refusal = /the encoded frame needs (\d+) bytes; the guests of this session's owner have (\d+) bytes that were not read, and may have (\d+)/;
  const idle = await stopReading(16, () => refusal.test(daemon.log));
  await daemon.untilLogged(refusal);
  const [needed, had, most] = refusal.exec(daemon.log).slice(1).map(Number);
  compare(needed + had, '>', most);
  compare(most, '<=', SHARE);
  const full = await counted();
  compare(full.answers, '>', SHARE / 2);
  compare(full.answers, '<=', SHARE);
  compare(resident(), '<=', base + full.all + TOLERANCE);
  const guest = await finalWidth('greedy');
  assert.ok(guest >= 128 || /the guests of this session's owner have/.test(guest), `a guest of this owner that reads: ${guest}`);
  assert.equal(await finalWidth('greedy', TOKENS.greedy), SIDE, 'the owner');
  assert.equal(await finalWidth('modest'), SIDE, 'a guest of another owner');
  compare((await counted()).answers, '<=', POOL);
  idle.forEach((raw) => raw.destroy());
  await within((async () => { while ((await counted()).all > 0); })(), 'memory that is given back');
  compare(resident(), '<=', base + TOLERANCE);
});

test('frames that clients do not read are counted, and given back when the clients have left', async () => {
  const waiting = async () => (await counted()).answers >= 2 * FRAME; // one alone may be in the frame cache
  const idle = await stopReading(2, () => false);
  await within((async () => { while (!await waiting()); })(), 'two frames that wait');
  assert.equal(await finalWidth('modest'), SIDE);
  idle.forEach((raw) => raw.destroy());
  await within((async () => { while (await waiting()); })(), 'frames that are given back');
});
