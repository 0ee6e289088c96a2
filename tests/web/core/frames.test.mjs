// SPDX-License-Identifier: Apache-2.0
// The page and the daemon agree on the frames of a camera path. Compares frames of paths that change everything with images
// of the views that blend.js computes.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { Api } from '../../../clients/web/core/api.js';
import { UNMOVED, matrixOf } from '../../../clients/web/core/placement.js';
import { framesOf, requestOf, turnOf, viewAt } from '../../../clients/web/core/keyframes.js';
import { webTransport } from '../../../clients/web/core/transport.js';
import { compare } from '../../support/compare.mjs';
import { startDaemon } from '../support/daemon.mjs';
import { decodePng } from '../support/png.mjs';

const OUTPUT = { size: [48, 40], fps: 4, format: 'png' };
let daemon;
let api;
let view;
before(async () => {
  daemon = await startDaemon(['--volume', 'demo:phantom?size=32', '--volume', 'demo:gaussians?size=8', '--volume', 'demo:points?size=8', '--backend', 'cpu']);
  const { origin, searchParams } = new URL(daemon.url);
  api = new Api({ base: `${origin}/`, token: searchParams.get('token'), transport: webTransport({ base: `${origin}/`, fetch, WebSocket: null }) });
  for (let states = ['loading']; states.includes('loading');) states = (await api.volumes()).map(({ state }) => state);
  view = await api.volumeView('phantom');
});
after(() => daemon?.stop());

async function png(path, options = {}) {
  const { headers, ...more } = options;
  const answer = await fetch(new URL(path, daemon.url), { headers: { Authorization: `Bearer ${api.token}`, ...headers }, ...more });
  assert.equal(answer.status, 200, path);
  return decodePng(Buffer.from(await answer.arrayBuffer()));
}

/** Returns the largest difference of a colour channel, of 255. */
function largest(a, b) {
  assert.deepEqual([a.width, a.height], [b.width, b.height]);
  let most = 0;
  for (let y = 0; y < a.height; y += 1) {
    for (let x = 0; x < a.width; x += 1) {
      const q = b.at(x, y);
      a.at(x, y).forEach((part, i) => { most = Math.max(most, Math.abs(part - q[i])); });
    }
  }
  return most;
}

async function check(path) {
  const { id } = await api.createPath(requestOf(path, OUTPUT));
  const events = [];
  await api.watchPath(id, (event, { state }) => events.push([event, state]));
  assert.deepEqual(events.at(-1), ['done', 'done']);
  const frames = [];
  for (let frame = 0; frame < framesOf(path, OUTPUT.fps); frame += 1) {
    const drawn = await png(`api/v1/paths/${id}/frames/${frame}`);
    const body = JSON.stringify({ ...viewAt(path, OUTPUT.fps, frame), size: OUTPUT.size });
    const shown = await png('api/v1/render?format=png', { method: 'POST', body, headers: { 'Content-Type': 'application/json' } });
    compare(largest(drawn, shown), '<=', 1, `frame ${frame} is off by ${largest(drawn, shown)} of 255`);
    frames.push(drawn);
  }
  await api.deletePath(id);
  return frames;
}

const key = (change, more = {}) => ({ view: { ...view, ...change }, seconds: 1, ease: 'linear', ...more });

