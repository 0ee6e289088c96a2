// SPDX-License-Identifier: Apache-2.0
// Draws frames in order. Frames decode in parallel and may finish in any order. An older frame is never drawn over a newer
// one. Every frame is acknowledged exactly once, whether it was drawn, superseded or undecodable.

export class FrameOrder {
  #decode; #draw; #ack; #fail;
  #epoch = 0;
  #newest = -1;

  /**
   * decode(frame) → Promise of an image (with an optional close()), or of null; draw(image, frame) is synchronous;
   * ack(frame); fail(error, frame).
   */
  constructor({ decode, draw, ack, fail }) {
    this.#decode = decode;
    this.#draw = draw;
    this.#ack = ack;
    this.#fail = fail;
  }

  /** Starts a new stream: frame numbers start again, and frames that still decode are dropped. */
  reset() {
    this.#epoch += 1;
    this.#newest = -1;
  }

  /** Takes one frame header with its payload. Resolves to true once the frame is drawn, or to false if it is not. */
  async put(frame) {
    const epoch = this.#epoch;
    let image = null;
    let drawn = false;
    try {
      image = await this.#decode(frame);
      if (image && epoch === this.#epoch && frame.frame > this.#newest) {
        this.#newest = frame.frame;
        this.#draw(image, frame);
        drawn = true;
      }
    } catch (error) {
      if (epoch === this.#epoch) this.#fail(error, frame);
    } finally {
      image?.close?.();
    }
    if (epoch === this.#epoch) this.#ack(frame);
    return drawn;
  }
}
