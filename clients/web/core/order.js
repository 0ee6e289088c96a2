// SPDX-License-Identifier: Apache-2.0
// Draws frames in order. Frames decode in parallel and may finish in any order; at the next animation frame the newest one is
// drawn. An older frame is never drawn over a newer one.
//
// A frame is acknowledged when it arrives, so that decoding does not look like a slow network. But a decoder that is behind
// delays acknowledgements, so that the daemon sends no more than it can decode.

const DECODING_MAX = 3;

export class FrameOrder {
  #decode; #schedule; #draw; #ack; #fail;
  #epoch = 0;
  #newest = -1;
  #decoding = 0;
  #owed = null; // the newest frame that is not acknowledged
  #next = null; // {image, frame, done}: drawn at the next animation frame

  /**
   * decode(frame) → Promise of an image (with an optional close()), or of null; schedule(f) calls f at the next animation frame;
   * draw(image, frame) is synchronous; ack(frame) acknowledges all frames up to this one; fail(error, frame).
   */
  constructor({ decode, schedule, draw, ack, fail }) {
    this.#decode = decode;
    this.#schedule = schedule;
    this.#draw = draw;
    this.#ack = ack;
    this.#fail = fail;
  }

  /** Starts a new stream: frame numbers start again, and frames that still decode are dropped. */
  reset() {
    this.#epoch += 1;
    this.#newest = -1;
    this.#decoding = 0;
    this.#owed = null;
    this.#drop();
  }

  /** Takes one frame header with its payload. Resolves to true once the frame is drawn, or to false if it is not. */
  async put(frame) {
    const epoch = this.#epoch;
    this.#decoding += 1;
    this.#owed = frame;
    this.#acknowledge();
    let image = null;
    try {
      image = await this.#decode(frame);
    } catch (error) {
      if (epoch === this.#epoch) this.#fail(error, frame);
    }
    if (epoch === this.#epoch) {
      this.#decoding -= 1;
      this.#acknowledge();
    }
    if (image && epoch === this.#epoch && frame.frame > this.#newest) return this.#show(image, frame);
    image?.close?.();
    return false;
  }

  #acknowledge() {
    if (!this.#owed || this.#decoding > DECODING_MAX) return;
    this.#ack(this.#owed);
    this.#owed = null;
  }

  #show(image, frame) {
    this.#newest = frame.frame;
    if (this.#next) this.#drop();
    else this.#schedule(() => this.#drawNext());
    return new Promise((done) => { this.#next = { image, frame, done }; });
  }

  #drawNext() {
    const next = this.#next;
    this.#next = null;
    if (!next) return;
    try {
      this.#draw(next.image, next.frame);
    } finally {
      next.image.close?.();
      next.done(true);
    }
  }

  #drop() {
    this.#next?.image.close?.();
    this.#next?.done(false);
    this.#next = null;
  }
}
