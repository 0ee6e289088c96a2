// SPDX-License-Identifier: Apache-2.0
// The worker of decoder.js. {id, payload, type} → {id, image} or {id, error}.
self.onmessage = async ({ data: { id, payload, type } }) => {
  try {
    const image = await createImageBitmap(new Blob([payload], { type }));
    self.postMessage({ id, image }, { transfer: [image] });
  } catch (error) {
    self.postMessage({ id, error: error.message });
  }
};
