// SPDX-License-Identifier: Apache-2.0
// The panel "Clip": a box with two sliders per axis, and one plane with its depth along its normal.
import { WHOLE, depthOf, moveFace, planeAt, sight } from '../core/clip.js';
import { byId } from './dom.js';
import { showValue } from './fields.js';

const DEPTH = 0.5;
const percent = (part) => `${Math.round(part * 100)} %`;

export function install({ viewer }) {
  const panel = new ClipPanel(viewer);
  viewer.on('view', () => {
    for (const id of ['clip-section', 'plane-section']) byId(id).inert = !viewer.canControl;
    panel.show();
  });
}

class ClipPanel {
  #viewer; #faces; #toggle; #depth; #button;
  /** The planes that the user switched off last, with their volume; switching on restores them. */
  #saved = null;

  constructor(viewer) {
    this.#viewer = viewer;
    this.#faces = [...byId('clip-section').querySelectorAll('input')];
    this.#toggle = byId('plane');
    this.#depth = byId('plane-depth');
    this.#button = byId('plane-sight');
    for (const face of this.#faces) {
      face.addEventListener('input', ({ timeStamp }) => {
        const { corner, axis } = face.dataset;
        viewer.change({ clip: { box: moveFace(this.#box, Number(corner), Number(axis), face.valueAsNumber) } }, timeStamp);
      });
    }
    this.#toggle.addEventListener('change', ({ timeStamp }) => this.#switch(this.#toggle.checked, timeStamp));
    this.#depth.addEventListener('input', ({ timeStamp }) => {
      const [first, ...others] = this.#planes;
      if (first) this.#set(() => [planeAt(viewer.box, first.normal, this.#depth.valueAsNumber), ...others], timeStamp);
    });
    this.#button.addEventListener('click', ({ timeStamp }) => {
      const [first, ...others] = this.#planes;
      this.#set(() => [this.#facing(first ? depthOf(viewer.box, first) : DEPTH), ...others], timeStamp);
    });
  }

  get #box() { return this.#viewer.view?.clip?.box ?? WHOLE; }
  get #planes() { return this.#viewer.view?.clip?.planes ?? []; }

  /** make() returns the new planes; it runs once camera and volume are known. */
  #set(make, time) {
    if (this.#viewer.isReady) this.#viewer.change({ clip: { planes: make() } }, time);
  }

  /** A plane perpendicular to the view direction. */
  #facing(depth) {
    return planeAt(this.#viewer.box, sight(this.#viewer.camera), depth);
  }

  #switch(isOn, time) {
    const { volume } = this.#viewer.view;
    if (!isOn) this.#saved = { volume, planes: this.#planes };
    const saved = this.#saved?.volume === volume ? this.#saved.planes : [];
    this.#set(() => (!isOn ? [] : saved.length ? saved : [this.#facing(DEPTH)]), time);
  }

  /** Shows the values of the view. */
  show() {
    const box = this.#box;
    for (const face of this.#faces) {
      const { corner, axis } = face.dataset;
      const value = box[corner][axis];
      face.value = value;
      face.setAttribute('aria-valuetext', percent(value));
      face.parentElement.style.setProperty(corner === '0' ? '--low' : '--high', value);
      face.closest('.row').querySelector('output').textContent = `${Math.round(box[0][axis] * 100)}–${percent(box[1][axis])}`;
    }
    const [plane] = this.#planes;
    const depth = plane && this.#viewer.box ? depthOf(this.#viewer.box, plane) : DEPTH;
    this.#toggle.checked = Boolean(plane);
    this.#depth.disabled = !plane;
    this.#depth.closest('.row').toggleAttribute('data-idle', !plane);
    this.#depth.value = depth;
    showValue(this.#depth, plane ? percent(depth) : '');
  }
}
