// SPDX-License-Identifier: Apache-2.0
// Drawing in order: pictures decode at the same time and may finish in any order; an older one is never drawn
// over a newer one, and every frame is acknowledged exactly once, whether it was drawn, overtaken or undecodable.

export class FrameOrder {
  #decode; #draw; #ack; #fail;
  #epoch = 0;
  #newest = -1;

  /**
   * decode(frame) → Promise of a picture (with an optional close()), or of null if there is none; draw(picture, frame), synchronous;
   * ack(frame); fail(error, frame).
   */
  constructor({ decode, draw, ack, fail }) {
    this.#decode = decode;
    this.#draw = draw;
    this.#ack = ack;
    this.#fail = fail;
  }

  /** A new stream: frame numbers begin again, and what still decodes belongs to the old one. */
  reset() {
    this.#epoch += 1;
    this.#newest = -1;
  }

  /** Takes one decoded header with its payload; resolves to true once drawn, false when it was not. */
  async put(frame) {
    const epoch = this.#epoch;
    let picture = null;
    let drawn = false;
    try {
      picture = await this.#decode(frame);
      if (picture && epoch === this.#epoch && frame.frame > this.#newest) {
        this.#newest = frame.frame;
        this.#draw(picture, frame);
        drawn = true;
      }
    } catch (error) {
      if (epoch === this.#epoch) this.#fail(error, frame);
    } finally {
      picture?.close?.();
    }
    if (epoch === this.#epoch) this.#ack(frame);
    return drawn;
  }
}
