// SPDX-License-Identifier: Apache-2.0
// Lines, letters and handles above the 3-D picture: an SVG with one group per layer. It follows the camera of the picture that is shown,
// not the newest one, so that lines stay on what they mark while pictures are late.
import { projector } from '../../core/project.js';
import { nextFrame } from '../frames/animation.js';
import { svg } from '../controls/dom.js';

export class Overlay {
  #root; #viewer; #screen; #warp;
  #layers = new Set();
  #shown = null; // camera of the picture on the canvas
  #isPlanned = false;

  constructor(root, { viewer, screen, warp }) {
    this.#root = root;
    this.#viewer = viewer;
    this.#screen = screen;
    this.#warp = warp;
    for (const event of ['view', 'camera']) viewer.on(event, () => this.update());
    screen.onResize(() => this.update());
  }

  /** The camera of the picture on the screen. While the predicted picture is shown, this is the newest camera. Null without a view. */
  get rig() {
    return (this.#warp.isVisible ? null : this.#shown) ?? this.#viewer.rig;
  }

  /** A picture with this rig was drawn; null if it is unknown. */
  drew(rig) {
    this.#shown = rig;
    this.update();
  }

  /**
   * Adds a layer; later layers lie above. draw(project, {group, width, height, rig}) is called at the next animation frame after camera,
   * view or size changed. project(world) → {x, y, depth, isVisible}: see core/project.js. `group` is the layer's <g>, which draw() fills or
   * updates. Elements get no pointer events unless their CSS says "pointer-events: auto". Returns {group, update(), remove()}.
   */
  layer(draw) {
    const group = svg('g');
    const layer = { group, draw };
    this.#layers.add(layer);
    this.#root.append(group);
    this.update();
    return {
      group,
      update: () => this.update(),
      remove: () => {
        this.#layers.delete(layer);
        group.remove();
      },
    };
  }

  /** Draws all layers again at the next animation frame. */
  update() {
    if (this.#isPlanned || this.#layers.size === 0) return;
    this.#isPlanned = true;
    nextFrame(() => {
      this.#isPlanned = false;
      this.#draw();
    });
  }

  #draw() {
    const { rig } = this;
    const { width, height } = this.#screen.viewport;
    this.#root.toggleAttribute('hidden', !rig);
    if (!rig) return;
    this.#root.setAttribute('viewBox', `0 0 ${width} ${height}`);
    const project = projector(rig, { width, height });
    for (const { group, draw } of this.#layers) draw(project, { group, width, height, rig });
  }
}
