// SPDX-License-Identifier: Apache-2.0
// Invalid views: HTTP and the stream refuse them with the same JSON pointer and a reason, and nothing changes.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { decodePng } from '../web/support/png.mjs';
import { Daemon } from './harness.mjs';

let daemon;
before(async () => {
  daemon = await Daemon.start();
  await daemon.loaded('engine');
});
after(async () => assert.equal(await daemon.stop(), 0));

const points = (...values) => ({ transfer_function: { points: values.map((value) => ({ value, color: [1, 1, 1], opacity: 0.5 })) } });
const gradient = (...values) => ({ transfer_function: { gradient: values.map((magnitude) => ({ magnitude, scale: 1 })) } });
const plane = (normal, offset = 0) => ({ clip: { planes: [{ normal: [0, 0, 1], offset: 1 }, { normal, offset }] } });
const box = (low, high) => ({ clip: { box: [low, high] } });

const WRONG = [
  [{ filter: { mode: 'box' } }, '/filter/mode', /"swan" or "none"/],
  [{ filter: { kernel: 'sinc' } }, '/filter/kernel', /"gaussian" or "cubic"/],
  [{ filter: { sigma: 0 } }, '/filter/sigma', /0 is outside \[0\.3, 2\]/],
  [{ filter: { sigma: -1 } }, '/filter/sigma', /-1 is outside/],
  [{ filter: { cutoff: 0.99 } }, '/filter/cutoff', /0\.99 is outside \[1, 6\]/],
  [{ filter: { lowpass: -0.1 } }, '/filter/lowpass', /outside \[0, 8\]/],
  [{ filter: { c_min: 0 } }, '/filter/c_min', /above 0/],
  [{ filter: { c_min: 2, c_max: 1 } }, '/filter/c_min', /c_min 2 is above c_max 1/],
  [{ filter: { c_min: 50 } }, '/filter/c_min', /c_min 50 is above c_max .*default for this camera/],
  [{ compositing: { mode: 'slabs' } }, '/compositing/mode', /"mean" or "sum"/],
  [{ compositing: { attenuation: 'none' } }, '/compositing/attenuation', /"exponential" or "linear"/],
  [{ compositing: { mode: 'slab', slab: 0 } }, '/compositing/slab', /0 is outside \[0\.05, 64\]/],
  [{ compositing: { mode: 'slab', slab: -1 } }, '/compositing/slab', /-1 is outside/],
  [{ compositing: { mode: 'slab', slab: 0.01 } }, '/compositing/slab', /0\.01 is outside/],
  [{ compositing: { slab: 64.5 } }, '/compositing/slab', /64\.5 is outside/],
  [points(), '/transfer_function/points', /./],
  [points(3, 2), '/transfer_function/points/1/value', /2 does not rise above the point before it \(3\)/],
  [points(1, 2, 2), '/transfer_function/points/2/value', /does not rise/],
  [gradient(5, 4), '/transfer_function/gradient/1/magnitude', /4 does not rise above the point before it \(5\)/],
  [gradient(0, 0), '/transfer_function/gradient/1/magnitude', /does not rise/],
  [gradient(-1), '/transfer_function/gradient/0/magnitude', /less than 0/],
  [plane([0, 0, 0]), '/clip/planes/1/normal', /the normal is zero/],
  [plane([0, 1]), '/clip/planes/1/normal', /3 numbers/],
  [{ clip: { planes: [{ normal: [0, 0, 1] }] } }, '/clip/planes/0', /"offset" is missing/],
  [{ clip: { planes: Array(9).fill({ normal: [0, 0, 1], offset: 0 }) } }, '/clip/planes', /has 9 items; the limit is 8/],
  [box([0, 0.6, 0], [1, 0.4, 1]), '/clip/box/0/1', /above the upper corner/],
  [box([0, 0, 0], [1, 1, 1.01]), '/clip/box/1/2', /outside \[0, 1\]/],
  [{ transfer_function: { order: 'after' } }, '/transfer_function/order', /"post" or "auto"/],
  [{ transfer_function: { order: 'post' }, compositing: { mode: 'splat' } }, '/transfer_function/order', /compositing\.mode "sheet" or "slab"/],
];

test('every interface gives the same pointer and reason', async () => {
  const stream = await daemon.stream();
  const { view: before_ } = await stream.call('view.get');
  const session = `/api/v1/sessions/${stream.session.id}`;
  const headers = { 'Content-Type': 'application/merge-patch+json' };
  for (const [view, pointer, reason] of WRONG) {
    const name = JSON.stringify(view);
    const refused = ({ status, headers: got, json }, place) => {
      assert.deepEqual([status, json.pointer], [422, place], `${name}: ${json.detail}`);
      assert.equal(got.get('content-type'), 'application/problem+json');
      assert.match(json.detail, reason, name);
    };
    refused(await daemon.post('/api/v1/render', view), pointer);
    refused(await daemon.post('/api/v1/sessions', { view }), `/view${pointer}`);
    refused(await daemon.json(session, { method: 'PATCH', headers, body: JSON.stringify({ view }) }), `/view${pointer}`);
    await assert.rejects(stream.update(view), (error) => {
      assert.deepEqual([error.code, error.data?.pointer], [-32000, pointer], `${name}: ${error.message}`);
      assert.match(error.message, reason, name);
      return true;
    });
  }
  assert.deepEqual((await stream.call('view.get')).view, before_);
  assert.deepEqual((await daemon.json(session)).json.view, before_);
  await stream.end();
});

