// SPDX-License-Identifier: Apache-2.0
// The lines of the other planes in each pane, the handles that turn the oblique plane, and what a drag in a pane moves.
import { cutLine, turnNormal } from '../../core/slices.js';
import { add, dot, normalize, scale, subtract } from '../../core/vector.js';
import { svg } from '../controls/dom.js';

const HANDLE_PX = [12, 22]; // for a mouse or a pen, and for a finger
const LINE_PX = [5, 12];
const GAP_PX = 7; // around the crosshair's centre

export class SliceLines {
  #slices;

  /** slices: the state of slices.js. */
  constructor(slices) {
    this.#slices = slices;
  }

  /** Where the lines of the other planes lie in a pane: [{plane, ends: two points in px}]. */
  #cuts(pane, toPane) {
    const reach = 2 * Math.hypot(...pane.size) / pane.view.zoom;
    return [...this.#slices.panes.values()].filter((other) => other !== pane).map((other) => {
      const plane = this.#slices.planeOf(other.id);
      const line = cutLine(pane.plane, plane, reach);
      return line && { plane, ends: line.map(toPane) };
    }).filter(Boolean);
  }

  /** The handles that turn the oblique plane in an orthogonal pane, px. */
  #handles(pane, toPane) {
    if (!this.#slices.isOblique || pane.plane.axis === null) return null;
    const cut = this.#cuts(pane, toPane).find(({ plane }) => plane.kind === 'oblique');
    if (!cut) return null;
    const [a, b] = cut.ends;
    const length = Math.hypot(b.x - a.x, b.y - a.y);
    const along = [(b.x - a.x) / length, (b.y - a.y) / length];
    const middle = toPane(this.#slices.position);
    const far = 0.36 * Math.min(...pane.size);
    return {
      middle: [middle.x, middle.y], along,
      places: [-far, far].map((way) => [middle.x + along[0] * way, middle.y + along[1] * way]),
    };
  }

  draw(pane, { group, toPane }) {
    const middle = toPane(this.#slices.position);
    const parts = this.#cuts(pane, toPane).flatMap(({ plane, ends }) => ends.map((end) => {
      const length = Math.hypot(end.x - middle.x, end.y - middle.y);
      const share = Math.min(1, GAP_PX / length);
      return svg('line', {
        class: 'slice-line', 'data-kind': plane.kind, x1: middle.x + (end.x - middle.x) * share, y1: middle.y + (end.y - middle.y) * share,
        x2: end.x, y2: end.y,
      });
    }));
    const handles = this.#handles(pane, toPane);
    for (const [x, y] of handles?.places ?? []) parts.push(svg('circle', { class: 'slice-handle', cx: x, cy: y, r: 6 }));
    group.replaceChildren(...parts);
  }

  /** Finds what a drag that begins at `at` moves: a handle or the line of the oblique plane; null = the crosshair. type: of the pointer. */
  grab(pane, at, type) {
    const kind = Number(type === 'touch');
    const handles = this.#handles(pane, (world) => pane.toPane(world));
    if (!handles) return null;
    const away = (place) => Math.hypot(place[0] - at[0], place[1] - at[1]);
    const { middle, along, places } = handles;
    if (places.some((place) => away(place) < HANDLE_PX[kind])) {
      return { kind: 'turn', normal: this.#slices.normal, from: Math.atan2(at[1] - middle[1], at[0] - middle[0]) };
    }
    const beside = Math.abs((at[0] - middle[0]) * along[1] - (at[1] - middle[1]) * along[0]);
    return beside < LINE_PX[kind] && away(middle) > 2 * GAP_PX ? { kind: 'shift', position: this.#slices.position, from: pane.toWorld(...at) } : null;
  }

  cursor(pane, at, type) {
    const grabbed = this.#slices.grid && pane.plane ? this.grab(pane, at, type) : null;
    return { turn: 'grab', shift: 'move' }[grabbed?.kind] ?? 'crosshair';
  }

  drag(pane, gesture, at, time) {
    if (gesture.kind === 'turn') {
      const { x, y } = pane.toPane(this.#slices.position);
      const angle = Math.atan2(at[1] - y, at[0] - x) - gesture.from;
      this.#slices.change({ normal: turnNormal(gesture.normal, pane.plane, angle) }, time);
    } else if (gesture.kind === 'shift') {
      const normal = normalize(this.#slices.normal);
      const moved = dot(subtract(pane.toWorld(...at), gesture.from), normal);
      this.#slices.setPosition(add(gesture.position, scale(normal, moved)), time);
    } else {
      this.#slices.setPosition(pane.toWorld(...at), time);
    }
  }
}
