// SPDX-License-Identifier: Apache-2.0
// Draws the overlay (measurements, scale bar) into a saved picture.
import { overlayPlacement } from '../core/capture.js';
import { byId } from './dom.js';

/** What a drawing without the style sheets of the page needs. */
const PROPERTIES = ['fill', 'fill-opacity', 'stroke', 'stroke-opacity', 'stroke-width', 'stroke-dasharray', 'stroke-linecap',
  'stroke-linejoin', 'opacity', 'display', 'visibility', 'paint-order', 'font-family', 'font-size', 'font-weight', 'letter-spacing',
  'text-anchor', 'dominant-baseline'];

const overlay = () => byId('overlay');

/** True if the overlay shows anything. */
export function hasAnnotations() {
  return !overlay().hasAttribute('hidden') && overlay().querySelector('path, line, polyline, polygon, circle, ellipse, rect, text') !== null;
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
  return canvas.convertToBlob({ type: blob.type, quality: quality / 100 });
}
