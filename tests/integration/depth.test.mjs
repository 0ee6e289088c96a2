// SPDX-License-Identifier: Apache-2.0
// The depth of frames in a stream, and the camera of images over HTTP.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { compare } from '../support/compare.mjs';
import { decodePng } from '../web/support/png.mjs';
import { Daemon, DEPTH, FINAL, turned } from './harness.mjs';

let daemon;
before(async () => {
  daemon = await Daemon.start(['--volume', 'demo:engine?size=32', '--memory', '1G'], { backend: 'cpu' });
  await daemon.loaded('engine');
});
after(async () => assert.equal(await daemon.stop(), 0));

/** A stream that gets depth. */
async function open(settings = {}, view = {}) {
  const stream = await daemon.stream();
  const granted = await stream.call('stream.configure', { depth: true, size: [120, 90], ...settings });
  assert.equal(granted.depth, true);
  await stream.update(view, 1);
  return stream;
}

const deepFinal = (stream, seq) => stream.frame((f) => f.flags & FINAL && f.flags & DEPTH && f.seq === seq, `a final frame of seq ${seq} with depth`);

/** The depth that a value stands for. */
const depthOf = (value, { near, far, isFlat }) => {
  const [first, last] = isFlat ? [far, near] : [1 / far, 1 / near];
  const mixed = first + (value - 1) / 254 * (last - first);
  return isFlat ? mixed : 1 / mixed;
};

test('a frame comes with its camera and its depth, which lies in the volume', async () => {
  const stream = await open();
  const { depth, payload } = await deepFinal(stream, 1);
  const { view } = await stream.call('view.get');
  assert.equal(payload.readUInt16BE(0), 0xffd8);
  assert.deepEqual([depth.position, depth.target, depth.up, depth.extent], [view.camera.position, view.camera.target, view.camera.up, view.camera.fov_y]);
  assert.deepEqual(depth.cells, [30, 23]);
  const image = decodePng(depth.payload);
  assert.deepEqual([image.width, image.height], [30, 46]);
  const distance = Math.hypot(...view.camera.position.map((x, i) => x - view.camera.target[i]));
  const radius = 32 * Math.sqrt(3) / 2; // of the volume, whose samples are 1 apart
  compare(depth.near, '>', distance - radius);
  compare(depth.far, '<', distance + radius);
  compare(Math.abs(depthOf(image.at(15, 11)[0], depth) - distance), '<', radius, 'the middle shows the volume');
  assert.equal(image.at(0, 0)[0], 0, 'a corner shows nothing');
  for (let y = 23; y < 46; y += 1) for (let x = 0; x < 30; x += 1) assert.equal(image.at(x, y)[0] % 32, 0, 'spreads are multiples of 32');
  await stream.end();
});

test('moving frames have the camera that they show', async () => {
  const stream = await open();
  await deepFinal(stream, 1);
  const cameras = new Map();
  for (let seq = 2; seq < 12; seq += 1) {
    const patch = turned(stream.session.view, seq);
    cameras.set(seq, patch.camera.position);
    await stream.update(patch, seq);
  }
  await deepFinal(stream, 11);
  const moving = stream.frames.filter(({ seq }) => seq >= 2);
  for (const { seq, depth } of moving) depth.position.forEach((x, i) => compare(Math.abs(x - cameras.get(seq)[i]), '<', 1e-9));
  await stream.end();
});

test('an orthographic camera has its height, and depth as well', async () => {
  const stream = await open({}, { camera: { projection: 'orthographic', height: 40 } });
  const { depth } = await deepFinal(stream, 1);
  assert.deepEqual([depth.isFlat, depth.extent], [true, 40]);
  compare(depth.far, '>', depth.near);
  await stream.end();
});

for (const [what, view] of [['that has none', { compositing: { mode: 'mean' } }], ['that shows nothing', { clip: { box: [[0, 0, 0], [0.01, 0.01, 0.01]] } }]]) {
  test(`a picture ${what} has its camera alone`, async () => {
    const stream = await open({}, view);
    const { depth } = await deepFinal(stream, 1);
    assert.deepEqual([depth.payload.length, depth.cells, depth.near, depth.far], [0, [0, 0], 0, 0]);
    await stream.end();
  });
}

