// SPDX-License-Identifier: Apache-2.0
// Where the parts of a picture from another camera lie in a frame with depth (warp_pixels.js draws them).
//
//   cells of the frame ──► nearest surface per tile of the picture ──► place of the tile in the frame
//
// A tile is a square of TILE px of the picture. A tile that no point of the frame lands on was hidden in the frame: it repeats the farthest
// tile beside it. Only the box around what the frame shows is visited; all around it is background.
import { depthMatrix } from './warp_depth.js';

export const TILE = 6;
const CELL = 4; // px of the frame
const FILL_STEPS = 24; // tiles that a hidden part may be wide
const BEHIND = 1e9;
const STEP_PART = 1 / 16; // of the frame's range of depths: with more between them, two points lie on two surfaces
const MARGIN = 6; // cells of background around what the frame shows that are placed too: they tell holes from background

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

/** The box {left, top, right, bottom} of the cells that show something, with a margin; the right and bottom are outside. */
function boxOf(values, [across, down]) {
  let [left, top, right, bottom] = [across, down, 0, 0];
  for (let row = 0, cell = 0; row < down; row += 1) {
    for (let column = 0; column < across; column += 1, cell += 1) {
      if (values[cell] === 0) continue;
      if (column < left) left = column;
      if (column >= right) right = column + 1;
      if (row < top) top = row;
      bottom = row + 1;
    }
  }
  return { left: Math.max(0, left - MARGIN), top: Math.max(0, top - MARGIN), right: Math.min(across, right + MARGIN), bottom: Math.min(down, bottom + MARGIN) };
}

export class WarpTiles {
  #frame = null;
  #cells = { left: 0, top: 0, right: 0, bottom: 0 }; // the box of the cells that are placed
  #x = new Float32Array(0); // per cell of the box: its place in the picture [tiles, from the centre of the first one], and its depth there
  #y = new Float32Array(0);
  #z = new Float32Array(0);
  #step = 0; // between the depths of two surfaces
  #depth = new Float32Array(0); // per tile: of the nearest surface; BEHIND = there is none
  #sums = new Float32Array(0); // per tile: of weighted depths, and of the weights
  #weights = new Float32Array(0);
  #open = new Int32Array(0); // tiles that no point landed on, and the tiles beside them that they repeat
  #found = new Int32Array(0);

  columns = 0;
  rows = 0;
  left = new Float32Array(0); // per tile: the place in the frame of its centre [px]
  top = new Float32Array(0);
  isEmpty = new Uint8Array(0); // per tile: 1 = background
  box = { left: 0, top: 0, right: 0, bottom: 0 }; // of tiles: all outside is background, and has no place

