// SPDX-License-Identifier: Apache-2.0
// Video while a view changes: the granted formats, the frames that arrive, and a full-quality image of a view at rest. (Tests
// of decoding: tests/unit/server/render/video_test.c and, in a browser, tests/web/page/video.test.mjs.)
import assert from 'node:assert/strict';
import { after, before, test } from 'node:test';
import { compare } from '../support/compare.mjs';
import { Daemon, FINAL, LOSSLESS, turned } from './harness.mjs';

const KEY = 1;
const CODECS = { jpeg: 1, png: 2, h264: 4, vp9: 5, vp8: 7 };
let daemon;
before(async () => {
  daemon = await Daemon.start(['--volume', 'demo:engine?size=32', '--encode-threads', '2']);
  await daemon.loaded('engine');
});
after(async () => assert.equal(await daemon.stop(), 0));

/** Moves the camera until `enough()` is true, then waits for the final frame of the last view. */
async function move(streams, enough, what) {
  const [first] = streams;
  const { view } = await first.call('view.get');
  const end = performance.now() + 60000;
  let step = 0;
  while (!enough()) {
    compare(performance.now(), '<', end, what);
    await first.update(turned(view, ++step));
  }
  await first.update(turned(view, ++step));
  const { seq } = await first.call('view.get');
  await first.final(seq);
}

const isVideo = (frame) => [CODECS.h264, CODECS.vp9, CODECS.vp8].includes(frame.codec);
const videos = (stream) => stream.frames.filter(isVideo);

test('formats are negotiated, with JPEG as the fallback', async () => {
  const stream = await daemon.stream();
  const granted = async (format) => (await stream.call('stream.configure', { format })).format;
  assert.equal(await granted('vp9'), 'vp9');
  assert.equal((await stream.call('stream.configure', { quality: 80 })).format, 'vp9', 'a field that the request omits does not change');
  assert.equal(await granted(['av1', 'vp8', 'jpeg']), 'vp8');
  assert.equal(await granted(['av1', 'h265']), 'jpeg');
  assert.equal(await granted(['webp', 'vp9']), 'webp');
  assert.match(await granted(['h264', 'vp9']), /^(h264|vp9)$/);
  const { formats } = await stream.call('stream.configure', {});
  assert.deepEqual(formats.slice(0, 3).sort(), ['jpeg', 'png', 'webp']);
  for (const format of ['vp8', 'vp9', 'h264']) { // the list says exactly what is granted
    assert.equal(await granted([format]), formats.includes(format) ? format : 'jpeg', format);
  }
  for (const format of ['av1', 'exr', [], ['vp9', 1], Array(17).fill('vp9'), 7, null, {}])
    await assert.rejects(granted(format), (error) => error.code === -32602 && error.data.pointer === '/format', JSON.stringify(format));
  await assert.rejects(stream.call('stream.key', { x: 1 }), (error) => error.code === -32602);
  await stream.end();
});

for (const format of ['vp8', 'vp9']) {
  test(`${format}: a changing view is sent as video, a view at rest as a JPEG of full size`, async () => {
    const stream = await daemon.stream();
    assert.equal((await stream.call('stream.configure', { format, size: [320, 200], max_fps: 120 })).format, format);
    await move([stream], () => videos(stream).length >= 20, '20 frames of video');
    const list = videos(stream);
    assert.ok(list.every((f) => f.codec === CODECS[format] && !(f.flags & FINAL)));
    assert.ok(list[0].flags & KEY, 'the first frame is a key frame');
    compare(list.filter((f) => !(f.flags & KEY)).length, '>=', 10, 'most frames are delta frames');
    list.forEach((f, i) => {
      const other = i > 0 && (f.width !== list[i - 1].width || f.height !== list[i - 1].height);
      if (other) assert.ok(f.flags & KEY, 'a new size starts with a key frame');
    });
    const last = stream.frames.at(-1);
    assert.deepEqual([last.codec, last.flags & FINAL, last.width, last.height], [CODECS.jpeg, FINAL, 320, 200]);
    await stream.end();
  });
}

test('a view at rest is lossless, as without video', async () => {
  const stream = await daemon.stream();
  await stream.call('stream.configure', { format: ['vp9', 'jpeg'], lossless: true, max_fps: 120 });
  await move([stream], () => videos(stream).length >= 5, '5 frames of video');
  const last = stream.frames.at(-1);
  assert.equal(last.codec, CODECS.png);
  assert.equal(last.flags & (FINAL | LOSSLESS), FINAL | LOSSLESS);
  await stream.end();
});

test('a joining client and a client that asks get a key frame; a client that prefers images gets images', async () => {
  const first = await daemon.stream();
  await first.call('stream.configure', { format: 'vp8', size: [160, 120], max_fps: 120 });
  await move([first], () => videos(first).length >= 5, '5 frames of video');
  const [second, third] = [await daemon.stream({ session: first.session }), await daemon.stream({ session: first.session })];
  await second.call('stream.configure', { format: 'vp8', size: [160, 120], max_fps: 120 });
  await third.call('stream.configure', { format: 'jpeg', size: [160, 120], max_fps: 120 });
  await move([first], () => videos(second).length >= 5, '5 frames of video for the second');
  assert.ok(videos(second)[0].flags & KEY);
  assert.equal(videos(third).length, 0);
  compare(third.frames.length, '>', 2);
  const from = videos(second).length;
  second.notify('stream.key', {});
  await move([first], () => videos(second).length > from, 'video after asking for a key frame');
  assert.ok(videos(second)[from].flags & KEY);
  await Promise.all([first, second, third].map((s) => s.end()));
});

test('a slow client gets only frames that it can decode, and finally the last view', async () => {
  const fast = await daemon.stream();
  const slow = await daemon.stream({ session: fast.session });
  for (const stream of [fast, slow]) await stream.call('stream.configure', { format: 'vp9', size: [160, 120], max_fps: 120 });
  slow.acks = false;
  await move([fast, slow], () => videos(fast).length >= 30, '30 frames of video');
  slow.acks = true;
  slow.ack(slow.frames.at(-1).frame);
  await slow.until(() => slow.frames.at(-1).flags & FINAL, 'the last view');
  compare(videos(slow).length, '<', videos(fast).length);
  await Promise.all([fast.end(), slow.end()]);
});

test('clients may leave, change formats and ask for key frames in the middle of a drag', async () => {
  const first = await daemon.stream();
  await first.call('stream.configure', { format: 'vp9', size: [96, 64], max_fps: 120 });
  for (let round = 0; round < 8; round++) {
    const guest = await daemon.stream({ session: first.session });
    const format = ['vp8', 'vp9', 'jpeg', ['h264', 'vp8']][round % 4];
    await guest.call('stream.configure', { format, size: [96 + 32 * (round % 3), 64], max_fps: 120 });
    const from = guest.frames.length;
    await move([first], () => guest.frames.length > from + 3, 'frames for the guest');
    const switched = guest.call('stream.configure', { format: 'vp9' }).catch(() => {});
    if (round % 2) await switched;
    guest.socket.terminate();
  }
  await move([first], () => videos(first).length > 20, 'video goes on');
  await first.end();
});
