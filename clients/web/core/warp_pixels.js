// SPDX-License-Identifier: Apache-2.0
// Draws a frame as another camera would see it, pixel by pixel, for browsers without a GPU: where WebGL runs on the processor, this takes a
// fraction of its time. Within a tile (warp_tiles.js), the place in the frame is affine in the place in the picture.
import { TILE, WarpTiles } from './warp_tiles.js';

const JUMP = 4 * 1.5; // px of the frame: neighbours whose places differ by more lie on two surfaces
const ONE = 65536; // a px of the frame; sums of integers stay exact
const EVEN = 0x00ff00ff; // two channels of a px; the others
const ODD = 0xff00ff00 | 0;
const HALF = 0x00800080; // of the lowest bit of two channels

/** How a place changes from a tile to the next one: between neighbours on the same surface, else as in a frame that is not warped. */
function slopeOf(places, tile, before, after, usual) {
  const most = JUMP + usual;
  const ahead = places[after] - places[tile];
  const behind = places[tile] - places[before];
  const isAhead = after !== tile && Math.abs(ahead - usual) < most;
  const isBehind = before !== tile && Math.abs(behind - usual) < most;
  if (isAhead && isBehind) return (ahead + behind) / 2;
  return isAhead ? ahead : isBehind ? behind : usual;
}

export class PixelWarp {
  #tiles = new WarpTiles();
  #pixels = null; // of the frame
  #size = [0, 0]; // of the frame
  #out = null; // what was drawn into last, with which background
  #ground = 0;
  #isDrawn = new Uint8Array(0); // per tile of it: 1 = not only background

  /** frame: {pixels (Int32Array), width, height, values (Uint8Array, a value per cell), cells, camera, near, far, aspect}. */
  take(frame) {
    this.#pixels = frame.pixels;
    this.#size = [frame.width, frame.height];
    this.#tiles.take(frame);
  }

  /**
   * Draws into `out` (Int32Array of width · height px); ground: the background as a px. What was drawn last may be in `out`; then only what
   * changes is written. Returns the box {left, top, right, bottom} of px outside of which all is background. Returns null if the camera sees the
   * frame from no useful place.
   */
  draw(camera, out, [width, height], ground) {
    const tiles = this.#tiles;
    if (!tiles.place(camera, width, height)) return null;
    const { columns, rows, isEmpty, box } = tiles;
    if (out !== this.#out || ground !== this.#ground || this.#isDrawn.length !== columns * rows) {
      out.fill(ground);
      [this.#out, this.#ground, this.#isDrawn] = [out, ground, new Uint8Array(columns * rows)];
    }
    const drawn = this.#isDrawn;
    for (let row = 0, tile = 0; row < rows; row += 1) {
      const isInside = row >= box.top && row < box.bottom;
      for (let column = 0; column < columns; column += 1, tile += 1) {
        const isVisible = isInside && column >= box.left && column < box.right && !(isEmpty[tile]
          && (column === 0 || isEmpty[tile - 1]) && (column + 1 === columns || isEmpty[tile + 1])
          && (row === 0 || isEmpty[tile - columns]) && (row + 1 === rows || isEmpty[tile + columns]));
        if (isVisible) this.#drawTile(column, row, out, width, height);
        else if (drawn[tile]) this.#clearTile(column, row, out, width, height);
        drawn[tile] = Number(isVisible);
      }
    }
    return { left: box.left * TILE, top: box.top * TILE, right: Math.min(box.right * TILE, width), bottom: Math.min(box.bottom * TILE, height) };
  }

  #clearTile(column, row, out, width, height) {
    const toX = Math.min((column + 1) * TILE, width);
    const toY = Math.min((row + 1) * TILE, height);
    for (let y = row * TILE; y < toY; y += 1) out.fill(this.#ground, y * width + column * TILE, y * width + toX);
  }

  #drawTile(column, row, out, width, height) {
    const { columns, left, top, box } = this.#tiles;
    const [wide, high] = this.#size;
    const tile = row * columns + column;
    const fromX = column * TILE;
    const fromY = row * TILE;
    const toX = Math.min(fromX + TILE, width);
    const toY = Math.min(fromY + TILE, height);
    const west = column > box.left ? tile - 1 : tile; // a tile at the border is its own neighbour
    const east = column + 1 < box.right ? tile + 1 : tile;
    const north = row > box.top ? tile - columns : tile;
    const south = row + 1 < box.bottom ? tile + columns : tile;
    const ux = slopeOf(left, tile, west, east, TILE * wide / width) / TILE;
    const vx = slopeOf(top, tile, west, east, 0) / TILE;
    const uy = slopeOf(left, tile, north, south, 0) / TILE;
    const vy = slopeOf(top, tile, north, south, TILE * high / height) / TILE;
    const aside = 0.5 - TILE / 2;
    const stepX = Math.round(ONE * ux) | 0;
    const stepY = Math.round(ONE * vx) | 0;
    const mostX = ONE * (wide - 1) - 1;
    const mostY = ONE * (high - 1) - 1;
    let startX = Math.round(ONE * (left[tile] - 0.5 + (ux + uy) * aside)) | 0; // px centres lie at 0.5
    let startY = Math.round(ONE * (top[tile] - 0.5 + (vx + vy) * aside)) | 0;
    const downX = Math.round(ONE * uy) | 0;
    const downY = Math.round(ONE * vy) | 0;
    const pixels = this.#pixels;
    for (let y = fromY; y < toY; y += 1) {
      let x16 = startX;
      let y16 = startY;
      for (let at = y * width + fromX, end = y * width + toX; at < end; at += 1) {
        const px = x16 < 0 ? 0 : x16 > mostX ? mostX : x16;
        const py = y16 < 0 ? 0 : y16 > mostY ? mostY : y16;
        const fx = (px >> 8) & 255;
        const fy = (py >> 8) & 255;
        const from = Math.imul(py >> 16, wide) + (px >> 16);
        const a = pixels[from];
        const b = pixels[from + 1];
        const c = pixels[from + wide];
        const d = pixels[from + wide + 1];
        // Two channels at a time; the four weights add up to 256.
        const last = Math.imul(fx, fy) >> 8;
        const right = fx - last;
        const below = fy - last;
        const first = 256 - fx - below;
        const even = Math.imul(a & EVEN, first) + Math.imul(b & EVEN, right) + Math.imul(c & EVEN, below) + Math.imul(d & EVEN, last) + HALF;
        const odd = Math.imul((a >>> 8) & EVEN, first) + Math.imul((b >>> 8) & EVEN, right) + Math.imul((c >>> 8) & EVEN, below)
          + Math.imul((d >>> 8) & EVEN, last) + HALF;
        out[at] = ((even >>> 8) & EVEN) | (odd & ODD);
        x16 = (x16 + stepX) | 0;
        y16 = (y16 + stepY) | 0;
      }
      startX = (startX + downX) | 0;
      startY = (startY + downY) | 0;
    }
  }
}
