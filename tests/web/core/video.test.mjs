// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { VideoStream, videoFormats } from '../../../clients/web/core/video.js';

/** Sets up a decoder whose output the test produces by hand. */
function setUp() {
  const it = { decoders: [], asked: 0, given: [] };
  class VideoDecoder {
    state = 'unconfigured';
    chunks = [];
    constructor({ output, error }) {
      Object.assign(this, { output, error });
      it.decoders.push(this);
    }
    configure(config) {
      this.config = config;
      this.state = 'configured';
    }
    decode(chunk) {
      if (it.throws) throw new Error('no');
      this.chunks.push(chunk);
    }
    close() { this.state = 'closed'; }
    show(i) { this.output({ timestamp: this.chunks[i].timestamp, close: () => { it.closed = (it.closed ?? 0) + 1; } }); }
  }
  it.video = new VideoStream({
    env: { VideoDecoder, EncodedVideoChunk: class { constructor(init) { Object.assign(this, init); } } },
    toImage: async (image, frame) => ({ of: frame.frame }),
    askKey: () => { it.asked += 1; },
    giveUp: (error) => it.given.push(error.message),
  });
  it.decode = (frame, isKey = false, codec = 5) => it.video.decode({ frame, isKey, codec, payload: new Uint8Array([frame]) });
  return it;
}

test('one decoder outputs images, each assigned to its frame', async () => {
  const it = setUp();
  const [a, b] = [it.decode(1, true), it.decode(2)];
  const [decoder] = it.decoders;
  assert.deepEqual(decoder.config, { codec: 'vp09.00.10.08', optimizeForLatency: true });
  assert.deepEqual(decoder.chunks.map((c) => c.type), ['key', 'delta']);
  decoder.show(0);
  decoder.show(1);
  assert.deepEqual([await a, await b], [{ of: 1 }, { of: 2 }]);
  assert.equal(it.closed, 2);
  assert.equal(it.decoders.length, 1);
});

test('a delta frame without its key frame gives no image and reaches no decoder', async () => {
  const it = setUp();
  assert.equal(await it.decode(1), null);
  it.decode(2, true, 5);
  assert.equal(await it.decode(3, false, 7), null, 'a delta frame of another codec');
  assert.equal(it.decoders[0].chunks.length, 1);
});

test('another codec starts with its key frame in a new decoder', async () => {
  const it = setUp();
  const old = it.decode(1, true, 5);
  it.decode(2, true, 7);
  assert.equal(await old, null);
  assert.equal(it.decoders[0].state, 'closed');
  assert.equal(it.decoders[1].config.codec, 'vp8');
});

test('after a failure nothing is decoded until the requested key frame arrives', async () => {
  const it = setUp();
  const lost = it.decode(1, true);
  it.decoders[0].error(new Error('bits'));
  assert.equal(await lost, null);
  assert.equal(it.asked, 1);
  assert.equal(await it.decode(2), null);
  const again = it.decode(3, true);
  it.decoders[1].show(0);
  assert.deepEqual(await again, { of: 3 });
  it.decoders[0].error(new Error('late error of the old decoder'));
  assert.equal(it.asked, 1);
});

test('a decoder that fails three times without an image is not used again', async () => {
  const it = setUp();
  it.throws = true;
  for (let i = 1; i <= 3; i += 1) assert.equal(await it.decode(i, true), null);
  assert.equal(it.asked, 2);
  assert.deepEqual(it.given, ['no']);
});

test('a new stream discards the state of the old one', async () => {
  const it = setUp();
  const old = it.decode(1, true);
  it.video.reset();
  assert.equal(await old, null);
  it.decoders[0].show(0); // arrives late and is released
  assert.equal(it.closed, 1);
  assert.equal(await it.decode(2), null);
});

test('the formats are those that the browser supports, and none without WebCodecs', async () => {
  const decoder = (supported) => ({ isConfigSupported: async ({ codec }) => ({ supported: supported.includes(codec) }) });
  assert.deepEqual(await videoFormats(undefined), []);
  assert.deepEqual(await videoFormats(decoder(['vp8', 'vp09.00.10.08'])), ['vp9', 'vp8']);
  assert.deepEqual(await videoFormats({ isConfigSupported: async () => { throw new TypeError('what?'); } }), []);
});
