// SPDX-License-Identifier: Apache-2.0
// Draws a frame as another camera would see it, pixel by pixel, for browsers without a GPU: where WebGL runs on the processor, this takes a
// third of its time.
//
//   cells of the frame ──► nearest point per tile of the picture ──► place in the frame and its slope, per tile ──► pixels
//
// A tile is a square of TILE px of the picture. A tile that no point of the frame lands on was hidden in the frame: it repeats the farthest
// tile beside it.
import { depthMatrix } from './warp_depth.js';

const TILE = 6;
const FILL_STEPS = 24; // tiles that a hidden part may be wide
const JUMP = 1.5; // cells of the frame: neighbours whose places differ by more lie on two surfaces
const BEHIND = 1e9;
const STEP_PART = 1 / 16; // of the frame's range of depths: with more between them, two points lie on two surfaces

/** The inverse of a 4 × 4 matrix, by Gauss and Jordan; null if it has none. */
function inverse(matrix) {
  const rows = [0, 1, 2, 3].map((r) => [0, 1, 2, 3].map((c) => matrix[4 * c + r]).concat([0, 1, 2, 3].map((c) => Number(c === r))));
  for (let c = 0; c < 4; c += 1) {
    const pivot = rows.slice(c).reduce((best, row) => (Math.abs(row[c]) > Math.abs(best[c]) ? row : best));
    if (!(Math.abs(pivot[c]) > 0)) return null;
    rows.splice(rows.indexOf(pivot), 1);
    rows.splice(c, 0, pivot.map((x) => x / pivot[c]));
    rows.forEach((row, r) => { if (r !== c) rows[r] = row.map((x, i) => x - row[c] * rows[c][i]); });
  }
  return rows.map((row) => row.slice(4));
}

export class PixelWarp {
  #frame = null; // {pixels, width, height, values, cells, camera, near, far, aspect}
  #x = new Float32Array(0); // per cell of the frame: its place in the picture [tiles], and its depth there
  #y = new Float32Array(0);
  #z = new Float32Array(0);
  #step = 0; // between the depths of two surfaces
  #columns = 0; // of tiles
  #rows = 0;
  #depth = new Float32Array(0); // per tile: of the nearest point; BEHIND = there is none
  #sums = new Float32Array(0); // per tile: of weighted depths, and of the weights
  #weights = new Float32Array(0);
  #left = new Float32Array(0); // per tile: the place in the frame of its centre [px]
  #top = new Float32Array(0);
  #isEmpty = new Uint8Array(0); // per tile: 1 = the background