test('camera, colours, filter, slabs, light, box, plane and background change as in the daemon', async () => {
  const { camera, transfer_function: tf, filter, shading, clip } = view;
  const far = {
    ...camera, position: [-100, 120, 10], target: [14, 17, 13], up: [0.2, -0.3, 1], fov_y: 45, near: 0.5,
  };
  const colours = {
    ...tf, reference_length: 2.5, gradient: [{ magnitude: 0, scale: 0.2 }, { magnitude: 0.05, scale: 1 }],
    points: [{ value: 0.1, color: [0, 0.2, 1], opacity: 0 }, { value: tf.points[2].value, color: [1, 0, 0], opacity: 0.4 }, { value: 0.7, color: [0, 1, 0], opacity: 0.2 }],
  };
  const light = { ...shading, ambient: 0.6, specular: 0.9, exponent: 60, lights: [{ direction: [-1, 0.2, 0.4], space: 'camera', color: [1, 0.5, 0.2] }] };
  const slabs = { mode: 'slab', attenuation: 'exponential', slab: 0.5 };
  const path = {
    isLoop: true,
    keys: [
      key({ compositing: slabs, clip: { ...clip, planes: [{ normal: [1, 0, 0], offset: 3 }] } }),
      key({
        camera: far, transfer_function: colours, shading: light, compositing: { ...slabs, slab: 4 },
        filter: { ...filter, sigma: 1.2, lowpass: 2.5, cutoff: 2, c_max: 0.9 }, background: [0.2, 0.4, 0.1, 1],
        clip: { box: [[0.1, 0, 0.2], [1, 0.9, 0.8]], planes: [{ normal: [0, 0, 2], offset: 9 }] },
      }, { ease: 'smooth', seconds: 1.5 }),
      key({
        camera: { ...camera, position: [20, -30, 50] }, compositing: slabs, filter: { ...filter, lowpass: 3, c_min: 0.9, c_max: 1.5 }, clip: { ...clip, planes: [] },
      }, { seconds: 1.25 }),
    ],
  };
  const frames = await check(path);
  assert.equal(frames.length, 15);
  for (let i = 1; i < frames.length; i += 1) compare(largest(frames[i - 1], frames[i]), '>', 8, `frame ${i} equals the frame before it`);
});

test('steps and names change at the keyframe; orthographic cameras and opposite directions work', async () => {
  const { camera, filter, shading, clip } = view;
  const flat = { ...camera, projection: 'orthographic' };
  const plane = (normal, offset) => ({ ...clip, planes: [{ normal, offset }] });
  await check({
    isLoop: false,
    keys: [
      key({ camera: flat, clip: plane([0, 1, 0], 12) }),
      key({ camera: { ...flat, height: 30, target: [10, 20, 12] }, filter: { ...filter, mode: 'none' }, clip: plane([0, -1, 0], -20) }),
      key({ camera: flat, clip: plane([0, 1, 1], 16), shading: { mode: 'none' } }, { ease: 'step' }),
      key({ camera: flat, shading, clip }, { seconds: 0.3 }),
    ],
  });
});

test('a turntable moves in a circle at constant speed, also in the daemon', async () => {
  const keys = turnOf(view, [0, 0, 1]).map((turned) => ({ view: turned, seconds: 0.75, ease: 'linear' }));
  const path = { keys, isLoop: true };
  const frames = await check(path);
  assert.equal(frames.length, 12);
  const angles = frames.map((_, i) => {
    const { position, target } = viewAt(path, OUTPUT.fps, i).camera;
    compare(Math.abs(position[2] - view.camera.position[2]), '<', 1e-9, 'the camera keeps its height');
    return Math.atan2(position[1] - target[1], position[0] - target[0]);
  });
  angles.forEach((angle, i) => {
    const step = (angle - (i ? angles[i - 1] : angles.at(-1)) + 4 * Math.PI) % (2 * Math.PI);
    compare(Math.abs(step - Math.PI / 6), '<', 1e-9, `${step} at ${i}`);
  });
});

test('layers of elements turn, grow and fade as in the daemon', async () => {
  const layers = (gaussians, points) => [
    { type: 'volume', visible: true }, { type: 'gaussians', visible: true, id: 'gaussians', convention: 'inria', opacity: 1, ...gaussians },
    { type: 'points', visible: true, id: 'points', size: 1, ...points },
  ];
  const place = (change) => ({ transform: matrixOf({ ...UNMOVED, ...change }) });
  const frames = await check({
    isLoop: true,
    keys: [
      key({ layers: layers(place({ move: [15, 15, 15], scale: 8 }), { ...place({ move: [5, 5, 5] }), size: 0.5 }) }),
      key({ layers: layers({ ...place({ move: [10, 20, 15], turn: [80, -30, 120], scale: 4 }), opacity: 0.5 }, { ...place({ move: [20, 9, 25], scale: 5 }), size: 3 }) }),
      key({ layers: layers({ transform: [6, 2, 0, 15, 0, 5, 0, 15, 0, 1, 9, 15, 0, 0, 0, 1] }, place({ move: [5, 5, 5] })) }, { ease: 'smooth' }),
    ],
  });
  for (let i = 1; i < frames.length; i += 1) compare(largest(frames[i - 1], frames[i]), '>', 8, `frame ${i} equals the frame before it`);
});
