// SPDX-License-Identifier: Apache-2.0
// Decodes video of a moving view (protocol/stream.md, Video) with the browser's decoder (WebCodecs), in the order of arrival.
// A delta frame needs all frames since its key frame. After a failure the client requests a key frame and decodes nothing
// until it arrives.

/** The protocol's and the browser's name of a codec, by the codec number in the frame header. */
const CODECS = new Map([
  [5, { name: 'vp9', codec: 'vp09.00.10.08' }],
  [7, { name: 'vp8', codec: 'vp8' }],
  [4, { name: 'h264', codec: 'avc1.4d0028' }],
]);
const FAILURES_MAX = 3;

/** The video formats that this browser decodes, ordered by the size of their frames, the smallest first; empty without WebCodecs. */
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
  #env; #toImage; #askKey; #giveUp;
  #decoder = null;
  #codec = 0;
  #time = 0;
  #failures = 0;
  #pending = new Map();

  /**
   * env: {VideoDecoder, EncodedVideoChunk}; toImage(videoFrame, frame) → Promise of an image; askKey() requests a key frame;
   * giveUp(error) reports repeated failures.
   */
  constructor({ env, toImage, askKey, giveUp }) {
    this.#env = env;
    this.#toImage = toImage;
    this.#askKey = askKey;
    this.#giveUp = giveUp;
  }

  /** Starts a new stream; frames that still decode are dropped. */
  reset() {
    this.#failures = 0;
    this.#drop();
  }

  /** Takes frames in the order of their numbers. Resolves to an image, or to null for a frame that cannot be decoded. */
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
      waiting.resolve(await this.#toImage(picture, waiting.frame));
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
