// SPDX-License-Identifier: Apache-2.0
// Limits on images: their size through every interface, the pixels of video, and open files.
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { compare } from '../support/compare.mjs';
import { Daemon, Raw, turned } from './harness.mjs';

const CODECS = { jpeg: 1, vp8: 7 };
let daemon;
before(async () => {
  daemon = await Daemon.start(['--volume', 'demo:engine?size=32', '--frame-size', '1024x512', '--video-pixels', '512x512']);
  await daemon.loaded('engine');
});
after(async () => assert.equal(await daemon.stop(), 0));

const LARGEST = [512, 1024];
const LARGER = [725, 724];

test('no interface gives an image larger than --frame-size', async () => {
  const refused = (answer) => {
    assert.equal(answer.status, 422);
    assert.equal(answer.json.pointer, '/size');
    assert.match(answer.json.detail, /725 x 724 are 524900 px and --frame-size allows 524288/);
  };
  const { json: { id } } = await daemon.post('/api/v1/views', { size: LARGEST });
  assert.equal((await daemon.fetch(`/api/v1/render/${id}`)).status, 200);
  refused(await daemon.post('/api/v1/views', { size: LARGER }));
  refused(await daemon.post('/api/v1/render', { size: LARGER }));
  refused(await daemon.json(`/api/v1/render/${id}?size=${LARGER}`));
  const session = await daemon.session({ size: LARGEST });
  const create = await daemon.post('/api/v1/sessions', { view: { size: LARGER } });
  assert.deepEqual([create.status, create.json.pointer], [422, '/view/size']);
  const patch = await daemon.post(`/api/v1/sessions/${session.id}`, { view: { size: LARGER } }, { method: 'PATCH' });
  assert.deepEqual([patch.status, patch.json.pointer], [422, '/view/size']);
  const stream = await daemon.stream({ session });
  await assert.rejects(stream.call('stream.configure', { size: LARGER }), (e) => e.code === -32602 && e.data.pointer === '/size');
  await assert.rejects(stream.update({ size: LARGER }), (e) => e.code === -32000 && e.data.pointer === '/size');
  assert.deepEqual((await stream.call('stream.configure', { size: LARGEST })).size, LARGEST);
  assert.deepEqual((await stream.call('view.get')).view.size, LARGEST);
  await stream.end();
});

test('streams over --video-pixels get JPEG, and the client is notified', async () => {
  const stream = await daemon.stream();
  const drag = async (enough, what) => {
    const { view } = await stream.call('view.get');
    const end = performance.now() + 60000;
    for (let step = 1; !enough(); step++) {
      compare(performance.now(), '<', end, what);
      await stream.update(turned(view, step));
    }
  };
  const count = (codec, from) => stream.frames.slice(from).filter((f) => f.codec === codec).length;
  assert.equal((await stream.call('stream.configure', { format: 'vp8', size: LARGEST, max_fps: 120 })).format, 'vp8');
  await drag(() => count(CODECS.jpeg, 0) > 5, 'JPEG instead of video');
  assert.equal(count(CODECS.vp8, 0), 0);
  await stream.note('stream.policy', ({ moving, final, why }) => moving.format === 'jpeg' && final.format === 'jpeg' && why.includes('video_pixels'));
  const told = stream.notes.length;
  await stream.call('stream.configure', { size: [256, 256] });
  const from = stream.frames.length;
  await drag(() => count(CODECS.vp8, from) > 5, 'video of a smaller size');
  const policy = stream.notes.slice(told).filter((n) => n.method === 'stream.policy').at(-1).params;
  assert.deepEqual([policy.moving.format, policy.why.includes('video_pixels')], ['vp8', false]);
  await stream.end();
});

// Without a check of that limit, late clients would wait in the kernel's backlog without an answer.
for (const [what, hard, count] of [['is raised', 2000, 100], ['is too low, so that there are fewer connections', 262, 70]]) {
  test(`the limit of open files ${what}: every client gets an answer`, async (t) => {
    const small = await Daemon.start(['--connections', '100', '--http-threads', '1'],
      { prefix: ['/bin/bash', '-c', `ulimit -Sn 100; ulimit -Hn ${hard}; exec "$@"`, 'splatd'] });
    const warned = small.log.includes(`--connections lowered from 100 to ${count}: it needs 292 file descriptors and the limit is ${hard}`);
    assert.equal(warned, count < 100, small.log);
    const held = [];
    t.after(() => held.forEach((raw) => raw.destroy()));
    const ask = async (raw) => {
      raw.write('GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n');
      await raw.until(() => /\r\n\r\n/.test(raw.text()), 'an answer');
      return Number(/^HTTP\/1\.1 (\d+)/.exec(raw.text())[1]);
    };
    while (held.length < count) {
      held.push(await Raw.connect(small.port));
      if (held.length < count * 0.75) assert.equal(await ask(held.at(-1)), 200); // over the share of clients without a token it would be closed
    }
    for (let i = 0; i < 60; i++) {
      held.push(await Raw.connect(small.port));
      assert.equal(await ask(held.at(-1)), 503);
    }
    assert.match(held.at(-1).text(), new RegExp(`--connections allows ${count}`));
    assert.equal(await small.stop(), 0);
  });
}
