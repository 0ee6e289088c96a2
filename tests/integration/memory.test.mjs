// SPDX-License-Identifier: Apache-2.0
// The memory of frames (--render-bytes): the process stays below it, says what it has, waits or refuses, and gives it back.
import assert from 'node:assert/strict';
import fs from 'node:fs';
import { after, before, test } from 'node:test';
import { compare } from '../support/compare.mjs';
import { Daemon, FINAL, within } from './harness.mjs';

const MIB = 2 ** 20;
const LIMIT = 48 * MIB;
const HALF = LIMIT / 2;
// What the metrics do not count: stacks, pages that the C library keeps, what is cached of the volume.
const TOLERANCE = process.env.SPLATD_SANITIZE ? Infinity : 12 * MIB; // sanitizers keep what is freed
const [HEAVY, WAITING] = process.env.SPLATD_SANITIZE ? [1, 3] : [20, 6]; // images: with a sanitizer each takes seconds
const SIDE = process.env.SPLATD_SANITIZE ? 192 : 384; // of a heavy image
const SURFACES = [30, 60, 90, 120, 150, 180, 210].map((value) => ({ type: 'surface', value, opacity: 0.3 }));
const LAYERS = [{ type: 'volume' }, ...SURFACES];

let daemon;
before(async () => {
  daemon = await Daemon.start(['--volume', 'demo:engine?size=24', '--render-bytes', '48M', '--threads', '2'], { backend: 'cpu' });
  await daemon.loaded('engine');
});
after(async () => assert.equal(await daemon.stop(), 0));

/** A size of the process [bytes]: VmRSS, VmHWM. */
const status = (name) => Number(new RegExp(`${name}:\\s+(\\d+) kB`).exec(fs.readFileSync(`/proc/${daemon.child.pid}/status`, 'utf8'))[1]) * 1024;
const resident = () => status('VmRSS');

/** Resolves to the bytes of frames by kind. */
async function counted() {
  const text = await (await daemon.fetch('/metrics')).text();
  const kinds = {};
  for (const [, kind, bytes] of text.matchAll(/^splatd_memory_bytes\{kind="(\w+)"\} (\d+)$/gm)) kinds[kind] = Number(bytes);
  delete kinds.voxels;
  assert.deepEqual(Object.keys(kinds), ['arenas', 'images', 'encoders', 'answers']);
  return kinds;
}
const sum = (kinds) => Object.values(kinds).reduce((all, bytes) => all + bytes, 0);

/** Resolves when no frame has memory: the daemon has given it back by itself. */
const rest = () => within((async () => { while (sum(await counted()) > 0); })(), 'memory that is given back');

async function render(view, format = 'jpeg') {
  const answer = await daemon.fetch(`/api/v1/render?format=${format}`, {
    method: 'POST', body: JSON.stringify(view), headers: { 'Content-Type': 'application/json' },
  });
  const body = Buffer.from(await answer.arrayBuffer());
  return { status: answer.status, detail: answer.status === 200 ? '' : JSON.parse(body).detail, pointer: answer.status === 200 ? null : JSON.parse(body).pointer };
}

test('heavy images stay below the limit, and their memory is given back', async () => {
  assert.equal((await render({ size: [32, 32], layers: LAYERS })).status, 200);
  await rest();
  const base = resident();
  for (let i = 0; i < HEAVY; i += 1) {
    assert.deepEqual(await render({ size: [SIDE, SIDE], layers: LAYERS, camera: { fov_y: 20 + i } }), { status: 200, detail: '', pointer: null });
    const kinds = await counted();
    compare(sum(kinds), '<=', LIMIT);
    compare(resident(), '<=', base + sum(kinds) + TOLERANCE, `after image ${i}: ${JSON.stringify(kinds)}`);
    compare(status('VmHWM'), '<=', base + HALF + TOLERANCE, 'the peak so far');
  }
  await rest();
  compare(resident(), '<=', base + TOLERANCE);
});

test('images that fit one after the other wait for each other', async () => {
  const answers = await Promise.all(Array.from({ length: WAITING }, (_, i) => render({ size: [500, 500], camera: { fov_y: 30 + i } }, 'png')));
  assert.deepEqual(answers.map(({ status }) => status), Array(WAITING).fill(200));
});

test('an image that can never fit is refused with both numbers', async () => {
  const { status, detail, pointer } = await render({ size: [1024, 1024] }, 'exr');
  assert.deepEqual([status, pointer], [422, '/size']);
  const [, needed, allowed] = /needs (\d+) bytes, and the half of --render-bytes .* is (\d+)/.exec(detail);
  compare(Number(needed), '>', HALF);
  assert.equal(Number(allowed), HALF);
});

test('an image that turns out to need too much is refused with both numbers, and others follow', async () => {
  const heavy = { size: [600, 600], compositing: { mode: 'splat' } };
  const { status, detail } = await render(heavy);
  assert.equal(status, 422, detail);
  const [, needed, allowed] = /needs (\d+) more bytes for its .*; frames have \d+ of the (\d+) bytes/.exec(detail);
  compare(Number(needed), '>', 0);
  assert.equal(Number(allowed), HALF);
  assert.equal((await render({ ...heavy, size: [128, 128] })).status, 200);
});

test('a session whose frames do not fit gets smaller ones', async () => {
  const session = await daemon.session({ size: [600, 600], compositing: { mode: 'splat' } });
  const stream = await daemon.stream({ session });
  await stream.until(() => stream.frames.some(({ flags }) => flags & FINAL), 'a final frame');
  const { width } = stream.frames.find(({ flags }) => flags & FINAL);
  compare(width, '<', 600);
  compare(width, '>=', 128);
  await stream.end();
  await rest();
});
