// SPDX-License-Identifier: Apache-2.0
// Draws the overlay (measurements), the scale bar, the colour bar and the orientation cube into a saved picture.
import { overlayPlacement } from '../../core/capture.js';
import { byId } from '../controls/dom.js';

/** The properties that a drawing needs once it is outside of the page and its style sheets. */
const PROPERTIES = ['fill', 'fill-opacity', 'stroke', 'stroke-opacity', 'stroke-width', 'stroke-dasharray', 'stroke-linecap',
  'stroke-linejoin', 'opacity', 'display', 'visibility', 'paint-order', 'font-family', 'font-size', 'font-weight', 'letter-spacing',
  'text-anchor', 'dominant-baseline'];

const CORNER_PX = 14; // from the scale bar and the cube to the edges of the picture

const overlay = () => byId('overlay');

const isShown = (element) => element !== null && element.checkVisibility();

/** True if the page shows anything above the picture. */
export function hasAnnotations() {
  return isShown(byId('scale-bar')) || isShown(byId('color-bar')) || isShown(byId('cube')) || !overlay().hasAttribute('hidden') && overlay().querySelector('path, line, polyline, polygon, circle, ellipse, rect, text') !== null;
}

/** A copy of an <svg>, with the computed style of each element as attributes, as a document of its own. */
function serialize(source, [width, height], viewBox) {
  const copy = source.cloneNode(true);
  const [from, to] = [source, copy].map((root) => [...root.querySelectorAll('*')]);
  from.forEach((element, i) => {
    const style = getComputedStyle(element);
    for (const name of PROPERTIES) to[i].setAttribute(name, style.getPropertyValue(name));
    to[i].removeAttribute('style');
  });
  copy.removeAttribute('hidden');
  copy.setAttribute('xmlns', 'http://www.w3.org/2000/svg');
  copy.setAttribute('width', width);
  copy.setAttribute('height', height);
  copy.setAttribute('viewBox', viewBox);
  return new XMLSerializer().serializeToString(copy);
}

async function load(url) {
  const image = new Image();
  image.src = url;
  await image.decode();
  return image;
}

/** Resolves to an image of an <svg> of the page in a size in px. */
export async function imageOf(source, size, viewBox) {
  const url = URL.createObjectURL(new Blob([serialize(source, size, viewBox)], { type: 'image/svg+xml' }));
  try {
    return await load(url);
  } finally {
    URL.revokeObjectURL(url);
  }
}

/** Draws the scale bar of the page, if it shows one, with its lower right corner at a place. */
export function drawScaleBar(context, [right, bottom]) {
  const root = byId('scale-bar');
  if (!isShown(root)) return;
  const [line, text] = ['.scale-line', '.scale-text'].map((part) => root.querySelector(part));
  const [{ width, height }, above] = [line, text].map((part) => part.getBoundingClientRect());
  const { fontWeight, fontSize, fontFamily } = getComputedStyle(text);
  context.save();
  Object.assign(context, { font: `${fontWeight} ${fontSize} ${fontFamily}`, textAlign: 'center', textBaseline: 'bottom' });
  Object.assign(context, { shadowColor: '#000', shadowBlur: 3, fillStyle: '#fff', strokeStyle: '#fff', lineWidth: 1.5 });
  const center = right - Math.max(width, above.width) / 2;
  context.stroke(new Path2D(`M${center - width / 2} ${bottom - height}v${height}h${width}v${-height}`));
  context.fillText(text.textContent, center, bottom - height - 2);
  context.restore();
}

/** Draws the colour bar, if the page has one, at the same distance from the scale bar as in the page. [right, bottom]: the corner of the scale bar.
 */
export function drawColorBar(context, [right, bottom]) {
  const root = byId('color-bar');
  if (!isShown(root)) return;
  const scale = byId('scale-bar').getBoundingClientRect();
  const strip = root.querySelector('canvas');
  const placed = (element) => {
    const { left, top, width, height } = element.getBoundingClientRect();
    return [left - scale.right + right, top - scale.bottom + bottom, width, height];
  };
  context.save();
  Object.assign(context, { shadowColor: '#000', shadowBlur: 3, fillStyle: '#fff', strokeStyle: 'rgb(255 255 255 / 65%)', lineWidth: 1, textBaseline: 'middle' });
  context.strokeRect(...placed(strip));
  for (const element of root.querySelectorAll('.color-title, .color-ticks span')) {
    const { fontWeight, fontSize, fontFamily } = getComputedStyle(element);
    const [x, y, width, height] = placed(element);
    context.font = `${fontWeight} ${fontSize} ${fontFamily}`;
    context.fillText(element.textContent, x, y + height / 2, width);
  }
  context.shadowBlur = 0;
  context.drawImage(strip, ...placed(strip));
  context.restore();
}

/** Draws the cube with its letters into the upper right corner. */
async function drawCube(context, width, scale) {
  const cube = byId('cube');
  if (!isShown(cube)) return;
  const side = cube.getBoundingClientRect().width;
  const drawing = await imageOf(cube, [side * scale, side * scale], cube.getAttribute('viewBox'));
  context.drawImage(drawing, width / scale - side - CORNER_PX, CORNER_PX, side, side);
}

/** Resolves to the picture with the overlay in it, in the same format. */
export async function burnIn(blob, { size: [width, height], viewport, quality }) {
  const { scale, x, y } = overlayPlacement(viewport, [width, height]);
  const [picture, drawing] = await Promise.all([createImageBitmap(blob),
    imageOf(overlay(), [width, height], `${-x / scale} ${-y / scale} ${width / scale} ${height / scale}`)]);
  const canvas = new OffscreenCanvas(width, height);
  const context = canvas.getContext('2d');
  context.drawImage(picture, 0, 0);
  context.drawImage(drawing, 0, 0, width, height);
  picture.close();
  context.scale(scale, scale);
  drawScaleBar(context, [width / scale - CORNER_PX, height / scale - CORNER_PX]);
  drawColorBar(context, [width / scale - CORNER_PX, height / scale - CORNER_PX]);
  await drawCube(context, width, scale);
  return canvas.convertToBlob({ type: blob.type, quality: quality / 100 });
}