test('depths lie in front of the eye, also where it is inside the volume', async () => {
  for (const order of ['pre', 'post']) {
    for (const mode of ['sheet', 'slab']) {
      const stream = await open();
      const { view } = await stream.call('view.get');
      const { target } = view.camera;
      await stream.update({ compositing: { mode }, transfer_function: { order }, camera: { position: target.map((x, i) => x - (i === 1 ? 3 : 0)), up: [0, 0, 1], fov_y: 120, near: 0.05 } }, 2);
      const { depth } = await deepFinal(stream, 2);
      compare(depth.payload.length, '>', 0, `${mode} ${order}`);
      compare(depth.near, '>=', 0.0499);
      compare(depth.far, '>=', depth.near);
      await stream.end();
    }
  }
});

test('participants with and without depth share a session, and get the same image', async () => {
  const deep = await open();
  const plain = await daemon.stream({ session: deep.session });
  await plain.call('stream.configure', { size: [120, 90] });
  await deep.update(turned(deep.session.view, 3), 2);
  const { payload } = await deepFinal(deep, 2);
  const same = await plain.frame((f) => f.payload.equals(payload), 'the same image');
  assert.equal(same.depth, null);
  await deep.call('stream.configure', { depth: false });
  await deep.update(turned(deep.session.view, 4), 3);
  const last = await deep.final(3);
  assert.equal(last.depth, null, 'a client can do without again');
  await Promise.all([deep.end(), plain.end()]);
});

test('video comes with depth', async (context) => {
  const stream = await open({ format: ['vp8'] });
  await deepFinal(stream, 1);
  for (let seq = 2; seq < 8; seq += 1) await stream.update(turned(stream.session.view, seq), seq);
  await deepFinal(stream, 7);
  const videos = stream.frames.filter(({ codec }) => codec === 7);
  if (videos.length === 0) context.skip('this daemon has no VP8');
  for (const { depth } of videos) compare(depth.payload.length, '>', 0);
  await stream.end();
});

test('a client that asks for depth and never acknowledges gets no more frames than others', async () => {
  const stream = await open();
  await deepFinal(stream, 1);
  stream.acks = false;
  const before_ = stream.frames.length;
  for (let seq = 2; seq < 60; seq += 1) await stream.update(turned(stream.session.view, seq), seq);
  compare(stream.frames.length - before_, '<', 10);
  stream.acks = true;
  stream.ack(stream.frames.at(-1).frame);
  await deepFinal(stream, 59);
  await stream.end();
});

test('a client that asks for it gets moving frames that are ahead of its hand, and the frame at rest where the hand stopped', async () => {
  const stream = await open({ predict: 200, max_fps: 60 });
  await deepFinal(stream, 1);
  const { camera } = stream.session.view;
  const sent = [0, 0]; // the places of the camera, by seq
  const isAhead = ({ seq, depth }) => seq > 1 && depth.position[0] - camera.position[0] > sent[seq] + 1e-6;
  while (!stream.frames.some(isAhead)) {
    sent.push(sent.length * 0.05);
    await stream.update({ camera: { ...camera, position: camera.position.map((x, i) => x + (i === 0 ? sent.at(-1) : 0)) } }, sent.length - 1);
  }
  const { depth } = await deepFinal(stream, sent.length - 1);
  compare(Math.abs(depth.position[0] - camera.position[0] - sent.at(-1)), '<', 1e-9);
  assert.deepEqual((await stream.call('view.get')).view.camera.position, depth.position, 'the view itself is where the hand is');
  await stream.end();
});

test('how far frames may be ahead is a whole number of ms', async () => {
  const stream = await daemon.stream();
  for (const predict of [-1, 1001, 0.5, true])
    await assert.rejects(stream.call('stream.configure', { predict }), ({ code, data }) => code === -32602 && data.pointer === '/predict');
  assert.equal((await stream.call('stream.configure', {})).predict, 0);
  assert.equal((await stream.call('stream.configure', { predict: 1000 })).predict, 1000);
  await stream.end();
});

test('depth must be true or false', async () => {
  const stream = await daemon.stream();
  await assert.rejects(stream.call('stream.configure', { depth: 'yes' }), ({ code, data }) => code === -32602 && data.pointer === '/depth');
  assert.equal((await stream.call('stream.configure', {})).depth, false);
  await stream.end();
});

test('an image over HTTP names its camera', async () => {
  const answer = await daemon.fetch('/api/v1/render?format=png', {
    method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify({ volume: 'engine', size: [64, 64], camera: { fov_y: 42 } }),
  });
  const camera = JSON.parse(answer.headers.get('X-Camera'));
  assert.equal(camera.fov_y, 42);
  assert.equal(camera.position.length, 3);
});
