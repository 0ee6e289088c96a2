// SPDX-License-Identifier: Apache-2.0
// Video of a view that moves (protocol/stream.md, Video): frames of video in the order in which they came, through a decoder
// of the browser (WebCodecs), out as pictures. A delta needs all frames since the key frame before it: after a failure nothing
// is decoded until the next key frame, which is asked for.

/** By the codec number of the frame's header: the protocol's name and the browser's. */
const CODECS = new Map([
  [5, { name: 'vp9', codec: 'vp09.00.10.08' }],
  [7, { name: 'vp8', codec: 'vp8' }],
  [4, { name: 'h264', codec: 'avc1.4d0028' }],
]);
const FAILURES_MAX = 3;

/** The names of the formats that this browser decodes, the smallest pictures first; empty without WebCodecs. */
export async function videoFormats(VideoDecoder) {
  const names = [];
  if (!VideoDecoder) return names;
  for (const { name, codec } of CODECS.values()) {
    try {
      if ((await VideoDecoder.isConfigSupported({ codec })).supported) names.push(name);
    } catch { /* not even the question is understood */ }
  }
  return names;
}

export class VideoStream {
  #env; #toPicture; #askKey; #giveUp;
  #decoder = null;
  #codec = 0;
  #time = 0;
  #failures = 0;
  #pending = new Map();

  /**
   * env: {VideoDecoder, EncodedVideoChunk}; toPicture(videoFrame, frame) → Promise of a picture; askKey(): the next frame must
   * be a key frame; giveUp(error): it failed time and again.
   */
  constructor({ env, toPicture, askKey, giveUp }) {
    this.#env = env;
    this.#toPicture = toPicture;
    this.#askKey = askKey;
    this.#giveUp = giveUp;
  }

  /** A new stream: what still decodes belongs to the old one and gives no picture. */
  reset() {
    this.#failures = 0;
    this.#drop();
  }

  /** Frames in the order of their numbers. Promise of a picture; of null for a frame that cannot be decoded by itself. */
  decode(frame) {
    if (frame.isKey && (!this.#decoder || this.#codec !== frame.codec)) {
      this.#drop();
      this.#open(frame.codec);
    }
    if (!this.#decoder || this.#codec !== frame.codec) return Promise.resolve(null);
    const timestamp = ++this.#time;
    return new Promise((resolve) => {
      this.#pending.set(timestamp, { frame, resolve });
      try {
        this.#decoder.decode(new this.#env.EncodedVideoChunk({
          type: frame.isKey ? 'key' : 'delta', timestamp, data: frame.payload,
        }));
      } catch (error) {
        this.#fail(error);
      }
    });
  }

  #open(codec) {
    const decoder = new this.#env.VideoDecoder({
      output: (picture) => this.#take(decoder, picture),
      error: (error) => decoder === this.#decoder && this.#fail(error),
    });
    this.#decoder = decoder;
    this.#codec = codec;
    try {
      decoder.configure({ codec: CODECS.get(codec).codec, optimizeForLatency: true });
    } catch (error) {
      this.#fail(error);
    }
  }

  async #take(decoder, picture) {
    const waiting = decoder === this.#decoder ? this.#pending.get(picture.timestamp) : null;
    if (!waiting) {
      picture.close();
      return;
    }
    this.#pending.delete(picture.timestamp);
    this.#failures = 0;
    try {
      waiting.resolve(await this.#toPicture(picture, waiting.frame));
    } catch {
      waiting.resolve(null);
    } finally {
      picture.close();
    }
  }

  #fail(error) {
    this.#drop();
    this.#failures += 1;
    if (this.#failures >= FAILURES_MAX) this.#giveUp(error);
    else this.#askKey();
  }

  #drop() {
    const decoder = this.#decoder;
    this.#decoder = null;
    if (decoder && decoder.state !== 'closed') decoder.close();
    for (const { resolve } of this.#pending.values()) resolve(null);
    this.#pending.clear();
  }
}
