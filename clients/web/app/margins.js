// SPDX-License-Identifier: Apache-2.0
// What covers the edges of the picture: the open panel, the toolbar and the status bar.
import { byId } from './dom.js';

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