  /** frame: {pixels (Int32Array), width, height, values (Uint8Array, a value per cell), cells, camera, near, far, aspect}. */
  take(frame) { this.#frame = frame; }

  /** Draws into `out` (Int32Array of width · height px); ground: the background as a px. False if the camera sees the frame from no useful place. */
  draw(camera, out, [width, height], ground) {
    const matrix = depthMatrix(this.#frame, camera, width / height);
    const back = inverse(matrix);
    if (!back) return false;
    this.#resize(Math.ceil(width / TILE), Math.ceil(height / TILE));
    this.#project(matrix, width, height);
    this.#cover(width, height);
    this.#place(back, width, height);
    this.#fill();
    for (let row = 0; row < this.#rows; row += 1) {
      for (let column = 0; column < this.#columns; column += 1) this.#drawTile(column, row, out, width, height, ground);
    }
    return true;
  }

  #resize(columns, rows) {
    [this.#columns, this.#rows] = [columns, rows];
    if (this.#depth.length !== columns * rows) {
      [this.#depth, this.#sums, this.#weights, this.#left, this.#top] = [0, 1, 2, 3, 4].map(() => new Float32Array(columns * rows));
      this.#isEmpty = new Uint8Array(columns * rows);
    }
    this.#depth.fill(BEHIND);
  }

  /** Where the cells of the frame are in the picture [tiles], and their depths. */
  #project(m, width, height) {
    const { values, cells: [across, down], width: wide, height: high } = this.#frame;
    const [scaleX, scaleY] = [width / 2 / TILE, height / 2 / TILE];
    const depthOf = (x, y, v) => (m[2] * x + m[6] * y + m[10] * v + m[14]) / (m[3] * x + m[7] * y + m[11] * v + m[15]);
    this.#step = STEP_PART * Math.abs(depthOf(0, 0, 1 / 255) - depthOf(0, 0, 1));
    if (this.#x.length !== values.length) [this.#x, this.#y, this.#z] = [0, 1, 2].map(() => new Float32Array(values.length));
    for (let row = 0, cell = 0; row < down; row += 1) {
      const y = 1 - 2 * Math.min((4 * row + 2) / high, 1);
      for (let column = 0; column < across; column += 1, cell += 1) {
        const x = 2 * Math.min((4 * column + 2) / wide, 1) - 1;
        const v = Math.max(values[cell], 1) / 255;
        const w = m[3] * x + m[7] * y + m[11] * v + m[15];
        const z = (m[2] * x + m[6] * y + m[10] * v + m[14]) / w;
        this.#x[cell] = ((m[0] * x + m[4] * y + m[8] * v + m[12]) / w + 1) * scaleX;
        this.#y[cell] = (1 - (m[1] * x + m[5] * y + m[9] * v + m[13]) / w) * scaleY;
        this.#z[cell] = !(w > 0) || z < -1 ? BEHIND : values[cell] ? z : z + 2 * this.#step; // the background lies behind all
      }
    }
  }

  /** Visits each tile whose centre lies in a cell. isNearest: finds the nearest depth of the tile; else sums up the depths of that surface, weighted
   * by how near the centres are. */
  #scatter(width, height, isNearest) {
    const { width: wide, height: high, values } = this.#frame;
    const [columns, rows, depth, z, empty, sums, weights] = [this.#columns, this.#rows, this.#depth, this.#z, this.#isEmpty, this.#sums, this.#weights];
    const [halfX, halfY] = [Math.max(0.5, 2 * width / TILE / wide), Math.max(0.5, 2 * height / TILE / high)]; // of a cell, in tiles
    for (let cell = 0; cell < values.length; cell += 1) {
      const own = z[cell];
      if (own === BEHIND) continue;
      const isEmpty = values[cell] ? 0 : 1;
      const x = this.#x[cell] - 0.5; // of the cell, from the centre of the first tile
      const y = this.#y[cell] - 0.5;
      const left = Math.max(0, Math.ceil(x - halfX));
      const right = Math.min(columns - 1, Math.floor(x + halfX));
      const bottom = Math.min(rows - 1, Math.floor(y + halfY));
      for (let row = Math.max(0, Math.ceil(y - halfY)); row <= bottom; row += 1) {
        for (let column = left, tile = row * columns + left; column <= right; column += 1, tile += 1) {
          if (isNearest && own < depth[tile]) {
            depth[tile] = own;
            empty[tile] = isEmpty;
          } else if (!isNearest && own <= depth[tile] + this.#step && isEmpty === empty[tile]) {
            const weight = (halfX + 0.5 - Math.abs(x - column)) * (halfY + 0.5 - Math.abs(y - row));
            sums[tile] += weight * own;
            weights[tile] += weight;
          }
        }
      }
    }
  }

  /** The depth of each tile: the mean of the points of its nearest surface. */
  #cover(width, height) {
    this.#scatter(width, height, true);
    this.#sums.fill(0);
    this.#weights.fill(0);
    this.#scatter(width, height, false);
    this.#depth.forEach((_, tile) => { if (this.#weights[tile] > 0) this.#depth[tile] = this.#sums[tile] / this.#weights[tile]; });
  }

  /** The place in the frame of the centre of each tile that a point landed on. */
  #place([first, second, , last], width, height) {
    const { width: wide, height: high } = this.#frame;
    for (let row = 0, tile = 0; row < this.#rows; row += 1) {
      const y = 1 - 2 * (row + 0.5) * TILE / height;
      for (let column = 0; column < this.#columns; column += 1, tile += 1) {
        const z = this.#depth[tile];
        const x = 2 * (column + 0.5) * TILE / width - 1;
        const w = last[0] * x + last[1] * y + last[2] * z + last[3];
        this.#left[tile] = ((first[0] * x + first[1] * y + first[2] * z + first[3]) / w + 1) / 2 * wide;
        this.#top[tile] = (1 - (second[0] * x + second[1] * y + second[2] * z + second[3]) / w) / 2 * high;
      }
    }
  }

  /** Tiles that no point landed on take the farthest of the tiles beside them, ring by ring. */
  #fill() {
    const [columns, rows, depth] = [this.#columns, this.#rows, this.#depth];
    let open = [];
    depth.forEach((z, tile) => { if (z === BEHIND) open.push(tile); });
    for (let step = 0; step < FILL_STEPS && open.length; step += 1) {
      const found = open.map((tile) => {
        const column = tile % columns;
        const beside = [column > 0 && tile - 1, column + 1 < columns && tile + 1, tile >= columns && tile - columns, tile + columns < columns * rows && tile + columns];
        return beside.reduce((best, other) => (other !== false && depth[other] < BEHIND && (best < 0 || depth[other] > depth[best]) ? other : best), -1);
      });
      found.forEach((from, i) => {
        if (from < 0) return;
        const tile = open[i];
        depth[tile] = depth[from];
        this.#left[tile] = this.#left[from];
        this.#top[tile] = this.#top[from];
        this.#isEmpty[tile] = this.#isEmpty[from];
      });
      open = open.filter((_, i) => found[i] < 0);
    }
    for (const tile of open) this.#isEmpty[tile] = 1;
  }

  /** How a place changes from a tile to the next one: between neighbours on the same surface, else as in a frame that is not warped. */
  #slope(places, tile, before, after, usual) {
    const most = JUMP * 4 + usual;
    const ahead = places[after] - places[tile];
    const behind = places[tile] - places[before];
    const isAhead = after !== tile && Math.abs(ahead - usual) < most;
    const isBehind = before !== tile && Math.abs(behind - usual) < most;
    if (isAhead && isBehind) return (ahead + behind) / 2;
    return isAhead ? ahead : isBehind ? behind : usual;
  }

  #drawTile(column, row, out, width, height, ground) {
    const columns = this.#columns;
    const tile = row * columns + column;
    const fromX = column * TILE;
    const fromY = row * TILE;
    const toX = Math.min(fromX + TILE, width);
    const toY = Math.min(fromY + TILE, height);
    const west = column > 0 ? tile - 1 : tile; // a tile at the border is its own neighbour
    const east = column + 1 < columns ? tile + 1 : tile;
    const north = row > 0 ? tile - columns : tile;
    const south = row + 1 < this.#rows ? tile + columns : tile;
    const empty = this.#isEmpty;
    if (empty[tile] && empty[west] && empty[east] && empty[north] && empty[south]) {
      for (let y = fromY; y < toY; y += 1) out.fill(ground, y * width + fromX, y * width + toX);
      return;
    }
    const { width: wide, height: high, pixels } = this.#frame;
    const ux = this.#slope(this.#left, tile, west, east, TILE * wide / width) / TILE;
    const vx = this.#slope(this.#top, tile, west, east, 0) / TILE;
    const uy = this.#slope(this.#left, tile, north, south, 0) / TILE;
    const vy = this.#slope(this.#top, tile, north, south, TILE * high / height) / TILE;
    const u = this.#left[tile] - 0.5; // px centres lie at 0.5
    const v = this.#top[tile] - 0.5;
    const mostX = 65536 * (wide - 1) - 1;
    const mostY = 65536 * (high - 1) - 1;
    const stepX = Math.round(65536 * ux) | 0; // 16 bits of a px: sums of integers stay exact
    const stepY = Math.round(65536 * vx) | 0;
    for (let y = fromY; y < toY; y += 1) {
      const asideX = 0.5 - TILE / 2;
      const asideY = y + 0.5 - (row + 0.5) * TILE;
      let x16 = Math.round(65536 * (u + ux * asideX + uy * asideY)) | 0;
      let y16 = Math.round(65536 * (v + vx * asideX + vy * asideY)) | 0;
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
        // Two channels at a time, with weights of 8 bits.
        const evenA = a & 0xff00ff;
        const evenC = c & 0xff00ff;
        const oddA = (a >>> 8) & 0xff00ff;
        const oddC = (c >>> 8) & 0xff00ff;
        const evenTop = (evenA + (Math.imul((b & 0xff00ff) - evenA, fx) >> 8)) & 0xff00ff;
        const evenLow = (evenC + (Math.imul((d & 0xff00ff) - evenC, fx) >> 8)) & 0xff00ff;
        const oddTop = (oddA + (Math.imul(((b >>> 8) & 0xff00ff) - oddA, fx) >> 8)) & 0xff00ff;
        const oddLow = (oddC + (Math.imul(((d >>> 8) & 0xff00ff) - oddC, fx) >> 8)) & 0xff00ff;
        const even = (evenTop + (Math.imul(evenLow - evenTop, fy) >> 8)) & 0xff00ff;
        const odd = (oddTop + (Math.imul(oddLow - oddTop, fy) >> 8)) & 0xff00ff;
        out[at] = even | (odd << 8);
        x16 = (x16 + stepX) | 0;
        y16 = (y16 + stepY) | 0;
      }
    }
  }
}
