// SPDX-License-Identifier: Apache-2.0
// What covers the picture: the open panel, the toolbar, the status bar and others.
import { byId } from '../controls/dom.js';

/** How far an element reaches into the picture from the side, in CSS px; 0 if it is hidden or lies elsewhere. */
function reach(element, side, picture) {
  const box = element.getBoundingClientRect();
  if (box.width === 0 || box.height === 0) return 0;
  const px = { left: box.right - picture.left, top: box.bottom - picture.top, bottom: picture.bottom - box.top }[side];
  const length = side === 'left' ? picture.width : picture.height;
  return px > 0 && px < length / 2 ? px : 0;
}

/** The margins {left, right, top, bottom} of the picture in CSS px. */
export function marginsOf(canvas) {
  const picture = canvas.getBoundingClientRect();
  const isOpen = byId('panel').dataset.open === 'true';
  return {
    left: isOpen ? reach(byId('panel'), 'left', picture) : 0,
    right: 0,
    top: reach(byId('toolbar'), 'top', picture),
    bottom: reach(byId('status'), 'bottom', picture),
  };
}

/** Calls told() when one of the large ones opens, closes or changes its size. */
export function onCovers(told) {
  const observer = new ResizeObserver(() => told());
  for (const name of ['panel', 'toolbar', 'mode-bar', 'status']) observer.observe(byId(name));
}

const ABOVE_ALL = '#panel, #toolbar, #mode-bar, #status, #stats, #notice, .prompt';
const ABOVE_PANE = '.cube, #scale-bar, #color-bar, .compare-badge, .pane-title, .slice-read, .slice-foot, .slice-letter, .slice-slider';

/** Returns what lies above a picture or a slice and would hide its labels: boxes {x, y, width, height} in CSS px; x and y are the middle. */
export function coversOf(canvas) {
  const picture = canvas.getBoundingClientRect();
  const above = [...document.querySelectorAll(ABOVE_ALL), ...canvas.closest('.pane').querySelectorAll(ABOVE_PANE)];
  return above.map((element) => element.getBoundingClientRect())
    .filter(({ left, right, top, bottom }) => right > picture.left && left < picture.right && bottom > picture.top && top < picture.bottom && right > left)
    .map(({ left, top, width, height }) => ({ x: left + width / 2 - picture.left, y: top + height / 2 - picture.top, width, height }));
}
