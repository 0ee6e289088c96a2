// SPDX-License-Identifier: Apache-2.0
// The size of a saved picture, and the view that gives it.

/** Largest side of an image in px, as in sp/view.h. */
export const SIDE_MAX = 8192;

/** Presets by name; null: the size of the window. */
export const SIZES = { window: null, hd: [1920, 1080], uhd: [3840, 2160], square: [2048, 2048] };

/** Why the daemon would refuse the size: {code: 'side' or 'pixels', limit}; null if it is fine. */
export function sizeProblem(size, maxPixels) {
  const isSide = (n) => Number.isInteger(n) && n >= 1 && n <= SIDE_MAX;
  if (!size.every(isSide)) return { code: 'side', limit: SIDE_MAX };
  return size[0] * size[1] > maxPixels ? { code: 'pixels', limit: maxPixels } : null;
}

/** The largest size with the same shape that the daemon allows. */
export function fitSize([width, height], maxPixels) {
  const factor = Math.min(1, SIDE_MAX / Math.max(width, height), Math.sqrt(maxPixels / (width * height)));
  return [width, height].map((n) => Math.max(1, Math.floor(n * factor)));
}

/** The view to render. isTransparent: without a background, for formats with alpha. */
export function captureView(view, size, isTransparent) {
  return { ...view, size, ...(isTransparent ? { background: [0, 0, 0, 0] } : {}) };
}

/** True if files of this format have alpha. */
export const hasAlpha = (format) => format !== 'jpeg';

/**
 * Where the overlay of the viewport lies in a picture of another size: {scale, x, y}. The field of view is vertical, so the height
 * is what both have in common.
 */
export function overlayPlacement(viewport, [width, height]) {
  const scale = height / viewport.height;
  return { scale, x: (width - viewport.width * scale) / 2, y: 0 };
}

/** Reads a response body and reports its progress: told(received, total); total 0: not known. Returns the chunks. */
export async function readProgress(answer, told) {
  const total = Number(answer.headers.get('Content-Length')) || 0;
  const reader = answer.body.getReader();
  const chunks = [];
  let received = 0;
  for (let part = await reader.read(); !part.done; part = await reader.read()) {
    chunks.push(part.value);
    received += part.value.length;
    told(received, total);
  }
  return chunks;
}
