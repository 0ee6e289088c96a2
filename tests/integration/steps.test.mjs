// SPDX-License-Identifier: Apache-2.0
// Time series: renders, slices, streams and camera paths of their steps, in bounded memory.
import assert from 'node:assert/strict';
import { spawn } from 'node:child_process';
import { once } from 'node:events';
import { mkdirSync, mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { after, before, test } from 'node:test';
import { compare } from '../support/compare.mjs';
import { BIN, Daemon, FINAL } from './harness.mjs';

const SIDE = 16;
const STEPS = 6;
const BUDGET = 4 * 1024 * 5; // bytes: for four of the six steps
let folder;
let daemon;

/** A ball that grows from step to step. */
function ball(step) {
  const bytes = Buffer.alloc(SIDE ** 3);
  for (let i = 0; i < bytes.length; i += 1) {
    const [x, y, z] = [i % SIDE, Math.floor(i / SIDE) % SIDE, Math.floor(i / SIDE / SIDE)].map((c) => c - (SIDE - 1) / 2);
    bytes[i] = Math.max(0, Math.min(255, 128 + 60 * (1 + step - Math.hypot(x, y, z))));
  }
  return bytes;
}

const header = (dims, more = '') => Buffer.from(`ObjectType = Image\nNDims = ${dims.length}\nDimSize = ${dims.join(' ')}\n${more}ElementType = MET_UCHAR\nElementDataFile = LOCAL\n`);

before(async () => {
  folder = mkdtempSync(path.join(tmpdir(), 'splatd-steps-'));
  const steps = [...Array(STEPS).keys()].map(ball);
  writeFileSync(path.join(folder, 'balls.mha'), Buffer.concat([header([SIDE, SIDE, SIDE, STEPS], 'ElementSpacing = 1 1 1 0.5\n'), ...steps]));
  mkdirSync(path.join(folder, 'run'));
  steps.forEach((bytes, i) => writeFileSync(path.join(folder, 'run', `t${i}.mha`), Buffer.concat([header([SIDE, SIDE, SIDE]), bytes])));
  writeFileSync(path.join(folder, 'run', 't4.mha'), 'damaged');
  daemon = await Daemon.start(['--data', folder, '--volume', path.join(folder, 'balls.mha'), '--memory', String(BUDGET)], { backend: 'cpu' });
  await daemon.loaded('balls');
});
after(async () => {
  assert.equal(await daemon.stop(), 0);
  rmSync(folder, { recursive: true });
});

async function render(view) {
  const answer = await daemon.fetch('/api/v1/render', { method: 'POST', body: JSON.stringify({ size: [48, 48], ...view }), headers: { 'Content-Type': 'application/json', Accept: 'image/png' } });
  return { status: answer.status, bytes: Buffer.from(await answer.arrayBuffer()) };
}

async function splatctl(...args) {
  const child = spawn(path.join(BIN, 'splatctl'), args, { env: { ...process.env, SPLATD_URL: `${daemon.base}/?token=${daemon.token}` } });
  const out = [];
  child.stdout.on('data', (data) => out.push(data));
  let err = '';
  child.stderr.on('data', (data) => { err += data; });
  const [status] = await once(child, 'close');
  assert.deepEqual({ status, err }, { status: 0, err: '' });
  return Buffer.concat(out);
}

test('a volume tells its steps, and an image shows the one that its view names', async () => {
  const { json } = await daemon.json('/api/v1/volumes/balls');
  assert.deepEqual(json.steps, { count: STEPS, unit: '', times: [0, 0.5, 1, 1.5, 2, 2.5] });
  const images = [];
  for (let step = 0; step < STEPS; step += 1) {
    const { status, bytes } = await render({ volume: 'balls', time: { step } });
    assert.equal(status, 200);
    images.push(bytes);
    const { json: now } = await daemon.json('/api/v1/volumes/balls');
    compare(now.memory.voxels, '<=', BUDGET);
  }
  assert.equal(new Set(images.map((image) => image.toString('base64'))).size, STEPS, 'all steps differ');
  assert.deepEqual((await render({ volume: 'balls', time: { step: 2 } })).bytes, images[2], 'a step that was evicted looks as before');
  const beyond = await render({ volume: 'balls', time: { step: STEPS } });
  assert.equal(beyond.status, 422);
  assert.match(beyond.bytes.toString(), /6 is outside \[0, 5\]/);
});

/** A grey TIFF image of SIDE² pixels of one byte. */
function tiff(pixels) {
  const tags = [[256, SIDE], [257, SIDE], [258, 8], [259, 1], [262, 1], [273, 8], [277, 1], [278, SIDE], [279, SIDE * SIDE]];
  const numbers = tags.flatMap(([tag, value]) => [tag | 4 << 16, 1, value]); // of 32 bits: tag and type, count, value
  const table = Buffer.alloc(2 + 4 * numbers.length + 4);
  table.writeUInt16LE(tags.length);
  numbers.forEach((number, i) => table.writeUInt32LE(number, 2 + 4 * i));
  const start = Buffer.from('II*\0\0\0\0\0', 'latin1');
  start.writeUInt32LE(8 + pixels.length, 4);
  return Buffer.concat([start, pixels, table]);
}

test('a file of a later step begins with this step', async () => {
  for (let step = 0; step < 3; step += 1)
    for (let z = 0; z < 2; z += 1) writeFileSync(path.join(folder, `img_t${step}_z${z}.tif`), tiff(Buffer.alloc(SIDE * SIDE, 50 * step + z)));
  const { json: made } = await daemon.post('/api/v1/volumes', { path: 'img_t2_z1.tif' });
  const loaded = await daemon.loaded(made.id);
  assert.equal(loaded.state, 'ready', loaded.reason);
  const session = await daemon.session({ volume: made.id, size: [8, 8] });
  assert.equal((await daemon.json(`/api/v1/sessions/${session.id}`)).json.view.time.step, 2);
  for (const [of, value] of [['', 101], ['&step=0', 1], ['&step=2', 101], ['&step=1', 51]]) {
    let answer;
    do answer = await daemon.fetch(`/api/v1/volumes/${made.id}/slice?axis=2&index=1&format=raw${of}`);
    while (answer.status === 409);
    assert.deepEqual(Buffer.from(await answer.arrayBuffer()), Buffer.alloc(SIDE * SIDE, value), of);
  }
  assert.equal((await daemon.fetch(`/api/v1/volumes/${made.id}`, { method: 'DELETE' })).status, 204);
});

test('a slice is that of a step', async () => {
  const at = async (step) => {
    for (;;) {
      const answer = await daemon.fetch(`/api/v1/volumes/balls/slice?axis=2&index=8&format=raw&step=${step}`);
      if (answer.status !== 409) return answer;
      await answer.arrayBuffer();
    }
  };
  for (const step of [5, 0]) {
    const raw = Buffer.from(await (await at(step)).arrayBuffer());
    assert.deepEqual(raw, ball(step).subarray(8 * SIDE * SIDE, 9 * SIDE * SIDE));
  }
  assert.equal((await at(9)).status, 422);
  assert.equal((await at('x')).status, 400);
});

test('the stream plays all steps in their order, for all participants', async () => {
  const session = await daemon.session({ volume: 'balls', size: [48, 48] });
  const stream = await daemon.stream({ session });
  const guest = await daemon.stream({ session });
  await stream.final(0);
  assert.equal((await stream.call('time.play', { steps: 30 })).steps, 30);
  for (let step = 0; step < STEPS; step += 1) await guest.note('time.changed', (now) => now.step === step && !now.loading && now.steps === 30 && now.count === STEPS);
  assert.equal((await stream.call('time.stop')).steps, 0);
  await stream.update({ time: { step: 5 } }, 3);
  const { view } = await stream.call('view.get');
  assert.equal(view.time.step, 5);
  const final = await stream.frame((f) => f.seq === 3 && f.flags & FINAL, 'a final frame of step 5');
  assert.ok(final);
  await assert.rejects(stream.update({ time: { step: 6 } }, 4), /6 is outside/);
  await stream.end();
  await guest.end();
});

test('numbered files are a series; a damaged one is an error of its own', async () => {
  assert.equal((await daemon.post('/api/v1/volumes', { path: 'run/t*.mha' })).json.id, 't');
  await daemon.loaded('t');
  assert.equal((await daemon.json('/api/v1/volumes/t')).json.steps.count, STEPS);
  assert.equal((await render({ volume: 't', time: { step: 1 } })).status, 200);
  const broken = await render({ volume: 't', time: { step: 4 } });
  assert.equal(broken.status, 409);
  assert.match(broken.bytes.toString(), /t4\.mha/);
  const stream = await daemon.stream({ session: await daemon.session({ volume: 't', size: [48, 48] }) });
  await stream.final(0);
  await stream.update({ time: { step: 4 } }, 1);
  assert.match((await stream.note('render.error')).params.message, /time step 4 of the volume 't' cannot be loaded: t4\.mha/);
  await stream.update({ time: { step: 5 } }, 2);
  await stream.frame((f) => f.seq === 2 && f.flags & FINAL, 'the step after it');
  await stream.end();
  assert.equal((await daemon.fetch('/api/v1/volumes/t', { method: 'DELETE' })).status, 204);
});

test('splatctl chooses a step, with and without the daemon', async () => {
  const file = path.join(folder, 'balls.mha');
  const [remote, local, first] = await Promise.all([
    splatctl('render', '--volume', 'balls', '--step', '3', '--size', '48x48', '--out', '-'),
    splatctl('render', '--local', '--backend', 'cpu', '--volume', file, '--step', '3', '--size', '48x48', '--out', '-'),
    splatctl('render', '--volume', 'balls', '--size', '48x48', '--out', '-'),
  ]);
  assert.deepEqual(remote, local);
  assert.notDeepEqual(remote, first);
  assert.deepEqual(await splatctl('slice', '--volume', 'balls', '--axis', 'z', '--index', '8', '--step', '4', '--out', '-', '--format', 'raw'),
    ball(4).subarray(8 * SIDE * SIDE, 9 * SIDE * SIDE));
  assert.match(String(await splatctl('info', file)), /"count": 6/);
});

test('a camera path goes through the steps', async () => {
  const made = await daemon.post('/api/v1/paths', { view: { volume: 'balls' }, size: [32, 32], frames: 6, format: 'png', keyframes: [{ frame: 5, view: { time: { step: 5 } } }] });
  assert.equal(made.status, 202, JSON.stringify(made.json));
  const answer = await daemon.fetch(`/api/v1/paths/${made.json.id}/events`); // ends with the path
  assert.match(await answer.text(), /"state":"done"/);
  const frames = [];
  for (let i = 0; i < 6; i += 1) frames.push(Buffer.from(await (await daemon.fetch(`/api/v1/paths/${made.json.id}/frames/${i}`)).arrayBuffer()).toString('base64'));
  assert.equal(new Set(frames).size, 6);
});

test('volumes that layers name follow the time', async () => {
  // The positions and `a` stay; `b` moves on from step to step.
  const table = (step) => `x,y,z,a,b\n${[...Array(27).keys()].map((i) => `${i % 3},${Math.floor(i / 3) % 3},${Math.floor(i / 9)},${i},${(i + 7 * step) % 27}`).join('\n')}\n`;
  mkdirSync(path.join(folder, 'points'));
  for (let step = 0; step < STEPS; step += 1) writeFileSync(path.join(folder, 'points', `p${step}.csv`), table(step));
  for (let step = 0; step < 2; step += 1) writeFileSync(path.join(folder, 'points', `q${step}.csv`), table(step + 1));
  const open = async (source) => {
    const { id } = (await daemon.post('/api/v1/volumes', { path: source })).json;
    await daemon.loaded(id);
    return id;
  };
  const a = await open('points/p*.csv?field=a');
  const b = await open('points/p*.csv?field=b');
  const short = await open('points/q*.csv?field=b');
  const single = await open('points/p3.csv?field=a');
  const colored = (volume, by, step) => render({ volume, time: { step }, layers: [{ type: 'points', color_by: by }] });
  const shown = (other, step) => render({ volume: a, time: { step }, layers: [{ type: 'points', id: other }] });
  const images = [];
  for (let step = 0; step < STEPS; step += 1) {
    const { status, bytes } = await colored(a, b, step);
    assert.equal(status, 200);
    images.push(bytes);
  }
  assert.equal(new Set(images.map((image) => image.toString('base64'))).size, STEPS, 'the colours are those of each step');
  // The short series has two steps: its last step stays, which has the numbers of step 2.
  assert.deepEqual((await colored(a, short, 1)).bytes, images[2]);
  assert.deepEqual((await colored(a, short, 5)).bytes, images[2]);
  assert.deepEqual((await colored(single, b, 0)).bytes, images[0], 'a volume without a series changes no time');
  assert.notDeepEqual((await shown(b, 1)).bytes, (await shown(b, 4)).bytes, 'a layer of its own follows, too');
  const file = path.join(folder, 'points', 'p*.csv?field=');
  const local = (step) => splatctl('render', '--local', '--backend', 'cpu', '--volume', `${file}a`, '--step', String(step), '--size', '48x48', '--out', '-',
    '--view', path.join(folder, 'view.json'));
  writeFileSync(path.join(folder, 'view.json'), JSON.stringify({ layers: [{ type: 'points', color_by: `${file}b` }] }));
  assert.deepEqual(await local(4), images[4]);
  const stream = await daemon.stream({ session: await daemon.session({ volume: a, size: [48, 48] }) });
  await stream.final(0);
  await stream.update({ layers: [{ type: 'points', color_by: b }] }, 1);
  await stream.call('time.play', { steps: 30 });
  for (let step = 1; step < STEPS; step += 1) await stream.note('time.changed', (now) => now.step === step && !now.loading);
  await stream.call('time.stop');
  await stream.end();
  for (const id of [a, b, short, single]) assert.equal((await daemon.fetch(`/api/v1/volumes/${id}`, { method: 'DELETE' })).status, 204);
});