test('numbers beyond the range of a double are refused as invalid JSON', async () => {
  for (const body of ['{"clip": {"planes": [{"normal": [0, 0, 1e999], "offset": 0}]}}', '{"compositing": {"slab": NaN}}']) {
    assert.equal((await daemon.post('/api/v1/render', body)).status, 400, body);
  }
});

test('single splats with post-classification are refused with a remedy, and the remedy works', async () => {
  const stream = await daemon.stream();
  await stream.update({ transfer_function: { order: 'post' }, compositing: { mode: 'slab', slab: 0.5 } });
  const { view } = await stream.call('view.get');
  assert.deepEqual([view.transfer_function.order, view.compositing.mode], ['post', 'slab']);
  await assert.rejects(stream.update({ compositing: { mode: 'splat' } }), (error) => error.code === -32000
    && error.data.pointer === '/transfer_function/order' && /"slab".*both at once.*"auto"/.test(error.message));
  assert.deepEqual((await stream.call('view.get')).view, view, 'a refused patch changes nothing');
  await stream.update({ compositing: { mode: 'splat' }, transfer_function: { order: 'auto' } });
  await stream.update({ compositing: null });
  await stream.update({ transfer_function: { order: 'post' } });
  await stream.update({ compositing: null, transfer_function: { order: null } }, 9);
  const last = (await stream.call('view.get')).view;
  assert.deepEqual([last.transfer_function.order, last.compositing], ['auto', {
    mode: 'sheet', attenuation: 'exponential', slab: 1, colors: 'grey', window: { center: null, width: null }, zero: null, absorption: null,
  }]);
  await stream.final(9);
  await stream.end();
});

test('clip planes may have any length and distance: nothing overflows, and a distant plane cuts all or nothing', async () => {
  const real = await Daemon.start(['--volume', 'demo:engine?size=32'], { backend: 'cpu' });
  await real.loaded('engine');
  const drawer = (choices) => async (...planes) => {
    const view = {
      ...choices, size: [40, 30], shading: { mode: 'none' }, clip: { planes: planes.map(([normal, offset]) => ({ normal, offset })) },
    };
    const answer = await real.fetch('/api/v1/render?format=png', {
      method: 'POST', body: JSON.stringify(view), headers: { 'Content-Type': 'application/json' },
    });
    const bytes = Buffer.from(await answer.arrayBuffer());
    assert.equal(answer.status, 200, `${JSON.stringify(view)}: ${bytes}`);
    return decodePng(bytes);
  };
  const isSame = (a, b, what) => {
    for (let y = 0; y < 30; y++) {
      for (let x = 0; x < 40; x++) {
        const [p, q] = [a.at(x, y), b.at(x, y)];
        assert.ok(p.every((part, i) => Math.abs(part - q[i]) <= 2), `${what}: [${p}] is not [${q}] at ${x}, ${y}`);
      }
    }
  };
  const nothing = { at: () => [0, 0, 0] };
  for (const choices of [{}, { compositing: { mode: 'splat' } }, { compositing: { mode: 'slab' }, transfer_function: { order: 'post' } }]) {
    const draw = drawer(choices);
    const [whole, cut] = [await draw(), await draw([[0, 0, 1], 6])];
    assert.throws(() => isSame(whole, cut, 'the cut'), 'the plane cuts something');
    assert.throws(() => isSame(cut, nothing, 'the cut'), 'the plane leaves something');
    for (const length of [1e-300, 1e-160, 1e-20, 1e20, 1e160, 1e300]) {
      isSame(await draw([[0, 0, length], 6 * length]), cut, `a normal of length ${length}`);
    }
    isSame(await draw([[1e308, 1e308, 1e308], 0], [[-1e308, -1e308, 1e308], -1e308]), await draw([[1, 1, 1], 0], [[-1, -1, 1], -1]),
      'the longest normals');
    for (const [normal, offset] of [[[0, 0, 1], 1e308], [[0, 0, 5e-324], 1], [[1, 2, 3], 1e30]]) {
      isSame(await draw([normal, offset]), nothing, `behind ${normal}, ${offset}`);
      isSame(await draw([normal, -offset]), whole, `before ${normal}, ${-offset}`);
    }
    const eight = Array.from({ length: 8 }, (_, i) => [[Math.cos(i), Math.sin(i), 0.1 * i], -1e308]);
    isSame(await draw(...eight), whole, 'eight planes far away');
  }
  assert.equal(await real.stop(), 0);
});