  /** frame: {width, height, values (Uint8Array, a value per cell), cells, camera, near, far, aspect}. */
  take(frame) {
    this.#frame = frame;
    this.#cells = boxOf(frame.values, frame.cells);
    const { left, top, right, bottom } = this.#cells;
    const count = Math.max(0, right - left) * Math.max(0, bottom - top);
    if (this.#x.length < count) [this.#x, this.#y, this.#z] = [0, 1, 2].map(() => new Float32Array(count));
  }

  /** Places the tiles of a picture. False if the camera sees the frame from no useful place. */
  place(camera, width, height) {
    const matrix = depthMatrix(this.#frame, camera, width / height);
    const back = inverse(matrix);
    if (!back) return false;
    this.#resize(Math.ceil(width / TILE), Math.ceil(height / TILE));
    this.#project(matrix, width, height);
    this.#scatter(width, height, true);
    this.#scatter(width, height, false);
    this.#locate(back, width, height);
    return true;
  }

  #resize(columns, rows) {
    [this.columns, this.rows] = [columns, rows];
    const count = columns * rows;
    if (this.#depth.length !== count) {
      [this.#depth, this.#sums, this.#weights, this.left, this.top] = [0, 1, 2, 3, 4].map(() => new Float32Array(count));
      this.isEmpty = new Uint8Array(count);
      [this.#open, this.#found] = [0, 1].map(() => new Int32Array(count));
    }
    this.#depth.fill(BEHIND);
    this.#sums.fill(0);
    this.#weights.fill(0);
    this.isEmpty.fill(1);
  }

  /** Where the cells are in the picture, their depths, and the box of the tiles that they show something in. */
  #project(m, width, height) {
    const { values, cells: [across], width: wide, height: high } = this.#frame;
    const { left, top, right, bottom } = this.#cells;
    const [xs, ys, zs] = [this.#x, this.#y, this.#z];
    const [scaleX, scaleY] = [width / 2 / TILE, height / 2 / TILE];
    const depthOf = (v) => (m[10] * v + m[14]) / (m[11] * v + m[15]);
    this.#step = STEP_PART * Math.abs(depthOf(1 / 255) - depthOf(1));
    const farther = 2 * this.#step; // the background lies behind all
    let [fromX, fromY, toX, toY] = [Infinity, Infinity, -Infinity, -Infinity];
    for (let row = top, at = 0; row < bottom; row += 1) {
      const y = 1 - 2 * Math.min((CELL * row + CELL / 2) / high, 1);
      const [baseX, baseY, baseZ, baseW] = [m[4] * y + m[12], m[5] * y + m[13], m[6] * y + m[14], m[7] * y + m[15]];
      for (let column = left; column < right; column += 1, at += 1) {
        const x = 2 * Math.min((CELL * column + CELL / 2) / wide, 1) - 1;
        const value = values[row * across + column];
        const v = (value || 1) / 255;
        const w = m[3] * x + m[11] * v + baseW;
        const z = (m[2] * x + m[10] * v + baseZ) / w;
        const px = ((m[0] * x + m[8] * v + baseX) / w + 1) * scaleX - 0.5;
        const py = (1 - (m[1] * x + m[9] * v + baseY) / w) * scaleY - 0.5;
        xs[at] = px;
        ys[at] = py;
        zs[at] = !(w > 0) || z < -1 ? BEHIND : value ? z : z + farther;
        if (value === 0 || zs[at] === BEHIND) continue;
        if (px < fromX) fromX = px;
        if (px > toX) toX = px;
        if (py < fromY) fromY = py;
        if (py > toY) toY = py;
      }
    }
    const reachX = 2 + Math.ceil(2 * width / TILE / wide);
    const reachY = 2 + Math.ceil(2 * height / TILE / high);
    const has = (n, at) => { for (let i = 0; i < n; i += 1) if (values[at(i)]) return true; return false; };
    const down = this.#frame.cells[1];
    if (has(down, (i) => i * across)) fromX -= FILL_STEPS;
    if (has(down, (i) => i * across + across - 1)) toX += FILL_STEPS;
    if (has(across, (i) => i)) fromY -= FILL_STEPS;
    if (has(across, (i) => (down - 1) * across + i)) toY += FILL_STEPS;
    const within = (tile, most) => Math.min(Math.max(tile, 0), most) || 0; // NaN: nothing is visible
    this.box = {
      left: within(Math.floor(fromX) - reachX, this.columns), right: within(Math.ceil(toX) + reachX + 1, this.columns),
      top: within(Math.floor(fromY) - reachY, this.rows), bottom: within(Math.ceil(toY) + reachY + 1, this.rows),
    };
  }

  /** Visits each tile of the box whose centre lies in a cell. isNearest: finds the nearest depth of the tile; else sums up the depths of that
   * surface, weighted by how near the centres are. */
  #scatter(width, height, isNearest) {
    const { width: wide, height: high, values, cells: [across] } = this.#frame;
    const { left: firstColumn, top: firstRow, right: endColumn, bottom: endRow } = this.box;
    const [columns, depth, empty, sums, weights] = [this.columns, this.#depth, this.isEmpty, this.#sums, this.#weights];
    const [xs, ys, zs, step] = [this.#x, this.#y, this.#z, this.#step];
    const [halfX, halfY] = [Math.max(0.5, 2 * width / TILE / wide), Math.max(0.5, 2 * height / TILE / high)]; // of a cell, in tiles
    const cells = this.#cells;
    for (let line = cells.top, at = 0; line < cells.bottom; line += 1) {
      for (let cell = line * across + cells.left, end = line * across + cells.right; cell < end; cell += 1, at += 1) {
        const own = zs[at];
        if (own === BEHIND) continue;
        const isEmpty = values[cell] ? 0 : 1;
        const x = xs[at];
        const y = ys[at];
        const left = Math.max(firstColumn, Math.ceil(x - halfX));
        const right = Math.min(endColumn - 1, Math.floor(x + halfX));
        const bottom = Math.min(endRow - 1, Math.floor(y + halfY));
        for (let row = Math.max(firstRow, Math.ceil(y - halfY)); row <= bottom; row += 1) {
          for (let column = left, tile = row * columns + left; column <= right; column += 1, tile += 1) {
            if (isNearest) {
              if (own < depth[tile]) {
                depth[tile] = own;
                empty[tile] = isEmpty;
              }
            } else if (own <= depth[tile] + step && isEmpty === empty[tile]) {
              const weight = (halfX + 0.5 - Math.abs(x - column)) * (halfY + 0.5 - Math.abs(y - row));
              sums[tile] += weight * own;
              weights[tile] += weight;
            }
          }
        }
      }
    }
  }

  /** The place in the frame of the centre of each tile of the box: by the mean depth of its nearest surface. */
  #locate([first, second, , last], width, height) {
    const { width: wide, height: high } = this.#frame;
    const { left, top, right, bottom } = this.box;
    const [depth, sums, weights, lefts, tops, open] = [this.#depth, this.#sums, this.#weights, this.left, this.top, this.#open];
    let count = 0;
    for (let row = top; row < bottom; row += 1) {
      const y = 1 - 2 * (row + 0.5) * TILE / height;
      const [baseX, baseY, baseW] = [first, second, last].map((line) => line[1] * y + line[3]);
      for (let column = left, tile = row * this.columns + left; column < right; column += 1, tile += 1) {
        if (depth[tile] === BEHIND) {
          open[count] = tile;
          count += 1;
          continue;
        }
        const z = weights[tile] > 0 ? sums[tile] / weights[tile] : depth[tile];
        const x = 2 * (column + 0.5) * TILE / width - 1;
        const w = last[0] * x + last[2] * z + baseW;
        depth[tile] = z;
        lefts[tile] = ((first[0] * x + first[2] * z + baseX) / w + 1) / 2 * wide;
        tops[tile] = (1 - (second[0] * x + second[2] * z + baseY) / w) / 2 * high;
      }
    }
    this.#fill(count);
  }

  /** The first `count` open tiles take the farthest of the tiles beside them, ring by ring. */
  #fill(count) {
    const { left, top, right, bottom } = this.box;
    const [columns, depth, open, found] = [this.columns, this.#depth, this.#open, this.#found];
    for (let step = 0; step < FILL_STEPS && count > 0; step += 1) {
      for (let i = 0; i < count; i += 1) {
        const tile = open[i];
        const row = Math.floor(tile / columns);
        const column = tile - row * columns;
        let best = -1;
        if (column > left && depth[tile - 1] < BEHIND) best = tile - 1;
        if (column + 1 < right && depth[tile + 1] < BEHIND && (best < 0 || depth[tile + 1] > depth[best])) best = tile + 1;
        if (row > top && depth[tile - columns] < BEHIND && (best < 0 || depth[tile - columns] > depth[best])) best = tile - columns;
        if (row + 1 < bottom && depth[tile + columns] < BEHIND && (best < 0 || depth[tile + columns] > depth[best])) best = tile + columns;
        found[i] = best;
      }
      let rest = 0;
      for (let i = 0; i < count; i += 1) {
        const [tile, from] = [open[i], found[i]];
        if (from < 0) {
          open[rest] = tile;
          rest += 1;
          continue;
        }
        depth[tile] = depth[from];
        this.left[tile] = this.left[from];
        this.top[tile] = this.top[from];
        this.isEmpty[tile] = this.isEmpty[from];
      }
      count = rest;
    }
  }
}
