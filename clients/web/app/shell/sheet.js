// SPDX-License-Identifier: Apache-2.0
// The panel on a phone: a sheet at the bottom, whose head sets one of three heights by a drag or a tap, or a sheet at the left (sheet.css).
// The picture takes the space that is left, and the camera keeps what it frames.
import { widen } from '../../core/camera.js';
import { settle } from '../../core/sheet.js';
import { byId, icon } from '../controls/dom.js';
import { NARROW } from './panel.js';

const HEIGHTS = ['closed', 'half', 'full'];
const TAP_PX = 6;

/** Drags and taps of the head. */
class Head {
  #panel; #root;
  #start = null; // {id, y, height, heights: null until the drag begins}

  constructor(panel, header) {
    this.#panel = panel;
    this.#root = byId('panel');
    header.addEventListener('pointerdown', (event) => this.#down(event));
    header.addEventListener('pointermove', (event) => this.#start?.id === event.pointerId && this.#move(event, header));
    header.addEventListener('pointerup', (event) => this.#start?.id === event.pointerId && this.#up(event));
    header.addEventListener('pointercancel', () => this.#end(this.#panel.height));
    header.addEventListener('lostpointercapture', ({ target }) => target === header && this.#end(this.#panel.height)); // not the event of a child
  }

  /** Only the sheet at the bottom has a head that forbids scrolling. */
  #down(event) {
    if (event.button !== 0 || this.#start || getComputedStyle(event.currentTarget).touchAction !== 'none') return;
    this.#start = { id: event.pointerId, y: event.clientY, height: this.#root.offsetHeight, heights: null };
  }

  #move(event, header) {
    const moved = this.#start.y - event.clientY;
    if (!this.#start.heights) {
      if (Math.abs(moved) < TAP_PX) return;
      header.setPointerCapture(event.pointerId); // and its buttons get no click
      this.#begin();
    }
    const { height, heights } = this.#start;
    this.#root.style.height = `${Math.min(Math.max(height + moved, heights[0]), heights.at(-1))}px`;
  }

  #begin() {
    this.#root.dataset.drag = '';
    byId('panel-body').hidden = false;
    this.#start.heights = HEIGHTS.map((name) => {
      this.#root.dataset.height = name;
      return this.#root.offsetHeight;
    });
    this.#root.dataset.height = this.#panel.height;
  }

  #up(event) {
    const { height, heights, y } = this.#start;
    if (heights) {
      this.#end(HEIGHTS[settle(heights, HEIGHTS.indexOf(this.#panel.height), height + y - event.clientY)]);
    } else {
      this.#start = null;
      if (!event.target.closest('button')) this.#panel.set(this.#panel.height === 'half' ? 'full' : 'half');
    }
  }

  #end(height) {
    if (!this.#start) return;
    const wasDragged = this.#start.heights !== null;
    this.#start = null;
    if (!wasDragged) return;
    delete this.#root.dataset.drag;
    this.#root.style.height = '';
    this.#panel.set(height);
  }
}

/** How far the camera must be, compared with a square picture, so that the shorter side shows the same. */
function distanceIn({ viewport, rig, margins }) {
  return widen({ ...rig, distance: 1, height: 1 }, viewport, margins).distance;
}

/** Keeps what the shorter side of the picture shows when the sheet or a turn of the phone changes the picture's shape. */
function keepFraming({ viewer, screen, participants, modes }) {
  const narrow = window.matchMedia(NARROW);
  let before = null;
  const shape = () => (narrow.matches && viewer.rig ? distanceIn(viewer) : null);
  viewer.on('view', () => { before ??= shape(); });
  screen.onResize(() => {
    const [from, to] = [before, shape()];
    before = to;
    const isMine = viewer.isReady && (participants.isHolder || participants.count <= 1);
    if (from === null || to === null || from === to || !isMine || modes.current === 'walk') return;
    const { rig } = viewer;
    viewer.place({ ...rig, distance: rig.distance * to / from, height: rig.height * to / from });
  });
}

export function install(app) {
  const { panel, modes } = app;
  new Head(panel, byId('panel').querySelector('header'));
  const size = byId('panel-size');
  size.append(icon('chevrons-up'));
  size.addEventListener('click', () => panel.set(panel.height === 'full' ? 'half' : 'full'));
  modes.on('change', () => { // a tool needs the picture
    if (!modes.isNavigating && panel.height === 'full') panel.set('half');
  });
  keepFraming(app);
}
