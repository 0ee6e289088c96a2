// SPDX-License-Identifier: Apache-2.0
// The daemon with the GPU backend on software GL: interactive and snapshot workers render at once; volumes load and unload.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { compare } from '../support/compare.mjs';
import { Daemon, runToEnd, turned } from './harness.mjs';

const software = /^gl-software: /m.test((await runToEnd(['--probe'])).out);
const size = [64, 64];

test('the GPU backend renders streams and snapshots at the same time', { skip: !software && 'no software GL' }, async (t) => {
  const daemon = await Daemon.start(['--volume', 'demo:phantom?size=16', '--volume', 'demo:engine?size=24'], { backend: 'gl-software' });
  t.after(() => daemon.kill('SIGKILL')); // open streams would keep a failed test waiting
  const ready = (await daemon.json('/readyz', { token: null })).json;
  assert.equal(ready.backend, 'gl-software');
  assert.match(ready.device, /software GL/);
  assert.deepEqual(ready.refused, []);
  for (const volume of ['phantom', 'engine']) await daemon.loaded(volume);
  const snapshot = async (volume, i) => {
    const answer = await daemon.fetch('/api/v1/render?format=png', {
      method: 'POST', headers: { 'Content-Type': 'application/json' },
      body: JSON.stringify({ volume, size, background: [i / 8, 0, 0, 1] }),
    });
    assert.equal(answer.status, 200);
    assert.equal(answer.headers.get('X-Backend'), 'gl-software');
    return Buffer.from(await answer.arrayBuffer()).toString('base64');
  };
  const streams = [];
  for (const volume of ['phantom', 'engine']) streams.push(await daemon.stream({ session: await daemon.session({ volume, size }) }));
  const snapshots = [];
  for (let i = 1; i <= 8; i++) {
    for (const stream of streams) await stream.update(turned(stream.session.view, i), i);
    for (const volume of ['phantom', 'engine']) snapshots.push(snapshot(volume, i % 4));
  }
  const images = await Promise.all(snapshots);
  // Equal requests give equal images, whatever is rendered at the same time; different requests give different images.
  for (let i = 0; i < 8; i++) assert.equal(images[i], images[i + 8]);
  assert.equal(new Set(images).size, 8);
  for (const stream of streams) {
    const final = await stream.final(8);
    assert.deepEqual([final.width, final.height], size);
    assert.equal((await stream.note('stream.stats')).params.backend, 'gl-software');
    await stream.end();
    assert.equal((await daemon.fetch(`/api/v1/sessions/${stream.session.id}`, { method: 'DELETE' })).status, 204);
  }
  compare((await daemon.json('/api/v1/volumes/phantom')).json.memory.derived, '>', 0);
  for (const volume of ['phantom', 'engine']) {
    assert.equal((await daemon.fetch(`/api/v1/volumes/${volume}`, { method: 'DELETE' })).status, 204);
  }
  // A new volume that takes the place of an unloaded one is not mistaken for it.
  await daemon.post('/api/v1/volumes', { uri: 'demo:engine?size=24', id: 'phantom' });
  await daemon.loaded('phantom');
  assert.equal(await snapshot('phantom', 0), images.at(-1));
  assert.equal(await daemon.stop(), 0);
});
