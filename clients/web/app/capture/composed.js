// SPDX-License-Identifier: Apache-2.0
// One picture of all panes as the layout shows them: the 3-D picture, the slices, and the lines and letters above them.
import { drawColorBar, drawScaleBar, imageOf } from '../annotations/annotations.js';
import { byId } from '../controls/dom.js';

const TEXTS = '.pane-title, .slice-letter, .slice-foot input, .slice-foot span, .slice-read';
const PLATE = '.slice-foot'; // behind several texts

const panes = () => [...document.querySelectorAll('main > .pane:not([hidden])')];

/** The size of the picture in px. */
export function composedSize() {
  const { width, height } = document.querySelector('main').getBoundingClientRect();
  return [width, height].map((side) => Math.round(side * (window.devicePixelRatio || 1)));
}

/** Draws the texts of a pane at their places, in their fonts and colours and on their plates. */
function drawTexts(context, pane, origin) {
  context.textBaseline = 'middle';
  for (const element of pane.querySelectorAll(`${PLATE}, ${TEXTS}`)) {
    const text = element.matches(PLATE) ? '' : element.value ?? element.textContent;
    if (!element.checkVisibility() || !element.textContent && !text) continue;
    const box = element.getBoundingClientRect();
    const style = getComputedStyle(element);
    context.fillStyle = style.backgroundColor;
    context.beginPath();
    context.roundRect(box.left - origin.left, box.top - origin.top, box.width, box.height, parseFloat(style.borderRadius) || 0);
    context.fill();
    context.font = `${style.fontWeight} ${style.fontSize} ${style.fontFamily}`;
    context.fillStyle = style.color;
    context.fillText(text, box.left - origin.left + parseFloat(style.paddingLeft), box.top - origin.top + box.height / 2);
  }
}

async function drawPane(context, pane, origin, picture, ratio) {
  const is3d = pane.id === 'pane-3d';
  const lines = is3d ? byId('overlay') : pane.querySelector('svg.slice-lines');
  const content = is3d ? picture : pane.querySelector('canvas');
  const box = (is3d ? pane : pane.querySelector('canvas')).getBoundingClientRect();
  const place = [box.left - origin.left, box.top - origin.top, box.width, box.height];
  const drawing = lines && !lines.hasAttribute('hidden')
    ? await imageOf(lines, [box.width * ratio, box.height * ratio], `0 0 ${box.width} ${box.height}`) : null;
  context.save();
  context.beginPath();
  context.rect(...place);
  context.clip();
  if (content) context.drawImage(content, ...place);
  if (drawing) context.drawImage(drawing, ...place);
  drawTexts(context, pane, origin);
  if (is3d) {
    const { right, bottom } = byId('scale-bar').getBoundingClientRect();
    drawScaleBar(context, [right - origin.left, bottom - origin.top]);
    drawColorBar(context, [right - origin.left, bottom - origin.top]);
  }
  context.restore();
}

/** Resolves to a Blob. picture: the 3-D picture as a Blob, or null if the layout has none; type: of an image with 8 bits. */
export async function composePanes(picture, { type, quality }) {
  const origin = document.querySelector('main').getBoundingClientRect();
  const ratio = window.devicePixelRatio || 1;
  const canvas = new OffscreenCanvas(...composedSize());
  const context = canvas.getContext('2d');
  context.fillStyle = '#3a3f47'; // the gaps between the panes
  context.fillRect(0, 0, canvas.width, canvas.height);
  context.scale(ratio, ratio);
  const bitmap = picture && await createImageBitmap(picture);
  for (const pane of panes()) {
    const box = pane.getBoundingClientRect();
    context.fillStyle = '#000';
    context.fillRect(box.left - origin.left, box.top - origin.top, box.width, box.height);
    await drawPane(context, pane, origin, bitmap, ratio);
  }
  bitmap?.close();
  return canvas.convertToBlob({ type, quality: quality / 100 });
}
