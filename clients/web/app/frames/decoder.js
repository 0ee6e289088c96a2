// SPDX-License-Identifier: Apache-2.0
// Decodes images in a worker, so that neither input nor acknowledgements wait for it. Where the worker fails, the page decodes.
const calls = new Map(); // by id: {resolve, reject}
let worker = null;
let hasFailed = false;
let ids = 0;

// A page of another origin that embeds <splat-view> may not start a worker of the daemon.
function start() {
  try {
    worker = new Worker(new URL('../frames/decode_worker.js', import.meta.url));
  } catch {
    hasFailed = true;
    return;
  }
  worker.onmessage = ({ data: { id, image, error } }) => {
    const call = calls.get(id);
    calls.delete(id);
    if (image) call.resolve(image);
    else call.reject(new Error(error));
  };
  worker.onerror = () => {
    worker.onmessage = null;
    worker.terminate();
    hasFailed = true;
    for (const { reject } of calls.values()) reject(new Error('the worker that decodes images failed'));
    calls.clear();
  };
}

/** Starts the worker, so that the first picture does not wait for it. */
export function prepareDecoder() {
  if (!worker && !hasFailed) start();
}

/** Decodes the payload of a frame and resolves to an ImageBitmap. The payload moves to the worker and is empty afterwards. */
export function decodeImage({ payload, type }) {
  prepareDecoder();
  if (hasFailed) return createImageBitmap(new Blob([payload], { type }));
  const id = ++ids;
  return new Promise((resolve, reject) => {
    calls.set(id, { resolve, reject });
    worker.postMessage({ id, payload, type }, [payload.buffer]);
  });
}
