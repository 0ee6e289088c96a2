// SPDX-License-Identifier: Apache-2.0
// The colour bar: which colour of the picture stands for which value. It lies between the orientation cube and the scale bar, or beside the
// scale bar where there is no space between the two.
import { colorBarOf } from '../../core/color_bar.js';
import { t } from '../../core/text.js';
import { nextFrame } from '../frames/animation.js';
import { byId, make, setText } from '../controls/dom.js';
import { marginsOf, onCovers } from '../shell/margins.js';

const [LONGEST, SHORTEST] = [170, 90]; // px
const SHARE = 0.3; // of a small picture
const STRIP_PX = 256; // of the drawing
const SPACE = { vertical: 46, flat: 30 }; // px around the strip: for the title, the labels and the distance to others
const css = ({ color, isHidden }) => `rgb(${color.map((part) => Math.round(part * 255)).join(' ')} / ${isHidden ? 0 : 1})`;

/** Paints the colours into a canvas of one row or one column, whose lower or left end is `at` 0. */
function paint(canvas, colors, isFlat) {
  [canvas.width, canvas.height] = isFlat ? [STRIP_PX, 1] : [1, STRIP_PX];
  const context = canvas.getContext('2d');
  const gradient = isFlat ? context.createLinearGradient(0, 0, STRIP_PX, 0) : context.createLinearGradient(0, STRIP_PX, 0, 0);
  colors.forEach(({ at, color, isHidden }, i) => {
    const before = colors[i - 1];
    if (before && before.isHidden !== isHidden) gradient.addColorStop(at, css({ color, isHidden: before.isHidden }));
    gradient.addColorStop(at, css({ color, isHidden: isHidden || (i === colors.length - 1 && Boolean(before?.isHidden)) }));
  });
  context.clearRect(0, 0, STRIP_PX, STRIP_PX);
  context.fillStyle = gradient;
  context.fillRect(0, 0, STRIP_PX, STRIP_PX);
}

class ColorBar {
  #app;
  #title = make('span', { class: 'color-title' });
  #strip = make('canvas', {});
  #ticks = make('span', { class: 'color-ticks' });
  #root = make('div', { id: 'color-bar', role: 'img', hidden: true }, this.#title, make('span', { class: 'color-body' }, this.#ticks, this.#strip));
  #switch = byId('color-bar-on');
  #shown = ''; // what the bar shows, as text
  #bar = null;
  #size = '';
  #isPlanned = false;

  constructor(app) {
    this.#app = app;
    const { connection, storage, transfer, viewer, overlay, later } = app;
    byId('pane-3d').append(this.#root);
    this.#switch.checked = storage.recall('color-bar') !== 'no';
    this.#switch.addEventListener('change', () => {
      storage.remember('color-bar', this.#switch.checked ? 'yes' : 'no');
      this.#plan();
    });
    viewer.on('view', () => this.#plan());
    connection.on('volumes', () => this.#plan());
    transfer.onShow(() => this.#plan());
    later.whenInstalled('compare', () => app.compare.onChange(() => this.#plan()));
    onCovers(() => this.#plan());
    overlay.layer((project, { width, height }) => {
      const size = `${width} ${height}`;
      if (size !== this.#size) this.#plan();
      this.#size = size;
    });
  }

  #plan() {
    if (this.#isPlanned) return;
    this.#isPlanned = true;
    nextFrame(() => {
      this.#isPlanned = false;
      this.#draw();
    });
  }

  /** B of a comparison may have other colours. */
  get #isWanted() { return this.#switch.checked && !this.#app.compare?.splitsPicture; }

  #draw() {
    const { viewer, connection, transfer } = this.#app;
    const { view } = viewer;
    const histogram = transfer.volume === view?.volume ? transfer.histogram : null;
    this.#bar = view && this.#isWanted ? colorBarOf(view, { volumes: connection.volumes, histogram }) : null;
    const place = this.#bar && this.#place();
    this.#root.hidden = !place;
    if (!place) return;
    const shown = JSON.stringify([this.#bar, place.isFlat]);
    if (shown === this.#shown) return;
    this.#shown = shown;
    this.#fill(place.isFlat);
  }

  /** Puts the bar where it covers nothing; {isFlat}, or null if there is no space. */
  #place() {
    const pane = byId('pane-3d').getBoundingClientRect();
    const [cube, scale] = [byId('cube'), byId('scale-bar')].map((element) => (element.checkVisibility() ? element.getBoundingClientRect() : null));
    const floor = (scale?.top ?? pane.bottom - SPACE.flat) - pane.top;
    const free = floor - ((cube?.bottom ?? pane.top) - pane.top) - SPACE.vertical;
    const { style } = this.#root;
    const isFlat = free < SHORTEST;
    const edge = isFlat && scale ? scale.left : pane.right;
    const wide = edge - pane.left - marginsOf(byId('screen')).left - 2 * SPACE.flat;
    if (isFlat && wide < SHORTEST) return null;
    this.#root.toggleAttribute('data-flat', isFlat);
    const longest = Math.max(SHORTEST, Math.min(LONGEST, SHARE * (isFlat ? pane.width : pane.height)));
    style.setProperty('--length', `${Math.floor(Math.min(longest, isFlat ? wide : free))}px`);
    style.right = isFlat && scale ? `${Math.round(pane.right - scale.left + SPACE.flat)}px` : '';
    style.bottom = `${Math.round(pane.height - (isFlat && scale ? scale.bottom - pane.top : floor - 14))}px`;
    return { isFlat };
  }

  #fill(isFlat) {
    const { colors, ticks, low, high, name, unit, projection } = this.#bar;
    const what = projection ? t(`colorbar.${projection}`, { name: name || t('colorbar.values') }) : name;
    const title = unit && projection !== 'sum' ? t('colorbar.unit', { name: what, unit }).trim() : what;
    setText(this.#title, title);
    this.#title.hidden = !title;
    this.#root.title = title;
    this.#root.setAttribute('aria-label', t('colorbar.label', { name: what || t('colorbar.values'), low, high: `${high} ${projection === 'sum' ? '' : unit}`.trim() }));
    paint(this.#strip, colors, isFlat);
    const labels = isFlat ? [ticks[0], ticks.at(-1)] : ticks;
    this.#ticks.replaceChildren(...labels.map(({ at, text }) => {
      const label = make('span', { text });
      label.style.setProperty('--at', String(at));
      return label;
    }));
  }
}

export function install(app) {
  new ColorBar(app);
}
